"""Files that are frames: their order, by the numbers in their names, and those that are missing.

Whatever lists files by name orders them with `natural`.
"""

import glob
import re
from pathlib import Path

from ..errors import MeshError

NUMBER = re.compile("([0-9]+)")
TOLD = 12  # numbers that a message names


def natural(name: str) -> list[tuple[int, str]]:
    """A key to sort names by, in which numbers count as such: f_2 comes before f_10."""
    parts = NUMBER.split(name)
    return [(int(part), part) if k % 2 else (-1, part) for k, part in enumerate(parts)]


def frames(pattern: str) -> list[str]:
    """Files that match a pattern, in their natural order.

    The folder of the pattern is taken as it is written where there is such a folder, and so are brackets in its name where
    nothing matches otherwise.

    Raises:
        MeshError: no file matches, or two are of one number.
    """
    path = Path(pattern)
    folder, name = Path(glob.escape(str(path.parent))), path.name
    tries = [str(folder / name), str(folder / _literal(name)), pattern, _literal(pattern)]
    found = next(filter(None, ([f for f in glob.glob(t) if Path(f).is_file()] for t in tries)), None)
    if found is None:
        raise MeshError(f"no file matches {pattern}")
    found.sort(key=natural)
    for one, other in zip(found, found[1:]):
        if [n for n, _ in natural(one)] == [n for n, _ in natural(other)] and _shape(one) == _shape(other):
            raise MeshError(f"{other} and {one} are of one number: which of them is the frame?")
    return found


def missing(files: list[str]) -> str:
    """A sentence on frames that are missing between those there, by the last numbers of names that differ in these alone; ""
    where none is. Frames of every second, or tenth, number are whole."""
    parts = [NUMBER.split(Path(f).name) for f in files]
    if len(files) < 3 or len({(*p[:-2], p[-1]) for p in parts}) > 1 or len(parts[0]) < 3:
        return ""
    numbers = [int(p[-2]) for p in parts]
    stride = min(b - a for a, b in zip(numbers, numbers[1:]))
    gone = sorted(set(range(numbers[0], numbers[-1], stride)) - set(numbers))
    if not gone:
        return ""
    more = f" and {len(gone) - TOLD:,} more" if len(gone) > TOLD else ""
    return (f"{files[0]} and the {len(files) - 1} frames after it: {', '.join(map(str, gone[:TOLD]))}{more} of "
            f"{numbers[0]} to {numbers[-1]} are missing; those there follow each other without a pause")


def _literal(pattern: str) -> str:
    """A pattern in which brackets are none."""
    return pattern.replace("[", "[[]")


def _shape(name: str) -> list[str]:
    """A name without its numbers."""
    return NUMBER.split(name)[::2]
