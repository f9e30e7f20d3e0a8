"""The command `look`: the content of a mesh, a sequence or a file with a scene, as a solid has it, or of a pattern."""

import argparse
import warnings
from typing import NamedTuple

from .flags import number_of
from .lists import SHOWN, some
from .recorded import size_of

PERSON = (0.5, 3.0)  # m, heights of people
THIN = 0.02  # of its length: lower than this, it lies there as cloth, not as a figure


def add_parser(commands) -> None:
    """`look` and its flags."""
    parser = commands.add_parser("look", help="describe a mesh, an animation or a sewing pattern: parts, clips, size")
    add = parser.add_argument
    add("file", help="as tc.load_solid takes it (.obj, .npz, .glb, .usd, .fbx, .abc, ...), or a pattern (.svg, .dxf, .json)")
    add("--to", metavar="FILE", help="also a picture of a few moments, a .png; of a pattern a drawing, a .svg")
    add("--pattern-size", metavar="NAME", help="of a DXF pattern with several sizes")
    add("--size", type=size_of, default=(480, 480), metavar="WxH", help="of each moment's picture (480x480)")
    add("--clip", action="append", metavar="NAME", help="of a file with several animations, by name or number; may come again")
    add("--only", action="append", metavar="PART", help="of a file with several parts; may come again")
    add("--all", action="store_true", help=f"list every clip, group and panel, not the first {SHOWN} of each")
    add("--apart", action="store_true", help="parts are not joined where they touch")
    add("--scale", type=number_of, default=1.0, metavar="M", help="metres per unit of the file, times its own (1)")
    add("--up", choices=("y", "z"), help="axis of the file that points up (its own, or y)")
    add("--fps", type=number_of, metavar="N", help="frames a second (its own)")
    add("--mesh", metavar="FILE", help="of a point cache, the file with its triangles")
    add("--weld", type=number_of, metavar="M", help="make vertices one that stay so near to each other")


def run(args: argparse.Namespace) -> int:
    """Prints; returns the exit code."""
    from .. import checks
    from ..errors import OutputError
    from ..io.animation.motion import wanted
    from ..io.solid import loaded
    from .patterns import is_pattern, look_at
    from .waiting import waiting

    if is_pattern(args.file):
        return look_at(args)
    if args.pattern_size is not None:
        raise OutputError(f"--pattern-size: {args.file} is not a sewing pattern")
    to = checks.maybe(args.to, checks.png, "--to", OutputError)
    clips = [int(name) if checks.is_whole(name) else name for name in args.clip or ()] or None
    with warnings.catch_warnings(record=True) as warned, waiting(f"loading {args.file}"):
        warnings.simplefilter("always")
        choice = wanted(clips, args.fps, args.only)
        shape, read = loaded(args.file, args.scale, args.mesh, args.up, None, choice, not args.apart, args.weld)
        floor = None if args.only or not read.motion else _floor(shape, [part.name for part in read.motion.parts])
        if floor is not None:  # the rest is what is looked at
            choice = choice._replace(only=floor.others)
            shape, read = loaded(args.file, args.scale, args.mesh, args.up, None, choice, not args.apart, args.weld)
    parts = [part.name for part in read.motion.parts] if read.motion else []
    notes = [f"note: {note}" for note in [*map(str, (w.message for w in warned)), *shape.notes, *doubts(shape, args.up)]]
    lines = [f"{args.file}: {f'{len(parts)} parts, together ' if len(parts) > 1 else ''}{shape!r}",
             *told(shape, read.motion, None if args.all else SHOWN), *([floor.line] if floor else []), *notes]
    if to is not None:  # before anything is printed: a reader such as `head` may go before the end
        from ..recording.looked import draw

        with waiting(f"drawing {to}"):
            draw(shape, to, args.size, parts, floor.height if floor else None)
        lines.append(f"written to {to}")
    print("\n".join(lines))
    return 0


class Floor(NamedTuple):
    """A floor under the parts of a file: a line on it, its height [m], the names of the others."""

    line: str
    height: float
    others: tuple[str, ...]


def _floor(shape, parts: list[str]) -> Floor | None:
    """The floor among the parts of a solid."""
    import numpy as np

    from ..io.floor import floor_among

    name = floor_among(shape.x, shape.groups, parts)
    if name is None:
        return None
    x = shape.x[0, shape.groups[name]]
    size = np.ptp(x, axis=0)
    line = (f"floor   {name!r}, {size[0]:.4g} x {size[2]:.4g} m at {x[0, 1]:.4g} m: not counted above, drawn as the ground; "
            f"--only {name} looks at it")
    return Floor(line, float(x[0, 1]), tuple(p for p in parts if p != name))


def told(shape, motion, most: int | None = None) -> list[str]:
    """Lines on a solid, and on the scene that it is of; at most so many on clips, and on groups."""
    import numpy as np

    from ..scene.mesh import distinct, face_edges

    def size(x: np.ndarray) -> str:
        return f"{' x '.join(f'{length:.4g}' for length in np.ptp(x, axis=0))} m"

    out = [f"size    {size(shape.x[0])} (y is up), the lowest point at {shape.x[0, :, 1].min():.4g} m"]
    def farthest(x: np.ndarray) -> float:
        return float(np.linalg.norm(x - x[:1], axis=2).max())

    if len(shape.x) > 1:
        out.append(f"moves   {len(shape.x):,} frames at {shape.fps:.6g} a second, {(len(shape.x) - 1) / shape.fps:.4g} s; a "
                   f"vertex goes {farthest(shape.x):.3g} m from where it starts")
    else:
        out.append("moves   no animation")
    clips = [f"clip    {k} {clip.name!r}, {clip.frames:,} frames, {clip.seconds:.4g} s{', read' if k in motion.taken else ''}"
             for k, clip in enumerate(motion.clips if motion else ())]
    groups = []
    for name, index in shape.groups.items():
        faces = shape.faces[np.isin(shape.faces, index).all(axis=1)]
        border = int((distinct(face_edges(faces))[1] == 1).sum())
        groups.append(f"group   {name!r}, {len(index):,} vertices, {len(faces):,} triangles, "
                      f"{f'{border:,} border edges' if border else 'closed'}, {size(shape.x[0, index])}, "
                      f"the lowest point at {shape.x[0, index, 1].min():.4g} m"
                      f"{f', goes {farthest(shape.x[:, index]):.3g} m' if len(shape.x) > 1 else ''}")
    return [*out, *some(clips, most, "clips"), *some(groups, most, "groups")]


def doubts(shape, up: str | None = None) -> list[str]:
    """Sentences on a size that looks like another unit's, or no person's, and on a body that lies down.

    Args:
        up: the axis that the caller says points up.
    """
    import numpy as np

    from ..scene.scene import Scene
    from ..scene.units import doubts_of_solid, fitting

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found = doubts_of_solid(Scene().add_solid(shape, friction=0.0, thickness=1e-3, name="solid"))
    size = np.ptp(shape.x[0], axis=0)
    longest, moves = float(size.max()), len(shape.x) > 1
    if moves and not found and not PERSON[0] <= longest <= PERSON[1]:
        found = [f"it is {longest:.3g} m long, and people are {PERSON[0]:g} to {PERSON[1]:g} m: if it is one, "
                 f"{fitting(longest, 'tc.load_solid')}"]
    out = [f"{sentence}; here `--scale`" for sentence in found]
    if up is None and (moves or shape.closed) and size[2] == longest and THIN * longest < size[1] < longest / 2:
        out.append("it is longest along z, twice as long as it is high: if it should stand, "
                   'tc.load_solid(path, up="z") turns it; here `--up z`')
    return out
