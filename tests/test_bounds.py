"""With Taichi's bounds checks on: an index out of bounds, which else ends the process without a word, is an exception then.

All is compiled anew for them, so one scene has all kinds of kernels in it.
"""

import os
import pathlib
import subprocess
import sys

import pytest

import taichi_cloth as tc
from taichi_cloth.app import scenefile

ROOT = pathlib.Path(__file__).parents[1]
SOLIDS = {"mesh": tc.SolidMesh(*tc.Box((0.3, 0.2, 0.3)).core()[:2]), "box": tc.Box((0.3, 0.2, 0.3)),
          "cylinder": tc.Cylinder(0.1, 0.2)}
MIDDLES = {"mesh": (0.3, -0.11, -0.3), "box": (0.7, -0.11, -0.3), "cylinder": (0.5, -0.11, -0.7)}

pytestmark = pytest.mark.slow


def all_at_once() -> tc.Scene:
    """A damped sheet falls in the wind, on solids of all kinds, a small one on it. It is held at a corner, and moved at
    another, which is let go again."""
    scene = tc.Scene(air=tc.Air(0.6, 0.03, wind=lambda t: (1.0, 0.0, 0.2 * t)))
    fabric = tc.Fabric(0.2, tc.Stretch(1000, 0.5, 0.98), tc.Shear(100, 0.1), tc.Bend(5e-5, 1e-7))
    wide, small = tc.grid(1.0, 10), tc.grid(0.3, 3)
    cloth = scene.add_cloth(wide, fabric, positions=wide.x, contact=tc.ClothContact(0.006, 0.3))
    scene.add_cloth(small, fabric, positions=small.x + [0.33, 0.009, -0.32], velocities=(0, -0.2, 0),
                    contact=tc.ClothContact(0.006, 0.3))
    for name, shape in SOLIDS.items():
        scene.add_solid(shape, friction=0.4, thickness=0.007, position=MIDDLES[name], name=name)
    scene.add_solid(tc.Plane(), friction=0.4, thickness=0.005, position=(0, -0.3, 0), name="floor")
    scene.at(0.02, lambda scene: scene.pin(cloth, "top_left"))
    scene.at(0.02, lambda scene: scene.move(cloth, "top_right", lambda t: (0, 0.1 * (t - 0.02), 0), relative=True))
    scene.at(0.05, lambda scene: scene.unpin(cloth, "top_right"))
    return scene


@pytest.mark.restarts
def test_no_index_is_out_of_bounds_in_a_scene_of_all_kinds():
    """By the integrator that is taken where none is asked for; implicit Euler has no kernel that it has not."""
    with tc.Simulation(all_at_once(), debug=True) as sim:
        sim.run(0.07, 30)
        assert sim.log and sim.runtime.debug
        sim.forces()
        sim.product(sim.positions(), 0.01)
        sim.integrator.system.solver._translate()  # only where nothing is ever held
        assert all(sim.solid_loads()[name][0][1] < 0 for name in SOLIDS), "not all solids are touched"
        assert max(r.layers for r in sim.log) > 0, "no cloth touches cloth"


@pytest.mark.restarts
def test_no_index_is_out_of_bounds_in_explicit_steps():
    swing = scenefile.read(str(ROOT / "scenes" / "swing.py"))
    with tc.Simulation(swing.make(swing.small), debug=True, integrator="verlet") as sim:
        sim.run(0.07, 30)
        assert sim.log and sim.runtime.debug
        sim.forces()


def test_debug_mode_does_catch_one(tmp_path):
    """In a process of its own: a kernel that was stopped leaves Taichi in no state to go on in."""
    script = tmp_path / "out_of_bounds.py"
    script.write_text(f'''
import numpy as np, taichi_cloth as tc
from taichi_cloth.app import scenefile
sim = tc.Simulation(scenefile.read({str(ROOT / "scenes" / "swing.py")!r}).make({{"cells": 10}}), debug=True)
sim.integrator.system.operator.correct_rhs_displacement(np.array([125], dtype=np.int32), np.zeros((1, 3)))
''')
    done = subprocess.run([sys.executable, str(script)], capture_output=True, text=True, timeout=120, check=False,
                          env={**os.environ, "PYTHONPATH": str(ROOT)})
    assert done.returncode != 0
    assert "of size (121) with indices (125)" in done.stderr, done.stderr
