"""Kernels are compiled for a make of scene, not for its mesh and numbers: counted in Taichi's cache."""

import os
import subprocess
import sys

import pytest

CODE = """
import sys
import taichi_cloth as tc
n, part = int(sys.argv[1]), float(sys.argv[2])
mesh, scene = tc.grid(0.5, n), tc.Scene(gravity=(0, -9.81 * part, 0), air=tc.Air(0.1 * part, 0.02 * part))
fabric = tc.Fabric(0.2 * part, tc.Stretch(1000 * part, part), tc.Shear(100 * part), tc.Bend(5e-5 * part))
contact = tc.ClothContact(0.004 * part, 0.3 * part)
cloth = scene.add_cloth(mesh, fabric, positions=mesh.x + [0, 0.01 * part, 0], contact=contact)
scene.pin(cloth, "top_left")
scene.add_solid(tc.Box((0.2 * part, 0.1, 0.2)), position=(0.25, -0.06, -0.25), friction=0.3 * part, thickness=0.005 * part)
sim = tc.Simulation(scene, h=part / 60, threads=1)
for _ in range(6):
    sim.step()
assert max(r.contacts for r in sim.log) > 0
"""


def kernels(folder, script, *args) -> int:
    """Compiled kernels in a cache after a process has run."""
    env = os.environ | {"TI_OFFLINE_CACHE_FILE_PATH": str(folder)}
    done = subprocess.run([sys.executable, str(script), *args], env=env, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return sum(1 for _ in folder.rglob("*.tic"))


@pytest.mark.slow
def test_another_mesh_fabric_air_thickness_and_step_compile_nothing(tmp_path):
    script = tmp_path / "scene.py"
    script.write_text(CODE)
    first = kernels(tmp_path / "cache", script, "8", "1.0")
    assert first > 20 and kernels(tmp_path / "cache", script, "11", "1.1") == first
