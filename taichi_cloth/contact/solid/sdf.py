"""Signed distance and outward normal of analytic shapes in their local frame, as 4 numbers (d, n)."""

from ...backend.language import ti
from ...scene.primitives import BOX, CAPSULE, CYLINDER, PLANE, SPHERE

TINY = 1e-20


@ti.func
def from_axis(offset, radius):
    """(|offset| - radius, offset / |offset|); on the axis itself, up."""
    length = offset.norm()
    n = ti.Vector([0.0, 1.0, 0.0])
    if length > TINY:
        n = offset / length
    return ti.Vector([length - radius, n[0], n[1], n[2]])


@ti.func
def plane(q, p):
    """Half space with outward normal p[0:3]."""
    return ti.Vector([q.dot(ti.Vector([p[0], p[1], p[2]])), p[0], p[1], p[2]])


@ti.func
def capsule(q, p):
    """Segment p[0:3] to p[3:6], radius p[6]."""
    a = ti.Vector([p[0], p[1], p[2]])
    e = ti.Vector([p[3], p[4], p[5]]) - a
    t = ti.min(ti.max((q - a).dot(e) / e.norm_sqr(), 0.0), 1.0)
    return from_axis(q - a - t * e, p[6])


@ti.func
def box(q, p):
    """Half sides p[0:3] with edges rounded by p[3]."""
    out, inside = ti.Vector.zero(float, 3), -1e30
    side, n = ti.Vector.zero(float, 3), ti.Vector.zero(float, 3)
    for c in ti.static(range(3)):
        side[c] = 1.0 if q[c] >= 0 else -1.0
        depth = ti.abs(q[c]) - (p[c] - p[3])
        out[c] = ti.max(depth, 0.0)
        if depth > inside:
            inside = depth
            n = ti.Vector.zero(float, 3)
            n[c] = side[c]
    length = out.norm()
    if length > TINY:
        n = out * side / length
    return ti.Vector([length + ti.min(inside, 0.0) - p[3], n[0], n[1], n[2]])


@ti.func
def cylinder(q, p):
    """Radius p[0], half length p[1] along y."""
    across = ti.Vector([q[0], 0.0, q[2]])
    radial = across.norm()
    away = ti.Vector([1.0, 0.0, 0.0])
    if radial > TINY:
        away = across / radial
    up = ti.Vector([0.0, 1.0 if q[1] >= 0 else -1.0, 0.0])
    a, b = radial - p[0], ti.abs(q[1]) - p[1]
    d, n = a, away
    if b > a:
        d, n = b, up
    if a > 0 and b > 0:
        d = ti.sqrt(a * a + b * b)
        n = (a * away + b * up) / d
    return ti.Vector([d, n[0], n[1], n[2]])


@ti.func
def distance(kind, q, p, kinds: ti.template()):
    """(d, n) of a point q in the frame of a solid with parameters p; only the shapes in `kinds` are compiled."""
    out = ti.Vector([1e30, 0.0, 1.0, 0.0])
    if ti.static(PLANE in kinds):
        if kind == PLANE:
            out = plane(q, p)
    if ti.static(SPHERE in kinds):
        if kind == SPHERE:
            out = from_axis(q, p[0])
    if ti.static(CAPSULE in kinds):
        if kind == CAPSULE:
            out = capsule(q, p)
    if ti.static(BOX in kinds):
        if kind == BOX:
            out = box(q, p)
    if ti.static(CYLINDER in kinds):
        if kind == CYLINDER:
            out = cylinder(q, p)
    return out
