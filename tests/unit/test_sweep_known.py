"""By what a run is known again: whatever decides its figures makes another run, and nothing else does."""

import dataclasses
import enum
import functools
import importlib
import itertools
import os
import pathlib
import subprocess
import sys
import threading

import numpy as np
import pytest

import taichi_cloth as tc
from taichi_cloth.sweeps.description import described
from taichi_cloth.sweeps.digest import Digest, Unknown

SCENE = '''"""A sheet on which everything acts that has a function."""
import json
import pathlib

import numpy as np
import taichi_cloth as tc
import pushes

DEPTH = 0.3
KINDS = {"warp", "weft", "bias", "none"}


class Own:
    stiffness = 3.0

    def __init__(self, fields, model, scene, K):
        self.k = self.stiffness * len(KINDS)


def drop(scene, vertex):
    scene.unpin(scene.cloths[0], vertex)


def build():
    first, given = 0, json.loads((pathlib.Path(__file__).parent / "path.json").read_text())
    scene = tc.Scene(air=tc.Air(normal=1.0, wind=lambda x, t: 0.1 * x + pushes.gust(t)))
    cloth = scene.add_cloth(tc.load(pathlib.Path(__file__).parent / "sheet.obj"), tc.Fabric(0.2, tc.Stretch(100.0)))
    scene.move(cloth, [0], lambda t: (0.0, given["speed"] * t, 0.0), relative=True)
    scene.pin(cloth, [1])
    scene.add_solid(tc.Sphere(0.1), 0.3, 0.01, position=lambda t: (0, -1 + DEPTH * t, 0))
    scene.add_load(cloth, [3], pushes.push)

    def event(scene):
        from pushes import HEAVIER
        drop(scene, first)  # lets go
        scene.add_load(scene.cloths[0], [2], (HEAVIER, 0, 0))

    scene.at(0.05, event)
    scene.add_force(Own)
    return scene


def metrics(sim):
    return pushes.FORCE * float(sim.positions()[:, 1].min())
'''
PUSHES = '''"""Helpers."""
FORCE, HEAVIER, UNUSED = 2.0, 3.0, 4.0


def push(t):
    return (strong(t), 0.0, 0.0)


def strong(t):
    return 2.0 * t


def gust(t):
    return 0.0 if t < 0.04 else 1.0
'''
FILES = {"tiny.py": SCENE, "pushes.py": PUSHES, "path.json": '{"speed": 0.5}',
         "sheet.obj": "v 0 0 0\nv 1 0 0\nv 1 0 1\nv 0 0 1\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nf 1/1 2/2 3/3\nf 1/1 3/3 4/4\n"}
OTHER = (  # what changes a run
    ("tiny.py", "DEPTH = 0.3", "DEPTH = 0.31"), ("tiny.py", "first, given = 0", "first, given = 1"),
    ("tiny.py", "scene.unpin(scene.cloths[0], vertex)", "scene.unpin(scene.cloths[0])"), ("tiny.py", "at(0.05", "at(0.06"),
    ("tiny.py", "[2], (HEAVIER", "[1], (HEAVIER"), ("tiny.py", "Fabric(0.2", "Fabric(0.21"),
    ("tiny.py", "0.3, 0.01", "0.3, 0.02"),
    ("tiny.py", "Sphere(0.1)", "Sphere(0.11)"), ("tiny.py", "stiffness = 3.0", "stiffness = 4.0"), ("tiny.py", '"bias", ', ""),
    ("tiny.py", "self.stiffness * len", "self.stiffness + len"), ("tiny.py", ".min()", ".max()"),
    ("tiny.py", "0.1 * x", "0.2 * x"),
    ("pushes.py", "FORCE, HEAVIER, UNUSED = 2.0", "FORCE, HEAVIER, UNUSED = 2.5"), ("pushes.py", "3.0, 4.0", "3.5, 4.0"),
    ("pushes.py", "2.0 * t", "2.5 * t"), ("pushes.py", "t < 0.04", "t < 0.05"), ("path.json", "0.5", "0.6"),
    ("sheet.obj", "v 1 0 1\n", "v 1 0 1.001\n"), ("sheet.obj", "vt 1 1\n", "vt 1 1.001\n"))
SAME = (  # what does not
    ("tiny.py", "  # lets go", ""), ("tiny.py", "given[\"speed\"] * t, 0.0)", "given['speed']\n        * t, 0.0)"),
    ("tiny.py", "DEPTH = 0.3", "# how fast\nDEPTH = 0.30"), ("tiny.py", "A sheet on", "The sheet on"),
    ("tiny.py", "\"warp\", \"weft\"", "\"weft\", \"warp\""), ("pushes.py", "3.0, 4.0", "3.0, 5.0"),
    ("pushes.py", "Helpers", "What helps"), ("pushes.py", "def strong(t):\n", "def strong(t):\n    # as strong as needed\n\n"))


def written(folder: pathlib.Path, file: str = "", old: str = "", new: str = "") -> str:
    """The digest of the scene and the metrics of the files above, one of them with other text, in this process."""
    folder.mkdir()
    for name, text in FILES.items():
        assert name != file or text.count(old) == 1, old
        (folder / name).write_text(text.replace(old, new) if name == file else text)
    sys.path.insert(0, str(folder))
    try:
        return digest()
    finally:
        sys.path.remove(str(folder))


def digest() -> str:
    """Of tiny.py, as it stands on the path now."""
    for name in ("tiny", "pushes"):
        sys.modules.pop(name, None)
    importlib.invalidate_caches()
    tiny = importlib.import_module("tiny")
    known, culprit = described(tiny.build(), tiny.metrics, 0.1, 20)
    assert not culprit and len(known) == 16, culprit
    return known


def test_whatever_decides_the_figures_makes_another_run_and_nothing_else_does(tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    base = written(tmp_path / "base")
    assert written(tmp_path / "again") == base
    others = [written(tmp_path / f"other{k}", *change) for k, change in enumerate(OTHER)]
    assert len({base, *others}) == 1 + len(OTHER), [c for c, o in zip(OTHER, others) if o == base or others.count(o) > 1]
    for k, change in enumerate(SAME):
        assert written(tmp_path / f"same{k}", *change) == base, change


def test_another_process_knows_it_by_the_same(tmp_path):
    base = written(tmp_path / "base")
    code = "import test_sweep_known; print(test_sweep_known.digest())"
    path = os.pathsep.join([str(tmp_path / "base"), str(pathlib.Path(__file__).parent), *sys.path])
    env = {**os.environ, "PYTHONPATH": path, "PYTHONHASHSEED": "7"}  # another order of sets
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=env, check=True)
    assert done.stdout.strip() == base


class Odd(enum.Enum):
    ONE = 1


@dataclasses.dataclass
class Box:
    inside: object


def test_values_are_told_apart_exactly_and_known_again():
    def cell(value):
        return lambda: value

    def texts(values):
        return [Digest().of(v) for v in values]

    values = [1, 1.0, True, "1", b"1", 1 + 0j, None, 0.1, np.nextafter(0.1, 1), -0.0, 0.0, np.float32(0.1), (1,), [1], {1},
              {1: 2}, {1: 3}, 10**5000, np.arange(3), np.arange(3.0), np.arange(3)[None], np.array([1, "a"], dtype=object),
              Odd.ONE, Odd, Box(1), Box(2), Box([1]), Box(Box(1)), pathlib.PurePath("a"), np.random.default_rng(3),
              np.random.default_rng(4), np.sin, np.cos, abs, functools.partial(max, 1), functools.partial(max, 2), cell(1),
              cell(2), [].append, "a".join, range(3)]
    found = texts(values)
    assert len(set(found)) == len(found)
    assert texts(values) == found
    assert texts([np.arange(6).reshape(2, 3).T]) == texts([np.arange(6).reshape(2, 3).T.copy()])
    assert texts([np.arange(3, dtype=">i4")]) == texts([np.arange(3, dtype="<i4")])
    names = [f"name{k}" for k in range(40)]
    assert texts([dict.fromkeys(names)]) == texts([dict.fromkeys(reversed(names))])
    circle: list = [1]
    circle.append(circle)
    assert texts([circle]) != texts([[1, [1]]])


def test_what_cannot_be_read_is_named():
    scene = tc.Scene()
    lock = threading.Lock()
    scene.at(0.5, lambda: lock.locked())
    known, culprit = described(scene, None, 0.1, 20)
    assert known == "" and "lock" in culprit and "action" in culprit and "the scene" in culprit
    with open(__file__) as file, pytest.raises(Unknown, match="'inside' of Box, a TextIOWrapper"):
        Digest().of(Box(file))
    deep: list = []
    for _ in range(100_000):
        deep = [deep]
    assert described(tc.Scene(), lambda sim: deep, 0.1, 20) == ("", "something in it that is nested too deeply")


def test_functions_that_read_elsewhere_count_by_their_values(tmp_path):
    file = tmp_path / "speed"

    def known(text: str) -> str:
        file.write_text(text)
        scene = tc.Scene()
        scene.add_prop(tc.Sphere(0.1), position=lambda t: (float(file.read_text()) * t, 0, 0))
        return described(scene, None, 0.1, 20)[0]

    assert known("1.0") != known("1.5")
    assert known("1.5") == known("1.5")


def test_the_counter_of_a_closure_counts_where_it_stands():
    count = itertools.count(3)
    first = Digest().of(lambda: next(count))
    next(count)
    assert Digest().of(lambda: next(count)) != first
