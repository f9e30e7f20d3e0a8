"""Keyframes of glTF: values at any time, by STEP, LINEAR or CUBICSPLINE; turns are unit quaternions (x, y, z, w)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...errors import MeshError

KINDS = ("LINEAR", "STEP", "CUBICSPLINE")


class Keys(NamedTuple):
    """Keyframes.

    Attributes:
        t: (k,) times [s], rising.
        values: (k, ...), or (k, 3, ...) of a cubic spline: tangent of arrival [1/s], value, tangent of departure [1/s].
        kind: of `KINDS`.
        turns: whether the values are quaternions.
    """

    t: np.ndarray
    values: np.ndarray
    kind: str
    turns: bool

    def at(self, t: np.ndarray) -> np.ndarray:
        """(frames, ...) values at times t (frames,) [s]; before the first key and after the last those of these."""
        k, u, dt = self._between(t)
        if self.kind == "CUBICSPLINE":
            out = self._spline(k, u, dt)
        elif self.kind == "STEP" or len(self.t) == 1:
            out = self.values[np.clip(np.searchsorted(self.t, t, side="right") - 1, 0, None)]
        else:
            a, b = self.values[k], self.values[k + 1]
            out = slerp(unit(a), unit(b), u) if self.turns else a + _wide(u, a) * (b - a)
        return unit(out) if self.turns else out

    def _between(self, t: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The key before each time, the part of the way to the next in [0, 1], and the time between both [s]."""
        if len(self.t) == 1:
            return np.zeros(len(t), dtype=np.int64), np.zeros(len(t)), np.ones(len(t))
        k = np.clip(np.searchsorted(self.t, t, side="right") - 1, 0, len(self.t) - 2)
        dt = self.t[k + 1] - self.t[k]
        return k, np.clip((t - self.t[k]) / dt, 0.0, 1.0), dt

    def _spline(self, k: np.ndarray, u: np.ndarray, dt: np.ndarray) -> np.ndarray:
        """Hermite's cubic between keys."""
        if len(self.t) == 1:
            return self.values[k, 1]
        a, m_a, b, m_b = self.values[k, 1], self.values[k, 2], self.values[k + 1, 1], self.values[k + 1, 0]
        u, dt = _wide(u, a), _wide(dt, a)
        return ((2 * u**3 - 3 * u**2 + 1) * a + (u**3 - 2 * u**2 + u) * dt * m_a
                + (3 * u**2 - 2 * u**3) * b + (u**3 - u**2) * dt * m_b)


def keys(what: str, t: np.ndarray, values: np.ndarray, kind: str, turns: bool) -> Keys:
    """Keyframes that can be used; `what` they move, for the message.

    Args:
        t: (k,); values: (k, ...), or of a spline (3 k, ...).

    Raises:
        MeshError: times that do not rise, an unknown kind, numbers that do not go together or are not finite.
    """
    if kind not in KINDS:
        raise MeshError(f"the animation of {what}: unknown interpolation {kind!r}; known: {', '.join(KINDS)}")
    if not len(t) or not np.isfinite(t).all() or (np.diff(t) <= 0).any():
        raise MeshError(f"the animation of {what}: times of keys must rise")
    each = 3 if kind == "CUBICSPLINE" else 1
    if len(values) != each * len(t):
        raise MeshError(f"the animation of {what}: {len(t)} keys need {each * len(t)} values, not {len(values)}")
    if not np.isfinite(values).all():
        raise MeshError(f"the animation of {what}: a value is not finite")
    return Keys(t, values.reshape(-1, 3, *values.shape[1:]) if each == 3 else values, kind, turns)


def slerp(a: np.ndarray, b: np.ndarray, u: np.ndarray) -> np.ndarray:
    """(frames, 4) unit quaternions the part u (frames,) of the way from a to b, at an even pace, the shorter way round."""
    dot = (a * b).sum(axis=-1, keepdims=True)
    b, u = np.where(dot < 0, -b, b), u[:, None]
    angle = np.arccos(np.clip(np.abs(dot), 0.0, 1.0)) / np.pi
    return ((1 - u) * np.sinc((1 - u) * angle) * a + u * np.sinc(u * angle) * b) / np.sinc(angle)  # sin(c pi)/(c pi)


def unit(q: np.ndarray) -> np.ndarray:
    """(..., 4) quaternions of length one; no turn for a quaternion of length 0."""
    length = np.linalg.norm(q, axis=-1, keepdims=True)
    return np.where(length > 0, q / np.where(length > 0, length, 1.0), [0.0, 0.0, 0.0, 1.0])


def matrix(q: np.ndarray) -> np.ndarray:
    """(..., 3, 3) rotations of unit quaternions (..., 4)."""
    x, y, z, w = np.moveaxis(q, -1, 0)
    rows = [[1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)]]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def _wide(u: np.ndarray, like: np.ndarray) -> np.ndarray:
    """(frames, 1, ...) with as many axes as `like`."""
    return u.reshape(-1, *[1] * (like.ndim - 1))
