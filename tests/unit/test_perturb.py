"""`scripts/perturb.py`: what it moves, which tests it runs, and its table."""

import pathlib
import sys

import numpy as np

import taichi_cloth as tc

ROOT = pathlib.Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "scripts"))

import perturb  # noqa: E402
from perturbing import noise  # noqa: E402


def test_starts_differ_by_a_rounding_and_the_same_one_never_does():
    """What is held stays, and what is sewn together goes as one."""
    scene, mesh = tc.Scene(), tc.grid(1.0, 4)
    cloth = scene.add_cloth(mesh, tc.Fabric(0.2, tc.Stretch(10.0)), positions=mesh.x)
    scene.pin(cloth, "top_left")
    scene.sew(cloth, [2], [14])
    with tc.Simulation(scene, integrator="backward_euler") as sim, tc.Simulation(scene, integrator="backward_euler") as other:
        moved, again, third = (s.model.to_user(noise(s, k)) for s, k in ((sim, 1), (other, 1), (sim, 2)))
    held = mesh.groups["top_left"]
    assert (moved == again).all() and (moved != third).any(axis=1).sum() == mesh.vertex_count - len(held)
    assert (moved[held] == 0).all() and 5e-10 < np.abs(moved).max() <= 1e-9 and (moved[2] == moved[14]).all()


def test_every_contact_test_is_there():
    """Of the tests that are named, and of the scenes; those without contact are left out."""
    tests = perturb.contact_tests()
    assert all((ROOT / test.split("::")[0]).is_file() for test in tests)
    assert "tests/test_scenes.py::test_scene[needles]" in tests and "tests/test_scenes.py::test_scene[hang]" not in tests


def test_the_table_counts_a_start_once(tmp_path):
    """A test that passes and whose fixtures fail after it has failed; one that is cut off counts for nothing."""
    row = {"test": "tests/unit/test_x.py::test_y", "seconds": 1.0, "message": "", "threads": 1}
    rows = [{**row, "start": 0, "outcome": "passed"}, {**row, "start": 1, "outcome": "passed"},
            {**row, "start": 1, "outcome": "failed", "message": "assert 2 | 1\n +  where"},
            {**row, "start": 2, "outcome": "begun"}]
    lines, failed = perturb.table(rows)
    assert lines[2:] == ["| `unit/test_x.py::test_y` | 1 of 2 | 1/1 | assert 2 \\| 1 |"] and failed == [row["test"]]
    results = tmp_path / "results.jsonl"
    results.write_text('{"test": "a", "outcome": "passed"}\n{"test": "b", "outc')
    assert perturb.read_rows(results) == [{"test": "a", "outcome": "passed"}]
