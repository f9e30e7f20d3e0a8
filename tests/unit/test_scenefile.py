"""Scene files: found, read, their options typed."""

import dataclasses
import sys
import time
import warnings

import numpy as np
import pytest

from taichi_cloth.app import cli, runner, scenefile, sceneoptions, waiting
from taichi_cloth.errors import SceneError, ScriptError
from taichi_cloth.scene.reading import builds, only_described

TEXT = '''"""What it shows.

More."""
import taichi_cloth as tc

RUN, SMALL = {"fps": 12}, {"n": 3}

def build(n: int = 5, x: float = 0.5, flag: bool = False, name: str = "a", at=(0.0, 1.0, 0.0)):
    scene = tc.Scene()
    scene.add_cloth(tc.grid(x, n), tc.Fabric(0.2, tc.Stretch(10)), name=name)
    return scene
'''


@pytest.mark.parametrize("name, word, said", [
    ("fabric", "jeans", "unknown fabric 'jeans'; did you mean 'denim'. known: canvas, "),
    ("wind", "strong", "known: breeze, .*; 'gusty' before one")])
def test_a_wrong_word_is_refused_before_a_scene_is_built(scene, name, word, said):
    """As a view does it whose scene takes long to build."""
    def never(n: int = 5):
        raise AssertionError("the scene is built")

    for refuses in (scene.typed, dataclasses.replace(scene, build=never).make):
        with pytest.raises(SceneError, match=said):
            refuses({name: word})
    assert scene.typed({"fabric": "", "wind": ""}) == {"fabric": "", "wind": ""}


@pytest.fixture
def scene(tmp_path):
    (tmp_path / "mine.py").write_text(TEXT)
    return scenefile.read(str(tmp_path / "mine.py"))


def test_a_scene_file_is_read(scene, monkeypatch, capsys):
    assert (scene.name, scene.summary, scene.run, scene.small) == ("mine", "What it shows.", {"fps": 12}, {"n": 3})
    assert scene.check is None
    made = scene.make({"n": "3", "name": "b"})
    assert made.cloths[0].mesh.vertex_count == 16 and made.cloths[0].name == "b"
    with pytest.raises(SceneError, match="has no check"):
        list(scenefile.run_check(scene, None))
    simulated: list = []
    monkeypatch.setattr(runner, "simulate", lambda *a: simulated.append(a))
    assert cli.main(["check", scene.path]) == 2 and "has no check" in capsys.readouterr().err and not simulated


@pytest.mark.parametrize("name, text, value", [
    ("n", "7", 7), ("x", "1/8", 0.125), ("x", "2e-3", 0.002), ("x", "1/", 1.0), ("name", "1/8", "1/8"), ("flag", "true", True),
    ("flag", "1", True),
    ("flag", "Yes", True), ("flag", "false", False), ("flag", "0", False), ("flag", "NO", False),
    ("at", "1,-.5,1/4", (1.0, -0.5, 0.25))])
def test_options_are_read_as_the_types_of_their_defaults(scene, name, text, value):
    got = scene.typed({name: text})[name]
    assert got == value and type(got) is type(value)
    assert scene.typed({name: scenefile.plain(got)})[name] == got  # as a manifest keeps it


@pytest.mark.parametrize("name, text", [("n", "1.5"), ("n", "x"), ("x", "1/0"), ("x", "a"), ("flag", "perhaps"), ("m", "1"),
                                        ("at", "1,2"), ("at", "1,2,x")])
def test_what_is_not_of_its_type_is_named(scene, name, text):
    with pytest.raises(SceneError, match=name):
        scene.typed({name: text})


def test_the_first_folder_that_has_a_scene_wins(tmp_path, monkeypatch, capsys):
    (tmp_path / "scenes").mkdir()
    for name in ("hang.py", "own.py", "_helper.py"):
        (tmp_path / "scenes" / name).write_text(TEXT)
    monkeypatch.chdir(tmp_path)
    found = scenefile.available()
    assert found["hang"].resolve() == (tmp_path / "scenes" / "hang.py").resolve() and "own" in found and "swing" in found
    assert "_helper" not in found and list(found) == sorted(found)
    assert scenefile.read("hang").summary == "What it shows."
    theirs = scenefile.folders()[1]
    assert scenefile.own("hang") == f"scenes/hang.py, not {theirs / 'hang.py'}" and scenefile.own("own") == "scenes/own.py"
    assert not any(scenefile.own(name) for name in ("swing", "scenes/own.py", "none"))
    assert cli.main(["check", "own"]) == 2 and "note: scene own is scenes/own.py\n" in capsys.readouterr().err
    assert cli.main(["list"]) == 0 and "(scenes/own.py)" in capsys.readouterr().out
    monkeypatch.chdir(theirs.parent)
    assert not scenefile.own("hang")


def test_scene_files_that_do_not_work_are_named(tmp_path):
    for text, words in (("build = 1/0", "does not run: ZeroDivisionError"), ("x = 1", "no build"),
                        ("def build():\n    return 3", "not a Scene"),
                        ("def build():\n    return {}['a']", r"KeyError: 'a' \(.*odd.py, line 2\)")):
        (tmp_path / "odd.py").write_text(text)
        with pytest.raises(SceneError, match=words):
            scenefile.read(str(tmp_path / "odd.py")).make({})


def test_modules_beside_a_scene_are_found(tmp_path, monkeypatch):
    (tmp_path / "beside_a_scene.py").write_text("SIZE = 0.25")
    (tmp_path / "mine.py").write_text("import taichi_cloth as tc\n\n\ndef build():\n    from beside_a_scene import SIZE\n"
                                      "    scene = tc.Scene()\n    scene.add_cloth(tc.grid(SIZE, 2), tc.Fabric(0.2))\n"
                                      "    return scene\n")
    monkeypatch.setattr(sys, "path", sys.path.copy())
    assert np.ptp(scenefile.read(str(tmp_path / "mine.py")).make({}).cloths[0].positions[:, 0]) == pytest.approx(0.25)


@pytest.mark.parametrize("line, words", [
    ("yield 'a', float('nan')", "yielded .'a', nan., not a sentence and True or False"),
    ("yield True", "yielded True, not a sentence"), ("yield 'a', np.array([True, False])", "not a sentence and True or False"),
    ("return; yield", "it yielded nothing"), ("return True", "not iterable")])
def test_checks_yield_sentences_and_truth(tmp_path, line, words):
    (tmp_path / "mine.py").write_text("import numpy as np\n\n\ndef build():\n    pass\n\n\n"
                                      f"def check(sim):\n    {line}\n")
    with pytest.raises(ScriptError, match=words) as caught:
        list(scenefile.run_check(scenefile.read(str(tmp_path / "mine.py")), None))
    assert "scenefile.py" not in str(caught.value) and "mine.py" in str(caught.value)


def test_a_flat_mesh_is_not_hung_by_all_of_it(tmp_path):
    (tmp_path / "flat.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 0 1\nf 1 3 2\n")
    with pytest.raises(SceneError, match="lies flat.*pins=2"):
        scenefile.read("hang_mesh").make({"mesh": str(tmp_path / "flat.obj")})


def test_a_scene_says_its_options(tmp_path, capsys):
    """With default, meaning and unit, by `list` and by the help of every command that takes a scene."""
    (tmp_path / "mine.py").write_text(TEXT.replace("    scene = tc", '''    """A sheet.

    Args:
        n: cells along
            a side.
        x: its size [m].

    Returns:
        at: nothing of its own.
    """
    scene = tc''', 1))
    path = str(tmp_path / "mine.py")
    lines = ["  n=5             cells along a side", "  x=0.5           its size [m]", "  flag=False", "  name=a",
             "  at=0.0,1.0,0.0"]
    assert cli.main(["list", path]) == 0
    said = capsys.readouterr().out.splitlines()
    assert said[0] == "mine: What it shows." and said[2:7] == lines and [line.split("=")[0] for line in said[7:]] == [
        "  fabric", "  wind"]
    for command in ("run", "check", "view", "sweep", "study", "verify"):
        with pytest.raises(SystemExit) as ended:
            cli.main([command, path, "--help"])
        said = capsys.readouterr().out
        assert ended.value.code == 0 and said.startswith("usage:") and "\n".join(lines) in said
    assert cli.main(["run", str(tmp_path / "mien.py"), "--help"]) == 2 and "did you mean" in capsys.readouterr().err


@pytest.mark.parametrize("name", scenefile.available())
def test_every_option_of_a_scene_has_its_line(name):
    scene = scenefile.read(name)
    said = sceneoptions.meanings(scene.build)
    assert list(said) == list(scene.options) and all(said.values())


def test_warnings_are_notes_on_a_command_line(capsys):
    """Without the line of code that Python shows; those for programmers stay as they are."""
    def work() -> int:
        warnings.warn("ball: size = 140 m looks like another unit", stacklevel=1)
        warnings.warn("old", DeprecationWarning, stacklevel=1)
        return 0

    with pytest.warns(DeprecationWarning, match="old"):
        assert cli._guard(work) == 0
    assert capsys.readouterr().err == "note: ball: size = 140 m looks like another unit\n"


def test_what_takes_long_is_said(monkeypatch, capsys):
    monkeypatch.setattr(waiting, "PATIENCE", 0.02)
    with waiting.waiting("loading dress.obj"):
        time.sleep(0.3)
    with waiting.waiting("loading quick.obj"):
        pass
    time.sleep(0.1)
    said = capsys.readouterr()
    assert said.err == "loading dress.obj ...\n" and said.out == ""


BUILDS, RECORD = "def build(): return tc.Scene()", "record(sim, 'out/x', duration=1)"
RECORDS = '''import pathlib
import taichi_cloth as tc

pathlib.Path("ran").touch()
sim = None
{build}
tc.{call}
'''


@pytest.mark.parametrize("build, call, says", [
    ("", RECORD, ["no build()", "`python mine.py`"]),
    (BUILDS, RECORD, ["mine.py, line 7: calls tc.record", "`python mine.py`"]),
    (BUILDS, "view(sim)", ["line 7: calls tc.view"]), (BUILDS, "run(build)", ["line 7: calls tc.run", "below `if __name__"])])
def test_a_script_that_runs_by_itself_is_refused_with_the_way_to_run_it(tmp_path, monkeypatch, build, call, says):
    """Nothing of one without a build is run; of one that has both, nothing from there on."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.py").write_text(RECORDS.format(build=build, call=call))
    with pytest.raises(SceneError) as caught:
        scenefile.read("mine.py")
    assert all(word in str(caught.value) for word in says)
    assert (tmp_path / "ran").exists() == bool(build) and not (tmp_path / "out").exists()
    only_described("tc.record")  # and nothing is refused any more


@pytest.mark.parametrize("code", ["from other import build", "from other import make as build", "build = print",
                                  "from other import *", "if True:\n    def build(): pass",
                                  "globals()['build'] = print", "def build(:"])
def test_code_that_may_name_a_build_is_read(code):
    assert builds(code)


@pytest.mark.parametrize("name, says, never", [
    ("nosuch.py", "no scene file 'nosuch.py': there is no such file; `taichi-cloth list`", "did you mean"),
    ("hang.py", "the scene of that name is meant by 'hang'", "did you mean"), ("mime.py", "did you mean 'mine.py'", "pinch"),
    ("pinhc", "no scene 'pinhc'; did you mean 'pinch'", "file"), ("folder.py", "is a folder", "no such")])
def test_a_missing_file_is_called_a_missing_file(tmp_path, monkeypatch, name, says, never):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.py").touch()
    (tmp_path / "folder.py").mkdir()
    with pytest.raises(SceneError) as caught:
        scenefile.read(name)
    assert says in str(caught.value) and never not in str(caught.value)
