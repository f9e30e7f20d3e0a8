"""Where a step goes: the files of the package that one step passes, and the calls from one of them to another.

    python scripts/trace_step.py                              # one contact step of sphere_drape with self-contact
    python scripts/trace_step.py --scene layers --cells 10 --until 0.3

The scene runs until the time given, then one step is traced by Python's own profiler hook. A call counts where a
function of one file calls one of another file, directly or through something outside the package. It is upward where the
file called could import the caller and not the other way round: by their places in the imports that the package's
modules make, followed from file to file. A method that overrides one of a base class is called by way of that class's
file: who imports the base may call what implements it.
"""

import argparse
import ast
import pathlib
import sys
from collections import Counter

ROOT = pathlib.Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "scenes")]
PACKAGE = ROOT / "taichi_cloth"
LEFT_OUT = {str(PACKAGE / "backend" / name) for name in ("taichi_patches.py", "shared_kernels.py", "timing.py")}
# what binds kernels to their objects, what Taichi asks at each launch whether one is compiled, and what times methods, are
# no part of where a step goes


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
    """Calls between files, in order, while it is entered."""

    def __init__(self) -> None:
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
        if event not in ("call", "return") or not file.startswith(str(PACKAGE)) or file in LEFT_OUT:
            return
        if event == "return":
            if self.stack:
                self.stack.pop()
            return
        name = str(pathlib.Path(file).relative_to(PACKAGE))
        if self.stack and self.stack[-1] != name:
            function = frame.f_code.co_name
            self.calls.append((self.stack[-1], name, function))
            if (name, function) not in self.declared:
                owner = type(frame.f_locals.get("self"))
                bases = [getattr(sys.modules[c.__module__], "__file__", None) for c in owner.__mro__ if function in vars(c)]
                self.declared[name, function] = {str(pathlib.Path(f).relative_to(PACKAGE)) for f in bases
                                                 if f is not None and f.startswith(str(PACKAGE))}
        self.stack.append(name)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scene", default="sphere_drape")
    parser.add_argument("--cells", type=int, default=36)
    parser.add_argument("--until", type=float, default=0.4, help="simulated seconds before the step that is traced")
    parser.add_argument("--h", type=float, default=1 / 60)
    parser.add_argument("--all", action="store_true", help="prints every call")
    args = parser.parse_args()
    import importlib
    from dataclasses import replace

    import taichi_cloth as tc

    scene = importlib.import_module(args.scene).build(cells=args.cells)
    for k, cloth in enumerate(scene.cloths):
        if cloth.contact is None:
            scene.cloths[k] = replace(cloth, contact=tc.ClothContact(thickness=0.005, friction=0.3))
    sim = tc.Simulation(scene, h=args.h)
    sim.run(args.until, fps=60)
    steps = len(sim.log)
    with Trace() as trace:
        sim.step()
    made = sim.log[steps:]
    solves = sum(record.solves for record in made)
    files = {name for call in trace.calls for name in call[:2]}
    above = reach()
    upward = [c for c in trace.calls if c[0] in above[c[1]]
              and not ({c[0]} | above[c[0]]) & ({c[1]} | trace.declared[c[1], c[2]])]
    seen: set[str] = set()
    back = 0
    for _, name, _ in trace.calls:
        back += name in seen
        seen.add(name)
    print(f"{args.scene}, {args.cells} cells, {sim.vertex_count} vertices, t = {sim.time:.3f} s: {len(made)} steps, "
          f"{solves} solves, {made[-1].contacts} contacts with solids, {made[-1].layers} pairs of cloth")
    print(f"{len(files)} files, {len(trace.calls)} calls between files ({len(trace.calls) / max(solves, 1):.0f} a solve), "
          f"{back} of them into files already visited, {len(upward)} upward")
    for (caller, called, function), n in Counter(upward).most_common():
        print(f"upward: {caller} -> {called}: {function} ({n})")
    if args.all:
        for (caller, called, function), n in Counter(trace.calls).most_common():
            print(f"{n:5} {caller} -> {called}: {function}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
