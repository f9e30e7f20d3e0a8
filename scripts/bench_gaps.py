"""What near pairs cost: steps, solves and rejections by the smallest gap of any pair, in scenes where one pair may hold
the rest back.

    python scripts/bench_gaps.py kick --until 1
    python scripts/bench_gaps.py dance --data body_dance.npz --speed 3 --until 1
"""

import argparse
import json
import math
import time
from collections import Counter

import numpy as np

import taichi_cloth as tc
from taichi_cloth.scene.intersections import count_crossings

CLASSES = (0.5, 0.3, 0.25, 0.22, 0.2, 0.0)
THICKNESS = 0.003


def tube(radii: tuple[float, float], length: float, around: int, along: int) -> tc.TriMesh:
    """A tube of cloth along -y from 0 on, at rest as it is; groups "top" and "hem"."""
    a = 2 * np.pi * np.arange(around) / around
    s = np.linspace(0, 1, along + 1)[:, None]
    r = radii[0] + s * (radii[1] - radii[0])
    x = np.stack([r * np.cos(a), np.broadcast_to(-length * s, (along + 1, around)), r * np.sin(a)], axis=2).reshape(-1, 3)
    i, j = np.meshgrid(np.arange(along), np.arange(around), indexing="ij")
    p, q = i * around + j, i * around + (j + 1) % around
    even = ((i + j) % 2 == 0)[..., None]
    first = np.where(even, np.stack([p, q, p + around], axis=-1), np.stack([p, q, q + around], axis=-1))
    second = np.where(even, np.stack([q, q + around, p + around], axis=-1), np.stack([p, q + around, p + around], axis=-1))
    faces = np.concatenate([first.reshape(-1, 3), second.reshape(-1, 3)])
    count = around * (along + 1)
    return tc.TriMesh(x, faces, groups={"top": np.arange(around), "hem": np.arange(count - around, count)})


def fabric() -> tc.Fabric:
    """Of dresses."""
    return tc.Fabric(0.2, tc.Stretch(1000, 0.5), tc.Shear(100, 0.05), tc.Bend(5e-5))


def kick(cells: int, speed: float) -> tc.Scene:
    """A wide skirt round two legs that kick to and fro, one against the other."""
    scene = tc.Scene()
    for side, name in ((1.0, "left leg"), (-1.0, "right leg")):
        def swing(t: float, side: float = side) -> tuple[float, float, float]:
            return side * 1.1 * math.sin(2 * math.pi * speed * t), 0.0, 0.0

        scene.add_solid(tc.Capsule((0, 0, 0), (0, -0.8, 0), 0.06), 0.3, THICKNESS, (0.085 * side, 0, 0), swing, name)
    mesh = tube((0.17, 0.24), 0.5, 2 * cells, cells)
    cloth = scene.add_cloth(mesh, fabric(), contact=tc.ClothContact(THICKNESS, 0.3))
    scene.pin(cloth, "top")
    return scene


def dance(data: str, cells: int, speed: float) -> tc.Scene:
    """A tube dress on a body that moves so many times as fast as it was filmed."""
    scene, body = tc.Scene(), tc.load_solid(data)
    body = tc.SolidMesh(body.x, body.faces, fps=body.fps * speed)
    on = scene.add_solid(body, 0.3, THICKNESS, name="body")
    mesh = tube((0.165, 0.19), 0.55, 2 * cells, cells)
    cloth = scene.add_cloth(mesh, fabric(), positions=mesh.x + [0, 1.0, -0.02], contact=tc.ClothContact(THICKNESS, 0.3))
    scene.attach(cloth, "top", on)
    return scene


def table(log: list) -> list[dict]:
    """Rows by smallest gap."""
    rows = []
    for low, high in zip(CLASSES, (np.inf, *CLASSES)):
        steps = [r for r in log if low <= r.min_gap_ratio < high]
        if steps:
            rows.append({"gap from": low, "steps": len(steps), "mean h, ms": 1e3 * float(np.mean([r.h for r in steps])),
                         "solves": float(np.mean([r.solves for r in steps])),
                         "rejected": sum(sum(r.rejections.values()) for r in steps),
                         "wall s": sum(r.seconds["total"] for r in steps)})
    return rows


def main() -> None:
    """Runs a scene, prints its table."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("scene", choices=("kick", "dance"))
    parser.add_argument("--data", help="file of the body")
    parser.add_argument("--cells", type=int, default=20)
    parser.add_argument("--speed", type=float, default=2.0, help="kicks a second, or how many times as fast as filmed")
    parser.add_argument("--h", type=float, default=0.01)
    parser.add_argument("--until", type=float, default=1.0)
    parser.add_argument("--cg-tol", type=float)
    parser.add_argument("--verbose", action="store_true")
    parser.add_argument("--limit", type=float, default=1e9, help="wall s after which it ends")
    parser.add_argument("--json")
    args = parser.parse_args()
    scene = kick(args.cells, args.speed) if args.scene == "kick" else dance(args.data, args.cells, args.speed)
    sim = tc.Simulation(scene, h=args.h, integrator="backward_euler", cg_tol=args.cg_tol)
    began, frames, crossed, tangled = time.perf_counter(), [], 0, 0
    faces = scene.cloths[0].mesh.faces
    for frame in range(1, round(25 * args.until) + 1):
        from_here = time.perf_counter()
        k = len(sim.log)
        while sim.time < frame / 25 - 1e-9:
            sim.step(min(args.h, frame / 25 - sim.time))
        frames.append(time.perf_counter() - from_here)
        x = sim.positions()
        with_body = sum(count_crossings(x, faces, s.surface_at(sim.time), s.shape.surface()[1]) for s in scene.solids)
        with_itself = sim.intersections()
        crossed, tangled = crossed + with_body, tangled + with_itself
        if args.verbose:
            new = sim.log[k:]
            why = Counter(f"{t.name}: {t.detail[:130]}" for r in new for t in r.troubles if t.name)
            rejected = sum(sum(r.rejections.values()) for r in new)
            print(f"{sim.time:.3f} s: {len(new)} steps, {sum(r.solves for r in new)} solves, rejected {rejected}, least "
                  f"{min(r.min_gap_ratio for r in new):.3f}, crossed {with_body}, itself {with_itself}, {frames[-1]:.2f} s")
            for text, count in why.most_common(4):
                print(f"      {count} x {text}")
        if time.perf_counter() - began > args.limit:
            break
    print("| smallest gap | steps | mean h, ms | solves | rejected | wall s |\n|---|---|---|---|---|---|")
    for row in table(sim.log):
        print(f"| from {row['gap from']:.2f} | {row['steps']} | {row['mean h, ms']:.2f} | {row['solves']:.2f} | "
              f"{row['rejected']} | {row['wall s']:.1f} |")
    h = sim.time / len(sim.log)
    out = {"steps": len(sim.log), "solves": sum(r.solves for r in sim.log), "mean h, ms": 1e3 * h,
           "rejected": sum(sum(r.rejections.values()) for r in sim.log), "slowest frame, s": max(frames),
           "crossings with solids": crossed, "with itself": tangled, "wall s": sum(frames)}
    print(out)
    if args.json:
        with open(args.json, "w", encoding="utf8") as file:
            json.dump(out | {"rows": table(sim.log)}, file, indent=1)


if __name__ == "__main__":
    main()
