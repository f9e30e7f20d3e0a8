"""Linear blend skinning: vertices follow a weighted mean of their joints' transforms."""

from __future__ import annotations

import numpy as np

from ...errors import MeshError

BYTE = 0.5 / 255  # rounding of a weight that is stored in a byte


def weighed(part: str, joints: np.ndarray, weights: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray, str]:
    """Joints and weights that can be used.

    Args:
        joints: (n, k) rows of the skin's joints; weights: (n, k); count: how many joints there are.

    Returns:
        (joints (n, k), weights (n, k) of sum one, a note or "").

    Raises:
        MeshError: a vertex without weights, a negative one, or a joint that is not there.
    """
    if joints.shape != weights.shape:
        raise MeshError(f"part {part!r}: has joints of shape {joints.shape} and weights of {weights.shape}")
    total = weights.sum(axis=1)
    bad = np.flatnonzero(~(np.isfinite(weights).all(axis=1) & (weights >= 0).all(axis=1) & (total > 0)))
    if len(bad):
        k = int(bad[0])
        raise MeshError(f"part {part!r}: the skin weights of vertex {k} are {np.round(weights[k], 6).tolist()} "
                        f"({len(bad)} such vertices): each needs weights of sum 1; paint them in the program that made it")
    joints = np.where(weights > 0, joints, 0).astype(np.int64)
    if joints.min(initial=0) < 0 or joints.max(initial=0) >= count:
        k = int(np.argmax((joints < 0).any(axis=1) | (joints >= count).any(axis=1)))
        raise MeshError(f"part {part!r}: vertex {k} follows joints {joints[k].tolist()}, and its skin has {count}")
    off = np.abs(total - 1) > BYTE * weights.shape[1]
    note = (f"part {part!r}: the skin weights of {int(off.sum()):,} vertices do not sum to 1 ({total.min():.3g} to "
            f"{total.max():.3g}), and are scaled so") if off.any() else ""
    return joints, weights / total[:, None], note


def skinned(x: np.ndarray, joints: np.ndarray, weights: np.ndarray, transforms: np.ndarray) -> np.ndarray:
    """(frames, n, 3) sum over k of w_k T_k x.

    Args:
        x: (1 or frames, n, 3) positions at rest.
        joints, weights: (n, k).
        transforms: (1 or frames, joints, 4, 4) from rest to where they are, of columns.
    """
    frames = max(len(x), len(transforms))
    out = np.empty((frames, *x.shape[1:]))
    for f in range(frames):
        at, rest = transforms[min(f, len(transforms) - 1), :, :3], x[min(f, len(x) - 1)]
        blend = np.einsum("nk,nkij->nij", weights, at[joints])
        out[f] = np.einsum("nij,nj->ni", blend[:, :, :3], rest) + blend[:, :, 3]
    return out
