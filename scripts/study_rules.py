"""What a constant or a rule is worth: scenes with it switched off or changed, beside the same scenes as they are.

    python scripts/study_rules.py                                      # the rules named here, on three scenes
    python scripts/study_rules.py --scenes fold --without "no brake: step.nonlinear.energy.MOST=0.0"
    python scripts/study_rules.py --without "both: contact.step_start.OFTEN=1000, contact.growth.NEAR=0.0"

A change is a dotted module within the package, a name in it, and a Python value. `off` is how far a vertex ends from where it
ends without changes, `digits` how many of its size's decimal digits are the same. Two rows of a scene "as it is" that differ
say how far apart runs are by themselves: that is the last row, whose solves are a hundredth more exact.
"""

import argparse
import ast
import pathlib
import sys

ROOT = pathlib.Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "scripts")]

import results  # noqa: E402
from changed import Change, changed, head, line, plain, run  # noqa: E402

MANY = 10**9
RULES: dict[str, list[Change]] = {
    "forcing_terms": [("contact.step_start", "OFTEN", MANY)],
    "rough further solves": [("step.nonlinear.layer_contact", "LOOSER", 1.0), ("step.nonlinear.layer_contact", "ROUGH", 0.0),
                             ("step.nonlinear.newton", "FURTHER", 0.0)],
    "brake": [("step.nonlinear.euler", "LIGHT", 0.0), ("step.nonlinear.euler", "MOST", 0.0),
              ("step.nonlinear.layer_contact", "MOST", 0.0)],
    "stiffer layers": [("contact.cloth.contact_pairs", "STIFFER", 1.0)],
    "stiffer edges of solids": [("contact.solid.pairs", "TIMES", MANY)],
    "looser law of contact": [("contact.contacts", "AGREED", 0.02)],
    "planes that follow": [("contact.solid.balance", "MET", MANY)],
    "growth of thickness": [("contact.growth", "NEAR", 0.0)],
}


def read(text: str) -> tuple[str, list[Change]]:
    """(label, changes) of "LABEL: MODULE.NAME=VALUE, ..."."""
    label, colon, rest = text.partition(":")
    try:
        pairs = [part.split("=") for part in (rest if colon else text).split(",")]
        return label.strip(), [(*place.strip().rsplit(".", 1), ast.literal_eval(value.strip())) for place, value in pairs]
    except (ValueError, SyntaxError):
        raise argparse.ArgumentTypeError(f'{text!r} is not like "LABEL: MODULE.NAME=VALUE, ..."') from None


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenes", nargs="+", default=["sphere_drape", "fold", "tablecloth_pull"],
                        help="small ones of scenes/")
    parser.add_argument("--set", nargs="+", default=[], metavar="NAME=VALUE", help="options of the scenes")
    parser.add_argument("--without", type=read, nargs="+", help="changes, instead of the rules named in this file")
    parser.add_argument("--until", type=float, help="simulated seconds")
    parser.add_argument("--json", help="file to write")
    args = parser.parse_args()
    settings = dict(text.split("=", 1) for text in args.set)
    rows = []
    print(head("without"))
    for scene in args.scenes:
        first = run(scene, settings, args.until)
        rows.append(plain(first, "as it is"))
        print(line(first, "as it is", None), flush=True)
        for label, changes in args.without or RULES.items():
            with changed(changes):
                row = run(scene, settings, args.until)
            rows.append(plain(row, label))
            print(line(row, label, first["x"]), flush=True)
        row = run(scene, settings, args.until, cg_tol=1e-6)
        rows.append(plain(row, "as it is, cg_tol 1e-6"))
        print(line(row, "as it is, cg_tol 1e-6", first["x"]), flush=True)
    results.write(args.json, rows)


if __name__ == "__main__":
    main()
