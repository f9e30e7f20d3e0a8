"""Puts one-line bugs into copies of the project, one at a time, and says which of them the tests notice.

    python scripts/mutate.py                     # every area in scripts/mutations/
    python scripts/mutate.py forces steps        # some of them
    python scripts/mutate.py forces --only shear --jobs 2 --json out.json

A bug is a row of an area's list: a file, a text that occurs in it exactly once, what it becomes, what is wrong then,
and, where the area's own tests would take long, the tests that are to notice it. It is

- noticed: tests fail, do not start, or do not end in time;
- survived: they pass;
- stale: the text is not there, or not once; the list has to follow the code.

An area's tests must pass without any bug first. Exit code 0 where nothing survived and nothing is stale.
"""

import argparse
import importlib.util
import json
import os
import pathlib
import shutil
import signal
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from queue import Queue

ROOT = pathlib.Path(__file__).resolve().parents[1]
LISTS = ROOT / "scripts" / "mutations"
COPIED = ("taichi_cloth", "tests", "scenes", "scripts", "docs", "pyproject.toml", "README.md")
NOTICED, SURVIVED, STALE = "noticed", "survived", "stale"
NO_TEST = 5  # pytest's exit code where nothing was collected


@dataclass(frozen=True)
class Mutation:
    """A one-line bug.

    Attributes:
        area: the list that it stands in.
        file: path from the project's root.
        old: text that occurs in it exactly once; new: what it becomes.
        fault: what is wrong then.
        tests: arguments for pytest.
    """

    area: str
    file: str
    old: str
    new: str
    fault: str
    tests: tuple[str, ...]


@dataclass(frozen=True)
class Result:
    """What became of a bug: `noticed`, `survived` or `stale`, and by what."""

    mutation: Mutation
    outcome: str
    detail: str


def read_list(area: str) -> list[Mutation]:
    """The rows of scripts/mutations/<area>.py."""
    path = LISTS / f"{area}.py"
    if not path.is_file():
        sys.exit(f"no list {path.relative_to(ROOT)}; there are {', '.join(areas())}")
    spec = importlib.util.spec_from_file_location(area, path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return [Mutation(area, *row[:4], tests=tuple(row[4].split()) if len(row) > 4 else tuple(module.TESTS))
            for row in module.MUTATIONS]


def areas() -> list[str]:
    """Names of the lists that there are."""
    return sorted(path.stem for path in LISTS.glob("*.py") if path.stem != "__init__")


class Copy:
    """A copy of the project's files, in which bugs come and go."""

    def __init__(self, folder: pathlib.Path) -> None:
        self.folder = folder
        for name in COPIED:
            source = ROOT / name
            if source.is_dir():
                shutil.copytree(source, folder / name, ignore=shutil.ignore_patterns("__pycache__"))
            elif source.is_file():
                shutil.copy(source, folder / name)
        shared = pathlib.Path(os.environ.get("TAICHI_CLOTH_SHARED", ROOT.parent / "shared"))
        self.environment = {**os.environ, "PYTHONPATH": str(folder), "TAICHI_CLOTH_SHARED": str(shared),
                            "PYTHONDONTWRITEBYTECODE": "1"}

    def run(self, tests: tuple[str, ...], timeout: float) -> tuple[int | None, str]:
        """(pytest's exit code, or None where it did not end in time; the last lines it printed)."""
        command = [sys.executable, "-m", "pytest", "-o", "addopts=", "-x", "-q", "-p", "no:cacheprovider", "--tb=line", *tests]
        process = subprocess.Popen(command, cwd=self.folder, env=self.environment, text=True, stdout=subprocess.PIPE,
                                   stderr=subprocess.STDOUT, stdin=subprocess.DEVNULL, start_new_session=True)
        try:
            output = process.communicate(timeout=timeout)[0]
        except BaseException as error:  # what the tests started ends with them, however this ends
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()
            if not isinstance(error, subprocess.TimeoutExpired):
                raise
            return None, f"no end in {timeout:g} s"
        return process.returncode, output[-4000:]

    def try_out(self, mutation: Mutation, timeout: float) -> Result:
        """Puts a bug in, runs its tests, takes it out again."""
        path = self.folder / mutation.file
        text = path.read_text(encoding="utf-8") if path.is_file() else ""
        if text.count(mutation.old) != 1 or mutation.old == mutation.new:
            return Result(mutation, STALE, f"the text occurs {text.count(mutation.old)} times")
        path.write_text(text.replace(mutation.old, mutation.new), encoding="utf-8")
        try:
            code, output = self.run(mutation.tests, timeout)
        finally:
            path.write_text(text, encoding="utf-8")
        if code == NO_TEST:
            return Result(mutation, STALE, "no test was run")
        if code == 0:
            return Result(mutation, SURVIVED, "skipped only" if " passed" not in output else "")
        failed = [line for line in output.splitlines() if line.startswith(("FAILED", "ERROR"))]
        return Result(mutation, NOTICED, [f"exit code {code}", *output.strip().splitlines(), *failed][-1][:160])


def check_tests(copies: Queue, mutations: list[Mutation], timeout: float) -> None:
    """The tests pass where nothing is wrong; else nothing can be learnt from them."""
    copy = copies.get()
    tests = sorted({test for m in mutations for test in m.tests})
    files = [test for test in tests if "::" not in test]
    whole = [test for test in tests if test in files or test.split("::")[0] not in files]
    code, output = copy.run(tuple(whole), timeout * len(whole))
    copies.put(copy)
    if code != 0:
        sys.exit(f"the tests do not pass without a bug (exit code {code}):\n{output}")


def print_table(results: list[Result]) -> None:
    """A line an area, and every bug that was not noticed."""
    print(f"{'area':12} {'bugs':>5} {'noticed':>8} {'survived':>9} {'stale':>6}")
    for area in [*dict.fromkeys(r.mutation.area for r in results), "all"]:
        mine = [r.outcome for r in results if area in ("all", r.mutation.area)]
        print(f"{area:12} {len(mine):5} {mine.count(NOTICED):8} {mine.count(SURVIVED):9} {mine.count(STALE):6}")
    for r in results:
        if r.outcome != NOTICED:
            m = r.mutation
            print(f"{r.outcome}: [{m.area}] {m.file}: {m.fault}\n    {m.old!r} -> {m.new!r} {r.detail}")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("areas", nargs="*", help="lists in scripts/mutations/; all where none is named")
    parser.add_argument("--only", default="", help="only bugs whose description or file has this text")
    parser.add_argument("--jobs", type=int, default=1, help="bugs tried at a time")
    parser.add_argument("--timeout", type=float, default=600, help="seconds after which tests count as hanging")
    parser.add_argument("--json", type=pathlib.Path, help="where to write the results")
    parser.add_argument("--unchecked", action="store_true", help="does not run the tests without a bug first")
    args = parser.parse_args()
    mutations = [m for area in args.areas or areas() for m in read_list(area)]
    mutations = [m for m in mutations if args.only in m.fault or args.only in m.file]
    with tempfile.TemporaryDirectory() as folder:
        copies: Queue = Queue()
        for k in range(args.jobs):
            copies.put(Copy(pathlib.Path(folder) / str(k)))
        if mutations and not args.unchecked:
            check_tests(copies, mutations, args.timeout)

        def work(mutation: Mutation) -> Result:
            copy = copies.get()
            try:
                result = copy.try_out(mutation, args.timeout)
            finally:
                copies.put(copy)
            print(f"{result.outcome:9} [{mutation.area}] {mutation.fault}  {result.detail}", flush=True)
            return result

        with ThreadPoolExecutor(args.jobs) as pool:
            results = list(pool.map(work, mutations))
    print_table(results)
    if args.json:
        args.json.write_text(json.dumps([asdict(r) for r in results], indent=1), encoding="utf-8")
    return int(any(r.outcome != NOTICED for r in results))


if __name__ == "__main__":
    sys.exit(main())
