"""Queries of a simulation between steps: its state, forces, energies, and the linear system at its state.

Arrays are the user's: his vertex order, float64, SI units.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from .. import checks
from ..backend.language import ti
from ..backend.ordering import components
from ..backend.rows import read
from ..errors import SceneError, SimulationError
from ..options import CG_TOL, LONGEST, SHORTEST
from ..scene.intersections import count_crossings, count_self_crossings
from ..solver.pcg import CONVERGED
from ..step.attempt import SOLVER
from ..step.stepper import ADVICE
from ..system.constraints import Constraint, by_hand
from ..system.held import Held
from ..system.operator import ForceField, Probe
from ..system.quantities import deformation, principal_stretches
from .parts import Parts


@ti.data_oriented
class Queries(Parts):
    """The questions; none of them changes how the simulation goes on."""

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

    def energy(self) -> dict[str, float]:
        """Energies [J] by name, as in the log: kinetic, and of the scene's terms stretch_u, stretch_v, shear, bend, gravity,
        attachments, gas and contact. The last is the repulsion between layers, after a step in which they met."""
        self._live().model.save()
        energies, ended = self.meter.measure().energies, self.stepper.ended
        stored = {} if ended is None else {name: e for name, e in ended.energies.items() if name == "contact"}
        return energies | stored

    def forces(self, renew: bool = True) -> np.ndarray:
        """(n, 3) [N] internal plus external, at the current state.

        Args:
            renew: False keeps the values that a step takes at its start as they were last set: loads, the wind, and the
                coefficients of a plate in air. The linear system's matrix is the derivative of these forces.
        """
        self._live()
        if checks.flag("forces: renew", renew):
            self.prescribed.set_time(self.time)
        if self._force_field is None:
            self._force_field = self._later(ForceField)
        self._force_field.compute()
        return self.model.to_user(read(self._force_field.f))

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
        return self.model.to_user(read(self._linearized(h).operator.b))

    def solve(self, h: float, constraints: Sequence[Constraint] | None = None) -> np.ndarray:
        """(n, 3) Delta v [m/s] of eq. (18) at the current state, without advancing.

        Args:
            h: step size [s].
            constraints: the scene's own pins and motions if None.

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
        return self.model.to_user(read(self.integrator.system.solver.dv))

    def constraint_forces(self) -> np.ndarray:
        """(n, 3) [N] reaction forces of pins, prescribed motion and other constraints in the last step or solve, (A dv - b)/h;
        0 in free directions."""
        system = self._system()
        return self.model.to_user(system.reaction())

    def seam_forces(self) -> np.ndarray:
        """(n, 3) [N] that seams put on vertices in the last step or solve; they add up to 0 on vertices that are sewn
        together."""
        system = self._system()
        if self.model.sewn is None or not system.dt_coefficient:  # nothing sewn, nothing solved
            return np.zeros((self.vertex_count, 3))
        return self.model.to_user(system.tension() / system.dt_coefficient)

    def seam_gaps(self) -> np.ndarray:
        """(seams,) [m] the widest gap between the two sides of each seam, in the order of `Scene.seams`."""
        x, seams = self.positions(), self.scene.seams
        return np.array([np.linalg.norm(x[s.a + s.cloth.start] - x[s.b + s.cloth.start], axis=1).max() for s in seams])

    def seam_states(self) -> list[str]:
        """State of each of `Scene.seams`: "open" if a stitch of it has given or was opened, "closing" while some are apart,
        else "closed"."""
        given = self.stitches_open() or [np.zeros(1, dtype=bool)] * len(self.scene.seams)
        return ["open" if opened.any() else "closing" if gap > 0 else "closed" for opened, gap in zip(given, self.seam_gaps())]

    def attachment_forces(self) -> np.ndarray:
        """(n, 3) [N] of soft attachments on the vertices, now."""
        self._live()
        force = np.zeros((self.model.n, 3))
        if self.prescribed.pulls is not None:
            pulled = self.prescribed.pulled(self.time)
            force[pulled.index] = pulled.forces(self.model.read_particles()[0])
        return self.model.to_user(force)

    def stitch_loads(self) -> list[np.ndarray]:
        """For each of `Scene.seams`, (k,) [N] forces of its stitches in the last step; 0 if open or still apart."""
        system = self._system()
        if self.stitch_failure is None:
            return []
        stitches = self.stitch_failure.stitches
        return np.split(stitches.loads(system.tension() / system.dt_coefficient), stitches.first[1:-1])

    def stitches_open(self) -> list[np.ndarray]:
        """For each of `Scene.seams`, (k,) whether each of its stitches has given or was opened."""
        self._live()
        if self.stitch_failure is None:
            return []
        stitches = self.stitch_failure.stitches
        return np.split(~stitches.whole & ~stitches.pulled, stitches.first[1:-1])

    def faces(self) -> np.ndarray:
        """(m, 3) vertices of all triangles as they hang together now: where cloth may tear, the first vertex of those that are
        joined stands for all of them."""
        self._live()
        faces = np.concatenate([c.mesh.faces + c.start for c in self.scene.cloths])
        if self.stitch_failure is None:
            return faces
        stands = np.arange(self.vertex_count)
        for seam, opened in zip(self.scene.seams, self.stitches_open()):
            if seam.tears:
                one = components(seam.cloth.mesh.vertex_count, seam.a[~opened], seam.b[~opened])
                stands[seam.cloth.start: seam.cloth.start + len(one)] = seam.cloth.start + one
        return stands[faces]

    def gas(self) -> dict[str, tuple[float, float]]:
        """(volume [m^3], pressure over that outside [Pa]) of inflated pieces, by name of cloth and part."""
        self._live().prescribed.set_time(self.time)
        return {name: pair for force in self.force_terms for name, pair in force.record().items()}

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
        return {} if self.contacts is None else self.contacts.solids.loads()

    def _linearized(self, h: float, held: Held | None = None):
        """The system, linearized at the current state for a step h, with y of the held particles."""
        h = checks.number("h", h, "s", least=SHORTEST, most=LONGEST)
        system = self._system()
        self.prescribed.set_time(self.time + h)
        self.model.save()
        system.operator.set_rhs_displacement(h)
        if held is not None:
            system.operator.correct_rhs_displacement(held.index, held.y)
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
