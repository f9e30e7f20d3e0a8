"""A scene run step by step, and judged by geometry and energies of its own after each: distances, crossings, pins, energy
against the work that the log has, the log."""

import pathlib
import sys

import numpy as np

sys.path.append(str(pathlib.Path(__file__).resolve().parents[2] / "tests"))
from fuzz import FAILED, GAVE_UP, OK, Outcome  # noqa: E402
from reference.energy import energies  # noqa: E402
from reference.geometry import against_solids, cloth_crossings  # noqa: E402

import taichi_cloth as tc  # noqa: E402

NEAREST = 0.15  # of the thickness that cloth keeps from a solid where there is room
DUST = 1e-3  # of the thickness: the search for the nearest place may be off by so much
WORKS = ("pins", "solids", "pushed_out", "pulled_down", "friction", "layers", "wind")
FALL = 0.1  # m/s
GAINED = 0.03  # of the largest kinetic energy, all work, and gravity's in a step at FALL: what TR-BDF2 may gain and lose again
PINCHED = 0.1  # of all work: the same of backward Euler, in steps too small to be tried smaller
ROUNDING = {"f64": 1e-9, "f32": 1e-3}  # of energies and work
ROUNDED = 16  # times the energy of cloth whose vertices are each off by as much as numbers are rounded


class Balance:
    """Energy from positions and velocities, step by step, against the log's change of it and the log's work."""

    def __init__(self, sim) -> None:
        self.sim, self.steps, self.rounding = sim, 0, ROUNDING[sim.options.precision]
        self.kinetic, potential = energies(sim)
        self.total, self.layers = self.kinetic + potential, 0.0  # J; and stored between layers
        self.work = self.grown = self.lowest = 0.0
        self.fall = float(sim.model.mass.sum() * np.linalg.norm(sim.scene.gravity)) * FALL * sim.control.h_max
        self.floor = sum(_rounded(c, np.finfo(np.float32 if sim.options.precision == "f32" else float).eps)
                         for c in sim.scene.cloths)

    def judge(self) -> str:
        """What is wrong with the last step, or ""."""
        new, (kinetic, potential) = self.sim.log[self.steps:], energies(self.sim)
        layers = new[-1].energies.get("contact", 0.0)
        change = kinetic + potential + layers - self.total - self.layers
        self.steps, self.total, self.layers = len(self.sim.log), kinetic + potential, layers
        self.kinetic = max(self.kinetic, kinetic)
        logged = sum(r.ledger["kinetic"] + r.ledger["potential"] for r in new)
        put_in, works = (sum(size(r.ledger[name]) for r in new for name in WORKS) for size in (float, abs))
        self.work += works
        scale = self.kinetic + abs(potential) + self.work
        rounding = self.rounding * scale + ROUNDED * self.floor
        if abs(change - logged) > rounding:
            return f"energy changed by {change:.6g} J, by the log {logged:.6g} J"
        grown = change - put_in
        self.grown += grown
        self.lowest = min(self.lowest, self.grown)
        robust = all(r.fallback_reason not in ("", "TOUCH") for r in new)
        small = min(r.h for r in new) <= min(self.sim.control.h_max, 1 / 60) / 64
        if robust and grown > rounding + PINCHED * works * small:
            return f"energy grew by {grown:.3g} J beyond the work put in, kinetic {kinetic:.3g} J"
        if self.grown - self.lowest > GAINED * (self.kinetic + self.work + self.fall) + rounding * len(self.sim.log):
            return f"energy grew by {self.grown - self.lowest:.3g} J in all beyond the work put in, kinetic {kinetic:.3g} J"
        return ""


def _rounded(cloth, epsilon: float) -> float:
    """Energy [J] that stretch has where all places are off by an epsilon of the cloth's extent."""
    p = cloth.mesh.corner_uv
    a, b = p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]
    area, edge = np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]) / 2, np.linalg.norm(a, axis=1)
    strain = epsilon * np.abs(cloth.positions).max() / edge
    return float(np.sum(area / 2 * np.max(cloth.fabric.stretch.k) * strain**2))


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
    start, balance = sim.positions(), Balance(sim)
    for k in range(1, steps + 1):
        sim.step()
        wrong = _judge(sim, start, fixed) or balance.judge()
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
            return (f"{name}: {crossed} crossings, nearest {least:.3g} thicknesses; the log has "
                    f"{last.solid_intersections} crossings, "
                    f"{last.pinched} pinched, a step of {last.h:.2g} s")
    if any(c.contact is not None for c in sim.scene.cloths) and (crossed := cloth_crossings(sim)):
        return f"{crossed} crossings of cloth with cloth; the log has {sim.log[-1].known_intersections} tangled"
    return ""
