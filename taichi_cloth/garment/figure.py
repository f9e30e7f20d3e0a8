"""A body's measures, found from its surface: where its trunk begins and ends, how wide it is, which way it faces. numpy only.

The surface is cut level by level. Each level shows outlines; those whose convex hulls overlap are one part of the body. The
trunk is the largest part over the feet. It is followed from the middle, down to where it parts into legs and up to where it
narrows to the neck. A body faces across its arms, where it is widest, to the side of its toes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..errors import SceneError
from ..scene.connected import components
from ..scene.scene import Scene

LEVELS = 100  # at which a body is cut
MIDDLE = 0.55  # of its height, where its trunk is looked for
NARROW = 0.6  # of the trunk's median girth: less is the neck, and of its area: less is no trunk
ARMS = 2.0  # times the median girth of a trunk: more is one with arms that are stretched out
TRUNK = 0.34  # of a person's height, from crotch to neck
ANKLE, SOLE = 0.09, 0.025  # of the height, at which feet are cut
ASIDE = np.sqrt(0.5)  # cosine between toes and the way across the arms beyond which a trunk is round, and has no arms
STANDS_OUT = 0.01  # of the height by which toes are before ankles, or else the body has no feet
NO = "fitted: the body has no {} that its surface shows"
AT = np.linspace(0.2, 0.7, 6)  # parts of the way from the crotch to the neck, at which girths are taken


@dataclass(frozen=True, eq=False)
class Figure:
    """A body that stands up.

    Attributes:
        crotch, neck: heights [m] between which its trunk is.
        centre: (2,) x and z [m] of the trunk; forward: (2,) x and z of the way it faces, of length 1.
        faces: whether its feet say so; else it is the way across its arms that is nearer to +z.
        girths: (6,) round the trunk [m], at the parts `AT` of the way from the crotch to the neck.
    """

    crotch: float
    neck: float
    centre: np.ndarray
    forward: np.ndarray
    faces: bool
    girths: np.ndarray

    @property
    def turn(self) -> float:
        """[degrees] from z towards x to the way it faces."""
        return float(np.degrees(np.arctan2(*self.forward)))


def measured(x: np.ndarray, faces: np.ndarray) -> Figure:
    """The measures of a body with vertices x (n, 3) [m] and triangles (m, 3).

    Raises:
        SceneError: nothing that stands up on legs, with a trunk and a neck.
    """
    floor, top = float(x[:, 1].min()), float(x[:, 1].max())
    heights = floor + (top - floor) * (np.arange(LEVELS) + 0.5) / LEVELS
    start = int(MIDDLE * LEVELS)
    trunk = _over_feet(parts_at(x, faces, heights[start]), x, faces, floor, top - floor)
    down = _followed(x, faces, heights[start - 1::-1], trunk)
    up = _followed(x, faces, heights[start + 1:], trunk)
    hulls = {start: trunk, **{start - 1 - k: h for k, h in enumerate(down)}, **{start + 1 + k: h for k, h in enumerate(up)}}
    lowest, highest = min(hulls), max(hulls)
    usual = float(np.median([girth(hulls[k]) for k in range(lowest, start + 1)]))
    narrow = [k for k in range(start, min(highest + 1, LEVELS - 1)) if girth(hulls[k]) < NARROW * usual]
    begins = [k for k in narrow if k - 1 not in narrow]  # some robots are narrow at the waist, too, and all are at the crown
    neck = min(begins, key=lambda k: abs(heights[k] - heights[lowest] - TRUNK * (top - floor)), default=None)
    legs = [h for h in parts_at(x, faces, heights[lowest - 1]) if overlap(h, hulls[lowest])] if lowest else []
    if len(legs) < 2 or neck is None:
        raise SceneError(NO.format("legs" if len(legs) < 2 else "neck"))
    crotch, top_of = float(heights[lowest]), float(heights[neck])
    trunk_at = [hulls[k] for k in range(lowest, neck + 1)]
    girths = _without_arms(np.interp(crotch + AT * (top_of - crotch), heights[lowest: neck + 1], [girth(h) for h in trunk_at]))
    middle = np.mean([centre(h) for h in trunk_at], axis=0)
    widest = max((hulls[k] for k in range(start, neck)), key=lambda h: np.ptp(h @ _across(h)))
    forward, known = _forward(x, faces, floor, top - floor, _across(widest))
    return Figure(crotch, top_of, middle, forward, known, girths)


def _without_arms(girths: np.ndarray) -> np.ndarray:
    """Girths (6,) of a trunk; a level at which arms are stretched out has that of the nearest one without them."""
    trunk = np.flatnonzero(girths <= ARMS * np.median(girths))
    return girths[trunk[np.abs(trunk[:, None] - np.arange(len(girths))).argmin(axis=0)]]


def parts_at(x: np.ndarray, faces: np.ndarray, height: float) -> list[np.ndarray]:
    """Convex hulls (k, 2), counterclockwise, x and z [m], of the parts of a surface that a level cuts."""
    above = x[:, 1] > height
    ends = faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    ends = np.sort(ends[above[ends[:, 0]] != above[ends[:, 1]]], axis=1)
    if not len(ends):
        return []
    edges, of = np.unique(ends, axis=0, return_inverse=True)
    a, b = x[edges[:, 0]], x[edges[:, 1]]
    cut = (a + ((height - a[:, 1]) / (b[:, 1] - a[:, 1]))[:, None] * (b - a))[:, [0, 2]]
    of = of.reshape(-1, 2)  # a triangle that is cut has two such edges
    label = components(len(edges), of[:, 0], of[:, 1])
    hulls = [hull(cut[label == k]) for k in np.unique(label)]
    out: list[np.ndarray] = []
    for h in hulls:
        if len(h) > 2:
            over = [other for other in out if overlap(h, other)]
            while over:  # a larger hull may reach others
                out = [other for other in out if not any(other is o for o in over)]
                h = hull(np.concatenate([h, *over]))
                over = [other for other in out if overlap(h, other)]
            out.append(h)
    return out


def hull(points: np.ndarray) -> np.ndarray:
    """(k, 2) corners of the convex hull of points (n, 2), counterclockwise."""
    points = np.unique(points, axis=0)

    def chain(rows: np.ndarray) -> list[np.ndarray]:
        out: list[np.ndarray] = []
        for p in rows:
            while len(out) > 1 and _turns(out[-2], out[-1], p) <= 0:
                out.pop()
            out.append(p)
        return out[:-1]

    return np.array(chain(points) + chain(points[::-1])).reshape(-1, 2)


def overlap(a: np.ndarray, b: np.ndarray) -> bool:
    """Whether convex polygons (k, 2), counterclockwise, have a point in common: no edge of either has the other outside."""
    for p, q in ((a, b), (b, a)):
        d = np.roll(p, -1, axis=0) - p
        outside = (q[None, :, 0] - p[:, None, 0]) * d[:, None, 1] - (q[None, :, 1] - p[:, None, 1]) * d[:, None, 0]
        if (outside > 0).all(axis=1).any():
            return False
    return True


def area(h: np.ndarray) -> float:
    """Signed area of a polygon (k, 2) [m^2]."""
    after = np.roll(h, -1, axis=0)
    return float((h[:, 0] * after[:, 1] - h[:, 1] * after[:, 0]).sum() / 2)


def girth(h: np.ndarray) -> float:
    """Length of the border of a polygon (k, 2)."""
    return float(np.linalg.norm(np.roll(h, -1, axis=0) - h, axis=1).sum())


def _turns(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> float:
    return float((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]))


def centre(h: np.ndarray) -> np.ndarray:
    """(2,) centre of area of a polygon (k, 2)."""
    after = np.roll(h, -1, axis=0)
    part = h[:, 0] * after[:, 1] - h[:, 1] * after[:, 0]
    return ((h + after) * part[:, None]).sum(axis=0) / (3 * part.sum())


def surface_of(body: Scene) -> tuple[np.ndarray, np.ndarray]:
    """(vertices (n, 3) of all solids at time 0 [m], triangles (m, 3))."""
    parts = [(s.surface_at(0.0), s.shape.surface()[1]) for s in body.solids]
    first = np.cumsum([0] + [len(x) for x, _ in parts])
    return np.concatenate([x for x, _ in parts]), np.concatenate([f + k for (_, f), k in zip(parts, first)])


def _over_feet(parts: list[np.ndarray], x: np.ndarray, faces: np.ndarray, floor: float, tall: float) -> np.ndarray:
    """The largest of the parts half way up that is over or between the feet: others are arms, or things that are carried."""
    if not parts:
        raise SceneError(NO.format("trunk half way up"))
    cut = [h for k in (SOLE, ANKLE) for h in parts_at(x, faces, floor + k * tall)]
    feet = hull(np.concatenate([np.zeros((0, 2)), *cut]))
    over = [h for h in parts if len(feet) > 2 and overlap(h, feet)]
    if not over:
        aside = max(parts, key=area)
        at = place(centre(feet)) if len(feet) > 2 else "nowhere"
        raise SceneError(f"fitted: the body has no trunk over its feet, whose middle is {at}: half way up, its largest part "
                         f"is {girth(aside):.3g} m round, at {place(centre(aside))}, and none is over them")
    return max(over, key=area)


def place(at: np.ndarray) -> str:
    """x and z (2,) [m], written as a report has them."""
    u, v = at.round(3) + 0.0  # no minus before a 0
    return f"({u:g}, {v:g}) m"


def _followed(x: np.ndarray, faces: np.ndarray, heights: np.ndarray, trunk: np.ndarray) -> list[np.ndarray]:
    """The largest hull at each height that is over or under the one before, down to where it is much smaller."""
    out: list[np.ndarray] = []
    for height in heights:
        there = max((h for h in parts_at(x, faces, height) if overlap(h, trunk)), key=area, default=None)
        if there is None or (heights[-1] < heights[0] and area(there) < NARROW * area(trunk)):
            break
        trunk = there
        out.append(trunk)
    return out


def _across(h: np.ndarray) -> np.ndarray:
    """(2,) the direction in which a polygon (k, 2) is longest."""
    pair = h[:, None] - h[None]
    k = int(np.argmax(np.linalg.norm(pair, axis=2)))
    d = pair.reshape(-1, 2)[k]
    return d / np.linalg.norm(d)


def _forward(x: np.ndarray, faces: np.ndarray, floor: float, tall: float, across: np.ndarray) -> tuple[np.ndarray, bool]:
    """(the way (2,) that a body faces, whether its feet say so) with arms that way (2,)."""
    forward = np.array([-across[1], across[0]])
    forward = forward if forward @ [1e-3, 1.0] > 0 else -forward  # nearer to +z, or else to +x
    ankles = parts_at(x, faces, floor + ANKLE * tall)
    toes = np.zeros(2)
    for sole in parts_at(x, faces, floor + SOLE * tall):
        off = [centre(sole) - centre(ankle) for ankle in ankles]
        toes += min(off, key=np.linalg.norm, default=np.zeros(2))
    long = float(np.linalg.norm(toes))
    if long < STANDS_OUT * tall:
        return forward, False
    forward = forward if toes @ forward > 0 else -forward
    return (forward if toes @ forward > ASIDE * long else toes / long), True
