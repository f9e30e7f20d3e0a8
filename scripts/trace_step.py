"""Where a step goes: files of the package that one step passes, calls from one to another, and functions.

    python scripts/trace_step.py                                       # the table of docs/architecture.md
    python scripts/trace_step.py --scene layers --cells 10 --until 0.3 --calls

A scene runs until the time given, then Python's own profiler hook traces one step. Everything of the package counts, launches
of kernels too. A call counts where a function of one file calls one of another file, directly or through something outside
the package. It is upward where the file called could import the caller and not the other way round: by their places in the
imports that the package's modules make, followed from file to file. A method that overrides one of a base class is called by
way of that class's file: who imports the base may call its overrides. Wrappers, such as those that time methods or bind
kernels to their objects, call on behalf of others, so no call from or to them is upward. That of `keywords.py`, which only
hands public calls on, is left out.
"""

import argparse
import ast
import importlib
import pathlib
import sys
from collections import Counter
from dataclasses import dataclass, field

ROOT = pathlib.Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "scenes")]
PACKAGE = ROOT / "taichi_cloth"
WRAPPERS = {f"backend/{name}.py" for name in ("launches", "taichi_patches", "shared_kernels", "timing")}
HANDS_ON = str(PACKAGE / "keywords.py")
CASES = {"`hang`, 51 x 51": ("hang", 50, 0.05), "`sphere_drape`, 36 cells": ("sphere_drape", 36, 0.3),
         "`layers`, 24 cells": ("layers", 24, 0.2)}  # name: scene, cells, simulated seconds before the step


def imported(path: pathlib.Path) -> set[str]:
    """Files of the package that a file imports anywhere in it, from the package's folder."""
    out = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if not (isinstance(node, ast.ImportFrom) and node.level):
            continue
        base = path.parent
        for _ in range(node.level - 1):
            base = base.parent
        target = base.joinpath(*node.module.split(".")) if node.module else base
        for found in [target, *(target / alias.name for alias in node.names)]:
            for file in (found.with_suffix(".py"), found / "__init__.py"):
                if file.is_file():
                    out.add(str(file.relative_to(PACKAGE)))
    return out


def reach() -> dict[str, set[str]]:
    """All files that each file imports, by however many others."""
    direct = {str(p.relative_to(PACKAGE)): imported(p) for p in PACKAGE.rglob("*.py")}
    out = {}
    for name in direct:
        seen, left = set(), [name]
        while left:
            for other in direct[left.pop()] - seen:
                seen.add(other)
                left.append(other)
        out[name] = seen
    return out


class Trace:
    """Functions and calls between files, in order, while it is entered."""

    def __init__(self) -> None:
        self.functions: Counter[tuple[str, str]] = Counter()  # file, function
        self.calls: list[tuple[str, str, str]] = []  # caller's file, file called, function
        self.declared: dict[tuple[str, str], set[str]] = {}  # by file and function: files of bases that declare it
        self.stack: list[str] = []

    def __enter__(self) -> "Trace":
        sys.setprofile(self._event)
        return self

    def __exit__(self, *_) -> None:
        sys.setprofile(None)

    def _event(self, frame, event: str, _arg) -> None:
        file = frame.f_code.co_filename
        if event not in ("call", "return") or not file.startswith(str(PACKAGE)) or file == HANDS_ON:
            return
        if event == "return":
            if self.stack:
                self.stack.pop()
            return
        name = str(pathlib.Path(file).relative_to(PACKAGE))
        self.functions[name, frame.f_code.co_qualname if sys.version_info >= (3, 11) else frame.f_code.co_name] += 1
        if self.stack and self.stack[-1] != name:
            function = frame.f_code.co_name
            self.calls.append((self.stack[-1], name, function))
            if (name, function) not in self.declared:
                owner = type(frame.f_locals.get("self"))
                bases = [getattr(sys.modules[c.__module__], "__file__", None) for c in owner.__mro__ if function in vars(c)]
                self.declared[name, function] = {str(pathlib.Path(f).relative_to(PACKAGE)) for f in bases
                                                 if f is not None and f.startswith(str(PACKAGE))}
        self.stack.append(name)

    @property
    def files(self) -> set[str]:
        """Files that any function called is in."""
        return {name for name, _ in self.functions}

    def upward(self) -> list[tuple[str, str, str]]:
        """Calls of a file that could import the caller, and that the caller could not import."""
        above = reach()
        return [c for c in self.calls if not WRAPPERS & {c[0], c[1]} and c[0] in above[c[1]]
                and not ({c[0]} | above[c[0]]) & ({c[1]} | self.declared[c[1], c[2]])]


@dataclass
class Traced:
    """One step and its trace."""

    trace: Trace
    solves: int
    about: str = field(repr=False)


def traced(scene: str, cells: int, until: float, h: float) -> Traced:
    """Runs a scene to a time [s] by steps of h [s] and traces the next step."""
    import taichi_cloth as tc
    from taichi_cloth.backend import placement

    sim = tc.Simulation(importlib.import_module(scene).build(cells=cells), h=h)
    sim.run(until, fps=60)
    placement.mind()  # looks twice a second only, so that the step does not
    steps = len(sim.log)
    with Trace() as trace:
        sim.step()
    made = sim.log[steps:]
    return Traced(trace, sum(record.solves for record in made), f"{scene}, {cells} cells, {sim.vertex_count} vertices, "
                  f"t = {sim.time:.3f} s: {len(made)} steps, {made[-1].contacts} contacts with solids, "
                  f"{made[-1].layers} pairs of cloth")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scene", help="one of scenes/, in place of those of the table")
    parser.add_argument("--cells", type=int, default=36)
    parser.add_argument("--until", type=float, default=0.4, help="simulated seconds before the step that is traced")
    parser.add_argument("--h", type=float, default=1 / 60)
    parser.add_argument("--calls", action="store_true", help="prints every call between files, the most frequent first")
    args = parser.parse_args()
    cases = CASES if args.scene is None else {args.scene: (args.scene, args.cells, args.until)}
    done = {name: traced(*case, args.h) for name, case in cases.items()}
    print("| one step | solves | files | calls between files | functions |\n| --- | --- | --- | --- | --- |")
    for name, step in done.items():
        print(f"| {name} | {step.solves} | {len(step.trace.files)} | {len(step.trace.calls)} | {len(step.trace.functions)} |")
    for step in done.values():
        print(step.about)
        for (caller, called, function), n in Counter(step.trace.upward()).most_common():
            print(f"upward: {caller} -> {called}: {function} ({n})")
        for (caller, called, function), n in Counter(step.trace.calls).most_common() if args.calls else ():
            print(f"{n:5} {caller} -> {called}: {function}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
