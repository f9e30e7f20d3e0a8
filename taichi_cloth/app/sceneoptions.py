"""A scene's options in words: each with its default, and the line that the docstring of `build` has for it. numpy only."""

import inspect
import re
from collections.abc import Callable

from ..scene.every import EVERY
from .scenefile import SceneFile, plain

ARGUMENT = re.compile(r" {4}(\w+): (.*)")
OF_ALL = {"fabric": "of all cloths: a name that `taichi-cloth fabrics` prints; empty: the scene's own",
          "wind": "a name that `taichi-cloth winds` prints, and an axis unless it is +x, such as 'breeze -z'; empty: its own"}
WIDE = 24  # letters of an option and its default, to which columns go at most


def meanings(build: Callable) -> dict[str, str]:
    """By name, the text of each argument under `Args:` in a docstring."""
    found: dict[str, str] = {}
    name = ""
    _, _, text = (inspect.getdoc(build) or "").partition("Args:\n")
    for line in text.split("\n"):
        if line and not line.startswith(" "):  # another section
            break
        if argument := ARGUMENT.fullmatch(line):
            name, found[argument[1]] = argument[1], argument[2]
        elif name and line.startswith(" " * 8):
            found[name] += " " + line.strip()
    return {name: said.rstrip(".") for name, said in found.items()}


def meanings_in(scene: SceneFile) -> dict[str, str]:
    """By name the meaning of each option of a scene, those of every scene included."""
    return OF_ALL | meanings(scene.build)


def described(scene: SceneFile) -> str:
    """The options that `--set` takes, a line each: name, default, meaning and unit."""
    said = meanings_in(scene)
    first = [f"{name}={'' if o.default is o.empty else plain(o.default)}" for name, o in scene.options.items()]
    first += [f"{name}=" for name in EVERY if name not in scene.options]
    wide = min(WIDE, max(map(len, first)))
    lines = [f"  {one:{wide}}  {said.get(one.partition('=')[0], '')}".rstrip() for one in first]
    return "\n".join([f"options of {scene.name}, with defaults; --set NAME=VALUE changes one:", *lines])
