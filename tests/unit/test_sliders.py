"""The sliders of a hinge, alone: what a fold that passes through itself keeps."""

from types import SimpleNamespace

import numpy as np
import pytest

from taichi_cloth.backend import runtime
from taichi_cloth.backend.fields import Fields
from taichi_cloth.backend.language import ti
from taichi_cloth.backend.rows import read, write
from taichi_cloth.forces.hysteresis import Hysteresis, Sliders
from taichi_cloth.system.state import Remembered

REACH = 0.5  # rad, of either slider


@ti.data_oriented
class Hinge:
    """One hinge whose angle is told."""

    def __init__(self) -> None:
        run = runtime.start("cpu", "f64")
        fields = Fields(run.exchange)
        model = SimpleNamespace(remember=lambda name, n, width: Remembered(fields, n, width, None))
        law = Sliders(np.array([[0.3, 0.2]]), np.full((1, 2), REACH), np.ones(1), np.zeros((1, 2)))
        self.law = Hysteresis(fields, model, SimpleNamespace(count=1, per_entry=lambda data: data), law)
        self.out = fields.real(2)
        fields.allocate()

    @ti.kernel
    def turn(self, C: float):
        self.law.return_map(0, C, 0.01)
        torque, secant, slope, energy = self.law.respond(0, C)
        self.out[0], self.out[1] = torque, energy

    def at(self, C: float) -> tuple[float, float]:
        """(torque, energy) after a step that ends there."""
        self.turn(C)
        return tuple(read(self.out).tolist())


def test_a_fold_that_passes_through_itself_is_the_same_from_the_other_side():
    """Folded to 3 rad and let back to 2.3, its sliders are at 2.5; at -2.3 they are at -2.5, and it pulls as much."""
    hinge = Hinge()
    hinge.at(2.99)
    torque, energy = hinge.at(2.3)
    here = read(hinge.law.positions.now).copy()
    assert torque < 0 < energy and (here > 2.3).all()
    assert hinge.at(-2.3) == pytest.approx((-torque, energy)) and read(hinge.law.positions.now) == pytest.approx(-here)
    write(hinge.law.positions.now, here)  # what is only opened as far has gone another way: nothing is turned round
    hinge.at(-1.0)
    assert read(hinge.law.positions.now) == pytest.approx(np.full((1, 2), REACH - 1.0))
