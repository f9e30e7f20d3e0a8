"""The command `dress`: a pattern and a body become a garment in a file."""

import argparse
import sys
from pathlib import Path

from .flags import number_of, vector_of

LEAD = 1.0  # s of --rest, of which the first frame alone is used


def add_parser(commands) -> None:
    """`dress` and its flags."""
    parser = commands.add_parser("dress", help="sew a pattern round a body and let it down")
    add = parser.add_argument
    add("pattern", help="in GarmentCode's JSON format, panels in an SVG or DXF, or meshed ones with stitches in an OBJ")
    add("--side", metavar="FILE", help="of an SVG or a DXF, stitches, labels and placement (the .json of its name); "
        "of an OBJ, a .csv of stitches (its own)")
    add("--pattern-size", metavar="NAME", help="of a DXF with several sizes")
    add("--body", required=True, metavar="MESH", help="the body, as tc.load_solid takes it; the first frame of a sequence")
    add("--scale", type=number_of, default=1.0, metavar="M", help="metres per unit of the body's file (1)")
    add("--up", choices=("y", "z"), help="axis of the body's file that points up (its own, or y)")
    add("--clip", metavar="NAME", help="of the body's file, by name or number (the first)")
    add("--rest", action="store_true", help="in the rest pose of the body's skeleton, arms away from the trunk, with which "
        "`tc.load_solid(..., rest=0.5)` begins, not in the clip's first frame")
    add("--only", action="append", metavar="PART", help="of a body's file with several parts (`look` lists them); may come "
        "again")
    add("--fit", action="store_true", help="makes a pattern that is drawn for the shipped figure as wide and as long as the "
        "body, and brings it to where that stands and faces")
    add("--turn", type=number_of, metavar="DEG", help="turns the pattern about the vertical, z towards x, to where the body "
        "faces (0; with --fit, found from its feet)")
    add("--shift", type=vector_of, default=(0.0, 0.0, 0.0), metavar="X,Y,Z", help="then moves it [m]")
    add("--out", required=True, metavar="FILE", help="the garment, a .npz for tc.load_garment")
    add("--fabric", default="shirting", help="one of those that `fabrics` prints (shirting)")
    add("--spacing", type=number_of, default=0.02, metavar="M", help="edge length of the cloth's triangles (0.02)")
    add("--thickness", type=number_of, default=0.003, metavar="M", help="of the cloth and of the body's skin (0.003)")
    add("--friction", type=number_of, default=0.3, metavar="X", help="of cloth on the body and on itself (0.3)")
    add("--over", metavar="FILE", action="append", default=[], help="a worn garment, a .npz, under the new one; again for"
        " the next one over it; as they lie in the end they are written beside --out")
    add("--over-fabric", metavar="NAME", help="of those (as --fabric)")
    add("--pull", type=number_of, default=5.0, metavar="N/M", help="force a length that closes seams (5)")
    add("--no-meets", action="store_false", dest="meets", help="cloth passes through itself while it is sewn (quicker)")
    add("--longest", type=number_of, default=4.0, metavar="S", help="simulated time after which settling ends (4)")


def run(args: argparse.Namespace) -> int:
    """Dresses; returns the exit code."""
    from .. import checks
    from ..garment import load_pattern
    from ..garment.dressing import dress
    from ..garment.fitted import fitted
    from ..garment.worn import Worn, worn_under
    from ..io.animation.motion import wanted
    from ..io.garment import load_garment
    from ..io.solid import loaded
    from ..scene.fabric import ClothContact
    from ..scene.fabrics import fabrics
    from ..scene.scene import Scene
    from .waiting import waiting

    name = checks.choice("--fabric", args.fabric, tuple(fabrics))
    under = fabrics[checks.choice("--over-fabric", args.over_fabric or name, tuple(fabrics))]
    out, contact = _checked_out(args.out), ClothContact(args.thickness, args.friction)
    worn = worn_under([Worn(load_garment(file), under, contact, Path(file).stem) for file in args.over], contact, out.stem)
    with waiting(f"loading {args.pattern}"):
        pattern = load_pattern(args.pattern, args.side, size=args.pattern_size)
        garment = pattern.mesh(args.spacing)
    print(f"{len(garment.seams)} seams, {garment.mesh.vertex_count} vertices, {garment.mesh.face_count} triangles")
    for note in garment.mesh.notes:
        print(f"note: {note}", file=sys.stderr)
    body = Scene()
    with waiting(f"loading {args.body}"):
        choice = wanted(args.clip, None, args.only, LEAD if args.rest else None)
        solid, read = loaded(args.body, args.scale, None, args.up, None, choice, True, None)
    body.add_solid(solid, friction=args.friction, thickness=args.thickness, name="body")
    if args.fit:
        parts = [part.name for part in read.motion.parts] if read.motion else []
        garment, done = fitted(garment, body, args.thickness, args.turn, parts)
        for note in done:
            print(f"note: {note}", file=sys.stderr)
    garment = garment.placed(0.0 if args.fit else args.turn or 0.0, args.shift)
    made = dress(garment, fabrics[name], body, contact, args.longest, tell=print, pull=args.pull, meets=args.meets, over=worn,
                 name=out.stem)
    for note in made.notes:
        print(f"note: {note}", file=sys.stderr)
    files = [*(out.with_name(f"{out.stem}-over-{w.name}.npz") for w in worn), out]
    for one, file in zip(made.worn, files):
        one.garment.save(file)
    print(f"{made.report()}\nwritten to {', '.join(map(str, files))}")
    return 0


def _checked_out(name: str) -> Path:
    """The file of the garment, checked before anything is computed: it must be writable."""
    from .. import checks
    from ..errors import SceneError

    out = checks.path("--out", name)
    if out.suffix != ".npz" or out.is_dir() or not out.parent.is_dir():
        raise SceneError(f"--out {name}: must be a .npz in a folder that is there")
    try:
        part = out.with_name(out.name + ".part")  # as `Garment.save` writes it
        part.touch()
        part.unlink()
    except OSError as error:
        raise SceneError(f"{out}: cannot be written: {error.strerror or error}") from None
    return out
