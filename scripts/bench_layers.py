"""What cloth against cloth costs: with and without it, its share of a step, and how detection grows with the cloth.

    python scripts/bench_layers.py --scenes fold twist --cells 25 50 100 150 --json layers.json
"""

import argparse
import time

import numpy as np
import results

import taichi_cloth as tc
from taichi_cloth.app import scenefile

FABRIC = tc.Fabric(0.2, tc.Stretch(1000), tc.Shear(100), tc.Bend(5e-5))


def of_scene(name: str, settings: dict, until: float | None) -> dict:
    """One row: a scene run as its file says, or to `until` [s]."""
    scene = scenefile.read(name)
    plan = dict(scene.run)
    duration, fps = plan.pop("duration"), plan.pop("fps")
    sim = tc.Simulation(scene.make(settings), **plan)
    sim.run(until or duration, fps)
    steps = sim.log[1:]  # the first compiles
    total = sum(r.seconds["total"] for r in steps)
    row = {"scene": name, "settings": settings, "vertices": sim.vertex_count, "steps": len(sim.log),
           "solves_a_step": float(np.mean([r.solves for r in steps])),
           "seconds_per_second": total / (sim.time - sim.log[0].h), "intersections": sim.intersections(),
           "cloth_cloth_share": sum(r.seconds.get("C-C", 0.0) for r in steps) / total,
           "least_gap": min(r.min_gap_ratio for r in sim.log), "pairs": max(r.layers for r in sim.log)}
    sim.close()
    return row


def detection(cells: int, rounds: int) -> dict:
    """One row: finding what three layers, a thickness apart, have in reach of each other as they move by a thickness."""
    mesh, scene = tc.grid(1.0, cells), tc.Scene()
    thickness = 0.3 / cells
    for k in range(3):
        scene.add_cloth(mesh, FABRIC, positions=mesh.x + [0, 0.9 * thickness * k, 0], contact=tc.ClothContact(thickness))
    sim = tc.Simulation(scene, integrator="backward_euler")
    layers, times = sim.contacts.layers.detector, []
    sim.model.save()
    x, v = sim.model.read_particles()
    sim.model.write_particles(x + thickness * np.random.default_rng(0).uniform(-0.2, 0.2, size=x.shape), v)
    for _ in range(rounds + 1):
        layers.fresh = False
        start = time.perf_counter()
        layers.paths.begin()
        layers.cover()
        layers.collision_free_step()
        layers.look()
        times.append(time.perf_counter() - start)
    kept = *layers.known.arrays, *layers.found.arrays, *layers.reached.arrays
    row = {"vertices": sim.vertex_count, "candidates": len(layers.candidates), "detect_ms": 1e3 * float(np.median(times[1:])),
           "candidate_mb": sum(a.nbytes for a in kept) / 1e6}
    sim.close()
    return row


def main() -> None:
    """Prints the tables, writes the file."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--scenes", nargs="*", default=["layers", "fold", "twist", "tablecloth_pull"])
    parser.add_argument("--until", type=float, help="s; the scenes' own durations where left out")
    parser.add_argument("--cells", type=int, nargs="*", default=[25, 50, 100])
    parser.add_argument("--drape", type=int, default=50, help="cells of the sheet on the ball that has self-contact or not")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--json")
    args = parser.parse_args()
    for itself in (False, True):  # compiles
        of_scene("sphere_drape", {"cells": args.drape, "itself": itself}, 0.05)
    pairs = [[of_scene("sphere_drape", {"cells": args.drape, "itself": itself}, args.until or 1.5) for itself in (False, True)]
             for _ in range(args.rounds)]
    ratios = [own["seconds_per_second"] / plain["seconds_per_second"] for plain, own in pairs]
    plain, own = pairs[int(np.argsort(ratios)[len(ratios) // 2])]  # the middle one of the rounds
    side = args.drape + 1
    print(f"sphere_drape {side}x{side}: {plain['seconds_per_second']:.2f} wall s a simulated second, with self-contact "
          f"{own['seconds_per_second']:.2f}: {np.median(ratios):.2f} times ({min(ratios):.2f} to {max(ratios):.2f} in "
          f"{len(ratios)} rounds)")
    rows = [of_scene(name, {}, args.until) for name in args.scenes]
    for r in rows:
        print(f"{r['scene']:16} {r['vertices']:6} vertices  {r['solves_a_step']:.2f} solves a step  "
              f"{r['seconds_per_second']:6.2f} wall s / s  cloth-cloth {r['cloth_cloth_share']:.0%}  "
              f"least gap {r['least_gap']:.2f}  {r['intersections']} crossings")
    growth = [detection(cells, args.rounds) for cells in args.cells]
    for r in growth:
        print(f"detection        {r['vertices']:6} vertices  {r['candidates']:8} candidates  {r['detect_ms']:8.1f} ms  "
              f"{r['candidate_mb']:.0f} MB")
    n, t = np.log([r["vertices"] for r in growth]), np.log([r["detect_ms"] for r in growth])
    exponent = float(np.polyfit(n, t, 1)[0]) if len(growth) > 1 else None
    print(f"growth of detection: vertices to the power of {exponent:.2f}" if exponent else "")
    results.write(args.json, [plain, own, *rows], sphere_drape_ratios=ratios, detection=growth, exponent=exponent)


if __name__ == "__main__":
    main()
