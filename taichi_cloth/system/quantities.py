"""Quantities of a recorded frame: stretch, shear, bend energy, speed, contact force, creases, limits, seams."""

from dataclasses import dataclass

import numpy as np

from .. import checks
from ..errors import SceneError
from .elements import hinge_angle

WIDTH = 1e-4  # stretch below which a triangle has no width that f32 would know from rounding


@dataclass(frozen=True)
class Quantity:
    """How a quantity is shown.

    Attributes:
        unit: of its values.
        reach: how far the scale goes where nothing is known of a run yet.
        middle: the value in the middle of a diverging scale, or None if values only go up from 0.
    """

    unit: str
    reach: float
    middle: float | None = None

    def scale(self, values: np.ndarray | None = None) -> tuple[float, float]:
        """(low, high) of a scale that fits values, but for the last half percent; the usual one if None."""
        middle = self.middle or 0.0
        reach = self.reach if values is None else max(float(np.percentile(np.abs(values - middle), 99.5)), 1e-3 * self.reach)
        return (0.0 if self.middle is None else middle - reach), middle + reach


QUANTITIES = {
    "stretch": Quantity("", 0.05, 1.0),
    "shear": Quantity("rad", 0.3, 0.0),
    "bend": Quantity("J/m2", 0.02),
    "speed": Quantity("m/s", 2.0),
    "contact": Quantity("N", 0.02),
    "crease": Quantity("1/m", 100.0),
    "limit": Quantity("of the limit", 1.0),
    "seam": Quantity("N/m", 5.0),
}
ABSENT = {"crease": "no fabric of this scene yields, and no edge is creased", "limit": "no fabric of this scene has a limit",
          "seam": "nothing in this scene is sewn"}
MARKS = {"crease": "creases", "limit": "face_limit", "seam": "sewn"}  # names in the geometry of a scene that has it


def principal_stretches(w: np.ndarray) -> np.ndarray:
    """(m, 2) singular values of deformation gradients w (m, 3, 2), the larger first."""
    uu, vv = np.einsum("mij,mij->mj", w, w).T
    uv = np.einsum("mi,mi->m", w[:, :, 0], w[:, :, 1])
    mean, spread = (uu + vv) / 2, np.hypot((uu - vv) / 2, uv)
    area = np.linalg.norm(np.cross(w[:, :, 0], w[:, :, 1]), axis=1)
    large = np.sqrt(mean + spread)
    return np.stack([large, area / np.where(large > 0, large, 1)], axis=1)


def deformation(x: np.ndarray, faces: np.ndarray, corner_uv: np.ndarray) -> np.ndarray:
    """(m, 3, 2) columns w_u, w_v [BW98 (9)] of triangles with corners at x (n, 3), pattern corner_uv (m, 3, 2)."""
    a = x[faces]
    rest = np.stack([corner_uv[:, 1] - corner_uv[:, 0], corner_uv[:, 2] - corner_uv[:, 0]], axis=2)
    return np.stack([a[:, 1] - a[:, 0], a[:, 2] - a[:, 0]], axis=2) @ np.linalg.inv(rest)


def collapsed(w: np.ndarray) -> int:
    """How many deformation gradients w (m, 3, 2) have no width in some direction, but for rounding: a line or a point."""
    return int(np.sum(principal_stretches(w)[:, 1] < WIDTH))


def evaluate(name: str, geometry: dict[str, np.ndarray], frame: dict[str, np.ndarray]) -> np.ndarray:
    """(n,) a quantity on every vertex of cloth, from a run's arrays.

    Raises:
        SceneError: an unknown name.
    """
    checks.choice("quantity", name, QUANTITIES)
    x, n = frame["x"].astype(np.float64), len(frame["x"])
    faces, uv = frame.get("faces", geometry["faces"]), geometry["uv"].astype(np.float64)
    if name == "speed":
        return np.linalg.norm(frame["v"].astype(np.float64), axis=1)
    require(name, geometry)
    if name == "seam":
        return frame["seam"].astype(np.float64) if "seam" in frame else np.zeros(n)
    if name == "crease":
        return _creases(geometry, frame)
    if name == "contact":
        return np.linalg.norm(in_one(geometry, frame, frame["contact"]), axis=1) if "contact" in frame else np.zeros(n)
    a, b = uv[:, 1] - uv[:, 0], uv[:, 2] - uv[:, 0]
    area = np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]) / 2
    if name == "bend":
        vertices = geometry["hinges"]
        turn = hinge_angle(x[vertices]) - geometry["hinge_rest"]
        turn = (turn + np.pi) % (2 * np.pi) - np.pi
        energy = geometry["hinge_k"] * frame.get("hinge_whole", True) * turn**2 / 2
        own = np.bincount(faces.ravel(), np.repeat(area / 3, 3), minlength=n)
        total = np.bincount(standing(geometry, frame)[vertices].ravel(), np.repeat(energy / 4, 4), minlength=n)
        if "patches" in geometry:
            second = np.einsum("kma,kac->kmc", geometry["patch_weight"], x[geometry["patches"]])
            energy = np.sum(geometry["patch_factor"] * np.sum(second**2, axis=2), axis=1) / 2
            total = total + np.bincount(geometry["patch_faces"].ravel(), np.repeat(energy / 3, 3), minlength=n)
        return total / np.where(own > 0, own, 1)
    w = deformation(x, faces, uv)
    if name == "stretch":
        values = principal_stretches(w)[:, 0]
    elif name == "limit":
        values = _used(w, geometry["face_limit"])
    else:
        length = np.linalg.norm(w[:, :, 0], axis=1) * np.linalg.norm(w[:, :, 1], axis=1)
        values = np.arcsin(np.clip(np.einsum("mi,mi->m", w[:, :, 0], w[:, :, 1]) / np.maximum(length, 1e-300), -1, 1))
    return on_vertices(values, faces, area, n)


def require(name: str, geometry: dict[str, np.ndarray]) -> None:
    """Raises SceneError where a run has nothing to show of a quantity."""
    if name in MARKS and MARKS[name] not in geometry:
        raise SceneError(f"heat {name!r}: {ABSENT[name]}")


def _used(w: np.ndarray, limit: np.ndarray) -> np.ndarray:
    """(m,) how much of a triangle's limits (m, 5: b_u, b_v, L_u, L_v, L of shear; NaN if none) is used: 1 at the first."""
    u, v = w[:, :, 0], w[:, :, 1]
    parts = [(np.linalg.norm(side, axis=1) - limit[:, k]) / (limit[:, k + 2] - limit[:, k]) for k, side in enumerate((u, v))]
    parts.append(np.abs(np.einsum("mi,mi->m", u, v)) / limit[:, 4])
    return np.fmax(np.fmax(np.fmax(parts[0], parts[1]), parts[2]), 0.0)


def _creases(geometry: dict[str, np.ndarray], frame: dict[str, np.ndarray]) -> np.ndarray:
    """(n,) the largest curvature at rest [1/m] of a vertex's edges, or of its triangles where they bend by curvatures."""
    out = np.zeros(len(frame["x"]))
    if "hinge_arc" in geometry:
        stays = geometry["hinge_rest"] + (1 - geometry["hinge_own"]) * frame.get("hinge_crease", 0.0)
        stays = stays * frame.get("hinge_whole", True)
        for end in (0, 1):
            at = standing(geometry, frame)[geometry["hinges"][:, end]]
            np.maximum.at(out, at, np.abs(stays) / geometry["hinge_arc"])
    if "patch_crease" in frame:
        for corner in geometry["patch_faces"].T:
            np.maximum.at(out, corner, (1 - geometry["patch_own"]) * frame["patch_crease"])
    return out


def standing(geometry: dict[str, np.ndarray], frame: dict[str, np.ndarray]) -> np.ndarray:
    """(n,) the vertex that each is drawn as: where cloth may tear, one stands for all corners that still hang together."""
    out = np.arange(len(frame["x"]))
    if "corners" in geometry:
        out[geometry["corners"]] = frame.get("faces", geometry["faces"])
    return out


def in_one(geometry: dict[str, np.ndarray], frame: dict[str, np.ndarray], force: np.ndarray) -> np.ndarray:
    """(n, 3) forces on vertices (n, 3), those on corners that hang together summed on the one that stands for them."""
    at, n = standing(geometry, frame), len(force)
    return np.stack([np.bincount(at, part, minlength=n) for part in force.T.astype(np.float64)], axis=1)


def on_vertices(values: np.ndarray, faces: np.ndarray, area: np.ndarray, n: int) -> np.ndarray:
    """(n,) means of per-triangle values (m,) over each vertex's triangles, weighted by area."""
    weight = np.repeat(area, 3)
    total = np.bincount(faces.ravel(), weight, minlength=n)
    return np.bincount(faces.ravel(), weight * np.repeat(values, 3), minlength=n) / np.where(total > 0, total, 1)


def vertex_normals(x: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """(n, 3) normals, the mean of a vertex's triangles weighted by area; 0 if it has none."""
    a, b, c = (x[faces[:, k]] for k in range(3))
    normal = np.cross(b - a, c - a)
    out = np.zeros_like(x)
    for d in range(3):
        out[:, d] = sum(np.bincount(faces[:, k], normal[:, d], minlength=len(x)) for k in range(3))
    return out / np.maximum(np.linalg.norm(out, axis=1, keepdims=True), 1e-30)
