"""The steps of a run in which most went wrong, by three measures: energy unaccounted for, refused attempts, stretch."""

from collections.abc import Callable, Sequence
from typing import Any

from ..errors import many

Step = dict[str, Any]  # as telemetry has it
TINY = 1e-3  # part of the energy of a run's steps that may be unaccounted for in one step without a word
STRETCHED = 1.2  # |w|/b from which on a stretch is told


def worst_of(log: Sequence[Step]) -> list[str]:
    """A heading and a line for each measure by which a step stands out; empty where none does."""
    largest = max((_energy(r) for r in log), default=0.0)
    measures: list[tuple[Callable[[Step], float], float, Callable[[Step], str]]] = [
        (_astray, TINY * largest, _astray_in_words),
        (_refused, 0.0, lambda r: f"most refused attempts, {_refused(r)}"),
        (_stretch, STRETCHED, lambda r: f"largest stretch, {_stretch(r):.3f} of the length at rest")]
    lines = []
    for measure, least, words in measures:
        k = max(range(len(log)), key=lambda k: measure(log[k]), default=-1)
        if k >= 0 and measure(log[k]) > least:
            lines.append(f"    step {k} to t = {log[k]['t']:.4g} s: {words(log[k])}")
    return [f"worst of {many(len(log), 'step')}, by energy, refused attempts and stretch:", *lines] if lines else []


def _energy(r: Step) -> float:
    return float(sum(abs(e) for e in r.get("energies", {}).values()))


def _astray(r: Step) -> float:
    return abs(float(r.get("ledger", {}).get("unaccounted", 0.0)))


def _astray_in_words(r: Step) -> str:
    lost = float(r["ledger"]["unaccounted"])
    return f"most energy unaccounted for, {abs(lost):.2g} J {'gained' if lost > 0 else 'lost'}"


def _refused(r: Step) -> int:
    return int(sum(r.get("rejections", {}).values()))


def _stretch(r: Step) -> float:
    return float(r.get("stretch") or 0.0)
