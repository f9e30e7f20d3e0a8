"""A parser of command lines that suggests a flag for a misspelt one, and takes negative values."""

import argparse
import difflib
import re
import sys
from collections.abc import Sequence
from typing import Any, NoReturn


class Help(argparse.Action):
    """Ends the process with the help of a command and, where a scene is named before, with the scene's options."""

    def __call__(self, parser: argparse.ArgumentParser, namespace: argparse.Namespace, *_: object) -> NoReturn:
        """Prints the help and ends the process; argparse calls it."""
        said = parser.format_help()
        if getattr(namespace, "scene", None):
            from .scenefile import read
            from .sceneoptions import described

            said += "\n" + described(read(namespace.scene)) + "\n"
        print(said, end="")
        parser.exit()


class Parser(argparse.ArgumentParser):
    """The parser of argparse, for a command and its subcommands."""

    def __init__(self, **options: Any) -> None:
        super().__init__(**{**options, "allow_abbrev": False, "add_help": False})  # --check is no --checkpoint-every
        self.add_argument("-h", "--help", action=Help, nargs=0, help="show this, and the options of a scene that is named")

    def parse_args(self, args: Sequence[str] | None = None, namespace: Any = None) -> Any:  # type: ignore[override]
        """Arguments by name; `--camera -1,1,2:0,0,0` is a flag and its value, and not two flags as for argparse."""
        words = list(sys.argv[1:] if args is None else args)
        joined: list[str] = []
        for word in words:
            if joined and re.match(r"-\.?\d", word) and re.fullmatch(r"--[a-z-]+", joined[-1]):
                joined[-1] += "=" + word
            else:
                joined.append(word)
        out, rest = self.parse_known_args(joined, namespace)
        if rest:
            hints = self._hints(rest, getattr(out, "command", ""))
            self.error("; ".join([f"unrecognized arguments: {' '.join(rest)}", *hints]))
        return out

    def _hints(self, rest: list[str], command: str) -> list[str]:
        """A suggestion for each flag among the words that a command does not know."""
        parsers: dict[str, argparse.ArgumentParser] = {"": self}
        for action in self._actions:
            if isinstance(action, argparse._SubParsersAction):
                parsers |= action.choices
        of = {name: [flag for a in p._actions for flag in a.option_strings if flag.startswith("--")]
              for name, p in parsers.items()}
        out = []
        for word in (found[0] for found in map(re.compile(r"--[\w-]+").match, rest) if found):
            having = [name for name, flags in of.items() if word in flags]
            near = difflib.get_close_matches(word, of[command], n=2)
            if having:
                verb = "has" if len(having) == 1 else "have"
                out.append(f"{word}: {command} has no such flag; {', '.join(having)} {verb} it")
            else:
                out.append(f"{word}: did you mean {' or '.join(near)}?" if near else f"{word}: see --help of the command")
        return out

    def error(self, message: str) -> NoReturn:
        """Ends the process with the message, and a suggestion for a command that is not known."""
        choice = re.search(r"invalid choice: '([^']*)' \(choose from (.*)\)", message)
        if choice:
            near = difflib.get_close_matches(choice[1], re.findall(r"[\w-]+", choice[2]), n=1)
            message += f"; did you mean {near[0]!r}?" if near else ""
        super().error(message)


def vector_of(text: str) -> tuple[float, ...]:
    """Three numbers such as 0,-.1,1e-2, for argparse."""
    from .scenefile import numbers

    try:
        return numbers(text, 3)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r}: must be three numbers, X,Y,Z") from None


def number_of(text: str) -> float:
    """A number such as 1e-3 or 1/60, for argparse."""
    from .scenefile import number

    try:
        return number(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is not a number") from None
