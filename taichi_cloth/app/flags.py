"""A parser of command lines that names what a misspelt flag was perhaps meant to be."""

import argparse
import difflib
import re
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

    def error(self, message: str) -> NoReturn:
        """Ends the process with the message, and a suggestion for each flag that is not known."""
        if message.startswith("unrecognized arguments"):
            for word in re.findall(r"(--[\w-]+)", message):
                near = difflib.get_close_matches(word, sorted(self.known), n=2)
                message += f"; {word}: " + (f"did you mean {' or '.join(near)}?" if near else "see --help of the command")
        super().error(message)
