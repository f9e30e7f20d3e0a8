"""Takes: runs that go on from a frame in another folder, bit for bit, or with options that are blended in."""

import json
import os
import pathlib
import shlex
import shutil
import signal
import subprocess
import sys

import numpy as np
import pytest

import taichi_cloth as tc
from taichi_cloth.app import cli, scenefile
from taichi_cloth.app.takes import Take
from taichi_cloth.output.recording import Recording
from taichi_cloth.scene.winds import velocity

SCENE = '''"""A sheet on two corners in a wind."""
import taichi_cloth as tc

ACT = {}

def build(stretch: float = 10.0, wind: float = 1.0, cells: int = 2, push: float = 0.0):
    scene = tc.Scene(air=tc.Air(0.5, wind=(wind, 0.0, 0.0)))
    cloth = scene.add_cloth(tc.grid(1.0, cells), tc.Fabric(0.2, tc.Stretch(stretch)))
    scene.pin(cloth, ["top_left", "top_right"])
    scene.add_load(cloth, "bottom_left", (0.0, 0.0, push))
    scene.at(0.28, lambda s: ACT.get("act", lambda: None)())
    return scene
'''
RUN = ["--fps", "20", "--duration", "0.4", "--no-images", "--integrator", "verlet", "--threads", "1",
       "--checkpoint-every", "3"]


def call(*words: object) -> int:
    return cli.main([str(word) for word in words])


@pytest.fixture(scope="module")
def first(tmp_path_factory):
    """A run of eight frames, with checkpoints at 0, 3, 6 and 8."""
    folder = tmp_path_factory.mktemp("takes")
    (folder / "sheet.py").write_text(SCENE)
    assert call("run", folder / "sheet.py", "--out", folder / "first", *RUN) == 0
    return folder / "first"


def content(folder: pathlib.Path) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


def arrays(folder: pathlib.Path, frame: int) -> dict[str, np.ndarray]:
    return Recording(folder).frame(frame)


def same_frames(a: pathlib.Path, b: pathlib.Path, count: int = 9) -> None:
    for k in range(count):
        assert (a / "frames" / f"{k:05d}.npz").read_bytes() == (b / "frames" / f"{k:05d}.npz").read_bytes(), k


def steps(folder: pathlib.Path) -> list[dict]:
    return [{k: v for k, v in r.items() if k != "seconds"} for r in Recording(folder).telemetry()]


@pytest.mark.parametrize("frame", [6, 5])  # at a checkpoint, and after one
def test_without_changes_it_goes_on_bit_for_bit(first, frame, capsys):
    before, name = content(first), f"same_{frame}"
    assert call("take", first, name, "--from-frame", frame) == 0
    out, take = first.parent / name, json.loads((first.parent / name / "manifest.json").read_text())
    same_frames(first, out)
    assert steps(first) == steps(out) and content(first) == before
    assert take["take"]["parent"] == os.path.join("..", "first") and take["take"]["frame"] == frame
    assert take["take"]["started"] == json.loads((first / "manifest.json").read_text())["started"]
    decisive = ("scene", "source", "settings", "fps", "simulation", "runtime", "duration")
    assert all(take[key] == json.loads((first / "manifest.json").read_text())[key] for key in decisive)
    linked = os.stat(first / "frames" / "00002.npz").st_ino == os.stat(out / "frames" / "00002.npz").st_ino
    assert take["take"]["files"] == ("linked" if linked else "copied") and take["take"]["files"] in capsys.readouterr().out


def test_copies_where_there_are_no_links(first, monkeypatch):
    def refuse(*_):
        raise OSError("no links here")

    monkeypatch.setattr(os, "link", refuse)
    assert call("take", first, "copied", "--from-frame", 6) == 0
    same_frames(first, first.parent / "copied")
    assert json.loads((first.parent / "copied" / "manifest.json").read_text())["take"]["files"] == "copied"


def test_a_folder_that_holds_another_run_is_refused_and_a_full_disk_is_named(first, monkeypatch, capsys):
    assert call("take", first, "twice", "--from-frame", 6) == 0
    assert "going on from frame 6, t = " in capsys.readouterr().err
    assert call("take", first, "twice", "--from-frame", 6) == 2
    said = capsys.readouterr().err
    assert "holds another run's files" in said and "--resume" in said and "--overwrite" in said and "going on" not in said
    assert call("take", first, "twice", "--from-frame", 3, "--overwrite") == 0
    same_frames(first, first.parent / "twice")
    assert Recording(first.parent / "twice").manifest["take"]["frame"] == 3

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "link", full)
    monkeypatch.setattr(shutil, "copyfile", full)
    assert call("take", first, "full", "--from-frame", 6) == 2
    assert "No space left on device" in capsys.readouterr().err and not (first.parent / "full" / "run.lock").exists()


@pytest.mark.parametrize("words", [("take", "first", "taken", "--from-frame", "6"),
                                   ("run", "sheet.py", "--out", "taken", *RUN)])
def test_a_folder_that_is_taken_is_refused_before_taichi_is_imported(first, words):
    """In a process of its own, which tells whether it was."""
    (first.parent / "taken").mkdir(exist_ok=True)
    (first.parent / "taken" / "manifest.json").write_text("{}")
    code = ("import sys; from taichi_cloth.app.cli import main; code = main(sys.argv[1:]); "
            "print([name for name in ('taichi', 'quadrants') if name in sys.modules]); sys.exit(code)")
    done = subprocess.run([sys.executable, "-c", code, *words], cwd=first.parent, capture_output=True, text=True,
                          env=os.environ | {"PYTHONPATH": str(pathlib.Path(__file__).parents[2])}, check=False)
    assert done.returncode == 2 and "taken holds another run's files" in done.stderr and "--overwrite removes" in done.stderr
    assert done.stdout.strip() == "[]"


def by_hand(first: pathlib.Path, blend: int) -> list[np.ndarray]:
    """Positions at frames 7 and 8 of a take from frame 6, stretch 10 to 40 N/m, wind 1 to 3 m/s, push 0 to .5 N."""
    build, state, out = scenefile.read(str(first.parent / "sheet.py")).build, Recording(first).last_checkpoint(6)[1], []
    for k in (7, 8):
        share = min((k - 6) / blend, 1.0)
        with tc.Simulation(build(10 + 30 * share, 1 + 2 * share, push=share / 2), integrator="verlet", threads=1) as sim:
            sim.resume(dict(state), edited=True)
            sim.run(k / 20, 20, resumed=k - 1)
            state = sim.checkpoint()
            out.append(sim.positions().astype(np.float32))
    return out


@pytest.mark.parametrize("blend, frames", [(0, 1), (2, 2), (4, 4)])
def test_options_are_blended_in_frame_by_frame(first, blend, frames):
    name = f"blended_{blend}"
    new = [word for option in ("stretch=40", "wind=3", "push=1/2") for word in ("--set", option)]
    assert call("take", first, name, "--from-frame", 6, "--blend", blend, *new) == 0
    out = first.parent / name
    same_frames(first, out, 7)
    for k, x in zip((7, 8), by_hand(first, frames)):
        assert np.array_equal(arrays(out, k)["x"], x), k
        assert not np.array_equal(arrays(first, k)["x"], x)
    assert Recording(out).kept == (0, 8) and len(list((out / "frames").iterdir())) == 9
    assert Recording(out).manifest["settings"] == {"stretch": 40.0, "wind": 3.0, "cells": 2, "push": 0.5}


@pytest.mark.usefixtures("asked_to_end")
def test_a_take_that_was_interrupted_in_its_blend_is_resumed_bit_for_bit(first, monkeypatch):
    """Two frames of a blend are made, and the rest of it by `run --resume`."""
    words = ["--from-frame", "3", "--blend", "4", "--set", "stretch=40", "--duration", "0.5", "--checkpoint-every", "1"]
    assert call("take", first, "straight", *words) == 0
    read = scenefile.read

    def reading(path):
        file = read(path)
        file.build.__globals__["ACT"]["act"] = lambda: os.kill(os.getpid(), signal.SIGINT)
        return file

    with monkeypatch.context() as patch:
        patch.setattr(scenefile, "read", reading)
        assert call("take", first, "stopped", *words) == 130
    out = first.parent / "stopped"
    assert Recording(out).manifest["frames"] == [0, 6]
    flags = [word if word != "0.4" else "0.5" for word in RUN]
    assert call("run", first.parent / "sheet.py", "--out", out, *flags, "--set", "stretch=40", "--resume") == 0
    same_frames(first.parent / "straight", out, 11)
    assert steps(first.parent / "straight") == steps(out)
    assert Recording(out).manifest["take"] == Recording(first.parent / "straight").manifest["take"]


def test_fabric_and_wind_in_words_go_for_every_scene(first):
    file, take = scenefile.read(str(first.parent / "sheet.py")), Take("first", "", 6, 4, {"stretch": 20.0})
    for frame, share in ((5, 0), (6, 0.25), (8, 0.75), (9, 1), (30, 1)):
        fabric = take.scene(file, {"fabric": "denim", "wind": "3"}, frame).cloths[0].fabric
        assert fabric.density == pytest.approx(0.2 + share * 0.124)
        assert np.array(fabric.stretch.k) == pytest.approx(20 + share * (np.array([411, 2028]) - 20 if share else 0))
    scene = scenefile.read("hang").make({"cells": "2", "fabric": "denim", "wind": "breeze -z"})
    assert scene.cloths[0].fabric is tc.fabrics["denim"]
    assert scene.air.wind_at(0.0).tolist() == [0, 0, -3] and scene.air.normal == 0.3  # the scene's own
    still = scenefile.SceneFile("still", "still.py", "", tc.Scene, None).make({"wind": "gale"})
    assert still.air.wind_at(0.0).tolist() == [19, 0, 0] and still.air.drag > still.air.lift > 0


@pytest.mark.parametrize("words, said", [
    (("first", "new", "--from-frame", "9"), "frame 9 is not there; there are 0 to 8"),
    (("first", "new", "--from-frame", "-1"), "--from-frame = -1: must be a whole number of at least 0"),
    (("first", "new", "--from-frame", "8"), "the take would end at frame 8 already: --duration S makes it longer"),
    (("first", "new", "--from-frame", "3", "--set", "strech=3"), "did you mean 'stretch'"),
    (("first", "new", "--from-frame", "3", "--set", "stretch"), "needs name=value"),
    (("first", "new", "--from-frame", "3", "--set", "fabric=denin"), "unknown fabric 'denin'; did you mean 'denim'"),
    (("first", "new", "--from-frame", "3", "--set", "stretch=3", "--set", "cells=3"),
     "'cloth0' has 9 vertices up to frame 3 and 16 with cells=3: a run goes on with the mesh that it has"),
    (("first", "new", "--from-frame", "4", "--set", "cells=3"), "'cloth0' has 9 vertices up to frame 4 and 16 with cells=3"),
    (("first", "new", "--from-frame", "3", "--blend", "-2"), "--blend = -2: must be a whole number"),
    (("first", "new", "--from-frame", "3", "--scene", "gone.py"), "no scene file 'gone.py'"),
    (("first", "first", "--from-frame", "3"), "is the run's own folder"),
    (("gone", "new", "--from-frame", "3"), "gone is not a run's folder"),
])
def test_what_cannot_be_taken_is_named_and_nothing_is_written(first, words, said, capsys):
    before = content(first)
    assert call("take", first.parent / words[0], *words[1:]) == 2
    errors = capsys.readouterr().err.splitlines()
    assert said in errors[-1] and errors[-1].startswith("error: ")
    assert not (first.parent / "new").exists() and content(first) == before


@pytest.mark.parametrize("page", ["README.md", "docs/tutorials/resume.md"])
def test_the_wind_of_the_pages_blows_onto_the_sheet(page):
    """The sheet of `hang` hangs from two pins, and a wind from one to the other would blow along it."""
    text = (pathlib.Path(__file__).parents[2] / page).read_text()
    words = [shlex.split(line, comments=True) for line in text.splitlines() if line.startswith("taichi-cloth take ")]
    winds = [word.removeprefix("wind=") for line in words for word in line if word.startswith("wind=")]
    mesh = scenefile.read("hang").make({"cells": 4}).cloths[0].mesh
    between = np.subtract(*(mesh.x[mesh.select(name)][0] for name in ("top_left", "top_right")))
    for wind in winds:
        v = velocity("wind", wind)
        assert abs(v @ between) < 0.1 * np.linalg.norm(v) * np.linalg.norm(between) and abs(v[1]) < 0.1 * np.linalg.norm(v)
    assert winds


def test_a_take_is_taken_from_where_its_options_are_all_new(first, capsys):
    assert call("take", first, "one", "--from-frame", 3, "--blend", 2, "--set", "stretch=40", "--checkpoint-every", 2) == 0
    assert call("take", first.parent / "one", "two", "--from-frame", 4) == 2
    said = capsys.readouterr().err
    assert "new options from frame 5 on, and frame 4 has no checkpoint since: take it from frame 6 on" in said
    assert call("take", first.parent / "one", "two", "--from-frame", 7) == 0
    same_frames(first.parent / "one", first.parent / "two")


def test_a_run_of_python_names_no_scene(first, tmp_path, capsys):
    with tc.Simulation(scenefile.read(str(first.parent / "sheet.py")).build(), integrator="verlet", threads=1) as sim:
        tc.record(sim, tmp_path / "python", 0.1, 20)
    assert call("take", tmp_path / "python", "new", "--from-frame", 1) == 2
    assert "was recorded from Python" in capsys.readouterr().err


def test_a_blend_builds_the_scenes_at_its_ends_once(first, monkeypatch):
    """A scene may load a character, which takes seconds: eight frames of a blend built it 24 times."""
    made, make = [], scenefile.SceneFile.make
    monkeypatch.setattr(scenefile.SceneFile, "make", lambda self, settings: made.append(settings) or make(self, settings))
    words = ["--from-frame", 0, "--blend", 8, "--set", "stretch=40", "--duration", 0.5]
    assert call("take", first, "built", *words) == 0
    assert len(made) <= 2 + 3 + 9, "to compare meshes, to begin, then one a frame and the two ends"
