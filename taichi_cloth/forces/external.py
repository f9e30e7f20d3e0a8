"""Gravity and air drag."""

import numpy as np

from ..backend.fields import Fields
from ..backend.language import ti
from ..scene.air import Air
from ..scene.attachment import Script
from ..scene.scene import Scene
from ..system.state import Elements, ParticleState
from .conditions import sym_outer, sym_scaled_identity, sym_times
from .force import Force


@ti.data_oriented
class DeadLoad(Force):
    """A force without a derivative, neither by position nor by velocity: it is in b alone."""

    dead_load = True

    def build_stiffness(self) -> None:
        """Nothing but to be asked for."""
        self.stiff = True

    @ti.func
    def add_product(self, block, p: ti.template(), q: ti.template()):
        """Nothing."""

    def build_levels(self, levels) -> None:
        """Nothing."""

    @ti.func
    def add_level_block(self, n, c, D, levels: ti.template()):
        """D"""
        return D


@ti.data_oriented
class Gravity(DeadLoad):
    """m g, with the potential -m g . x."""

    energies = ("gravity",)

    def __init__(self, fields: Fields, model: ParticleState, scene: Scene, mode: str) -> None:
        self.model = model
        self.strength = float(np.linalg.norm(scene.gravity))
        self.g = fields.real(1, 3, np.array(scene.gravity, dtype=np.float64))  # a field: no other gravity compiles anew

    def rounding_energy(self, d: float) -> float:
        """Energy [J] that positions off by d [m] amount to."""
        return self.strength * float(self.model.mass.sum()) * d

    @ti.func
    def add_force(self, block, f: ti.template()):
        """f += m g"""
        g = self.g[0]
        for i in range(self.model.blocks.row[block], self.model.blocks.row[block + 1]):
            f[i] = f[i] + self.model.m[i] * g

    @ti.func
    def evaluate(self, block, linearizes, moves, c, to: ti.template(), base: ti.template(), report: ti.template(),
                 dtype: ti.template()):
        """Energy [J] in column `base`, no dissipation, the rate at which the energy grows [W]. With `linearizes`,
        b += c m g."""
        g = self.g[0]
        total, rate = ti.cast(0, dtype), ti.cast(0, dtype)
        for i in range(self.model.blocks.row[block], self.model.blocks.row[block + 1]):
            weight = self.model.m[i] * g
            total -= weight.dot(self.model.x[i])
            rate -= weight.dot(self.model.v[i])
            if ti.static(self.stiff):
                if linearizes == 1:
                    to.b[i] = to.b[i] + c * weight
        report[block, base] = total
        report[block, base + 1] = 0
        report[block, base + 2] = rate


@ti.data_oriented
class Drag(Force):
    """Viscous drag of a triangle moving through the air: f = -A B (v - wind), B = c_n n n^T + c_t (I - n n^T).

    A and n are those of the triangle as it is; v is the mean of its vertices. The force is linear in v and goes
    into the implicit solve; its derivative by position is left out of the matrix.
    """

    def __init__(self, fields: Fields, model: ParticleState, scene: Scene, mode: str) -> None:
        self.model = model
        vertices = np.concatenate([model.particle[c.mesh.faces + c.start] for c in scene.cloths])
        self.elements = Elements(fields, model.blocks, vertices)
        air = scene.air
        assert air is not None  # build_forces makes no drag without air
        self.built, self.script, self.now = air, scene.script, np.zeros(3)
        self.drag = fields.real(2, data=np.array([air.normal, air.tangential]))  # c_n, c_t: other ones compile nothing anew
        density = min(f.density for c in scene.cloths for f in c.fabrics)
        self.rates = (0.0, max(float(air.normal), float(air.tangential)) / density)
        self.time_dependent = self.interpolated_wind = callable(air.wind)
        if not air.varies_in_space:
            self.now = air.wind_at(0.0)
        self.wind = fields.real(1, 3, self.now)
        self._fields = fields

    def rounding_energy(self, d: float) -> float:
        """None: drag has no energy."""
        return 0.0

    def build_stiffness(self) -> None:
        """Allocates the matrix, which only an implicit step needs."""
        self.A, self.stiff = self._fields.real(self.elements.count, 6), True

    @property
    def air(self) -> Air:
        """The air as it now is."""
        return self.script.air or self.built

    def follow(self, script: Script) -> None:
        """See `Force`."""
        self.script = script

    def set_time(self, t: float) -> None:
        """The wind at t [s], where it changes."""
        if self.time_dependent or self.script.air is not None:
            self.set_wind(self.air.wind_at(t))

    def set_wind(self, now: np.ndarray) -> None:
        """Sets the velocity of the air (3,) [m/s]."""
        self.now = now
        self._set(*map(float, now))

    @ti.kernel
    def _set(self, x: float, y: float, z: float):
        self.wind[0] = ti.Vector([x, y, z])

    @ti.func
    def air_at(self, e):
        """The wind at a triangle."""
        return self.wind[0]

    @ti.func
    def coefficient(self, e):
        """A B: area times the drag tensor, 6 numbers."""
        v = self.elements.vertices[e]
        x = ti.static(self.model.x)
        twice = (x[v[1]] - x[v[0]]).cross(x[v[2]] - x[v[0]])
        area = 0.5 * twice.norm()
        n = twice / ti.max(2 * area, 1e-30)
        return sym_scaled_identity(area * self.drag[1]) + area * (self.drag[0] - self.drag[1]) * sym_outer(n)

    @ti.func
    def slip(self, e):
        """Mean velocity of the triangle against the air."""
        u = self.elements.vertices[e]
        v = ti.static(self.model.v)
        return (v[u[0]] + v[u[1]] + v[u[2]]) / 3 - self.air_at(e)

    @ti.func
    def scatter(self, e, value, q: ti.template(), lo, hi):
        """Adds the same to the three vertices."""
        for a in ti.static(range(3)):
            self.model.blocks.add(q, self.elements.vertices[e][a], value, lo, hi)

    @ti.func
    def add_force(self, block, f: ti.template()):
        """f += drag"""
        lo, hi = self.model.blocks.row[block], self.model.blocks.row[block + 1]
        for e in range(self.elements.first[block], self.elements.first[block + 1]):
            self.scatter(e, -sym_times(self.coefficient(e), self.slip(e)) / 3, f, lo, hi)

    @ti.func
    def evaluate(self, block, linearizes, moves, c, to: ti.template(), base: ti.template(), report: ti.template(),
                 dtype: ti.template()):
        """No energy; in column `base` half of the power of drag [W] beyond that on cloth at rest, then the power of drag on
        the cloth [W]. With `linearizes`, b += c f; stores -c D and adds its diagonal to P."""
        lo, hi = self.model.blocks.row[block], self.model.blocks.row[block + 1]
        total, taken = ti.cast(0, dtype), ti.cast(0, dtype)
        for e in range(self.elements.first[block], self.elements.first[block + 1]):
            B, slip, wind = self.coefficient(e), self.slip(e), self.air_at(e)
            if self.elements.primary[e] == 1:
                total += 0.5 * (slip + wind).dot(sym_times(B, slip - wind))
                taken += (slip + wind).dot(sym_times(B, slip))
            if ti.static(self.stiff):
                if linearizes == 1:
                    self.scatter(e, -c * sym_times(B, slip) / 3, to.b, lo, hi)
                    self.A[e] = c * B / 9
                    self.scatter(e, c * B / 9, to.P, lo, hi)
        report[block, base] = total
        report[block, base + 1] = taken

    @ti.func
    def add_product(self, block, p: ti.template(), q: ti.template()):
        """q += -c D p"""
        lo, hi = self.model.blocks.row[block], self.model.blocks.row[block + 1]
        for e in range(self.elements.first[block], self.elements.first[block + 1]):
            v = self.elements.vertices[e]
            self.scatter(e, sym_times(self.A[e], p[v[0]] + p[v[1]] + p[v[2]]), q, lo, hi)

    def build_levels(self, levels) -> None:
        """Nothing: the block of drag is small against the mass of a node."""

    @ti.func
    def add_level_block(self, n, c, D, levels: ti.template()):
        """D, without drag"""
        return D
