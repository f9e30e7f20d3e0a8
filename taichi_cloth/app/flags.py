"""A parser of command lines that names what a misspelt flag was perhaps meant to be, and takes negative values."""

import argparse
import difflib
import re
import sys
from collections.abc import Sequence
from typing import Any, NoReturn


class Parser(argparse.ArgumentParser):
    """As argparse's, for a command and its subcommands."""

    known: set[str] = set()  # flags of all parsers of the process

    def __init__(self, **options: Any) -> None:
        super().__init__(**{**options, "allow_abbrev": False})  # --check is no --checkpoint-every

    def add_argument(self, *names: str, **options: Any) -> argparse.Action:  # type: ignore[override]
        """As argparse's."""
        self.known.update(name for name in names if name.startswith("--"))
        return super().add_argument(*names, **options)

    def parse_args(self, args: Sequence[str] | None = None, namespace: Any = None) -> Any:  # type: ignore[override]
        """As argparse's; `--camera -1,1,2:0,0,0` is a flag and its value, which argparse would take for another flag."""
        words = list(sys.argv[1:] if args is None else args)
        joined: list[str] = []
        for word in words:
            if joined and re.match(r"-\.?\d", word) and re.fullmatch(r"--[a-z-]+", joined[-1]):
                joined[-1] += "=" + word
            else:
                joined.append(word)
        return super().parse_args(joined, namespace)

    def error(self, message: str) -> NoReturn:
        """Ends the process with the message, and a suggestion for each flag or command that is not known."""
        if message.startswith("unrecognized arguments"):
            for word in re.findall(r"(--[\w-]+)", message):
                near = difflib.get_close_matches(word, sorted(self.known), n=2)
                message += f"; {word}: " + (f"did you mean {' or '.join(near)}?" if near else "see --help of the command")
        choice = re.search(r"invalid choice: '([^']*)' \(choose from (.*)\)", message)
        if choice:
            near = difflib.get_close_matches(choice[1], re.findall(r"[\w-]+", choice[2]), n=1)
            message += f"; did you mean {near[0]!r}?" if near else ""
        super().error(message)


def number_of(text: str) -> float:
    """A number such as 1e-3 or 1/60, for argparse."""
    from .scenefile import number

    try:
        return number(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is no number") from None
