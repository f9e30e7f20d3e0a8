"""The command `blend` besides the export: a run on the objects of somebody's own .blend, and the add-on."""

import argparse
import pathlib
from collections.abc import Callable, Sequence

ADDON = pathlib.Path(__file__).with_name("blender_addon.py")


def add_flags(parser: argparse.ArgumentParser) -> None:
    """Flags of `blend`, besides those of `export`."""
    parser.add_argument("--onto", metavar="FILE", help="your own .blend: a copy of it whose objects move as the run's cloths")
    parser.add_argument("--object", action="append", metavar="[CLOTH=]OBJECT",
                        help="the object that a cloth is put onto (that of its name); may come again")
    parser.add_argument("--addon", metavar="FILE", help="write Blender's add-on to a .py, for its preferences to install")


def other(args: argparse.Namespace, retimed: Callable) -> int | None:
    """The exit code of `--addon` or `--onto`; None if it is an export.

    Args:
        retimed: a recording at the times that are asked for, of the arguments and the recording.
    """
    from ..errors import OutputError

    if args.addon is not None:
        return _addon(args)
    if args.run is None:
        raise OutputError("blend needs a run's folder, or --addon")
    if args.onto is not None or args.object:
        return _onto(args, retimed)
    return None


def _addon(args: argparse.Namespace) -> int:
    from ..errors import OutputError
    from ..output.folder import write_whole

    file = pathlib.Path(args.addon)
    if args.run is not None or args.onto is not None:
        raise OutputError("--addon goes without a run")
    if file.suffix != ".py" or not file.stem.isidentifier():
        raise OutputError(f"--addon {args.addon!r}: must be a .py whose name is one word, such as taichi_cloth_addon.py")
    write_whole(file, ADDON.read_bytes())
    print(f"written to {file}: in Blender, Preferences > Add-ons > Install from Disk")
    return 0


def _onto(args: argparse.Namespace, retimed: Callable) -> int:
    from ..errors import OutputError
    from ..output.export.onto import onto
    from ..output.recording import Recording

    if not args.onto:
        raise OutputError("--object says where --onto puts cloth: name a .blend with --onto")
    if args.parts is not None:
        raise OutputError("--onto takes cloths as they are: leave out --panels and --weld")
    recording = retimed(args, Recording(args.run))
    files = onto(recording, args.onto, args.to, objects_of(args.object, recording.geometry["cloth_names"].tolist()))
    for note in recording.notes:
        print(f"note: {note}")
    print(f"written to {files[0]}, with its caches in {files[1].parent}/: {', '.join(file.name for file in files[1:-1])}")
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
