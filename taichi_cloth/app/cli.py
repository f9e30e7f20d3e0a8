"""Command line: run, list, check, doctor; the commands on finished runs are in `recorded`.

Heavy imports happen inside the commands, so that --help is instant.
"""

import argparse
import os
import pathlib
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import Field, replace

from .. import __version__
from ..options import ARCHS, BY_NAME, MOST_FRAMES
from . import dressing, fitting, looking, sweeping, taking, viewing
from . import recorded as cli_recorded
from . import studies as cli_study
from .flags import Parser, number_of
from .look_flags import frame_flags, look_flags, look_of, passes_of
from .recorded import size_of

DURATION, FPS = 2.0, 30.0  # s, frames a second, where neither flags nor the scene say
SHOWN = ("While it runs: the frame and how many there are; simulated time; how long it still takes, as frames took so far; "
         "how many steps went wrong and were tried again, smaller; the last time step's size and its solver's iterations "
         "(many: stiff cloth or a fine mesh).")
OK, FAILED, BAD_USAGE, GAVE_UP, OWN_CODE, INTERRUPTED, UNREAD = 0, 1, 2, 3, 4, 130, 141


def main(argv: Sequence[str] | None = None) -> int:
    """Runs a command.

    Returns:
        The exit code: 0 ok, 1 check failed, 2 bad scene or usage, 3 gave up, 4 an exception of the scene's own code while it
        runs, 130 interrupted, 141 nobody reads its output.
    """
    return _guard(lambda: _dispatch(_parser().parse_args(argv)))


def run(build: Callable, argv: Sequence[str] | None = None) -> None:
    """Makes `python scenes/x.py` take the flags of `taichi-cloth run`; ends the process with its exit code.

    Args:
        build: the scene's build function; `check`, `RUN` and `SMALL` are taken from its module.
        argv: flags; the process's own if None.
    """
    from .. import checks
    from ..scene.reading import only_described

    only_described("tc.run")
    checks.function("run: build", build)
    if argv is not None and not (isinstance(argv, (list, tuple)) and all(isinstance(a, str) for a in argv)):
        checks.instance("run: argv", argv, type(None))
    parser = Parser(description=sys.modules[build.__module__].__doc__)
    parser.set_defaults(scene=getattr(sys.modules[build.__module__], "__file__", None))  # for --help
    _run_flags(parser)

    def go() -> int:
        from . import scenefile

        return _run(parser.parse_args(argv), scenefile.of_module(build))

    sys.exit(_guard(go))


def _dispatch(args: argparse.Namespace) -> int:
    from . import scenefile

    if args.command == "list":
        return _list(args)
    if args.command == "doctor":
        return _doctor()
    if args.command == "fabrics":
        from ..scene.fabrics import table

        print(table())
        return OK
    if args.command == "winds":
        return _winds(args)
    if args.command == "dress":
        return dressing.run(args)
    if args.command == "take":
        return taking.run(args)
    if args.command == "look":
        return looking.run(args)
    if args.command in cli_recorded.COMMANDS:
        return cli_recorded.COMMANDS[args.command](args)
    if args.command in cli_study.COMMANDS:
        return cli_study.COMMANDS[args.command](args)
    if args.command == "fit":
        return fitting.run(args)
    if args.command == "sweep":
        return _sweep(args)
    if args.command == "view":
        return viewing.run(args, lambda: _scene(args), _options)
    return _run(args, _scene(args)) if args.command == "run" else _check(args, scenefile.checked(_scene(args)))


def _scene(args: argparse.Namespace):
    """The scene file that is meant; says where it is one of the user's."""
    from . import scenefile

    scene, mine = scenefile.read(args.scene), scenefile.own(args.scene)
    if mine:
        print(f"note: scene {args.scene} is {mine}", file=sys.stderr)
    return scene


def _guard(work: Callable[[], int]) -> int:
    from ..backend.interrupts import raised
    from ..errors import ClothError, ScriptError
    from .notes import warnings_as_notes
    from .scenefile import own_lines

    try:
        with raised(), warnings_as_notes():
            try:
                return work()
            finally:
                print(end="", flush=True)  # here, not at exit, a pipe that was closed is met
    except ClothError as error:
        if isinstance(error, ScriptError):
            print(own_lines(error.__cause__ or error), end="", file=sys.stderr)
        print(f"error: {error}", file=sys.stderr)
        return error.exit_code
    except KeyboardInterrupt:
        print("interrupted: every finished frame is whole", file=sys.stderr)
        return INTERRUPTED
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # for the flush at exit
        return UNREAD


def _run(args: argparse.Namespace, scene) -> int:
    started = time.perf_counter()
    quicker = f"--small takes the scene's quick options, {' '.join(_settings(scene.small))}"
    options = replace(_options(_small(args, scene), scene), quicker=quicker if scene.small and not args.small else "")
    sim, start = _simulated(scene, options)
    from .summary import describe

    spent = _spent(options)
    print(describe(sim, time.perf_counter() - started, start, options.out, args.verbose, spent))
    if options.out:
        drawn = "images/ (--no-images draws none, --size WxH smaller ones)" if options.size else ""
        print(f"written to {options.out}/{drawn}")
    return OK


def _spent(options) -> dict[str, float]:
    """Seconds that a run took to draw and to write, by its folder."""
    from ..output.recording import Recording

    return Recording(options.out).manifest.get("output_seconds", {}) if options.out else {}


def _simulated(scene, options) -> tuple:
    """The run of a scene. What is wrong with its folder or its options is refused before Taichi is imported."""
    if options.out and not options.resume:
        from ..output.folder import free_for_a_run
        from .runoptions import INSTEAD

        free_for_a_run(pathlib.Path(options.out), options.overwrite, INSTEAD)
    built = None if options.resume else scene.make(options.settings)
    from .runner import simulate

    return simulate(scene, options, built=built)


def _check(args: argparse.Namespace, scene) -> int:
    from .scenefile import run_check

    sim, passed = _simulated(scene, _options(_small(args, scene), scene))[0], True
    for sentence, good in run_check(scene, sim):
        print(f"{'ok    ' if good else 'FAILED'} {sentence}")
        passed &= bool(good)
    return OK if passed else FAILED


def _small(args: argparse.Namespace, scene) -> argparse.Namespace:
    """The flags with the scene's quick options where these are asked for, before those that are set."""
    return argparse.Namespace(**{**vars(args), "set": [*(_settings(scene.small) if args.small else ()), *args.set]})


def _settings(options: dict) -> list[str]:
    """As `--set` takes them."""
    return [f"{name}={value}" for name, value in options.items()]


def _sweep(args: argparse.Namespace) -> int:
    from ..errors import SceneError
    from . import scenefile

    if args.out == "":
        raise SceneError("--out '': needs a folder's name")
    scene = scenefile.read(args.scene)
    plain = argparse.Namespace(**{name: value for name, value in vars(args).items() if name not in ("out", "set")}, set=[])
    options = _options(plain, scene)
    return sweeping.run(args, options.duration, options.fps, options.simulation)


def _list(args: argparse.Namespace) -> int:
    from . import scenefile
    from .sceneoptions import described

    for name in args.scenes:
        scene = scenefile.read(name)
        print(f"{scene.name}: {scene.summary}\n{described(scene)}")
    if args.scenes:
        return OK
    for name in scenefile.available():
        mine = scenefile.own(name)
        print(f"{name:22} {scenefile.read(name).summary}{f' ({mine})' if mine else ''}")
    return OK


def _doctor() -> int:
    import platform

    from .. import __version__
    from ..backend import compiler, runtime

    chosen = compiler.chosen()
    print(f"taichi_cloth {__version__}, Python {platform.python_version()}, {platform.platform()}")
    for package in (chosen.distribution, "numpy", "meshio", "rich"):
        from importlib.metadata import version
        print(f"{package:8} {version(package)}")
    here = ", ".join(other.name for other in compiler.COMPILERS.values() if other.installed)
    print(f"compiler {chosen.name}; installed: {here}; {compiler.VARIABLE} chooses")
    cores = runtime.cores()
    print(f"cpu      runs, f32 and f64, {cores} threads")
    for arch in ARCHS[1:]:
        there = runtime.available(arch)
        print(f"{arch:8} {'runs, f32' + ('' if arch in runtime.NO_DOUBLE else ' and f64') if there else 'not here'}")
    return OK


def _winds(args: argparse.Namespace) -> int:
    from .. import checks
    from ..scene.fabrics import fabrics
    from ..scene.winds import table
    from .scenefile import number

    def density(name: str) -> float:
        try:
            given = number(name)
        except ValueError:
            return fabrics[name].density
        return checks.number("--fabric", given, "kg/m^2", positive=True)

    print(table({name: density(name) for name in args.fabric or ("charmeuse", "denim", "wool_coating")}))
    return OK


def _options(args: argparse.Namespace, scene):
    from .. import checks
    from ..errors import SceneError, did_you_mean
    from .runoptions import RunOptions
    from .scenefile import settings_of

    given = {"duration": DURATION, "fps": FPS, **scene.run}
    unknown = [name for name in given if name not in ("duration", "fps", *BY_NAME)]
    if unknown:
        known = ("duration", "fps", *BY_NAME)
        raise SceneError(f"scene {scene.name}: RUN has no {unknown[0]!r}; {did_you_mean(unknown[0], known)}")
    flags = {name: getattr(args, name, None) for name in ("duration", "fps", *BY_NAME)}
    values = {**given, **{name: value for name, value in flags.items() if value is not None}}
    settings: dict[str, object] = {**settings_of(args.set)}
    for name in ("duration", "fps", "h"):
        values[name] = checks.maybe(values.get(name), checks.number, f"--{name}", positive=True)
    duration, fps = values.pop("duration"), values.pop("fps")
    checks.integer("--duration times --fps, the number of frames,", round(duration * fps), most=MOST_FRAMES)
    size = None if getattr(args, "no_images", True) else args.size
    options = RunOptions(getattr(args, "out", None), duration, fps, size, getattr(args, "overwrite", False), settings,
                         values)
    if not hasattr(args, "out"):
        return options
    if args.out == "":
        raise SceneError("--out '': needs a folder's name; without --out nothing is written")
    resume = args.resume or args.from_frame is not None
    if resume and not args.out:
        raise SceneError("--resume needs the run's folder: --out DIR")
    if resume and args.overwrite:
        raise SceneError("--resume keeps a run's files and --overwrite removes them: choose one")
    checks.integer("--checkpoint-every", args.checkpoint_every, least=0)
    checks.maybe(args.from_frame, checks.integer, "--from-frame", least=0)
    options = replace(options, look=look_of(args), pictures=args.frames, passes=passes_of(args),
                      checkpoint_every=args.checkpoint_every, frames=not args.no_frames, resume=resume,
                      from_frame=args.from_frame, force=args.force)
    if args.frames:
        options.drawn  # noqa: B018  (a wrong value is an error before anything runs)
    return options


def _parser() -> argparse.ArgumentParser:
    parser = Parser(prog="taichi-cloth", description="Implicit cloth simulation on Taichi kernels.")
    parser.add_argument("--version", action="version", version=f"taichi-cloth {__version__}")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    run_parser = commands.add_parser("run", help="simulate a scene and write pictures", epilog=SHOWN)
    run_parser.add_argument("scene", help="a scene file, with a function build() that returns the scene, or the name of one "
                            "that `list` shows; a script that calls tc.record itself is refused: `python` runs it")
    _run_flags(run_parser)
    check = commands.add_parser("check", help="simulate a scene and run its check")
    check.add_argument("scene", help="a scene file or name")
    _small_flag(check)
    _simulation_flags(check)
    cli_recorded.add_parsers(commands)
    cli_study.add_parsers(commands)
    dressing.add_parser(commands)
    looking.add_parser(commands)
    taking.add_parser(commands)
    viewing.add_parser(commands, _option_flags)
    sweeping.add_parser(commands, _simulation_flags)
    fitting.add_parser(commands)
    listing = commands.add_parser("list", help="scenes, one line each; of those that are named, their options")
    listing.add_argument("scenes", nargs="*", metavar="SCENE", help="a scene file or name, whose options are printed")
    commands.add_parser("doctor", help="what runs on this machine")
    commands.add_parser("fabrics", help="measured cloths, with their sources")
    winds = commands.add_parser("winds", help="winds by name, and how far each lifts cloth")
    winds.add_argument("--fabric", action="append", default=[], metavar="NAME", help="one that `fabrics` prints, or a density "
                       "[kg/m^2]; several, one after the other (charmeuse, denim, wool_coating)")
    return parser


def _run_flags(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--out", metavar="DIR", help="folder for manifest, telemetry and images")
    parser.add_argument("--size", type=size_of, default=(1280, 720), metavar="WxH", help="of the images (1280x720)")
    parser.add_argument("--no-images", action="store_true", help="write no images")
    parser.add_argument("-v", "--verbose", action="store_true", help="with numbers of the solver in the last lines")
    parser.add_argument("--overwrite", action="store_true", help="remove another run's files from the folder")
    parser.add_argument("--no-frames", action="store_true", help="keep no positions: no rendering again, no export")
    parser.add_argument("--checkpoint-every", type=int, default=10, metavar="N", help="frames (10); 0 writes no checkpoints")
    parser.add_argument("--resume", action="store_true", help="go on with the run in the folder from its last checkpoint")
    parser.add_argument("--from-frame", type=int, metavar="K", help="go on from frame K; the scene may be edited")
    parser.add_argument("--force", action="store_true", help="go on though parameters have changed")
    look_flags(parser)
    frame_flags(parser)
    _small_flag(parser)
    _simulation_flags(parser)


def _small_flag(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--small", action="store_true", help="with the scene's quick options")


def _simulation_flags(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("--duration", type=number_of, metavar="S", help="simulated time [s]")
    add("--fps", type=number_of, metavar="N", help="frames a second")
    _option_flags(parser)


def _option_flags(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    for name, option in BY_NAME.items():
        if option.metadata["flag"]:
            add(option.metadata["flag"], dest=name, **_how(option))
    add("--set", action="append", default=[], metavar="NAME=VALUE", help="an option of the scene: `list SCENE` prints them")


def _how(option: Field) -> dict:
    """Arguments of `add_argument` for an option of `Options`; an option that is not given becomes None."""
    kind, unit, meaning = (option.metadata[key] for key in ("kind", "unit", "meaning"))
    if kind == "flag":
        off = meaning.partition("False ")[2]
        return {"action": "store_const", "const": not option.default,
                "help": f"{off} ({option.name}=False)" if option.default else meaning}
    how = {"number": {"type": number_of, "metavar": unit.upper() or "X"}, "integer": {"type": int, "metavar": "N"}}
    return {"help": meaning, **how.get(kind, {})}
