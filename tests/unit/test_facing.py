"""Fitted cameras see cloth from a side from which much of it is seen; heat maps stand out from floors."""

import re
from types import SimpleNamespace

import numpy as np
import pytest

import taichi_cloth as tc
from taichi_cloth.app.recorded import _turntable
from taichi_cloth.backend import runtime
from taichi_cloth.output.camera import DIRECTION
from taichi_cloth.output.colors import heat_colors
from taichi_cloth.output.facing import RAISED, WAYS, facing
from taichi_cloth.output.look import Look
from taichi_cloth.output.picture import Artist
from taichi_cloth.recording import record
from taichi_cloth.recording.expected import expected
from taichi_cloth.recording.report import page

SHEET = tc.grid(0.6, 4)


def turned(degrees: float) -> np.ndarray:
    """(n, 3) positions of the sheet, turned about the vertical [m]."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return SHEET.x @ np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]).T


def towel(degrees: float) -> tc.Scene:
    """A sheet that lies level at first, held by its upper edge."""
    scene = tc.Scene()
    scene.pin(scene.add_cloth(SHEET, tc.Fabric(0.2, tc.Stretch(100)), turned(degrees)), "top")
    return scene


def seen(way: tuple[float, float, float], degrees: float) -> float:
    """Part of the hanging towel's area that is seen from a direction."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return abs(np.array(way) @ [s, 0, c]) / np.linalg.norm(way)


@pytest.mark.parametrize("degrees", range(0, 180, 15))
def test_a_towel_is_not_seen_edge_on(degrees):
    """Before the run, and by the frames of one in which it hangs."""
    scene = towel(degrees)
    *_, last = expected(scene, 1.0)
    assert last["hung"][:, 1].min() == pytest.approx(-0.6) and last["hung"][:, 1].max() == pytest.approx(0.0, abs=1e-9)
    way = facing(expected(scene, 1.0), SHEET.faces)
    assert way == facing([{"x": last["hung"]}], SHEET.faces)
    assert seen(way, degrees) > 0.55 and seen(way, degrees) > 0.6 * max(seen(other, degrees) for other in WAYS) - 1e-9
    assert (way == DIRECTION) == (seen(DIRECTION, degrees) > 0.6 * max(seen(other, degrees) for other in WAYS))


def test_cloth_that_goes_round_something_is_seen_from_the_usual_side():
    x, faces = tc.Sphere(0.3).surface()
    assert facing([{"x": x}], faces) == facing([], faces) == DIRECTION


@pytest.mark.parametrize("slope, above", [(0.0, True), (-0.3, True), (-1.2, False)])
def test_cloth_that_lies_flat_is_seen_from_above(slope, above):
    """A tablecloth, from the side on which a flat one is; a steep one shows itself. A line was seen of what lay level."""
    x = turned(40.0)
    x[:, 1] = slope * x[:, 2]
    way = facing([{"x": x}], SHEET.faces)
    assert (way[1] == RAISED) == above and way[0] == DIRECTION[0] and way[2] == DIRECTION[2]


def test_a_turntable_looks_down_at_what_lies_flat(tmp_path, monkeypatch):
    """And a page about the run begins there."""
    x = np.column_stack([SHEET.x[:, 0], 0 * SHEET.x[:, 0], SHEET.x[:, 2]])
    scene = tc.Scene()
    scene.add_cloth(SHEET, tc.Fabric(0.2, tc.Stretch(100)), x)
    run = SimpleNamespace(geometry=record.as_built(scene), fps=30, frames=lambda: [0], path="run", manifest={},
                          frame=lambda k: {"t": np.array(0.0), "x": x})
    tilt = float(re.search(r'"tilt": ([\d.-]+)', page(run, "", "", ""))[1])
    assert np.degrees(tilt) == pytest.approx(33.3, abs=0.1)
    frozen = SimpleNamespace(points=lambda: x, frame=run.frame, geometry=run.geometry)
    monkeypatch.setattr("taichi_cloth.output.retimed.Frozen", lambda *_: frozen)
    args = SimpleNamespace(turntable=8, frames="", speed=None, fps=None, orbit=0.0, frame=0, camera=None, size=(64, 48))
    _turntable(args, run)
    eye, target, _ = args.camera[0][1]
    assert np.subtract(eye, target)[1] / np.linalg.norm(np.subtract(eye, target)) == pytest.approx(np.sin(tilt), abs=1e-3)


def test_a_fitted_camera_looks_from_there():
    """A towel along the usual view; a side that is asked for stays."""
    degrees = np.degrees(np.arctan2(DIRECTION[0], DIRECTION[2])) + 90
    scene = towel(degrees)
    geometry, frames = record.as_built(scene), list(expected(scene, 1.0))
    runtime.go_on()
    for camera, angle in ((None, 40.0), ("front", None)):
        made = Artist(geometry, (64, 48), Look(camera=camera), lambda: frames).camera
        way = np.subtract(made.eye, made.target)
        assert seen(tuple(way), degrees) > 0.6 if angle else abs(way[0]) < 1e-9


def test_a_page_that_plays_a_run_begins_there():
    """Seen along the towel's plane it would be a line."""
    degrees = float(np.degrees(np.arctan2(DIRECTION[0], DIRECTION[2])) + 90)
    scene = towel(degrees)
    *_, last = expected(scene, 1.0)
    run = SimpleNamespace(geometry=record.as_built(scene), fps=30, frames=lambda: [0], path="run",
                          frame=lambda k: {"t": np.array(0.0), "x": last["hung"]})
    found = re.search(r'"turn": ([\d.-]+)', page(run, "", "", ""))
    turn = float(found[1])
    assert seen((np.sin(turn), 0.0, np.cos(turn)), degrees) > 0.6


@pytest.mark.parametrize("diverging", [True, False])
def test_no_value_of_a_heat_map_is_grey(diverging):
    """Floors and solids are; whatever the light, a colour's ratios stay."""
    colors = heat_colors(np.linspace(0, 1, 101), 0.0, 1.0, diverging)
    assert (1 - colors.min(axis=1) / colors.max(axis=1)).min() > 0.5
