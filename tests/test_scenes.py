"""Every scene, small: it runs, its check passes, its file keeps to the rules."""

import pathlib

import numpy as np
import pytest
from reference.geometry import against_solids

import taichi_cloth as tc
from taichi_cloth.app import scenefile
from taichi_cloth.output.camera import frame
from taichi_cloth.recording import record
from taichi_cloth.scene.view import camera_at

pytestmark = pytest.mark.slow

FOLDER = pathlib.Path(__file__).parents[1] / "scenes"
NAMES = sorted(p.stem for p in FOLDER.glob("*.py"))


SHORTER = {"body": 1.4, "bunny_drape": 0.8, "laundry": 1.8, "outfit": 2.5, "rotating_sphere": 2.0}  # s: more of the same after
NEAREST = dict.fromkeys(("body", "bunny_drape", "needles"), 0.149)  # of the thickness; elsewhere cloth is outside solids


def clear_of_solids(sim: tc.Simulation, frame: int) -> None:
    """Cloth crosses no solid, is inside none and nearer to none than its scene allows, by geometry of the tests' own;
    the forces on the solids are those on the cloth, turned round."""
    for name, (nearest, crossed) in against_solids(sim, sampled=True).items():
        assert not crossed, f"frame {frame}: {crossed} crossings with {name}"
        assert nearest >= sim.nearest, f"frame {frame}: {nearest:.3g} thicknesses from {name}"
    if sim.scene.solids:
        force, loads = sim.contact_forces().sum(axis=0), sum(load for load, _ in sim.solid_loads().values())
        assert force == pytest.approx(-loads, abs=1e-4 * (1e-3 + np.abs(force).max())), f"frame {frame}"


WORN = ("dress_up", "incline", "shirt", "skirt_pleats")  # whose cameras look at the cloth, not at all that it is on
THROWN = ("fold",)  # whose coarse sheet springs from the hand by .1 to .5 m, by a rounding; at its own size it does not


def framed(name: str, sim: tc.Simulation, frames: list[dict]) -> None:
    """All of the motion is in the picture, in its middle, with air round it, and fills it: in pictures of 16:9 and 4:3."""
    if sim.scene.view.camera is None or name in THROWN:
        return
    solids = record.geometry(sim)["solid_x"]
    in_the_middle(camera_at(sim.scene.view.camera, 0.0), np.concatenate(
        [f["x"] if name in WORN else np.concatenate([f["x"], f.get("solid_x", solids)]) for f in frames]))


def in_the_middle(view: tc.Camera, x: np.ndarray) -> None:
    camera = frame(view)
    for width in (640, 480):
        at = camera.project(x.astype(np.float64), width, 360)[:, :2] / [width, 360]
        low, high = at.min(axis=0), at.max(axis=0)
        assert low.min() > 0.04 and high.max() < 0.96 and np.abs((low + high) / 2 - 0.5).max() < 0.1, (low, high)
        assert (high - low).max() > 0.4


@pytest.mark.parametrize("walk", [False, True])
def test_all_of_the_figure_in_an_outfit_is_in_the_picture(walk):
    scene = scenefile.read(str(FOLDER / "outfit.py")).make({"spacing": "0.1", "walk": str(walk)})
    x = [s.surface_at(t) for s in scene.solids for t in np.linspace(0, 6, 61)] + [c.positions for c in scene.cloths]
    in_the_middle(scene.view.camera, np.concatenate(x))


def run(name: str, duration: float | None = None, **kwargs) -> tuple[scenefile.SceneFile, tc.Simulation]:
    scene = scenefile.read(str(FOLDER / f"{name}.py"))
    plan = dict(scene.run)
    length, fps = duration or SHORTER.get(name, plan["duration"]), plan.pop("fps")
    plan.pop("duration")
    sim = tc.Simulation(scene.make(scene.small), **{**plan, **kwargs})
    sim.nearest = NEAREST.get(name, 0.0)
    frames: list[dict] = []

    def each(sim: tc.Simulation, number: int) -> None:
        clear_of_solids(sim, number)
        frames.append(record.frame(sim))

    sim.run(length, fps, each)
    framed(name, sim, frames)
    return scene, sim


@pytest.mark.parametrize("name", NAMES)
def test_scene(name):
    scene, sim = run(name)
    assert scene.summary and scene.check
    results = list(scene.check(sim))
    assert results and all(good for _, good in results), results
    sim.close()


@pytest.mark.restarts
@pytest.mark.parametrize("name", ["hang", "trampoline", "flag", "table", "rotating_sphere"])
def test_scene_in_f32(name):
    scene, sim = run(name, precision="f32")
    assert all(good for _, good in scene.check(sim))
    sim.close()
