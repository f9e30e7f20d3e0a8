"""A scene run step by step, and judged by geometry of its own after each: distances, crossings, pins, the log."""

import pathlib
import sys

import numpy as np

sys.path.append(str(pathlib.Path(__file__).resolve().parents[2] / "tests"))
from fuzz import FAILED, GAVE_UP, OK, Outcome  # noqa: E402
from reference.geometry import against_solids, cloth_crossings  # noqa: E402

import taichi_cloth as tc  # noqa: E402

NEAREST = 0.2  # of the thickness that cloth keeps from a solid where there is room
DUST = 1e-3  # of the thickness: the search for the nearest place may be off by so much


def run(code: str, steps: int, precision: str) -> Outcome:
    """Runs lines of code that make `sim`, for a number of steps, and says what went wrong first.

    The lines see `np`, `tc` and `precision`. The vertices that they name `pinned` have to stay to the last bit.
    """
    names = {"np": np, "tc": tc, "precision": precision}
    code = f"import numpy as np\nimport taichi_cloth as tc\nprecision = {precision!r}\n{code}"
    sim = None
    try:
        exec(code, names)  # the case is its own report
        sim = names["sim"]
        return _follow(sim, np.asarray(names["pinned"], dtype=int), steps, code)
    except tc.SimulationError as error:
        return Outcome(GAVE_UP, f"{error}\n{code}\nfor _ in range({steps}):\n    sim.step()")
    finally:
        if sim is not None:
            sim.close()


def _follow(sim, fixed: np.ndarray, steps: int, code: str) -> Outcome:
    start = sim.positions()
    for k in range(1, steps + 1):
        sim.step()
        wrong = _judge(sim, start, fixed)
        if wrong:
            return Outcome(FAILED, f"after {k} steps, at t = {sim.time:.6g} s: {wrong}\n{code}\n"
                                   f"for _ in range({k}):\n    sim.step()")
    return Outcome(OK)


def _judge(sim, start: np.ndarray, fixed: np.ndarray) -> str:
    """What is wrong now, or ""."""
    x = sim.positions()
    if not (np.isfinite(x).all() and np.isfinite(sim.velocities()).all()):
        return "numbers that are not finite"
    if not (x[fixed] == start[fixed]).all():
        return "a pin moved"
    for name, (least, crossed) in against_solids(sim).items():
        if crossed or least < NEAREST - DUST:
            last = sim.log[-1]
            return (f"{name}: {crossed} crossings, nearest {least:.3g} thicknesses; the log has {last.crossings} crossings, "
                    f"{last.pinched} pinched, a step of {last.h:.2g} s")
    if any(c.contact is not None for c in sim.scene.cloths) and (crossed := cloth_crossings(sim)):
        return f"{crossed} crossings of cloth with cloth; the log has {sim.log[-1].tangled} tangled"
    return ""
