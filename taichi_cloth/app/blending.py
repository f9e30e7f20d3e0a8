"""The command `blend --onto`: a run on the objects of somebody's own .blend."""

import argparse
from collections.abc import Sequence


def add_flags(parser: argparse.ArgumentParser) -> None:
    """Of `blend`, besides those of `export`."""
    parser.add_argument("--onto", metavar="FILE", help="your own .blend: a copy of it whose objects move as the run's cloths")
    parser.add_argument("--object", action="append", metavar="[CLOTH=]OBJECT",
                        help="the object that a cloth is put onto (that of its name); may come again")


def put_onto(args: argparse.Namespace) -> int:
    """Writes; returns the exit code."""
    from ..errors import OutputError
    from ..output.export.onto import onto
    from ..output.recording import Recording

    if not args.onto:
        raise OutputError("--object says where --onto puts cloth: name a .blend with --onto")
    if args.parts is not None:
        raise OutputError("--onto takes cloths as they are: leave out --panels and --weld")
    recording = Recording(args.run)
    files = onto(recording, args.onto, args.to, objects_of(args.object, recording.geometry["cloth_names"].tolist()))
    for note in recording.notes:
        print(f"note: {note}")
    print(f"written to {files[0]}, with {len(files) - 1} caches in {files[1].parent}/")
    return 0


def objects_of(said: Sequence[str] | None, cloths: Sequence[str]) -> dict[str, str] | None:
    """The object of each cloth, from CLOTH=OBJECT, or an object alone where the run has one cloth."""
    from ..errors import OutputError

    if not said:
        return None
    out: dict[str, str] = {}
    for text in said:
        cloth, equals, name = text.partition("=")
        if not equals or cloth not in cloths and len(cloths) == 1:
            cloth, name = cloths[0] if len(cloths) == 1 else "", text
        if not cloth or not name:
            raise OutputError(f"--object {text!r}: the run has the cloths {', '.join(cloths)}: say CLOTH=OBJECT")
        if cloth in out:
            raise OutputError(f"--object {text!r}: cloth {cloth!r} has {out[cloth]!r} already")
        out[cloth] = name
    return out
