"""Scenes run with constants of the package changed: what `study_rules.py` and `study_converged.py` have in common.

A change is (module, name, value): `module` is dotted and within the package, and may end in a class; `name` is what it has by
that name. Only what Python reads at run time can be changed: a number inside a kernel is compiled into it.
"""

import contextlib
import importlib
import pathlib
import time
from collections.abc import Iterable, Iterator

import numpy as np

import taichi_cloth as tc
from taichi_cloth.app import scenefile

SCENES = pathlib.Path(__file__).resolve().parents[1] / "scenes"
Change = tuple[str, str, object]


def owner(where: str) -> object:
    """The module, or the class in it, that a dotted name within the package means.

    Raises:
        SystemExit: there is none.
    """
    head, _, last = where.rpartition(".")
    for module, part in ((where, ""), (head, last)):
        with contextlib.suppress(ModuleNotFoundError):
            found = importlib.import_module(f"taichi_cloth.{module}" if module else "taichi_cloth")
            if not part or hasattr(found, part):
                return getattr(found, part) if part else found
    raise SystemExit(f"taichi_cloth has no module or class {where}")


@contextlib.contextmanager
def changed(changes: Iterable[Change]) -> Iterator[None]:
    """Within it, names have other values.

    Raises:
        SystemExit: a module has no such name, which would change nothing.
    """
    before = []
    try:
        for where, name, value in changes:
            place = owner(where)
            if name not in vars(place):
                raise SystemExit(f"taichi_cloth.{where} has no {name} of its own")
            before.append((place, name, vars(place)[name]))
            setattr(place, name, value)
        yield
    finally:
        for place, name, value in reversed(before):
            setattr(place, name, value)


def run(scene: str, settings: dict, until: float | None, **options: object) -> dict:
    """A scene of scenes/ by name, with its own options and others: what it took, and where it ended.

    Returns:
        a row: time [s], steps, solves, the most in a step, CG iterations, rejected attempts, unsettled contacts, what energy
        is unaccounted for and how much went through [J], time without compilation [s], crossings, why it gave up, and
        positions x (n, 3) [m].
    """
    found = scenefile.read(str(SCENES / f"{scene}.py"))
    usual = {name: value for name, value in found.run.items() if name not in ("duration", "fps")}
    until = found.run.get("duration", 1.0) if until is None else until
    with tc.Simulation(found.make(found.small | settings), **{"threads": 1, **usual, **options}) as sim:
        began, gave_up = time.perf_counter(), ""
        try:
            sim.run(until, 60)
        except tc.ClothError as error:
            gave_up = f"{type(error).__name__}: {error}"
        log = sim.log
        used = time.perf_counter() - began - sum(r.seconds.get("compiling", 0.0) for r in log)
        ledgers = [r.ledger for r in log if r.ledger]
        return {"scene": scene, "time": sim.time, "steps": len(log), "solves": sum(r.solves for r in log),
                "most": max((r.solves for r in log), default=0), "iterations": sum(r.iterations for r in log),
                "rejected": sum(sum(r.rejections.values()) for r in log),
                "unsettled": sum(r.unconverged_contacts for r in log),
                "unaccounted": sum(abs(ledger["unaccounted"]) for ledger in ledgers),
                "through": sum(abs(value) for ledger in ledgers for value in ledger.values()) / 2,
                "wall": used, "crossings": sim.intersections(), "gave_up": gave_up, "x": np.array(sim.positions())}


def off(x: np.ndarray, y: np.ndarray) -> float:
    """Largest distance [m] between positions (n, 3) of two runs."""
    return float(np.linalg.norm(x - y, axis=1).max())


def digits(x: np.ndarray, y: np.ndarray) -> float:
    """Decimal digits that two runs have in common, of the size of what moved there; 16 where they are equal."""
    size = float(np.ptp(x, axis=0).max())
    return 16.0 if off(x, y) == 0 else float(np.clip(-np.log10(off(x, y) / size), 0.0, 16.0))


HEAD = ("| scene | {} | steps | solves | most | CG | rejected | unsettled | unaccounted / through [J] "
        "| off [m] | digits | wall [s] |")


def head(column: str) -> str:
    """The table's first lines; `column` says what differs between rows."""
    first = HEAD.format(column)
    return first + "\n" + "|---" * (first.count("|") - 1) + "|"


def line(row: dict, label: str, first: np.ndarray | None) -> str:
    """A row of the table; `first` are positions that it is compared with, None for the row that others are compared with."""
    same = first is not None and not row["gave_up"]
    compared = f"{off(row['x'], first):.2g} | {digits(row['x'], first):.1f}" if same else " | "
    return (f"| {row['scene']} | {label} | {row['steps']} | {row['solves']} | {row['most']} | {row['iterations']} "
            f"| {row['rejected']} | {row['unsettled']} | {row['unaccounted']:.2g} / {row['through']:.2g} | {compared} "
            f"| {row['wall']:.1f} |" + (f" gave up at {row['time']:.3f} s: {row['gave_up'][:80]}" if row["gave_up"] else ""))


def plain(row: dict, label: str) -> dict:
    """A row as it can be written to a file."""
    return {name: value for name, value in row.items() if name != "x"} | {"label": label}
