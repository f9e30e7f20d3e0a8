"""Sweeps: every combination has its row, wherever it was run and whatever happened there."""

import csv
import json
import os
import pathlib
import signal
import sys

import numpy as np
import pytest

import taichi_cloth as tc
from taichi_cloth.app.cli import main

sys.path.insert(0, str(pathlib.Path(__file__).parents[1] / "cli"))
from test_cli import call  # noqa: E402

HOW = {"duration": 0.1, "fps": 20, "h": 1 / 20, "integrator": "verlet"}
NOT_FIGURES = ("wall_s", "key")


def hung(cells: int, k: float, seed: int, traces: str, kills: bool = False) -> tc.Scene:
    """A sheet that hangs by a corner; one run kills its own process in the middle, the first time that it is run."""
    folder = pathlib.Path(traces)
    with open(folder / "begun", "a") as file:
        file.write(f"{os.getpid()}\n")
    scene = tc.Scene()
    mesh = tc.grid(1.0, cells)
    noise = 1e-3 * np.random.default_rng(seed).normal(size=mesh.x.shape)
    cloth = scene.add_cloth(mesh, tc.Fabric(0.2, tc.Stretch(k)), positions=mesh.x + noise)
    scene.pin(cloth, "top_left")

    def kill() -> None:
        flag = folder / "killed"
        if not flag.exists():
            flag.write_text(str(os.getpid()))
            os.kill(os.getpid(), signal.SIGKILL)

    if kills and (cells, k, seed) == (4, 300.0, 12):
        scene.at(0.05, kill)
    return scene


def sag(sim) -> float:
    return float(-sim.positions()[:, 1].min())


def fails(kind: str, number: int = 1, traces: str = "") -> tc.Scene:
    """Does what cannot be simulated, at once."""
    if traces:
        with open(traces, "a") as file:
            file.write(f"{kind}{number}\n")
    if kind == "fabric":
        tc.Fabric(-1.0)
    if kind == "nothing":
        return None  # type: ignore[return-value]
    return tc.Scene(gravity=(0, 0, 1 / (number - number)))


@pytest.mark.slow
@pytest.mark.skipif(os.name == "nt", reason="kills a process by a signal")
def test_24_runs_on_two_workers_with_one_killed_are_those_of_one_process(tmp_path):
    pytest.importorskip("distributed")
    grid = {"cells": [3, 4], "k": [200.0, 300.0, 400.0], "seed": [11, 12, 13, 14], "traces": [str(tmp_path)],
            "kills": [True]}
    told: list[str] = []
    there = tc.sweep(hung, grid, sag, out=tmp_path / "out", workers=2, say=told.append, **HOW)
    begun = (tmp_path / "begun").read_text().split()
    # the killed run twice, and those of its process whose results were not fetched yet: on a busy machine several; a third
    # process where that starts in time
    assert 25 <= len(begun) <= 36 and len(set(begun)) in (2, 3)
    assert (tmp_path / "killed").read_text() in begun and str(os.getpid()) not in begun
    assert [r["status"] for r in there.rows] == ["ok"] * 24 and len(told) == 24
    assert [r["run"] for r in there.rows] == list(range(24)) and there.rows[23]["cells"] == 4
    here = tc.sweep(hung, grid, sag, workers=0, **HOW)
    for a, b in zip(there.rows, here.rows):
        assert {n: v for n, v in a.items() if n not in NOT_FIGURES} == {n: v for n, v in b.items() if n not in NOT_FIGURES}
        assert len(a["digest"]) == 16 and a["steps"] in (2, 3)  # a rejected step goes on in two
    assert len({r["digest"] for r in here.rows}) == 24  # none is another's
    with tc.Simulation(hung(3, 200.0, 11, str(tmp_path)), threads=1, h=1 / 20, integrator="verlet") as sim:
        sim.run(0.1, 20)
        assert there.column("sag")[0] == -sim.positions()[:, 1].min()
    with open(tmp_path / "out" / "sweep.csv", newline="") as file:
        assert [float(r["sag"]) for r in csv.DictReader(file)] == there.column("sag").tolist()  # all digits
    page = (tmp_path / "out" / "sweep.html").read_text()
    assert "<figcaption>sag</figcaption>" in page and "cells = 4</text>" in page and page.count("<tr") == 25
    again = tc.sweep(hung, grid, sag, out=tmp_path / "out", workers=2, **HOW)
    assert again.again == 24 and again.rows == there.rows and len((tmp_path / "begun").read_text().split()) == len(begun) + 25


def test_failures_are_rows_with_their_reasons(tmp_path):
    traces = tmp_path / "begun"
    grid = {"kind": ["fabric", "nothing", "own"], "number": [1, 2], "traces": [str(traces)]}
    made = tc.sweep(fails, grid, workers=0, out=tmp_path / "out")
    assert [(r["status"], r["reason"]) for r in made.rows] == [("failed", "SceneError")] * 4 + [("failed", "ScriptError")] * 2
    assert "fabric density = -1" in made.rows[0]["message"] and "not a Scene" in made.rows[2]["message"]
    assert "ZeroDivisionError" in made.rows[4]["message"] and "test_sweep.py" in made.rows[4]["message"]
    assert made.summary() == "6 runs: 0 ok, 4 failed (SceneError), 2 failed (ScriptError)"
    page = (tmp_path / "out" / "sweep.html").read_text()
    assert page.count('<tr class="bad">') == 6
    assert "ZeroDivisionError" in made._repr_html_() and "failed (SceneError)" in repr(made)


def test_a_sweep_goes_on_where_it_ended(tmp_path):
    traces = tmp_path / "begun"

    def run(**more):
        traces.write_text("")
        made = tc.sweep(fails, {"kind": ["fabric"], "number": [1, 2, 3], "traces": [str(traces)], **more}, workers=0,
                        out=tmp_path / "out", fps=more.pop("fps", 30))
        return made.again, traces.read_text().split()

    assert run() == (0, ["fabric1", "fabric2", "fabric3"])
    assert run() == (3, [])
    assert run(number=[2, 4]) == (1, ["fabric4"])
    files = sorted((tmp_path / "out" / "runs").iterdir())
    assert len(files) == 4
    for file, text in zip(files, ("", "{}", json.dumps({"manifest": {}, "outcome": {}}))):
        file.write_text(text)  # damaged: run again
    again, begun = run(number=[1, 2, 3, 4])
    assert again == 1 and len(begun) == 3
    assert run(h=[1 / 60, 1 / 30])[0] == 0  # another step is another run


def test_interrupted_it_keeps_what_is_done(tmp_path):
    grid = {"kind": ["fabric"], "number": range(5), "traces": [str(tmp_path / "begun")]}
    told: list[str] = []

    def say(text):
        told.append(text)
        if len(told) == 3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        tc.sweep(fails, grid, workers=0, out=tmp_path / "out", say=say)
    with open(tmp_path / "out" / "sweep.csv", newline="") as file:
        assert [r["number"] for r in csv.DictReader(file)] == ["0", "1", "2"]
    assert tc.sweep(fails, grid, workers=0, out=tmp_path / "out").again == 3


@pytest.mark.slow
def test_a_run_that_gives_up_has_its_rejection_as_reason():
    def jerked(speed: float) -> tc.Scene:
        scene = tc.Scene()
        cloth = scene.add_cloth(tc.grid(1.0, 3), tc.Fabric(0.2, tc.Stretch(200, 0.2), tc.Shear(50, 0.1)))
        scene.move(cloth, "top_left", lambda t: (0, speed * t, 0), relative=True)
        return scene

    def odd(sim):
        return {"speed": 1.0} if sim.scene.cloths else {}

    made = tc.sweep(jerked, {"speed": [1000.0]}, workers=0, duration=0.1, fps=20, h=1 / 20, h_min=1 / 20,
                    integrator="backward_euler")
    assert made.rows[0]["status"] == "gave up" and made.rows[0]["reason"] == "STRETCH", made.rows
    made = tc.sweep(jerked, {"speed": [0.1]}, odd, workers=0, duration=0.1, fps=20, h=1 / 20, integrator="backward_euler")
    assert made.rows[0]["reason"] == "SceneError" and "name of a setting" in made.rows[0]["message"]


def test_what_is_wrong_is_named_before_anything_runs(tmp_path):
    for grid, more, words in (
            ({"kid": [1]}, {}, "did you mean 'kind'"), ({"number": [1]}, {}, "needs a value for 'kind'"),
            ({"kind": "own"}, {}, "several values"), ({"kind": []}, {}, "several values"),
            ({"kind": ["a", "a"]}, {}, "twice"),
            ({"kind": [lambda t: t]}, {}, "its text is another"), ({"kind": ["own"], "precision": ["f16"]}, {}, "f16"),
            ({"kind": ["own"]}, {"seeds": 3}, "option `seed`"), ({"kind": ["own"]}, {"duration": -1}, "duration = -1"),
            ({"kind": ["own"]}, {"workers": -1}, "workers = -1"), ({"kind": ["own"]}, {"integrater": "safe"}, "integrater"),
            ({"kind": ["own"]}, {"metrics": {"x": 3}}, "x = 3"),
            ({"kind": ["own"]}, {"workers": 0, "scheduler": "tcp://x:1"}, "leave the scheduler out"),
            ({"kind": ["own"], "number": range(2000), "h": np.linspace(1e-3, 1e-2, 1000)}, {}, "number of runs")):
        with pytest.raises(tc.SceneError, match=words):
            tc.sweep(fails, grid, out=tmp_path / "out", **more)
    with pytest.raises(tc.SceneError, match="did you mean 'reason'"):
        tc.sweep(fails, {"kind": ["own"]}, workers=0).column("reasom")
    assert not (tmp_path / "out").exists()


def test_parquet_holds_the_table(tmp_path):
    parquet = pytest.importorskip("pyarrow.parquet")
    grid = {"kind": ["fabric", "own"], "number": [1, 2]}
    made = tc.sweep(fails, grid, workers=0, out=tmp_path)
    table = parquet.read_table(tmp_path / "sweep.parquet").to_pydict()
    assert table["reason"] == [r["reason"] for r in made.rows] and table["number"] == [1, 2, 1, 2]


SBATCH = """#!/bin/sh
# stands for Slurm's: notes the job's script, and runs it here
cp "$1" "{folder}/job"  # the script is removed when this one ends
sh "{folder}/job" > "{folder}/log" 2>&1 &
echo $! > "{folder}/pid"
echo "Submitted batch job $$"
"""


@pytest.mark.slow
@pytest.mark.skipif(os.name == "nt", reason="Slurm is not for Windows")
def test_workers_that_slurm_starts(tmp_path, monkeypatch):
    pytest.importorskip("dask_jobqueue")
    for name, text in (("sbatch", SBATCH.format(folder=tmp_path)), ("scancel", "#!/bin/sh\n")):
        (tmp_path / name).write_text(text)
        (tmp_path / name).chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}{os.pathsep}{os.environ['PATH']}")
    made = tc.sweep(fails, {"kind": ["fabric", "nothing"]}, workers=1, slurm={
        "queue": "cpu", "walltime": "00:05:00", "interface": "lo", "log_directory": str(tmp_path),
        "job_script_prologue": [f"export PYTHONPATH={os.pathsep.join(sys.path)}"]})
    assert [r["reason"] for r in made.rows] == ["SceneError"] * 2, made.rows
    job = (tmp_path / "job").read_text()
    assert "#SBATCH -p cpu" in job and "--cpus-per-task=1" in job and "--nthreads 1" in job
    with pytest.raises(tc.SceneError, match="slurm: "):
        tc.sweep(fails, {"kind": ["own"]}, slurm={"cores": 1, "walltimes": "1"})


@pytest.mark.slow
def test_the_command_makes_the_table(scene_file, tmp_path):
    done = call("sweep", scene_file, "--set", "k=1e2", "--set", "precision=f64,f32", "--seeds", "5:7", "--out",
                tmp_path / "out", "--workers", "0")
    assert done.returncode == 0 and "4 runs: 4 ok" in done.stdout and "[4/4] k=100.0" in done.stderr, done.stderr
    with open(tmp_path / "out" / "sweep.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert [(r["precision"], r["seed"]) for r in rows] == [("f64", "5"), ("f64", "6"), ("f32", "5"), ("f32", "6")]
    assert all(5 < float(r["widest"]) < 8 for r in rows) and rows[0]["digest"] != rows[2]["digest"]


@pytest.fixture
def scene_file(tmp_path):
    path = tmp_path / "tiny.py"
    path.write_text('''"""Tiny."""
import taichi_cloth as tc
RUN = {"duration": 0.1, "fps": 10, "h": 0.1, "integrator": "verlet"}
def build(cells: int = 2, k: float = 100.0, seed: int = 0) -> tc.Scene:
    scene = tc.Scene()
    scene.pin(scene.add_cloth(tc.grid(1.0 + seed, cells), tc.Fabric(0.2, tc.Stretch(k))), "top_left")
    return scene
def metrics(sim):
    return {"widest": float(sim.positions()[:, 0].max())}
''')
    return path


def test_what_a_command_asks_for_is_checked_before_anything_runs(scene_file, tmp_path, capsys):
    for args, words in ((("--set", "kk=1"), "an option 'kk'; did you mean 'k'"), (("--seeds", "x"), "needs a number"),
                        (("--set", "k=1", "--set", "k=2"), "twice"), (("--slurm", "cpu"), "needs names and values"),
                        (("--set", "newton_max=a"), "needs a whole number"), (("--set", "k="), "several values"),
                        (("--set", "k=1e2,1/0"), "option k='1/0' needs a number"), (("--out", ""), "needs a folder's name"),
                        (("--scheduler", "nowhere:x"), "no Dask scheduler answers at nowhere:x")):
        code = main(["sweep", str(scene_file), "--out", str(tmp_path / "no"), *args])
        said = capsys.readouterr().err
        assert code == 2 and words in said and not (tmp_path / "no" / "runs" / "x").exists(), (args, said)
