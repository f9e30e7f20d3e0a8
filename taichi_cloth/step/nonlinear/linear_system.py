"""The linear system of implicit methods with everything that solves it: operator, preconditioner, CG, held directions.

Shared by all methods that a simulation may use, so that each kernel is compiled once.
"""

import numpy as np

from ...backend.fields import Fields
from ...backend.language import ti
from ...backend.rows import read
from ...backend.runtime import Runtime
from ...options import Options
from ...scene.scene import Scene
from ...solver.pcg import BREAKDOWN, NOT_FINITE, PCG, Solution
from ...solver.preconditioner import build_preconditioner
from ...solver.proximal import ProximalGradient
from ...system.assembler import Assembler, Measures
from ...system.base import Base
from ...system.cones import Cones
from ...system.constraints import Filter
from ...system.held import Held, kernel_array
from ...system.operator import Operator
from ...system.state import ParticleState

ROUNDING = 64  # Phi may grow by this many roundings of its terms, and what is held be off its target by as many of positions


@ti.data_oriented
class System:
    """A model's system, ready to be linearized and solved.

    Attributes:
        contacts: `contact.contacts.Contacts`, or None.
        held: of the last solve.
        dt_coefficient: c [s] that it was linearized with.
        leads: whether the last solve led something: pins that move, solids, seams that close.
        definite: whether terms that may be indefinite are left out of every linearization; stays_definite: whether they are,
            once a matrix was indefinite.
        stitches_failed: whether stitches did in this step, which is tried again without them.
        pulled: whether something may be attached softly.
        fragile: whether single solves can be far off: something may rip or tear, or is blown up.
        resolution: rounding of positions [m].
        floor: energy [J] that this rounding amounts to.
        base: the start of the step, if not the saved state.
        notes: requests that could not be met, and their substitutes.
    """

    def __init__(self, fields: Fields, model: ParticleState, operator: Operator, forces: list, meter: Assembler,
                 options: Options, runtime: Runtime, scene: Scene, contacts=None) -> None:
        self.model, self.operator, self.meter, self.options, self.contacts = model, operator, meter, options, contacts
        self.scene, self._fields = scene, fields
        self._relaxation: ProximalGradient | None = None
        self.notes: list[str] = []
        self.preconditioner = build_preconditioner(options.preconditioner, fields, self.operator, scene, self.tell)
        self.pulled = any(force.attached is not None for force in forces)
        alone = not scene.solids and scene.air is None and not self.pulled
        self.solver = PCG(fields, self.operator, self.preconditioner, runtime, options.cg_max_iterations, alone)
        self.filter = Filter(fields, model, self.solver.dv)
        self.held: Held | None = None
        self.base: Base | None = None
        self.dt_coefficient, self.leads = 0.0, False
        self.stitches_failed, self.fragile = False, any(force.time_dependent_energy for force in forces)
        self._kept: np.ndarray | None = None
        self._kept_tension: np.ndarray | None = None
        self.epsilon = runtime.epsilon
        extent = float(np.abs(model.start_positions[model.user] - model.origin).max())
        self.resolution = runtime.epsilon * extent
        self._indefinite = [force for force in forces if force.indefinite]
        self._moves = self._definite = False  # as it was linearized
        self._over, self.definite, self.stays_definite = 0.0, False, False
        self.floor = sum(force.rounding_energy(self.resolution) for force in forces)

    def tell(self, note: str) -> None:
        """Adds a note, once."""
        if note not in self.notes:
            self.notes.append(note)

    def start_over(self) -> None:
        """The model goes back to where the attempt at a step started."""
        self.model.restore()
        if self.base is not None:
            base = self.base.x_offset, self.base.v, self.base.guess
            self._start_from(*(kernel_array(a, self.model.exchange) for a in base))

    @ti.kernel
    def _start_from(self, x_offset: ti.types.ndarray(), v: ti.types.ndarray(), guess: ti.types.ndarray()):
        """v_base, x_base; v is the guess"""
        ti.loop_config(serialize=self.model.blocks.serial)
        for i in range(self.model.rows()):
            for c in ti.static(range(3)):
                self.model.x_offset[i][c] = x_offset[i, c]
                self.model.v_base[i][c] = v[i, c]
                self.model.v[i][c] = guess[i, c]

    def predict(self, c: float, pins: Held | None, together: bool) -> None:
        """The model goes where the last step's change of velocity would lead it, and contacts are looked for on the way.

        Args:
            together: whether layers of cloth are part of the problem.
        """
        x, v = self.model.read_saved()
        self.operator.set_rhs_displacement(c)
        if self.base is not None:
            self.solver.dv.fill(0)
            self.add_guess(1.0)
        elif not self.contacts.warm:
            self.fall(c, *self.contacts.gravity)
        self.place(c, 1.0)
        self.settle(pins)
        self.contacts.begin(c, pins, x, v, together, self.base)

    def linearize_first(self, c: float, held: Held | None) -> Measures:
        """The system of a step's first solve, with the alterations of held particles: (18), from the saved state. With a
        base it is linearized at the base's guess, x = x_base + c v + y."""
        self.operator.set_rhs_displacement(c)
        if self.contacts is not None and held is not None:
            self.operator.correct_rhs_displacement(held.index, held.y)
        if self.base is not None:
            self.model.moved()
            self._go_to_guess(c)
        return self.linearize(c, moves=self.base is None)

    @ti.kernel
    def _go_to_guess(self, c: float):
        """x = x_0 + rhs_displacement + c (v - v_base)"""
        ti.loop_config(serialize=self.model.blocks.serial)
        for i in range(self.model.rows()):
            moved = self.operator.rhs_displacement[i] + c * (self.model.v[i] - self.model.v_base[i])
            self.model.x[i] = self.model.x_saved[i] + moved

    @ti.kernel
    def add_guess(self, sign: float):
        """dv += sign (v - v_base): from the base instead of from the guess, where the model is"""
        ti.loop_config(serialize=self.model.blocks.serial)
        for i in range(self.model.rows()):
            self.solver.dv[i] = self.solver.dv[i] + sign * (self.model.v[i] - self.model.v_base[i])

    def linearize(self, c: float, moves: bool = False, over: float = 0.0) -> Measures:
        """A and b at the model's state, with `moves` b with K `rhs_displacement`; see `Assembler`."""
        self.dt_coefficient, self._moves, self._over = c, moves, over
        self._leave_out(self.definite)
        return self.meter.linearize(c, moves, over)

    def imbalance(self, held: Held | None) -> float:
        """Norm of b over root masses [kg^1/2 m/s], without directions that are held: how far forces are from balance."""
        b = read(self.operator.b).astype(np.float64)
        if held is not None:
            b[held.index] -= np.einsum("kij,kj->ki", held.projector, b[held.index])
        return float(np.sqrt(np.sum(b**2 / self.model.mass[:, None])))

    def relax(self, cones: Cones, again: bool) -> tuple[np.ndarray, np.ndarray]:
        """(slips (k, 3) [m/s], impulses along the normals (k,) [N s]) of contacts in the last solve's system, by the proximal
        gradient method from its dv.

        Args:
            again: whether it was called for this system before.
        """
        method = self._proximal()
        if not again:
            method.ended = None
        if self.base is not None:  # dv is from it, the system's is from the guess
            self.start_over()
            self.add_guess(-1.0)
        found = method.run(cones)
        if self.base is not None:
            self.add_guess(1.0)
        return found

    def relax_next(self, cones: Cones, again: bool) -> tuple[np.ndarray, np.ndarray]:
        """Like `relax`, in the system that is linearized where the last solve ended: from dv = 0.

        Args:
            again: whether it was called where that solve began.
        """
        method = self._proximal()
        method.ended = method.ended - read(self.solver.dv) if again and method.ended is not None else None
        self.fall(0.0, 0.0, 0.0, 0.0)
        return method.run(cones)

    def _proximal(self) -> ProximalGradient:
        """The method, made where it is first needed."""
        if self._relaxation is None:
            self._relaxation = ProximalGradient(self._fields, self.solver)
        return self._relaxation

    def inertia(self, of: np.ndarray) -> np.ndarray:
        """(n,) a third of the trace of the block of A as linearized [kg] of particles `of` (k,): their mass and h^2 times the
        stiffness around them. Of others their mass. Friction that is in A counts too: where it is asked for, A is without."""
        out = self.model.mass.copy()
        if not len(of):
            return out
        P = read(self.operator.P, of).astype(np.float64, copy=False)
        out[of] = np.maximum((P[:, 0] + P[:, 3] + P[:, 5]) / 3, out[of])
        return out

    def _leave_out(self, part: bool) -> None:
        """Sets whether terms of forces that may be indefinite are left out of the next linearization."""
        for force in self._indefinite if part != self._definite else ():
            force.leave_out(part)
        self._definite = part

    def solve(self, tolerance: float, held: Held | None, h: float = 0.0, z: np.ndarray | float | None = None,
              warm: bool = False, fresh: bool = True, lead: float = 0.0, reuse_levels: bool = False,
              moved: bool = False, least_reference: float = 0.0, track_iterations: bool = True) -> Solution:
        """Solves the system as linearized; if it turns out indefinite, without the terms of forces that may be.

        Args:
            tolerance: relative residual.
            held: the held directions.
            h: step [s] in which they must reach their targets; with 0 they are there and dv = 0 in them.
            z: (k, 3) dv in them [m/s], instead, or the span [s] in which dv leads them to their targets from where they are.
            warm: starts from the last solve's dv.
            lead: span [s] in which positions x + lead dv get to the targets, instead of h.
            reuse_levels: coarse levels made for an earlier system may do.
            moved: whether the model is no longer at the start of the step of size h.
            least_reference: residual norm that the tolerance is relative to where the solve's own is less.
            track_iterations: whether its iterations say how well levels still do.
            fresh: False keeps all of the preconditioner of the last solve, of a similar system with the same directions held.
        """
        self.held, self._kept, self._kept_tension = held, None, None
        self.leads = held is not None and held.moving
        sewn = self.model.sewn if h > 0 else None  # of which something is apart
        if sewn is not None and not sewn.lead(self.solver.dv, h, not warm, moved):
            sewn = None
        self.leads |= sewn is not None
        zero = not warm and sewn is None and (held is None or (z is None and not h > 0 and not lead > 0))
        if held is not None:
            self.filter.bring(held)
            index, projector, target, y = held.arrays
        if held is not None and isinstance(z, float):
            self.filter.impose_rest(index, projector, target, z, int(sewn is None))
        elif held is not None and z is not None:
            self.filter.impose(index, projector, kernel_array(z, self.model.exchange), int(sewn is None))
        elif held is not None and h > 0:
            self.filter.prescribe(index, projector, target, y, h, int(not warm and sewn is None))
        elif held is not None and lead > 0:
            self.filter.lead(index, projector, target, lead)
        if fresh:
            self.preconditioner.make(self.dt_coefficient, held, reuse_levels)
        falls = held is None and not warm and sewn is None and not self.pulled
        solution = self.solver.solve(tolerance, falls, warm, zero, least_reference, held is None)
        if solution.status == NOT_FINITE:
            self.forget()
        if solution.status == BREAKDOWN and self._indefinite and not self._definite:
            self._leave_out(True)
            self.definite = self.stays_definite
            self.preconditioner.forget()  # its levels may be indefinite as well
            self.meter.linearize(self.dt_coefficient, self._moves, self._over)
            return self.solve(tolerance, held, h, z, False, fresh, lead, reuse_levels, moved, least_reference,
                              track_iterations)
        if fresh and track_iterations and not warm:
            self.preconditioner.count_iterations(solution.iterations)
        return solution

    def reaction(self) -> np.ndarray:
        """(n, 3) force [N] in particle order that keeps the held directions, by the last solve."""
        force = np.zeros((self.model.n, 3))
        if self.held is not None:
            force[self.held.index] = self.reaction_rows() / self.dt_coefficient
        return force

    def replace_constraints(self, held: Held | None, impulse: np.ndarray) -> None:
        """Constraints of a step's end, and the impulses (n, 3) [N s] that balance it, replace those of the last solve."""
        self.held, self._kept, self._kept_tension = held, None, None
        if self.model.sewn is not None:
            self._kept_tension = self.model.sewn.tension(impulse)
        if held is not None:
            self._kept = self.on_held(held, impulse[held.index])

    def on_held(self, held: Held, impulse: np.ndarray) -> np.ndarray:
        """(k, 3) the part of impulses (k, 3) on held particles along held directions; particles sewn together share it."""
        if self.model.sewn is not None:
            impulse = self.model.sewn.shared(held.index, impulse)
        return np.einsum("kij,kj->ki", held.projector.astype(np.float64), impulse)

    def keep_reaction(self, rows: np.ndarray, tension: np.ndarray | None) -> None:
        """Stand for the last solve's, which was not one for a state."""
        self._kept, self._kept_tension = rows, tension

    def reaction_rows(self) -> np.ndarray:
        """(k, 3) impulse [N s] on the held particles, in their order."""
        held = self.held
        if held is None:
            return np.zeros((0, 3))
        if self._kept is not None:
            return self._kept
        return self.on_held(held, self._of(self.solver.As, held) - self._of(self.operator.b, held))  # A dv - b

    def left_undone(self) -> float:
        """Norm [N s] of b - A dv of the last solve, without directions that are held."""
        return self.solver.left()

    def tension(self) -> np.ndarray:
        """(n, 3) impulse [N s] that seams put on particles in the last solve; over particles sewn together it sums to zero."""
        if self._kept_tension is not None:
            return self._kept_tension
        return self.model.sewn.tension(read(self.solver.As).astype(np.float64) - read(self.operator.b))

    def loosen(self) -> None:
        """Seams have opened: the preconditioner of the system before is invalid."""
        self.preconditioner.forget()

    def forget(self) -> None:
        """Nothing of the last solve goes on: the state is another, or it was not finite."""
        self.preconditioner.forget()
        self.solver.dv.fill(0)

    def motion_rows(self, held: Held, h: float) -> tuple[np.ndarray, np.ndarray]:
        """(v [m/s], x - x_0 - h v [m]), each (k, 3), of the held particles."""
        model = self.model
        v, x, x_saved, x_offset = (self._of(field, held) for field in (model.v, model.x, model.x_saved, model.x_offset))
        return v, (x - x_saved) - x_offset - h * v

    @staticmethod
    def _of(field, held: Held) -> np.ndarray:
        """(k, 3) rows of the held particles."""
        return read(field, held.index).astype(np.float64, copy=False)

    def to_go(self, held: Held | None, c: float) -> np.ndarray | None:
        """(k, 3) velocity [m/s] by which held directions are still short of their targets."""
        if held is None:
            return None
        return (held.target - self._of(self.model.x, held)) / c

    def rest(self, held: Held | None, c: float) -> np.ndarray | float | None:
        """`to_go` for `solve`, which works it out on a device."""
        return c if held is not None and len(held.index) and self.filter.device else self.to_go(held, c)

    def settle(self, held: Held | None) -> None:
        """Puts held directions exactly at their targets, and particles sewn together in one place."""
        if held is not None:
            self.filter.bring(held)
            self.model.moved()
            self.filter.lead(*held.arrays[:3], 0.0)
        if self.model.sewn is not None:
            self.model.sewn.settle(self.resolution)

    def rounding(self, h: float, *measures: Measures) -> float:
        """How much of Phi [J] is rounding: of its terms, and of positions as they are stored."""
        kinetic = 0.5 * self.model.mass.sum() * (self.resolution / h) ** 2
        return ROUNDING * self.epsilon * sum(m.size for m in measures) + 2 * (self.floor + kinetic)

    def rms_change(self) -> float:
        """RMS of the last solve's dv over the particles [m/s]."""
        return self.solver.rms

    def place(self, h: float, part: float) -> None:
        """x = x_0 + part (r + h dv), r the operator's `rhs_displacement`; v such that x = x_base + h v, y apart"""
        self.model.moved()
        self._place(h, part)

    def shift(self, c: float, part: float) -> None:
        """v += part dv, x += part c dv"""
        self.model.moved()
        self._shift(c, part)

    @ti.kernel
    def _place(self, h: float, part: float):
        ti.loop_config(serialize=self.model.blocks.serial)
        for i in range(self.model.rows()):
            self.model.v[i] = part * (self.model.v_base[i] + self.solver.dv[i]) - (1 - part) / h * self.model.x_offset[i]
            self.model.x[i] = self.model.x_saved[i] + part * (self.operator.rhs_displacement[i] + h * self.solver.dv[i])

    @ti.kernel
    def _shift(self, c: float, part: float):
        ti.loop_config(serialize=self.model.blocks.serial)
        for i in range(self.model.rows()):
            self.model.v[i] = self.model.v[i] + part * self.solver.dv[i]
            self.model.x[i] = self.model.x[i] + part * c * self.solver.dv[i]

    @ti.kernel
    def fall(self, h: float, x: float, y: float, z: float):
        """dv = h g"""
        ti.loop_config(serialize=self.model.blocks.serial)
        for i in range(self.model.rows()):
            self.solver.dv[i] = h * ti.Vector([x, y, z])
