"""The commands study and verify."""

import csv
import json
import re

import pytest
from inside import call

from taichi_cloth.studies.study import SAFE, STAR

pytestmark = pytest.mark.slow


def test_study_writes_tables(tmp_path):
    done = call("study", "swing", "--small", "--duration", "0.2", "--h", "1/30,1/60", "--integrators", "verlet,backward_euler",
                "--tolerances", "1e-2", "--substeps", "1,2", "--out", tmp_path / "s")
    assert done.returncode == 0, done.stderr
    data = json.loads((tmp_path / "s" / "study.json").read_text())
    rows = data["rows"]
    assert [(r["integrator"], r["tolerance"], r["substep"]) for r in rows] == [
        ("verlet", None, 1), ("verlet", None, 2), ("backward_euler", None, 1), ("backward_euler", None, 1), ("safe", 0.01, 1)]
    softened = rows.pop(1)
    assert softened["error"] > rows[0]["error"] and softened["evaluations"] < 0.7 * rows[0]["evaluations"]
    assert rows[1]["error"] > rows[2]["error"] > rows[3]["error"] > rows[0]["error"] and all(r["wall"] > 0 for r in rows)
    rows.insert(1, softened)
    assert any(r["best"] for r in rows) and rows[2]["steps"] < rows[3]["steps"] == 12
    with open(tmp_path / "s" / "study.csv", newline="") as file:
        assert [float(r["error"]) for r in csv.DictReader(file)] == [r["error"] for r in rows]
    svg = (tmp_path / "s" / "study.svg").read_text()
    assert svg.startswith("<svg xmlns") and svg.count("<circle") == 5
    assert "RMS error of positions at t = 0.2 s" in done.stdout
    assert done.stdout.count("\n* ") == sum(r["best"] for r in rows) + 1
    assert done.stdout.splitlines()[-3:-1] == [SAFE, STAR] and done.stdout.count("backward_euler") == 2
    assert done.stderr.count("case ") == 5 and "case 3 of 5: backward_euler h = 1/30\n" in done.stderr
    assert "wall s" not in done.stderr and not re.search(r"\d\.\d\de-\d\d", done.stderr.split("case ", 1)[1])


def test_verify_passes_on_a_scene_and_sees_what_is_wrong(tmp_path):
    done = call("verify", "trampoline", "--small", "--time", "0.1")
    assert done.returncode == 0, done.stdout + done.stderr
    for words in ("pins drift", "force against differences", "stiffness product", "symmetric", "add up to", "falls with g",
                  "direct solve"):
        assert words in done.stdout, words
    assert "FAILED" not in done.stdout


def test_bad_requests_are_named(tmp_path):
    for args, words in ((("study", "swing", "--h", "x"), "needs numbers"),
                        (("study", "swing", "--h", ","), "at least one step"),
                        (("study", "swing", "--integrators", "rk4"), "unknown integrator 'rk4'"),
                        (("study", "swing", "--substeps", "-1"), "substeps = -1"),
                        (("study", "swing", "--h", "nan"), "needs numbers"), (("study", "swing", "--duration", "-1"),
                                                                              "duration = -1"),
                        (("study", "swing", "--out", "README.md"), "cannot write to README.md"),
                        (("verify", "swing", "--time", "0"), "time = 0"), (("verify", "nothing"), "nothing")):
        done = call(*args)
        assert done.returncode == 2 and words in done.stderr, (args, done.stderr)
