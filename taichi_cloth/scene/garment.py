"""A garment: panels as one mesh, and the rows of vertices that are sewn to each other. numpy only."""

from __future__ import annotations

import math
import os
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from .. import checks
from ..errors import SceneError, shown
from .connected import components
from .mesh import TriMesh, face_edges

FLAT = 1e-2  # of its width by which a flat panel's vertices may be off its plane


class SewnRows(NamedTuple):
    """Two rows of a garment's vertices that are sewn to each other, one by one.

    Attributes:
        a, b: (k,) vertices.
        rest, stiffness, strength: as in `Scene.sew`.
    """

    a: np.ndarray
    b: np.ndarray
    rest: float | str = 0.0
    stiffness: float = 1.0
    strength: float | None = None


@dataclass(frozen=True, eq=False)
class Garment:
    """A garment, as `Scene.add_garment` takes it.

    Attributes:
        mesh: all panels, as they hang round the body; groups by the names of panels and of labels of edges.
        seams: rows of vertices that are sewn to each other; given as (a, b, rest), and where they differ from 1 and None,
            stiffness and strength.
        positions: (n, 3) where a dressed garment is [m]; the mesh's own where it was not dressed.
        fitted: whether `fitted` made it for a body.
    """

    mesh: TriMesh
    seams: tuple[SewnRows, ...]
    positions: np.ndarray = None  # type: ignore[assignment]
    fitted: bool = False

    def __post_init__(self) -> None:
        checks.instance("garment: mesh", self.mesh, TriMesh)
        n = self.mesh.vertex_count
        if not isinstance(self.seams, (list, tuple)):
            raise SceneError(f"garment: seams = {shown(self.seams)}: must be rows (a, b, rest) in a tuple")
        object.__setattr__(self, "seams", tuple(_seam(k, seam, n) for k, seam in enumerate(self.seams)))
        x = self.mesh.x if self.positions is None else self.positions
        object.__setattr__(self, "positions", checks.array("garment: positions", x, (n, 3), row="vertex"))
        object.__setattr__(self, "fitted", checks.flag("garment: fitted", self.fitted))

    def __repr__(self) -> str:
        return f"<Garment of {self.mesh.vertex_count:,} vertices, {len(self.seams)} seams>"

    def gap(self) -> float:
        """Largest distance [m] between vertices that are sewn to each other."""
        x = self.positions
        return max((float(np.linalg.norm(x[a] - x[b], axis=1).max()) for a, b, *_ in self.seams), default=0.0)

    def panel_of(self, vertex: int) -> str:
        """The panel that a vertex is of: of the groups that have it the largest, labels of edges being smaller."""
        having = {name: len(index) for name, index in self.mesh.groups.items() if vertex in index}
        return max(having, key=having.__getitem__, default="the garment")

    def parts(self) -> list[np.ndarray]:
        """The vertices (k,) of each part that seams or triangles hold together, the largest first."""
        edges, none = face_edges(self.mesh.faces), np.zeros(0, dtype=np.int64)
        a, b = (np.concatenate([edges[:, k], *(seam[k] for seam in self.seams), none]) for k in (0, 1))
        label = components(self.mesh.vertex_count, a, b)
        parts = [np.flatnonzero(label == k) for k in np.unique(label[self.mesh.faces])]
        return sorted(parts, key=len, reverse=True)

    def loose(self) -> tuple[str, ...]:
        """A note on the panels that no seam holds to the rest of a garment that has seams."""
        apart = self.parts()[1:] if self.seams else []
        if not apart:
            return ()
        names = ", ".join(repr(self.panel_of(int(rows[0]))) for rows in apart)
        return (f"no seam holds {names} to the rest of the garment: nothing keeps it there while it is put on",)

    def placed(self, turn: float = 0.0, shift: ArrayLike = (0.0, 0.0, 0.0)) -> Garment:
        """The garment turned as a whole about the vertical through the origin, and then moved, to where a body stands.

        Args:
            turn: [degrees], from z towards x.
            shift: (3,) [m].
        """
        angle = math.radians(checks.number("placed: turn", turn, "degrees"))
        c, s = math.cos(angle), math.sin(angle)
        x = self.positions @ np.array([[c, 0.0, -s], [0.0, 1.0, 0.0], [s, 0.0, c]])
        return replace(self, positions=x + checks.vector("placed: shift", shift, "m"))

    def moved(self, panel: str, by: ArrayLike) -> Garment:
        """The garment with a panel brought by (3,) [m] from where it hangs.

        Raises:
            SceneError: no such group, or a vector that is none.
        """
        rows, x = self._rows("moved", panel), self.positions.copy()
        x[rows] += checks.vector("moved: by", by, "m")
        return replace(self, positions=x)

    def bent(self, panel: str, around: ArrayLike, radius: float) -> Garment:
        """The garment with a flat panel bent round an axis beside it, as a sleeve that hangs above an arm round the arm.

        The panel stays where it is along the axis, and its middle on that side of it. A length u across the axis in the
        panel's plane comes to the angle u / radius: no length changes.

        Args:
            around: (2, 3) ends of the axis [m].
            radius: [m] at which it is bent.

        Raises:
            SceneError: no such group, one of fewer than three vertices, no axis, a panel that is not flat, stands across the
                axis or has its middle on it, or is wider than the way round.
        """
        rows, what = self._rows("bent", panel), f"bent: panel {panel!r}"
        if len(rows) < 3:
            raise SceneError(f"{what} has {len(rows)} vertices: no plane goes through them")
        low, high = checks.array("bent: around", around, (2, 3), row="end")
        r, x = checks.number("bent: radius", radius, "m", positive=True), self.positions[rows]
        middle = (x.min(axis=0) + x.max(axis=0)) / 2
        size, flat = np.linalg.svd(x - x.mean(axis=0), full_matrices=False)[1:]
        if not np.linalg.norm(high - low) > 0:
            raise SceneError("bent: both ends of the axis are in one place")
        v = (high - low) / np.linalg.norm(high - low)
        along, out = v - (v @ flat[2]) * flat[2], middle - low - ((middle - low) @ v) * v
        if not size[2] <= FLAT * size[1]:
            raise SceneError(f"{what} is not flat")
        if np.linalg.norm(along) < 0.5 or not np.linalg.norm(out) > FLAT * r:
            raise SceneError(f"{what} stands across the axis, or has its middle on it: turn or move it first")
        along, out = along / np.linalg.norm(along), out / np.linalg.norm(out)
        side = np.cross(v, out)
        across = np.cross(along, flat[2])
        u = (x - middle) @ (across if across @ side > 0 else -across)
        if np.ptp(u) > 2 * np.pi * r:
            raise SceneError(f"{what} is {np.ptp(u):.3g} m wide, and the way round is {2 * np.pi * r:.3g} m")
        angle, s = u / r, (middle - low) @ v + (x - middle) @ along
        there, positions = low + s[:, None] * v, self.positions.copy()
        positions[rows] = there + r * (np.cos(angle)[:, None] * out + np.sin(angle)[:, None] * side)
        return replace(self, positions=positions)

    def _rows(self, what: str, panel: str) -> np.ndarray:
        if panel not in self.mesh.groups:
            raise SceneError(f"{what}: there is no panel {shown(panel)}; there are {', '.join(self.mesh.groups)}")
        return self.mesh.groups[panel]

    def save(self, path: str | Path) -> None:
        """Writes a .npz that `load_garment` reads.

        Raises:
            SceneError: it cannot be written; the file before stays.
        """
        path = checks.path("path", path, SceneError)
        mesh, part = self.mesh, path.with_name(path.name + ".part")
        arrays = {"x": mesh.x, "faces": mesh.faces, "uv": mesh.uv, "flattened": np.array(mesh.flattened),
                  "notes": np.array(mesh.notes, dtype=str), "positions": self.positions,
                  **({} if mesh.texture is None else {"texture": mesh.texture}),
                  **({} if mesh.polygon is None else {"polygon": mesh.polygon}),
                  **{f"group_{name}": index for name, index in mesh.groups.items()},
                  **{f"weight_{name}": weight for name, weight in mesh.weights.items()},
                  **{f"seam_{k}": np.stack([a, b]) for k, (a, b, *_) in enumerate(self.seams)},
                  "rest": np.array([str(seam.rest) for seam in self.seams]),
                  "stiffness": np.array([seam.stiffness for seam in self.seams]),
                  "strength": np.array([np.inf if seam.strength is None else seam.strength for seam in self.seams])}
        try:
            with open(part, "wb") as file:
                np.savez_compressed(file, **arrays)  # type: ignore[arg-type]
            os.replace(part, path)
        except OSError as error:
            part.unlink(missing_ok=True)
            raise SceneError(f"{path}: cannot be written: {error.strerror or error}") from None


def seam_angle(what: str, rest: object) -> float | str:
    """A seam's angle at rest: 0 for "flat", "given", or a number [rad]."""
    if isinstance(rest, str):
        return 0.0 if checks.choice(what, rest, ("flat", "given")) == "flat" else "given"
    return checks.number(what, rest, "rad", least=-np.pi, most=np.pi)


def seam_strength(what: str, strength: object) -> float | None:
    """A force a length [N/m] at which a seam rips; None never does."""
    return checks.maybe(strength, checks.number, what, "N/m", positive=True)


def _seam(k: int, seam: object, n: int) -> SewnRows:
    if not (isinstance(seam, (list, tuple)) and 3 <= len(seam) <= 5):
        raise SceneError(f"garment: seam {k} = {shown(seam)}: must be (a, b, rest), with stiffness and strength after it")
    rows = [np.asarray(row) for row in seam[:2]]
    for row in rows:
        if row.ndim != 1 or not np.issubdtype(row.dtype, np.integer) or not len(row) or row.min() < 0 or row.max() >= n:
            raise SceneError(f"garment: seam {k}: its rows must be vertices from 0 to {n - 1}")
    if len(rows[0]) != len(rows[1]):
        raise SceneError(f"garment: seam {k}: {len(rows[0])} vertices to {len(rows[1])}")
    _, _, rest, stiffness, strength = SewnRows(*seam)
    strength = seam_strength(f"garment: strength of seam {k}", strength)
    if strength is not None and len(rows[0]) < 2:
        raise SceneError(f"garment: seam {k}: a single stitch has no strength, which is a force a length")
    return SewnRows(rows[0], rows[1], seam_angle(f"garment: rest of seam {k}", rest),
                    checks.number(f"garment: stiffness of seam {k}", stiffness, least=0.0), strength)
