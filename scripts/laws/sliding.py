"""Sheets that stick to and slide on solids that lie, move and turn."""

import numpy as np

import taichi_cloth as tc

from .case import CREEP, G, Result, case, fabric, follow, gained, noisy, speed, turned

THICK = 0.004  # m


def lying(cells: int, start: int, size: float = 0.2, at: tuple = (0.0, 0.0), velocities: object = None) -> tuple:
    """(scene, mesh, positions): a square sheet that lies at the thickness above y = 0, its middle at (x, z)."""
    mesh, scene = tc.grid(size, cells, centred=True), tc.Scene()
    x = noisy(mesh.x + [at[0], THICK, at[1]], start)
    scene.add_cloth(mesh, fabric(k=1000.0, bend=5e-5), positions=x,
                    velocities=None if velocities is None else velocities(x))
    return scene, mesh, x


@case(20, 50, 100)
def slip_front(h: float, cells: int, start: int, threads: int) -> tuple[Result, ...]:
    """A strip on a plane that is drawn at one end by twice its friction goes as a whole with mu g.

    A front runs through it at c = sqrt(k / rho) and reaches the other end after T = L / c. Until then only what it has
    passed rubs: m v' = 2 mu m g - mu m g t / T. So at T it has v = 3/2 mu g T and has moved 5/6 mu g T^2; then v' = mu g.
    Of what is moved at t, a method of first order may be off by v h / 2.
    """
    mu, length, width, rho, k, until = 0.3, 0.5, 0.09, 0.2, 500.0, 0.4
    mesh, scene = tc.strip(length, width, (cells, max(2, cells // 6))), tc.Scene()
    cloth = scene.add_cloth(mesh, fabric(rho, k), positions=noisy(mesh.x + [0, THICK, 0], start))
    scene.add_solid(tc.Plane(), mu, THICK)
    end = mesh.select("right")
    part = np.where(np.isin(np.arange(len(end)), [0, len(end) - 1]), 0.5, 1.0)
    weight = rho * length * width * G
    scene.add_load(cloth, end, np.outer(2 * mu * weight * part / part.sum(), [1, 0, 0]))
    t, x = follow(scene, h, threads, until)

    def way(friction: float) -> tuple[float, float]:
        """(moved [m], velocity [m/s]) at the end, of the same force."""
        a, passed = G * (2 * mu - friction), length / np.sqrt(k / rho)
        v, rest = G * (2 * mu - friction / 2) * passed, t[-1] - passed
        return G * passed**2 * (mu - friction / 6) + v * rest + a * rest**2 / 2, v + a * rest

    law, v = way(mu)
    return Result("moved", float((x[-1] - x[0])[:, 0].mean()), law, 0.03 * law + v * h / 2, "m", wrong=way(2 * mu)[0]),


@case(5, 12)
def turntable(h: float, cells: int, start: int, threads: int) -> tuple[Result, ...]:
    """A sheet beside the axis of a turntable sticks where its edge needs half of mu g, omega^2 r = mu g / 2.

    It starts with the table's velocity. Slip is its mean speed in the turning frame, from a quarter of a second on.
    """
    mu, inner, size = 0.3, 0.05, 0.2
    omega = float(np.sqrt(mu * G / 2 / np.hypot(inner + size, size / 2)))
    scene, _, _ = lying(cells, start, size, (inner + size / 2, 0.0), lambda x: omega * x[:, [2, 1, 0]] * [1, 0, -1])
    scene.add_solid(tc.Cylinder(0.6, 0.1), mu, THICK, position=(0, -0.05, 0), rotation=lambda t: (0, omega * t, 0))
    t, x = follow(scene, h, threads, 0.5)
    slip = np.abs(speed(t, turned(x, -omega * t, 1).mean(axis=1), 0.25, 0.5)).max()
    fast = omega * (inner + size / 2)
    return Result("slip", float(slip), 0.0, CREEP * fast, "m/s", wrong=fast),


@case(6, 12)
def turntable_catches(h: float, cells: int, start: int, threads: int) -> tuple[Result, ...]:
    """A sheet that rests on the axis of a turning table is spun up by friction, lags by omega^2 / 2 alpha, then sticks.

    alpha I = mu g (m / A) int r dA, and I = (m / A) int r^2 dA; of a square with side a: int r dA = .38260 a^3 and
    int r^2 dA = a^4 / 6. Both are of the mesh here, lumped at its vertices. A method of first order may add omega h / 2.
    """
    mu, omega, size = 0.3, 3.0, 0.2
    scene, mesh, start_x = lying(cells, start, size)
    scene.add_solid(tc.Cylinder(0.6, 0.1), mu, THICK, position=(0, -0.05, 0), rotation=lambda t: (0, omega * t, 0))
    t, x = follow(scene, h, threads, 0.5)
    weight = np.bincount(mesh.faces.ravel(), np.repeat(mesh.material_areas / 3, 3))
    r = np.hypot(start_x[:, 0], start_x[:, 2])
    alpha = mu * G * (weight @ r) / (weight @ r**2)
    z, y = x[-1, :, 2] @ start_x[:, 2] + x[-1, :, 0] @ start_x[:, 0], x[-1, :, 0] @ start_x[:, 2] - x[-1, :, 2] @ start_x[:, 0]
    lag = (omega * t[-1] - np.arctan2(y, z) + np.pi) % (2 * np.pi) - np.pi
    law = omega**2 / 2 / alpha
    back = turned(x, -omega * t, 1)
    slip = np.linalg.norm(speed(t, back, 0.3, 0.5), axis=1).max()
    return (Result("lags", float(lag), law, 0.03 * law + omega * h / 2, "rad", wrong=law / 2),
            Result("slip after", float(slip), 0.0, CREEP * omega * size / 2, "m/s", wrong=omega * size / 2))


@case(6, 12)
def drum(h: float, cells: int, start: int, threads: int) -> tuple[Result, ...]:
    """A small sheet on top of a drum that rolls goes with it up to the angle with tan = mu, then slides down faster.

    p is the angle of its middle; it covers 2 a of the drum, so that gravity along it and on it are g sin(p) and g cos(p)
    times sin(a) / a. N = m (g cos(p) - R p'^2) gives R p'' = g (sin(p) - mu cos(p)) sin(a) / a + mu R p'^2 from
    tan(p) = mu and p' = omega on. Its tension, of the order of a^2, is left out. A method of first order may be off by h times
    what it is faster than the drum: it takes speeds, and what pulls and grows from 0 on, of a step's end, h / 2 each.
    """
    mu, omega, size = 0.3, 0.8, 0.1
    radius = 0.5 + THICK
    mesh, scene = tc.grid(size, cells, centred=True), tc.Scene()
    s = mesh.x[:, 0] / radius
    x0 = noisy(np.stack([radius * np.sin(s), radius * np.cos(s), mesh.x[:, 2]], axis=1), start)
    scene.add_cloth(mesh, fabric(k=1000.0), positions=x0, velocities=omega * x0[:, [1, 0, 2]] * [-1, 1, 0])
    scene.add_solid(tc.Cylinder(0.5, 0.4), mu, THICK, rotation=lambda t: rolled(omega * t))
    t, x = follow(scene, h, threads, 0.65)
    p = np.arctan2(-x[..., 0], x[..., 1]).mean(axis=1)

    def ahead(friction: float) -> tuple[float, float]:
        """Angle [rad] that it is ahead of the drum in the end, and how fast."""
        angle, rate, dt = np.arctan(friction), omega, 1e-4
        pull = G / radius * np.sin(size / 2 / radius) / (size / 2 / radius)
        for _ in range(round((t[-1] - angle / omega) / dt)):
            rate += dt * (pull * (np.sin(angle) - friction * np.cos(angle)) + friction * rate**2)
            angle += dt * rate
        return float(angle - omega * t[-1]), float(rate - omega)

    mid = np.abs(t - 0.25).argmin()
    law, fast = ahead(mu)
    return (Result("goes along", float(p[mid]), omega * t[mid], 1e-4, "rad", wrong=2 * omega * t[mid]),
            Result("slides", float(p[-1] - omega * t[-1]), law, 0.03 * law + fast * h, "rad", wrong=ahead(mu / 2)[0]))


def rolled(angle: float) -> np.ndarray:
    """Rotation (3, 3) that lays a cylinder's axis y along z, then turns it about z by an angle."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]])


@case(5, 12)
def conveyor(h: float, cells: int, start: int, threads: int) -> tuple[Result, ...]:
    """A belt that carries a sheet at v and turns back at once: the sheet slips by (2 v)^2 / (2 mu g), then sticks again.

    Relative speed 2 v falls by mu g a second; a method of first order may add 2 v h / 2.
    """
    mu, v, turns = 0.3, 0.3, 0.1
    scene, _, _ = lying(cells, start, velocities=lambda x: 0 * x + [v, 0, 0])
    scene.add_solid(tc.Plane(), mu, THICK, position=lambda t: (v * (turns - abs(t - turns)), 0, 0))
    t, x = follow(scene, h, threads, 0.6)
    slid = x[..., 0] - v * (turns - np.abs(t - turns))[:, None]
    mean, law = slid.mean(axis=1), (2 * v) ** 2 / (2 * mu * G)
    slip = np.abs(speed(t, slid, 0.45, 0.6)).max()
    return (Result("slipped", float(mean[-1] - mean[0]), law, 0.02 * law + v * h, "m", wrong=law / 2),
            Result("slip after", float(slip), 0.0, CREEP * v, "m/s", wrong=2 * v))


def driven(part: float, later: float, h: float, cells: int, start: int,
           threads: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(times, ways of the vertices and of the plane), which gains a part of mu g for .3 s, and another later."""
    a, then, until = part * 0.3 * G, later * 0.3 * G, 0.3
    scene, _, _ = lying(cells, start)

    def way(t: float) -> float:
        rest = max(t - until, 0.0)
        return a * min(t, until) ** 2 / 2 + a * until * rest + then * rest**2 / 2

    scene.add_solid(tc.Plane(), 0.3, THICK, position=lambda t: (way(t), 0, 0))
    t, x = follow(scene, h, threads, 0.9 if part > 1 else 0.5)
    return t, x[..., 0] - x[0, :, 0], np.array([way(s) for s in t])


@case(5, 12)
def plane_sticks(h: float, cells: int, start: int, threads: int) -> tuple[Result, ...]:
    """A sheet goes with a plane that gains half of mu g, and goes on so when that moves uniformly."""
    t, x, plane = driven(0.5, 0.0, h, cells, start, threads)
    off = np.abs(x - plane[:, None])
    slip, fast = np.abs(speed(t, x - plane[:, None], 0.4, 0.5)).max(), 0.15 * G * 0.3
    return (Result("slid", float(off.max()), 0.0, 1e-6, "m", wrong=float(plane[-1])),
            Result("slip after", float(slip), 0.0, CREEP * fast, "m/s", wrong=fast))


@case(5, 12)
def plane_slips(h: float, cells: int, start: int, threads: int) -> tuple[Result, ...]:
    """Under a sheet a plane gains 1.5 mu g for .3 s: the sheet gains mu g, catches up with the plane, and sticks.

    It has slid by 1/2 (1.5 - 1) mu g .3^2 when the plane stops to gain, and by v^2 / (2 mu g) more, v = .5 mu g .3.
    What gains w may be off by w h / 2, by a method of first order: w = .45 mu g here.
    """
    t, x, plane = driven(1.5, 0.0, h, cells, start, threads)
    a = 0.3 * G
    law = 0.25 * a * 0.09 + (0.15 * a) ** 2 / (2 * a)
    slid = plane - x.mean(axis=1)
    slip = np.abs(speed(t, x - plane[:, None], 0.7, 0.9)).max()
    return (Result("gains", gained(t, x.mean(axis=1), 0.05, 0.3), a, 0.01 * a, "m/s^2", wrong=2 * a),
            Result("slid", float(slid[-1]), law, 0.02 * law + 0.45 * a * h / 2, "m", wrong=law / 2),
            Result("slip after", float(slip), 0.0, CREEP * 0.45 * a, "m/s", wrong=0.45 * a))


@case(5, 12)
def sticks_again(h: float, cells: int, start: int, threads: int) -> tuple[Result, ...]:
    """Under a sheet a plane gains 1.5 mu g for .3 s, then half of mu g: the sheet catches up, and sticks though it is loaded.

    It has slid by .25 mu g .3^2 when the plane gains less, and by v^2 / (2 (1 - .5) mu g) more, v = .5 mu g .3.
    What gains w may be off by w h / 2, by a method of first order: w = .6 mu g here.
    """
    t, x, plane = driven(1.5, 0.5, h, cells, start, threads)
    a = 0.3 * G
    law = 0.25 * a * 0.09 + (0.15 * a) ** 2 / a
    slip = np.abs(speed(t, x - plane[:, None], 0.75, 0.9)).max()
    return (Result("slid", float(plane[-1] - x[-1].mean()), law, 0.02 * law + 0.6 * a * h / 2, "m", wrong=law / 2),
            Result("slip after", float(slip), 0.0, CREEP * 0.75 * a, "m/s", wrong=0.45 * a))


@case(8, 16)
def grip(h: float, cells: int, start: int, threads: int) -> tuple[Result, ...]:
    """A strip on which two pads close, and that then bears a tenth of what their friction allows, does not slip.

    Pads of a x a that leave less room than thicknesses press by 2 kPa at least: mu 2 a^2 2 kPa is what both hold. They close
    in .1 s, and a tenth of it draws from .15 s on, without gravity; between the pads no vertex moves after a quarter second.
    """
    mu, a, length = 0.4, 0.05, 0.15
    mesh, scene = tc.strip(length, a, (cells, max(2, cells // 3)), plane="xy"), tc.Scene(gravity=None)
    x0 = mesh.x[:, [1, 0, 2]] * [1, -1, 1] + [-a / 2, a / 2, 0]
    cloth = scene.add_cloth(mesh, fabric(k=2000.0), positions=noisy(x0, start))
    low = np.flatnonzero(mesh.uv[:, 0] > length - 1e-9)
    pull = 0.1 * mu * 2 * a * a * 2000.0 / len(low)
    scene.add_load(cloth, low, lambda t: (0, -pull * min(max(t / 0.05 - 3, 0.0), 1.0), 0))
    for side in (-1, 1):
        scene.add_solid(tc.Box((2 * a, a, 0.04), 0.002), mu, THICK,
                        position=lambda t, s=side: (0, 0, s * (0.02 + THICK * (0.8 + 0.4 * max(1 - t / 0.1, 0.0)))))
    t, x = follow(scene, h, threads, 0.5)
    between = x0[:, 1] > -a / 2 + 0.25 * a
    slip = np.abs(speed(t, x[:, between], 0.25, 0.5)).max()
    return Result("slip", float(slip), 0.0, CREEP, "m/s", wrong=1e-3),
