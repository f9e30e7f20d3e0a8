"""Enclosed volumes of cloth: the faces that, sewn together, are a closed surface, and their outer side. numpy only."""

from dataclasses import dataclass

import numpy as np

from ..backend.ordering import components
from ..errors import SceneError
from ..scene.inflation import Inflation
from ..scene.mesh import facing
from ..scene.scene import Scene

FLAT = 1e-12  # part of area^(3/2) below which a volume has no sign


@dataclass(frozen=True, eq=False)
class Enclosure:
    """A closed piece of cloth.

    Attributes:
        inflation: its description.
        name: of the cloth and its part, with a number where that is several pieces.
        faces: (m, 3) vertices in the simulation's order of arrays, one for all that are sewn together, counterclockwise from
            outside.
        area: [m^2] and volume [m^3] at time 0.
    """

    inflation: Inflation
    name: str
    faces: np.ndarray
    area: float
    volume: float


def enclosures(scene: Scene) -> list[Enclosure]:
    """All that a scene inflates.

    Raises:
        SceneError: a piece that is open, has one side only, or shares faces with another.
    """
    x, cluster = np.concatenate([c.positions for c in scene.cloths]), cluster_ids(scene)
    at = np.zeros_like(x)  # of all that are sewn together, the mean
    np.add.at(at, cluster, x)
    at /= np.maximum(np.bincount(cluster, minlength=len(x)), 1)[:, None]
    out: list[Enclosure] = []
    taken = np.zeros((0, 3), dtype=np.int64)
    for inflation in scene.pieces:
        rows = inflation.cloth.mesh.faces
        if inflation.part is not None:
            rows = rows[np.isin(rows, inflation.part).all(axis=1)]
        mine = rows + inflation.cloth.start
        if len(np.unique(both := np.concatenate([taken, mine]), axis=0)) < len(both):
            raise SceneError(f"inflate: {inflation.name!r} has faces that are inflated already")
        taken, faces = both, cluster[mine]
        between = _between(faces)
        mine, faces = mine[between], faces[between]
        if not len(faces):
            raise SceneError(f"inflate: {inflation.name!r} encloses nothing: each of its faces is sewn onto another")
        _refuse_open(inflation, mine, faces)
        label = components(len(x), *np.concatenate([faces[:, [0, 1]], faces[:, [0, 2]]]).T)[faces[:, 0]]
        parts = np.unique(label)
        if len(parts) > 1 and inflation.volume is not None:
            raise SceneError(f"inflate: {inflation.name!r} is {len(parts)} closed pieces, which have a volume each: name "
                             "the one that is meant with `part`")
        for k, part in enumerate(parts):
            name = inflation.name if len(parts) == 1 else f"{inflation.name}#{k}"
            out.append(_oriented(inflation, name, faces[label == part], at))
    return out


def cluster_ids(scene: Scene) -> np.ndarray:
    """(n,) one vertex for all that are sewn together, itself where nothing is sewn."""
    pairs = [(s.a + s.cloth.start, s.b + s.cloth.start) for s in scene.seams]
    a, b = (np.concatenate([np.zeros(0, dtype=np.int64), *(p[k] for p in pairs)]) for k in (0, 1))
    return components(scene.vertex_count, a, b)


def volume(x: np.ndarray, faces: np.ndarray) -> float:
    """[m^3] enclosed by faces (m, 3), counterclockwise from outside, with corners at x (n, 3) [m]."""
    a, b, c = (x[faces[:, k]] - x[faces[0, 0]] for k in range(3))
    return float(np.einsum("mi,mi->", a, np.cross(b, c)) / 6)


def _oriented(inflation: Inflation, name: str, faces: np.ndarray, x: np.ndarray) -> Enclosure:
    """With all faces counterclockwise from outside: their volume at time 0 is positive, or they are as most are."""
    turned = facing(faces)
    if turned is None:
        raise SceneError(f"inflate: {name!r} has one side only, like a Klein bottle: it encloses nothing")
    faces = np.where(turned[:, None], faces[:, ::-1], faces)
    a, b, c = (x[faces[:, k]] for k in range(3))
    area = float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)
    enclosed = volume(x, faces)
    if enclosed < -FLAT * area**1.5:
        faces, enclosed = faces[:, ::-1], -enclosed
    return Enclosure(inflation, name, faces, area, enclosed)


def _between(faces: np.ndarray) -> np.ndarray:
    """(m,) whether faces enclose something: not those sewn onto another one by all three corners, as in a pillow's corner."""
    _, which, count = np.unique(np.sort(faces, axis=1), axis=0, return_inverse=True, return_counts=True)
    return count[which.reshape(-1)] != 2


def _refuse_open(inflation: Inflation, vertices: np.ndarray, faces: np.ndarray) -> None:
    """Says which borders a piece has, of how many edges; vertices (m, 3) as they are, and as sewn together."""
    ends = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    edges, which, count = np.unique(np.sort(ends, axis=1), axis=0, return_inverse=True, return_counts=True)
    if count.max() > 2:
        i, j = edges[count.argmax()].tolist()
        raise SceneError(f"inflate: {count.max()} triangles of {inflation.name!r} meet at the edge of vertices {i} and {j}, "
                         "seams included: name the closed pieces one by one with `part`")
    if count.min() == 2:
        return
    alone = count[which.reshape(-1)] == 1
    own = np.concatenate([vertices[:, [0, 1]], vertices[:, [1, 2]], vertices[:, [2, 0]]])[alone] - inflation.cloth.start
    label = components(int(edges.max()) + 1, *ends[alone].T)[ends[alone][:, 0]]
    borders = []
    for border in np.unique(label):
        mine = own[label == border]
        groups = [name for name, index in inflation.cloth.mesh.groups.items() if np.isin(mine, index).all()]
        where = f"along {groups[0]!r}" if groups else f"at vertices {mine[0, 0]}, {mine[0, 1]}, ..."
        borders.append(f"{len(mine)} edges {where}")
    more = f" and {len(borders) - 4} more" if len(borders) > 4 else ""
    raise SceneError(f"inflate: {inflation.name!r} is open: {'; '.join(borders[:4])}{more}. Sew it, close it with faces, or "
                     "name a closed piece with `part`")
