"""Commands that compare a scene with exact solutions and identities: study and verify."""

import argparse
import pathlib
from collections.abc import Callable

from .flags import number_of

STEPS = "1/30,1/60,1/120,1/240"
METHODS = "safe,verlet,backward_euler,newton_euler"


def add_parsers(commands) -> None:
    """Adds the commands."""
    study = commands.add_parser("study", help="error against cost of every method on a scene")
    study.add_argument("scene", help="a scene file or name")
    study.add_argument("--out", metavar="DIR", help="folder for study.json, study.csv and study.svg")
    study.add_argument("--duration", type=number_of, metavar="S", default=0.5, help="simulated time [s] (0.5)")
    study.add_argument("--integrators", metavar="A,B",
                       help=f"methods ({METHODS}; explicit ones where nothing touches)")
    study.add_argument("--h", default=STEPS, metavar="S,S", help=f"steps [s] ({STEPS})")
    study.add_argument("--tolerances", default="1e-2,1e-3", metavar="M,M", help="errors asked for [m]; empty for none")
    study.add_argument("--cg-tols", dest="cg_tols", default="", metavar="X,X", help="relative residuals; each method's own")
    study.add_argument("--substeps", default="1,3", metavar="X,X",
                       help="substeps of verlet, in stable ones; above 1 it softens triangles that are too stiff (1,3)")
    study.add_argument("--precision", default="f64", metavar="A,B", help="f64, f32 or both")
    study.add_argument("--arch", default="cpu", metavar="A,B", help="such as cpu,cuda")
    study.add_argument("--reference-h", dest="reference_h", type=number_of, default=1 / 1000, metavar="S",
                       help="step of the implicit reference, for scenes with solids; halved once (1/1000)")
    verify = commands.add_parser("verify", help="derivatives, momentum, constraints and solver on a scene, with figures")
    verify.add_argument("scene", help="a scene file or name")
    verify.add_argument("--time", type=number_of, metavar="S", default=0.2, help="when the scene is looked at [s] (0.2)")
    for parser in (study, verify):
        parser.add_argument("--set", action="append", default=[], metavar="NAME=VALUE", help="an option of the scene")
        parser.add_argument("--small", action="store_true", help="with the scene's quick options")


def _study(args: argparse.Namespace) -> int:
    from ..errors import OutputError, SceneError
    from ..output.folder import write_whole
    from ..output.plot import as_file, line_plot

    scene, settings = _scene_of(args)
    from ..studies.study import as_csv, as_json, cases_of, curves, methods_for, study, table

    def numbers(text: str) -> list[float]:
        try:
            return [number_of(part) for part in text.split(",") if part]
        except (ValueError, argparse.ArgumentTypeError):
            raise SceneError(f"{text!r}: needs numbers with commas between them") from None

    steps = numbers(args.h)
    if not steps:
        raise SceneError("--h: needs at least one step")
    methods = (args.integrators or METHODS).split(",")
    if args.integrators is None:
        methods = methods_for(methods, scene.make(settings))
    cases = cases_of(methods, steps, numbers(args.tolerances), [*numbers(args.cg_tols)] or [None],
                     args.precision.split(","), args.arch.split(","), max(steps), numbers(args.substeps))
    folder = pathlib.Path(args.out) if args.out else None
    if folder:
        try:
            folder.mkdir(parents=True, exist_ok=True)  # before anything is computed for it
        except OSError as error:
            raise OutputError(f"cannot write to {folder}: {error.strerror or error}") from None
    made = study(scene.name, lambda: scene.make(settings), cases, args.duration, args.reference_h, say=_say)
    if folder:
        plot = as_file(line_plot(curves(made), "wall time [s]; up: RMS error [m]", log=True, log_x=True, marks=True))
        for name, text in (("study.json", as_json(made)), ("study.csv", as_csv(made)), ("study.svg", plot)):
            write_whole(folder / name, text.encode())
    print(table(made), *([f"written to {folder}/"] if folder else []), sep="\n")
    return 0


def _verify(args: argparse.Namespace) -> int:
    scene, settings = _scene_of(args)
    from ..studies.verify import verify

    passed = True
    for name, figure, good in verify(lambda: scene.make(settings), args.time):
        print(f"{'ok    ' if good else 'FAILED'} {name}: {figure}", flush=True)
        passed &= good
    return 0 if passed else 1


def _scene_of(args: argparse.Namespace):
    """The scene file and its settings, with which it can be built."""
    from ..errors import SceneError
    from . import scenefile

    scene = scenefile.read(args.scene)
    settings = dict(scene.small) if args.small else {}
    for item in args.set:
        name, equals, value = item.partition("=")
        if not equals:
            raise SceneError(f"--set {item!r}: needs name=value")
        settings[name] = value
    scene.make(settings)  # a wrong option is refused before Taichi is imported
    return scene, settings


def _say(text: str) -> None:
    import sys

    print(text, file=sys.stderr, flush=True)


COMMANDS: dict[str, Callable[[argparse.Namespace], int]] = {"study": _study, "verify": _verify}
