"""Odd values for every argument of every public callable, a few fixed seeds; `scripts/fuzz.py calls` tries more."""

import argparse
import dataclasses
import pathlib
import sys

import numpy as np
import pytest

import taichi_cloth as tc

sys.path.insert(0, str(pathlib.Path(__file__).parents[2] / "scripts"))
from fuzzing import calls  # noqa: E402


def test_no_argument_is_left_out():
    assert calls.missing() == []


@pytest.mark.parametrize("before, what, right", calls.CALLS, ids=[what for _, what, _ in calls.CALLS])
def test_descriptions(before, what, right):
    """Right arguments are taken, odd ones taken sensibly or refused by name."""
    assert calls.judge(before, what, right, right, "f64").verdict == "ok"
    rng = np.random.default_rng(20_261_122)
    for name in right:
        for odd in rng.choice(calls.ODD, 12, replace=False):
            outcome = calls.judge(before, what, right, {**right, name: str(odd)}, "f64")
            assert outcome.verdict == "ok", outcome.text


def test_a_bare_error_and_a_value_taken_in_silence_are_seen(monkeypatch):
    """The judge itself."""
    @dataclasses.dataclass
    class Silent:
        radius: object

    monkeypatch.setattr(tc, "Silent", Silent, raising=False)
    for odd in ("nan", '"red"', "1j", "None", "np.array([1, inf])", "object()"):
        outcome = calls.judge("", "tc.Silent", {"radius": "1.0"}, {"radius": odd}, "f64")
        assert outcome.verdict == "failed" and "taken in silence: radius" in outcome.text
    assert calls.judge("", "tc.Silent", {"radius": "1.0"}, {"radius": "2.0"}, "f64").verdict == "ok"
    assert "TypeError" in calls.judge("", "tc.Silent", {}, {"width": "1"}, "f64").text


@pytest.mark.parametrize("text", ["²", "9" * 5000, "1:²", "0:" + "9" * 19])
def test_numbers_of_frames_and_seeds_in_odd_digits_are_refused_by_name(text):
    from taichi_cloth.app.recorded import size_of
    from taichi_cloth.app.sweeping import seeds_of
    from taichi_cloth.recording.drawing import numbers_in

    with pytest.raises(tc.SceneError, match="frames = "):
        numbers_in(text, range(5))
    with pytest.raises(tc.SceneError, match="--seeds "):
        seeds_of(text)
    with pytest.raises(argparse.ArgumentTypeError, match="WIDTHxHEIGHT"):
        size_of(f"{text}x100")
    assert numbers_in("1:999999999999999999:2", range(5)) == [1, 3]
