"""How far a run is, as a notebook, a terminal and a file are told."""

import builtins
import io
import itertools
import re
import sys
from types import SimpleNamespace

import pytest
from inside import call

import taichi_cloth as tc
from taichi_cloth.app import progress as progress_module
from taichi_cloth.app.progress import Left, Pictures, in_words, progress
from taichi_cloth.backend.timing import compiling
from taichi_cloth.step.records import Tally


class ZMQInteractiveShell:
    """What a notebook's kernel calls its shell."""


@pytest.fixture
def notebook(monkeypatch):
    """A notebook, as far as it is asked; what it shows, picture after picture."""
    seen = []

    def display(what, display_id):
        assert display_id is True
        seen.append(what)
        return SimpleNamespace(update=seen.append)

    monkeypatch.setattr(builtins, "get_ipython", ZMQInteractiveShell, raising=False)
    monkeypatch.setitem(sys.modules, "IPython.display", SimpleNamespace(display=display))
    return seen


def test_a_notebook_shows_a_bar(notebook, tmp_path, capsys):
    scene = tc.Scene()
    scene.add_cloth(tc.grid(0.5, 4), tc.Fabric(0.2, tc.Stretch(100)))
    with tc.Simulation(scene, h=1 / 60, integrator="verlet") as sim:
        tc.record(sim, tmp_path / "run", 0.1, 30)
    text = [what._repr_html_() for what in notebook]
    assert text[0].startswith('<progress value="0" max="3"></progress>') and "building kernels" in text[0]
    assert text[-1].startswith('<progress value="3" max="3"></progress> frame 3/3  0.100 s simulated, step ')
    assert len(text) <= 5
    assert not re.search("frame", capsys.readouterr().err)


def test_elsewhere_there_are_lines(capsys, monkeypatch):
    """The first frame compiles for 30 s; then each takes .5 s."""
    clock = iter([0.0, *(30 + 0.5 * k for k in range(40))])
    monkeypatch.setattr(progress_module.time, "perf_counter", lambda: next(clock))
    sim = SimpleNamespace(time=0.5, last=SimpleNamespace(h=0.01, iterations=3), tally=Tally())
    sim.tally.rejections["ENERGY"] = 2
    with progress(40) as show:
        for frame in range(41):
            show(sim, frame)
    lines = capsys.readouterr().err.splitlines()
    left = [", no estimate yet", *(f", about {0.5 * (40 - k):.0f} s left{' at this rate' * (k < 8)}" for k in range(4, 40, 4)),
            ""]
    assert lines == [f"frame {k}/40  0.500 s simulated{more}, 2 steps tried again, step 10 ms, 3 iterations"
                     for k, more in zip(range(0, 41, 4), left)]


def test_frames_whose_kernels_are_built_say_so_and_do_not_count(monkeypatch):
    """Frames take .5 s; the fourth builds kernels for 20 s more, in the middle of the run. Three frames are an estimate."""
    times, built = iter([0.0, 30.0, 30.5, 51.0, 51.5, 52.0, 72.5]), iter([0.0, 29.0, 29.0, 49.0, 49.0, 49.0, 69.0])
    monkeypatch.setattr(progress_module.time, "perf_counter", lambda: next(times))
    watch = SimpleNamespace()
    monkeypatch.setattr(progress_module, "compiling", watch)
    left, said = Left(100), []
    for frame in range(7):
        watch.seconds = next(built)
        said.append(left(frame))
    assert said == ["no estimate yet", "building kernels", "no estimate yet", "building kernels",
                    *["about 48 s left at this rate"] * 2, "building kernels"]


def test_frames_that_become_dearer_count_as_the_last_of_them(monkeypatch):
    """Cloth falls for ten frames of 1 s, and lies on something in those after it, of 4 s; then it rests."""
    costs = [1.0] * 10 + [4.0] * 12 + [0.5] * 60
    clock = itertools.accumulate(costs, initial=0.0)
    monkeypatch.setattr(progress_module.time, "perf_counter", lambda: next(clock))
    left = Left(100)
    said = [left(frame) for frame in range(80)]
    assert said[8] == "about 92 s left at this rate" and said[20] == f"about {in_words(4.0 * 80)} left"
    mean = (9 * 1.0 + 12 * 4.0 + 39 * 0.5) / 60  # of all but the first
    assert said[61] == f"about {in_words(mean * 39)} left"


@pytest.mark.parametrize("drawn, said", [
    (range(41), "about 60 s left"),  # 20 frames of 1 s and 20 pictures of 2 s
    (range(0, 41, 10), "about 24 s left"),  # of which two are left
    (range(21, 41), "about 20 s and 20 pictures left"), (range(11), "about 20 s left"), ((), "about 20 s left")])
def test_pictures_count_where_they_are_drawn(monkeypatch, drawn, said):
    """At frame 20 of 40; the first picture takes 30 s more, for other reasons than kernels."""
    now = 0.0
    monkeypatch.setattr(progress_module.time, "perf_counter", lambda: now)
    pictures = Pictures(drawn)
    left = Left(40, "", pictures)
    for frame in range(21):
        now += 1.0
        if frame in pictures.frames:
            with pictures.timed():
                now += 2.0 + 30.0 * (not pictures.took)
        told = left(frame)
    assert told == said


def test_a_run_tells_of_pictures_that_come_late(tmp_path):
    """Those of the last frames alone: the estimate says that it is without them until one is drawn."""
    done = call("run", "hang", "--set", "cells=3", "--duration", "1", "--fps", "20", "--integrator", "verlet", "--frames",
                "14:20", "--size", "32x24", "--out", tmp_path / "run")
    assert done.returncode == 0, done.stderr
    lines = {line.split("/")[0]: line for line in done.stderr.splitlines() if line.startswith("frame ")}
    assert " s and 7 pictures left" in lines["frame 12"]
    assert " pictures" not in lines["frame 18"] and " left" in lines["frame 18"]


@pytest.mark.parametrize("each, quicker, told", [(4.0, "--small is", True), (2.0, "--small is", False), (4.0, "", False)])
def test_a_long_run_is_told_once_how_it_is_quicker(monkeypatch, capsys, each, quicker, told):
    clock = iter(each * k for k in range(100))
    monkeypatch.setattr(progress_module.time, "perf_counter", lambda: next(clock))
    left = Left(100, quicker)
    for frame in range(8):
        left(frame)
    said = capsys.readouterr().err.splitlines()
    assert said == ["note: this run takes about 6 min more; --small is"] * told


def test_a_run_takes_the_quick_options_of_its_scene(tmp_path, monkeypatch):
    """`run --small` as `check --small`; what is set comes after them; without the flag it is told of it."""
    made = []

    def simulate(scene, options, built):
        made.append((scene.typed(options.settings), options.quicker))
        raise tc.SceneError("enough")

    monkeypatch.setattr("taichi_cloth.app.runner.simulate", simulate)
    for words in (("--small",), ("--small", "--set", "cells=7"), ()):
        assert call("run", "hang", *words).returncode == 2
    assert made == [({"cells": 12}, ""), ({"cells": 7}, ""), ({}, "--small takes the scene's quick options, cells=12")]


def test_a_bar_says_that_kernels_are_built_before_it_waits_for_them(monkeypatch):
    """A terminal shows the sentence while the compiler works, and no estimate of before."""
    from rich.console import Console

    shown = io.StringIO()
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True, raising=False)
    monkeypatch.setattr("rich.console.Console", lambda stderr: Console(file=shown, force_terminal=True, width=120))
    sim = SimpleNamespace(time=0.5, last=SimpleNamespace(h=0.01, iterations=3), tally=Tally())
    with progress(40) as show:
        for frame in range(4):
            show(sim, frame)
        compiling.start()
        assert "building kernels" in shown.getvalue()
        show(sim, 4)
    assert compiling.tell is None


@pytest.mark.parametrize("seconds, words", [(0.2, "0 s"), (99.4, "99 s"), (100, "2 min"), (754, "13 min"), (5940, "99 min"),
                                            (12000, "3 h 20 min")])
def test_durations_in_words(seconds, words):
    assert in_words(seconds) == words


@pytest.mark.parametrize("room, said", [(80, "0.500 s simulated, about 9 min left, step 10 ms, 3 iterations"),
                                        (50, "0.500 s simulated, about 9 min left, step 10 ms"), (5, "0.500 s simulated")])
def test_what_there_is_no_room_for_is_left_out(room, said):
    sim = SimpleNamespace(time=0.5, last=SimpleNamespace(h=0.01, iterations=3), tally=Tally())
    assert progress_module._state(sim, "about 9 min left", room) == said


def test_a_run_that_is_gone_on_with_counts_from_where_it_goes_on(monkeypatch):
    clock = iter([100.0, 104.0, 106.0, 108.0, 110.0])
    monkeypatch.setattr(progress_module.time, "perf_counter", lambda: next(clock))
    left = Left(30)
    assert [left(k) for k in (21, 22, 23, 24, 25)][-1] == "about 10 s left"
