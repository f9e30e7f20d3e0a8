"""The composition root: a scene becomes fields, forces, an integrator and a stepper, and is run frame by frame."""

from .backend import taichi_patches  # noqa: F401  (before Taichi)

# isort: split
import inspect
import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import taichi as ti
from numpy.typing import ArrayLike

from . import checks
from .backend import runtime
from .backend.fields import Fields
from .errors import BackendError, SceneError, SimulationError
from .forces import build_forces
from .options import CG_TOL, EXPLICIT, H_MIN_FACTOR, LONGEST, MACHINE, SHORTEST, Options, signature, usual
from .scene.attachment import Path
from .scene.cloth import Cloth
from .scene.intersections import count_crossings, count_self_crossings
from .scene.scene import Scene
from .scene.solids import Solid
from .solver.pcg import CONVERGED, Solution
from .step import integrators
from .step.attempt import SOLVER
from .step.choice import SAFETY, choose
from .step.prescribed import Prescribed
from .step.stepper import ADVICE, Control, Stepper, StepRecord
from .step.trouble import Locator
from .system.assembler import Assembler
from .system.checkpoint import VERSION, below
from .system.constraints import Constraint, by_hand
from .system.held import Held
from .system.operator import ForceField, Operator, Probe
from .system.quantities import collapsed, deformation, principal_stretches
from .system.state import ParticleState

ROUND_TIME = 1e-9  # part of a step below which two times are the same
H, H_EXPLICIT = 1 / 60, 0.1  # s, where none is given; explicit methods need it only to look at what they did
MOST_STEPS, MOST_FRAMES = 1e10, 10_000_000  # of a run: more have no end


@ti.data_oriented
class Simulation:
    """A running scene. Arrays are the user's: his vertex order, float64, SI units.

    Args:
        scene: what to simulate; it stays as it was built.
        h: step size [s], one of the options.
        options: all of them at once.
        named: any of `Options` by name; these come before `options`.

    Raises:
        SceneError: an impossible value or an unknown name.
        BackendError: an arch or precision that is not there.

    Attributes:
        time: simulated time [s].
        log: one `StepRecord` a step.
        runtime: what runs.
        notes: what was found out about the meshes and solids, and done about it.
    """

    __signature__ = signature(
        inspect.Parameter("scene", inspect.Parameter.POSITIONAL_OR_KEYWORD, annotation=Scene),
        inspect.Parameter("h", inspect.Parameter.POSITIONAL_OR_KEYWORD, default=None, annotation=float | None))

    def __init__(self, scene: Scene, h: float | None = None, *, options: Options | None = None, **named: Any) -> None:
        if not isinstance(scene, Scene) or not scene.cloths:
            raise SceneError("a simulation needs a Scene with at least one cloth")
        asked = Options() if options is None else checks.instance("options", options, Options)
        asked = Options.named({**vars(asked), **({} if h is None else {"h": h}), **named})
        bound, h = asked.h is not None, asked.h or H
        self.control = Control(h, asked.h_min or usual(h) / H_MIN_FACTOR, asked.adaptive, asked.stretch_limit)
        if asked.preconditioner == "auto" and asked.K == "paper":  # an indefinite matrix has indefinite levels
            asked = replace(asked, preconditioner="block_jacobi")
        self.options = asked
        self.scene, self.time, self._h = scene, 0.0, h
        self.log: list[StepRecord] = []
        self.runtime = runtime.start(*(getattr(asked, name) for name in MACHINE))
        self._generation, self._open = runtime.generation(), True
        self.integrator_name = asked.integrator
        self._fields = Fields(self.runtime.exchange, self.runtime.debug)
        try:
            self._build(scene, h)
        except BaseException:
            self._fields.free()
            raise
        if self.integrator.system is None:
            self.integrator.subcycles = asked.adaptive
            if asked.adaptive and not bound and not self.integrator.gusty:
                self.control = replace(self.control, h_max=H_EXPLICIT)
        self.notes += [f"{c.name}: {note}" for c in scene.cloths for note in c.mesh.notes]
        self._note_collapsed(self.model.start_positions)
        if self.contacts is not None:
            self.notes += self.contacts.inspect()
        self.stepper = Stepper(self.model, self.integrator, self.meter, self.control,
                               Locator(self.model, scene.cloths, scene.solids))
        self.prescribed = Prescribed(self.model, scene.script.copy(), self.force_terms, self.contacts)
        scene.followers.add(self)
        self._extra: list[Fields] = []  # made when first asked for
        self._force_field: ForceField | None = None
        self._probe: Probe | None = None
        self.solution: Solution | None = None

    def _build(self, scene: Scene, h: float) -> None:
        """Everything that lives in fields."""
        fields = self._fields
        self.model = ParticleState(fields, scene, self.runtime)
        self.notes: list[str] = []
        substep = self.options.substep
        self.force_terms = build_forces(fields, self.model, scene, self.options.K, substep and substep / SAFETY)
        self.notes += [note for force in self.force_terms for note in force.notes]
        if self.integrator_name == "auto":
            tolerance = self.options.tolerance
            self.integrator_name, why = choose(self.force_terms, scene, h, tolerance, self.control.adaptive)
            self.notes.append(f"integrator {self.integrator_name}: {why}")
        self.contacts = _contacts(fields, self.model, scene, h, self.runtime.arch == "cpu", self.options)
        operator, forces = None, list(self.force_terms)
        if self.integrator_name not in EXPLICIT:
            forces += [self.contacts.force] if self.contacts else []
            operator = Operator(fields, self.model, forces)
        self.meter = Assembler(self.model, forces, self.runtime, operator)
        self.integrator = integrators.build(self.integrator_name, fields, self.model, self.force_terms, self.meter,
                                            self.options, self.runtime, scene, self.contacts)
        fields.allocate()

    # state

    @property
    def vertex_count(self) -> int:
        """Number of vertices of all cloths."""
        return self.scene.vertex_count

    def positions(self) -> np.ndarray:
        """(n, 3) [m]"""
        return self._live().model.read()[0]

    def velocities(self) -> np.ndarray:
        """(n, 3) [m/s]"""
        return self._live().model.read()[1]

    def set_state(self, x: ArrayLike, v: ArrayLike) -> None:
        """Sets positions (n, 3) [m] and velocities (n, 3) [m/s]; pins begin anew where their vertices now are.

        Raises:
            SceneError: a wrong shape or a number that is not finite.
        """
        x, v = (checks.array(f"set_state: {name}", value, (self.vertex_count, 3), row="vertex")
                for name, value in (("positions", x), ("velocities", v)))
        self._live().model.write(x, v)
        self._note_collapsed(x)
        self.stepper.start = None
        self.integrator.reset()
        if self.contacts is not None:
            self.contacts.clear()
        self.prescribed.begin_anew()

    def _note_collapsed(self, x: np.ndarray) -> None:
        """Says which cloth at positions x (n, 3) [m] has triangles without a width."""
        for cloth in self.scene.cloths:
            mesh = cloth.mesh
            count = collapsed(deformation(x[cloth.start:], mesh.faces, mesh.corner_uv))
            note = (f"{cloth.name}: {count} of {mesh.face_count} triangles are collapsed to a line or a point: no force has "
                    "a side to open them to, so they may stay so; give them some width")
            if count and note not in self.notes:
                self.notes.append(note)

    def energy(self) -> dict[str, float]:
        """J by term: stretch_u, stretch_v, shear, bend, gravity (those there are) and kinetic."""
        self._live().model.save()
        return self.meter.measure().energies

    def forces(self) -> np.ndarray:
        """(n, 3) [N] internal plus external, at the current state."""
        self._live().prescribed.set_time(self.time)
        if self._force_field is None:
            self._force_field = self._later(ForceField)
        self._force_field.compute()
        return self.model.to_user(self._force_field.f.to_numpy())

    def stretch(self) -> np.ndarray:
        """(m, 2) principal stretches of every triangle, the larger first; 1 is the pattern's size."""
        x = self.positions()
        out = []
        for cloth in self.scene.cloths:
            out.append(principal_stretches(deformation(x[cloth.start:], cloth.mesh.faces, cloth.mesh.corner_uv)))
        return np.concatenate(out)

    # the linear system at the current state, for checks from outside

    def product(self, p: ArrayLike, h: float) -> np.ndarray:
        """(n, 3) (M - h D - h^2 K) p for p (n, 3)."""
        p = checks.array("product: p", p, (self.vertex_count, 3), row="vertex")
        system = self._linearized(h)
        if self._probe is None:
            self._probe = self._later(Probe, system.operator)
        return self.model.to_user(self._probe.product(self.model.to_particles(p)))

    def right_hand_side(self, h: float) -> np.ndarray:
        """(n, 3) h (f_0 + h K v_0) [kg m/s]."""
        return self.model.to_user(self._linearized(h).operator.b.to_numpy())

    def solve(self, h: float, constraints: Sequence[Constraint] | None = None) -> np.ndarray:
        """(n, 3) Delta v [m/s] of eq. (18) at the current state, without advancing.

        Args:
            h: step size [s].
            constraints: the scene's own pins and motions where None.

        Raises:
            SimulationError: where the solve does not converge, with its status.
        """
        if constraints is None:
            held = self.prescribed.at(self.time, h)
            solution = self._linearized(h).solve(self._cg_tol, held, h)
        else:
            held, z = by_hand(constraints, self.model, self.runtime.exchange)
            solution = self._linearized(h, held).solve(self._cg_tol, held, z=z)
        self.solution = solution
        if solution.status != CONVERGED:
            raise SimulationError(f"the solve ended with {solution.status} after {solution.iterations} iterations at a "
                                  f"relative residual of {solution.residual:.2g}: {ADVICE[SOLVER]}", SOLVER, self.time)
        return self.model.to_user(self.integrator.system.solver.dv.to_numpy())

    def constraint_forces(self) -> np.ndarray:
        """(n, 3) [N] of the constraints in the last step or solve, (A dv - b)/h; 0 in free directions."""
        system = self._system()
        return self.model.to_user(system.reaction())

    def seam_forces(self) -> np.ndarray:
        """(n, 3) [N] that seams put on vertices in the last step or solve; they add up to 0 on what is sewn together."""
        system = self._system()
        if self.model.sewn is None:
            return np.zeros((self.vertex_count, 3))
        return self.model.to_user(system.tension() / system.span)

    def seam_gaps(self) -> np.ndarray:
        """(seams,) [m] how far apart what a seam sews together still is, at its widest, in the order of `Scene.seams`."""
        x, seams = self.positions(), self.scene.seams
        return np.array([np.linalg.norm(x[s.a + s.cloth.start] - x[s.b + s.cloth.start], axis=1).max() for s in seams])

    def contact_forces(self) -> np.ndarray:
        """(n, 3) [N] of solids on the cloth in the last step, friction included."""
        self._live()
        if self.contacts is None:
            return np.zeros((self.vertex_count, 3))
        return self.model.to_user(self.contacts.forces_on_particles())

    def intersections(self) -> int:
        """Pairs of an edge and a triangle of cloth that pass through each other now, counted exactly, among cloths that
        are to meet (`contact`)."""
        x = self.positions()
        cloths = [c for c in self.scene.cloths if c.contact is not None]
        total = 0
        for k, a in enumerate(cloths):
            if a.contact.itself:  # type: ignore[union-attr]
                total += count_self_crossings(x, a.mesh.faces + a.start)
            for b in cloths[:k]:
                if not self.scene.passes(a, b):
                    total += count_crossings(x, a.mesh.faces + a.start, x, b.mesh.faces + b.start)
        return total

    def solid_loads(self) -> dict[str, tuple[np.ndarray, np.ndarray]]:
        """Force (3,) [N] of the cloth on each solid in the last step, and torque (3,) [N m] about its origin, by name."""
        self._live()
        return {} if self.contacts is None else self.contacts.loads()

    # running

    def step(self, h: float | None = None) -> StepRecord:
        """Advances by h [s] (the simulation's own where None), in one step if it passes, else in smaller ones.

        Returns:
            the record of the last of them.

        Raises:
            SimulationError: where no step passes.
        """
        h = self._h if h is None else checks.number("h", h, "s", least=SHORTEST)
        self._check_length("h", h)
        return self._advance_to(self.time + h)

    def run(self, duration: float, fps: float, on_frame: Callable[["Simulation", int], None] | None = None,
            resumed: int | None = None) -> None:
        """Runs for `duration` [s], rounded to whole frames, and calls on_frame(simulation, frame) at the start and at
        every frame's time.

        Frames are hit exactly; steps between them are equal where nothing goes wrong.

        Args:
            resumed: the frame of a run from time 0 at which this simulation now is; it goes on with the next.
        """
        duration, fps = checks.number("duration", duration, "s", positive=True), checks.number("fps", fps, positive=True)
        self._check_length("duration", max(duration, 1 / fps))
        checks.integer("run: duration * fps, the number of frames,", max(1, round(duration * fps)), most=MOST_FRAMES)
        checks.maybe(on_frame, checks.function, "on_frame", "simulation", "frame")
        resumed = checks.maybe(resumed, checks.integer, "resumed", least=0)
        start, frames = self.time if resumed is None else 0.0, max(1, round(duration * fps))
        for frame in range(0 if resumed is None else resumed + 1, frames + 1):
            if frame:
                self._advance_to(start + frame / fps)
            if on_frame is not None:
                on_frame(self, frame)

    # between steps

    def pin(self, cloth: Cloth, vertices: object, directions: object = None) -> None:
        """As `Scene.pin`, for this simulation, from now on."""
        self._change(lambda: self.scene.pin(cloth, vertices, directions))

    def move(self, cloth: Cloth, vertices: object, path: Path, relative: bool = False, directions: object = None) -> None:
        """As `Scene.move`, for this simulation, from now on; the path is a function of the simulation's time."""
        self._change(lambda: self.scene.move(cloth, vertices, path, relative, directions))

    def attach(self, cloth: Cloth, vertices: object, solid: Solid, since: float | None = None) -> None:
        """As `Scene.attach`, for this simulation, from now on; `since` [s] is now where None."""
        self._change(lambda: self.scene.attach(cloth, vertices, solid, self.time if since is None else since))

    def unpin(self, cloth: Cloth, vertices: object = None) -> None:
        """As `Scene.unpin`, for this simulation, from now on."""
        self._change(lambda: self.scene.unpin(cloth, vertices))

    def _change(self, change: Callable[[], None]) -> None:
        """Pins and motions are changed by hand; what begins, begins where its vertices are."""
        self._live()
        with self.scene.running(self.prescribed.script):
            change()
        self.prescribed.changes += 1

    def checkpoint(self) -> dict[str, np.ndarray]:
        """Everything that decides how the simulation goes on, as arrays by name; see `resume`."""
        self._live()
        out = {"version": np.array(VERSION), "time": np.array(self.time), "records": np.array(len(self.log))}
        for name, part in self._parts().items():
            out |= {f"{name}.{key}": array for key, array in part.checkpoint().items()}
        return out

    def _parts(self) -> dict[str, Any]:
        """What remembers something, by name."""
        parts = {"particles": self.model, "step": self.stepper, "integrator": self.integrator}
        if self.integrator.system is not None:
            parts["preconditioner"] = self.integrator.system.preconditioner
        if self.contacts is not None:
            parts["contacts"] = self.contacts
        return parts | {"script": self.prescribed}

    def resume(self, state: dict[str, np.ndarray]) -> None:
        """Goes on where `checkpoint` was taken, bit for bit on the same machine, threads and precision.

        Events of the scene up to then are fired again; the simulation must be new.

        Raises:
            SceneError: the state is of another mesh, of a scene without what this one has, or of another version.
        """
        self._live()
        checks.instance("resume: state", state, dict)
        version = int(state.get("version", 0))
        if version != VERSION:
            raise SceneError(f"the checkpoint is of version {version}, and this taichi_cloth goes on from version {VERSION}")
        for name, value in state.items():
            if (name in ("time", "step.h") or name.startswith("script.")) and not np.isfinite(value).all():
                raise SceneError(f"the checkpoint's {name} is not finite")
        try:
            self.time = float(state["time"])
            for name, part in self._parts().items():
                part.resume(below(name, state))
        except KeyError as missing:
            raise SceneError(f"the checkpoint has no {missing}: it is of a run with other options") from None
        self._fire_events()
        self.prescribed.resume(below("script", state))  # attachments that events began, began where they did

    def __enter__(self) -> "Simulation":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __repr__(self) -> str:
        names = ", ".join(f"{c.name} ({c.mesh.vertex_count:,} vertices)" for c in self.scene.cloths)
        state = f"t = {self.time:g} s, {len(self.log)} steps" if self._open else "closed"
        return f"<Simulation of {names}; {self.integrator_name}, {self.runtime.arch} {self.runtime.precision}; {state}>"

    def close(self) -> None:
        """Gives the memory of the fields back; the simulation is over. `with Simulation(...) as sim:` does so at its end."""
        if self._open and self._generation == runtime.generation():
            for fields in (self._fields, *self._extra):
                fields.free()
        self._open = False
        self.scene.followers.discard(self)

    def _check_length(self, name: str, time: float) -> None:
        """Refuses what would need more steps than anybody waits for."""
        steps = time / self.control.h_max
        if steps > MOST_STEPS:
            raise SceneError(f"{name} = {time:g} s is {steps:.2g} steps of h = {self.control.h_max:g} s: at most "
                             f"{MOST_STEPS:.0e}")

    def _advance_to(self, end: float) -> StepRecord:
        self._live()
        record = None
        while end - self.time > ROUND_TIME * self.control.h_max or record is None:
            self._fire_events()
            stop = min([end, *(e.time for e in self.prescribed.script.events[:1])])
            remaining = stop - self.time
            h = min(self.control.h_max, self.stepper.h) if self.control.adaptive else self.control.h_max
            steps = max(1, math.ceil(remaining / h - ROUND_TIME)) if remaining > h else 1
            record = self.stepper.step(self.time, remaining / steps, self.prescribed.at)
            self.time = stop if steps == 1 and abs(record.t - stop) <= ROUND_TIME * record.h else record.t
            record.t = self.time
            if self.options.count_intersections:
                record.intersections = self.intersections()
            self.log.append(record)
        self._fire_events()
        return record

    def _fire_events(self) -> None:
        script = self.prescribed.script
        while script.events and script.events[0].time <= self.time + ROUND_TIME * self.control.h_max:
            event = script.events.pop(0)
            with self.scene.running(script):
                self.scene.fire(event)
            script.events.sort(key=lambda e: e.time)

    def _linearized(self, h: float, held: Held | None = None):
        """The system, linearized at the current state for a step h, with y of the held particles."""
        h = checks.number("h", h, "s", least=SHORTEST, most=LONGEST)
        system = self._system()
        self.prescribed.set_time(self.time + h)
        self.model.save()
        system.operator.set_motion(h)
        if held is not None:
            system.operator.alter_motion(held.index, held.y)
        system.linearize(h, moves=True)
        self.integrator.reset()
        return system

    def _system(self):
        self._live()
        if self.integrator.system is None:
            raise SceneError(f"integrator {self.integrator_name!r} solves no system: this needs an implicit one")
        return self.integrator.system

    @property
    def _cg_tol(self) -> float:
        return self.options.cg_tol or CG_TOL

    def _later(self, kind, *args):
        """An object with fields of its own, for what most runs never ask for."""
        fields = Fields(self.runtime.exchange, self.runtime.debug)
        made = kind(fields, self.model, self.force_terms, *args)
        fields.allocate()
        self._extra.append(fields)
        return made

    def _live(self) -> "Simulation":
        if not self._open:
            raise BackendError("this simulation was closed")
        if self._generation != runtime.generation():
            raise BackendError("this simulation ended when another was started with a different arch, precision or "
                               "number of threads: use one of them at a time")
        return self


def _contacts(fields: Fields, model: ParticleState, scene: Scene, h: float, cpu: bool, options: Options):
    """The contacts of a scene with solids, or with cloth that meets cloth; nothing of them is imported without."""
    if not scene.touches:
        return None
    from .contact.contacts import Contacts

    return Contacts(fields, model, scene, h, cpu, options.tangles, options.contact)
