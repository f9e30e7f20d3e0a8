"""The rest shape of a mesh without a pattern: its own lengths, in the plane. numpy only."""

import numpy as np

LEVEL = 1e-5  # of its size: a mesh thicker than this is not flat; a file's digits are about as coarse


def own_shape(x: np.ndarray, faces: np.ndarray, texture: np.ndarray | None) -> np.ndarray:
    """Material coordinates [m] with the lengths that positions have; the warp runs along the texture's u if there is one.

    Args:
        x: (n, 3) positions [m]; faces: (m, 3).
        texture: (m, 3, 2) texture coordinates of the corners.

    Returns:
        (n, 2) in the mesh's plane, where it is flat and has texture coordinates; else (m, 3, 2), each triangle in a frame
        of its own.
    """
    own = flatten(x, faces)
    if texture is None:
        return own
    with np.errstate(over="ignore", invalid="ignore"):
        plane = _in_plane(x, faces, texture)
        return _turned(own, gradients(texture, own)) if plane is None else plane


def flatten(x: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """(m, 3, 2) coordinates [m] of each triangle in a frame of its own: corner 0 at the origin, edge 0-1 along u."""
    a, b = x[faces[:, 1]] - x[faces[:, 0]], x[faces[:, 2]] - x[faces[:, 0]]
    length = np.linalg.norm(a, axis=1)
    unit = a / np.where(length > 0, length, 1)[:, None]
    along = np.einsum("ij,ij->i", b, unit)
    across = np.linalg.norm(b - along[:, None] * unit, axis=1)
    zero = np.zeros(len(faces))
    return np.stack([np.stack([zero, zero], 1), np.stack([length, zero], 1), np.stack([along, across], 1)], 1)


def twice_area(corner_uv: np.ndarray) -> np.ndarray:
    """(m,) signed, of triangles (m, 3, 2)."""
    a, b = corner_uv[:, 1] - corner_uv[:, 0], corner_uv[:, 2] - corner_uv[:, 0]
    return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]


def gradients(corner_uv: np.ndarray, corner: np.ndarray) -> np.ndarray:
    """(m, d, 2) of the maps that take triangles (m, 3, 2) to others (m, 3, d); 0 if a triangle has no area."""
    det = twice_area(corner_uv)[:, None]
    a, b = (corner_uv[:, k] - corner_uv[:, 0] for k in (1, 2))
    e, g = (corner[:, k] - corner[:, 0] for k in (1, 2))
    both = np.stack([e * b[:, 1:] - g * a[:, 1:], g * a[:, :1] - e * b[:, :1]], axis=2)
    return both / np.where(det == 0, np.inf, det)[..., None]


def stretches(corner_uv: np.ndarray, corner: np.ndarray) -> np.ndarray:
    """(m, 2) largest and smallest stretch of the maps that take triangles (m, 3, 2) to others (m, 3, 2)."""
    F = gradients(corner_uv, corner)
    one = np.hypot(F[:, 0, 0] + F[:, 1, 1], F[:, 1, 0] - F[:, 0, 1])
    other = np.hypot(F[:, 0, 0] - F[:, 1, 1], F[:, 1, 0] + F[:, 0, 1])
    return np.stack([one + other, np.abs(one - other)], axis=1) / 2


def _in_plane(x: np.ndarray, faces: np.ndarray, texture: np.ndarray) -> np.ndarray | None:
    """(n, 2) of a flat mesh, from its lower left corner; None of one that is not flat, or where u has no direction."""
    used = np.zeros(len(x), dtype=bool)
    used[faces] = True
    points = x[used] - x[faces[0, 0]]
    values, axes = np.linalg.eigh(points.T @ points) if np.isfinite(points).all() else (np.zeros(3), np.eye(3))
    across = points @ axes[:, 0]  # flat: the points are in the plane through one of them that is nearest to all
    if values[2] <= 0 or np.ptp(across) > LEVEL * np.ptp(points, axis=0).max():
        return None
    corner = x[faces]
    area = np.linalg.norm(np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]), axis=1)
    along = np.einsum("m,mdk->dk", area, gradients(texture, corner))
    u = along[:, 0] - axes[:, 0] * (axes[:, 0] @ along[:, 0])
    if not np.linalg.norm(u) > 0:
        return None
    u /= np.linalg.norm(u)
    v = np.cross(axes[:, 0], u)
    flat = (x - x[faces[0, 0]]) @ np.stack([u, v if v @ along[:, 1] >= 0 else -v], axis=1)
    return flat - flat[faces].min(axis=(0, 1))


def _turned(own: np.ndarray, F: np.ndarray) -> np.ndarray:
    """Triangles (m, 3, 2) turned so that the texture's u runs along theirs, and v not against it; F: gradients."""
    length = np.linalg.norm(F[:, :, 0], axis=1)
    known = np.isfinite(length) & (length > 0)
    cos, sin = (np.divide(F[:, d, 0], length, out=np.full(len(F), 1.0 - d), where=known)[:, None] for d in (0, 1))
    side = np.where(known & (F[:, 0, 0] * F[:, 1, 1] < F[:, 0, 1] * F[:, 1, 0]), -1.0, 1.0)[:, None]
    x, y = own[..., 0], own[..., 1]
    return np.stack([cos * x + sin * y, side * (cos * y - sin * x)], axis=2)
