"""Runs tests about contact from starts that differ by a rounding, on one thread and on two: a claim must hold in all of them.

    python scripts/perturb.py                                        # every contact test, 10 starts, 1 and 2 threads: hours
    python scripts/perturb.py --starts 3 --tests tests/unit/test_pinch.py
    python scripts/perturb.py --results perturb.jsonl --out table.md # goes on where it was cut short

Start 0 is the test's own; in each other every vertex that is not held is moved by up to 1e-9 m before the first step
(`perturbing.py`). What does not pass all of them is a bug of the product, or claims more than physics does. Tests that do
not yet hold, and why, are in `EXPECTED`. Prints a Markdown table; exit code 1 where a test failed that is not there.
"""

import argparse
import json
import os
import pathlib
import subprocess
import sys
from collections import Counter
from concurrent.futures import ThreadPoolExecutor

ROOT = pathlib.Path(__file__).resolve().parents[1]
FILES = {
    "unit": ("attach", "cloth_contact", "contact_reference", "ledger", "pinch", "placed_panels", "soft_attach", "solids",
             "swept_detection"),
    "physics": ("body_parts", "closing_bodies", "cloth_on_cloth", "contact_order", "friction", "layer_order", "near_starts",
                "pressed_folds", "resewn", "solid_contact", "tangles"),
    "hard": ("drives", "hard_contact", "hard_layers", "hard_starts", "loaded_edges"),
}
TOUCHES = "add_solid(", "ClothContact("  # a scene with one of these has contact
EXPECTED = {  # part of a test's name: why it may fail
    "comes_near_or_through[1007]": "law of contact with solids: a box comes too near, or through, in steps of 1/15 s",
    "throw_nothing[gaps1]": "law of layers: sheets pinned in one place; a rounding decides on which side each vertex starts",
}
NO_TEST = 5  # pytest's exit code where nothing was collected


def contact_tests() -> list[str]:
    """Arguments for pytest: files about contact, and the checks of scenes that have any."""
    files = [f"tests/{folder}/test_{name}.py" for folder, names in FILES.items() for name in names]
    scenes = [path.stem for path in sorted((ROOT / "scenes").glob("*.py"))
              if any(call in path.read_text(encoding="utf-8") for call in TOUCHES)]
    return files + [f"tests/test_scenes.py::test_scene[{name}]" for name in scenes]


def read_rows(results: pathlib.Path) -> list[dict]:
    """The results so far; a line that was cut off with the run is none."""
    rows = []
    for line in results.read_text(encoding="utf-8").splitlines() if results.exists() else ():
        try:
            rows.append(json.loads(line))
        except ValueError:
            continue
    return rows


def run(start: int, threads: int, longest: float, tests: list[str], results: pathlib.Path) -> None:
    """All tests from one start, in one process, so that each kernel is compiled once; another one where a test ends it."""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), str(ROOT / "scripts")])}
    command = [sys.executable, "-m", "pytest", "-o", "addopts=", "-q", "--runxfail", "--tb=line", "-p", "no:cacheprovider",
               "-p", "perturbing", f"--perturb-start={start}", f"--perturb-threads={threads}",
               f"--perturb-longest={longest}", f"--perturb-results={results}", *tests]
    while True:
        code = subprocess.run(command, cwd=ROOT, env=environment, stdout=subprocess.DEVNULL, stdin=subprocess.DEVNULL,
                              check=False).returncode
        if code in (0, 1, NO_TEST):
            return
        of_this = [row for row in read_rows(results) if (row["start"], row["threads"]) == (start, threads)]
        if code > 1 or not of_this or of_this[-1]["outcome"] != "begun":
            sys.exit(f"start {start}, {threads} threads: pytest ended with exit code {code}")
        with open(results, "a", encoding="utf-8") as file:
            row = {**of_this[-1], "outcome": "failed", "seconds": 0.0, "message": f"the process ended with exit code {code}"}
            file.write(json.dumps(row) + "\n")


def table(rows: list[dict]) -> tuple[list[str], list[str]]:
    """(lines of a Markdown table, the tests that failed and are not expected to)."""
    of_test: dict[str, list[dict]] = {}
    for row in rows:
        if row["outcome"] in ("passed", "failed"):
            of_test.setdefault(row["test"], []).append(row)
    lines, unexpected = ["| test | passed | failed at start/threads | says |", "|---|---|---|---|"], []
    for test, outcomes in of_test.items():
        failed = [row for row in outcomes if row["outcome"] == "failed"]
        passed = len({(row["start"], row["threads"]) for row in outcomes} - {(r["start"], r["threads"]) for r in failed})
        reason = next((why for part, why in EXPECTED.items() if part in test), None)
        said = Counter(row["message"].splitlines()[0][:110] for row in failed if row["message"]).most_common(1)
        where = " ".join(f"{row['start']}/{row['threads']}" for row in failed)
        says = (said[0][0].replace("|", "\\|") if said else "") + (f" ({reason})" if failed and reason else "")
        lines.append(f"| `{test.removeprefix('tests/')}` | {passed} of {passed + len(failed)} | {where} | {says} |")
        unexpected += [test] if failed and reason is None else []
    return lines, unexpected


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--starts", type=int, default=10, help="how many, the tests' own among them")
    parser.add_argument("--first", type=int, default=0, help="the first of them")
    parser.add_argument("--threads", type=int, nargs="+", default=[1, 2])
    parser.add_argument("--workers", type=int, default=1, help="processes at once")
    parser.add_argument("--longest", type=float, default=1e9, metavar="S",
                        help="leave out tests that took longer than so many seconds in a result that is there")
    parser.add_argument("--tests", nargs="+", default=None, help="arguments for pytest; every contact test if left out")
    parser.add_argument("--results", type=pathlib.Path, default=pathlib.Path("perturb.jsonl"),
                        help="file that results are added to; tests with a result there are not run again")
    parser.add_argument("--out", type=pathlib.Path, help="file for the table, which is printed too")
    parser.add_argument("--table", action="store_true", help="only the table of the results so far")
    args = parser.parse_args()
    results, tests = args.results.resolve(), args.tests or contact_tests()
    if not args.table:
        with ThreadPoolExecutor(args.workers) as pool:
            for _ in pool.map(lambda job: run(*job, args.longest, tests, results),
                              [(start, threads) for start in range(args.first, args.first + args.starts)
                               for threads in args.threads]):
                pass
    lines, unexpected = table(read_rows(results))
    print("\n".join(lines))
    if args.out:
        args.out.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return int(bool(unexpected))


if __name__ == "__main__":
    sys.exit(main())
