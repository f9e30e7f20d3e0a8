"""Contact against its laws: cases with closed forms, from starts that differ by a nanometre, as a table.

    python scripts/contact_laws.py                       # all cases as they are tested: one start, the smallest mesh, 1/60 s
    python scripts/contact_laws.py slip_front capstan --starts 10 --meshes 2 --steps 1/60 1/120 --threads 1 2 --out table.md

Each case is a function in scripts/laws/ whose docstring derives its law. A row of the table is one number of a case, at one
mesh and step; within the tolerance are n of N runs, which differ in start and threads.
"""

import argparse
import math
import pathlib
import sys
import time
from fractions import Fraction

ROOT = pathlib.Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "scripts")]

import numpy as np  # noqa: E402
from laws import CASES  # noqa: E402
from laws.case import SETTINGS, Case, Result  # noqa: E402

from taichi_cloth.errors import ClothError  # noqa: E402

HEAD = "| case | number | cells | step | law | measured: mean | worst | within tolerance |\n|---|---|---|---|---|---|---|---|"


def run(case: Case, h: float, cells: int, start: int, threads: int) -> tuple[Result, ...]:
    """The results of a case; where it gave up by name there is one, NaN."""
    try:
        return case.run(h, cells, start, threads)
    except ClothError as error:
        print(f"{case.name}: {type(error).__name__}: {error}", file=sys.stderr)
        return Result("gave up", math.nan, 0.0, 0.0),


def row(case: Case, cells: int, h: float, results: list[Result]) -> str:
    """A line of the table: runs of one number."""
    r = results[0]
    measured = np.array([result.measured for result in results])
    worst = measured[np.argmax(np.nan_to_num([result.off(result.law) for result in results], nan=np.inf))]
    held = sum(result.holds for result in results)
    sense = "" if r.sense == "=" else r.sense + " "
    return (f"| {case.name} | {r.name} | {cells} | 1/{1 / h:.4g} s | {sense}{r.law:.4g} +- {r.tolerance:.2g} {r.unit} "
            f"| {measured.mean():.4g} | {worst:.4g} | {held} of {len(results)} |")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("cases", nargs="*", metavar="CASE", help=f"of {', '.join(CASES)}")
    parser.add_argument("--starts", type=int, default=1)
    parser.add_argument("--meshes", type=int, default=1, help="of each case's, from the coarsest on")
    parser.add_argument("--steps", type=Fraction, nargs="+", default=[Fraction(1, 60)], help="[s], 1/60 for example")
    parser.add_argument("--threads", type=int, nargs="+", default=[1])
    parser.add_argument("--contact-tol", type=float, help="solve contact with solids to this (see docs/contact-laws.md)")
    parser.add_argument("--integrator", help="bdf2 for example, of second order in contact")
    parser.add_argument("--out", type=pathlib.Path, help="a file for the table, beside what is printed")
    args = parser.parse_args()
    if unknown := set(args.cases) - set(CASES):
        parser.error(f"no case {', '.join(sorted(unknown))}; there are {', '.join(CASES)}")
    SETTINGS.update({name: value for name in ("contact_tol", "integrator") if (value := getattr(args, name)) is not None})
    chosen = [CASES[name] for name in args.cases or CASES]
    results: dict[tuple, list[Result]] = {}
    for threads in args.threads:  # outermost: each number of threads starts Taichi anew
        for case in chosen:
            for key in [(cells, float(h)) for cells in case.cells[:args.meshes] for h in args.steps]:
                began = time.process_time()
                for start in range(args.starts):
                    for r in run(case, key[1], key[0], start, threads):
                        results.setdefault((case.name, *key, r.name), []).append(r)
                print(f"{case.name} {key[0]} cells, h {key[1]:.4g} s, {threads} threads: "
                      f"{(time.process_time() - began) / args.starts:.1f} s a run", file=sys.stderr, flush=True)
    lines = [row(CASES[name], cells, h, held) for (name, cells, h, _), held in results.items()]
    table = "\n".join([HEAD, *lines])
    print(table)
    if args.out:
        args.out.write_text(table + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
