"""Cloth against cloth, worked out afresh: closest points, repulsion, friction, times of impact, crossings. numpy only.

A pair is four points (k, 4, 3): VERTEX_FACE, the vertex first; EDGE_EDGE, two ends of each edge. Its weights w (k, 4) are
positive on its first side and negative on the second, and w . x is the shortest way from the second to the first.
Everything is written from the equations, candidate by candidate and pair by pair; nothing of the simulator is used, its
numbers included.
"""

from dataclasses import dataclass
from fractions import Fraction

import numpy as np

VERTEX_FACE, EDGE_EDGE = 0, 1

FLOOR = 1 / 5  # of the distance r that a pair should keep: repulsion is that of what is above it
LAST = 0.02  # part of the room above the floor, and of r, where the law changes for what solids press
STIFFNESS = 12.0 * 60**2  # of a pair over mass [1/s^2]
SETTLING = 0.3  # r a second that a pair may come nearer and is not stopped
STOPPING = 30.0  # of what stops an approach, over mass / h^2, h this step
END, ANGLE = 0.05, 1e-3  # part of an edge near its ends, squared sine of the angle between edges, where pairs fade
STEEP = 4.0  # size of a turn from which on friction fades
CREEP = 2e-5  # m/s of slip below which friction is viscous
HARDER = 4.0  # times the damping that a pair had, if it stuck


# closest points

def of_triangle(p: np.ndarray, t: np.ndarray) -> np.ndarray:
    """(k, 3) weights of the point of triangles t (k, 3, 3) closest to p (k, 3): the best of the inside and three edges."""
    best, weights = np.full(len(p), np.inf), np.zeros((len(p), 3))
    e, f, r = t[:, 1] - t[:, 0], t[:, 2] - t[:, 0], p - t[:, 0]
    ee, ef, ff, er, fr = (np.sum(a * b, axis=1) for a, b in ((e, e), (e, f), (f, f), (e, r), (f, r)))
    area = ee * ff - ef**2
    with np.errstate(all="ignore"):
        u, v = (ff * er - ef * fr) / area, (ee * fr - ef * er) / area
    inside = (area > 1e-14 * ee * ff) & (u >= 0) & (v >= 0) & (u + v <= 1)
    tries = [(np.stack([1 - u - v, u, v], axis=1), inside)]
    for a, b in ((0, 1), (1, 2), (2, 0)):
        s = along(p, t[:, a], t[:, b])
        w = np.zeros((len(p), 3))
        w[:, a], w[:, b] = 1 - s, s
        tries.append((w, np.ones(len(p), dtype=bool)))
    for w, allowed in tries:
        w = np.where(allowed[:, None], w, 0.0)
        d = np.where(allowed, np.linalg.norm(np.einsum("ka,kai->ki", w, t) - p, axis=1), np.inf)
        better = d < best
        best[better], weights[better] = d[better], w[better]
    return weights


def along(p: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """(k,) how far along segments a b (k, 3) the point closest to p (k, 3) is, 0 to 1."""
    e = b - a
    size = np.sum(e * e, axis=1)
    return np.clip(np.sum((p - a) * e, axis=1) / np.where(size > 0, size, 1.0), 0.0, 1.0)


def of_edges(x: np.ndarray) -> np.ndarray:
    """(k, 2) how far along the first and the second of two edges (k, 4, 3) their closest points are."""
    p, q, a, b = (x[:, k] for k in range(4))
    d, e, r = q - p, b - a, p - a
    dd, de, ee, dr, er = (np.sum(u * v, axis=1) for u, v in ((d, d), (d, e), (e, e), (d, r), (e, r)))
    sine = dd * ee - de**2
    with np.errstate(all="ignore"):
        s, t = (de * er - ee * dr) / sine, (dd * er - de * dr) / sine
    inside = (sine > 1e-12 * dd * ee) & (s >= 0) & (s <= 1) & (t >= 0) & (t <= 1)
    zero, one = np.zeros(len(x)), np.ones(len(x))
    tries = [(np.where(inside, s, 0.0), np.where(inside, t, 0.0), inside)]
    tries += [(zero, along(p, a, b), None), (one, along(q, a, b), None), (along(a, p, q), zero, None),
              (along(b, p, q), one, None)]
    best, out = np.full(len(x), np.inf), np.zeros((len(x), 2))
    for s, t, allowed in tries:
        gap = np.linalg.norm(r + s[:, None] * d - t[:, None] * e, axis=1)
        gap = gap if allowed is None else np.where(allowed, gap, np.inf)
        better = gap < best
        best[better], out[better] = gap[better], np.stack([s, t], axis=1)[better]
    return out


def weights_of(kind: np.ndarray, x: np.ndarray) -> np.ndarray:
    """(k, 4) weights of pairs (k, 4, 3) of kinds (k,)."""
    u, st = of_triangle(x[:, 0], x[:, 1:]), of_edges(x)
    face = np.concatenate([np.ones((len(x), 1)), -u], axis=1)
    edge = np.stack([1 - st[:, 0], st[:, 0], st[:, 1] - 1, -st[:, 1]], axis=1)
    return np.where((kind == VERTEX_FACE)[:, None], face, edge)


def distances(kind: np.ndarray, x: np.ndarray) -> np.ndarray:
    """(k,) distance [m] of pairs."""
    return np.linalg.norm(np.einsum("ka,kai->ki", weights_of(kind, x), x), axis=1)


def fading(kind: np.ndarray, w: np.ndarray, x: np.ndarray) -> np.ndarray:
    """(k,) part that pairs count: less near the ends of edges, and where edges are near parallel."""
    ends = np.prod(np.minimum(1.0, np.abs(w) / END), axis=1)
    d, e = x[:, 1] - x[:, 0], x[:, 3] - x[:, 2]
    size = np.sum(d * d, axis=1) * np.sum(e * e, axis=1)
    c = np.minimum(np.sum(np.cross(d, e) ** 2, axis=1) / (ANGLE * np.where(size > 0, size, 1.0)), 1.0)
    return np.where(kind == EDGE_EDGE, ends * c * (2 - c), 1.0)


def all_pairs(edges: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(rows (k, 2) of vertex and face or of two edges, kinds (k,), particles (k, 4)): all that share no particle."""
    v, f = (a.ravel() for a in np.meshgrid(np.unique(faces), np.arange(len(faces)), indexing="ij"))
    e, g = np.triu_indices(len(edges), 1)
    row = np.concatenate([np.stack([v, f], axis=1), np.stack([e, g], axis=1)])
    kind = np.repeat([VERTEX_FACE, EDGE_EDGE], [len(v), len(e)])
    four = np.concatenate([np.column_stack([v, faces[f]]), np.column_stack([edges[e], edges[g]])])
    first = np.where((kind == VERTEX_FACE)[:, None], four[:, :1], four[:, :2])
    apart = (first[:, :, None] != four[:, None, 2:]).all(axis=(1, 2)) & ((kind == EDGE_EDGE) | (four[:, 0] != four[:, 1]))
    return row[apart], kind[apart], four[apart]


def spans(faces: np.ndarray) -> np.ndarray:
    """(e, 2) edges of faces (m, 3), each once."""
    return np.unique(np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1), axis=0)


# repulsion and friction of one pair

def repulsion(d: float, r: float, shift: float = 0.0) -> tuple[float, float, float]:
    """(energy [m^2], force [m], slope) over the stiffness at a distance d of a pair that should keep r and begins to repel
    `shift` [m] further away.

    Above the floor by s, with R the room above it to where it begins: phi'' = 1 for R > s > R/2, phi = R^2/4 log(1/s) + ...
    from R/2 down to .02 R, and below that the force grows as 1/d down to .02 r, and no more.
    """
    R, s = (1 - FLOOR) * r + shift, d - FLOOR * r
    low, end = FLOOR * r + LAST * R, LAST * r

    def above(s: float) -> tuple[float, float, float]:
        if s >= R:
            return 0.0, 0.0, 0.0
        if s >= R / 2:
            return (R - s) ** 2 / 2, R - s, 1.0
        return R**2 / 8 + R**2 / 4 * np.log(R / 2 / s), R**2 / (4 * s), R**2 / (4 * s**2)

    if d >= low * (1 - 1e-12):  # at the kink itself the slope is that from above
        return above(s)
    energy, force, _ = above(LAST * R)
    if d >= end:
        return energy + force * low * np.log(low / d), force * low / d, force * low / d**2
    most = force * low / end
    return energy + force * low * np.log(low / end) + most * (end - d), most, most / end


def stop(d: float, r: float, began: float, h: float) -> float:
    """How far [m] a pair has come nearer in h [s] than it began, settling apart, and than it should be; no further than into
    the floor."""
    return max(min(max(began - SETTLING * h * r, FLOOR * r + 2 * LAST * (1 - FLOOR) * r), r) - d, 0.0)


def turns(kind: int, x: np.ndarray, n: np.ndarray, d: float) -> np.ndarray:
    """(4, 3) turns t of a pair (4, 3): what it moves by is sum_a w_a v_a + t_a (n . v_a).

    In the plane across n, adding up to 0 on either side, and such that a rigid motion has no slip: sum_a t_a x_a^T = d times
    the identity of that plane.
    """
    u = np.linalg.svd(n[None])[2][1:]  # (2, 3) across n
    y = x @ u.T
    sides = ([0], [1, 2, 3]) if kind == VERTEX_FACE else ([0, 1], [2, 3])
    rows, right = [], []
    for i in range(2):
        for side in sides:
            row = np.zeros((4, 2))
            row[side, i] = 1
            rows.append(row.ravel())
            right.append(0.0)
        for j in range(2):
            row = np.zeros((4, 2))
            row[:, i] = y[:, j]
            rows.append(row.ravel())
            right.append(d * (i == j))
    t = np.linalg.lstsq(np.array(rows), np.array(right), rcond=None)[0].reshape(4, 2)
    return t @ u


def turning(t: np.ndarray) -> float:
    """Part of its friction that a pair with turns t (4, 3) keeps."""
    return min(1.0, (STEEP / max(np.linalg.norm(t, axis=1).max(), 1e-30)) ** 2)


def jacobian(w: np.ndarray, t: np.ndarray, n: np.ndarray) -> np.ndarray:
    """(3, 12) how a pair moves where its particles do."""
    return np.concatenate([w[a] * np.eye(3) + np.outer(t[a], n) for a in range(4)], axis=1)


@dataclass
class Pair:
    """A pair of cloth in a step: where it is linearised, and what it is told by the solves before.

    Attributes:
        kind: VERTEX_FACE or EDGE_EDGE; x: (4, 3) where its turns are taken; w, n: (4,), (3,) weights and normal.
        end: distance [m] along the normal; r: what it should be; began: where the step began.
        mass: (4,) [kg]; mu: Coulomb's coefficient; factor: fading; boost: factor of its stiffness.
        shifts: (4,) parts of r by which its particles begin to repel further away.
        h: the step [s].
    """

    kind: int
    x: np.ndarray
    w: np.ndarray
    n: np.ndarray
    end: float
    r: float
    began: float
    mass: np.ndarray
    mu: float
    factor: float
    boost: float
    shifts: np.ndarray
    h: float

    def __post_init__(self) -> None:
        self.shift = self.r * float(np.abs(self.w) @ self.shifts) / 2  # [m]
        self.own = 1 / float(np.sum(self.w**2 / self.mass))  # kg that its distance has
        self.stiff = STIFFNESS * self.own * self.factor * self.boost
        self.t = turns(self.kind, self.x, self.n, self.end)
        self.J = jacobian(self.w, self.t, self.n)
        self.rubs = self.mu * turning(self.t)
        self.stopping = STOPPING * self.own * self.factor / self.h**2

    def pull(self, d: float) -> tuple[float, float]:
        """(force [N], slope [N/m]) at a distance d."""
        _, force, slope = repulsion(d, self.r, self.shift)
        stopped = stop(d, self.r, self.began, self.h)
        return self.stiff * force + self.stopping * stopped, self.stiff * slope + self.stopping * (stopped > 0)

    def take(self, first: bool, bore: float | None, there: np.ndarray, base: np.ndarray, v: np.ndarray,
             before: tuple[float, float, np.ndarray] | None, rubbed: np.ndarray, slipped: float) -> tuple:
        """The pair as a solve takes it.

        Args:
            bore: its force in the last solve [N], None where it is new.
            there, base: (4, 3) how far its particles have gone [m] where slip is looked at, and where the solve begins.
            v: (4, 3) velocities at the step's beginning; before: (bound [N], drag, way) of the last solve.
            rubbed: (3,) friction [N] at the end of the last step; slipped: how fast it slipped there [m/s], if it stuck.

        Returns:
            (A (3, 3), r (3,), force, slope, at, bound, drag, way, offset (3,) [m/s] that is added to its slip).
        """
        room = lambda part: (FLOOR + part * (1 - FLOOR)) * self.r  # noqa: E731
        least = min(max(self.began, room(LAST)), room(0.5)) if first else LAST * self.r
        at = min(max(self.end, least), self.r + self.shift)
        force, slope = self.pull(at)
        if bore is None:  # no more than what stops the approach
            near = self.r - self.began - self.h * float(self.n @ (self.w @ v))
            bore = min(self.stiff * repulsion(at, self.r, self.shift)[1], self.own / self.h**2 * max(near, 0.0))
        P = np.eye(3) - np.outer(self.n, self.n)
        bound, way = self.rubs * bore, np.zeros(3)
        offset = P @ rubbed * (-CREEP / max(bound, 1e-30))
        offset *= min(1.0, CREEP / max(np.linalg.norm(offset), 1e-30))
        slip = P @ self.J @ there.ravel() / self.h + offset
        size = np.linalg.norm(slip)
        if before is not None and bound > 0:
            old_bound, old_drag, old_way = before
            if (slip @ old_way > 0) if old_way.any() else (old_drag * size > 1.02 * old_bound):
                way = slip / size
        if before is None and self.own * size <= self.h * bound:
            size = min(size, slipped / HARDER)
        drag = bound / max(size, CREEP)
        across = P - np.outer(way, way)
        A = self.h**2 * slope * np.outer(self.n, self.n) + self.h * drag * across
        moved = self.J @ base.ravel()
        r = self.h * (force + slope * (at - self.began - self.n @ moved)) * self.n
        r = r - drag * across @ (moved + self.h * offset) - self.h * bound * way
        return A, r, force, slope, at, bound, drag, way, offset


# times of impact

def first_touch(kind: int, x: np.ndarray, way: np.ndarray) -> float:
    """Part of straight ways (4, 3) from x (4, 3) at which a pair first touches; infinite where it does not.

    The four points are coplanar at roots of a cubic; at which of them the pair meets is seen there.
    """
    p, q = x - x[0], way - way[0]
    det = lambda a, b, c: np.linalg.det(np.stack([a, b, c]))  # noqa: E731
    cubic = [det(q[1], q[2], q[3]), det(q[1], q[2], p[3]) + det(q[1], p[2], q[3]) + det(p[1], q[2], q[3]),
             det(q[1], p[2], p[3]) + det(p[1], q[2], p[3]) + det(p[1], p[2], q[3]), det(p[1], p[2], p[3])]
    size = np.abs(x - x[0]).max() + np.abs(way - way[0]).max()
    for s in sorted(root.real for root in np.roots(cubic) if abs(root.imag) < 1e-7 and -1e-9 <= root.real <= 1 + 1e-9):
        if distances(np.array([kind]), (x + s * way)[None])[0] < 1e-6 * size:
            return float(s)
    return np.inf


def first_below(kind: np.ndarray, x: np.ndarray, way: np.ndarray, limit: np.ndarray, samples: int = 60) -> np.ndarray:
    """(k,) part of straight ways (k, 4, 3) from x at which pairs are first nearer than limit (k,) [m]; infinite where never.

    By samples, finer ones where a dip would fit between two of them, and bisection.
    """
    grid, out = np.linspace(0, 1, samples + 1), np.full(len(x), np.inf)
    d = np.stack([distances(kind, x + s * way) - limit for s in grid], axis=1)
    dip = np.minimum(d[:, :-1], d[:, 1:]) < speed(kind, way)[:, None] / samples

    def below(k: np.ndarray, s: np.ndarray) -> np.ndarray:
        return distances(kind[k], x[k] + s[:, None, None] * way[k]) < limit[k]

    k, i = np.nonzero(dip)
    fine = grid[i][:, None] + np.linspace(0, 1 / samples, 33)
    there = below(np.repeat(k, 33), fine.ravel()).reshape(fine.shape)
    some = there.any(axis=1)
    k, first = np.unique(k[some], return_index=True)  # of each pair the first
    fine, there = fine[some][first], there[some][first].argmax(axis=1)
    a, b = (fine[np.arange(len(k)), at] for at in (np.maximum(there - 1, 0), there))
    for _ in range(40):
        middle = (a + b) / 2
        nearer = below(k, middle)
        a, b = np.where(nearer, a, middle), np.where(nearer, middle, b)
    out[k] = b
    return out


def speed(kind: np.ndarray, way: np.ndarray) -> np.ndarray:
    """(k,) what the distance of pairs can change by at most on ways (k, 4, 3)."""
    size = np.linalg.norm(way - way.mean(axis=1, keepdims=True), axis=2)
    first = np.where(kind == VERTEX_FACE, size[:, 0], size[:, :2].max(axis=1))
    return first + np.where(kind == VERTEX_FACE, size[:, 1:].max(axis=1), size[:, 2:].max(axis=1))


# crossings

def through(p, q, a, b, c) -> bool:
    """Whether the edge p q passes through the inside of the triangle a b c, both its ends beyond, in rational arithmetic.

    p + s (q - p) = a + u (b - a) + v (c - a) solved by Cramer's rule; touching is no crossing.
    """
    p, q, a, b, c = ([Fraction(float(v)) for v in point] for point in (p, q, a, b, c))
    minus = lambda u, v: [i - j for i, j in zip(u, v)]  # noqa: E731
    d, e, f, r = minus(q, p), minus(b, a), minus(c, a), minus(p, a)

    def det(u, v, w):
        return sum(u[i] * (v[(i + 1) % 3] * w[(i + 2) % 3] - v[(i + 2) % 3] * w[(i + 1) % 3]) for i in range(3))

    whole = det([-k for k in d], e, f)
    if whole == 0:
        return False
    s, u, v = det(r, e, f) / whole, det([-k for k in d], r, f) / whole, det([-k for k in d], e, r) / whole
    return 0 < s < 1 and u > 0 and v > 0 and u + v < 1


def crossings(x: np.ndarray, faces: np.ndarray) -> set[tuple[int, int, int]]:
    """All (end, end, face) of edges that pass through faces of one mesh, by trying every edge with every face."""
    return {(int(i), int(j), k) for i, j in spans(faces) for k, face in enumerate(faces)
            if i not in face and j not in face and through(x[i], x[j], *x[face])}
