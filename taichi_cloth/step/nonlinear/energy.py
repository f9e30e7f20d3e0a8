"""The test of energy that a backward Euler step has to pass, and the correction of a small excess.

Kinetic and potential energy must not grow by more than the work put in (`ledger`). Phi does not bound kinetic energy, and
if E is not convex even its minimum may gain some. An excess that is left at the end, or is too small to be worth a
further solve, is taken off the velocities (`KineticEnergyCorrection`): it is of second order in h, so that no smaller step is
free of it. If all of the cloth is led, no step could do better.
"""

import math
from collections.abc import Callable
from dataclasses import asdict, replace

import numpy as np

from ...scene.scene import Scene
from ...system.assembler import Measures
from ...system.held import Held
from ...system.state import ParticleState
from ..ledger import Ledger, Work, gained, one_stage
from .linear_system import System

LIGHT = 0.01  # part of the velocity of deformation that is taken off rather than solved again
MOST = 0.5  # the same where nothing is solved again: with .01 a scene of tests/hard gives up
PINCHED = 0.1  # part of all works by which these may be off in steps too small to be tried smaller
PRESSED = 1e-3  # part of the energy of pressed layers by which that may be off there
SLIGHT = 1e-6  # and anywhere: factors of pairs change from place to place and have no force


class EnergyTest:
    """On the steps of a system, with its contacts where it has some."""

    def __init__(self, system: System) -> None:
        self.system, self.model, self.meter, self.contacts = system, system.model, system.meter, system.contacts
        self.kinetic_correction = KineticEnergyCorrection(self.model, system.scene)

    def conclude(self, h: float, held: Held | None, start: Measures, measures: Measures, most: float,
                 fits: Callable[[Measures, Ledger], bool] | None = None, slack: float = 0.0) -> tuple[Measures, Ledger] | None:
        """(measures, ledger) of the step, if its energy has not grown beyond work and rounding.

        Else they are those after the excess was taken off velocities; None if that is too much.

        Args:
            most: part of the velocities that may be taken off.
            slack: part of all that a step's energy goes through by which works may be off.
            fits: whether a step that has to be slowed down is good enough otherwise; it is left alone if not. None: all are.
        """
        work = self.work(h, held, start, measures)
        ledger = one_stage(h, start, measures, work)
        over = gained(start, measures, work) - max(0.0, ledger.wind) - self.system.rounding(h, start, measures)
        over -= slack * sum(abs(value) for value in asdict(ledger).values())
        over -= SLIGHT * measures.energies.get("contact", 0.0)
        if self.contacts is not None and self.contacts.start.small:  # nothing smaller does better where cloth is pinched: how
            # it is moved out need not be paid for, and works are off by as much as forces may be
            over += min(work.pushed_out, 0.0) - PINCHED * sum(abs(value) for value in asdict(work).values())
            over -= PRESSED * measures.energies.get("contact", 0.0)
        if not over > 0 or (math.isfinite(over) and self._leads_all(held)):
            return measures, ledger
        good = math.isfinite(over) and (fits is None or fits(measures, ledger))
        if not (good and self.kinetic_correction.take(over, held, most)):
            return None
        slower = replace(self.meter.measure(), stretch_change=measures.stretch_change)
        energies = {**measures.energies, **slower.energies}
        lost = measures.energies["kinetic"] - slower.energies["kinetic"]
        return (replace(slower, energies=energies),
                replace(ledger, kinetic=ledger.kinetic - lost, method=ledger.method + lost, kinetic_correction=lost))

    def _leads_all(self, held: Held | None) -> bool:
        """Whether everything is where it is led, in steps of any size."""
        return held is not None and len(held.index) == self.model.n and bool((held.projector == np.eye(3)).all())

    def work(self, h: float, held: Held | None, start: Measures, measures: Measures) -> Work:
        """Work put in by constraints, contacts and alterations of positions, by the forces of the last solve."""
        x, v = self.model.read_particles()
        by_pins = by_solids = lifted = lowered = friction = edges = layers = 0.0
        between = self.contacts.between_layers(x) if self.contacts is not None else np.zeros_like(x)
        if held is not None and held.moving and len(held.index):
            reaction = self.system.reaction_rows()  # J
            motion, y = self.system.motion_rows(held, h)
            power = np.einsum("ki,ki->k", reaction, motion)
            solids = up = np.zeros(len(power), dtype=bool)
            if self.contacts is not None:
                solids, up = self.contacts.solids.rows_held(len(power))
            by_pins, by_solids = float(power[~solids].sum()), float(power[solids].sum())
            (lifted, above), (lowered, below) = (self._altering(x, held.index[k], y[k], between) for k in (up, ~up))
            self.model.write_particles(x, v)
            layers = -above - below  # y stores it, and not the motion
        if self.model.sewn is not None and self.model.sewn.led:
            by_pins += float(np.sum(self.system.tension() * v))
        if self.contacts is not None:
            if self.contacts.start.small:  # no smaller step can do better: not paid for
                lifted, lowered = lifted + lowered, 0.0
            friction, edges = self.contacts.works(x, v)
            stored = measures.energies.get("contact", 0.0) - start.energies.get("contact", 0.0)
            layers += stored + self.contacts.start.c * float(np.sum(between * v))
        return Work(pins=by_pins, solids=by_solids + edges, pushed_out=lifted, pulled_down=lowered, friction=friction,
                    layers=layers)

    def _altering(self, x: np.ndarray, index: np.ndarray, y: np.ndarray, between: np.ndarray) -> tuple[float, float]:
        """(work to alter positions x (n, 3) of particles index (k,) by y (k, 3), the part of it stored between layers) [J].

        The work is dE . y, with the cloth's energy here and layers' forces between (n, 3) in the last solve.

        The model is left with y as its velocities.
        """
        if not np.abs(y).max(initial=0.0) > self.system.resolution:
            return 0.0, 0.0
        motion = np.zeros_like(x)
        motion[index] = y
        self.model.write_particles(x, motion)
        taken = self.meter.measure().rate
        stored = -float(np.sum(between * motion))
        return taken + stored, stored


class KineticEnergyCorrection:
    """Takes off the velocities of a model's cloths what energy a step would else have gained.

    Velocities of deformation are reduced until the sum is right. The rigid motion of each cloth stays as it is, and so do held
    directions, and the momenta of cloth that is free.
    """

    def __init__(self, model: ParticleState, scene: Scene) -> None:
        self.model = model
        self.cloth = np.repeat(np.arange(len(scene.cloths)), [c.mesh.vertex_count for c in scene.cloths])[model.user]

    def take(self, energy: float, held: Held | None, most: float = MOST) -> bool:
        """Slows the model down until its kinetic energy has fallen by `energy` [J]; False where that is too much."""
        x, v = self.model.read_particles()
        slower = self._deforming(x, v)
        if held is not None:
            slower[held.index] -= np.einsum("kij,kj->ki", held.projector, slower[held.index])
        m = self.model.mass[:, None]
        b, a = float(np.sum(m * v * slower)), float(np.sum(m * slower**2))
        root = b * b - 2 * a * energy  # energy = part b - part^2 a/2
        if not (b > 0 and root >= 0):
            return False
        part = 2 * energy / (b + math.sqrt(root))
        if part > most:
            return False
        self.model.write_particles(x, v - part * slower)
        return True

    def _deforming(self, x: np.ndarray, v: np.ndarray) -> np.ndarray:
        """(n, 3) velocities [m/s] without the rigid motion of each cloth."""
        out, mass = v.copy(), self.model.mass
        for k in np.unique(self.cloth):
            mine = self.cloth == k
            m, arm = mass[mine, None], x[mine]
            arm = arm - np.sum(m * arm, axis=0) / np.sum(m)
            own = v[mine] - np.sum(m * v[mine], axis=0) / np.sum(m)
            turning = np.sum(m * np.cross(arm, own), axis=0)
            inertia = np.sum(m * arm**2) * np.eye(3) - (m * arm).T @ arm
            spin = np.linalg.pinv(inertia, rcond=1e-9) @ turning
            out[mine] = own - np.cross(spin, arm)
        return out
