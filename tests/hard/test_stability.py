"""Hard cases of `scripts/stability.py` that are quick: the default method passes them all, others by their rules."""

import importlib.util
import pathlib

import pytest

_spec = importlib.util.spec_from_file_location("stability", pathlib.Path(__file__).parents[2] / "scripts" / "stability.py")
assert _spec is not None and _spec.loader is not None
stability = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(stability)


@pytest.mark.parametrize("name", ["stiff", "masses", "slivers", "collapsed", "folded", "half", "inverted", "fast pins",
                                  "jerked", "gusts", "far away", "all held"])
@pytest.mark.slow
def test_default_passes(name):
    row = stability.run(stability.CASES[name], "safe")
    assert row["passed"], row


@pytest.mark.parametrize("name, integrator", [("half", "newton_euler"), ("random", "newton_euler"), ("masses", "verlet"),
                                              ("far away", "verlet"), ("fast pins", "verlet")])
def test_others_pass(name, integrator):
    row = stability.run(stability.CASES[name], integrator)
    assert row["passed"], row


@pytest.mark.parametrize("name", ["masses", "half", "far away"])
@pytest.mark.slow
@pytest.mark.restarts
def test_in_f32(name):
    row = stability.run(stability.CASES[name], "safe", "f32")
    assert row["passed"], row


@pytest.mark.slow
def test_the_rules_can_be_broken():
    """A frozen sheet and one that gains energy are told apart from good ones."""
    case = stability.CASES["half"]
    wild = stability.run(case, "verlet", adaptive=False)
    assert not wild["passed"]
    frozen = stability.Case(stability.plain(), free=True, t=0.3)  # pinned, and said to be falling
    row = stability.run(frozen, "safe")
    assert not row["passed"] and "falls" in row["faults"][0]
