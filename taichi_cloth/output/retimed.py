"""A recorded run at other times: slower, faster, with another number of frames a second, or frozen. numpy only.

Between two frames a point goes along the cubic through both positions with both velocities, as far as the velocities fit the
way between. With d = x_1 - x_0, the part of the way from the straight line to the cubic is

    1 - r^2, r = |d - h (v_0 + v_1) / 2| / (h |v_1 - v_0| / 2),    at least 0.

Under a constant force r is 0, and motion is met exactly. If a point was stopped at a part f of the way, by a solid or a
seam, r is |1 - 2 f|. With that it does not swing beyond the place where it stopped, as the cubic alone would.
Solids have no recorded velocity: theirs is that between the frames before and after.
"""

import numpy as np

from .. import checks
from ..errors import OutputError
from .recording import Recording

Arrays = dict[str, np.ndarray]
SAME = 1e-9  # frames: two times that are no further apart are one


class Retimed(Recording):
    """A run as if it had been recorded at other times; its frames are numbered from 0.

    Args:
        source: the run.
        speed: seconds of the run in a second of the film; .5 is half as fast.
        fps: frames a second of the film; the run's if None.
        first, last: recorded frames between which it is; all if None.

    Raises:
        SceneError: a speed or a number of frames that is not positive.
        OutputError: the run has no frames, or not these.
    """

    def __init__(self, source: Recording, speed: float = 1.0, fps: float | None = None, first: int | None = None,
                 last: int | None = None) -> None:
        super().__init__(source.path)
        self.source, self.speed = source, checks.number("speed", speed, positive=True)
        rate = source.fps if fps is None else checks.number("fps", fps, positive=True)
        there = source.frames()
        self.first, self.last = there[0] if first is None else first, there[-1] if last is None else last
        if not there[0] <= self.first <= self.last <= there[-1]:
            raise OutputError(f"{source.path} has no frames {self.first} to {self.last}; it has {there[0]} to {there[-1]}")
        self.step = self.speed * source.fps / rate  # in recorded frames
        count = checks.integer("speed, fps: number of frames", int((self.last - self.first) / self.step + SAME) + 1)
        self.manifest |= {"fps": rate, "frames": [0, count - 1]}
        self._read: dict[int, Arrays] = {}

    def frames(self) -> list[int]:
        """Numbers of the film's frames."""
        return list(range(self.manifest["frames"][1] + 1))

    def time(self, frame: int) -> float:
        """Simulated time of a frame [s]."""
        return self.source.time(0) + (self.first + frame * self.step) / self.source.fps

    def frame(self, number: int) -> Arrays:
        """Moving data of a frame; `clock` is the film's own time [s]."""
        at = self.first + number * self.step
        k = int(at + SAME)
        share, clock = at - k, {"clock": np.array(number / self.fps)}
        if share <= SAME or k >= self.last:
            return self._recorded(min(k, self.last)) | clock
        out = between(self._recorded(k), self._recorded(k + 1), share)
        if "solid_x" in out:
            out["solid_x"] = self._solids(k, share)
        return out | clock

    def _solids(self, k: int, share: float) -> np.ndarray:
        before, a, b, after = (self._recorded(j)["solid_x"] for j in (max(k - 1, self.first), k, k + 1,
                                                                       min(k + 2, self.last)))
        first = (b - before) / (2 if k > self.first else 1)
        last = (after - a) / (2 if k + 2 <= self.last else 1)
        return curve(a, b, first, last, share)

    def _recorded(self, k: int) -> Arrays:
        """A frame of the run; the last few are kept."""
        if k not in self._read:
            self._read = {j: frame for j, frame in self._read.items() if k - 3 <= j <= k + 3}
            self._read[k] = self.source.frame(k)
        return self._read[k]


class Frozen(Recording):
    """A frame of a run, again and again, while the film's own time goes on.

    Args:
        frame: its number; count: how many of it.

    Raises:
        OutputError: the run has no such frame.
    """

    def __init__(self, source: Recording, frame: int, count: int) -> None:
        super().__init__(source.path)
        there = source.frames()
        if frame not in there:
            raise OutputError(f"{source.path} has no frame {frame}; it has {there[0]} to {there[-1]}")
        self._frame, self._time = source.frame(frame), source.time(frame)
        self.manifest["frames"] = [0, checks.integer("number of pictures", count) - 1]

    def frames(self) -> list[int]:
        """Numbers of the film's frames."""
        return list(range(self.manifest["frames"][1] + 1))

    def time(self, frame: int) -> float:
        """Simulated time [s], the same for all."""
        return self._time

    def points(self) -> np.ndarray:
        """(n, 3) places of cloth and solids [m]."""
        solids = self._frame.get("solid_x", self.geometry["solid_x"])
        return np.concatenate([self._frame["x"], solids]).astype(np.float64)

    def frame(self, number: int) -> Arrays:
        """Moving data of the frame; `clock` is the film's own time [s]."""
        return self._frame | {"clock": np.array(number / self.fps)}


def between(a: Arrays, b: Arrays, share: float) -> Arrays:
    """A frame so far from a to b: points along their curves, other numbers linearly, all else as in a."""
    out = dict(a)
    for name, first in a.items():
        last = b.get(name)
        if last is not None and last.shape == first.shape and first.dtype.kind == "f":
            out[name] = first + np.asarray(share * (last - first), dtype=first.dtype)
    h = float(b["t"]) - float(a["t"])
    out["x"] = curve(a["x"], b["x"], h * a["v"].astype(np.float64), h * b["v"].astype(np.float64), share)
    return out


def curve(a: np.ndarray, b: np.ndarray, first: np.ndarray, last: np.ndarray, share: float) -> np.ndarray:
    """(n, 3) points between (n, 3) a and b, of a's type; `first`, `last` (n, 3) are velocities there, a frame's way long."""
    x, y = a.astype(np.float64), b.astype(np.float64)
    way, turn = y - x, last - first
    off, most = (np.linalg.norm(d, axis=1, keepdims=True) for d in (way - (first + last) / 2, turn / 2))
    fits = np.clip(1 - (off / np.maximum(most, 1e-150)) ** 2, 0.0, 1.0)
    s, r = share, 1 - share
    return (x + s * way + fits * s * r * (r * (first - way) - s * (last - way))).astype(a.dtype)
