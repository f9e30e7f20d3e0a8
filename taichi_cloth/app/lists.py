"""Lists that a command prints, not longer than a screen."""

SHOWN = 15  # lines of a list that are printed, unless all are asked for


def some(lines: list[str], most: int | None, kind: str) -> list[str]:
    """The first lines, and one that counts those that are left out; all of them where `most` is None."""
    more = 0 if most is None else len(lines) - most
    return lines if more < 2 else [*lines[:most], f"        and {more} {kind} more; --all lists them"]
