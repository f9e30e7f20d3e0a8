"""Cloth in contact, ours next to programs that pip installs: the tables of `bench_peers.py --contact`.

Every program gets the same vertices, mass, ball, thickness, friction and time, no damping, and a fabric as near to ours as
its model has; how is said in scripts/baselines/contact.py. Solvers keep their own defaults. Each peer runs in a process
of its own, one after the other, and each first compiles: ours, whose kernels know their size, by the first half second of
the task, peers by that of a small sheet. What is counted at the end is counted by us, from positions: crossings, the
largest stretch of a mesh edge, the gap of the nearest vertex to the solid's surface, and on a slope the speed that it
gains in the second half over what Coulomb's law gives, g (sin a - mu cos a).
"""

import json
import pathlib
import subprocess
import sys
import tempfile
import time

import numpy as np
from baselines import contact

import taichi_cloth as tc
from taichi_cloth.scene.intersections import count_self_crossings

RADIUS, THICKNESS, FRICTION = 0.3, 0.005, 0.4
FABRIC = {"density": 0.2, "stretch": 1000.0, "shear": 100.0, "bend": 5e-5}
SCENES = {"drape": 1, "layers": 3, "slide": 1, "slip": 1}  # sheets, on a ball or a slope
SLOPE, SLIDES = np.radians(20), {"slide": 0.2, "slip": 0.0}  # rad, friction there
SMALL, FIRST = 9, 0.5  # vertices a side, and seconds, of what peers run first


def plan(scene: str, n: int, until: float) -> dict:
    """Sheets of 1 m x 1 m over a ball: in `layers` each is turned a little against the last and 3 cm above it; in `slide` and
    `slip` one that lies on a slope."""
    mesh, sheets = tc.grid(1.0, n - 1), []
    more: dict = {"slope": 0.0, "friction": FRICTION}
    if scene in SLIDES:
        more = {"slope": SLOPE, "friction": SLIDES[scene]}
        sheets.append((mesh.x + [-0.5, THICKNESS, 0.5]) @ contact.turn(SLOPE).T)
    for k in range(len(sheets), SCENES[scene]):
        c, s = np.cos(0.35 * k), np.sin(0.35 * k)
        turn = np.array([[c, 0, -s], [0, 1, 0], [s, 0, c]])
        sheets.append((mesh.x + [-0.5, 0, 0.5]) @ turn + [0, RADIUS + THICKNESS + 0.05 + 0.03 * k, 0])
    return {"x": np.concatenate(sheets), "uv": mesh.uv, "faces": mesh.faces, "sheets": len(sheets), "n": n, "radius": RADIUS,
            "thickness": THICKNESS, "until": until, **more, **FABRIC}


def ours(s: dict) -> contact.Run:
    """Ours with default settings and self-contact."""
    scene, mesh, count = tc.Scene(), tc.grid(1.0, s["n"] - 1), s["n"] ** 2
    fabric = tc.Fabric(s["density"], tc.Stretch(s["stretch"]), tc.Shear(s["shear"]), tc.Bend(s["bend"]))
    for k in range(s["sheets"]):
        scene.add_cloth(mesh, fabric, positions=s["x"][count * k: count * k + count],
                        contact=tc.ClothContact(s["thickness"], s["friction"]))
    solid = tc.Plane(contact.turn(s["slope"])[:, 1]) if s["slope"] else tc.Sphere(s["radius"])
    scene.add_solid(solid, friction=s["friction"], thickness=s["thickness"], name="solid")
    sim = tc.Simulation(scene)
    return (lambda: sim.run(1 / contact.FPS, contact.FPS), contact.FPS, sim.positions,
            f"taichi_cloth {tc.__version__}, defaults")


def peer(name: str, python: str, first: dict, task: dict) -> dict:
    """What a peer gives.

    Raises:
        ImportError: it is not installed.
        RuntimeError: it failed.
    """
    with tempfile.TemporaryDirectory() as folder:
        source, target = pathlib.Path(folder) / "task.npz", pathlib.Path(folder) / "result.npz"
        arrays = {}
        for key, s in (("first", first), ("task", task)):
            arrays |= {f"{key}_{part}": s[part] for part in ("x", "uv", "faces")}
            arrays[f"{key}_plan"] = json.dumps({k: v for k, v in s.items() if not isinstance(v, np.ndarray)})
        np.savez(source, **arrays)
        done = subprocess.run([python, contact.__file__, name, source, target], capture_output=True, text=True)
        last = (done.stderr.strip().splitlines() or ["no message"])[-1]
        if done.returncode == contact.ABSENT:
            raise ImportError(last)
        if done.returncode:
            raise RuntimeError(f"exit code {done.returncode}, {last}")
        with np.load(target) as file:
            return {k: file[k] if k in ("x", "went") else file[k].item() for k in file.files}


def row(scene: str, system: str, s: dict, made: dict) -> dict:
    """A row of the table: wall and CPU in seconds a simulated second, stretch in %, gap and height in metres, what it
    gains of speed in % of what Coulomb's law gives, None on the ball."""
    x, count = made["x"], s["n"] ** 2
    faces = np.concatenate([s["faces"] + count * k for k in range(s["sheets"])])
    edges = np.unique(np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1), axis=0)
    now, rest = (np.linalg.norm(p[edges[:, 0]] - p[edges[:, 1]], axis=1) for p in (x, s["x"]))
    finite, speed = bool(np.isfinite(x).all()), None
    out = np.linalg.norm(x, axis=1) - s["radius"]
    if s["slope"]:
        along, up, _ = contact.turn(s["slope"]).T
        out = x @ up
        gains = contact.GRAVITY * (np.sin(s["slope"]) - s["friction"] * np.cos(s["slope"]))
        took = (made["frames"] - made["frames"] // 2) * made["frame"]
        speed = 100 * float((made["went"][1] - made["went"][0]).mean(axis=0) @ along / made["frame"] / (gains * took))
    return {"scene": scene, "n": s["n"], "system": system, "about": made["about"], "setup": made["setup"],
            "wall": made["wall"] / s["until"], "cpu": made["cpu"] / s["until"],
            "crossings": count_self_crossings(x, faces) if finite else None, "stretch": 100 * float((now / rest).max() - 1),
            "gap": float(out.min()), "height": float(np.ptp(x[:, 1])), "speed": speed}


def table(scenes: list[str], sizes: list[int], until: float, names: list[str], pythons: dict[str, str]) -> list[dict]:
    """Rows, printed as they come; a peer that is not there is named, with why, and has none."""
    rows, absent = [], set()
    print(f"{'scene':8} {'sheet':>6} {'system':<16} {'set-up s':>8} {'wall s/s':>8} {'CPU s/s':>8} {'crossings':>9} "
          f"{'stretch %':>9} {'gap mm':>7} {'height m':>8} {'speed %':>7}  what")
    for scene in scenes:
        for n in sizes:
            task = plan(scene, n, until)
            first, small = plan(scene, n, min(until, FIRST)), plan(scene, SMALL, min(until, FIRST))
            for name in ["ours", *names]:
                start = time.perf_counter()
                try:
                    made = contact.timed(ours, first, task) if name == "ours" else peer(name, pythons[name], small, task)
                except (ImportError, RuntimeError) as reason:
                    if isinstance(reason, RuntimeError) or name not in absent:
                        kind = "left out" if isinstance(reason, ImportError) else f"failed on {scene}, {n}x{n}"
                        print(f"{name}: {kind}, {reason}", file=sys.stderr)
                    absent |= {name} if isinstance(reason, ImportError) else set()
                    continue
                rows.append({**row(scene, name, task, made), "in_all": time.perf_counter() - start})
                r = rows[-1]
                print(f"{scene:8} {n:4}^2 {name:<16} {r['setup']:8.1f} {r['wall']:8.2f} {r['cpu']:8.2f} "
                      f"{r['crossings']!s:>9} {r['stretch']:9.1f} {1e3 * r['gap']:7.2f} {r['height']:8.3f} "
                      f"{'' if r['speed'] is None else format(r['speed'], '.1f'):>7}  {r['about']}",
                      flush=True)
    return rows
