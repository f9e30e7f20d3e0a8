"""Garments on a body that dances: what a frame costs, where the time goes, how small steps get, what crosses.

The data are files of others, in a folder (`--data`, or `data` in the folder that TAICHI_CLOTH_SHARED names): a body's frames
(body_dance.npz), a dress's panels with stitches and as another program draped it (dress_pattern.obj, dress_stitches.csv,
dress_draped.npz), a skirt (skirt.obj). `panels` is the dress from its flat panels: it is put on here, and then dances. A tube
and the shirt of scenes/patterns need the body alone. What is not there is left out.

Contact is chaotic: whole dances say little of small changes. `--again 5 --resume DIR/shirt_*.npz` takes one frame from each of
those checkpoints, five times, from places that differ by .1 um: what comes together of that can be compared.
"""

import argparse
import json
import os
import pathlib
import sys
import tempfile
import time
from collections import Counter
from dataclasses import replace

import numpy as np
import results
from bench_gaps import fabric, tube

import taichi_cloth as tc
from taichi_cloth.scene.intersections import count_crossings, count_self_crossings
from taichi_cloth.scene.mesh import face_edges

FPS = 25.0  # of the dance as it was made
FRICTION = 0.3
PATTERN = "dress_pattern.obj", "dress_stitches.csv"
FILES = {"skirt": ("skirt.obj",), "tube": (), "shirt": (), "dress": (*PATTERN, "dress_draped.npz"), "panels": PATTERN}
SKIRT = (0.0, -0.140, -0.046)  # m by which it is brought down and back, to the waist in the dance's first frame
TUBE = (70, 58)  # cells round and along: 4,130 vertices
HUNG = (0.0, 0.784, 0.0)  # m from the flat panels' origin; their file has z up
FRONT, BACK, ASIDE = (0.0, -0.05, 0.05), (0.0, -0.065, -0.03), {"panel4": 0.115, "panel11": -0.1}  # m by which panels hang
# lower and further out, clear of the body and its hair, and those of the skirt's front aside, beside each other
SLEEVES = {"panel13": 1, "panel6": -1}  # flat above the arms: bent round their axes, of the left one, with a radius [m]
ARM, WIDE = ((0.15, 1.227, -0.067), (0.33, 1.217, -0.06)), 0.05
SHIRT = pathlib.Path(__file__).parents[1] / "scenes" / "patterns" / "shirt.json"  # without its collar, under the hair,
SMALLER, SPACING = 0.91, 0.012  # of its size, for this body; m of its triangles' edges
IN_FRONT, BEHIND = (0.0, -0.03, 0.03), (0.0, -0.03, -0.08)  # m by which front and back hang lower and further out
LONG_SLEEVE = ((0.17, 1.226, -0.08), (0.47, 1.216, -0.02)), 0.06  # axis of the left one [m], radius [m]
BAND = (50.0, 0.5)  # N/m and N a vertex that hold up what has no shoulders
CROSSINGS = "with_body", "with_itself", "body_elsewhere", "itself_elsewhere"
DISTURBED = 1e-7  # m by which --again moves vertices, at random
PARTS = {"C-S": "solids", "C-C": "layers", "CG": "CG", "EVAL": "forces"}


class Absent(Exception):
    """A file of the data is not there."""


def load(folder: pathlib.Path, name: str) -> pathlib.Path:
    """Path of a file of the data.

    Raises:
        Absent: there is none.
    """
    if not (folder / name).is_file():
        raise Absent(f"{folder / name}: not there")
    return folder / name


def filled(faces: np.ndarray) -> np.ndarray:
    """Triangles (m, 3) with fans over their holes, of which no two have a vertex in common."""
    edges = face_edges(faces)
    _, back, count = np.unique(np.sort(edges, axis=1), axis=0, return_inverse=True, return_counts=True)
    onward = {int(j): int(i) for i, j in edges[count[back.ravel()] == 1]}  # a fan runs along the border against its triangles
    fans: list[tuple[int, int, int]] = []
    while onward:
        first, i = onward.popitem()
        while (j := onward.pop(i)) != first:
            fans.append((first, i, j))
            i = j
    return np.concatenate([faces, np.array(fans, dtype=np.int64).reshape(-1, 3)])


def hung(folder: pathlib.Path) -> tc.Garment:
    """The dress's flat panels, where they can be sewn round the body: none within it, none through another."""
    made = tc.load_stitched(*(folder / name for name in PATTERN))
    made = replace(made, positions=made.positions[:, [0, 2, 1]] * [1, 1, -1] + HUNG)
    for name in (f"panel{k}" for k in range(14)):
        if name in SLEEVES:
            made = made.bent(name, np.array(ARM) * [SLEEVES[name], 1, 1], WIDE)
        else:
            in_front = made.positions[made.mesh.groups[name], 2].mean() > 0
            made = made.moved(name, np.array(FRONT if in_front else BACK) + [ASIDE.get(name, 0.0), 0, 0])
    return made


def shirt() -> tc.Garment:
    """Front, back and sleeves of a pattern in GarmentCode's format, made smaller, where they can be sewn round the body."""
    data = json.loads(SHIRT.read_text())
    data["properties"]["units_in_meter"] /= SMALLER
    drawn = data["pattern"]
    del drawn["panels"]["collar"]
    drawn["panel_order"] = list(drawn["panels"])
    drawn["stitches"] = [s for s in drawn["stitches"] if all(end["panel"] != "collar" for end in s[:2])]
    with tempfile.TemporaryDirectory() as folder:
        file = pathlib.Path(folder) / "shirt.json"
        file.write_text(json.dumps(data))
        pattern = tc.load_pattern(file)
    for panel, by in zip(pattern.panels, (IN_FRONT, BEHIND)):
        pattern = pattern.with_panel(replace(panel, translation=panel.translation + by))
    for name, side in (("right sleeve", 1), ("left sleeve", -1)):
        axis, radius = LONG_SLEEVE
        pattern = pattern.wrap(name, np.array(axis) * [side, 1, 1], radius, turn=side * np.pi / 2)
    return pattern.mesh(SPACING)


def scene_of(garment: str, folder: pathlib.Path, fast: float, thickness: float, meets: bool = True,
             dresses: bool = True, led: bool = False) -> tc.Scene:
    """A garment on the body, both with a thickness [m]; the body goes so many times as fast as it was made. Its mouth and eyes
    are filled, so that it has an inside. `meets` as in `tc.dress`; without `dresses` nothing is put on, a checkpoint says
    where it is. What has no shoulders is pulled softly to the body, or, `led`, held to it.
    """
    for name in FILES[garment]:
        load(folder, name)
    scene, body = tc.Scene(), tc.load_solid(load(folder, "body_dance.npz"))
    on = scene.add_solid(tc.SolidMesh(body.x, filled(body.faces), fps=body.fps * fast), FRICTION, thickness, name="body")
    contact, pull = tc.ClothContact(thickness, FRICTION), {} if led else {"stiffness": BAND[0], "most": BAND[1]}
    if garment == "dress":
        draped = np.load(folder / "dress_draped.npz")["positions"]
        made = tc.load_stitched(*(folder / name for name in PATTERN), positions=draped)
        scene.add_garment(made, fabric(), name="dress", contact=contact)
    elif garment in ("panels", "shirt"):
        flat = hung(folder) if garment == "panels" else shirt()
        if dresses:
            made = tc.dress(flat, fabric(), scene, contact, tell=lambda line: print(line, flush=True), meets=meets)
            print(f"{garment}: {made.report()}", flush=True)
            flat = made.garment
        scene.add_garment(flat, fabric(), name=garment, contact=contact)
    elif garment == "tube":
        mesh = tube((0.165, 0.19), 0.55, *TUBE)
        cloth = scene.add_cloth(mesh, fabric(), positions=mesh.x + [0, 1.0, -0.02], contact=contact)
        scene.attach(cloth, "top", on, **pull)
    else:
        mesh = tc.load(folder / "skirt.obj")
        cloth = scene.add_cloth(mesh, fabric(), positions=mesh.x + SKIRT, contact=contact)
        band = np.flatnonzero(mesh.x[:, 1] > mesh.x[:, 1].max() - 0.034)
        scene.attach(cloth, band, on, **pull)
    return scene


def pinched(sim: tc.Simulation) -> np.ndarray:
    """(n,) whether a vertex, or one that it shares a face with, is or was .1 s ago between parts of the body without room."""
    solids = sim.contacts.solids
    return (solids.pinches.around | (solids.penetration.spared > 0))[sim.model.particle]


def crossings(sim: tc.Simulation) -> dict[str, int]:
    """From positions: with the body, with itself; and of both those of faces without a corner that is pinched."""
    x, faces, body = sim.positions(), sim.scene.cloths[0].mesh.faces, sim.scene.solids[0]
    there, triangles = body.surface_at(sim.time), body.shape.surface()[1]
    out = {"with_body": count_crossings(x, faces, there, triangles), "with_itself": count_self_crossings(x, faces)}
    apart = faces[~pinched(sim)[faces].any(axis=1)]
    return out | {"body_elsewhere": count_crossings(x, apart, there, triangles) if out["with_body"] else 0,
                  "itself_elsewhere": count_self_crossings(x, apart) if out["with_itself"] else 0}


def frame_of(sim: tc.Simulation, k: int, counts: bool) -> dict:
    """One frame of the dance, to frame k; whether crossings are counted."""
    first, wall, cpu = len(sim.log), time.perf_counter(), time.process_time()
    problem = ""
    try:
        sim.step(k / FPS - sim.time)
    except tc.SimulationError as error:
        problem = str(error)
    wall, cpu, log = time.perf_counter() - wall, time.process_time() - cpu, sim.log[first:]
    rejected: Counter = Counter()
    for r in log:
        rejected.update(r.rejections)
    row = {"frame": k, "wall": wall, "cpu": cpu, "steps": len(log), "smallest_h": min((r.h for r in log), default=0.0),
           "solves": sum(r.solves for r in log), "iterations": sum(r.iterations for r in log),
           "rejected": dict(rejected), "problem": problem, "pinched": max((r.pinched for r in log), default=0),
           "least_gap": min((r.min_gap_ratio for r in log), default=1.0),
           "stretch": max((r.stretch for r in log), default=0.0),
           "seams": float(sim.seam_gaps().max(initial=0.0)) if sim.scene.seams else 0.0,
           **{name: sum(r.seconds.get(part, 0.0) for r in log) for part, name in PARTS.items()}}
    return row | (crossings(sim) if counts else {})


def costliest(sim: tc.Simulation, first: int, count: int) -> list[str]:
    """The steps that took longest: index in the log, what they cost, and where they were in trouble."""
    lines = []
    for k in sorted(range(first, len(sim.log)), key=lambda k: -sim.log[k].seconds["total"])[:count]:
        r = sim.log[k]
        lines.append(f"sim.log[{k}], to t = {r.t:.4f} s: {r.seconds['total']:.2f} s, h = {1e3 * r.h:.3g} ms, "
                     f"{r.solves} solves, {r.iterations} iterations, {r.rejections or 'none rejected'}")
        seen = Counter(f"{t.name or 'slow'}: {t.detail}; {t}" for t in r.troubles)
        lines += [f"    {text}" + (f" ({times} times)" if times > 1 else "") for text, times in list(seen.items())[:4]]
    return lines


def begin(scene: tc.Scene, args: argparse.Namespace, checkpoint: str | None = None) -> tc.Simulation:
    """The simulation of a scene, from a checkpoint where one is given."""
    sim = tc.Simulation(scene, h=args.h, integrator="backward_euler", cg_tol=args.cg_tol)
    if checkpoint is not None:
        with np.load(checkpoint) as file:
            sim.resume(dict(file))
    return sim


def sample(garment: str, folder: pathlib.Path, args: argparse.Namespace) -> dict:
    """One row: a frame from each checkpoint, `again` times from places that differ a little."""
    scene = scene_of(garment, folder, args.fast, args.thickness, args.meets, dresses=False, led=args.led)
    frames, records = [], []
    for checkpoint in args.resume:
        for k in range(args.again):
            sim = begin(scene, args, checkpoint)
            x, v = sim.model.read_particles()
            off = DISTURBED * np.random.default_rng(k).normal(size=x.shape)
            sim.model.write_particles(x + (off if sim.model.sewn is None else off[sim.model.sewn.representative]), v)
            frames.append(frame_of(sim, round(sim.time * FPS) + 1, False))
            records += sim.log
            if args.verbose:
                print(f"{checkpoint} {k}: {frames[-1]}", flush=True)
            sim.close()
    return summary(garment, records, frames, len(sim.model.particle), 0.0, args.h)


def measure(garment: str, folder: pathlib.Path, args: argparse.Namespace) -> dict:
    """One row: a garment's whole dance."""
    began = time.perf_counter()
    scene = scene_of(garment, folder, args.fast, args.thickness, args.meets, dresses=not args.resume, led=args.led)
    sim = begin(scene, args, args.resume[0] if args.resume else None)
    setup, frames, first = time.perf_counter() - began, [], round(sim.time * FPS) + 1
    for note in sim.notes:
        print(f"{garment}: {note}", flush=True)
    for k in range(first, min(args.frames, int((len(scene.solids[0].shape.x) - 1) / args.fast)) + 1):
        row = frame_of(sim, k, k % args.count == 0)
        frames.append(row)
        if args.verbose:
            print(f"{garment} {k}: " + ", ".join(f"{name} {value:.3g}" if isinstance(value, float) else f"{name} {value}"
                                                 for name, value in row.items() if name != "frame"), flush=True)
        if args.checkpoints and (k % args.every == 0 or row["problem"]):
            np.savez(pathlib.Path(args.checkpoints) / f"{garment}_{k:03d}.npz", **sim.checkpoint())
        if row["problem"]:
            print(f"{garment}: frame {k}: {row['problem']}", flush=True)
            break
    row = summary(garment, sim.log, frames, sim.vertex_count, setup, args.h)
    print("\n".join(costliest(sim, 1, args.costliest)), flush=True)
    sim.close()
    return row


def summary(garment: str, log: list, frames: list[dict], vertices: int, setup: float, h: float) -> dict:
    """What a garment's frames came to. The first of several compiles: it is not among the seconds."""
    later = frames[1:] or frames
    steps, wall = sum(f["steps"] for f in frames), [f["wall"] for f in later]
    total = max(sum(f[name] for f in later for name in PARTS.values()), 1e-300)
    rejected: Counter = Counter()
    for f in frames:
        rejected.update(f["rejected"])
    counted = [f for f in frames if "with_body" in f]
    return {"scene": garment, "vertices": vertices, "frames": len(frames), "setup": setup,
            "wall": float(np.mean(wall)), "slowest": float(np.max(wall)),
            "cpu": float(np.mean([f["cpu"] for f in later])), "steps": steps,
            "mean_h": float(np.mean([r.h for r in log])), "smallest_h": min(f["smallest_h"] for f in frames),
            "below_eighth": sum(r.h < h / 8 * (1 - 1e-9) for r in log),
            "solves": sum(f["solves"] for f in frames) / steps, "iterations": sum(f["iterations"] for f in frames) / steps,
            "rejected": dict(rejected), "stretch": max(f["stretch"] for f in frames), "seams": frames[-1]["seams"],
            "least_gap": min(f["least_gap"] for f in frames), "pinched": max(f["pinched"] for f in frames),
            **{name: sum(f[name] for f in later) / total for name in PARTS.values()},
            "counted": len(counted), **{name: sum(f[name] for f in counted) for name in CROSSINGS},
            "problem": frames[-1]["problem"], "each": frames}


def main() -> int:
    """Prints the table, writes the file."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--data", help="folder of the files")
    parser.add_argument("--garments", nargs="+", choices=sorted(FILES), default=["skirt", "dress"])
    parser.add_argument("--frames", type=int, default=120, help="of 1/25 s each")
    parser.add_argument("--fast", type=float, default=1.0, help="how many times as fast as it was made")
    parser.add_argument("--thickness", type=float, default=0.002, help="m")
    parser.add_argument("--no-meets", action="store_false", dest="meets", help="what is sewn here does not meet itself then")
    parser.add_argument("--led", action="store_true", help="skirt and tube are held to the body, not pulled softly")
    parser.add_argument("--h", type=float, default=1 / 60)
    parser.add_argument("--cg-tol", type=float, default=1e-3)
    parser.add_argument("--count", type=int, default=1, help="crossings are counted every so many frames")
    parser.add_argument("--costliest", type=int, default=5, help="steps to list")
    parser.add_argument("--checkpoints", help="folder to write them to"), parser.add_argument("--every", type=int, default=10)
    parser.add_argument("--resume", nargs="+", help="a checkpoint to go on from; with --again several")
    parser.add_argument("--again", type=int, default=0, help="take the frame after each of them so many times")
    parser.add_argument("--verbose", action="store_true")
    parser.add_argument("--json")
    args = parser.parse_args()
    if args.again and not args.resume:
        parser.error("--again: --resume says from which checkpoints")
    shared = os.environ.get("TAICHI_CLOTH_SHARED")
    folder = pathlib.Path(args.data or (pathlib.Path(shared) / "data" if shared else "data"))
    rows = []
    for garment in args.garments:
        try:
            rows.append((sample if args.again else measure)(garment, folder, args))
        except Absent as absent:
            print(f"{garment}: left out, {absent}", file=sys.stderr)
    head = ("garment", "vertices", "frames", "wall s", "slowest", "CPU s", "steps", "mean h", "smallest", "below h/8",
            "solves", "iterations", "rejected", *PARTS.values(), *(name.replace("_", " ") for name in CROSSINGS), "seams mm")
    print("| " + " | ".join(head) + " |\n" + "|---" * len(head) + "|")
    for r in rows:
        print(f"| {r['scene']} | {r['vertices']} | {r['frames']} | {r['wall']:.2f} | {r['slowest']:.2f} | {r['cpu']:.2f} | "
              f"{r['steps']} | {1e3 * r['mean_h']:.2f} | {1e3 * r['smallest_h']:.2f} | {r['below_eighth']} | "
              f"{r['solves']:.2f} | {r['iterations']:.0f} | {sum(r['rejected'].values())} | "
              + " | ".join(f"{r[name]:.0%}" for name in PARTS.values())
              + "".join(f" | {r[name]}" for name in CROSSINGS) + f" | {1e3 * r['seams']:.3f} |")
    results.write(args.json, rows, h=args.h, fast=args.fast, thickness=args.thickness)
    return 0 if rows else 1


if __name__ == "__main__":
    sys.exit(main())
