"""The package's warnings on a command line: notes, without the line of code that a warning is shown with."""

import contextlib
import sys
import warnings
from collections.abc import Iterator
from typing import TextIO


@contextlib.contextmanager
def warnings_as_notes() -> Iterator[None]:
    """Warnings to users are printed as notes; those of another kind, such as of deprecations, as always."""
    with warnings.catch_warnings():
        usual = warnings.showwarning

        def show(message: Warning | str, category: type[Warning], filename: str, lineno: int, file: TextIO | None = None,
                 line: str | None = None) -> None:
            if category is UserWarning:
                print(f"note: {message}", file=sys.stderr)
            else:
                usual(message, category, filename, lineno, file, line)

        warnings.showwarning = show
        yield
