"""Pictures from Python, simulations in a `with` block, and what objects say of themselves."""

import numpy as np
import pytest
from test_cli import read_png

import taichi_cloth as tc
from taichi_cloth.app import cli

SIZE = (160, 120)


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("still") / "run"
    assert cli.main(["run", "sphere_drape", "--out", str(folder), "--set", "cells=8", "--duration", "0.1", "--fps", "30",
                     "--size", "160x120", "--precision", "f64"]) == 0
    return folder


@pytest.mark.slow
def test_a_picture_is_the_one_that_the_command_draws(run, tmp_path):
    recording = tc.Recording(run)
    for frame in (1, None):
        number = recording.frames()[-1] if frame is None else frame
        image = tc.render(recording, tmp_path / "a.png", frame=frame, size=SIZE, quality="fast")
        assert image.shape == (120, 160, 3) and image.dtype == np.uint8 and np.ptp(image) > 100
        assert (image == read_png(run / "images" / f"{number:05d}.png")).all()
        assert (image == read_png(tmp_path / "a.png")).all()
    heat = tc.render(recording, size=SIZE, quality="fast", heat="speed", limits=(0, 2))
    assert (heat != image).any()


@pytest.mark.slow
def test_a_simulation_is_drawn_as_it_is_and_goes_on(run):
    scene = tc.Scene()
    cloth = scene.add_cloth(tc.grid(0.5, 5), tc.Fabric(0.2, tc.Stretch(100)))
    with tc.Simulation(scene, h=1 / 60) as sim:
        sim.step()
        x = sim.positions()
        first = tc.render(sim, size=SIZE)
        assert (sim.positions() == x).all()
        sim.run(0.2, fps=30)
        assert (tc.render(sim, size=SIZE) != first).any()
        assert "36 vertices" in repr(sim) and "50 triangles" in repr(cloth.mesh) and "36 vertices" in repr(scene)
    assert "closed" in repr(sim)
    with pytest.raises(tc.ClothError, match="closed"):
        sim.positions()
    with pytest.raises(ZeroDivisionError), tc.Simulation(scene, h=1 / 60) as sim:
        1 / 0  # noqa: B018
    with pytest.raises(tc.ClothError, match="closed"):
        sim.positions()


@pytest.mark.parametrize("options, what", [
    ({"size": (8, 100)}, "size"), ({"size": 3}, "pair"), ({"heat": "warmth"}, "warmth"), ({"quality": "best"}, "best"),
    ({"limits": (1, 1)}, "first must be less"), ({"frame": 99}, "no frame 99; it has 0 to 3"), ({"camera": 1}, "camera")])
def test_what_cannot_be_drawn_is_named(run, options, what):
    with pytest.raises(tc.ClothError, match=what):
        tc.render(tc.Recording(run), **{"size": SIZE, **options})


def test_neither_simulation_nor_recording():
    with pytest.raises(tc.SceneError, match="what = 'out'"):
        tc.render("out")
