"""Where the time of a recorded run went: its parts, the worst and the costliest steps, where cloth was in trouble."""

from collections import Counter
from collections.abc import Sequence
from typing import Any

from ..errors import OutputError, many
from ..output.recording import Recording
from ..step.records import Trouble
from ..step.stepper import ADVICE
from .reasons import meaning, refused, remedy, usual, why_refused
from .worst import worst_of

PARTS = {"CG": "linear solves", "EVAL": "forces and their derivatives", "C-S": "contact with solids",
         "C-C": "contact of cloth with cloth"}
SLOWER = 2  # times the solves of half of the steps: with more a step is said to be slow to solve
LEAST, WORTH = 0.005, 0.1  # parts of a run that are told of, and of which it is said how they are less


def costliest(recording: Recording, count: int = 10) -> str:
    """Parts of the time of a run, its worst steps, a paragraph for each of the `count` steps that took longest, and advice.

    Raises:
        OutputError: the run has no steps.
    """
    log = recording.telemetry()
    if not log:
        raise OutputError(f"{recording.path} has no telemetry: nothing was simulated")
    m = recording.manifest
    parts = time_of(m, log)
    return "\n".join([*parts, *worst_of(log), costliest_of(log, count, str(m.get("status", "")))])


def lasting(seconds: float) -> str:
    """A time in words: "12.3 ms", and from a second on "3.3 s"."""
    return f"{seconds:.1f} s" if seconds >= 0.9995 else f"{1e3 * seconds:.3g} ms"


def time_of(manifest: dict[str, Any], log: Sequence[dict[str, Any]]) -> list[str]:
    """Lines on all that a run took: drawing, steps, files, and the rest; none where that is not known.

    Of a run that was gone on with, the time is that of its last part.
    """
    out, steps = manifest.get("output_seconds", {}), log[int(manifest.get("steps_before", 0)):]
    seconds: Counter[str] = Counter()
    for r in steps:
        seconds.update(r["seconds"])
    wall, own = float(manifest.get("wall_s", 0.0)), float(seconds["total"])
    rest = wall - own - sum(out.values())
    if not steps or rest < 0 or wall <= 0:
        return []
    inner = ", ".join(f"{name} {lasting(seconds[key])}" for key, name in PARTS.items() if seconds[key] > LEAST * wall)
    compiling = seconds["compiling"]
    inner += f"; {lasting(compiling)} of these to compile kernels, or to load them" if compiling > LEAST * wall else ""
    fewer = "--no-images draws none, --frames some, --size smaller ones"
    rows = [("drawing pictures", out.get("draw", 0.0), fewer), ("steps", own, inner),
            ("writing files", out.get("write", 0.0), ""), ("setting up and all else", rest, "")]
    rows = sorted((row for row in rows if row[1] > LEAST * wall), key=lambda row: -row[1])
    since = " since it was gone on with" if manifest.get("steps_before") else ""
    return [f"{lasting(wall)} in all{since}:",
            *(f"    {spent / wall:4.0%}  {lasting(spent):>7}  {name}{f': {more}' if more and spent >= WORTH * wall else ''}"
              for name, spent, more in rows)]


def costliest_of(log: Sequence[dict[str, Any]], count: int, status: str = "") -> str:
    """Costliest steps of a log (1 or more), each as telemetry has it; `status` says how they ended."""
    cost = [r["seconds"].get("total", 0.0) for r in log]
    total = max(sum(cost), 1e-300)
    chosen = sorted(range(len(log)), key=lambda k: -cost[k])[:count]
    half, solves = sorted(cost)[len(cost) // 2], sorted(r["solves"] for r in log)[len(log) // 2]
    share = sum(cost[k] for k in chosen) / total
    lines = [f"{many(len(log), 'step')} took {lasting(sum(cost))}, half of them less than {lasting(half)} each; "
             f"{'this one' if len(chosen) == 1 else f'these {len(chosen)}'} took {share:.0%} of it:"]
    for k in chosen:
        r = log[k]
        compiling = r["seconds"].get("compiling", 0.0)
        lines.append(f"step {k} to t = {r['t']:.4g} s: {lasting(cost[k])}, h = {1e3 * r['h']:.3g} ms, "
                     f"{many(r['solves'], 'solve')}, {many(r['iterations'], 'CG iteration')}"
                     + (f"; {lasting(compiling)} of it to compile kernels, or to load them" if compiling else ""))
        for trouble in (Trouble(**t) for t in r.get("troubles", [])):
            if trouble.name:
                lines.append(f"    first tried with h = {1e3 * trouble.h:.3g} ms, and refused: "
                             f"{why_refused(trouble.name, trouble.detail)}, at {trouble}")
            elif r["solves"] > SLOWER * solves:
                lines.append(f"    more solves than usual: most at {trouble}")
    if status.startswith("gave up"):
        lines.append(f"then it {status}")
    return "\n".join([*lines, *_advice(log, status)])


def _advice(log: Sequence[dict[str, Any]], status: str) -> list[str]:
    """Refused attempts of all steps by name, and remedies where they are many."""
    counts: Counter[str] = Counter()
    for r in log:
        counts.update(r.get("rejections", {}))
    h = [r["h"] for r in log]
    bounds = counts.total(), len(log), min(h), max(h)
    if not counts:
        return []
    lines = [f"in all {refused(*bounds)}"]
    gave_up = status.startswith("gave up")
    if not gave_up and usual(*bounds):
        return lines
    troubles = [t for r in log for t in r.get("troubles", [])]
    for name, count in counts.most_common():
        mine = [t for t in troubles if t["name"] == name]
        reasons = Counter(meaning(name, t.get("detail", "")) for t in mine) or {meaning(name, ""): 1}
        advice = f": {remedy(name, all(t['against'] for t in mine))}" if name in ADVICE and not gave_up else ""
        lines.append(f"{name} {count}, {max(reasons, key=lambda why: reasons[why])}{advice}")  # last words have their advice
    return lines
