"""Sweeps: every combination has its row, wherever it was run and whatever happened there."""

import csv
import os
import pathlib
import shutil
import signal
import subprocess
import sys
import threading
import urllib.error
import urllib.request

import numpy as np
import pytest

import taichi_cloth as tc
from taichi_cloth.app.cli import main
from taichi_cloth.sweeps import engine
from taichi_cloth.sweeps.task import Outcome

sys.path.insert(0, str(pathlib.Path(__file__).parents[1] / "cli"))
from test_cli import call  # noqa: E402

HOW = {"duration": 0.1, "fps": 20, "h": 1 / 20, "integrator": "verlet"}
NOT_FIGURES = ("wall_s", "key")


def hung(cells: int, k: float, seed: int, traces: str, kills: bool = False) -> tc.Scene:
    """A sheet that hangs by a corner; one run kills its own process in the middle, the first time that it is run."""
    folder = pathlib.Path(traces)
    scene = tc.Scene()
    mesh = tc.grid(1.0, cells)
    noise = 1e-3 * np.random.default_rng(seed).normal(size=mesh.x.shape)
    cloth = scene.add_cloth(mesh, tc.Fabric(0.2, tc.Stretch(k)), positions=mesh.x + noise)
    scene.pin(cloth, "top_left")

    def begun() -> None:
        with open(folder / "begun", "a") as file:
            file.write(f"{os.getpid()}\n")

    def kill() -> None:
        flag = folder / "killed"
        if not flag.exists():
            flag.write_text(str(os.getpid()))
            os.kill(os.getpid(), signal.SIGKILL)

    scene.at(0.0, begun)
    if kills and (cells, k, seed) == (4, 300.0, 12):
        scene.at(0.05, kill)
    return scene


def sag(sim) -> float:
    return float(-sim.positions()[:, 1].min())


def fails(kind: str, number: int = 1) -> tc.Scene:
    """Does what cannot be simulated, at once."""
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
    grid = {"kind": ["fabric", "nothing", "own"], "number": [1, 2]}
    made = tc.sweep(fails, grid, workers=0, out=tmp_path / "out")
    assert [(r["status"], r["reason"]) for r in made.rows] == [("failed", "SceneError")] * 4 + [("failed", "ScriptError")] * 2
    assert "fabric density = -1" in made.rows[0]["message"] and "not a Scene" in made.rows[2]["message"]
    assert "ZeroDivisionError" in made.rows[4]["message"] and "test_sweep.py" in made.rows[4]["message"]
    assert made.summary() == "6 runs: 0 ok, 4 failed (SceneError), 2 failed (ScriptError)"
    page = (tmp_path / "out" / "sweep.html").read_text()
    assert page.count('<tr class="bad">') == 6
    assert "ZeroDivisionError" in made._repr_html_() and "failed (SceneError)" in repr(made)


def test_a_sweep_goes_on_where_it_ended(tmp_path):
    def run(**more):
        told: list[str] = []
        made = tc.sweep(fails, {"kind": ["fabric"], "number": [1, 2, 3], **more}, workers=0, out=tmp_path / "out",
                        say=told.append)
        assert [row["status"] for row in made.rows] == ["failed"] * len(made.rows)
        return made.again, [line.split("number=")[1].split(":")[0].split()[0] for line in told]

    assert run() == (0, ["1", "2", "3"])
    assert run() == (3, [])
    assert run(number=[2, 4]) == (1, ["4"])
    files = sorted((tmp_path / "out" / "runs").iterdir())
    assert len(files) == 4
    for file, text in zip(files, ("", '{"manifest": {}, "outcome": {}}', files[3].read_text())):
        file.write_text(text)  # damaged, or another's: run again
    again, begun = run(number=[1, 2, 3, 4])
    assert again == 1 and len(begun) == 3
    assert run(h=[1 / 60, 1 / 30])[0] == 0  # another step is another run


def test_interrupted_it_keeps_what_is_done(tmp_path):
    grid = {"kind": ["fabric"], "number": range(5)}
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
    assert made.rows[0]["status"] == "gave up" and made.rows[0]["reason"] in ("STRETCH", "ENERGY"), made.rows
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


SPEED, NO_CLOTH = 1.0, "a simulation needs a Scene with at least one cloth"


def odd(number: int) -> tc.Scene:
    """Refused when it is to be simulated, since nothing can move in it; there is a motion."""
    scene = tc.Scene()
    scene.add_prop(tc.Sphere(0.1), position=lambda t: (number * SPEED * t, 0, 0))
    return scene


def test_what_was_changed_outside_of_build_is_run_again(tmp_path, monkeypatch):
    def run(metrics=sag):
        made = tc.sweep(odd, {"number": [1, 2]}, metrics, workers=0, out=tmp_path / "out")
        assert [row["message"] for row in made.rows] == [NO_CLOTH] * 2
        return made.again, [row["key"] for row in made.rows]

    first = run()[1]
    assert run() == (2, first)
    monkeypatch.setattr(sys.modules[__name__], "SPEED", 1.5)
    again, second = run()
    assert again == 0 and not {*first} & {*second}
    assert run(lambda sim: 1.0)[0] == 0  # other figures
    assert run() == (2, second)
    monkeypatch.setattr(sys.modules[__name__], "SPEED", 1.0)
    assert run() == (2, first)  # both materials' rows are there


def test_rows_of_an_earlier_version_are_left_and_said(tmp_path):
    (tmp_path / "runs").mkdir()
    old = tmp_path / "runs" / "0123456789abcdef.json"
    old.write_text("{}")
    made = tc.sweep(odd, {"number": [1]}, workers=0, out=tmp_path)
    assert made.again == 0 and old.read_text() == "{}"
    assert "1 files" in made.notes[0] and "earlier version" in made.notes[0] and "earlier version" in (
        tmp_path / "sweep.html").read_text()


def test_runs_that_cannot_be_known_again_are_said_and_not_kept(tmp_path):
    lock = threading.Lock()

    def measured(sim):
        return lock.locked()

    for _ in range(2):
        made = tc.sweep(odd, {"number": [1, 2]}, measured, workers=0, out=tmp_path)
        assert made.again == 0 and "2 rows cannot be known again" in made.notes[0] and "lock" in made.notes[0]
    assert not any((tmp_path / "runs").iterdir())


def test_rows_of_a_worker_that_was_lost_are_tried_again(tmp_path, monkeypatch):
    def run():
        made = tc.sweep(odd, {"number": [1, 2]}, workers=0, out=tmp_path)
        return made.again, [row["status"] for row in made.rows]

    def dies(tasks):
        yield from ((k, Outcome("lost", "WORKER", "its worker died", {}, 0.0)) for k in range(len(tasks)))

    with monkeypatch.context() as patch:
        patch.setattr(engine, "serially", dies)
        assert run() == (0, ["lost"] * 2)
        assert run() == (0, ["lost"] * 2)
    assert not any((tmp_path / "runs").iterdir())
    assert run() == (0, ["failed"] * 2)
    assert run() == (2, ["failed"] * 2)


def test_what_becomes_of_tasks_whose_worker_is_gone():
    distributed = pytest.importorskip("distributed")

    class Future:
        def __init__(self, error):
            self.error = error

        def result(self):
            raise self.error

    died = engine._result(Future(distributed.KilledWorker("task", "worker", engine.TRIES)), distributed)
    assert (died.status, died.reason, died.scene) == ("lost", "WORKER", "") and "died 4 times" in died.message
    away = engine._result(Future(ModuleNotFoundError("no module named 'own'")), distributed)
    assert (away.status, away.reason) == ("lost", "ModuleNotFoundError") and "'own'" in away.message
    with pytest.raises(tc.BackendError, match="scheduler went away"):
        engine._result(Future(distributed.CancelledError("task")), distributed)


def test_that_no_parquet_is_written_is_said(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    (tmp_path / "sweep.parquet").write_text("old")
    made = tc.sweep(odd, {"number": [1]}, workers=0, out=tmp_path)
    assert made.notes == ["no sweep.parquet was written: pyarrow is not installed (pip install pyarrow)"]
    assert not (tmp_path / "sweep.parquet").exists() and "pip install pyarrow" in (tmp_path / "sweep.html").read_text()


def test_dashboards_and_certificates_are_checked_before_anything_runs(tmp_path, monkeypatch):
    ca = tmp_path / "ca.pem"
    ca.write_text("")
    monkeypatch.setitem(sys.modules, "bokeh", None)
    for more, error, words in (
            ({"tls": {"ca": ca}}, tc.SceneError, "needs cert"), ({"tls": {"kay": ca}}, tc.SceneError, "'key'"),
            ({"tls": {"ca": ca, "cert": tmp_path / "cb.pem"}}, tc.SceneError, "did you mean .*ca.pem"),
            ({"dashboard": ":1", "workers": 0}, tc.SceneError, "leave it out"),
            ({"dashboard": ":1", "scheduler": "tcp://x:1"}, tc.SceneError, "leave it out"),
            ({"dashboard": ":1"}, tc.BackendError, "pip install bokeh")):
        with pytest.raises(error, match=words):
            tc.sweep(odd, {"number": [1]}, **more)


def test_an_event_loop_that_begins_late_is_asked_for_twice(monkeypatch):
    from taichi_cloth.sweeps import engine

    tries = []

    def cluster(**options):
        tries.append(options)
        assert len(tries) > 1  # as of Dask's `LoopRunner`
        return "a cluster"

    distributed = pytest.importorskip("distributed")
    monkeypatch.setattr(distributed, "LocalCluster", cluster)
    where = engine.Where(workers=1)
    assert engine._here(where, None) == "a cluster" and len(tries) == 2 and tries[0] == tries[1]


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("openssl") is None, reason="needs openssl to make certificates")
def test_with_certificates_nothing_goes_unencrypted_and_there_are_no_pages(tmp_path):
    distributed = pytest.importorskip("distributed")
    files = {"ca": tmp_path / "cert.pem", "cert": tmp_path / "cert.pem", "key": tmp_path / "key.pem"}
    subprocess.run(["openssl", "req", "-x509", "-newkey", "rsa:2048", "-nodes", "-days", "2", "-subj", "/CN=sweep", "-keyout",
                    files["key"], "-out", files["cert"]], check=True, capture_output=True)
    seen: list[str] = []

    def look(text):
        client = distributed.default_client()
        about = client.scheduler_info(n_workers=-1)
        seen.append(client.scheduler.address)
        for server in (about, *about["workers"].values()):
            for page in ("status", "health", "info/main/workers.html", "metrics", "json/counts.json"):
                with pytest.raises(urllib.error.HTTPError, match="404"):
                    urllib.request.urlopen(f"http://127.0.0.1:{server['services']['dashboard']}/{page}", timeout=10)

    made = tc.sweep(odd, {"number": [1]}, workers=1, tls=files, say=look)
    assert [row["message"] for row in made.rows] == [NO_CLOTH]
    assert len(seen) == 1 and seen[0].startswith("tls://127.0.0.1:")
