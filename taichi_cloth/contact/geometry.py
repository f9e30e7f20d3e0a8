"""Closest points of points, edges and triangles, and triangles that cross. [Ericson, Real-Time Collision Detection, §5.1]"""

from ..backend.language import ti

TINY = 1e-30
VERTEX_FACE, EDGE_EDGE = 0, 1


@ti.func
def on_triangle(p, a, b, c):
    """Barycentric weights (3) of the point of triangle (a, b, c) that is closest to p; degenerate ones too."""
    ab, ac, ap = b - a, c - a, p - a
    d1, d2 = ab.dot(ap), ac.dot(ap)
    bp, cp = p - b, p - c
    d3, d4 = ab.dot(bp), ac.dot(bp)
    d5, d6 = ab.dot(cp), ac.dot(cp)
    va, vb, vc = d3 * d6 - d5 * d4, d5 * d2 - d1 * d6, d1 * d4 - d3 * d2
    total = va + vb + vc
    w = ti.Vector([1.0, 0.0, 0.0])
    if d1 <= 0 and d2 <= 0:
        w = ti.Vector([1.0, 0.0, 0.0])
    elif d3 >= 0 and d4 <= d3:
        w = ti.Vector([0.0, 1.0, 0.0])
    elif d6 >= 0 and d5 <= d6:
        w = ti.Vector([0.0, 0.0, 1.0])
    elif vc <= 0 and d1 >= 0 and d3 <= 0 and d1 > d3:  # not where a is b
        t = d1 / ti.max(d1 - d3, TINY)
        w = ti.Vector([1 - t, t, 0.0])
    elif vb <= 0 and d2 >= 0 and d6 <= 0:
        t = d2 / ti.max(d2 - d6, TINY)
        w = ti.Vector([1 - t, 0.0, t])
    elif va <= 0 and d4 >= d3 and d5 >= d6:
        t = (d4 - d3) / ti.max((d4 - d3) + (d5 - d6), TINY)
        w = ti.Vector([0.0, 1 - t, t])
    else:
        w = ti.Vector([va, vb, vc]) / ti.max(total, TINY)
    return w


@ti.func
def of_segments(p, q, a, b):
    """(s, t): the points p + s (q - p) and a + t (b - a) of two segments that are closest to each other."""
    d1, d2, r = q - p, b - a, p - a
    A, E, f = d1.norm_sqr(), d2.norm_sqr(), d2.dot(r)
    c, B = d1.dot(r), d1.dot(d2)
    s, t = 0.0, 0.0
    if A <= TINY and E > TINY:
        t = ti.min(ti.max(f / E, 0.0), 1.0)
    elif A > TINY and E <= TINY:
        s = ti.min(ti.max(-c / A, 0.0), 1.0)
    elif A > TINY:
        denominator = A * E - B * B
        s = 0.5
        if denominator > 1e-9 * A * E:
            s = ti.min(ti.max((B * f - c * E) / denominator, 0.0), 1.0)
        t = (B * s + f) / E
        if t < 0:
            t = 0.0
            s = ti.min(ti.max(-c / A, 0.0), 1.0)
        elif t > 1:
            t = 1.0
            s = ti.min(ti.max((B - c) / A, 0.0), 1.0)
    return s, t


@ti.func
def of_pair(kind, p, q, a, b, c):
    """Closest points of cloth and solid.

    VERTEX_FACE: the solid's vertex p against the cloth's triangle (a, b, c); EDGE_EDGE: the solid's edge (p, q)
    against the cloth's edge (a, b). Returns the difference cloth - solid, the cloth's weights (3), and how far along
    (p, q) the solid's point is.
    """
    w, s = ti.Vector([0.0, 0.0, 0.0]), 0.0
    if kind == VERTEX_FACE:
        w = on_triangle(p, a, b, c)
    else:
        along, t = of_segments(p, q, a, b)
        s = along
        w = ti.Vector([1 - t, t, 0.0])
    return w[0] * a + w[1] * b + w[2] * c - p - s * (q - p), w, s


@ti.func
def within(radius, a, b, c, d, e, f):
    """1 if triangles (a, b, c) and (d, e, f) that do not cross are nearer to each other than a radius."""
    out = 0
    if radius > 0:
        face, core = ti.Matrix.rows([a, b, c]), ti.Matrix.rows([d, e, f])
        for k in range(3):
            p, q = row(core, k), row(core, (k + 1) % 3)
            w = on_triangle(p, a, b, c)
            if (w[0] * a + w[1] * b + w[2] * c - p).norm() < radius:
                out = 1
            for j in range(3):
                r, s = row(face, j), row(face, (j + 1) % 3)
                along, t = of_segments(p, q, r, s)
                if (p + along * (q - p) - r - t * (s - r)).norm() < radius:
                    out = 1
    return out


@ti.func
def through(a, b, c, d, e, f):
    """Number of edges of triangle (a, b, c) that pass through triangle (d, e, f)."""
    n = (e - d).cross(f - d)
    corners = ti.Matrix.rows([a - d, b - d, c - d])
    count = 0
    for k in range(3):
        p, q = row(corners, k), row(corners, (k + 1) % 3)
        if n.dot(p) * n.dot(q) < 0:
            way, u, w = q - p, e - d, f - d
            one = way.dot((-p).cross(u - p))
            two = way.dot((u - p).cross(w - p))
            three = way.dot((w - p).cross(-p))
            if (one > 0 and two > 0 and three > 0) or (one < 0 and two < 0 and three < 0):
                count += 1
    return count


@ti.func
def row(m, k):
    """Row k, not known when compiling."""
    out = ti.Vector([m[2, 0], m[2, 1], m[2, 2]])
    if k == 0:
        out = ti.Vector([m[0, 0], m[0, 1], m[0, 2]])
    if k == 1:
        out = ti.Vector([m[1, 0], m[1, 1], m[1, 2]])
    return out
