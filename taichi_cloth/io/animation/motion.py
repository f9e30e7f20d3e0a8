"""Parts of a file with a scene, as they move: the same for every format. Choices by the caller are checked here."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from ... import checks
from ...errors import MeshError, did_you_mean, shown
from .. import npz

SHEARED = 1e-3  # cosine between axes of a transform above which it is said to shear
FPS = 24.0  # frames a second, as in films: the least at which a clip is sampled that names no rate


class Part(NamedTuple):
    """A mesh of a file.

    Attributes:
        x: (frames, n, 3) positions in the world of the file, in its unit and axes; one frame where it stands still.
        faces: (m, 3) rows of x.
        corner_uv: (m, 3, 2) texture coordinates, v up, or None.
        groups: rows of `faces` by the names of materials and subsets.
        mirrored, sheared: whether its transform does that to it; of a mirrored part the triangles are turned.
    """

    name: str
    x: np.ndarray
    faces: np.ndarray
    corner_uv: np.ndarray | None
    groups: dict[str, np.ndarray]
    mirrored: bool = False
    sheared: bool = False


class Clip(NamedTuple):
    """An animation to choose from: `fps`, its own frames a second."""

    name: str
    seconds: float
    fps: float

    @property
    def frames(self) -> int:
        """How many it is read as."""
        return _frames(self.seconds * self.fps)


class Motion(NamedTuple):
    """The content of a file with a scene.

    Attributes:
        fps: frames a second of the parts' frames; None where nothing moves.
        unit: metres of the file's unit.
        up: the axis that points up, "y" or "z".
        clips: to choose from; taken: numbers of those that were read.
        notes: sentences on the file.
    """

    parts: list[Part]
    fps: float | None
    unit: float
    up: str
    clips: tuple[Clip, ...]
    taken: tuple[int, ...]
    notes: tuple[str, ...]


class Wanted(NamedTuple):
    """Choices of the caller.

    Attributes:
        clip: names or numbers of animations that play together; if None the first, with others that move nothing that it
            moves.
        fps: frames a second at which it is sampled, the file's own if None.
        only: names of the parts that are read; all if None.
        moves: whether the animation is read at all.
        rest: seconds in which it goes from its rest pose to the first frame; None begins with that.
    """

    clip: tuple[str | int, ...] | None = None
    fps: float | None = None
    only: tuple[str, ...] | None = None
    moves: bool = True
    rest: float | None = None


def wanted(clip: object, fps: object, only: object, rest: object = None) -> Wanted:
    """The choices, checked."""
    if clip is not None:
        several = tuple(clip) if isinstance(clip, (list, tuple)) else (clip,)
        clip = tuple(one if isinstance(one, str) else checks.integer("clip", one, least=0) for one in several)
        if not clip:
            raise MeshError("clip: names no animation")
    fps = checks.maybe(fps, checks.number, "fps", positive=True)
    if only is not None:
        names = (only,) if isinstance(only, str) else tuple(only) if isinstance(only, Iterable) else ()
        if not names:
            raise MeshError(f"only = {shown(only)}: must be the name of a part, or a list of names")
        only = tuple(checks.name("only", name, MeshError) for name in names)
    rest = checks.maybe(rest, checks.number, "rest", "s", positive=True, most=60.0)
    return Wanted(clip, fps, only, rest=rest)  # type: ignore[arg-type]


def refuse_restless(wanted: Wanted, found: bool) -> None:
    """Refuses a rest pose of a file in which none was found.

    Raises:
        MeshError: it has no skeleton below its topmost joints, or no animation.
    """
    if wanted.rest is not None and not found:
        raise MeshError(f"rest = {wanted.rest:g}: it has no skeleton that an animation moves away from a rest pose")


def chosen_clips(clip: tuple[str | int, ...] | None, names: Sequence[str]) -> tuple[int, ...] | None:
    """The numbers of the animations that are meant; None where the caller leaves it to the file.

    Raises:
        MeshError: no such animation.
    """
    if clip is None:
        return None
    out = []
    for one in clip:
        if not names:
            raise MeshError(f"clip = {shown(one)}: the file has no animation to choose from")
        if isinstance(one, str) and one not in names:
            raise MeshError(f"clip = {shown(one)}: no such animation; {did_you_mean(one, names)}")
        if isinstance(one, int) and one >= len(names):
            raise MeshError(f"clip = {one}: the file has {len(names)}, from 0: {', '.join(names)}")
        out.append(list(names).index(one) if isinstance(one, str) else one)
    return tuple(out)


def chosen_parts(only: tuple[str, ...] | None, names: Sequence[str], found: str) -> list[bool]:
    """Whether each part is read.

    Args:
        found: the rest of the file's content, for the message where it has no mesh.

    Raises:
        MeshError: there is no mesh, or no part of a name.
    """
    if not names:
        raise MeshError(f"has no mesh: {found}")
    for name in only or ():
        if name not in names:
            raise MeshError(f"only: no part {shown(name)}; {did_you_mean(name, names)}")
    return [only is None or name in only for name in names]


def times(first: float, last: float, fps: float, vertices: int) -> np.ndarray:
    """(frames,) times [s] from the first to the last, or just after it, at so many a second.

    Raises:
        MeshError: more than this machine's memory has room for.
    """
    count = (last - first) * fps
    if not 0 <= count * vertices * 24 < npz.memory():
        raise MeshError(f"its animation lasts {last - first:g} s: at {fps:g} frames a second its positions need "
                        f"{count * vertices * 24:.3g} bytes")
    return first + np.arange(_frames(count)) / fps


def _frames(count: float) -> int:
    """From the first to the last, or just after it; the rounding of times in f32 makes none."""
    return int(np.ceil(count * (1 - 1e-6))) + 1


def distinct_names(names: Iterable[str | None], kind: str) -> list[str]:
    """Names that can be printed and differ from each other; `kind` and a number if there is none."""
    out: list[str] = []
    for k, name in enumerate(names):
        plain = "".join(c if c.isprintable() else " " for c in name or "").strip() or f"{kind} {k}"
        tried, number = plain, 2
        while tried in out:
            tried, number = f"{plain} {number}", number + 1
        out.append(tried)
    return out


def finite(part: str, values: np.ndarray) -> np.ndarray:
    """The same numbers (rows, k), checked.

    Raises:
        MeshError: one is not finite, with its row.
    """
    rows = np.isfinite(values).all(axis=-1)
    if not rows.all():
        raise MeshError(f"part {part!r}: vertex {int(np.argwhere(~rows)[0][-1])} is not finite")
    return values


def mirrors(part: str, turns: np.ndarray, t: np.ndarray) -> bool:
    """Whether transforms (1 or frames, 3, 3) mirror.

    Raises:
        MeshError: they do at times t (frames,) only, or make nothing of the part.
    """
    det = np.linalg.det(turns)
    bad = np.flatnonzero((det == 0) | (np.sign(det) != np.sign(det[0])))
    if len(bad):
        how = "shrinks it to nothing" if det[bad[0]] == 0 else "turns it inside out"
        raise MeshError(f"part {part!r}: its transform {how} at {t[min(bad[0], len(t) - 1)]:.4g} s: leave it out (only=), or "
                        "choose another clip")
    return bool(det[0] < 0)


def shears(turns: np.ndarray) -> bool:
    """Whether some of transforms (frames, 3, 3) has axes that are not at right angles to each other."""
    axes = turns / np.maximum(np.linalg.norm(turns, axis=1, keepdims=True), np.finfo(float).tiny)
    return bool((np.abs(np.tril(axes.transpose(0, 2, 1) @ axes, -1)) > SHEARED).any())
