"""The body that a garment is put on: as it stands at time 0, and where it passes through itself."""

from types import SimpleNamespace

import numpy as np
import pytest

import taichi_cloth as tc
from taichi_cloth.garment import dressing


def balls(apart: float) -> tuple[np.ndarray, np.ndarray]:
    """Two balls of .1 m in one mesh, at x = 0 and `apart`."""
    x, faces = tc.Sphere(0.1).surface()
    return np.concatenate([x, x @ np.diag([1, -1, -1]) + [apart, 0.013, 0.007]]), np.concatenate([faces, faces + len(x)])


def body(apart: float) -> tc.Solid:
    x, faces = balls(apart)
    frames = np.stack([x, x + [0, 0.1, 0]])
    shape = tc.SolidMesh(frames, faces, fps=10, groups={"left": np.arange(len(x) // 2)})
    return tc.Scene().add_solid(shape, 0.3, 0.004, name="body", position=(1, 0, 0), parts={"left": 0.7})


def test_parts_of_a_body_keep_their_friction_as_it_stands():
    """A body with frictions by part could not be dressed: its groups were lost."""
    still = dressing._still(body(0.25))
    assert len(still.shape.x) == 1 and set(still.face_friction()) == {0.3, 0.7}


@pytest.mark.parametrize("apart, folded", [(0.11, True), (0.25, False)])
def test_a_dress_that_gives_up_is_told_where_the_body_passes_through_itself(apart, folded):
    def step(h):
        raise tc.SimulationError("gave up.", "CONTACT", 0.7)

    sim = SimpleNamespace(time=0.6, control=SimpleNamespace(h_max=0.01), step=step, stepper=SimpleNamespace(),
                          scene=SimpleNamespace(solids=[dressing._still(body(apart))]))
    with pytest.raises(tc.SimulationError, match="^gave up.") as told:
        dressing._advance(sim, None, "sewing")
    assert ("a character's rest pose, by --rest" in str(told.value)) is folded
    assert told.value.reason == "CONTACT" and told.value.time == 0.7
    if folded:  # the circle in which the balls meet has a radius of sqrt(.1^2 - .055^2) = .083 m
        low, high = (np.array(part.split(")")[0].split(", "), dtype=float) for part in str(told.value).split("(")[1:])
        assert low == pytest.approx([1.03, -0.08, -0.08], abs=0.05) and high == pytest.approx([1.08, 0.09, 0.09], abs=0.05)
