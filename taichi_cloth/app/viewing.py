"""The command `view`: a scene in the browser as it runs."""

import argparse
import contextlib
from collections.abc import Callable
from dataclasses import replace

from ..scene.every import EVERY
from .runoptions import RunOptions
from .scenefile import SceneFile, path_of


def add_parser(commands, simulation_flags: Callable[[argparse.ArgumentParser], None]) -> None:
    """`view` and its flags."""
    parser = commands.add_parser("view", help="show a scene in the browser as it runs")
    add = parser.add_argument
    add("scene", help="a scene file or name")
    add("--small", action="store_true", help="with the scene's quick options")
    add("--paused", action="store_true", help="no step is made before Play is clicked")
    add("--host", default="127.0.0.1", metavar="NAME", help="from where it can be reached (127.0.0.1: this machine alone)")
    add("--port", type=int, metavar="N", help="of the page (the first that is free from 8080 on)")
    add("--no-open", action="store_true", help="open no browser")
    simulation_flags(parser)


def run(args: argparse.Namespace, read: Callable[[], SceneFile], options_of: Callable) -> int:
    """Shows; returns the exit code. The page starts before the scene file is run, which imports Taichi.

    Args:
        read: gives the scene file; options_of: takes the flags and it, and gives `RunOptions`.
    """
    with contextlib.suppress(KeyboardInterrupt):  # the usual end, from the first
        from ..live.view import serve

        title = path_of(args.scene).stem
        serve(lambda: _source(args, scene := read(), options_of(args, scene)), title, args.host, args.port, not args.no_open,
              not args.paused, lambda line: print(line, flush=True))
    return 0


def _source(args: argparse.Namespace, scene: SceneFile, options: RunOptions):
    """The page's source: the scene, made with any of its parameters."""
    from ..live.parameters import Parameter, parameters
    from ..live.view import Made
    from ..options import Options
    from .sceneoptions import meanings_in

    given = scene.typed({**(scene.small if args.small else {}), **options.settings})
    said = meanings_in(scene)
    shown = [*parameters(scene.options, scene.ranges, given),
             *(Parameter(name, str(given.get(name, "")), every=True) for name in EVERY if name not in scene.options)]
    return Made(lambda changed: scene.make({**given, **changed}), Options.named(options.simulation),
                tuple(replace(p, meaning=said.get(p.name, "")) for p in shown))
