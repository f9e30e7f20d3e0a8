"""Does a step with contact converge if it is let, and what does that cost?

    python scripts/study_converged.py
    python scripts/study_converged.py --scenes layers --set cells=12 --until 0.5

Each scene is run as usual, with a Newton method for all of backward Euler's step, and then with what a step accepts made a
hundredth and its limits of rounds ten times as large. A step that converges has little energy unaccounted for and nothing
unsettled then; the most solves of any step, and rejected attempts, say what that costs.
"""

import argparse
import pathlib
import sys

ROOT = pathlib.Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "scripts")]

import results  # noqa: E402
from changed import Change, changed, head, line, plain, run  # noqa: E402

LAYERS = "contact.cloth.layers"
TIGHT: list[Change] = [
    (LAYERS, "AGREED", 1e-3), (LAYERS, "LOOSE", 0.02), (LAYERS, "GIVE", 1e-4),
    (LAYERS, "RUBBED", 5e-4), (LAYERS, "LATER", 30), (LAYERS + ".Layers", "ROUNDS", 120),
    ("contact.contacts", "AGREED", 1e-4), ("step.nonlinear.solid_contact", "ROUNDS", 60),
    ("step.nonlinear.layer_contact", "LATER", 60),
    ("contact.step_start", "OFTEN", 10**9)]
WAYS: dict[str, tuple[list[Change], dict]] = {
    "as it is": ([], {}), "newton_euler": ([], {"integrator": "newton_euler"}),
    "let converge": (TIGHT, {"cg_tol": 1e-6}),
    "newton_euler, let converge": (TIGHT, {"integrator": "newton_euler", "cg_tol": 1e-6})}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenes", nargs="+", default=["sphere_drape", "table", "tablecloth_pull"],
                        help="small ones of scenes/")
    parser.add_argument("--set", nargs="+", default=[], metavar="NAME=VALUE", help="options of the scenes")
    parser.add_argument("--until", type=float, help="simulated seconds")
    parser.add_argument("--json", help="file to write")
    args = parser.parse_args()
    settings, rows = dict(text.split("=", 1) for text in args.set), []
    print(head("way"))
    for scene in args.scenes:
        first = None
        for label, (changes, options) in WAYS.items():
            with changed(changes):
                row = run(scene, settings, args.until, **options)
            first = row["x"] if label == "as it is" else first
            rows.append(plain(row, label))
            print(line(row, label, None if label == "as it is" else first), flush=True)
    results.write(args.json, rows)


if __name__ == "__main__":
    main()
