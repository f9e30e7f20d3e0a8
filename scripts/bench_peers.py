"""Work and error on `swing`, next to baselines that pip installs, in one run: compiled explicit Numba, and pyPBD (XPBD).

Errors are RMS over the vertices at the end of half a second (`--until 0.3` for stiff fine sheets, which part from themselves),
each system against its own limit: they do not have the same material. Ours is Verlet at a fifth of its stable step; what
half of that changes is printed.

Rounds are interleaved, medians of them and of their ratios reported. Baselines that are not installed are left out, with a
line that says so: `pip install numba pypbd`.

    python scripts/bench_peers.py --sizes 26 51 --json peers.json --plots docs

`--contact` is another table: sheets on a ball with self-contact, next to Blender, pyPBD and Newton where they are installed
(peers_contact.py). Blender may be in another Python than the rest.

    python scripts/bench_peers.py --contact --sizes 51 --scenes drape --blender-python BLENDER_ENV/bin/python
"""

import argparse
import pathlib
import re
import shutil
import sys
import time
from collections.abc import Callable

import numpy as np
import peers_contact
import results
from baselines.contact import SYSTEMS

import taichi_cloth as tc
from taichi_cloth.output.plot import as_file, line_plot
from taichi_cloth.step.integrators.verlet import SLOW, SLOW_SAFETY
from taichi_cloth.studies.study import substep_of
from taichi_cloth.system.elements import lumped_mass, row_sums

LOOP = "Numba, explicit, one thread"
DENSITY, D = 0.2, 5e-5
METHODS = {"verlet": {"integrator": "verlet", "h": None},
           **{f"verlet, substep x{k}": {"integrator": "verlet", "h": None, "times": k} for k in (0.5, 3, 6, 9)},
           "safe, h = 1/60": {"h": 1 / 60}, "safe, h = 1/240": {"h": 1 / 240},
           "safe, tolerance 1e-2": {"tolerance": 1e-2}, "safe, tolerance 1e-3": {"tolerance": 1e-3},
           "tr_bdf2, h = 1/60": {"integrator": "tr_bdf2"}, "newton_euler, h = 1/60": {"integrator": "newton_euler"},
           "backward_euler, h = 1/60": {"integrator": "backward_euler"}}


def ours(n: int, stretch: float, until: float, **options: object) -> Callable[[], np.ndarray]:
    """A function that runs from rest and gives positions; explicit at a `part` of its stable step, bending in
    every substep, where that is asked for."""
    scene, part = tc.Scene(), options.pop("part", None)
    cloth = scene.add_cloth(tc.grid(1.0, n - 1), tc.Fabric(DENSITY, tc.Stretch(stretch), tc.Shear(stretch / 10), tc.Bend(D)))
    scene.pin(cloth, "top_left")
    scene.pin(cloth, "top_right")
    if "times" in options:
        options["substep"] = substep_of(scene, options.pop("times"))  # type: ignore[arg-type]
    sim = tc.Simulation(scene, **{"h": 1 / 60, **options})  # type: ignore[arg-type]
    if part is not None:
        sim.integrator.part, sim.integrator.every = part, 1
    begin = sim.checkpoint()

    def go() -> np.ndarray:
        sim.resume(begin)
        sim.log.clear()
        sim.run(until, 10)
        return sim.positions()

    return go


def numba(n: int, stretch: float, until: float, part: float, most: int) -> Callable[[], np.ndarray]:
    """The compiled explicit loop at a part of its stable step, bending as rarely as its model, stiffer than ours, bears, and
    at least once in so many substeps."""
    from baselines import explicit

    mesh = tc.grid(1.0, n - 1)
    pins = np.concatenate([mesh.select("top_left"), mesh.select("top_right")])
    go = explicit.sheet(mesh, DENSITY, stretch, stretch / 10, D, pins)
    scene = tc.Scene()
    scene.add_cloth(mesh, tc.Fabric(DENSITY, tc.Stretch(stretch), tc.Shear(stretch / 10), tc.Bend(D)))
    sim = tc.Simulation(scene, integrator="verlet")
    step = sim.integrator.stable_step
    sim.close()
    hinge, weight, stiff = explicit.bending(mesh)
    sizes = D * stiff[:, None, None] * np.abs(np.einsum("ei,ej->eij", weight, weight))
    slow = 2 / np.sqrt(row_sums(hinge, sizes, lumped_mass(mesh, DENSITY)).max())
    every = int(np.clip(SLOW_SAFETY * slow / step, 1, most))
    return lambda: go(until, part * step, every)


def pypbd(n: int, stretch: float, until: float, substeps: int) -> Callable[[], np.ndarray]:
    """XPBD with distance and dihedral constraints, one iteration a substep, 1/60 s a step."""
    import pypbd as pbd

    def go() -> np.ndarray:
        simulation = pbd.Simulation.getCurrent()
        simulation.initDefault()
        model = simulation.getModel()
        model.cleanup()
        turned = np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]], dtype=float)
        triangles = model.addRegularTriangleModel(n, n, rotation=turned, scale=np.ones(2))
        particles = model.getParticles()
        x = np.array([particles.getPosition(i) for i in range(n * n)])
        for i in range(n * n):
            particles.setMass(i, DENSITY / (n - 1) ** 2)
        for corner in np.argsort(x @ [0, 0, 1.0] + 1e-6 * np.abs(x[:, 0] - x[:, 0].mean()) * -1)[:2]:
            particles.setMass(int(corner), 0.0)
        model.addClothConstraints(triangles, 4, stretch, stretch, stretch / 10, stretch / 10, 0.3, 0.3, False, False)
        model.addBendingConstraints(triangles, 3, D)
        stepper = simulation.getTimeStep()
        stepper.setValueUInt(pbd.TimeStepController.NUM_SUB_STEPS, substeps)
        stepper.setValueUInt(pbd.TimeStepController.MAX_ITERATIONS, 1)
        pbd.TimeManager.getCurrent().setTimeStepSize(1 / 60)
        for _ in range(round(60 * until)):
            stepper.step(model)
        return np.array([particles.getPosition(i) for i in range(n * n)])

    return go


def rms(x: np.ndarray) -> float:
    """Of the lengths of (n, 3)."""
    return float(np.sqrt(np.mean(np.sum(x**2, axis=1))))


def measure(n: int, stretch: float, until: float, rounds: int) -> list[dict]:
    """Rows of one sheet."""
    runs: dict[str, tuple[Callable[[], np.ndarray], Callable[[], np.ndarray]]] = {}  # what is timed, and its limit
    fine, finer = (ours(n, stretch, until, integrator="verlet", h=None, part=part) for part in (0.2, 0.1))
    for name, options in METHODS.items():
        runs[name] = ours(n, stretch, until, **options), fine
    sheet = n, stretch, until
    for name, make, *settings in ((LOOP, numba, (0.9, 1), (0.2, 1)),
                                  ("Numba, with our impulses", numba, (0.9, SLOW), (0.2, SLOW)),
                                  ("pyPBD, 20 x 1", pypbd, (20,), (400,)), ("pyPBD, 100 x 1", pypbd, (100,), (400,))):
        try:
            runs[name] = make(*sheet, *settings[0]), make(*sheet, *settings[1])
        except ImportError as missing:
            print(f"{name}: left out, {missing}", file=sys.stderr)
    limits: dict[int, np.ndarray] = {}
    errors, times = {}, {name: [] for name in runs}
    for name, (go, limit) in runs.items():  # the first run compiles
        key = id(limit) if name in METHODS else hash(name.split()[0])
        if key not in limits:
            limits[key] = limit()
        errors[name] = rms(go() - limits[key])
    doubt = rms(finer() - limits[id(fine)])
    for _ in range(rounds):
        for name, (go, _) in runs.items():
            start = time.perf_counter()
            go()
            times[name].append((time.perf_counter() - start) / until)
    base = np.array(times.get(LOOP, [np.nan] * rounds))
    return [{"n": n, "stretch": stretch, "method": name, "until": until, "wall": float(np.median(t)), "error": errors[name],
             "doubt": doubt, "to_numba": float(np.median(np.array(t) / base))} for name, t in times.items()]


def draw(rows: list[dict]) -> str:
    """An SVG of error over wall time, a line for each family of methods of one sheet; what failed, or another of its family
    beats, is left out."""
    families: dict[str, list[tuple[float, float]]] = {}
    for row in rows:
        if np.isfinite(row["error"]):
            name = re.split(r" = |, substep|, explicit|, \d| \de", row["method"])[0]
            families.setdefault(name, []).append((row["wall"], row["error"]))
    series = {}
    for name, points in families.items():
        best = [p for p in sorted(points) if p[1] <= min(q[1] for q in points if q[0] <= p[0])]
        series[name] = tuple(np.array(best).T)
    n, stretch, until = (rows[0][k] for k in ("n", "stretch", "until"))
    label = f"{n}x{n}, stretch {stretch:g} N/m: wall s per s; up: RMS error at {until:g} s [m]"
    return as_file(line_plot(series, label, log=True, log_x=True, marks=True))  # type: ignore[arg-type]


def main() -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--sizes", type=int, nargs="+", help="vertices a side (26 51; 51 with --contact)")
    parser.add_argument("--stretch", type=float, nargs="+", default=[1000.0], help="N/m; shear is a tenth of it")
    parser.add_argument("--until", type=float, help="simulated time [s] (0.5; 1.5 with --contact)")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--json", help="file to write")
    parser.add_argument("--plots", metavar="DIR", help="folder for an SVG of each sheet")
    parser.add_argument("--contact", action="store_true", help="sheets on a ball with self-contact instead")
    parser.add_argument("--scenes", nargs="+", choices=list(peers_contact.SCENES), default=["drape"], help="of --contact")
    parser.add_argument("--peers", nargs="*", choices=list(SYSTEMS), default=list(SYSTEMS), help="of --contact")
    parser.add_argument("--peer-python", default=sys.executable, help="Python with pyPBD and Newton, of --contact")
    parser.add_argument("--blender-python", help="Python with bpy, of --contact; that of --peer-python where left out")
    args = parser.parse_args()
    if args.contact:
        pythons = {**dict.fromkeys(SYSTEMS, args.peer_python), "Blender": args.blender_python or args.peer_python}
        for python in pythons.values():
            if not shutil.which(python):
                parser.error(f"no Python at {python}: give the path of one to --peer-python, or to --blender-python")
        results.write(args.json, peers_contact.table(args.scenes, args.sizes or [51], args.until or 1.5, args.peers, pythons))
        return
    args.sizes, args.until = args.sizes or [26, 51], args.until or 0.5
    rows = []
    print(f"{'sheet':>8} {'stretch':>8} {'method':<30} {'wall s / s':>10} {'RMS error m':>12} {'over Numba':>10}")
    for stretch in args.stretch:
        for n in args.sizes:
            made = measure(n, stretch, args.until, args.rounds)
            for r in made:
                rows.append(r)
                print(f"{n:5}^2 {stretch:8g} {r['method']:<30} {r['wall']:10.3f} {r['error']:12.1e} {r['to_numba']:10.2f}",
                      flush=True)
            if args.plots:
                (pathlib.Path(args.plots) / f"peers_{n}_{stretch:g}.svg").write_text(draw(made))
            print(f"{n:5}^2 {stretch:8g} our limit is good to {made[0]['doubt']:.1e} m at {args.until:g} s")
    results.write(args.json, rows)


if __name__ == "__main__":
    main()
