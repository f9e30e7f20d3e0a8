"""A run from scene file to folder: simulate, draw, write, report progress; and going on with one that ended early."""

import contextlib
import datetime
import functools
import platform
import sys
import time
import traceback
from collections import Counter
from dataclasses import asdict, dataclass, field

import numpy as np

from .. import __version__
from ..errors import ClothError, OutputError, ScriptError, SimulationError
from ..output.folder import FRAMES, RunFolder, hash_of_file
from ..output.recording import Recording
from ..recording import record
from ..recording.resuming import kept_from, resume, run_of
from ..scene.scene import Scene
from ..simulation import Simulation
from ..step.ledger import totals
from .interrupts import after_this_frame
from .scenefile import SceneFile


@dataclass(frozen=True)
class RunOptions:
    """What the command line asks for.

    Attributes:
        out: folder, or None to write nothing.
        size: of the pictures [pixels], or None for no pictures.
        simulation: arguments of `Simulation`.
        settings: options of the scene's build.
        look: as `look_flags.look_of` gives it.
        pictures: which frames are drawn, as `drawing.numbers_in` reads it; "" is all.
        passes: as `look_flags.passes_of` gives it.
        checkpoint_every: frames; 0 writes none.
        frames: whether positions are kept, for rendering again and for export.
        resume: goes on with the run in `out`; from its last whole checkpoint, or from that of frame `from_frame` or the
            last one before it.
        force: goes on though the scene or its parameters have changed.
    """

    out: str | None
    duration: float
    fps: float
    size: tuple[int, int] | None = None
    overwrite: bool = False
    settings: dict = field(default_factory=dict)
    simulation: dict = field(default_factory=dict)
    look: dict = field(default_factory=dict)
    pictures: str = ""
    passes: tuple[tuple[str, ...], str] = ((), "npy")
    checkpoint_every: int = 10
    frames: bool = True
    resume: bool = False
    from_frame: int | None = None
    force: bool = False

    @functools.cached_property
    def drawn(self) -> set[int]:
        """Numbers of the frames that are drawn."""
        from ..recording.drawing import numbers_in

        there = range(round(self.duration * self.fps) + 1)
        return set(numbers_in(self.pictures, there) if self.pictures else there)


def simulate(scene_file: SceneFile, options: RunOptions) -> Simulation:
    """Builds the scene, runs it, writes its folder.

    Raises:
        ClothError: by what went wrong; the frames so far are whole.
    """
    scene = scene_file.make(options.settings)
    started = time.perf_counter()
    sim = Simulation(scene, **options.simulation)
    for note in sim.notes:
        print(f"note: {note}", file=sys.stderr)
    manifest = _manifest(scene_file, sim, options)
    old = Recording(options.out) if options.resume and options.out else None
    last = round(options.duration * options.fps)
    resumed = resume(sim, old, manifest, last, options.from_frame, options.force) if old else None
    first = kept_from(old, resumed, options.frames)
    # only now, when nothing in the request is wrong any more, may an earlier run's files go
    folder = RunFolder(options.out, options.overwrite, resumed) if options.out else None
    outcome, writer = "interrupted", None
    try:
        with progress(options) as show, after_this_frame() as interrupted:
            if folder:
                folder.write_manifest({**manifest, "status": "running", "frames": None if first is None else [first, None]})
                writer = Writer(folder, sim, options, resumed, first, run_of(manifest))

            def on_frame(sim: Simulation, frame: int) -> None:
                if writer:
                    writer.write(frame)
                show(sim, frame)
                if interrupted():
                    raise KeyboardInterrupt

            sim.run(options.duration, options.fps, on_frame, resumed)
        if writer:
            writer.check()
        outcome = "finished"
    except SimulationError as error:
        outcome = f"gave up: {error}"
        raise
    except ClothError as error:
        outcome = f"failed: {error}"
        raise
    except Exception as error:
        outcome = f"failed: {_said(error, scene_file)}"
        raise ScriptError(f"scene {scene_file.name}: {_said(error, scene_file)}") from error
    finally:
        if folder:
            with contextlib.closing(folder), (contextlib.suppress(OutputError) if outcome.startswith("failed")
                                              else contextlib.nullcontext()):
                if writer:
                    writer.finish()
                folder.write_manifest({**manifest, "status": outcome, "frames": writer.kept if writer else None,
                                       "simulated_s": sim.time, "wall_s": round(time.perf_counter() - started, 3),
                                       "summary": summary(sim), "output_seconds": writer.seconds if writer else {}})
    return sim


def _said(error: Exception, scene_file: SceneFile) -> str:
    """An exception of a scene's own code in one line: what, and where in the scene file."""
    places = traceback.extract_tb(error.__traceback__)
    where = next((p for p in reversed(places) if p.filename == scene_file.path), places[-1])
    return f"{type(error).__name__}: {error} ({where.filename}, line {where.lineno})"


class Writer:
    """Writes what a run leaves behind, frame by frame, and keeps count of what that costs.

    Attributes:
        seconds: wall time by what was done: draw, write.
    """

    def __init__(self, folder: RunFolder, sim: Simulation, options: RunOptions, resumed: int | None, first: int | None,
                 run: str) -> None:
        self.folder, self.sim, self.options, self.run = folder, sim, options, run
        self.first, self.last = first, resumed
        self.seconds = {"draw": 0.0, "write": 0.0}
        self.written = len(sim.log)
        self.geometry = record.geometry(sim)
        folder.write_telemetry([asdict(r) for r in sim.log])
        folder.write_geometry(self.geometry)
        self.artist = _artist(self.geometry, options, sim.scene) if options.size else None
        self.cut = 0  # frames in which cloth is not all in the picture

    def write(self, frame: int) -> None:
        """The frame at which the simulation now is."""
        sim, folder = self.sim, self.folder
        begun = time.perf_counter()
        arrays = record.frame(sim)
        files = self._draw(arrays, frame)
        drawn = time.perf_counter()
        for ending, data in files.items():
            folder.write_image(frame, data, ending)
        if self.options.frames:
            folder.write_frame(frame, arrays)
            self.last = frame
        self.flush()
        every = self.options.checkpoint_every
        if every and frame % every == 0:
            folder.write_checkpoint(frame, sim.checkpoint(), self.run)
        self.seconds["draw"] += drawn - begun
        self.seconds["write"] += time.perf_counter() - drawn

    def _draw(self, arrays: dict[str, np.ndarray], frame: int) -> dict[str, bytes]:
        """The frame's pictures by their files' endings."""
        if self.artist is None or frame not in self.options.drawn:
            return {}
        from ..recording.drawing import Extras, files_of

        self.cut += self.artist.fitted and not self.artist.sees(arrays)
        return files_of(self.artist, arrays, frame, Extras(*self.options.passes))[1]

    def flush(self) -> None:
        """Telemetry of the steps since the last time."""
        self.folder.append_telemetry([asdict(r) for r in self.sim.log[self.written:]])
        self.written = len(self.sim.log)

    @property
    def kept(self) -> list[int] | None:
        """First and last frame whose positions are in the folder."""
        return None if self.first is None or self.last is None or self.last < self.first else [self.first, self.last]

    def check(self) -> None:
        """All frames are still there.

        Raises:
            OutputError: some were removed while the run went on.
        """
        missing = self.folder.missing_frames(*self.kept) if self.kept else []
        if missing:
            raise OutputError(f"{self.folder.path / FRAMES}: {len(missing)} frames were removed while the run went on, the "
                              f"first is {missing[0]}")

    def finish(self) -> None:
        """The last steps."""
        self.flush()
        if self.cut:
            print(f"note: cloth left the picture in {self.cut} of {len(self.options.drawn)} frames: `taichi-cloth render "
                  f"{self.folder.path}` draws them through a camera that fits all of them", file=sys.stderr)
        self.seconds = {k: round(v, 4) for k, v in self.seconds.items()}


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
            "fell_back": sum(bool(r.fell_back) for r in sim.log),
            "contacts": max((r.contacts for r in sim.log), default=0),
            "crossings": max((r.crossings for r in sim.log), default=0),
            "layers": max((r.layers for r in sim.log), default=0),
            "least_gap": min((r.least for r in sim.log), default=1.0),
            "tangled": max((r.tangled for r in sim.log), default=0), "pinched": max((r.pinched for r in sim.log), default=0),
            "intersections": max((r.intersections for r in sim.log if r.intersections is not None), default=None),
            "largest_stretch": max((r.stretch for r in sim.log), default=None),
            "energy": totals([r.ledger for r in sim.log]),
            "seconds": {k: round(v, 4) for k, v in seconds.items()}}


def _seams(sim: Simulation) -> str:
    """What is not sewn together yet, or no longer."""
    seams, gaps, given = sim.scene.seams, sim.seam_gaps(), sim.stitches_open()
    count = sum(int(o.sum()) for o in given)
    if count:
        return f"seams: {count} of {sum(map(len, given))} stitches have opened, at most {gaps.max():.3g} m\n"
    if not (gaps > 0).any():
        return f"seams: all {len(seams)} are closed\n" if seams else ""
    k = int(np.argmax(gaps))
    names = seams[k].cloth.mesh.groups
    joined = [next((n for n, g in names.items() if np.isin(row, g).all()), f"vertices {row[0]} to {row[-1]}")
              for row in (seams[k].a, seams[k].b)]
    return (f"seams: {int((gaps > 0).sum())} of {len(seams)} are open, at most {gaps[k]:.3g} m: seam {k} of "
            f"{seams[k].cloth.name!r}, {joined[0]} to {joined[1]}\n")


def describe(sim: Simulation, wall: float) -> str:
    """The closing lines of a run: how complex it was, how often it went wrong, what it cost."""
    s = summary(sim)
    cloths = sim.scene.cloths
    bad = ", ".join(f"{n} {c}" for n, c in s["rejections"].items()) or "none"
    parts = ", ".join(f"{n} {v:.2f} s" for n, v in s["seconds"].items() if v)
    faces = sum(c.mesh.face_count for c in cloths)
    model = f"{sim.model.n} vertices, {faces} triangles, {len(sim.scene.solids)} solids, at most {s['contacts']} contacts"
    layers = ""
    if sim.contacts is not None and sim.contacts.layers is not None:
        counted = "not counted" if s["intersections"] is None else s["intersections"]
        layers = (f"layers: at most {s['layers']} pairs of cloth in contact, smallest gap {s['least_gap']:.2f} thicknesses; "
                  f"intersections {counted}, tangled at most {s['tangled']}, pinched {s['pinched']}\n")
    return (f"model: {model}\n{layers}{_seams(sim)}"
            f"trouble: rejected steps: {bad}; taken by backward Euler instead: {s['fell_back']}; smallest h "
            f"{s['smallest_h'] * 1e3:.3g} ms, worst residual {s['worst_residual']:.1g}, "
            f"crossings {s['crossings']}, largest stretch {s['largest_stretch']:.3f}\n"
            f"energy: {_energy(s['energy'])}\n"
            f"cost: {sim.time:g} s simulated in {wall:.1f} s on {sim.runtime.arch} {sim.runtime.precision}: {s['steps']} "
            f"steps, {s['cg_iterations']} CG iterations; {parts}")


def _energy(total: dict[str, float]) -> str:
    """What put energy in, what took it, and what is unaccounted for, in a sentence."""
    taken = ("damping", "method")
    terms = (f"{name} {-value if name in taken else value:+.3g}" for name, value in total.items()
             if value and name in ("attachments", "pins", "solids", "lifted", "lowered", "friction", "layers", "wind", *taken))
    return (f"changed by {total['kinetic'] + total['potential']:+.3g} J: {', '.join(terms) or 'no work'}; "
            f"unaccounted for {total['unaccounted']:+.2g} J")


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


def _artist(geometry: dict[str, np.ndarray], options: RunOptions, scene: Scene):
    """What draws the run's frames."""
    from ..output.look import Look
    from ..output.picture import Artist
    from ..recording.expected import expected
    from ..recording.playback import heat_of

    assert options.size is not None
    look = dict(options.look)
    if look.get("heat"):
        look["heat"] = heat_of(look["heat"][0], geometry, look["heat"][1])
    return Artist(geometry, options.size, Look(**look), lambda: expected(scene, options.duration))


def _manifest(scene_file: SceneFile, sim: Simulation, options: RunOptions) -> dict:
    resolved = {name: p.default for name, p in scene_file.options.items() if p.default is not p.empty}
    settings = scene_file.typed(options.settings)
    return {
        **described(sim, options), "scene": scene_file.name, "path": scene_file.path, "source": hash_of_file(scene_file.path),
        "settings": {k: v if isinstance(v, (int, float, bool)) else str(v) for k, v in {**resolved, **settings}.items()}}


def described(sim: Simulation, options: RunOptions) -> dict:
    """What a manifest says of a run whatever its scene comes from."""
    return {
        "taichi_cloth": __version__, "python": platform.python_version(), "numpy": np.__version__,
        "machine": f"{platform.system()} {platform.machine()}",
        "started": datetime.datetime.now(datetime.timezone.utc).isoformat(timespec="seconds"),
        "duration": options.duration, "fps": options.fps, "size": options.size,
        "simulation": {**sim.options.record(), **asdict(sim.control), "integrator": sim.integrator_name},
        "runtime": sim.runtime.record(),
        "model": {"vertices": sim.model.n, "triangles": sum(c.mesh.face_count for c in sim.scene.cloths),
                  "solids": len(sim.scene.solids), "notes": sim.notes},
    }
