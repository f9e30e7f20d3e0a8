"""Drag in air that differs from triangle to triangle: wind that varies in space, and plates that feel the square of speed.

f = -A B (v - wind) as in `external.Drag`, where B has besides, of a plate [Keckeisen et al. 2004],

density/2 |u| (drag c I + lift (n n^T - c^2 I)), c = |n.u| / |u|,

so that B u drags along u and lifts across it; B is positive as lift <= drag. A B is that at the
beginning of the step. The wind is taken at the places of the beginning, for the time of the end. The force then has a
potential in the velocities of the solve, and is of first order in the step.
"""

import numpy as np

from ..backend.fields import Fields
from ..backend.language import ti
from ..scene.scene import Scene
from ..system.state import ParticleState
from .conditions import sym_outer, sym_scaled_identity
from .external import Drag

FASTEST = 100.0  # m/s: up to there explicit steps are bounded for


@ti.data_oriented
class LocalDrag(Drag):
    """Drag with a wind and coefficients of its own for each triangle."""

    def __init__(self, fields: Fields, model: ParticleState, scene: Scene, mode: str) -> None:
        super().__init__(fields, model, scene, mode)
        self.time_dependent, self.interpolated_wind = True, False
        plate = 0.5 * self.built.density * np.array([self.built.drag, self.built.lift])
        self.plate = fields.real(2, data=plate)
        density = min(f.density for c in scene.cloths for f in c.fabrics)
        self.rates = (0.0, self.rates[1] + FASTEST * float(plate.sum()) / density)
        self.local = fields.real(self.elements.count, 9)  # wind [m/s] and A B [N s/m]

    def set_time(self, t: float) -> None:
        """The air as it is at t [s] where the cloth now is."""
        model = self.model
        if self.air.varies_in_space:
            winds = self.air.wind_at(t, model.read_particles()[0] + model.origin)
        else:
            winds = self.air.wind_at(t)[None]
        self._feel(np.ascontiguousarray(winds, dtype=model.exchange))

    @ti.kernel
    def _feel(self, winds: ti.types.ndarray()):
        for e in range(self.elements.first[self.model.blocks.count]):
            v = self.elements.vertices[e]
            x = ti.static(self.model.x)
            wind = ti.Vector.zero(float, 3)
            for a in ti.static(range(3)):
                row = v[a]
                if winds.shape[0] == 1:
                    row = 0
                wind += ti.Vector([winds[row, 0], winds[row, 1], winds[row, 2]]) / 3
            u = (self.model.v[v[0]] + self.model.v[v[1]] + self.model.v[v[2]]) / 3 - wind
            twice = (x[v[1]] - x[v[0]]).cross(x[v[2]] - x[v[0]])
            n, speed = twice.normalized(1e-30), u.norm()
            c = ti.abs(n.dot(u)) / ti.max(speed, 1e-30)
            tangential = self.drag[1] + speed * (self.plate[0] * c - self.plate[1] * c * c)
            beyond = self.drag[0] - self.drag[1] + speed * self.plate[1]  # excess of B along n over that across
            B = 0.5 * twice.norm() * (sym_scaled_identity(tangential) + beyond * sym_outer(n))
            self.local[e] = ti.Vector([wind[0], wind[1], wind[2], B[0], B[1], B[2], B[3], B[4], B[5]])

    @ti.func
    def air_at(self, e):
        """The wind at a triangle."""
        return ti.Vector([self.local[e][0], self.local[e][1], self.local[e][2]])

    @ti.func
    def coefficient(self, e):
        """A B, 6 numbers."""
        B = self.local[e]
        return ti.Vector([B[3], B[4], B[5], B[6], B[7], B[8]])
