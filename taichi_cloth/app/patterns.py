"""`look` at a sewing pattern: its panels in words, and their drawing."""

import argparse
from pathlib import Path

PATTERNS = (".svg", ".svgz", ".dxf", ".json")


def is_pattern(name: str) -> bool:
    """Whether a file is a pattern, by its name."""
    return Path(name).suffix.lower() in PATTERNS


def look_at(args: argparse.Namespace) -> int:
    """Prints; returns the exit code."""
    from .. import checks
    from ..errors import OutputError
    from ..garment import load_pattern
    from ..garment.pattern import Pattern
    from ..garment.sheet import described, drawing
    from ..output.folder import write_whole
    from .lists import SHOWN, some

    for flag in ("clip", "only", "apart", "fps", "mesh", "weld"):
        if getattr(args, flag):
            raise OutputError(f"--{flag}: {args.file} is a sewing pattern: that is for meshes and animations")
    to = checks.maybe(args.to, checks.path, "--to", OutputError)
    if to is not None and to.suffix.lower() != ".svg":
        raise OutputError(f"--to = {str(to)!r}: must end with .svg: a sewing pattern is drawn as SVG")
    pattern = load_pattern(args.file, scale=args.scale, up=args.up or "y", size=args.pattern_size)
    assert isinstance(pattern, Pattern)  # only an OBJ is another
    lines = [f"{args.file}: {pattern!r}", *some(described(pattern), None if args.all else SHOWN, "panels"),
             *(f"note: {note}" for note in pattern.notes)]
    if to is not None:
        write_whole(to, drawing(pattern).encode())
        lines.append(f"written to {to}")
    print("\n".join(lines))
    return 0
