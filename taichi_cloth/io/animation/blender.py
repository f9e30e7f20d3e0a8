"""FBX, Alembic and Blender's own files, by Blender in a process of its own; frames of the first two are kept."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from ...errors import MeshError
from .. import blender
from ..polygon import cut
from . import kept
from .motion import Clip, Motion, Part, Wanted, chosen_clips, chosen_parts, finite, refuse_restless, shears
from .rest import kept_heading

SCRIPT = Path(__file__).with_name("blender_script.py")
UPRIGHT = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])  # from Blender's z up to y up
KINDS = {".fbx": "FBX", ".abc": "Alembic", ".blend": "a .blend"}


def read(path: Path, wanted: Wanted) -> Motion:
    """The parts of a file as Blender has them; the unit is the metre, but a .blend's own, and y points up here.

    Raises:
        MeshError: Blender is not here, or cannot read the file; or the file holds no mesh or no such clip.
    """
    choices = json.dumps(wanted._asdict())
    if path.suffix.lower() == ".blend":  # whose libraries and caches may change while it does not
        got = _evaluated(path, choices)
    else:
        got = kept.arrays(path, choices + SCRIPT.read_text(), lambda: _evaluated(path, choices))
    if "refused" in got:
        raise MeshError(str(got["refused"]))
    names, clips = got["names"].tolist(), got["clips"].tolist()
    chosen_clips(wanted.clip, clips)
    take = chosen_parts(wanted.only, names, "Blender finds none in it")
    chosen = [name for name, taken in zip(names, take) if taken]
    refuse_restless(wanted, len(got["way"]) > 0)
    parts = [_part(name, got) for name in chosen if len(got[f"counts {name}"])]
    if not parts:
        raise MeshError(f"has no mesh: {chosen[0]!r} has no faces")
    moves = any(len(part.x) > 1 for part in parts)
    notes: tuple[str, ...] = ("Alembic names no unit: metres are taken (scale=...)",) if path.suffix.lower() == ".abc" else ()
    counts = [(part.name, int(got[f"own {part.name}"]), part.x.shape[1]) for part in parts]
    notes += tuple(f"part {name!r} has {own:,} vertices of its own, and {count:,} behind its modifiers, which are read"
                   for name, own, count in counts if own not in (0, count))
    fps = float(got["fps"])
    lengths = tuple(Clip(name, seconds, fps) for name, seconds in zip(clips, got["seconds"].tolist()))
    return Motion(parts, fps if moves else None, float(got["unit"]), "y",
                  lengths, tuple(got["taken"].tolist()), notes)


def _evaluated(path: Path, choices: str) -> dict[str, np.ndarray]:
    """The arrays that the script makes of a file."""
    return blender.arrays(SCRIPT, path, choices, KINDS[path.suffix.lower()])


def _part(name: str, got: dict[str, np.ndarray]) -> Part:
    x = finite(name, got[f"x {name}"].astype(np.float64))
    lead = len(got["way"])
    if lead and len(x) > 1 and (x[:lead] != x[lead]).any():
        turn = UPRIGHT @ kept_heading(got["bones"], 2)[:-1] @ UPRIGHT.T
        x[:lead] = x[:lead] @ turn[:, :3, :3].transpose(0, 2, 1) + turn[:, None, :3, 3]
    counts, corners = got[f"counts {name}"].astype(np.int64), got[f"corners {name}"].astype(np.int64)
    places, face = cut(x[0], corners, counts)
    if got[f"mirrored {name}"]:
        places = places[:, [0, 2, 1]]
    uv = got.get(f"uv {name}")
    materials = got[f"materials {name}"].tolist()
    of = np.clip(got[f"material {name}"][face], 0, max(len(materials) - 1, 0))
    groups = {said: np.flatnonzero(of == k) for k, said in enumerate(materials) if said and (of == k).any()}
    still = (x == x[:1]).all()
    return Part(name, x[:1] if still else x, corners[places], None if uv is None else uv[places].astype(np.float64), groups,
                bool(got[f"mirrored {name}"]), shears(got[f"world {name}"][None]))
