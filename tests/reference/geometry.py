"""Where cloth is against solids and against itself, from positions alone: distances, depths, crossings.

Nothing of the simulator's own geometry is used. Solids are described by their shapes' numbers and posed at a time here;
signs that decide whether something crosses are those of exact arithmetic where floating point leaves a doubt.
"""

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial.transform import Rotation

ORIENT = (7 + 56 * 2.0**-53) * 2.0**-53  # of the permanent: error of a 3x3 determinant of differences [Shewchuk 1997]
LEVELS, FINE = 14, 4e-3  # halvings of triangles in the search for their lowest point, and its error over the reach
CHUNK = 200_000  # rows of pairs at a time


# solids at a time

def pose(solid, t: float) -> tuple[np.ndarray, np.ndarray]:
    """(R (3, 3), p (3,)) of a solid at time t [s]: world = R local + p."""
    p = np.array(solid.position(t) if callable(solid.position) else solid.position, dtype=float)
    r = np.array(solid.rotation(t) if callable(solid.rotation) else solid.rotation, dtype=float)
    return (Rotation.from_rotvec(r).as_matrix() if r.shape == (3,) else r), p


def triangles(solid, t: float) -> tuple[np.ndarray, np.ndarray]:
    """(vertices (n, 3) in the world at time t, faces (m, 3)) of a solid mesh or of a sharp box."""
    shape = solid.shape
    if hasattr(shape, "faces"):
        x, faces = _mesh_at(shape, t), np.asarray(shape.faces)
    else:
        x = np.array([[i, j, k] for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)]) * np.array(shape.size) / 2
        quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
        faces = np.array([f for a, b, c, d in quads for f in ((a, b, c), (a, c, d))])
    R, p = pose(solid, t)
    return x @ R.T + p, faces


def _mesh_at(shape, t: float) -> np.ndarray:
    frames = np.asarray(shape.x, dtype=float)
    if len(frames) == 1:
        return frames[0]
    at = np.clip(t * shape.fps, 0, len(frames) - 1)
    k = min(int(np.floor(at)), len(frames) - 2)
    return (1 - (at - k)) * frames[k] + (at - k) * frames[k + 1]


def signed_distance(solid, t: float, q: np.ndarray) -> np.ndarray:
    """(k,) distance [m] of points (k, 3) from a solid's surface at time t, negative inside; of an open mesh never negative."""
    if hasattr(solid.shape, "faces"):
        x, faces = triangles(solid, t)
        d = distance_to_triangles(q, x, faces)
        return np.where(winding(q, x, faces) > 0.5, -d, d) if is_closed(faces) else d
    R, p = pose(solid, t)
    return _local_distance(solid.shape, (q - p) @ R)


def _local_distance(shape, q: np.ndarray) -> np.ndarray:
    """The same for an analytic shape in its own frame, told by what it is made of."""
    if hasattr(shape, "normal"):
        n = np.array(shape.normal, dtype=float)
        return q @ n / np.linalg.norm(n)
    if hasattr(shape, "length"):  # a cylinder along y
        out = np.stack([np.hypot(q[:, 0], q[:, 2]) - shape.radius, np.abs(q[:, 1]) - shape.length / 2])
    elif hasattr(shape, "size"):  # a box, its edges rounded
        out = (np.abs(q) - np.array(shape.size) / 2 + shape.radius).T
    elif hasattr(shape, "a"):  # a capsule
        a, b = np.array(shape.a, dtype=float), np.array(shape.b, dtype=float)
        s = np.clip((q - a) @ (b - a) / ((b - a) @ (b - a)), 0, 1)
        return np.linalg.norm(q - a - s[:, None] * (b - a), axis=1) - shape.radius
    else:
        return np.linalg.norm(q, axis=1) - shape.radius
    rounding = 0.0 if hasattr(shape, "length") else shape.radius
    return np.linalg.norm(np.maximum(out, 0), axis=0) + np.minimum(out.max(axis=0), 0) - rounding


def is_closed(faces: np.ndarray) -> bool:
    """Whether every edge has two triangles."""
    edges = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    return bool((np.unique(edges, axis=0, return_counts=True)[1] == 2).all())


def winding(q: np.ndarray, x: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """(k,) how often a mesh goes round points (k, 3), outside 0. [Van Oosterom and Strackee 1983]"""
    out = np.zeros(len(q))
    inside = ((q >= x.min(axis=0)) & (q <= x.max(axis=0))).all(axis=1)
    for i in np.flatnonzero(inside):
        a, b, c = (x[faces[:, k]] - q[i] for k in range(3))
        la, lb, lc = (np.linalg.norm(v, axis=1) for v in (a, b, c))
        volume = np.einsum("ij,ij->i", a, np.cross(b, c))
        rest = la * lb * lc + (a * b).sum(1) * lc + (b * c).sum(1) * la + (c * a).sum(1) * lb
        out[i] = 2 * np.arctan2(volume, rest).sum() / (4 * np.pi)
    return out


# distances

def point_triangle(p: np.ndarray, a: np.ndarray, b: np.ndarray, c: np.ndarray) -> np.ndarray:
    """(k,) distance of points from triangles, row by row."""
    n = np.cross(b - a, c - a)
    nn = np.einsum("ij,ij->i", n, n)
    over = nn > 0
    for u, v in ((a, b), (b, c), (c, a)):  # whether the foot is on the inner side of every edge
        over &= np.einsum("ij,ij->i", np.cross(v - u, p - u), n) >= 0
    flat = np.abs(np.einsum("ij,ij->i", p - a, n)) / np.sqrt(np.where(nn > 0, nn, 1))
    rim = np.minimum(point_segment(p, a, b), np.minimum(point_segment(p, b, c), point_segment(p, c, a)))
    return np.where(over, flat, rim)


def point_segment(p: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """(k,) distance of points from segments, row by row."""
    e = b - a
    s = np.clip(np.einsum("ij,ij->i", p - a, e) / np.maximum(np.einsum("ij,ij->i", e, e), 1e-300), 0, 1)
    return np.linalg.norm(p - a - s[:, None] * e, axis=1)


def segment_segment(p: np.ndarray, q: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """(k,) distance of segments, row by row: at an end of one of them, or where their lines are nearest."""
    out = np.minimum(np.minimum(point_segment(p, a, b), point_segment(q, a, b)),
                     np.minimum(point_segment(a, p, q), point_segment(b, p, q)))
    u, w, r = q - p, b - a, p - a
    uu, ww, uw = (np.einsum("ij,ij->i", m, n) for m, n in ((u, u), (w, w), (u, w)))
    ur, wr = np.einsum("ij,ij->i", u, r), np.einsum("ij,ij->i", w, r)
    det = uu * ww - uw**2
    crossed = det > 1e-12 * uu * ww
    det = np.where(crossed, det, 1)
    s, t = (uw * wr - ww * ur) / det, (uu * wr - uw * ur) / det
    inner = crossed & (s > 0) & (s < 1) & (t > 0) & (t < 1)
    between = np.linalg.norm(r + s[:, None] * u - t[:, None] * w, axis=1)
    return np.where(inner, np.minimum(out, between), out)


def triangle_triangle(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """(k,) distance of triangles (k, 3, 3), row by row, that do not cross."""
    out = np.full(len(a), np.inf)
    for first, second in ((a, b), (b, a)):
        for k in range(3):
            out = np.minimum(out, point_triangle(first[:, k], *second.swapaxes(0, 1)))
    for j in range(3):
        for k in range(3):
            out = np.minimum(out, segment_segment(a[:, j], a[:, (j + 1) % 3], b[:, k], b[:, (k + 1) % 3]))
    return out


def distance_to_triangles(q: np.ndarray, x: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """(k,) distance of points (k, 3) from the nearest of triangles, each against every one."""
    out = np.full(len(q), np.inf)
    rows = max(1, CHUNK // len(faces))
    for i in range(0, len(q), rows):
        part = q[i: i + rows]
        p = np.repeat(part, len(faces), axis=0)
        a, b, c = (np.tile(x[faces[:, k]], (len(part), 1)) for k in range(3))
        out[i: i + rows] = point_triangle(p, a, b, c).reshape(len(part), len(faces)).min(axis=1)
    return out


SAMPLES = np.array([(i, j, 4 - i - j) for i in range(5) for j in range(5 - i)]) / 4  # of a triangle, by its corners


def clearance(solid, t: float, x: np.ndarray, faces: np.ndarray, reach: float, sampled: bool = False) -> np.ndarray:
    """(m,) least distance [m] of every face of cloth from a solid, its edges and corners included.

    From a mesh it is 0 where they cross; from other solids it is negative by how deep it goes. Faces that stay farther away
    than `reach` [m] may be given any number above that. `sampled`: from analytic solids at 15 points of every face alone.
    """
    if hasattr(solid.shape, "faces"):
        y, others = triangles(solid, t)
        i, j = boxes_within(x[faces], y[others], reach)
        out = np.full(len(faces), np.inf)
        for k in range(0, len(i), CHUNK):
            rows = slice(k, k + CHUNK)
            np.minimum.at(out, i[rows], triangle_triangle(x[faces[i[rows]]], y[others[j[rows]]]))
        e, f, g, h = crossing_faces(x, faces, y, others)
        out[np.concatenate([e, h])] = 0.0
        return out
    if sampled:
        at = SAMPLES @ x[faces]
        return signed_distance(solid, t, at.reshape(-1, 3)).reshape(len(faces), -1).min(axis=1)
    exact = _from_core(solid, t, x[faces])
    return _lowest(lambda q: signed_distance(solid, t, q), x[faces], reach) if exact is None else exact


def _from_core(solid, t: float, corners: np.ndarray) -> np.ndarray | None:
    """(m,) exact clearance of triangles (m, 3, 3) from what is round a point or a segment, or a plane; None from others."""
    shape, (R, p) = solid.shape, pose(solid, t)
    local = (corners - p) @ R
    if hasattr(shape, "normal"):
        return _local_distance(shape, local.reshape(-1, 3)).reshape(-1, 3).min(axis=1)
    if hasattr(shape, "length") or hasattr(shape, "size"):
        return None
    ends = [shape.a, shape.b] if hasattr(shape, "a") else [np.zeros(3)] * 2
    a, b = (np.tile(np.asarray(end, dtype=float), (len(local), 1)) for end in ends)
    u, v, w = local.swapaxes(0, 1)
    out = np.minimum(point_triangle(a, u, v, w), point_triangle(b, u, v, w))
    for first, second in ((u, v), (v, w), (w, u)):
        out = np.minimum(out, segment_segment(a, b, first, second))
    through = orientation(a, b, u, v) + orientation(a, b, v, w) + orientation(a, b, w, u)
    sides = orientation(u, v, w, a) * orientation(u, v, w, b)
    out[(np.abs(through) == 3) & (sides < 0)] = 0.0
    return out - shape.radius


def _lowest(measure, corners: np.ndarray, reach: float) -> np.ndarray:
    """(m,) lowest value on triangles (m, 3, 3) of a function that changes no faster than one goes, by bounds."""
    owner, part = np.arange(len(corners)), corners
    least = np.full(len(corners), np.inf)
    for _ in range(LEVELS):
        middle = part.mean(axis=1)
        here = measure(middle)
        np.minimum.at(least, owner, np.minimum(here, measure(part.reshape(-1, 3)).reshape(-1, 3).min(axis=1)))
        bound = here - np.linalg.norm(part - middle[:, None], axis=2).max(axis=1)
        more = (bound < least[owner] - FINE * reach) & (bound < reach)
        if not more.any():
            break
        owner, part = np.repeat(owner[more], 4), _quarters(part[more])
    return least


def _quarters(part: np.ndarray) -> np.ndarray:
    a, b, c = part.swapaxes(0, 1)
    ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
    four = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
    return np.stack([np.stack(f, axis=1) for f in four], axis=1).reshape(-1, 3, 3)


def boxes_within(a: np.ndarray, b: np.ndarray, reach: float) -> tuple[np.ndarray, np.ndarray]:
    """(i, j) of items a (n, k, 3) and b (m, l, 3) with boxes within reach of each other, by a sweep along an axis."""
    low_a, high_a = a.min(axis=1) - reach, a.max(axis=1) + reach
    low_b, high_b = b.min(axis=1), b.max(axis=1)
    among = np.flatnonzero(((low_b <= high_a.max(axis=0)) & (high_b >= low_a.min(axis=0))).all(axis=1))
    if not len(among):
        return among, among
    low_b, high_b = low_b[among], high_b[among]
    axis = int(np.argmax(np.ptp(np.concatenate([low_a, low_b]), axis=0)))
    order = np.argsort(low_b[:, axis], kind="stable")
    widest = float((high_b - low_b)[:, axis].max())
    first = np.searchsorted(low_b[order, axis], low_a[:, axis] - widest, "left")
    last = np.searchsorted(low_b[order, axis], high_a[:, axis], "right")
    count = np.maximum(last - first, 0)
    i = np.repeat(np.arange(len(a)), count)
    j = order[np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count) + np.repeat(first, count)]
    for k in (axis, axis - 1, axis - 2):  # fewer are left each time
        near = (low_a[i, k] <= high_b[j, k]) & (high_a[i, k] >= low_b[j, k])
        i, j = i[near], j[near]
    return i, among[j]


# crossings

def orientation(a: np.ndarray, b: np.ndarray, c: np.ndarray, d: np.ndarray) -> np.ndarray:
    """(k,) sign of det(a - d, b - d, c - d), row by row, exactly."""
    u, v, w = a - d, b - d, c - d
    minors = [(e[:, 0] * f[:, 1], f[:, 0] * e[:, 1]) for e, f in ((v, w), (w, u), (u, v))]
    det = sum((p - q) * z for (p, q), z in zip(minors, (u[:, 2], v[:, 2], w[:, 2])))
    size = sum((np.abs(p) + np.abs(q)) * np.abs(z) for (p, q), z in zip(minors, (u[:, 2], v[:, 2], w[:, 2])))
    sign = np.sign(det).astype(int)
    level = ((u == 0) & (v == 0) & (w == 0)).any(axis=1)  # all four in one plane across an axis
    sign[level] = 0
    unsure = np.flatnonzero((np.abs(det) <= ORIENT * size) & ~level)
    if len(unsure):
        p, q, r, s = _whole(np.stack([point[unsure] for point in (a, b, c, d)])).swapaxes(1, 2)
        (u0, u1, u2), (v0, v1, v2), (w0, w1, w2) = p - s, q - s, r - s
        exact = u0 * (v1 * w2 - v2 * w1) - u1 * (v0 * w2 - v2 * w0) + u2 * (v0 * w1 - v1 * w0)
        sign[unsure] = (exact > 0).astype(int) - (exact < 0).astype(int)
    return sign


def _whole(numbers: np.ndarray) -> np.ndarray:
    """Numbers as Python's integers, which have no largest, in a unit of which all are whole multiples."""
    part, power = np.frexp(numbers.astype(float))
    return (part * 2.0**53).astype(np.int64).astype(object) << (power - power.min()).astype(object)


def edges_through(x: np.ndarray, edges: np.ndarray, y: np.ndarray, faces: np.ndarray,
                  same: bool = False) -> tuple[np.ndarray, np.ndarray]:
    """Rows (i, j) of edges (k, 2) of x that pass through faces (m, 3) of y; touching is none. `same`: of one mesh."""
    i, j = boxes_within(x[edges], y[faces], 0.0)
    if same:
        apart = ~(edges[i][:, :, None] == faces[j][:, None, :]).any(axis=(1, 2))
        i, j = i[apart], j[apart]
    p, q = x[edges[i, 0]], x[edges[i, 1]]
    a, b, c = (y[faces[j, k]] for k in range(3))
    sides = orientation(a, b, c, p) * orientation(a, b, c, q) < 0
    i, j, p, q, a, b, c = (v[sides] for v in (i, j, p, q, a, b, c))
    turns = orientation(p, q, a, b) + orientation(p, q, b, c) + orientation(p, q, c, a)
    through = np.abs(turns) == 3
    return i[through], j[through]


def edges_of(faces: np.ndarray) -> np.ndarray:
    """(k, 2) edges, each once."""
    both = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    return np.unique(both, axis=0)


def crossing_faces(x: np.ndarray, faces: np.ndarray, y: np.ndarray, others: np.ndarray) -> tuple[np.ndarray, ...]:
    """(faces of x with an edge through y, faces of y there, faces of y with an edge through x, faces of x there)."""
    out = []
    for (p, f), (q, g) in (((x, faces), (y, others)), ((y, others), (x, faces))):
        edges = np.concatenate([f[:, [0, 1]], f[:, [1, 2]], f[:, [2, 0]]])
        i, j = edges_through(p, edges, q, g)
        out += [i % len(f), j]
    return tuple(out)


def count_crossings(x: np.ndarray, faces: np.ndarray, y: np.ndarray, others: np.ndarray) -> int:
    """Number of edges through triangles, of x through y and of y through x."""
    return len(edges_through(x, edges_of(faces), y, others)[0]) + len(edges_through(y, edges_of(others), x, faces)[0])


def count_self_crossings(x: np.ndarray, faces: np.ndarray) -> int:
    """Number of edges of a mesh through its triangles, those that share a vertex left out."""
    return len(edges_through(x, edges_of(faces), x, faces, same=True)[0])


# a simulation

def cloth_faces(sim) -> np.ndarray:
    """(m, 3) all faces of cloth."""
    return np.concatenate([c.mesh.faces + c.start for c in sim.scene.cloths])


def against_solids(sim, reach: float = 0.5, sampled: bool = False) -> dict[str, tuple[float, int]]:
    """By solid: (least clearance of cloth over the solid's thickness, number of its crossings).

    Crossings with a mesh are edges through triangles; with other solids, faces of cloth that go inside. Cloth that is wholly
    inside a closed mesh has as much negative clearance. Farther away than `reach` thicknesses nothing is told apart.
    `sampled` as in `clearance`: much faster where cloth lies flat on a solid.
    """
    x, faces, out = sim.positions(), cloth_faces(sim), {}
    firsts = x[[piece for c in sim.scene.cloths for piece in c.start + _one_each(c.mesh.faces)]]
    for solid in sim.scene.solids:
        away = clearance(solid, sim.time, x, faces, reach * solid.thickness, sampled)
        least, crossed = float(away.min()), int((away < 0).sum())
        if hasattr(solid.shape, "faces"):
            y, others = triangles(solid, sim.time)
            crossed = count_crossings(x, faces, y, others) if least <= 0 else 0  # 0 is the clearance of what crosses
            inside = firsts[winding(firsts, y, others) > 0.5] if is_closed(others) else firsts[:0]
            if len(inside):
                least = -float(distance_to_triangles(inside, y, others).max())
        out[solid.name] = least / solid.thickness, crossed
    return out


def _one_each(faces: np.ndarray) -> np.ndarray:
    """A vertex of every connected piece of a mesh: where nothing crosses, a piece is on one side as a whole."""
    edges = edges_of(faces)
    n = int(faces.max()) + 1
    _, piece = connected_components(coo_matrix((np.ones(len(edges)), edges.T), shape=(n, n)), directed=False)
    return np.array([v for v in np.unique(piece, return_index=True)[1] if v in faces])


def cloth_crossings(sim) -> int:
    """Edges of cloth through triangles of cloth, all cloths as one mesh."""
    return count_self_crossings(sim.positions(), cloth_faces(sim))
