"""Simulations recorded from Python: the same folder as the command's, and nothing on disk lost by what is wrong."""

import json

import numpy as np
import pytest

import taichi_cloth as tc
from taichi_cloth.output.recording import Recording as Folder
from taichi_cloth.recording import playback

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def sim():
    scene = tc.Scene()
    cloth = scene.add_cloth(tc.grid(0.5, 4), tc.Fabric(0.2, tc.Stretch(100), tc.Shear(10), tc.Bend(1e-5)), name="sheet")
    scene.pin(cloth, "top")
    return tc.Simulation(scene, h=1 / 60, integrator="backward_euler")


def test_a_recorded_simulation_is_what_it_was(sim, tmp_path, capsys):
    seen = []
    recording = tc.record(sim, tmp_path / "o", 0.2, 20, lambda sim, frame: seen.append((frame, sim.time, sim.positions())))
    assert [k for k, _, _ in seen] == [0, 1, 2, 3, 4] == recording.frames()
    for k, t, x in seen:
        frame = recording.frame(k)
        assert float(frame["t"]) == t and (frame["x"] == x.astype(np.float32)).all()
    m = recording.manifest
    assert (m["status"], m["fps"], m["frames"], m["model"]["vertices"]) == ("finished", 20, [0, 4], 25)
    assert len(recording.telemetry()) == len(sim.log) == m["summary"]["steps"] and "frame 4/4" in capsys.readouterr().err
    assert "python" in repr(recording) and recording.export("ply")[0].is_file()
    assert "sheet" in recording.export("usda", tmp_path / "x.usda")[0].read_text()
    assert "0 CG" not in recording.report().read_text()
    begun = sim.time
    again = tc.record(sim, tmp_path / "on", 0.1, 20)  # goes on from where it is
    assert [float(again.frame(k)["t"]) for k in again.frames()] == pytest.approx([begun, begun + 0.05, begun + 0.1])
    assert (again.frame(0)["x"] == recording.frame(4)["x"]).all()
    assert [again.time(k) for k in again.frames()] == pytest.approx([begun, begun + 0.05, begun + 0.1])
    assert playback.same_times(recording, again) == [(4, 0)] and playback.same_times(again, recording) == [(0, 4)]
    assert "agrees in all 1 frames" in playback.parting(recording, again, 1e-9)[0]
    assert again.last_checkpoint()[0] == 2, "the end of a run is kept, whatever comes between checkpoints"
    number, state = again.last_checkpoint(1)
    sim.resume(state)
    assert number == 0 and sim.time == begun and (sim.positions() == seen[-1][2]).all()


def test_what_is_wrong_costs_nothing_on_disk(sim, tmp_path):
    kept = tc.record(sim, tmp_path / "o", 0.05, 20)
    before = {f: f.read_bytes() for f in sorted(kept.path.rglob("*")) if f.is_file()}
    for options, words in (({"duration": 0}, "duration"), ({"duration": 1e9}, "duration"), ({"fps": -1}, "fps"),
                           ({"on_frame": 3}, "on_frame"), ({"checkpoint_every": -1}, "checkpoint_every"),
                           ({"overwrite": 2}, "overwrite"), ({"name": ""}, "name")):
        with pytest.raises(tc.SceneError, match=words):
            tc.record(sim, kept.path, **{"duration": 0.1, "overwrite": True, **options})
    with pytest.raises(tc.OutputError, match="another run's files.*or overwrite=True removes them"):
        tc.record(sim, kept.path, 0.1)
    with pytest.raises(tc.SceneError, match="sim"):
        tc.record(3, kept.path, 0.1, overwrite=True)
    assert before == {f: f.read_bytes() for f in sorted(kept.path.rglob("*")) if f.is_file()}
    assert tc.record(sim, kept.path, 0.1, 20, overwrite=True).frames() == [0, 1, 2]


def test_a_users_own_exception_leaves_whole_frames(sim, tmp_path):
    def fails(sim, frame):
        if frame == 2:
            raise ZeroDivisionError("mine")

    with pytest.raises(ZeroDivisionError, match="mine"):
        tc.record(sim, tmp_path / "o", 0.2, 20, fails)
    recording = Folder(tmp_path / "o")
    assert recording.frames() == [0, 1] and recording.manifest["status"] == "failed: ZeroDivisionError: mine"
    assert json.loads((tmp_path / "o" / "manifest.json").read_text())["frames"] == [0, 1]
    assert not list((tmp_path / "o").rglob("*.partial")) and len(recording.telemetry()) == len(sim.log)


def test_a_closed_simulation_is_not_recorded(tmp_path):
    scene = tc.Scene()
    scene.add_cloth(tc.grid(0.5, 4), tc.Fabric(0.2, tc.Stretch(100), tc.Shear(10), tc.Bend(1e-5)))
    with tc.Simulation(scene, h=1 / 60, integrator="backward_euler") as sim:
        pass
    with pytest.raises(tc.BackendError, match="closed"):
        tc.record(sim, tmp_path / "o", 0.1)
    assert not (tmp_path / "o").exists()
