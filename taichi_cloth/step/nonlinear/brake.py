"""Takes off velocities the energy that a step would else have gained.

A backward Euler step may gain a little where the energy is not convex, of second order in h, so that no smaller step
is free of it. Velocities of deformation are reduced until the sum is right. The rigid motion of each cloth stays as it is,
and so do held directions, and the momenta of cloth that is free.
"""

import math

import numpy as np

from ...scene.scene import Scene
from ...system.held import Held
from ...system.state import ParticleState

MOST = 0.5  # part of the velocity of deformation that may be taken off in a step


class Brake:
    """On a model's cloths."""

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
