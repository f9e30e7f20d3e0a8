"""Commands on finished runs: render, compare, export, diff, report, why."""

import argparse
import pathlib
import sys
from collections.abc import Callable

from .blending import add_flags as add_blender
from .flags import number_of
from .look_flags import frame_flags, look_flags, look_of, passes_of


def add_parsers(commands) -> None:
    """Adds the commands."""
    render = commands.add_parser("render", help="draw a finished run again: other camera, heat map, film")
    render.add_argument("run", help="a run's folder")
    render.add_argument("--to", metavar="DIR", help="folder for the pictures (RUN/images)")
    render.add_argument("--size", type=size_of, default=(1280, 720), metavar="WxH", help="of the images (1280x720)")
    render.add_argument("--every", type=int, default=1, metavar="N", help="every Nth frame")
    render.add_argument("--arch", default="cpu", help="cpu, cuda, vulkan or metal")
    render.add_argument("--shutter", type=number_of, default=0.0, metavar="PART",
                        help="part of the time until the next frame over which a picture is exposed, 0 to 1: blurs motion")
    render.add_argument("--sheet", type=int, default=0, metavar="N", help="also N frames in one picture, sheet.png")
    render.add_argument("--apng", action="store_true", help="also an animated PNG, animation.png")
    render.add_argument("--mp4", action="store_true", help="also film.mp4 (needs the extra `film`)")
    render.add_argument("--turntable", type=int, default=0, metavar="N", help="N pictures of one frame, from all round")
    render.add_argument("--frame", type=int, metavar="K", help="that of the turntable (the last)")
    _retiming(render)
    look_flags(render)
    frame_flags(render)
    _add_compare(commands)
    _add_exports(commands)
    diff = commands.add_parser("diff", help="differences between two runs, and the time at which their motion parts")
    diff.add_argument("runs", nargs=2, metavar="RUN", help="runs' folders")
    diff.add_argument("--tolerance", type=number_of, default=1e-6, metavar="M", help="RMS distance [m] that counts (1e-6)")
    why = commands.add_parser("why", help="the worst and the costliest steps, where they had trouble, and advice")
    why.add_argument("run", help="a run's folder")
    why.add_argument("--steps", type=int, default=10, metavar="N", help="how many of them (10)")
    report = commands.add_parser("report", help="one HTML page about a run")
    report.add_argument("run", help="a run's folder")
    report.add_argument("--to", metavar="FILE", help="page (RUN/report.html)")


def _add_compare(commands) -> None:
    compare = commands.add_parser("compare", help="two runs side by side, with their difference frame by frame")
    compare.add_argument("runs", nargs=2, metavar="RUN", help="runs' folders")
    compare.add_argument("--to", metavar="PATH", help="a folder, the picture's file (.png), or the film's (.mp4, "
                         ".apng), with the picture beside it (compare.png in the first run's folder)")
    compare.add_argument("--size", type=size_of, default=(480, 360), metavar="WxH", help="of one frame (480x360)")
    compare.add_argument("--frames", type=int, default=5, metavar="N", help="number of frames in a row")
    compare.add_argument("--movie", action="store_true", help="also both side by side as a film, .mp4, or .apng without the "
                         "extra `film`")
    compare.add_argument("--common", action="store_true", help="the times that both have, where their frames do not match")
    look_flags(compare)


def _add_exports(commands) -> None:
    export = commands.add_parser("export", help="geometry for other tools")
    export.add_argument("--format", required=True, help="blend, abc, usda, usdc, glb, gltf, obj, pc2, vtu or ply")
    export.add_argument("run", help="a run's folder")
    blend = commands.add_parser("blend", help="a .blend with cloths, solids and camera; or a run put onto your own")
    blend.add_argument("run", nargs="?", help="a run's folder")
    for parser in (export, blend):
        _retiming(parser)
        parser.add_argument("--to", metavar="PATH", help="folder, or the file where the format has one (RUN/FORMAT)")
        parts = parser.add_mutually_exclusive_group()
        parts.add_argument("--panels", dest="parts", action="store_const", const="panels",
                           help="a mesh for each panel of a garment")
        parts.add_argument("--weld", dest="parts", action="store_const", const="welded",
                           help="garments welded over their seams")
    add_blender(blend)


def _render(args: argparse.Namespace) -> int:
    from .. import checks
    from ..errors import many
    from ..output.recording import Recording
    from ..recording.drawing import Extras, numbers_in
    from ..recording.playback import Films, render, warn_inside

    _check_to(args)
    checks.integer("--every", args.every)
    checks.integer("--sheet", args.sheet, least=0)
    extras = Extras(*passes_of(args))
    recorded = Recording(args.run)
    recording = _turntable(args, recorded) if args.turntable or args.frame is not None else _retimed(args, recorded)
    numbers = recording.frames()
    numbers = (numbers_in(args.frames, numbers) if args.frames and recording is recorded else numbers)[::args.every]
    look = _look(args, recording)
    warn_inside(recording, look)
    usual = "images" if recording is recorded else "turntable" if args.turntable else "retimed"
    folder = pathlib.Path(args.to) if args.to else recording.path / usual
    files = render(recording, folder, args.size, look, numbers, Films(args.sheet, args.apng, args.mp4), extras)
    for note in recording.notes:
        print(f"note: {note}", file=sys.stderr)
    last = f", the last {files[-1].name}" if len(files) > 1 else f": {files[0].name}"
    print(f"{many(len(files), 'file')} in {folder}/{last}")
    return 0


def _compare(args: argparse.Namespace) -> int:
    from .. import checks
    from ..errors import OutputError
    from ..output.recording import Recording
    from ..recording.comparing import Pair, Sides, draw, files_at, film

    _check_to(args)
    checks.integer("--frames", args.frames)
    to = checks.maybe(args.to, checks.path, "--to", OutputError)
    a, b = map(Recording, args.runs)
    file, movie = files_at(to, a.path, args.movie)
    pair = Pair(a, b, args.common)
    sides, files = Sides(pair, args.size, _look(args, pair.a)), [file]
    draw(pair, sides, file, args.frames)
    if pair.apart is not None:
        files.append(file.with_suffix(".csv"))
        pair.written(files[-1])
    if movie:
        film(pair, sides, movie, args.size)
        files.append(movie)
    print("\n".join([*pair.said(), f"written to {', '.join(map(str, files))}"]))
    return 0


def _export(args: argparse.Namespace, format: str | None = None) -> int:
    from ..output.export import export
    from ..output.recording import Recording

    _check_to(args)
    recording = _retimed(args, Recording(args.run))
    files = export(recording, format or args.format, args.to, args.parts or "cloths")
    for note in recording.notes:
        print(f"note: {note}")
    names = ", ".join(f.name for f in files[:3]) + (" ..." if len(files) > 3 else "")
    print(f"{len(files)} files in {files[0].parent}/: {names}" if len(files) > 1 else f"written to {files[0]}")
    return 0


def _blend(args: argparse.Namespace) -> int:
    from .blending import other

    _check_to(args)
    done = other(args, _retimed)
    return _export(args, "blend") if done is None else done


def _diff(args: argparse.Namespace) -> int:
    from ..output.recording import Recording
    from ..recording.playback import parting
    from ..recording.resuming import differences

    first, second = map(Recording, args.runs)
    skip = ["started", "wall_s", "output_seconds", "steps_before", "simulated_s", "frames"]
    skip += ["path"] * (first.manifest.get("source") == second.manifest.get("source"))  # of one scene, named in another way
    lines = differences({k: v for k, v in first.manifest.items() if k not in skip},
                        {k: v for k, v in second.manifest.items() if k not in skip})
    for line in [x for x in lines if ".seconds." not in x] + parting(first, second, args.tolerance):
        print(line)
    return 0


def _report(args: argparse.Namespace) -> int:
    from ..output.recording import Recording
    from ..recording.report import write_report

    _check_to(args)
    recording = Recording(args.run)
    file = pathlib.Path(args.to) if args.to else recording.path / "report.html"
    write_report(recording, file)
    for note in recording.notes:
        print(f"note: {note}")
    print(f"written to {file} ({file.stat().st_size / 1e6:.1f} MB)")
    return 0


def _why(args: argparse.Namespace) -> int:
    from .. import checks
    from ..output.recording import Recording
    from ..recording.why import costliest

    print(costliest(Recording(args.run), checks.integer("--steps", args.steps, least=1)))
    return 0


COMMANDS: dict[str, Callable[[argparse.Namespace], int]] = {
    "render": _render, "compare": _compare, "export": _export, "blend": _blend, "diff": _diff, "report": _report, "why": _why}


def _retiming(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--speed", type=number_of, metavar="X", help="seconds of the run in a second of the film: .5 is half "
                        "as fast; between recorded frames motion is interpolated")
    parser.add_argument("--fps", type=number_of, metavar="N", help="frames a second of the film (the run's)")


def _retimed(args: argparse.Namespace, recording):
    """The run at the times that `--speed` and `--fps` ask for; itself where they do not."""
    from ..errors import SceneError
    from ..output.retimed import Retimed
    from ..recording.drawing import numbers_in

    if args.speed is None and args.fps is None:
        return recording
    ends: tuple[int, ...] = ()
    if getattr(args, "frames", ""):
        numbers = numbers_in(args.frames, recording.frames())
        if len(numbers) != numbers[-1] - numbers[0] + 1:
            raise SceneError(f"--frames {args.frames}: with --speed or --fps it is FIRST:LAST of the run, without gaps")
        ends = numbers[0], numbers[-1]
    return Retimed(recording, 1.0 if args.speed is None else args.speed, args.fps, *ends)


def _turntable(args: argparse.Namespace, recording):
    """A frame of the run, while the camera goes round once."""
    from .. import checks
    from ..errors import SceneError
    from ..output.facing import facing
    from ..output.framing import fit_round
    from ..output.retimed import Frozen

    if not args.turntable:
        raise SceneError("--frame is the one that --turntable N goes round; --frames FIRST:LAST says which are drawn")
    if getattr(args, "frames", ""):
        raise SceneError(f"--turntable: draws one frame from all round: --frame K instead of --frames {args.frames}")
    for flag in ("speed", "fps", "orbit"):
        if getattr(args, flag):
            raise SceneError(f"--turntable: draws one frame from all round; --{flag} says nothing of that: leave it out")
    count = checks.integer("--turntable", args.turntable, least=2)
    args.orbit = 360.0 * recording.fps / count  # degrees a second of the film
    frozen = Frozen(recording, recording.frames()[-1] if args.frame is None else args.frame, count)
    if args.camera is None:  # the scene's own looks at one side
        way = facing([frozen.frame(0)], frozen.geometry["faces"])
        camera = fit_round([frozen.points()], 0.0, args.size[0] / args.size[1], way)
        args.camera = [(None, (camera.eye, camera.target, camera.fov))]
    return frozen


def _look(args: argparse.Namespace, recording):
    from ..backend import runtime
    from ..output.look import Look
    from ..recording.playback import heat_of

    runtime.start(getattr(args, "arch", "cpu"), "f32", None, True, False)
    look = look_of(args)
    if look["heat"]:
        look["heat"] = heat_of(look["heat"][0], recording.geometry, look["heat"][1], recording)
    return Look(**look)


def _check_to(args: argparse.Namespace) -> None:
    from ..errors import OutputError

    if args.to == "":
        raise OutputError("--to '': needs a name")


def size_of(text: str) -> tuple[int, int]:
    """WIDTHxHEIGHT, for argparse."""
    from .. import checks

    width, _, height = text.partition("x")
    if not (checks.is_whole(width) and checks.is_whole(height) and 16 <= int(width) <= 16384 and 16 <= int(height) <= 16384):
        raise argparse.ArgumentTypeError(f"{text!r}: needs WIDTHxHEIGHT, each from 16 to 16384")
    return int(width), int(height)
