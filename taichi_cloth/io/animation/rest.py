"""From the rest pose of a skeleton to the first frame of a clip.

Each joint turns, moves and grows from where its parent has it at rest to where it has it in that frame. The topmost joints are
where the frame has them, but for a turn about the vertical and a move along the ground that keep the body's heading and place.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from . import keys


class Placing(NamedTuple):
    """Transforms taken apart: translations (k, 3), unit quaternions (k, 4), scales (k, 3); each may be one for all."""

    move: np.ndarray
    turn: np.ndarray
    scale: np.ndarray

    def matrix(self) -> np.ndarray:
        """(k, 4, 4), of columns."""
        out = np.zeros((max(map(len, self)), 4, 4))
        out[:, :3, :3] = keys.matrix(keys.unit(self.turn)) * self.scale[:, None, :]
        out[:, :3, 3], out[:, 3, 3] = self.move, 1.0
        return out

    def on_the_way(self, there: Placing, u: np.ndarray) -> Placing:
        """The parts u (k,) of the way from here, which is one, to others (1 or k)."""
        end = [np.broadcast_to(part, (len(u), part.shape[1])) for part in there]
        turn = keys.slerp(np.broadcast_to(keys.unit(self.turn), end[1].shape), keys.unit(end[1]), u)
        move, scale = (a + u[:, None] * (b - a) for a, b in ((self.move, end[0]), (self.scale, end[2])))
        return Placing(move, turn, scale)


def lead(seconds: float, fps: float) -> np.ndarray:
    """(k,) parts of the way to the first frame, k frames before it; it begins and ends without a jump in speed."""
    s = np.arange(count := max(1, int(np.ceil(seconds * fps * (1 - 1e-6))))) / count
    return s * s * (3 - 2 * s)


def taken_apart(at: np.ndarray) -> Placing:
    """Transforms (k, 4, 4) of columns, without their shear; one that mirrors has a negative scale along x."""
    turn, scale = at[:, :3, :3], np.linalg.norm(at[:, :3, :3], axis=1)
    scale[:, 0] *= np.where(np.linalg.det(turn) < 0, -1.0, 1.0)
    return Placing(at[:, :3, 3], quaternions(turn / scale[:, None, :]), scale)


def quaternions(turns: np.ndarray) -> np.ndarray:
    """(k, 4) of the rotations nearest to matrices (k, 3, 3): eigenvectors, after Bar-Itzhack."""
    (a, b, c), (d, e, f), (g, h, i) = turns.transpose(1, 2, 0)
    rows = [[a - e - i, d + b, g + c, h - f], [d + b, e - a - i, h + f, c - g],
            [g + c, h + f, i - a - e, d - b], [h - f, c - g, d - b, a + e + i]]
    return np.linalg.eigh(np.stack([np.stack(row, axis=-1) for row in rows], axis=-2))[1][:, :, -1]


def kept_heading(at: np.ndarray, up: int) -> np.ndarray:
    """(frames, 4, 4) turns about the vertical, with moves along the ground, that bring joints nearest to where they are last.

    Args:
        at: (frames, joints, 4, 4) to the world, from the joints right below the topmost ones: hips, or trunk and thighs.
        up: number of the axis that points up.
    """
    a, b = (up + 1) % 3, (up + 2) % 3  # turning takes a to b
    axes = at[:, :, :3, :3] / np.linalg.norm(at[:, :, :3, :3], axis=2, keepdims=True)
    both = np.einsum("fjik,jlk->fil", axes, axes[-1])  # trace(turn both) is to be largest
    turn = both[:, a, a] + both[:, b, b] + 1j * (both[:, a, b] - both[:, b, a])
    turn = np.where(np.abs(turn) > 0, turn, 1.0)
    turn = turn / np.abs(turn)
    middle = (at[:, :, a, 3] + 1j * at[:, :, b, 3]).mean(axis=1)
    move = middle[-1] - turn * middle
    out = np.tile(np.eye(4), (len(at), 1, 1))
    out[:, a, a] = out[:, b, b] = turn.real
    out[:, b, a], out[:, a, b] = turn.imag, -turn.imag
    out[:, a, 3], out[:, b, 3] = move.real, move.imag
    return out
