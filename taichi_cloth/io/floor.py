"""A floor among the parts of a file with a scene. numpy only."""

from collections.abc import Mapping, Sequence

import numpy as np

from ..errors import shown

LEVEL = 1e-4  # height of a part that counts as level, of its width
ROOM = 0.05  # how far others may reach below it, of their height


def floor_among(x: np.ndarray, groups: Mapping[str, np.ndarray], parts: Sequence[str]) -> str | None:
    """The part that is level, does not move, and lies below and round all others; None if there is none.

    Args:
        x: (frames, n, 3) positions, y up; groups: vertices by name; parts: names of those that are parts.
    """
    there = [name for name in parts if name in groups]
    low, high = ({name: getattr(x[:, groups[name]], end)(axis=(0, 1)) for name in there} for end in ("min", "max"))
    for name in there:
        rest = [other for other in there if other != name]
        wide, mine = high[name] - low[name], x[:, groups[name]]
        level, still = wide[1] <= LEVEL * min(wide[0], wide[2]), np.abs(mine - mine[0]).max() <= LEVEL * wide.max()
        if not (rest and level and still):
            continue
        below, above = np.min([low[other] for other in rest], axis=0), np.max([high[other] for other in rest], axis=0)
        around = all(low[name][a] <= below[a] and above[a] <= high[name][a] for a in (0, 2))
        if around and high[name][1] <= below[1] + ROOM * (above[1] - below[1]):
            return name
    return None


def floor_note(x: np.ndarray, groups: Mapping[str, np.ndarray], parts: Sequence[str]) -> tuple[str, ...]:
    """A sentence on a floor, with the way to leave it out; none if there is none. Arguments as those of `floor_among`."""
    name = floor_among(x, groups, parts)
    others = [other for other in parts if other != name]
    return () if name is None else (f"part {name!r} is level and lies below and round all others, as a floor: "
                                    f"only={shown(others[0] if len(others) == 1 else others)} leaves it out",)
