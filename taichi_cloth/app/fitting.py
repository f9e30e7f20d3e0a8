"""The command `fit`: fabric parameters from measurements in a CSV file."""

import argparse
import os
import sys

from .flags import number_of


def add_parser(commands) -> None:
    """`fit` and its flags."""
    parser = commands.add_parser("fit", help="fabric parameters from measured drape, cantilever, strip or swing, with their "
                                             "uncertainty")
    add = parser.add_argument
    add("kind", help="cantilever, strip, drape or swing")
    add("data", help="CSV: length and drop or angle; strain and tension or force; coefficient; time and x; and sigma")
    add("--out", metavar="DIR", help="folder for fit.json, fit.csv and fit.svg")
    add("--density", type=number_of, metavar="KG/M2", help="of the cloth")
    add("--width", type=number_of, metavar="M", help="of the strip")
    add("--length", type=number_of, metavar="M", help="of the swinging strip")
    add("--find", metavar="NAME", help="of a strip k or k,limit; of a swing air (its drag) or k_d (damping of bending)")
    add("--range", dest="range_", metavar="LOW:HIGH", help="values that are simulated, of drape and swing")
    add("--D", type=number_of, default=1e-5, metavar="NM", help="rigidity of the swinging strip (1e-5)")
    add("--k", type=number_of, default=1000.0, metavar="N/M", help="stretch stiffness in simulations (1000)")
    add("--confidence", type=number_of, default=0.95, metavar="P", help="of the intervals (0.95)")
    add("--rings", type=int, default=15, metavar="N", help="of the draping disk's mesh (15)")
    add("--cells", type=int, default=12, metavar="N", help="along the swinging strip (12)")
    add("--h", type=number_of, default=1 / 240, metavar="S", help="steps of the swing (1/240)")
    add("--workers", type=int, metavar="N", help="as of sweep: processes; 0: one run after the other")


def run(args: argparse.Namespace) -> int:
    """Fits; returns the exit code."""
    from ..errors import SceneError
    from ..fitting.fit import fit

    span = None
    if args.range_ is not None:
        low, _, high = args.range_.partition(":")
        try:
            span = number_of(low), number_of(high)
        except argparse.ArgumentTypeError:
            raise SceneError(f"--range {args.range_!r}: needs LOW:HIGH") from None
    if args.out == "":
        raise SceneError("--out '': needs a folder's name")
    names = ("density", "width", "length", "find", "D", "k", "confidence", "rings", "cells", "h", "workers", "out")
    made = fit(args.kind, args.data, range_=span, say=lambda text: print(text, file=sys.stderr, flush=True),
               **{name: getattr(args, name) for name in names})
    print(made)
    if args.out:
        print(f"written to {args.out}{os.sep}")
    return 0
