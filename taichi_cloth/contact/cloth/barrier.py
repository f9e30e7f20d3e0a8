"""The law by which two places of cloth repel each other.

A pair of stiffness k should keep a distance r; its floor is a fifth of that. Its distance d is s above the floor, and
R = r - floor + shift: a pair that a load holds begins to repel a little further away, see `contact_pairs.PenaltyShift`. The
potential over k has phi'' = 1 from R down to R/2, and phi = -R^2 / 4 log s below: joined with two continuous derivatives,
convex, growing towards the floor. From just above the floor on, where only cloth pressed together by
solids gets to, it grows with -log d.
"""

from ...backend.language import ti

FLOOR = 0.2  # of a pair's distance
MOST_SHIFT = 0.25  # of it, by which repulsion may begin further away. With .15 and .5 ten sheets lie as far apart; two layers
# under an arm that closes take 72 to 105 and 72 to 89 steps (four runs) for 72 to 83 (eight)
REACH = 1 + MOST_SHIFT  # parts of a pair's distance, within which it may repel
SHALLOW = 0.02  # part of the height above the floor from which on downwards the force grows more slowly, and of r its end


@ti.func
def height(part, r):
    """The distance at a part of that way."""
    return (FLOOR + part * (1 - FLOOR)) * r


@ti.func
def law(d, r, shift):
    """(force, its slope) at a distance d, over the stiffness."""
    top = (1 - FLOOR) * r + shift
    low = height(SHALLOW, r) + SHALLOW * shift
    s, b = ti.max(d, low) - FLOOR * r, ti.min(ti.max(d, SHALLOW * r), low)
    force, slope = ti.max(top - s, 0.0), ti.select(s <= top, 1.0, 0.0)
    if s < top / 2:
        force, slope = top**2 / (4 * s), top**2 / (4 * s**2)
    if d < low:
        most = top / (4 * SHALLOW)
        force, slope = most * low / b, most * low / b**2
    return force, slope


@ti.func
def potential(d, r, shift):
    """Energy at a distance d, over the stiffness [m^2]."""
    top = (1 - FLOOR) * r + shift
    low = height(SHALLOW, r) + SHALLOW * shift
    s, b = ti.max(d, low) - FLOOR * r, ti.min(ti.max(d, SHALLOW * r), low)
    energy = ti.max(top - s, 0.0) ** 2 / 2
    if s < top / 2:
        energy = top**2 / 8 + top**2 / 4 * ti.log(top / (2 * s))
    if d < low:
        most = top / (4 * SHALLOW) * low
        energy += most * ti.log(low / b) + ti.max(SHALLOW * r - d, 0.0) * most / (SHALLOW * r)
    return energy
