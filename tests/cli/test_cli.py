"""The command line, as a user calls it: exit codes, files, messages."""

import json
import os
import pathlib
import signal
import struct
import subprocess
import sys
import time
import zlib

import numpy as np
import pytest
from inside import ROOT
from inside import call as call_here
from inside import call_script as call_script_here

QUICK = ["--set", "cells=8", "--duration", "0.1", "--fps", "20", "--size", "64x48"]


def call(*args, cwd=None, **kwargs):
    return call_script("-m", "taichi_cloth", *args, cwd=cwd, **kwargs)


def call_script(*args, cwd=None, **kwargs):
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    return subprocess.run([sys.executable, *map(str, args)], capture_output=True, text=True, cwd=cwd or ROOT,
                          env=environment, timeout=300, **kwargs)


def read_png(path: pathlib.Path) -> np.ndarray:
    data = path.read_bytes()
    assert data[:8] == b"\x89PNG\r\n\x1a\n"
    width, height = struct.unpack(">II", data[16:24])
    start, packed = 8, b""
    while start < len(data):
        length, kind = struct.unpack(">I4s", data[start:start + 8])
        body = data[start + 8:start + 8 + length]
        assert struct.unpack(">I", data[start + 8 + length:start + 12 + length])[0] == zlib.crc32(kind + body)
        packed += body if kind == b"IDAT" else b""
        start += 12 + length
    rows = np.frombuffer(zlib.decompress(packed), dtype=np.uint8).reshape(height, 1 + 3 * width)
    assert (rows[:, 0] == 1).all()
    return np.cumsum(rows[:, 1:].reshape(height, width, 3), axis=1, dtype=np.uint8)


@pytest.mark.parametrize("what, unbuffered", [("fabrics", ""), ("fabrics", "1"), ("--help", "")])
def test_a_pipe_that_nobody_reads_ends_quietly(what, unbuffered):
    with subprocess.Popen([sys.executable, "-m", "taichi_cloth", what], stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                          cwd=ROOT, text=True, env={**os.environ, "PYTHONUNBUFFERED": unbuffered}) as process:
        process.stdout.close()
        assert (process.stderr.read(), process.wait(300)) == ("", 141)


@pytest.fixture(scope="module")
def out(tmp_path_factory):
    folder = tmp_path_factory.mktemp("run") / "hang"
    done = call("run", "scenes/hang.py", "--out", folder, "--precision", "f32", "--h", "1/60", *QUICK)
    assert done.returncode == 0, done.stderr
    return folder, done


@pytest.mark.slow
def test_run_writes_what_it_says(out):
    folder, done = out
    assert sorted(p.name for p in folder.iterdir()) == ["checkpoints", "frames", "geometry.npz", "images", "manifest.json",
                                                        "telemetry.jsonl"]
    assert [p.name for p in sorted((folder / "images").iterdir())] == ["00000.png", "00001.png", "00002.png"]
    manifest = json.loads((folder / "manifest.json").read_text())
    assert manifest["status"] == "finished" and manifest["settings"]["cells"] == 8
    assert manifest["runtime"]["arch"] == "cpu" and manifest["runtime"]["precision"] == "f32"
    assert manifest["model"] == {"vertices": 81, "triangles": 128, "solids": 0, "notes": []}
    records = [json.loads(line) for line in (folder / "telemetry.jsonl").read_text().splitlines()]
    assert [r["t"] for r in records] == pytest.approx([0.1 * k / 6 for k in range(1, 7)])
    assert all(r["status"] == "CONVERGED" and r["iterations"] > 0 and r["residual"] < 1 for r in records)
    assert set(records[0]["seconds"]) == {"EVAL", "CG", "C-C", "C-S", "total", "compiling"}
    assert "0.1 s simulated" in done.stdout and "frame 2/2" in done.stderr


@pytest.mark.slow
def test_pictures_show_cloth_on_a_ground(out):
    images = [read_png(p) for p in sorted((out[0] / "images").iterdir())]
    first, last = images[0].astype(int), images[-1].astype(int)
    assert first.shape == (48, 64, 3)
    red = (first[..., 0] > first[..., 1] + 40) & (first[..., 0] > first[..., 2] + 40)
    assert 0.01 < red.mean() < 0.6
    assert first[0].mean() > 180  # sky
    assert np.abs(first - last).max() > 40  # it moved


@pytest.mark.slow
def test_another_runs_files_are_safe(out, tmp_path):
    folder, _ = out
    (folder / "mine.txt").write_text("keep")
    before = (folder / "manifest.json").read_bytes()
    refused = call("run", "hang", "--out", folder, *QUICK)
    assert refused.returncode == 2 and "--overwrite removes them" in refused.stderr
    assert (folder / "manifest.json").read_bytes() == before
    wrong = call_here("run", "hang", "--out", folder, "--overwrite", "--K", "papre", *QUICK)
    assert wrong.returncode == 2 and (folder / "manifest.json").read_bytes() == before
    assert len(list((folder / "images").iterdir())) == 3  # a request that is wrong costs nothing on disk
    done = call_here("run", "hang", "--out", folder, "--overwrite", "--no-images", *QUICK)
    assert done.returncode == 0, done.stderr
    assert (folder / "mine.txt").read_text() == "keep" and not list((folder / "images").iterdir())


@pytest.mark.parametrize("args, words", [
    (("run", "hnag"), "did you mean 'hang'"), (("rnu", "hang"), "did you mean 'run'"),
    (("run", str(pathlib.Path(__file__).with_name("test_cil.py"))), "test_cli.py'"),
    (("run", "hang", "--duratoin", "3"), "--duratoin: did you mean --duration"),
    (("report", "out", "--small"), "--small: report has no such flag; run, check, study, verify, view, sweep have it"),
    (("study", "swing", "--threads", "1"), "--threads: study has no such flag; run, check, view, sweep have it"),
    (("render", "out", "--duration", "1", "--evrey=2"), "--evrey: did you mean --every"),
    (("run", "hang", "--check"), "unrecognized arguments: --check"),  # no --checkpoint-every cut short
    (("run", "hang", "--set", "m=3"), "no option 'm'"),
    (("run", "hang", "--set", "cells=many"), "needs a whole number"),
    (("run", "hang", "--set", "cells"), "needs name=value"),
    (("run", "hang", "--h", "0"), "--h = 0.0: must be a positive number"),
    (("run", "hang", "--h", "a/b"), "not a number"),
    (("run", "hang", "--size", "10"), "needs WIDTHxHEIGHT"),
    (("run", "hang", "--arch", "gpu"), "unknown arch 'gpu'"),
    (("run", "hang", "--arch", "metal", "--precision", "f32"), "'metal' does not run here; what does: cpu"),
    (("run", "hang", "--K", "papre"), "did you mean 'paper'"),
    (("run", "hang_mesh", "--set", "mesh=none.obj"), "no such mesh file: none.obj"),
    (("run", "hang", "--out", "README.md"), "is a file, not a folder"),
    (("fly",), "invalid choice"),
])
def test_bad_usage_ends_with_2_and_names_the_culprit(args, words):
    done = call_here(*args, *([] if "--size" in args or args[0] != "run" else ["--no-images"]))
    assert done.returncode == 2
    assert words in done.stderr and "Traceback" not in done.stderr


@pytest.mark.slow
def test_giving_up_ends_with_3_and_keeps_the_frames(tmp_path):
    scene = tmp_path / "wild.py"
    scene.write_text('''"""Pulled apart."""
import taichi_cloth as tc

def build():
    scene = tc.Scene()
    cloth = scene.add_cloth(tc.grid(1.0, 4), tc.Fabric(0.2, tc.Stretch(100)))
    scene.pin(cloth, "left")
    scene.move(cloth, "right", lambda t: (0 if t < 0.06 else 1e9 * t, 0, 0), relative=True)
    return scene

def check(sim):
    yield "it is not there", False
''')
    done = call_here("run", scene, "--out", tmp_path / "o", "--duration", 1, "--fps", 20, "--size", "64x48")
    assert done.returncode == 3 and "gave up at t = 0.05" in done.stderr
    assert [p.name for p in sorted((tmp_path / "o" / "images").iterdir())] == ["00000.png", "00001.png"]
    manifest = json.loads((tmp_path / "o" / "manifest.json").read_text())
    assert manifest["status"].startswith("gave up") and manifest["simulated_s"] == pytest.approx(0.06, abs=0.011)
    assert call_here("check", scene, "--duration", "0.05", "--fps", "20").returncode == 1


@pytest.mark.slow
@pytest.mark.usefixtures("asked_to_end")
def test_interrupt_leaves_whole_frames(tmp_path):
    """Of a run that was started as nohup does: it goes on when its terminal is closed, and ends when it is interrupted."""
    environment, pictures = {**os.environ, "PYTHONPATH": str(ROOT)}, tmp_path / "o" / "images"
    command = [sys.executable, "-m", "taichi_cloth", "run", "hang", "--out", str(tmp_path / "o"), "--duration", "60",
               "--size", "320x200", "--set", "cells=20"]
    process = subprocess.Popen(command, env=environment, cwd=ROOT, stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
                               preexec_fn=lambda: signal.signal(signal.SIGHUP, signal.SIG_IGN))

    def wait_for(count):
        deadline = time.time() + 60
        while len(list(pictures.glob("*.png"))) < count and process.poll() is None and time.time() < deadline:
            time.sleep(0.1)

    try:
        wait_for(1)
        process.send_signal(signal.SIGHUP)
        wait_for(len(list(pictures.glob("*.png"))) + 2)
        assert process.poll() is None, "it ended with its terminal"
        process.send_signal(signal.SIGINT)
        _, errors = process.communicate(timeout=60)
    finally:
        process.kill()
    assert process.returncode == 130 and "interrupted" in errors
    images = sorted(pictures.iterdir())
    assert len(images) >= 3 and all(read_png(p).shape == (200, 320, 3) for p in images)
    assert json.loads((tmp_path / "o" / "manifest.json").read_text())["status"] == "interrupted"


@pytest.mark.slow
def test_check_list_doctor_and_help():
    done = call_here("check", "swing", "--small")
    assert done.returncode == 0 and done.stdout.count("ok ") == 3
    listed = call_here("list").stdout.splitlines()
    assert len(listed) >= 7 and any(line.startswith("hang ") and "fig. 2" in line for line in listed)
    doctor = call_here("doctor")
    assert doctor.returncode == 0 and "cpu      runs" in doctor.stdout
    modules = subprocess.run([sys.executable, "-X", "importtime", "-m", "taichi_cloth", "--help"], capture_output=True,
                             text=True, cwd=ROOT, check=True).stderr
    assert "taichi_cloth.app.cli" in modules and "taichi.lang" not in modules and "numpy" not in modules


@pytest.mark.slow
def test_scene_file_takes_the_same_flags():
    done = call_script_here(ROOT / "scenes" / "hang.py", "--no-images", "--set", "cells=6", "--duration", "0.1")
    assert done.returncode == 0 and "0.1 s simulated" in done.stdout, done.stderr
