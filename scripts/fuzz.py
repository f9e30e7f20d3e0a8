"""Random trials: odd scenes, drives, files, drawings, tables, calls and damaged runs, judged from outside.

    python scripts/fuzz.py scenes --seeds 1000:1300
    python scripts/fuzz.py drives --seeds 1000:1100 --precision f32
    python scripts/fuzz.py files --seeds 7          # one trial, again

Each kind is a module in scripts/fuzzing/ with

    def trial(seed: int, precision: str) -> Outcome

which makes its case from the seed alone, and judges what comes of it by what it counts and measures itself
(`from fuzz import FAILED, GAVE_UP, OK, Outcome`; the repository's root and scripts/ are on the path). Trials of one
worker process follow each other; one that crashes or takes too long fails, and a new worker goes on behind it.
Exit code 0 where none failed.
"""

import argparse
import importlib
import multiprocessing
import pathlib
import sys
import traceback
from collections import Counter
from dataclasses import dataclass
from queue import Empty

ROOT = pathlib.Path(__file__).resolve().parents[1]
KINDS = ("scenes", "drives", "files", "drawings", "tables", "calls", "damage")
OK, GAVE_UP, FAILED = "ok", "gave up", "failed"


@dataclass(frozen=True)
class Outcome:
    """What came of a trial.

    Attributes:
        verdict: "ok", "gave up" (a named refusal of something that might have worked) or "failed".
        text: what went wrong, and the case as a few lines of code that make it again.
    """

    verdict: str
    text: str = ""


def work(kind: str, precision: str, seeds, results) -> None:
    """Trials of a worker process, until there is no seed left."""
    sys.path[:0] = [str(ROOT), str(ROOT / "scripts")]
    trial = importlib.import_module(f"fuzzing.{kind}").trial
    while (seed := seeds.get()) is not None:
        try:
            outcome = trial(seed, precision)
        except Exception:  # whatever gets out of a trial is what it is there to find
            outcome = Outcome(FAILED, traceback.format_exc())
        results.put((outcome.verdict, outcome.text))


class Worker:
    """A process that makes one trial after the other, and is replaced where one takes it down."""

    def __init__(self, kind: str, precision: str, timeout: float) -> None:
        self.kind, self.precision, self.timeout = kind, precision, timeout
        self.process: multiprocessing.process.BaseProcess | None = None

    def run(self, seed: int) -> Outcome:
        """One trial."""
        if self.process is None:
            context = multiprocessing.get_context("spawn")
            self.seeds, self.results = context.Queue(), context.Queue()
            args = (self.kind, self.precision, self.seeds, self.results)
            self.process = context.Process(target=work, args=args, daemon=True)
            self.process.start()
        self.seeds.put(seed)
        waited = 0.0
        while waited < self.timeout:
            try:
                return Outcome(*self.results.get(timeout=1.0))
            except Empty:
                waited += 1.0
            if not self.process.is_alive() and self.results.empty():
                code, self.process = self.process.exitcode, None
                return Outcome(FAILED, f"the process died with exit code {code}")
        self.process.kill()
        self.process.join()
        self.process = None
        return Outcome(FAILED, f"no end in {self.timeout:g} s")

    def end(self) -> None:
        """No more trials."""
        if self.process is not None:
            self.seeds.put(None)
            self.process.join(10)
            self.process.kill()


def read_seeds(text: str) -> range:
    """"A:B" (B excluded) or "A"."""
    first, _, end = text.partition(":")
    return range(int(first), int(end) if end else int(first) + 1)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("kind", choices=KINDS)
    parser.add_argument("--seeds", type=read_seeds, required=True, help="A:B, B excluded, or one")
    parser.add_argument("--precision", choices=("f32", "f64"), default="f64")
    parser.add_argument("--timeout", type=float, default=300, help="seconds that a trial may take")
    args = parser.parse_args()
    worker, counts = Worker(args.kind, args.precision, args.timeout), Counter()
    for seed in args.seeds:
        outcome = worker.run(seed)
        counts[outcome.verdict] += 1
        if outcome.verdict != OK:
            print(f"--- {args.kind} {args.precision}, seed {seed}: {outcome.verdict}\n{outcome.text}", flush=True)
    worker.end()
    total = max(sum(counts.values()), 1)
    print(f"{args.kind} {args.precision}, seeds {args.seeds.start}:{args.seeds.stop}: "
          + ", ".join(f"{counts[v]} {v} ({100 * counts[v] / total:.1f} %)" for v in (OK, GAVE_UP, FAILED)))
    return int(counts[FAILED] > 0)


if __name__ == "__main__":
    sys.exit(main())
