"""Sentences of a page on its session: state, last step, costliest steps."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING

from ..errors import many

if TYPE_CHECKING:  # a page starts before Taichi is imported
    from ..step.records import StepRecord
    from .session import Session

COSTLY = 3  # steps that are named


def state(session: Session) -> str:
    """One line: whether it runs, its time [s], and the last error."""
    if session.sim is None:
        return "setting up"
    mode = "runs" if session.running else "paused"
    pulled = ", pulled" if session.hand is not None else ""
    t = float(session.arrays["t"])
    return f"{mode} at t = {t:.3f} s{pulled}" + (f". Error: {session.trouble}" if session.trouble else "")


def last_step(record: StepRecord) -> str:
    """Size, cost, contacts and rejections of a step, in sentences."""
    from ..recording.reasons import MEANS, fell_back
    from ..recording.why import lasting

    said = [f"A step of {1e3 * record.h:.3g} ms to t = {record.t:.4g} s took {lasting(record.seconds.get('total', 0.0))}: "
            f"{many(record.solves, 'solve')}, {many(record.iterations, 'iteration')}; "
            f"the largest stretch is {record.stretch:.3f}."]
    if record.contacts or record.layers:
        said.append(f"Cloth touches solids in {many(record.contacts, 'place')}, and cloth in "
                    f"{many(record.layers, 'place')}.")
    if record.fallback_reason:
        said.append(f"It was made by the more robust method: {fell_back(record.fallback_reason)}.")
    if compiling := record.seconds.get("compiling", 0.0):
        said.append(f"Of its time {lasting(compiling)} went into loading or compiling kernels.")
    for name, count in record.rejections.items():
        said.append(f"Before it {many(count, 'longer attempt')} {'was' if count == 1 else 'were'} refused: "
                    f"{MEANS.get(name, name)} ({name}).")
    return " ".join(said)


def costly(session: Session) -> str:
    """The steps of the log that took longest, where cloth was in trouble, and advice; "" before the first."""
    from ..recording.why import costliest_of

    if session.sim is None or not session.sim.log:
        return ""
    return costliest_of([asdict(r) for r in session.sim.log], COSTLY)
