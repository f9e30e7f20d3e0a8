"""Pictures of the theory pages and tutorials, in docs/images/.

    python scripts/make_figures.py [strain_limits bend_friction shirt_fold balloon crumple tent dressed] [--to docs/images]
"""

import argparse
import pathlib
from collections.abc import Callable
from dataclasses import replace

import numpy as np

import taichi_cloth as tc
from taichi_cloth.app import scenefile
from taichi_cloth.output.look import Look
from taichi_cloth.output.picture import Artist
from taichi_cloth.output.png import encode_png
from taichi_cloth.recording import record
from taichi_cloth.recording.playback import heat_of

PATTERNS = pathlib.Path(__file__).parents[1] / "scenes" / "patterns"
SIZE = (480, 320)
FIGURE = (225, 330)


def drawn(sim: tc.Simulation, heat: str | None = None, limits: tuple[float, float] | None = None,
          size: tuple[int, int] = SIZE) -> np.ndarray:
    """What the scene's camera sees now."""
    geometry = record.geometry(sim)
    shown = None if heat is None else heat_of(heat, geometry, limits)
    return Artist(geometry, size, Look(quality="high", heat=shown)).draw(record.frame(sim))


def of_scene(name: str, heat: str | None = None, limits: tuple[float, float] | None = None, part: float = 1.0) -> np.ndarray:
    """The end of a scene, or of a part of its duration."""
    scene = scenefile.read(name)
    plan = dict(scene.run)
    duration, fps = plan.pop("duration"), plan.pop("fps")
    with tc.Simulation(scene.make({}), **plan) as sim:
        sim.run(part * duration, fps)
        return drawn(sim, heat, limits)


def strain_limits() -> np.ndarray:
    """The same weight on a knit, a soft weave and one with a limit, by stretch."""
    return of_scene("knit_stretch", "stretch", (0.6, 1.4))


def bend_friction() -> np.ndarray:
    """Three strips that were let go level, with 0, .8 and 2.5 mN of friction in bending, at rest."""
    scene = tc.Scene(air=tc.Air(0.3, 0.1), view=tc.View(
        tc.Camera((0.14, 0.05, 0.36), (0.055, -0.026, -0.08), 24.0), ground=-0.09))
    mesh = tc.grid((0.11, 0.03), (33, 3))
    for k, (friction, color) in enumerate(((0.0, "steelblue"), (8e-4, "seagreen"), (2.5e-3, "firebrick"))):
        fabric = tc.Fabric(0.15, tc.Stretch(500, 0.5), tc.Shear(50, 0.05), tc.Bend(5e-5, 2e-7, friction=friction))
        cloth = scene.add_cloth(mesh, fabric, mesh.x - [0, 0, 0.05 * k], name=f"friction {friction:g}",
                                color=tc.Appearance(color, squares=False))
        scene.pin(cloth, np.flatnonzero(mesh.uv[:, 0] < 0.021))
    with tc.Simulation(scene, h=1 / 60, integrator="backward_euler") as sim:
        sim.run(4.0, 10)
        return drawn(sim)


def dressed() -> np.ndarray:
    """The patterns that come with `dress_up`, worn, from in front and from behind."""
    scene, columns = scenefile.read("dress_up"), []
    for name in ("skirt", "dress", "shirt", "trousers"):
        description = scene.make({"pattern": str(PATTERNS / f"{name}.json"), "spacing": 0.02})
        with tc.Simulation(description, h=scene.run["h"], cg_tol=scene.run["cg_tol"]) as sim:
            sim.run(scene.run["duration"], scene.run["fps"])
            sides = []
            for way in (1, -1):
                camera = tc.Camera((0.7 * way, 1.25, 2.9 * way), (0, 0.9, 0), 37)
                description.view = replace(description.view, camera=camera, light=(0.45 * way, 0.8, 0.5 * way))
                sides.append(drawn(sim, size=FIGURE))
            columns.append(np.concatenate(sides))
    return np.concatenate(columns, axis=1)


FIGURES: dict[str, Callable[[], np.ndarray]] = {
    "strain_limits": strain_limits, "bend_friction": bend_friction, "shirt_fold": lambda: of_scene("shirt_fold"),
    "balloon": lambda: of_scene("balloon", part=0.68), "crumple": lambda: of_scene("crumple", "crease", (0.0, 150.0)),
    "tent": lambda: of_scene("tent", "stretch", (0.95, 1.05)), "dressed": dressed}


def main() -> None:
    """Makes them."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("names", nargs="*", help="all where none is named")
    parser.add_argument("--to", default="docs/images", type=pathlib.Path)
    args = parser.parse_args()
    for name in args.names or FIGURES:
        file = args.to / f"{name}.png"
        file.write_bytes(encode_png(FIGURES[name](), 9))
        print(f"{file}: {file.stat().st_size / 1e3:.0f} kB", flush=True)


if __name__ == "__main__":
    main()
