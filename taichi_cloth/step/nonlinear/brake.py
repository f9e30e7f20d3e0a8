"""Takes from velocities what a step would else have gained in energy.

A backward Euler step may gain a little where the energy is not convex, of second order in h, so that no smaller step
is free of it. What deforms the cloth is slowed down until the sum is right; how each cloth moves and turns as a whole,
and what is held, stay as they are, and so do the momenta of cloth that is free.
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
        cloth = np.repeat(np.arange(len(scene.cloths)), [c.mesh.vertex_count for c in scene.cloths])[model.user]
        self.cloths = [np.flatnonzero(cloth == k) for k in np.unique(cloth)]  # particles of each

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
        for mine in self.cloths:
            m, arm = mass[mine], x[mine]
            arm = arm - m @ arm / m.sum()
            own = v[mine] - m @ v[mine] / m.sum()
            weighed = arm * m[:, None]
            moments = weighed.T @ own  # sum m arm own^T
            turning = np.array([moments[1, 2] - moments[2, 1], moments[2, 0] - moments[0, 2], moments[0, 1] - moments[1, 0]])
            products = weighed.T @ arm
            inertia = np.trace(products) * np.eye(3) - products
            w = np.linalg.pinv(inertia, rcond=1e-9) @ turning
            spin = np.array([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]])  # spin arm = w x arm
            out[mine] = own - arm @ spin.T
        return out
