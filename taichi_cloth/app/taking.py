"""The command `take`: a recorded run goes on from one of its frames, in a folder of its own."""

import argparse
import os
import pathlib
import sys
import time
from typing import Any

from .flags import number_of


def add_parser(commands) -> None:
    """Adds the command."""
    parser = commands.add_parser("take", help="go on from a frame of a run in a new folder, with other options blended in",
                                 epilog="It draws no pictures: `taichi-cloth render FOLDER` draws the new folder's, and "
                                        "`taichi-cloth compare` both runs side by side.")
    add = parser.add_argument
    add("run", help="a run's folder; it stays as it is")
    add("name", help="the new folder: a name beside the run's, or a path")
    add("--from-frame", type=int, required=True, metavar="K", help="the last frame that both have")
    add("--set", action="append", default=[], metavar="NAME=VALUE",
        help="an option of the scene that changes; fabric=NAME and wind=WORD go for every scene")
    add("--blend", type=int, default=0, metavar="FRAMES", help="over which options become the new ones (0: at once)")
    add("--duration", type=number_of, metavar="S", help="simulated time from the run's start on [s] (the run's)")
    add("--scene", metavar="FILE", help="the scene's file, if it was moved since the run")
    add("--overwrite", action="store_true", help="remove another run's files from the new folder")
    add("--checkpoint-every", type=int, default=10, metavar="N", help="frames (10); 0 writes no checkpoints")


def run(args: argparse.Namespace) -> int:
    """Goes on; returns the exit code."""
    from .. import checks
    from ..output.folder import free_for_a_run, hash_of_file
    from ..output.recording import Recording
    from .runoptions import INSTEAD_OF_TAKE, RunOptions
    from .scenefile import settings_of

    started = time.perf_counter()
    parent = Recording(args.run)
    out = _out(args.name, parent.path)
    free_for_a_run(out, args.overwrite, INSTEAD_OF_TAKE)
    scene = _scene(args, parent)
    was = scene.changed(parent.manifest["settings"])
    settings = was | settings_of(args.set)
    scene.typed(settings)  # options that are no number, or no known word, are refused before Taichi is imported
    from .runner import simulate
    from .summary import describe
    from .takes import Take

    duration = _duration(args, parent)
    blend = checks.integer("--blend", args.blend, least=0)
    checks.integer("--checkpoint-every", args.checkpoint_every, least=0)
    _check_blended(parent, args.from_frame)
    if hash_of_file(scene.path) != parent.manifest.get("source"):
        print(f"note: {scene.path} was changed since {parent.path} was run", file=sys.stderr)
    options = RunOptions(str(out), duration, parent.fps, overwrite=args.overwrite, settings=settings,
                         simulation=_simulation(parent), checkpoint_every=args.checkpoint_every, resume=True,
                         from_frame=args.from_frame)
    take = Take(os.path.relpath(parent.path, out), str(parent.manifest.get("started", "")), args.from_frame, blend, was)
    sim, start = simulate(scene, options, take, parent)
    print(describe(sim, time.perf_counter() - started, start, options.out))
    print(f"written to {out}/, whose frames begin with those of {parent.path}, {Recording(out).manifest['take']['files']}; "
          f"`taichi-cloth render {out}` draws it")
    return 0


def _scene(args: argparse.Namespace, parent):
    """The run's scene file."""
    from ..errors import OutputError
    from . import scenefile

    path = parent.manifest.get("path")
    if not path:
        raise OutputError(f"{parent.path} was recorded from Python, and no file has its scene: make the simulation "
                          "again, sim.resume(...), and tc.record(sim, ...)")
    there = args.scene or (path if pathlib.Path(path).is_file() else str(parent.manifest.get("scene")))
    if not args.scene and not pathlib.Path(there).is_file() and there not in scenefile.available():
        raise OutputError(f"{parent.path}: its scene's file, {path}, is not there: --scene FILE says where it is")
    return scenefile.read(there)


def _duration(args: argparse.Namespace, parent) -> float:
    """Simulated time [s] at which the take ends."""
    from .. import checks
    from ..errors import OutputError, SceneError

    frame = checks.integer("--from-frame", args.from_frame, least=0)
    first, last = parent.kept or (0, (parent.numbers("checkpoints") or [0])[-1])
    if not first <= frame <= last:
        raise OutputError(f"{parent.path}: frame {frame} is not there; there are {first} to {last}")
    given = checks.maybe(args.duration, checks.number, "--duration", "s", positive=True)
    duration = float(parent.manifest["duration"]) if given is None else given
    if round(duration * parent.fps) <= frame:
        raise SceneError(f"--from-frame {frame}: the take would end at frame {round(duration * parent.fps)} already: "
                         "--duration S makes it longer")
    return duration


def _check_blended(parent, frame: int) -> None:
    """Refuses to go on from the middle of another take's blend, whose scene is that of no options."""
    from ..errors import OutputError

    take = parent.manifest.get("take")
    if not take:
        return
    whole = take["frame"] + take["blend"]
    states = [k for k in parent.numbers("checkpoints") if k <= frame]
    if not states or states[-1] < whole:
        after = [k for k in parent.numbers("checkpoints") if k >= whole]
        way = f"from frame {after[0]} on" if after else "after a checkpoint behind that"
        raise OutputError(f"{parent.path} is itself a take, with its new options from frame {whole} on, and frame {frame} has "
                          f"no checkpoint since: take it {way}, or go on from {take['parent']}")


def _simulation(parent) -> dict[str, Any]:
    """Options of `Simulation` as the run had them."""
    from ..errors import OutputError
    from ..options import BY_NAME, MACHINE

    said, runtime = parent.manifest.get("simulation", {}), parent.manifest.get("runtime", {})
    if "h_max" not in said:
        raise OutputError(f"{parent.path} is of another version: its manifest does not say with which steps it was run")
    options = {name: value for name, value in said.items() if name in BY_NAME}
    return options | {"h": said["h_max"]} | {name: runtime[name] for name in MACHINE if name in runtime}


def _out(name: str, run: pathlib.Path) -> pathlib.Path:
    """The take's folder."""
    from .. import checks
    from ..errors import OutputError

    out = checks.path("take: name", name, OutputError)
    out = out if os.path.dirname(name) else run.absolute().parent / out if run.is_absolute() else run.parent / out
    if out.absolute() == run.absolute() or run.absolute() in out.absolute().parents:
        raise OutputError(f"take: {out} is the run's own folder, which stays as it is: give the take another name")
    return out
