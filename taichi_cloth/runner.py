"""A run from scene file to folder: simulate, draw, write, report progress."""

import contextlib
import datetime
import platform
import sys
import time
from collections import Counter
from dataclasses import asdict, dataclass, field, replace

import numpy as np

from . import __version__
from .errors import ClothError, SceneError, SimulationError
from .output.folder import RunFolder
from .output.png import encode_png
from .scene import Scene
from .scenefile import SceneFile
from .simulation import Simulation
from .solids import Plane, Solid


@dataclass(frozen=True)
class RunOptions:
    """What the command line asks for.

    Attributes:
        out: folder, or None to write nothing.
        size: of the pictures [pixels], or None for no pictures.
        simulation: arguments of `Simulation`.
        settings: options of the scene's build.
    """

    out: str | None
    duration: float
    fps: float
    size: tuple[int, int] | None = None
    overwrite: bool = False
    settings: dict = field(default_factory=dict)
    simulation: dict = field(default_factory=dict)


def simulate(scene_file: SceneFile, options: RunOptions) -> Simulation:
    """Builds the scene, runs it, writes its folder.

    Raises:
        ClothError: by what went wrong; the frames so far are whole.
    """
    if round(options.duration * options.fps) < 1:
        raise SceneError(f"duration {options.duration:g} s at {options.fps:g} frames a second is no frame")
    scene = scene_file.make(options.settings)
    started = time.perf_counter()
    sim = Simulation(scene, **options.simulation)
    for note in sim.notes:
        print(f"note: {note}", file=sys.stderr)
    # only now, when nothing in the request is wrong any more, may an earlier run's files go
    folder = RunFolder(options.out, options.overwrite) if options.out else None
    manifest = _manifest(scene_file, scene, sim, options)
    outcome, written = "interrupted", 0
    try:
        if folder:
            folder.write_manifest({**manifest, "status": "running"})
        with progress(options) as show:
            draw = _artist(scene, options) if options.size and folder else None

            def on_frame(sim: Simulation, frame: int) -> None:
                nonlocal written
                if folder:
                    if draw:
                        folder.write_image(frame, encode_png(draw(sim.positions(), sim.time)))
                    folder.append_telemetry([asdict(r) for r in sim.log[written:]])
                    written = len(sim.log)
                show(sim, frame)

            sim.run(options.duration, options.fps, on_frame)
        outcome = "finished"
    except SimulationError as error:
        outcome = f"gave up: {error}"
        raise
    except ClothError as error:
        outcome = f"failed: {error}"
        raise
    finally:
        if folder:
            folder.append_telemetry([asdict(r) for r in sim.log[written:]])
            folder.close()
            folder.write_manifest({**manifest, "status": outcome, "simulated_s": sim.time,
                                   "wall_s": round(time.perf_counter() - started, 3), "summary": summary(sim)})
    return sim


def summary(sim: Simulation) -> dict:
    """Steps, rejections by name, smallest step, worst residual, iterations and seconds by part of a run."""
    rejections: Counter[str] = Counter()
    seconds: dict[str, float] = {}
    for r in sim.log:
        rejections.update(r.rejections)
        for name, value in r.seconds.items():
            seconds[name] = seconds.get(name, 0.0) + value
    return {"steps": len(sim.log), "rejections": dict(rejections),
            "smallest_h": min((r.h for r in sim.log), default=None),
            "worst_residual": max((r.residual for r in sim.log), default=None),
            "not_converged": sum(r.status not in ("CONVERGED", "EXPLICIT") for r in sim.log),
            "cg_iterations": sum(r.iterations for r in sim.log), "solves": sum(r.solves for r in sim.log),
            "largest_stretch": max((r.stretch for r in sim.log), default=None),
            "seconds": {k: round(v, 4) for k, v in seconds.items()}}


def describe(sim: Simulation, wall: float) -> str:
    """The closing line of a run."""
    s = summary(sim)
    bad = ", ".join(f"{n} {c}" for n, c in s["rejections"].items()) or "none"
    parts = ", ".join(f"{n} {v:.2f} s" for n, v in s["seconds"].items() if v)
    return (f"{sim.time:g} s simulated in {wall:.1f} s on {sim.runtime.arch} {sim.runtime.precision}: {s['steps']} steps, "
            f"rejections: {bad}, {s['cg_iterations']} CG iterations, largest stretch {s['largest_stretch']:.3f}; {parts}")


@contextlib.contextmanager
def progress(options: RunOptions):
    """A function (sim, frame) that shows how far a run is: a bar on a terminal, plain lines elsewhere."""
    frames = max(1, round(options.duration * options.fps))
    if not sys.stderr.isatty():
        yield lambda sim, frame: _line(sim, frame, frames)
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (TextColumn("frame {task.completed}/{task.total}"), BarColumn(), TimeRemainingColumn(),
               TextColumn("{task.fields[state]}"))
    with Progress(*columns, console=Console(stderr=True)) as bar:
        task = bar.add_task("", total=frames, state="")
        yield lambda sim, frame: bar.update(task, completed=frame, state=_state(sim))


def _line(sim: Simulation, frame: int, frames: int) -> None:
    every = max(1, frames // 10)
    if frame % every == 0 or frame == frames:
        print(f"frame {frame}/{frames}  {_state(sim)}", file=sys.stderr, flush=True)


def _state(sim: Simulation) -> str:
    if not sim.log:
        return "compiling"
    last = sim.log[-1]
    rejected = sum(sum(r.rejections.values()) for r in sim.log)
    return f"t {sim.time:.3f} s  h {last.h * 1e3:.2f} ms  CG {last.iterations}  rejected {rejected}"


def _artist(scene: Scene, options: RunOptions):
    """A function of positions and time that draws the scene, solids included."""
    from .output.raster import PALETTE, STONE, Renderer

    assert options.size is not None
    parts = [(c.positions, c.mesh.faces, c.mesh.corner_uv, c.color or PALETTE[k % len(PALETTE)])
             for k, c in enumerate(scene.cloths)]
    solids = [s for s in scene.solids if not _is_ground(s)]
    for s in solids:
        faces = s.shape.surface()[1]
        parts.append((s.surface_at(0.0), faces, np.zeros((len(faces), 3, 2)), s.color or STONE))
    starts = np.cumsum([0] + [len(x) for x, *_ in parts])
    faces = np.concatenate([f + k for (_, f, _, _), k in zip(parts, starts)])
    uv = np.concatenate([p[2] for p in parts])
    colors = np.concatenate([np.tile(color, (len(f), 1)) for _, f, _, color in parts])
    grounds = [s.pose(0.0)[1][1] for s in scene.solids if _is_ground(s)]
    view = scene.view if scene.view.ground is not None or not grounds else replace(scene.view, ground=float(max(grounds)))
    start = np.concatenate([x for x, *_ in parts])
    cloth_faces = sum(c.mesh.face_count for c in scene.cloths)
    renderer = Renderer(*options.size, faces, uv, colors, start, view, cloth_faces)
    return lambda x, t: renderer.render(np.concatenate([x, *(s.surface_at(t) for s in solids)]))


def _is_ground(solid: Solid) -> bool:
    """A level plane that stays is drawn as the ground."""
    if not isinstance(solid.shape, Plane) or solid.moves:
        return False
    return bool((solid.pose(0.0)[0] @ np.array(solid.shape.normal))[1] > 1 - 1e-9)


def _manifest(scene_file: SceneFile, scene: Scene, sim: Simulation, options: RunOptions) -> dict:
    resolved = {name: p.default for name, p in scene_file.options.items() if p.default is not p.empty}
    return {
        "taichi_cloth": __version__, "python": platform.python_version(), "numpy": np.__version__,
        "machine": f"{platform.system()} {platform.machine()}",
        "started": datetime.datetime.now(datetime.timezone.utc).isoformat(timespec="seconds"),
        "scene": scene_file.name, "settings": {**resolved, **options.settings},
        "duration": options.duration, "fps": options.fps, "size": options.size,
        "simulation": {"integrator": sim.integrator_name, **asdict(sim.control), **asdict(sim.options)},
        "runtime": sim.runtime.record(),
        "model": {"vertices": sim.model.n, "triangles": sum(c.mesh.face_count for c in scene.cloths),
                  "solids": len(scene.solids), "notes": sim.notes},
    }
