"""Rest geometry of triangles and hinges in the material plane. numpy only."""

from dataclasses import dataclass, replace

import numpy as np

from ..scene.cloth import Cloth
from ..scene.mesh import TriMesh, face_edges


@dataclass(frozen=True)
class Triangles:
    """Triangles of a mesh.

    Attributes:
        vertices: (m, 3).
        inverse: (m, 2, 2) so that (w_u, w_v) = (x_1 - x_0, x_2 - x_0) @ inverse [1/m] (9).
        area: (m,) in the material plane [m^2].
    """

    vertices: np.ndarray
    inverse: np.ndarray
    area: np.ndarray


@dataclass(frozen=True)
class Hinges:
    """Pairs of triangles with a common edge.

    Attributes:
        vertices: (k, 4) edge i, j and the opposite vertices of the two triangles.
        faces: (k, 2) the triangles.
        length2: (k,) squared length of the edge in the material plane [m^2], the mean of its two sides.
        areas: (k, 2) of the two triangles [m^2].
        feet: (k, 2) where the perpendiculars from the opposite vertices meet the edge, in parts of it from i.
        across: (k, 2) squared components along u and v of the unit vector across the edge, the direction of curvature
            when the hinge bends; the mean of its two sides.
        angle: (k,) angle theta in the given shape.
    """

    vertices: np.ndarray
    faces: np.ndarray
    length2: np.ndarray
    areas: np.ndarray
    feet: np.ndarray
    across: np.ndarray
    angle: np.ndarray


def triangles(mesh: TriMesh) -> Triangles:
    """The triangles of a mesh."""
    corner = mesh.corner_uv
    edges = np.stack([corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]], axis=2)
    return Triangles(mesh.faces, np.linalg.inv(edges), mesh.material_areas)


def hinges(mesh: TriMesh) -> Hinges:
    """The hinges of a mesh: one for every edge with two triangles, across seams too."""
    faces, m = mesh.faces, mesh.face_count
    edges = face_edges(faces)
    low, high = edges.min(axis=1), edges.max(axis=1)
    order = np.lexsort((np.arange(3 * m), high, low))
    inner = np.flatnonzero((low[order][1:] == low[order][:-1]) & (high[order][1:] == high[order][:-1]))
    a, b = order[inner], order[inner + 1]  # rows of face_edges: corner `row // m` of triangle `row % m`
    opposite = np.concatenate([faces[:, 2], faces[:, 0], faces[:, 1]])
    vertices = np.column_stack([edges[a], opposite[a], opposite[b]])
    corner = mesh.corner_uv
    along = np.concatenate([corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 1], corner[:, 0] - corner[:, 2]])
    length_a, length_b = (np.linalg.norm(along[s], axis=1) for s in (a, b))
    across = sum((along[s][:, ::-1] / np.linalg.norm(along[s], axis=1)[:, None]) ** 2 for s in (a, b)) / 2
    areas = mesh.material_areas[np.column_stack([a % m, b % m])]
    third = np.concatenate([corner[:, 2] - corner[:, 0], corner[:, 0] - corner[:, 1], corner[:, 1] - corner[:, 2]])
    feet = np.column_stack([np.einsum("ij,ij->i", third[s], along[s]) for s in (a, b)])
    feet /= np.column_stack([length_a, length_b]) ** 2
    feet[:, 1] = np.where(edges[a, 0] == edges[b, 0], feet[:, 1], 1 - feet[:, 1])
    sides = np.column_stack([a % m, b % m])
    return Hinges(vertices, sides, ((length_a + length_b) / 2) ** 2, areas, feet, across, hinge_angle(mesh.x[vertices]))


def hinges_of(cloth: Cloth) -> Hinges:
    """The hinges of a cloth's mesh, also where the corners of its triangles are apart."""
    h = hinges(cloth.whole)
    if cloth.split is None:
        return h
    i, j, a, b = h.vertices.T
    first, second = h.faces.T
    of = cloth.split.corners
    return replace(h, vertices=np.stack([of(i, first), of(j, first), of(a, first), of(b, second)], axis=1))


def seam_hinges(mesh: TriMesh, a: np.ndarray, b: np.ndarray) -> Hinges:
    """Hinges over a seam of rows a, b (k,) of a mesh: where two vertices that follow each other are the ends of a border edge
    in both rows. Edge and first triangle are those of row a.
    """
    faces, corner = mesh.faces, mesh.corner_uv
    m, borders = len(faces), mesh.border_edges
    both = np.array([[borders.get((min(i, j), max(i, j)), -1) for i, j in zip(row[:-1].tolist(), row[1:].tolist())]
                     for row in (a, b)], dtype=np.int64).reshape(2, -1)
    k = np.flatnonzero((both >= 0).all(axis=0) & (both[0] != both[1]))
    lengths, areas, sides, across, tips = [], [], [], [], []
    for side, row in ((0, a), (1, b)):
        f, c = both[side, k] % m, both[side, k] // m
        along = corner[f, (c + 1) % 3] - corner[f, c]
        length = np.linalg.norm(along, axis=1)
        foot = np.einsum("ij,ij->i", corner[f, (c + 2) % 3] - corner[f, c], along) / length**2
        forward = faces[f, c] == row[k]  # the triangle's edge begins where the row's does
        lengths.append(length)
        areas.append(mesh.material_areas[f])
        sides.append(np.where(forward, foot, 1 - foot))
        across.append((along[:, ::-1] / length[:, None]) ** 2)
        tips.append(faces[f, (c + 2) % 3])
    turned = faces[both[0, k] % m, both[0, k] // m] != a[k]  # edges run as those of the triangles of row a do
    i, j = np.where(turned, a[k + 1], a[k]), np.where(turned, a[k], a[k + 1])
    feet = np.stack(sides, axis=1)
    feet = np.where(turned[:, None], 1 - feet, feet)
    vertices = np.stack([i, j, *tips], axis=1)
    return Hinges(vertices, both[:, k].T % m, ((lengths[0] + lengths[1]) / 2) ** 2, np.stack(areas, axis=1), feet,
                  (across[0] + across[1]) / 2, hinge_angle(mesh.x[vertices]))


def hinge_angle(x: np.ndarray) -> np.ndarray:
    """(k,) angle theta in (-pi, pi] between the normals of two triangles; x (k, 4, 3) as in `Hinges.vertices`."""
    e, a, b = x[:, 1] - x[:, 0], x[:, 2] - x[:, 0], x[:, 3] - x[:, 0]
    n_a, n_b = np.cross(e, a), np.cross(b, e)
    sine = np.einsum("ij,ij->i", np.cross(n_a, n_b), e) / np.maximum(np.linalg.norm(e, axis=1), 1e-300)
    return np.arctan2(sine, np.einsum("ij,ij->i", n_a, n_b))


def flat_turns(h: Hinges) -> np.ndarray:
    """(k, 4) d theta / d height of a flat hinge's vertices [1/m], height going along the normals."""
    per_height = -np.sqrt(h.length2)[:, None] / (2 * h.areas)
    return np.column_stack([-((1 - h.feet) * per_height).sum(axis=1), -(h.feet * per_height).sum(axis=1), per_height])


def row_sums(vertices: np.ndarray, sizes: np.ndarray, mass: np.ndarray) -> np.ndarray:
    """(n,) row sums of the sizes of blocks of M^-1 K; the largest bounds its eigenvalues. [Gershgorin]

    Args:
        vertices: (m, k) of the elements; sizes: (m, k, k) of their blocks.
        mass: (n,).
    """
    return np.bincount(vertices.ravel(), sizes.sum(axis=2).ravel(), len(mass)) / mass


def lumped_mass(mesh: TriMesh, density: float | np.ndarray) -> np.ndarray:
    """(n,) a third of the mass of each of a vertex's triangles [kg]; density of all, or (m,) of each [kg/m^2]."""
    mass = np.zeros(mesh.vertex_count)
    np.add.at(mass, mesh.faces.ravel(), np.repeat(mesh.material_areas * density / 3, 3))
    return mass
