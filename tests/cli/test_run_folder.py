"""What a run leaves behind when something goes wrong in its middle: events of the scene do it, in this process."""

import copy
import json
import os
import shutil
import signal

import numpy as np
import pytest
from test_cli import call

import taichi_cloth as tc
from taichi_cloth.app import cli, scenefile
from taichi_cloth.app.scenefile import SceneFile, run_check
from taichi_cloth.errors import ScriptError
from taichi_cloth.io import npz
from taichi_cloth.output.folder import RunFolder
from taichi_cloth.output.recording import Recording
from taichi_cloth.recording.resuming import run_of

SCENE = '''"""A sheet that falls, and what `act` does after 0.13 s."""
import taichi_cloth as tc

ACT = {}

def build():
    scene = tc.Scene()
    scene.add_cloth(tc.grid(1.0, 2), tc.Fabric(0.2, tc.Stretch(10.0)))
    scene.at(0.13, lambda s: ACT["act"]())
    return scene
'''
FLAGS = ["--fps", "20", "--duration", "0.4", "--no-images", "--integrator", "verlet", "--threads", "1",
         "--checkpoint-every", "2"]


class Falling:
    """Runs of that scene in a folder `out`, in this process."""

    def __init__(self, folder):
        (folder / "falling.py").write_text(SCENE)
        self.file, self.out = scenefile.read(str(folder / "falling.py")), folder / "out"

    def __call__(self, act=lambda: None, *flags):
        """Exit code of a run with an act and more flags."""
        self.file.build.__globals__["ACT"]["act"] = act
        args = cli._parser().parse_args(["run", self.file.path, "--out", str(self.out), *FLAGS, *flags])
        return cli._guard(lambda: cli._run(args, self.file))


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """A whole run, in whose middle came SIGHUP and SIGINT, which are ignored as nohup and a shell's background want it, and
    another run wanted its folder."""
    made, codes = Falling(tmp_path_factory.mktemp("finished")), []

    def act():
        for number in ignored:
            os.kill(os.getpid(), number)
        codes.append(cli._guard(lambda: RunFolder(made.out, resumed=0).close() or 0))

    ignored = {number: signal.signal(number, signal.SIG_IGN) for number in (signal.SIGHUP, signal.SIGINT)}
    try:
        assert made(act) == 0
    finally:
        for number, old in ignored.items():
            signal.signal(number, old)
    assert codes == [2] and names(made.out, "frames") == list(range(9))
    assert manifest(made.out)["status"] == "finished"
    return made


@pytest.fixture
def scene(tmp_path):
    """Nothing was run yet."""
    return Falling(tmp_path)


@pytest.fixture
def again(finished, tmp_path):
    """A copy of the whole run."""
    made = copy.copy(finished)
    made.out = shutil.copytree(finished.out, tmp_path / "copy")
    return made


def manifest(folder):
    return json.loads((folder / "manifest.json").read_text())


def names(folder, kind):
    return sorted(int(p.stem) for p in (folder / kind).iterdir())


@pytest.mark.usefixtures("asked_to_end")
@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM", "SIGHUP"])
def test_signals_end_a_run_after_its_frame_and_it_goes_on_bitwise(scene, finished, name, capsys):
    before = {n: signal.getsignal(getattr(signal, n)) for n in ("SIGINT", "SIGTERM", "SIGHUP")}
    code = scene(lambda: os.kill(os.getpid(), getattr(signal, name)))
    assert code == 130 and "interrupted: ends after this frame" in capsys.readouterr().err
    assert manifest(scene.out)["status"] == "interrupted" and manifest(scene.out)["frames"] == [0, 3]
    assert names(scene.out, "frames") == [0, 1, 2, 3] and not (scene.out / "run.lock").exists()
    assert {n: signal.getsignal(getattr(signal, n)) for n in before} == before
    if name != "SIGTERM":
        return
    assert scene(lambda: None, "--resume", "--force") == 0  # the scene's path is another
    for k in range(9):
        assert (scene.out / "frames" / f"{k:05d}.npz").read_bytes() == (finished.out / "frames" / f"{k:05d}.npz").read_bytes()
    logs = [[{k: v for k, v in r.items() if k != "seconds"} for r in Recording(f).telemetry()]
            for f in (scene.out, finished.out)]
    assert logs[0] == logs[1]
    assert manifest(scene.out)["status"] == "finished" and manifest(scene.out)["frames"] == [0, 8]


def test_an_exception_of_the_scenes_own_has_its_exit_code(scene, capsys):
    def act():
        return {}["forgotten"]

    assert scene(act) == 4
    said = capsys.readouterr().err
    assert "KeyError: 'forgotten'" in said and "falling.py, line 9" in said and "Traceback" in said
    assert "stepper.py" not in said and "running.py" not in said  # of the way there only his own lines
    assert manifest(scene.out)["status"].startswith("failed: KeyError: 'forgotten'") and not (scene.out / "run.lock").exists()
    assert names(scene.out, "frames") == [0, 1, 2]
    assert len(Recording(scene.out).telemetry()) == manifest(scene.out)["summary"]["steps"] > 0


def test_a_checks_own_exception_is_no_failed_check():
    def check(sim):
        yield "good", True
        raise ZeroDivisionError("by hand")

    made = SceneFile("x", "x.py", "", lambda: None, check)
    with pytest.raises(ScriptError, match="check: ZeroDivisionError: by hand"):
        list(run_check(made, None))
    assert ScriptError.exit_code == 4


def test_frames_removed_while_the_run_goes_on_are_missed(scene, capsys):
    assert scene(lambda: shutil.rmtree(scene.out / "frames")) == 2
    assert "frames was removed while the run went on" in capsys.readouterr().err
    assert manifest(scene.out)["status"].startswith("failed")


def test_one_frame_removed_while_the_run_goes_on_is_missed(scene, capsys):
    assert scene(lambda: (scene.out / "frames" / "00001.npz").unlink()) == 2
    assert "1 frames were removed while the run went on, the first is 1" in capsys.readouterr().err


def test_going_on_needs_what_was_kept_to_be_whole(again, capsys):
    (again.out / "frames" / "00003.npz").unlink()
    assert again(lambda: None, "--resume") == 2
    assert "00003.npz is missing: --from-frame 2 simulates it again" in capsys.readouterr().err
    assert names(again.out, "frames") == [0, 1, 2, 4, 5, 6, 7, 8]
    assert again(lambda: None, "--from-frame", "2") == 0 and Recording(again.out).frames() == list(range(9))


def test_a_run_goes_on_with_its_own_checkpoints_only(again, finished, capsys):
    """The last one is of a run with other settings, put in its place."""
    path = again.out / "checkpoints" / "00008.npz"
    path.write_bytes(npz.pack(npz.unpack(path) | {"run": np.array("another")}))
    assert again(lambda: None, "--resume") == 0
    written, said = capsys.readouterr()
    assert "00008.npz is of another run" in said and "going on from frame 6" in said
    assert "cost: 0.1 s simulated in" in written and "from t = 0.3 s on; of the whole run" in written
    for kind in ("frames", "checkpoints"):
        assert all(p.read_bytes() == (finished.out / kind / p.name).read_bytes() for p in (again.out / kind).glob("*7.npz"))
    assert run_of(manifest(finished.out)) == run_of(manifest(again.out))
    assert run_of(manifest(finished.out) | {"settings": {"n": 3}}) != run_of(manifest(again.out))


def test_a_shorter_run_than_there_is_already_is_refused(again, capsys):
    assert again(lambda: None, "--resume", "--duration", "0.2") == 2
    assert "is at frame 8 already, and this request ends at frame 4" in capsys.readouterr().err
    assert names(again.out, "frames") == list(range(9))


def test_a_state_that_is_not_finite_is_refused(finished):
    state = Recording(finished.out).last_checkpoint()[1]
    sim = tc.Simulation(finished.file.make({}), integrator="verlet", threads=1)
    for name in ("particles.x", "particles.v", "time"):
        bad = dict(state)
        bad[name] = np.where(np.arange(state[name].size).reshape(state[name].shape) == 0, np.nan, state[name])
        with pytest.raises(tc.SceneError, match=f"checkpoint's {name.split('.')[-1]} is not finite"):
            sim.resume(bad)


@pytest.mark.parametrize("args", [("run", "hang", "--out", ""), ("export", "x", "--format", "pc2", "--to", ""),
                                  ("report", "x", "--to", ""), ("render", "x", "--to", "")])
def test_an_empty_name_is_none(args, capsys):
    assert cli.main(args) == 2 and "''" in capsys.readouterr().err


def test_a_name_with_more_than_a_name_in_it_adds_nothing_to_files(tmp_path):
    """Through the whole of it: scene, recording, export."""
    (tmp_path / "named.py").write_text(SCENE.replace("tc.Stretch(10.0))", 'tc.Stretch(10.0)), name="a\\nf 1 2 3 # b"'))
    done = call("run", tmp_path / "named.py", "--out", tmp_path / "o", "--fps", "20", "--duration", "0.05", "--no-images",
                "--integrator", "verlet", "--threads", "1")
    assert done.returncode in (0, 2), done.stderr  # such a name may be refused
    if done.returncode == 0:
        assert call("export", tmp_path / "o", "--format", "pc2").returncode == 0
        obj, = (tmp_path / "o" / "pc2").glob("*.obj")
        lines = obj.read_text().splitlines()
        assert sum(line.startswith("f ") for line in lines) == 8
