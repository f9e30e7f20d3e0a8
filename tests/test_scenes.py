"""Every scene, small: it runs, its check passes, its file keeps to the rules; also with Taichi's bounds checks on."""

import os
import pathlib
import subprocess
import sys

import numpy as np
import pytest

import taichi_cloth as tc
from taichi_cloth import scenefile
from taichi_cloth.intersections import count_crossings

FOLDER = pathlib.Path(__file__).parents[1] / "scenes"
NAMES = sorted(p.stem for p in FOLDER.glob("*.py"))


def clear_of_solids(sim: tc.Simulation, frame: int) -> None:
    """No triangle of cloth crosses one of a solid, counted exactly; no vertex is in a solid by 1 % of its thickness."""
    x = sim.positions()
    faces = np.concatenate([c.mesh.faces + c.start for c in sim.scene.cloths])
    for solid in sim.scene.solids:
        if not isinstance(solid.shape, tc.Plane):
            crossed = count_crossings(x, faces, solid.surface_at(sim.time), solid.shape.surface()[1])
            assert crossed == 0, f"frame {frame}: {crossed} crossings with {solid.name}"
    if frame and sim.contacts is not None:
        found = sim.contacts.found
        thickness = np.array([s.thickness for s in sim.scene.solids])[found.solid]
        assert (found.gap + thickness > -0.01 * thickness).all(), f"frame {frame}: a vertex is inside a solid"


def run(name: str, duration: float | None = None, **kwargs) -> tuple[scenefile.SceneFile, tc.Simulation]:
    scene = scenefile.read(str(FOLDER / f"{name}.py"))
    plan = dict(scene.run)
    length, fps = duration or plan.pop("duration"), plan.pop("fps")
    plan.pop("duration", None)
    sim = tc.Simulation(scene.make(scene.small), **{**plan, **kwargs})
    sim.run(length, fps, clear_of_solids)
    return scene, sim


@pytest.mark.parametrize("name", NAMES)
def test_scene(name):
    scene, sim = run(name)
    assert scene.summary and scene.check
    results = list(scene.check(sim))
    assert results and all(good for _, good in results), results
    sim.close()


@pytest.mark.parametrize("name", ["hang", "trampoline", "flag", "table", "rotating_sphere"])
def test_scene_in_f32(name):
    scene, sim = run(name, precision="f32")
    assert all(good for _, good in scene.check(sim))
    sim.close()


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
from taichi_cloth import scenefile
sim = tc.Simulation(scenefile.read({str(FOLDER / "swing.py")!r}).make({{"n": 11}}), debug=True)
sim.integrator.system.operator.alter_motion(np.array([125], dtype=np.int32), np.zeros((1, 3)))
''')
    root = str(FOLDER.parent)
    done = subprocess.run([sys.executable, str(script)], capture_output=True, text=True, timeout=120, check=False,
                          env={**os.environ, "PYTHONPATH": root})
    assert done.returncode != 0
    assert "of size (121) with indices (125)" in done.stderr, done.stderr
