"""Loads: forces that a script puts on vertices, whatever their positions. Without an energy, as air: their power is F . v."""

import numpy as np

from ..backend.fields import Fields
from ..backend.language import ti
from ..backend.rows import write
from ..scene.attachment import Script
from ..scene.scene import Scene
from ..system.state import ParticleState
from .external import DeadLoad


@ti.data_oriented
class Loads(DeadLoad):
    """The sum of all loads on every particle."""

    time_dependent = True

    def __init__(self, fields: Fields, model: ParticleState, scene: Scene, mode: str) -> None:
        self.model, self.script = model, scene.script
        self.now: np.ndarray = np.zeros((model.n, 3))
        self.load = fields.real(model.n, 3, self.now)

    def rounding_energy(self, d: float) -> float:
        """None: they have no energy."""
        return 0.0

    def follow(self, script: Script) -> None:
        """See `Force`."""
        self.script = script

    def set_time(self, t: float) -> None:
        """The loads as they are at t [s]."""
        now = np.zeros((self.model.n, 3))
        for load in self.script.loads:
            share = load.cloth.shares(load.vertices)[:, None]
            now[self.model.particle[load.vertices + load.cloth.start]] += share * load.at(t)
        if not np.array_equal(now, self.now):
            self.now = now
            write(self.load, now.astype(self.model.exchange))

    @ti.func
    def add_force(self, block, f: ti.template()):
        """f += F"""
        for i in range(self.model.blocks.row[block], self.model.blocks.row[block + 1]):
            f[i] = f[i] + self.load[i]

    @ti.func
    def evaluate(self, block, linearizes, moves, c, to: ti.template(), base: ti.template(), report: ti.template(),
                 dtype: ti.template()):
        """No energy; -F . v, whose derivative by v is -F, in column `base`, and again as the power [W] that it takes from the
        cloth. With `linearizes`, b += c F."""
        power = ti.cast(0, dtype)
        for i in range(self.model.blocks.row[block], self.model.blocks.row[block + 1]):
            power -= self.load[i].dot(self.model.v[i])
            if ti.static(self.stiff):
                if linearizes == 1:
                    to.b[i] = to.b[i] + c * self.load[i]
        report[block, base] = power
        report[block, base + 1] = power
