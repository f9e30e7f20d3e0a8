"""Every scene, small: it runs, its check passes, its file keeps to the rules; also with Taichi's bounds checks on."""

import os
import pathlib
import subprocess
import sys

import numpy as np
import pytest
from reference.geometry import against_solids

import taichi_cloth as tc
from taichi_cloth.app import scenefile

pytestmark = pytest.mark.slow

FOLDER = pathlib.Path(__file__).parents[1] / "scenes"
NAMES = sorted(p.stem for p in FOLDER.glob("*.py"))


SHORTER = {"bunny_drape": 0.8, "laundry": 1.8}  # s: what comes after is more of the same
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


def run(name: str, duration: float | None = None, **kwargs) -> tuple[scenefile.SceneFile, tc.Simulation]:
    scene = scenefile.read(str(FOLDER / f"{name}.py"))
    plan = dict(scene.run)
    length, fps = duration or SHORTER.get(name, plan["duration"]), plan.pop("fps")
    plan.pop("duration")
    sim = tc.Simulation(scene.make(scene.small), **{**plan, **kwargs})
    sim.nearest = NEAREST.get(name, 0.0)
    sim.run(length, fps, clear_of_solids)
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


@pytest.mark.restarts
@pytest.mark.parametrize("name, integrator", [("flag", "safe"), ("trampoline", "backward_euler"), ("swing", "verlet"),
                                              ("table", "safe"), ("bunny_drape", "safe")])
def test_no_index_is_out_of_bounds(name, integrator):
    """Debug mode turns an index out of bounds, which else ends the process without a word, into an exception."""
    _, sim = run(name, duration=0.07, debug=True, integrator=integrator)
    assert sim.log and sim.runtime.debug
    sim.forces()
    if integrator != "verlet":
        sim.product(sim.positions(), 0.01)
    sim.close()


def test_debug_mode_does_catch_one(tmp_path):
    """In a process of its own: a kernel that was stopped leaves Taichi in no state to go on in."""
    script = tmp_path / "out_of_bounds.py"
    script.write_text(f'''
import numpy as np, taichi_cloth as tc
from taichi_cloth.app import scenefile
sim = tc.Simulation(scenefile.read({str(FOLDER / "swing.py")!r}).make({{"cells": 10}}), debug=True)
sim.integrator.system.operator.alter_motion(np.array([125], dtype=np.int32), np.zeros((1, 3)))
''')
    root = str(FOLDER.parent)
    done = subprocess.run([sys.executable, str(script)], capture_output=True, text=True, timeout=120, check=False,
                          env={**os.environ, "PYTHONPATH": root})
    assert done.returncode != 0
    assert "of size (121) with indices (125)" in done.stderr, done.stderr
