"""A run's folder: what is damaged is said, and never used; one process at a time writes there."""

import json
import subprocess
import sys

import numpy as np
import pytest

from taichi_cloth.errors import OutputError
from taichi_cloth.io import npz
from taichi_cloth.output.folder import RunFolder, write_whole
from taichi_cloth.output.recording import Recording


def make(path, rng, frames=5, status="finished"):
    """A run of `frames` frames of two steps each, with a checkpoint at every other one."""
    folder = RunFolder(path)
    folder.write_geometry({"faces": np.arange(3)[None]})
    folder.write_telemetry([])
    for k in range(frames):
        folder.append_telemetry([{"t": k + s / 2, "energies": {"kinetic": float(rng.random())}} for s in (0, 1)])
        folder.write_frame(k, {"x": rng.normal(size=(3, 3))})
        if k % 2 == 0:
            folder.write_checkpoint(k, {"x": rng.normal(size=(3, 3)), "records": np.array(2 * k + 2)}, "this run")
    end = {"frames": [0, frames - 1], "summary": {"steps": 2 * frames}} if status == "finished" else {"frames": [0, None]}
    folder.write_manifest({"fps": 24.0, "status": status, **end})
    folder.close()
    return path


@pytest.fixture
def run(tmp_path, rng):
    return make(tmp_path / "run", rng)


def turn(path, at, bit=0) -> None:
    data = bytearray(path.read_bytes())
    data[at] ^= 1 << bit
    path.write_bytes(data)


def test_arrays_come_back_and_the_same_ones_make_the_same_bytes(tmp_path, rng):
    arrays = {"a": rng.normal(size=(4, 3)), "b": np.arange(5, dtype=np.int32), "c": np.array("text"), "d": np.zeros((0, 3)),
              "e": rng.normal(size=(3, 4)).T}
    (tmp_path / "a.npz").write_bytes(npz.pack(arrays))
    back = npz.unpack(tmp_path / "a.npz")
    assert list(back) == list(arrays)
    for k, array in arrays.items():
        assert (back[k] == array).all() and back[k].dtype == array.dtype and back[k].shape == array.shape
    assert npz.pack(arrays) == npz.pack(dict(arrays))
    with np.load(tmp_path / "a.npz") as file:  # numpy reads it too
        assert (file["e"] == arrays["e"]).all()


@pytest.mark.parametrize("change", [
    {"x": np.ones((3, 3))}, {"x": np.diag([0.0, 0, 1])}, {"x": np.zeros((3, 3), dtype=np.float32)}, {"x": np.zeros((9,))},
    {"y": np.zeros((3, 3))}, {"more": np.zeros(1)}, {"checksum": np.array("0")}, {"checksum": None}])
def test_content_that_is_not_what_was_written_is_told_by_its_checksum(tmp_path, change):
    """Zips with right sums of their own."""
    (tmp_path / "a.npz").write_bytes(npz.pack({"x": np.zeros((3, 3))}))
    with np.load(tmp_path / "a.npz") as file:
        arrays = {**file, **change}
    if "y" in change:
        del arrays["x"]
    np.savez(tmp_path / "a.npz", **{k: v for k, v in arrays.items() if v is not None})
    with pytest.raises(npz.DamagedError, match="checksum"):
        npz.unpack(tmp_path / "a.npz")


def test_every_byte_of_a_file_of_arrays_counts(tmp_path):
    path = tmp_path / "a.npz"
    data = npz.pack({"x": np.arange(4.0)})
    good = 0
    for at in range(0, len(data), 3):
        path.write_bytes(data)
        turn(path, at, at % 8)
        try:
            assert (npz.unpack(path)["x"] == np.arange(4.0)).all()  # what the zip says of dates and the like
            good += 1
        except npz.DamagedError:
            pass
    assert good < len(data) / 12


def test_a_whole_recording_reads(run):
    recording = Recording(run)
    assert recording.frames() == [0, 1, 2, 3, 4] and recording.frame(3)["x"].shape == (3, 3)
    assert [r["t"] for r in recording.telemetry()] == [k / 2 for k in range(10)]
    assert set(recording.telemetry()[0]) == {"t", "energies"}
    frame, state = recording.last_checkpoint()
    assert frame == 4 and int(state["records"]) == 10 and set(state) == {"x", "records"} and recording.notes == []
    assert "checksum" not in recording.manifest and recording.manifest["status"] == "finished"


@pytest.mark.parametrize("spoil", [b"\xff", b"\x00", b"9", b"}", b"\n"])
def test_telemetry_that_is_damaged_is_refused(run, spoil):
    file = run / "telemetry.jsonl"
    lines = file.read_bytes().splitlines(keepends=True)
    lines[3] = lines[3][:7] + spoil + lines[3][8:]
    file.write_bytes(b"".join(lines))
    recording = Recording(run)
    with pytest.raises(OutputError, match=r"telemetry.jsonl is damaged in line 4"):
        recording.telemetry()
    records, damage = recording.whole_telemetry()
    assert len(records) == 3 and "line 4" in damage


@pytest.mark.parametrize("change", ["gone from the middle", "twice", "swapped", "gone from the end"])
def test_lines_of_telemetry_follow_each_other(run, change):
    lines = (run / "telemetry.jsonl").read_bytes().splitlines(keepends=True)
    lines = {"gone from the middle": lines[:4] + lines[5:], "twice": lines[:5] + lines[4:],
             "swapped": [*lines[:4], lines[5], lines[4], *lines[6:]], "gone from the end": lines[:-1]}[change]
    (run / "telemetry.jsonl").write_bytes(b"".join(lines))
    with pytest.raises(OutputError, match="telemetry.jsonl is damaged"):
        Recording(run).telemetry()


def test_a_killed_runs_last_line_may_be_cut(tmp_path, rng):
    file = make(tmp_path / "killed", rng, status="running") / "telemetry.jsonl"
    file.write_bytes(file.read_bytes()[:-9])
    recording = Recording(tmp_path / "killed")
    assert len(recording.telemetry()) == 9 and "line 10 is not whole" in recording.notes[0]


@pytest.mark.parametrize("content", [b"", b"[]", b"{", b"\xff\xfe", b'{"status": "finished"}', b"null", b"[" * 100_000])
def test_a_manifest_that_is_none_is_refused(run, content):
    (run / "manifest.json").write_bytes(content)
    with pytest.raises(OutputError, match="manifest.json is damaged"):
        Recording(run)


def test_a_manifest_with_another_number_is_refused(run):
    text = (run / "manifest.json").read_text()
    (run / "manifest.json").write_text(text.replace("24.0", "25.0"))
    with pytest.raises(OutputError, match="its checksum is not that of its content"):
        Recording(run)
    assert json.loads(text)["fps"] == 24.0


def test_checkpoints_that_cannot_be_used_are_passed_over(run):
    path = run / "checkpoints" / "00004.npz"
    good = path.read_bytes()
    recording = Recording(run)
    assert recording.last_checkpoint(3)[0] == 2 and "nearest before it is frame 2" in recording.notes[0]
    assert recording.last_checkpoint(run="this run")[0] == 4
    assert recording.last_checkpoint(records=9)[0] == 2 and recording.last_checkpoint(records=10)[0] == 4
    with pytest.raises(OutputError, match="no whole checkpoint.*of another run"):
        recording.last_checkpoint(run="another run")
    turn(path, len(good) // 2)
    assert Recording(run).last_checkpoint()[0] == 2
    path.write_bytes((run / "checkpoints" / "00002.npz").read_bytes())
    recording = Recording(run)
    assert recording.last_checkpoint()[0] == 2 and "00004.npz is damaged: it is checkpoints/00002.npz" in recording.notes[0]
    with np.load(run / "checkpoints" / "00002.npz") as file:
        old = {k: v for k, v in file.items() if k != "checksum"}
    old |= {"name": np.array("checkpoints/00004.npz"), "format": np.array(1)}
    path.write_bytes(npz.pack(old))
    recording = Recording(run)
    assert recording.last_checkpoint()[0] == 2 and "of another version" in recording.notes[0]


def test_going_on_removes_what_comes_after(run):
    (run / "frames" / "mine.npz").write_bytes(b"mine")
    (run / "images").mkdir()
    (run / "images" / "00004.png").write_bytes(b"later")
    RunFolder(run, resumed=2).close()
    assert sorted(p.name for p in (run / "frames").iterdir()) == ["00000.npz", "00001.npz", "00002.npz", "mine.npz"]
    assert sorted(p.name for p in (run / "checkpoints").iterdir()) == ["00000.npz", "00002.npz"]
    assert not list((run / "images").iterdir()) and (run / "telemetry.jsonl").exists()


def test_a_folder_is_written_by_one_at_a_time(run):
    first = RunFolder(run, resumed=4)
    for options in ({"resumed": 4}, {"overwrite": True}):
        with pytest.raises(OutputError, match="being written by another run"):
            RunFolder(run, **options)
    assert len(list((run / "frames").iterdir())) == 5  # nothing was removed
    first.close()
    assert not (run / "run.lock").exists()
    RunFolder(run, resumed=4).close()


def test_the_lock_of_a_killed_process_is_no_lock(run):
    script = ("import os, signal, sys\n"
              "from taichi_cloth.output.lock import Lock\n"
              "import pathlib\n"
              "held = Lock(pathlib.Path(sys.argv[1]))\n"
              "print('held', flush=True)\n"
              "sys.stdin.read()\n")
    with subprocess.Popen([sys.executable, "-c", script, str(run)], stdin=subprocess.PIPE, stdout=subprocess.PIPE) as other:
        assert other.stdout.readline() == b"held\n"
        with pytest.raises(OutputError, match="being written by another run"):
            RunFolder(run, resumed=4)
        other.kill()
        other.wait()
    assert (run / "run.lock").exists()
    RunFolder(run, resumed=4).close()


@pytest.mark.parametrize("name", ["frames", "images", "checkpoints", "."])
def test_a_folder_that_vanishes_is_not_made_again(tmp_path, name):
    import shutil

    folder = RunFolder(tmp_path / "run")

    def write(k):
        folder.write_frame(k, {"x": np.zeros(3)})
        folder.write_image(k, b"x")
        folder.write_checkpoint(k, {"x": np.zeros(3)}, "")

    write(0)
    assert folder.missing_frames(0, 1) == [1]
    shutil.rmtree(tmp_path / "run" / name)
    with pytest.raises(OutputError, match="was removed while the run went on"):
        write(1)


def test_files_are_whole_or_not_there(tmp_path):
    write_whole(tmp_path / "deep" / "a", b"first")
    (tmp_path / "deep" / "a.partial").mkdir()  # what cannot be written to
    with pytest.raises(OutputError, match="cannot write"):
        write_whole(tmp_path / "deep" / "a", b"second")
    assert (tmp_path / "deep" / "a").read_bytes() == b"first"


def test_a_file_in_anothers_place_is_told_by_its_name(run):
    for a, b in (("frames/00002.npz", "checkpoints/00002.npz"), ("geometry.npz", "frames/00003.npz")):
        mine, its = (run / a).read_bytes(), (run / b).read_bytes()
        (run / a).write_bytes(its)
        (run / b).write_bytes(mine)
    recording = Recording(run)
    for number in (2, 3):
        with pytest.raises(OutputError, match=f"0000{number}.npz is damaged: it is (geometry|checkpoints/00002).npz"):
            recording.frame(number)
    with pytest.raises(OutputError, match="geometry.npz is damaged: it is frames/00003.npz"):
        _ = recording.geometry
