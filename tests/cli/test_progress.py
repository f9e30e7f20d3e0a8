"""How far a run is, as a notebook, a terminal and a file are told."""

import builtins
import re
import sys
from types import SimpleNamespace

import pytest

import taichi_cloth as tc
from taichi_cloth.app.progress import progress
from taichi_cloth.step.tally import Tally


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
    assert text[0].startswith('<progress value="0" max="3"></progress>') and "compiling" in text[0]
    assert text[-1].startswith('<progress value="3" max="3"></progress> frame 3/3  t 0.100 s') and len(text) <= 5
    assert not re.search("frame", capsys.readouterr().err)


def test_elsewhere_there_are_lines(capsys):
    sim = SimpleNamespace(time=0.5, last=SimpleNamespace(h=0.01, iterations=3), tally=Tally())
    sim.tally.rejections["ENERGY"] = 2
    with progress(40) as show:
        for frame in range(41):
            show(sim, frame)
    lines = capsys.readouterr().err.splitlines()
    assert lines == [f"frame {k}/40  t 0.500 s  h 10.00 ms  CG 3  rejected 2" for k in range(0, 41, 4)]
