"""Hard cases against every integrator: a table of what passes, by stated rules, and what is refused by name.

    python scripts/stability.py [--cases stiff masses] [--integrators safe verlet] [--precision f64 f32] [--json FILE]

Each case is a small sheet in a situation that breaks solvers. It passes if
 - no number becomes infinite or NaN, and the run reaches its end, or is refused by name where the case has no answer;
 - mechanical energy never exceeds what it began with plus the work put in, by more than 2 % of the case's scale;
 - held vertices are where they must be, to rounding;
 - the motion has the right speed: free cloth falls with g (a frozen sheet is a failure);
 - where the case says so, the state at rest is that of a run with small steps, to 1 %, or another of the same energy to .1 %
   (wrinkles may settle this way or that).
"""

import argparse
import json
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

import taichi_cloth as tc

H, G = 1 / 60, 9.81
SOFT: dict = {"density": 0.2, "stretch": tc.Stretch(1000.0), "shear": tc.Shear(100.0), "bend": tc.Bend(5e-5)}
INTEGRATORS = ("safe", "tr_bdf2", "backward_euler", "newton_euler", "verlet")


@dataclass(frozen=True)
class Case:
    """A hard situation.

    Attributes:
        make: builds the scene and gives the positions it starts from, or None for the scene's own.
        t: simulated time [s]; h: step [s].
        free: whether the cloth falls freely, so that its speed is known.
        driven: whether pins or wind do work, so that energy says nothing.
        rest: whether the end is compared with a run at a tenth of the step.
        refused: the reason for which a run may end early; rough: the same in f32, where rounding alone is too much.
    """

    make: Callable[[], tuple[tc.Scene, np.ndarray | None]]
    t: float = 0.5
    h: float = H
    free: bool = False
    driven: bool = False
    rest: bool = False
    refused: tuple[str, ...] = ()
    rough: tuple[str, ...] = ()


def sheet(n: int = 10, pins: tuple[str, ...] = ("top_left", "top_right"), mesh: tc.TriMesh | None = None, **fabric):
    """A scene with one sheet of 1 m."""
    scene = tc.Scene()
    cloth = scene.add_cloth(mesh or tc.grid(1.0, n), tc.Fabric(**{**SOFT, **fabric}))
    for name in pins:
        scene.pin(cloth, name)
    return scene, cloth


def started(positions: Callable[[np.ndarray], np.ndarray], **fabric):
    """A free sheet that starts deformed."""
    def make():
        scene, cloth = sheet(pins=(), **fabric)
        return scene, positions(np.array(cloth.positions))
    return make


def collapsed(x: np.ndarray) -> np.ndarray:
    x = x.copy()
    x[:, 0] = np.where(x[:, 0] > 0.5, 0.5, x[:, 0])  # half of the triangles have no width
    return x


def folded(x: np.ndarray) -> np.ndarray:
    x = x.copy()
    x[:, 0] = np.where(x[:, 0] > 0.5, 1.0 - x[:, 0], x[:, 0])
    return x


def scattered(x: np.ndarray) -> np.ndarray:
    return np.random.default_rng(20_260_811).uniform(-0.5, 0.5, x.shape)


def plain(**fabric):
    return lambda: (sheet(**fabric)[0], None)


def heavy():
    scene, cloth = sheet()
    scene.add_mass(cloth, "bottom", 1000 * 0.2 / 121)
    return scene, None


def slivers():
    mesh = tc.grid((1.0, 0.01), (5, 50), plane="xz")  # cells of 200 x 0.2 mm
    return sheet(mesh=mesh, pins=("left",))[0], None


def jerked():
    """A corner that goes up and down at 10 m/s and turns at once."""
    scene, cloth = sheet(pins=("top_left",))
    scene.move(cloth, "top_right", lambda t: np.array([0.0, 0.1 * (1 - 2 * abs((50 * t) % 1 - 0.5)), 0.0]), relative=True)
    return scene, None


def fast():
    scene, cloth = sheet(pins=())
    for name in ("top_left", "top_right"):
        scene.move(cloth, name, lambda t: np.array([0.0, 10.0 * t, 0.0]), relative=True)
    return scene, None


def gusts():
    scene, _ = sheet()
    scene.air = tc.Air(1.0, 0.1, lambda t: (0.0, 0.0, 30.0 * np.sign(np.sin(60 * t))))
    return scene, None


def far():
    mesh = tc.grid(1.0, 10)
    scene = tc.Scene()
    cloth = scene.add_cloth(mesh, tc.Fabric(**SOFT), mesh.x + [1e4, 0, 0])
    for name in ("top_left", "top_right"):
        scene.pin(cloth, name)
    return scene, None


def held():
    scene, cloth = sheet(pins=())
    scene.pin(cloth, np.arange(cloth.mesh.vertex_count))
    return scene, None


def damped():
    return sheet(stretch=tc.Stretch(1000.0, 5.0), shear=tc.Shear(100.0, 1.0), bend=tc.Bend(5e-5, 1e-4))[0], None


def airy():
    scene, _ = damped()
    scene.air = tc.Air(2.0, 2.0)
    return scene, None


CASES = {
    "stiff": Case(plain(stretch=tc.Stretch(1e8), shear=tc.Shear(1e7)), t=0.2, rough=("ENERGY",)),
    "masses": Case(heavy),
    "slivers": Case(slivers, t=0.2),
    "collapsed": Case(started(collapsed), free=True, t=0.3),
    "folded": Case(started(folded), free=True, t=0.3),
    "half": Case(started(lambda x: 0.5 * x), free=True, t=0.3),
    "tenth": Case(started(lambda x: 0.1 * x), free=True, t=0.3),
    "inverted": Case(started(lambda x: x * [-1, 1, 1] + [1, 0, 0]), free=True, t=0.3),
    "random": Case(started(scattered), free=True, t=0.3),
    "large step": Case(airy, t=8.0, h=1 / 10, rest=True),
    "fast pins": Case(fast, driven=True),
    "jerked": Case(jerked, driven=True),
    "gusts": Case(gusts, driven=True),
    "far away": Case(far),
    "all held": Case(held),
}


def run(case: Case, integrator: str, precision: str = "f64", **more) -> dict:
    """How a case went: passed, and figures or the reason in words."""
    scene, start = case.make()
    began = time.perf_counter()
    limit = 1e9 if case.free else 0.5  # what starts torn apart may change its stretch at will
    sim = tc.Simulation(scene, h=case.h, integrator=integrator, precision=precision, stretch_limit=limit, **more)
    row = {"steps": 0, "rejections": 0, "seconds": 0.0}
    try:
        if start is not None:
            sim.set_state(start, np.zeros_like(start))
        first, x_0 = sim.energy(), sim.positions()
        scale = 0.2 * G * 1.0 + sum(abs(e) for e in first.values())
        sim.run(case.t, 1 / min(case.t, 0.1))
        row |= {"steps": len(sim.log), "rejections": sum(sum(r.rejections.values()) for r in sim.log),
                "fell_back": sum(bool(r.fallback_reason) for r in sim.log)}
        faults = _faults(case, sim, first, x_0, scale, precision)
        if case.rest and not faults:
            small = tc.Simulation(case.make()[0], h=case.h / 10, precision=precision)
            small.run(case.t, 1 / case.t)
            off = np.sqrt(np.mean(np.sum((small.positions() - sim.positions()) ** 2, axis=1)))
            higher = sum(sim.energy().values()) - sum(small.energy().values())
            if off > 0.01 and abs(higher) > 1e-3 * scale:
                faults.append(f"rests {off:.2g} m from where small steps end, {higher:.2g} J higher")
            small.close()
    except tc.SimulationError as error:
        known = case.refused + (case.rough if precision == "f32" else ())
        faults = [] if error.reason in known else [f"{error.reason} at t = {error.time:.3g} s"]
        row["refused"] = error.reason
    row["seconds"] = round(time.perf_counter() - began, 2)
    sim.close()
    return {"passed": not faults, "faults": faults, **row}


def _faults(case: Case, sim: tc.Simulation, first: dict, x_0: np.ndarray, scale: float, precision: str) -> list[str]:
    x, faults = sim.positions(), []
    if not np.isfinite(x).all():
        return ["not finite"]
    total = [sum(r.energies.values()) for r in sim.log]
    gained = max(total) - sum(first.values())
    if not case.driven and gained > 0.02 * scale:
        faults.append(f"gains {gained:.2g} J")
    largest = max(r.stretch for r in sim.log)
    if case.driven and largest > 5:
        faults.append(f"stretch {largest:.2g}")
    if case.free:
        fallen = -float(sim.model.mass @ (x - x_0)[sim.model.user, 1]) / sim.model.mass.sum()
        slack = G * case.t * case.h / 2 + 0.01 * G * case.t**2  # backward Euler falls ahead by g t h / 2
        if abs(fallen - G * case.t**2 / 2) > slack:
            faults.append(f"falls {fallen:.3g} m and not {G * case.t**2 / 2:.3g}")
    attached = sim.prescribed.held(sim.time)
    if attached is not None:
        here = sim.model.read_particles()[0][attached.index]
        off = np.abs(np.einsum("kij,kj->ki", attached.projector, here - attached.target)).max()
        if off > (1e-12 if precision == "f64" else 1e-6):
            faults.append(f"pins off by {off:.2g} m")
    return faults


def drift(steps: int, integrator: str) -> dict:
    """Many steps of a sheet at rest under its pins: it stays there. Backward Euler brings it there: by others it swings on."""
    scene, _ = damped()
    settling = tc.Simulation(scene, h=1 / 60, integrator="backward_euler")
    settling.run(60.0, 1)
    x = settling.positions()
    settling.close()
    sim = tc.Simulation(scene, h=1 / 60, integrator=integrator)
    sim.set_state(x, np.zeros_like(x))
    for _ in range(steps):
        sim.step()
        del sim.log[:-1]
    moved = float(np.abs(sim.positions() - x).max())
    sim.close()
    return {"passed": moved < 1e-2, "faults": [] if moved < 1e-2 else [f"moved {moved:.2g} m"], "steps": steps, "moved": moved}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", nargs="*", default=list(CASES), choices=list(CASES))
    parser.add_argument("--integrators", nargs="*", default=list(INTEGRATORS), choices=INTEGRATORS)
    parser.add_argument("--precision", nargs="*", default=["f64"], choices=["f64", "f32"])
    parser.add_argument("--drift", type=int, default=0, metavar="N", help="also N steps at rest (1000000 takes hours)")
    parser.add_argument("--json", metavar="FILE")
    args = parser.parse_args()
    rows = []
    print(f"{'case':12} {'precision':9} " + " ".join(f"{name:>26}" for name in args.integrators))
    for precision in args.precision:
        for name in args.cases:
            cells = []
            for integrator in args.integrators:
                row = run(CASES[name], integrator, precision)
                rows.append({"case": name, "integrator": integrator, "precision": precision, **row})
                cells.append(f"ok {row['steps']} steps {row['seconds']:.1f} s" if row["passed"] else row["faults"][0][:26])
            print(f"{name:12} {precision:9} " + " ".join(f"{cell:>26}" for cell in cells), flush=True)
    for integrator in args.integrators if args.drift else ():
        row = drift(args.drift, integrator)
        rows.append({"case": "drift", "integrator": integrator, "precision": "f64", **row})
        print(f"drift        {integrator}: moved {row['moved']:.2e} m in {args.drift} steps")
    if args.json:
        with open(args.json, "w", encoding="utf-8") as file:
            json.dump(rows, file, indent=1)


if __name__ == "__main__":
    main()
