"""The command `view`: a scene in the browser as it runs."""

import argparse
from collections.abc import Callable
from dataclasses import replace

from .scenefile import EVERY, SceneFile


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


def run(args: argparse.Namespace, scene: SceneFile, settings: dict[str, str], simulation: dict) -> int:
    """Shows; returns the exit code.

    Args:
        settings: of the scene, as `--set` gives them; simulation: arguments of `Simulation`.
    """
    from ..live.parameters import Parameter, parameters
    from ..live.view import Made, serve
    from ..options import Options
    from .sceneoptions import meanings_in

    given = scene.typed({**(scene.small if args.small else {}), **settings})
    said = meanings_in(scene)
    shown = [*parameters(scene.options, scene.ranges, given), *(Parameter(name, str(given.get(name, ""))) for name in EVERY
                                                               if name not in scene.options)]
    source = Made(lambda changed: scene.make({**given, **changed}), Options.named(simulation),
                  tuple(replace(p, meaning=said.get(p.name, "")) for p in shown))
    serve(source, scene.name, args.host, args.port, not args.no_open, not args.paused,
          lambda line: print(line, flush=True))
    return 0
