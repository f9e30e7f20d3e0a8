"""Costliest steps of a recorded run, the places where cloth was in trouble then, and remedies."""

from collections.abc import Sequence
from typing import Any

from ..errors import OutputError
from ..output.recording import Recording
from ..step.records import Trouble
from ..step.stepper import ADVICE


def costliest(recording: Recording, count: int = 10) -> str:
    """A paragraph for each of the `count` steps that took longest, in the order of their cost, and advice.

    Raises:
        OutputError: the run has no steps.
    """
    log = recording.telemetry()
    if not log:
        raise OutputError(f"{recording.path} has no telemetry: nothing was simulated")
    return costliest_of(log, count, str(recording.manifest.get("status", "")))


def lasting(seconds: float) -> str:
    """A time in words: "12.3 ms", and from a second on "3.3 s"."""
    return f"{seconds:.1f} s" if seconds >= 0.9995 else f"{1e3 * seconds:.3g} ms"


def costliest_of(log: Sequence[dict[str, Any]], count: int, status: str = "") -> str:
    """The same of the steps of a log (1 or more), each as telemetry has it; `status` says how they ended."""
    cost = [r["seconds"].get("total", 0.0) for r in log]
    total = max(sum(cost), 1e-300)
    chosen = sorted(range(len(log)), key=lambda k: -cost[k])[:count]
    usual = sorted(cost)[len(cost) // 2]
    share = sum(cost[k] for k in chosen) / total
    lines = [f"{len(log)} steps took {sum(cost):.3g} s, half of them less than {lasting(usual)} each; these {len(chosen)} "
             f"took {share:.0%} of it:"]
    names: list[str] = []
    for k in chosen:
        r = log[k]
        compiling = r["seconds"].get("compiling", 0.0)
        lines.append(f"step {k} to t = {r['t']:.4g} s: {lasting(cost[k])}, h = {1e3 * r['h']:.3g} ms, "
                     f"{r['solves']} solves, {r['iterations']} CG iterations"
                     + (f"; {lasting(compiling)} of it to compile kernels, or to load them" if compiling else ""))
        for trouble in (Trouble(**t) for t in r.get("troubles", [])):
            names += [trouble.name] * (trouble.name in ADVICE)
            what = f"{trouble.name} at h = {1e3 * trouble.h:.3g} ms" if trouble.name else "slow to solve"
            detail = f" ({trouble.detail})" if trouble.detail else ""
            lines.append(f"    {what}{detail}: {trouble}")
    if status.startswith("gave up"):
        lines.append(f"then it {status}")
    lines += [f"{name}: {ADVICE[name]}" for name in sorted(set(names), key=names.index)]
    return "\n".join(lines)
