"""Rest geometry, triangle by triangle and hinge by hinge."""

import functools

import numpy as np


def area(uv):
    """Of a triangle in the material plane."""
    a, b = uv[1] - uv[0], uv[2] - uv[0]
    return abs(a[0] * b[1] - a[1] * b[0]) / 2


def pair(value):
    """(warp, weft)"""
    return tuple(map(float, value)) if np.ndim(value) else (float(value), float(value))


@functools.lru_cache(maxsize=4)
def hinges(mesh):
    """A dict a hinge: vertices (i, j, a, b), smaller area, length2 / (A_1 + A_2), across (2,), angle of the mesh as given."""
    sides = {}
    for t, face in enumerate(mesh.faces):
        for k in range(3):
            i, j = int(face[k]), int(face[(k + 1) % 3])
            sides.setdefault(frozenset((i, j)), []).append((t, i, j, int(face[(k + 2) % 3]), k))
    out, pairs = [], [meeting for meeting in sides.values() if len(meeting) == 2]
    corners = [(one[1], one[2], one[3], other[3]) for one, other in pairs]
    for ((s, i, j, a, k), (t, _, _, b, m)), angle in zip(pairs, angles(mesh.x[np.reshape(corners, (-1, 4)).astype(int)])):
        ways = [mesh.corner_uv[f][(c + 1) % 3] - mesh.corner_uv[f][c] for f, c in ((s, k), (t, m))]
        length = np.mean([np.linalg.norm(way) for way in ways])
        areas = [area(mesh.corner_uv[f]) for f in (s, t)]
        across = np.mean([(way[::-1] / np.linalg.norm(way)) ** 2 for way in ways], axis=0)
        out.append({"vertices": [i, j, a, b], "least": min(areas), "weight": length**2 / sum(areas), "across": across,
                    "angle": float(angle)})
    return out


def angles(x):
    """(n,) [rad] between the normals of the triangles (i, j, a) and (j, i, b) of hinges, x (n, 4, 3) their corners."""
    e, a, b = x[:, 1] - x[:, 0], x[:, 2] - x[:, 0], x[:, 3] - x[:, 0]
    n_a, n_b = np.cross(e, a), np.cross(b, e)
    along = np.einsum("ki,ki->k", np.cross(n_a, n_b), e) / np.linalg.norm(e, axis=1)
    return np.arctan2(along, np.einsum("ki,ki->k", n_a, n_b))
