"""The condition of a hinge, C = fade(a) fade(b) crest(theta - theta_0), as a function of its edge and its two arms.

An angle alone is no smooth function of positions. It jumps by 2 pi where a fold passes through itself, and by pi where
a triangle's tip passes through the edge, with gradients that grow without bounds on the way there. Therefore

- `crest` levels off in the last CREST before +-pi: a fold that passes through itself gains no energy by it, and the
  moment changes its side smoothly. (To unwind the angle by its history instead makes energy depend on the way that
  cloth took, round collapsed triangles too: a twisted sheet gained a hundred times its energy.)
- `fade` takes the condition back to 0 with a triangle that has less than COLLAPSED of its area.

C^2 then has a continuous gradient everywhere. Elsewhere, which is nearly always, C is the angle itself, as in [BW98].
A fold of exactly pi has no side; it is pushed to the positive one, or to that where it is creased.
"""

import math

from ..backend.language import ti
from .conditions import TINY, unit

CREST = 0.2  # rad
KNEE = math.pi - CREST
SIDE = 1e-6  # rad within which a fold counts as one of exactly pi
COLLAPSED = 0.1  # part of the smaller triangle's area below which a hinge fades
LOST = 1e-12  # part of the square of that area's normal below which the normal has no direction


@ti.func
def hinge_angle(e, a, b):
    """theta in (-pi, pi] of a hinge with edge e and arms a, b from the edge's first vertex."""
    n_a, n_b = e.cross(a), b.cross(e)
    return ti.atan2(n_a.cross(n_b).dot(unit(e)), n_a.dot(n_b))


@ti.func
def turn(angle):
    """An angle difference brought to [-pi, pi]: the short way round."""
    if angle > math.pi:
        angle -= 2 * math.pi
    if angle < -math.pi:
        angle += 2 * math.pi
    return angle


@ti.func
def crest(angle, way):
    """(value, slope, change of slope) of an angle in [-pi, pi], levelled off near the ends; `way` is the sign of +-pi."""
    value, slope, bow = angle, angle * 0 + 1, angle * 0
    left = math.pi - ti.abs(angle)
    if left < CREST:
        sign, slope = 1.0, left / CREST
        if left < SIDE:
            sign, slope = way, 1.0
        elif angle < 0:
            sign = -1.0
        value = sign * (math.pi - 0.5 * CREST - 0.5 * left * left / CREST)
        bow = -sign / CREST
    return value, slope, bow


@ti.func
def uncrested(C):
    """The angle whose crest is C."""
    angle, left = C, math.pi - 0.5 * CREST - ti.abs(C)
    if left < 0.5 * CREST:
        angle = (math.pi - ti.sqrt(2 * CREST * ti.max(left, 0.0))) * (C / ti.abs(C))
    return angle


@ti.func
def fade(r):
    """(value, slope, change of slope) of r (2 - r) up to r = 1, and 1 from there on."""
    value, slope, bow = r * 0 + 1, r * 0, r * 0
    if r < 1:
        value, slope, bow = r * (2 - r), 2 - 2 * r, r * 0 - 2
    return value, slope, bow


@ti.func
def hinge_condition(e, a, b, theta_0, floor2, way):
    """C and dC/d(e, a, b); floor2 [m^4] is the squared normal below which a triangle fades, `way` the sign of +-pi."""
    C = turn(hinge_angle(e, a, b) - theta_0)
    g_e, g_a, g_b = angle_gradient(e, a, b, floor2)
    n_a, n_b = e.cross(a), b.cross(e)
    if ti.abs(C) > KNEE or ti.min(n_a.norm_sqr(), n_b.norm_sqr()) < floor2:
        floor = ti.sqrt(floor2)
        C, slope, _ = crest(C, way)
        value_a, slope_a, _ = fade(n_a.norm() / floor)
        value_b, slope_b, _ = fade(n_b.norm() / floor)
        slope *= value_a * value_b
        s_a, s_b = C * value_b * slope_a / floor, C * value_a * slope_b / floor
        n_a, n_b = unit(n_a), unit(n_b)
        g_e = slope * g_e + s_a * a.cross(n_a) + s_b * n_b.cross(b)
        g_a = slope * g_a + s_a * n_a.cross(e)
        g_b = slope * g_b + s_b * e.cross(n_b)
        C *= value_a * value_b
    return C, g_e, g_a, g_b


@ti.func
def turned_by(C, before):
    """C - C_0 the short way round: a fold that passes through itself goes on from where the crest levels off."""
    change, period = C - before, 2 * math.pi - CREST
    if ti.abs(change) > 0.5 * period:
        change -= period * (change / ti.abs(change))
    return change


@ti.func
def hinge_condition_change(e, a, b, de, da, db, theta_0, floor2):
    """Change of dC along (de, da, db): ddC times a direction."""
    C, slope, bow = crest(turn(hinge_angle(e, a, b) - theta_0), 1.0)
    g_e, g_a, g_b = angle_gradient(e, a, b, floor2)
    h_e, h_a, h_b = angle_gradient_change(e, a, b, de, da, db, floor2)
    turned = g_e.dot(de) + g_a.dot(da) + g_b.dot(db)
    h_e, h_a, h_b = (slope * h_e + bow * turned * g_e, slope * h_a + bow * turned * g_a, slope * h_b + bow * turned * g_b)
    n_a, n_b = e.cross(a), b.cross(e)
    if ti.min(n_a.norm_sqr(), n_b.norm_sqr()) < floor2:
        floor = ti.sqrt(floor2)
        value_a, slope_a, bow_a = fade(n_a.norm() / floor)
        value_b, slope_b, bow_b = fade(n_b.norm() / floor)
        slope_a, slope_b, bow_a, bow_b = slope_a / floor, slope_b / floor, bow_a / floor2, bow_b / floor2
        dn_a, dn_b = de.cross(a) + e.cross(da), db.cross(e) + b.cross(de)
        per_a, per_b = 1 / ti.max(n_a.norm(), TINY), 1 / ti.max(n_b.norm(), TINY)
        n_a, n_b = unit(n_a), unit(n_b)
        r_a, r_b = n_a.dot(dn_a), n_b.dot(dn_b)  # change of the lengths of the normals, and of their directions:
        dn_a, dn_b = (dn_a - r_a * n_a) * per_a, (dn_b - r_b * n_b) * per_b
        faded = value_a * value_b
        change = value_b * slope_a * r_a + value_a * slope_b * r_b
        # C = F c: ddC = F ddc + dF dc + dc dF + c ddF, in the directions of the gradients of the two normals' lengths
        s_a, s_b = value_b * slope_a, value_a * slope_b  # dF by the two lengths
        ds_a = value_b * bow_a * r_a + slope_a * slope_b * r_b
        ds_b = value_a * bow_b * r_b + slope_a * slope_b * r_a
        u_a, u_b = slope * turned * s_a + C * ds_a, slope * turned * s_b + C * ds_b
        w_a, w_b = C * s_a, C * s_b
        h_e = (faded * h_e + change * slope * g_e + u_a * a.cross(n_a) + u_b * n_b.cross(b)
               + w_a * (da.cross(n_a) + a.cross(dn_a)) + w_b * (dn_b.cross(b) + n_b.cross(db)))
        h_a = faded * h_a + change * slope * g_a + u_a * n_a.cross(e) + w_a * (dn_a.cross(e) + n_a.cross(de))
        h_b = faded * h_b + change * slope * g_b + u_b * e.cross(n_b) + w_b * (de.cross(n_b) + e.cross(dn_b))
    return h_e, h_a, h_b


@ti.func
def angle_gradient(e, a, b, floor2):
    """d theta/d(e, a, b); finite where a triangle has no normal."""
    n_a, n_b = e.cross(a), b.cross(e)
    e2 = ti.max(e.norm_sqr(), TINY)
    g_a = -ti.sqrt(e2) * n_a / ti.max(n_a.norm_sqr(), LOST * floor2)
    g_b = -ti.sqrt(e2) * n_b / ti.max(n_b.norm_sqr(), LOST * floor2)
    return -(a.dot(e) / e2) * g_a - (b.dot(e) / e2) * g_b, g_a, g_b


@ti.func
def angle_gradient_change(e, a, b, de, da, db, floor2):
    """Change of `angle_gradient` along (de, da, db): d2 theta times a direction."""
    n_a, n_b = e.cross(a), b.cross(e)
    dn_a, dn_b = de.cross(a) + e.cross(da), db.cross(e) + b.cross(de)
    e2 = ti.max(e.norm_sqr(), TINY)
    length = ti.sqrt(e2)
    d_e2 = 2 * e.dot(de)
    d_length = e.dot(de) / length
    a2, b2 = ti.max(n_a.norm_sqr(), LOST * floor2), ti.max(n_b.norm_sqr(), LOST * floor2)
    g_a, g_b = -length * n_a / a2, -length * n_b / b2
    dg_a = -(d_length * n_a + length * dn_a - 2 * length * n_a.dot(dn_a) / a2 * n_a) / a2
    dg_b = -(d_length * n_b + length * dn_b - 2 * length * n_b.dot(dn_b) / b2 * n_b) / b2
    t_a, t_b = a.dot(e) / e2, b.dot(e) / e2
    dt_a = (da.dot(e) + a.dot(de) - t_a * d_e2) / e2
    dt_b = (db.dot(e) + b.dot(de) - t_b * d_e2) / e2
    return -dt_a * g_a - t_a * dg_a - dt_b * g_b - t_b * dg_b, dg_a, dg_b
