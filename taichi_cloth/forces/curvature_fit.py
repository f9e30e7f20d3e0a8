"""Second derivatives of vertex fields on a triangle mesh, by quadratics fitted to patches of it. numpy only."""

import math

import numpy as np

from ..scene.mesh import TriMesh, face_edges

CONIC = 1e-2  # singular values of a fit below this part of the largest are left out: six points near a conic


def curvatures(mesh: TriMesh) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Second derivatives of vertex fields, one set a triangle.

    Returns:
        (m, k) vertices, (m, 3, k) their weights for uu, uv, vv in the triangle's material plane [1/m^2], 0 for those
        that only fill a row up; (m,) areas [m^2].
    """
    m, area, corner = mesh.face_count, mesh.material_areas, _corners(mesh)
    ids, gradients, twin, turn = edge_gradients(mesh)
    B, vertices = np.zeros((m, 3, 24)), np.repeat(mesh.faces[:, :1], 24, axis=1)
    vertices[:, :6] = ids
    for k in range(3):
        row = np.arange(m) + k * m
        a, b, third = corner[:, k], corner[:, (k + 1) % 3], corner[:, (k + 2) % 3]
        n = np.stack([(b - a)[:, 1], -(b - a)[:, 0]], axis=1)
        n *= -np.sign(np.einsum("ki,ki->k", n, third - a))[:, None] / area[:, None]
        two = twin[row] >= 0
        B[:, :, :6] += _symmetric(n, gradients[row] * np.where(two, 0.5, 1.0)[:, None, None])
        t = np.flatnonzero(two)
        other = twin[row[t]]
        vertices[t, 6 + 6 * k:12 + 6 * k] = ids[other % m]
        B[t, :, 6 + 6 * k:12 + 6 * k] = _symmetric(n[t], 0.5 * turn[row[t]] @ gradients[other])
    return (*_merged(vertices, B), area)


def _symmetric(n: np.ndarray, g: np.ndarray) -> np.ndarray:
    """(k, 3, j) uu, uv, vv of the symmetric part of n (k, 2) times g (k, 2, j)."""
    u, v = n[:, :1], n[:, 1:]
    return np.stack([u * g[:, 0], (u * g[:, 1] + v * g[:, 0]) / 2, v * g[:, 1]], axis=1)


def _merged(vertices: np.ndarray, B: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Every vertex once a row, with the sum of its weights."""
    order = np.argsort(vertices, axis=1, kind="stable")
    v, w = np.take_along_axis(vertices, order, axis=1), np.take_along_axis(B, order[:, None, :], axis=2)
    group = np.cumsum(np.column_stack([np.zeros(len(v), dtype=int), v[:, 1:] != v[:, :-1]]), axis=1)
    count = int(group.max()) + 1
    out, ids = np.zeros((len(v), 3, count)), np.repeat(v[:, :1], count, axis=1)
    t = np.arange(len(v))[:, None]
    for part in range(3):
        np.add.at(out[:, part], (t, group), w[:, part])
    ids[t, group] = v
    return ids, out


def edge_gradients(mesh: TriMesh) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Gradients at the middles of edges, of a quadratic through each triangle and the vertices across its edges.

    At a border, where there is nothing across, a vertex across an edge of a neighbour stands in; if there is none
    either, the fit is that of least energy.

    Returns:
        (m, 6) vertices of each fit; (3m, 2, 6) weights of the gradient [1/m], row r for edge r // m of triangle r % m, in its
        material plane. Then, as `_unfold` gives them: the neighbour's row of the same edge or -1, turns from its plane.
    """
    m, corner = mesh.face_count, _corners(mesh)
    ids, second, twin, turn = _fits(mesh)
    slope = np.linalg.inv(np.concatenate([corner, np.ones((m, 3, 1))], axis=2))[:, :2]  # of barycentric coordinates
    flat = slope @ _quadratics(corner - corner[:, :1])  # of the planes through u^2/2, u v, v^2/2 at the corners
    out = []
    for k in range(3):
        p = (corner[:, k] + corner[:, (k + 1) % 3]) / 2 - corner[:, 0]
        zero = np.zeros(m)
        own = np.stack([np.stack([p[:, 0], p[:, 1], zero], axis=1), np.stack([zero, p[:, 0], p[:, 1]], axis=1)], axis=1)
        gradient = (own - flat) @ second
        gradient[:, :, :3] += slope
        out.append(gradient)
    return ids, np.concatenate(out), twin, turn


def _fits(mesh: TriMesh) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """(m, 6) vertices, (m, 3, 6) weights of the quadratic's second derivatives; twin and turn of `_unfold`."""
    faces, m, corner = mesh.faces, mesh.face_count, _corners(mesh)
    twin, turn, shift = _unfold(mesh)
    across, there = twin.reshape(3, m).T, (twin >= 0).reshape(3, m).T  # by triangle and edge: row of the neighbour's edge
    tip = np.where(there, faces[across % m, (across // m + 2) % 3], faces[:, :1])
    local = corner[across % m, (across // m + 2) % 3]
    rows = np.arange(m)[:, None] + m * np.arange(3)
    place = np.einsum("tkij,tkj->tki", turn[rows], local) + shift[rows]
    R = np.where(there[:, :, None], _excess(corner, place), 0.0)
    for t in np.flatnonzero(~there.all(axis=1) & there.any(axis=1)):
        taken = set(faces[t]) | set(tip[t, there[t]])
        further = []
        for k in np.flatnonzero(there[t]):
            other, side = int(across[t, k] % m), int(across[t, k] // m)
            for j in np.flatnonzero(there[other] & (np.arange(3) != side)):
                if tip[other, j] not in taken:
                    row = t + m * k
                    point = turn[row] @ place[other, j] + shift[row]
                    further.append((int(tip[other, j]), _excess(corner[t:t + 1], point[None, None])[0, 0], point))
        for slot in np.flatnonzero(~there[t]):
            best = max(further, key=lambda f: _spread(np.vstack([R[t], f[1]])), default=None)
            if best is not None:
                tip[t, slot], R[t, slot], place[t, slot] = best
                there[t, slot] = True
                further = [f for f in further if f[0] != best[0]]
    W = np.zeros((m, 3, 6))
    W[:, :, :3] = -_shares(corner, place)
    W[:, np.arange(3), 3 + np.arange(3)] = 1.0
    W[~there] = 0
    scale = np.array([1.0, math.sqrt(2.0), 1.0])  # the norm whose square the energy is
    inverse = np.linalg.pinv(R / scale, rcond=CONIC) / scale[:, None]
    return np.concatenate([faces, tip], axis=1), inverse @ W, twin, turn


def _unfold(mesh: TriMesh) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The neighbours across edges: row r is for edge r // m of triangle r % m.

    Returns:
        (3m,) the same edge's row in the neighbour or -1; (3m, 2, 2) turns and (3m, 2) shifts [m], the rigid motion that lays
        the neighbour's material plane beside the triangle.
    """
    faces, m, corner = mesh.faces, mesh.face_count, _corners(mesh)
    edges = face_edges(faces)
    order = np.lexsort((edges.max(axis=1), edges.min(axis=1)))
    s = np.sort(edges, axis=1)[order]
    same = np.flatnonzero((s[1:] == s[:-1]).all(axis=1))
    twin = np.full(3 * m, -1)
    twin[order[same]], twin[order[same + 1]] = order[same + 1], order[same]
    t, k = np.arange(3 * m) % m, np.arange(3 * m) // m
    a, b, third = corner[t, k], corner[t, (k + 1) % 3], corner[t, (k + 2) % 3]
    other, side = twin % m, twin // m
    c, d, tip = corner[other, side], corner[other, (side + 1) % 3], corner[other, (side + 2) % 3]
    flips = (edges[:, 0] == edges[twin, 0])[:, None]  # else the two triangles run along it in opposite ways
    c, d = np.where(flips, c, d), np.where(flips, d, c)
    mirrored = np.sign(_cross(b - a, third - a)) == np.sign(_cross(d - c, tip - c))
    here, there = _frame(b - a, np.ones(len(a))), _frame(d - c, np.where(mirrored, -1.0, 1.0))
    turn = here @ there.transpose(0, 2, 1)
    return twin, turn, (a + b) / 2 - np.einsum("rij,rj->ri", turn, (c + d) / 2)


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]


def _corners(mesh: TriMesh) -> np.ndarray:
    """(m, 3, 2) material coordinates [m] from the mesh's first corner: the fit does not depend on the origin, and loses digits
    far from it."""
    return mesh.corner_uv - mesh.corner_uv[0, 0]


def _frame(along: np.ndarray, hand: np.ndarray) -> np.ndarray:
    """(k, 2, 2) with columns along, and across to the left or, where hand is -1, to the right."""
    u = along / np.linalg.norm(along, axis=1)[:, None]
    return np.stack([u, hand[:, None] * np.stack([-u[:, 1], u[:, 0]], axis=1)], axis=2)


def _shares(corner: np.ndarray, place: np.ndarray) -> np.ndarray:
    """(m, j, 3) values at places (m, j, 2) of the linear functions that are 1 at one corner (m, 3, 2)."""
    inverse = np.linalg.inv(np.concatenate([corner, np.ones((len(corner), 3, 1))], axis=2))
    return np.concatenate([place, np.ones((*place.shape[:2], 1))], axis=2) @ inverse


def _excess(corner: np.ndarray, place: np.ndarray) -> np.ndarray:
    """(m, j, 3) u^2/2, u v and v^2/2 at places (m, j, 2), less the plane through their values at the corners."""
    origin = corner[:, :1]
    return _quadratics(place - origin) - _shares(corner, place) @ _quadratics(corner - origin)


def _quadratics(p: np.ndarray) -> np.ndarray:
    """u^2/2, u v, v^2/2"""
    return np.stack([p[..., 0] ** 2 / 2, p[..., 0] * p[..., 1], p[..., 1] ** 2 / 2], axis=-1)


def _spread(R: np.ndarray) -> float:
    """How far from degenerate rows are: the product of their singular values that are not 0."""
    values = np.linalg.svd(R, compute_uv=False)
    return float(np.prod(values[: min(3, int((np.abs(R).sum(axis=1) > 0).sum()))]))
