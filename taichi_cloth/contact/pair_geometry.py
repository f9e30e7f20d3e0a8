"""A vertex and a face, or two edges: how far apart, along what, how fast they can close in, how much they count."""

from ..backend.language import ti
from .geometry import EDGE_EDGE, VERTEX_FACE, of_segments, on_triangle

PARALLEL = 1e-3  # squared sine of the angle below which edges count less and less, as parallel ones have no closest points
RAMP = 0.05  # part of an edge's length near its ends over which edge pairs fade: there vertices take over


@ti.func
def corners_of(hull):
    """Low and high corner of a thing's box where its path begins, and where it ends, from 12 numbers."""
    return (ti.Vector([hull[0], hull[1], hull[2]]), ti.Vector([hull[3], hull[4], hull[5]]),
            ti.Vector([hull[6], hull[7], hull[8]]), ti.Vector([hull[9], hull[10], hull[11]]))


@ti.func
def apart(hull_a, hull_b, reach):
    """1 if two things, given by boxes at both ends of their paths, stay out of reach of each other along some axis."""
    low_a, high_a, low_a1, high_a1 = corners_of(hull_a)
    low_b, high_b, low_b1, high_b1 = corners_of(hull_b)
    out = 0
    low, high = ti.min(low_a - high_b, low_a1 - high_b1), ti.max(high_a - low_b, high_a1 - low_b1)
    if (low > reach).any() or (high < -reach).any():
        out = 1
    return out


@ti.func
def gap(kind, p, q, r, s):
    """A lower bound of a pair's distance, from boxes."""
    lo_a, hi_a, lo_b, hi_b = p, p, ti.min(r, s), ti.max(r, s)
    if kind == VERTEX_FACE:
        lo_b, hi_b = ti.min(lo_b, q), ti.max(hi_b, q)
    else:
        lo_a, hi_a = ti.min(p, q), ti.max(p, q)
    return ti.max(lo_b - hi_a, lo_a - hi_b).max()


@ti.func
def between(kind, p, q, r, s):
    """The shortest difference from the second to the first of a pair, and its weights (4)."""
    w = ti.Vector([1.0, 0.0, 0.0, 0.0])
    if kind == VERTEX_FACE:
        u = on_triangle(p, q, r, s)
        w = ti.Vector([1.0, -u[0], -u[1], -u[2]])
    else:
        along, t = of_segments(p, q, r, s)
        w = ti.Vector([1 - along, along, t - 1, -t])
    return w[0] * p + w[1] * q + w[2] * r + w[3] * s, w


@ti.func
def closing(kind, dp, dq, dr, ds):
    """By how much [m] a pair's distance can shrink on paths dp to ds. [Li et al. 2021, additive CCD]"""
    mean = (dp + dq + dr + ds) / 4
    p, q, r, s = (dp - mean).norm(), (dq - mean).norm(), (dr - mean).norm(), (ds - mean).norm()
    out = ti.max(p, q) + ti.max(r, s)
    if kind == VERTEX_FACE:
        out = p + ti.max(q, r, s)
    return out


@ti.func
def least_between(first, last, speed):
    """A lower bound of a pair's distance [m] on a path at whose ends it is `first` and `last`, by `closing`."""
    return ti.min(first, last, (first + last - speed) / 2)


@ti.func
def fading(kind, w, p, q, r, s):
    """Part that an edge pair counts."""
    out = 1.0
    if kind == EDGE_EDGE:
        out = ti.min(1.0, w[0] / RAMP) * ti.min(1.0, w[1] / RAMP) * ti.min(1.0, -w[2] / RAMP) * ti.min(1.0, -w[3] / RAMP)
        e, g = q - p, s - r
        c = e.cross(g).norm_sqr() / ti.max(PARALLEL * e.norm_sqr() * g.norm_sqr(), 1e-30)
        if c < 1:
            out *= c * (2 - c)
    return out
