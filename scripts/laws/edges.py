"""Strips that slide over edges and bars, and are wound round them: the chain with a capstan, and Euler's rope."""

import math
from functools import partial

import numpy as np

import taichi_cloth as tc

from .case import CREEP, G, Result, case, enter, fabric, follow, gained, noisy, speed

THICK = 0.004  # m


def bent(u: np.ndarray, first: float, radius: float, turn: float, slope: float) -> np.ndarray:
    """Places (n, 2) at arc lengths u along a straight part, an arc about the origin, and a straight part again.

    Args:
        u: arc lengths [m]; the arc begins at `first`.
        radius: of the arc [m].
        turn: its angle [rad].
        slope: by which the first part leads downwards [rad].
    """
    a = np.clip((u - first) / radius, 0.0, turn)
    at = slope + a  # of the tangent, below the horizontal
    before, after = np.minimum(u - first, 0.0), np.maximum(u - first - radius * turn, 0.0)
    along = (before + after)[:, None] * np.stack([np.cos(at), -np.sin(at)], axis=1)
    return radius * np.stack([np.sin(at), np.cos(at)], axis=1) + along


def chain(until: float, lengths: tuple[float, float], arc: tuple[float, float], mu: float,
          slope: float) -> tuple[float, float]:
    """(way [m], speed [m/s]) of a chain over an arc, from rest: the capstan's equation with the arc's weight and speed.

    Before the arc lie l1, behind it hang l2; r and phi are the arc's radius and angle. Over rho, tensions before and behind
    are T1 = l1 (a - d), d = g (sin(b) - mu cos(b)) on a slope b and -g where it hangs, and T2 = l2 (g - a). On the arc, where
    the chain leads downwards by s, T' = mu (T - v^2 + r g cos(s)) + r (a - g sin(s)), ' by the angle. That is linear: with
    e = exp(mu phi) and A = int exp(mu (b + phi - s)) r g (mu cos(s) - sin(s)) ds,
    a = (g l2 - A + e l1 d + (e - 1) v^2) / (l2 + e l1 + r (e - 1) / mu). Where that leaves the arc's begin without a normal
    force, mu = 0 on it; and what friction holds at rest has a = 0.
    """
    radius, phi = arc
    d = -G if slope < -1.0 else G * (math.sin(slope) - mu * math.cos(slope))
    (l1, l2), parts = lengths, []
    for m in (mu, 0.0):
        s = slope + (np.arange(400) + 0.5) * phi / 400
        weight = np.sum(np.exp(m * (slope + phi - s)) * radius * G * (m * np.cos(s) - np.sin(s))) * phi / 400
        parts.append((math.exp(m * phi), float(weight), radius * (math.expm1(m * phi) / m if m else phi)))
    way, v, dt = 0.0, 0.0, 1e-4
    for _ in range(round(until / dt)):
        a = 0.0
        for e, weight, inert in parts:
            a = (G * l2 - weight + e * l1 * d + (e - 1) * v * v) / (l2 + e * l1 + inert)
            if l1 * (a - d) - v * v + radius * G * math.cos(slope) >= 0:
                break
        a = max(a, 0.0) if v <= 0 else a
        v += a * dt
        way, l1, l2 = way + v * dt, l1 - v * dt, l2 + v * dt
    return way, v


def over(h: float, cells: int, start: int, threads: int, mu: float, shape: str = "round", slope: float = 0.0,
         hangs: float = 0.4, until: float = 0.3) -> tuple[Result, ...]:
    """Way and speed of a strip of .5 m of which a part hangs over an edge ("round", "sharp", "mesh") or bar, after a time.

    Both are those of its upper end, the speed a mean of the last thirtieth of a second; of the way a method of first order
    may be off by v h / 2.
    """
    length, width = 0.5, 0.09
    rounding = {"round": 0.01, "sharp": 0.0, "mesh": 0.0, "bar": 0.03}[shape]
    radius = rounding + THICK
    tilt, turn = (-math.pi / 2, math.pi) if shape == "bar" else (slope, math.pi / 2 - slope)
    second = hangs * length
    first = length - second - radius * turn
    mesh, scene = tc.strip(length, width, (cells, max(2, cells // 20))), tc.Scene()
    x0 = bent(mesh.uv[:, 0], first, radius, turn, tilt)
    scene.add_cloth(mesh, fabric(k=1000.0), positions=noisy(np.column_stack([x0, mesh.uv[:, 1] - width / 2]), start))
    if shape == "bar":
        scene.add_solid(tc.Cylinder(rounding, 0.5), mu, THICK, rotation=(math.pi / 2, 0, 0))
    else:
        box = tc.Box((2.0, 0.8, 1.0), rounding)
        box = tc.SolidMesh(*box.core()[:2]) if shape == "mesh" else box
        c, s = math.cos(slope), math.sin(slope)
        corner = np.array([1.0 - rounding, 0.4 - rounding])
        scene.add_solid(box, mu, THICK, position=(-c * corner[0] - s * corner[1], s * corner[0] - c * corner[1], 0),
                        rotation=(0, 0, -slope))
    t, x = follow(scene, h, threads, until)
    far = mesh.uv[:, 0] < 1e-9
    along = np.array([math.cos(tilt), -math.sin(tilt), 0.0])
    way = (x[:, far].mean(axis=1) - x[0, far].mean(axis=0)) @ along
    late = np.abs(t - until + 1 / 30).argmin()

    def said(friction: float) -> tuple[float, float]:
        """(way, mean speed) by the law."""
        end, before = (chain(at, (first, second), (radius, turn), friction, tilt)[0] for at in (t[-1], t[late]))
        return end, (end - before) / (t[-1] - t[late])

    (law, v), (wrong, fast) = said(mu), said(2 * mu if mu else 0.1)
    return (Result("way", float(way[-1]), law, 0.05 * law + v * h / 2, "m", wrong=wrong),
            Result("speed", float(speed(t, way, t[late], t[-1])), v, 0.05 * v, "m/s", wrong=fast))


@case(50, 100)
def edge_smooth(h: float, cells: int, start: int, threads: int) -> tuple[Result, ...]:
    """A strip slides over a table's rounded edge, mu = 0, as a chain does (see `chain`), which leaves the edge at .23 s."""
    return over(h, cells, start, threads, 0.0, until=0.2)


@case(50, 100)
def edge_round(h: float, cells: int, start: int, threads: int) -> tuple[Result, ...]:
    """A strip slides over a table's rounded edge, mu = .2, as a chain with a capstan does (see `chain`)."""
    return over(h, cells, start, threads, 0.2)


@case(50, 100)
def edge_sharp(h: float, cells: int, start: int, threads: int) -> tuple[Result, ...]:
    """A strip slides over a table's sharp edge, mu = .2, as over an arc of its thickness."""
    return over(h, cells, start, threads, 0.2, "sharp")


@case(50, 100)
def edge_mesh(h: float, cells: int, start: int, threads: int) -> tuple[Result, ...]:
    """A strip slides over the sharp edge of a box of triangles, mu = .2, as over an arc of its thickness."""
    return over(h, cells, start, threads, 0.2, "mesh")


@case(50, 100)
def edge_slope(h: float, cells: int, start: int, threads: int) -> tuple[Result, ...]:
    """A strip slides down a slope of 35 degrees, mu = .2, and over its lower rounded edge."""
    return over(h, cells, start, threads, 0.2, slope=math.radians(35), hangs=0.1)


@case(50, 100)
def towel(h: float, cells: int, start: int, threads: int) -> tuple[Result, ...]:
    """A towel slides off a round bar of which more than Euler's rope bears hangs on one side, mu = .2."""
    return over(h, cells, start, threads, 0.2, "bar", hangs=0.6, until=0.25)


ROUND, WIDE, THIN = 0.05, 0.03, 0.002  # m: radius of the bar that is wound round, width and thickness of the strip
TAIL = 0.2  # m that is straight at either end


def wound(cells: int, start: int, phi: float, mu: float, mass: float) -> tuple:
    """A strip of next to no weight round a bar, by an angle, with a mass [kg] at either end and without gravity.

    Windings beyond the first lie where the first lies: the strip does not meet itself.

    Returns:
        (scene, cloth, mesh, unit vectors (3,) in which the first and the last end are pulled)
    """
    length = phi * (ROUND + THIN) + 2 * TAIL
    mesh, scene = tc.strip(length, WIDE, (cells, 1), diagonals="uniform"), tc.Scene(gravity=None)
    x = bent(mesh.uv[:, 0], TAIL, ROUND + THIN, phi, -math.pi / 2)
    cloth = scene.add_cloth(mesh, tc.Fabric(0.02, tc.Stretch(20000, 200.0), tc.Shear(2000, 2.0)),
                            positions=noisy(np.column_stack([x, mesh.uv[:, 1] - WIDE / 2]), start))
    for rows in ("left", "right"):
        scene.add_mass(cloth, mesh.select(rows), mass / 2)
    scene.pin(cloth, np.arange(mesh.vertex_count), "z")
    scene.add_solid(tc.Cylinder(ROUND, 0.5), mu, THIN, rotation=(math.pi / 2, 0, 0))
    last = phi - math.pi / 2
    return scene, cloth, mesh, np.array([[0, -1, 0], [math.cos(last), -math.sin(last), 0]], dtype=float)


def corners(cells: int, phi: float, mu: float) -> float:
    """exp(mu phi) on the polygon that so many cells make of the bar of `wound`, with corners of 2 a.

    Of the forces at one, (T2 - T1) cos a = mu N and N = (T2 + T1) sin a: T2 / T1 = (1 + mu tan a) / (1 - mu tan a). It is 1 %
    more for the coarsest of the meshes.
    """
    a = math.asin((phi * (ROUND + THIN) + 2 * TAIL) / cells / (2 * (ROUND + THIN)))
    return ((1 + mu * math.tan(a)) / (1 - mu * math.tan(a))) ** (phi / (2 * a))


def capstan(phi: float, mu: float, h: float, cells: int, start: int, threads: int) -> tuple[Result, ...]:
    """A strip drawn round a bar: of the tensions at its ends one is exp(mu phi) times the other, whatever the bar's radius.

    dT = mu N ds and N = T / R give dT = mu T d(phi), on the mesh `corners`. Both tensions are k times the width times the
    strain of straight parts, so that their ratio is that of the strains; it is taken from .45 s on.
    """
    scene, cloth, mesh, ways = wound(cells, start, phi, mu, 1e-4)
    first, last = mesh.select("left"), mesh.select("right")
    scene.add_load(cloth, first, lambda t: 0.25 * min(1.0, t / 0.2) * ways[0])
    scene.move(cloth, last, lambda t: 0.08 * (t - (1 - math.exp(-20 * t)) / 20) * ways[1], relative=True, directions="xy")
    t, x = follow(scene, h, threads, 0.7)
    rows = [np.flatnonzero(np.abs(mesh.uv[:, 0] - u) < 1e-9) for u in np.unique(mesh.uv[:, 0])]
    many = max(2, round(0.06 * (len(rows) - 1) / np.ptp(mesh.uv[:, 0])))  # rows that are straight all the time
    strain = [np.linalg.norm(x[:, a].mean(axis=1) - x[:, b].mean(axis=1), axis=1)
              / (mesh.uv[b[0], 0] - mesh.uv[a[0], 0]) - 1 for a, b in ((rows[0], rows[many]), (rows[-1 - many], rows[-1]))]
    late, law = t > 0.45, corners(cells, phi, mu)
    ratio = (strain[1] / strain[0])[late]
    return (Result("ratio", float(ratio.mean()), law, 0.01 * law, wrong=math.exp(2 * mu * phi)),
            Result("spread", float(ratio.std()), 0.0, 0.01 * law, wrong=law))


def rope(part: float, h: float, cells: int, start: int, threads: int) -> tuple[np.ndarray, np.ndarray, float]:
    """(times, way of the end that is pulled more, acceleration by the law) at a part of what exp(mu phi) = 4.81 bears.

    Masses m at both ends are pulled by F1 and F2: F2 - m a = r (F1 + m a), or 0 where F2 < r F1, with r of `corners`.
    """
    mu, phi, mass, force = 0.5, math.pi, 0.3, 1.0
    scene, cloth, mesh, ways = wound(cells, start, phi, mu, mass)
    bears = corners(cells, phi, mu)
    for rows, pull, way in zip(("left", "right"), (force, part * bears * force), ways):
        scene.add_load(cloth, mesh.select(rows), 0.5 * pull * way)
    t, x = follow(scene, h, threads, 0.4)
    moved = (x[:, mesh.select("right")].mean(axis=1) - x[0, mesh.select("right")].mean(axis=0)) @ ways[1]
    return t, moved, force * bears * max(part - 1, 0.0) / mass / (1 + bears)


@case(40, 80)
def rope_holds(h: float, cells: int, start: int, threads: int) -> tuple[Result, ...]:
    """A rope round half a turn of a bar, mu = .5, holds nine tenths of exp(mu phi) times the force at its other end."""
    t, moved, _ = rope(0.9, h, cells, start, threads)
    return Result("slip", float(abs(speed(t, moved, 0.3, 0.4))), 0.0, CREEP, "m/s", wrong=0.3),


@case(40, 80)
def rope_runs(h: float, cells: int, start: int, threads: int) -> tuple[Result, ...]:
    """It runs at 1.4 times exp(mu phi), as much faster every second as the masses at its ends allow (see `rope`)."""
    t, moved, law = rope(1.4, h, cells, start, threads)
    return Result("gains", gained(t, moved, 0.15, 0.4), law, 0.03 * law, "m/s^2", wrong=1.1 * law),


for _degrees, _mu, _cells in ((90, 0.3, 30), (180, 0.1, 40), (180, 0.3, 40), (180, 0.5, 40), (180, 0.8, 40), (360, 0.3, 50),
                             (720, 0.1, 80)):
    enter(f"capstan_{_degrees}_{10 * _mu:02.0f}", partial(capstan, math.radians(_degrees), _mu), _cells, 2 * _cells)
