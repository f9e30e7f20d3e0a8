"""Creases: edges of a cloth that are bent at rest, given one by one or as a line over the pattern. numpy only."""

from dataclasses import dataclass

import numpy as np

from .. import checks
from ..errors import SceneError
from .cloth import Cloth
from .mesh import TriMesh

ON = 1e-6  # of the pattern's extent that the ends of an edge may be off a line


@dataclass(frozen=True, eq=False)
class Crease:
    """Edges of a cloth with an angle of their own at rest; made by `Scene.crease`.

    Attributes:
        edges: (k, 2) vertices, the lower first.
        angle: (k,) at rest [rad].
        stiffness: factor of their bending stiffness.
    """

    cloth: Cloth
    edges: np.ndarray
    angle: np.ndarray
    stiffness: float

    def __repr__(self) -> str:
        return f"<Crease of {self.cloth.name!r} over {len(self.edges):,} edges>"


def make(cloth: Cloth, angle: object, line: object, edges: object, stiffness: object) -> Crease:
    """The crease of `Scene.crease`."""
    what = f"crease of {cloth.name!r}"
    if (line is None) == (edges is None):
        raise SceneError(f"{what}: give a line over the pattern, or edges")
    there = cloth.mesh.inner_edges
    if edges is None:
        chosen = along(what, cloth.mesh, there, line)
    else:
        n = cloth.mesh.vertex_count
        chosen = np.sort(checks.indices(f"{what}: edges", edges, n, width=2, row="edge"), axis=1)
        if not len(chosen):
            raise SceneError(f"{what}: no edges are named")
        lost = np.flatnonzero(~np.isin(chosen @ np.array([n, 1]), there @ np.array([n, 1])))
        if len(lost):
            a, b = chosen[lost[0]].tolist()
            raise SceneError(f"{what}: vertices {a} and {b} are not an edge between two triangles")
        if len(np.unique(chosen, axis=0)) < len(chosen):
            raise SceneError(f"{what}: an edge is named twice")
    if cloth.fabric.bend is None or cloth.fabric.bend.model != "hinge":
        raise SceneError(f"{what}: its fabric must bend, and over hinges: Bend(model=\"hinge\")")
    if checks.is_sequence(angle):
        angles = checks.array(f"{what}: angle", angle, (len(chosen),), row="edge")
        if np.abs(angles).max() > np.pi:
            raise SceneError(f"{what}: angle = {np.abs(angles).max():g} rad: must be from -pi to pi")
    else:
        angles = np.full(len(chosen), checks.number(f"{what}: angle", angle, "rad", least=-np.pi, most=np.pi))
    return Crease(cloth, chosen, angles, checks.number(f"{what}: stiffness", stiffness, least=0.0))


def along(what: str, mesh: TriMesh, there: np.ndarray, line: object) -> np.ndarray:
    """Those edges that lie on a line through points (k, 2) of the pattern."""
    points = checks.array(f"{what}: line", line, ("p", 2), row="point")
    if len(points) < 2:
        raise SceneError(f"{what}: a line has two points or more")
    extent = float(np.ptp(mesh.corner_uv.reshape(-1, 2), axis=0).max())
    n, code, on = mesh.vertex_count, [], []
    for k in range(3):  # edges where the pattern has them: once on either side of a seam in the texture
        a, b = mesh.corner_uv[:, k], mesh.corner_uv[:, (k + 1) % 3]
        ends = np.sort(np.stack([mesh.faces[:, k], mesh.faces[:, (k + 1) % 3]], axis=1), axis=1)
        code.append(ends @ np.array([n, 1]))
        on.append(np.any([_on(a, p, q, extent) & _on(b, p, q, extent) for p, q in zip(points[:-1], points[1:])], axis=0))
    found = there[np.isin(there @ np.array([n, 1]), np.concatenate(code)[np.concatenate(on)])]
    if not len(found):
        raise SceneError(f"{what}: no edge between two triangles lies on the line: mesh the pattern so that edges do, or give "
                         "edges")
    return found


def _on(x: np.ndarray, p: np.ndarray, q: np.ndarray, extent: float) -> np.ndarray:
    """(m,) whether points x (m, 2) are on the way from p to q."""
    way = q - p
    t = np.clip((x - p) @ way / max(float(way @ way), 1e-300), 0.0, 1.0)
    return np.linalg.norm(x - p - t[:, None] * way, axis=1) <= ON * extent
