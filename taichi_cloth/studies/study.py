"""Error against cost on any scene: every method and step size held against a reference that is checked first.

The reference is run twice, the second time with half the step. Once the two part, the motion is no longer
predictable: positions are compared up to there and not beyond, energies and stretch over the whole run. A row whose
error is not ten times the references' own difference says "reference not converged" instead of a number that means
nothing.
"""

import csv
import io
import json
import time
from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass, field

import numpy as np

from .. import checks
from ..errors import ClothError, SceneError
from ..options import EXPLICIT, INTEGRATORS
from ..renamed import old_names
from ..scene.scene import Scene
from ..simulation import Simulation
from ..step.choice import SAFETY

PREDICTABLE = 1e-3  # of the scene's size: by more than that the two references may not differ, RMS
CONVERGED = 0.1  # of a row's error: the references' difference must be less
REFERENCE_PARTS = (0.5, 0.25)  # of an explicit reference's stable step
SAMPLES = 30  # a second, at which runs are compared
MOST = 1e4  # s, that may be studied: all positions at all samples are kept


@dataclass(frozen=True)
class Case:
    """One way to run the scene.

    Attributes:
        integrator, precision, arch: as of `Simulation`.
        h: step [s]; tolerance: error asked for instead [m], with h as the largest step.
        cg_tol, newton_tol [m]: None is the method's own.
        substep: of an explicit method, in its stable ones; more than 1 softens elements that are too stiff for it.
    """

    integrator: str
    h: float
    tolerance: float | None = None
    cg_tol: float | None = None
    newton_tol: float | None = None
    substep: float = 1.0
    precision: str = "f64"
    arch: str = "cpu"

    def __post_init__(self) -> None:
        checks.choice("integrator", self.integrator, INTEGRATORS)
        checks.number("h", self.h, "s", positive=True)
        checks.number("substeps", self.substep, positive=True)
        for name in ("tolerance", "cg_tol", "newton_tol"):
            checks.maybe(getattr(self, name), checks.number, name, positive=True)

    def describe(self) -> str:
        """A few words."""
        step = f"tolerance {self.tolerance:g} m" if self.tolerance else f"h = 1/{1 / self.h:.4g}"
        more = [f"cg {self.cg_tol:g}"] if self.cg_tol else []
        more += [f"substep x{self.substep:g}"] if self.substep != 1 else []
        more += [self.precision] if self.precision != "f64" else []
        more += [self.arch] if self.arch != "cpu" else []
        return " ".join([step, *more])


@old_names
@dataclass
class Row:
    """Result of a case.

    Attributes:
        wall: seconds, the better of two runs; compiling is not in it.
        error: RMS distance from the reference at the last predictable time [m], or None where the case failed.
        energy_error: largest difference of the mechanical energy up to then [J]; stretch_error: of the largest stretch,
            over the whole run.
        note: "reference not converged", or why the run ended early.
        converged: whether the reference is good enough to tell the error.
        best: on the Pareto front of wall time and error; no row is whose error the reference cannot tell.
    """

    case: Case
    wall: float = 0.0
    error: float | None = None
    energy_error: float | None = None
    stretch_error: float | None = None
    steps: int = 0
    rejections: dict[str, int] = field(default_factory=dict)
    fallbacks: int = 0
    iterations: int = 0
    evaluations: int = 0
    note: str = ""
    converged: bool = True
    best: bool = False


@dataclass
class Track:
    """A run at its samples: positions (s, n, 3), mechanical energy (s,) [J], largest stretch (s,)."""

    positions: np.ndarray
    energy: np.ndarray
    stretch: np.ndarray


@dataclass
class Study:
    """All rows of a scene.

    Attributes:
        times: (s,) of the samples [s].
        predictable: time [s] up to which positions mean anything.
        reference: how it was made; doubt: (s,) RMS difference of the two references [m].
    """

    scene: str
    times: np.ndarray
    predictable: float
    reference: str
    doubt: np.ndarray
    rows: list[Row]


def study(name: str, make: Callable[[], Scene], cases: Iterable[Case], duration: float, h: float,
          say: Callable[[str], None] = lambda text: None) -> Study:
    """Runs every case of a scene against a reference.

    Args:
        make: builds the scene anew.
        duration: [s], rounded to whole samples; h: of the coarsest implicit reference [s].

    Raises:
        SceneError: not even the first sample of the references agrees.
    """
    samples = max(2, round(checks.number("duration", duration, "s", positive=True, most=MOST) * SAMPLES))
    times = np.arange(samples + 1) / SAMPLES
    rough, fine, how = _references(make, samples, h, say)
    doubt = _rms(rough.positions, fine.positions)
    last = predictable(doubt, float(np.linalg.norm(np.ptp(fine.positions[0], axis=0))) or 1.0)
    if last < 1:
        raise SceneError(f"study of {name}: the references part at once ({doubt[1]:.2g} m after {times[1]:.3g} s): nothing "
                         "can be said about positions; use a smaller --h, or a scene with some damping")
    say(f"reference: {how}; its positions are good to {doubt[last]:.1e} m up to t = {times[last]:.3g} s")
    rows = []
    cases = list(cases)
    for k, case in enumerate(cases):
        say(f"case {k + 1} of {len(cases)}: {case.integrator} {case.describe()}")
        row, track = _run(case, make, samples)
        if track is not None:
            judge(row, track, fine, last, float(doubt[last]))
        rows.append(row)
    mark_front(rows)
    return Study(name, times, float(times[last]), how, doubt, rows)


def predictable(doubt: np.ndarray, size: float) -> int:
    """The last sample up to which two references (s,) [m] apart agree, on a scene of some size [m]."""
    apart = doubt > PREDICTABLE * size
    return int(np.argmax(apart)) - 1 if apart.any() else len(doubt) - 1


def judge(row: Row, track: Track, fine: Track, last: int, doubt: float) -> None:
    """Fills in a row's errors: its run against the finer reference.

    Args:
        last: sample at which positions are compared, and up to which energies are; doubt: of the references there [m].
    """
    row.error = float(_rms(track.positions[last], fine.positions[last]))
    row.energy_error = float(np.abs(track.energy - fine.energy)[: last + 1].max())
    row.stretch_error = float(np.abs(track.stretch - fine.stretch)[1:].max())
    row.converged = doubt <= CONVERGED * row.error
    notes = [] if row.converged else ["reference not converged"]
    notes += [f"{row.fallbacks} steps by backward Euler"] if row.fallbacks else []
    row.note = ", ".join(notes + [f"{k} {v}" for k, v in row.rejections.items()])


def mark_front(rows: list[Row]) -> None:
    """Marks rows that no other beats in both wall time and error, of those whose error the reference can tell."""
    good = [r for r in rows if r.error is not None and r.converged]
    for row in good:
        row.best = not any(o.wall <= row.wall and o.error <= row.error and o is not row for o in good)  # type: ignore[operator]


def table(s: Study) -> str:
    """The rows as text; a star marks the Pareto front, and last lines explain it and the name of the default method."""
    return "\n".join([f"{s.scene}: RMS error of positions at t = {s.predictable:.3g} s against {s.reference}",
                      HEADER, *(line(row) for row in s.rows),
                      *([SAFE] if any(row.case.integrator == "safe" for row in s.rows) else []),
                      *([STAR] if any(row.best for row in s.rows) else [])])


SAFE = "safe, the default: TR-BDF2, in contact with solids BDF2, backward Euler where these cannot step"
STAR = "* the best for its time: no other case here has both a smaller error and a shorter wall time"


HEADER = (f"  {'method':15} {'setting':24} {'wall s':>8} {'error m':>9} {'energy J':>9} {'stretch':>8} {'steps':>6} "
          f"{'rejected':>8} {'CG its':>7}  note")


def line(row: Row) -> str:
    """A row of the table."""
    def number(value: float | None, form: str = ".2e") -> str:
        return "-" if value is None else format(value, form)

    effort = row.evaluations if row.evaluations else row.iterations
    return (f"{'*' if row.best else ' '} {row.case.integrator:15} {row.case.describe():24} {row.wall:8.3f} "
            f"{number(row.error):>9} {number(row.energy_error):>9} {number(row.stretch_error):>8} {row.steps:6d} "
            f"{sum(row.rejections.values()):8d} {effort:7d}  {row.note}")


def as_json(s: Study) -> str:
    """Everything, for other programs."""
    return json.dumps({"scene": s.scene, "predictable_s": s.predictable, "reference": s.reference,
                       "doubt_m": [float(d) for d in s.doubt], "rows": [_flat(r) for r in s.rows]}, indent=1) + "\n"


def as_csv(s: Study) -> str:
    """One line a row."""
    text = io.StringIO()
    rows = [_flat(r) for r in s.rows]
    writer = csv.DictWriter(text, list(rows[0]) if rows else ["integrator"])
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()


def curves(s: Study) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """By method, (wall seconds, errors), the cheap ones first."""
    out: dict[str, list[tuple[float, float]]] = {}
    for row in s.rows:
        if row.error is not None:
            name = " ".join([row.case.integrator, *(["tolerance"] if row.case.tolerance else []),
                             *([row.case.precision] if row.case.precision != "f64" else []),
                             *([row.case.arch] if row.case.arch != "cpu" else [])])
            out.setdefault(name, []).append((row.wall, row.error))
    return {name: tuple(np.array(sorted(points)).T) for name, points in out.items()}  # type: ignore[misc]


def _flat(row: Row) -> dict:
    out = {**asdict(row.case), **{k: v for k, v in asdict(row).items() if k != "case"}}
    out["rejections"] = " ".join(f"{k} {v}" for k, v in row.rejections.items())
    return out


def _references(make: Callable[[], Scene], samples: int, h: float, say: Callable[[str], None]) -> tuple[Track, Track, str]:
    """(the rougher, the finer, how they were made): explicit where it knows the scene and is stable, else TR-BDF2."""
    scene = make()
    if not scene.touches:
        tracks = []
        for part in REFERENCE_PARTS:
            # wind and led particles go evenly within a step: the two must not have that error in common
            sim = Simulation(make(), h=part / (4 * SAMPLES), integrator="verlet")
            sim.integrator.part, sim.integrator.every = part, 1
            say(f"reference: verlet at {part:g} of its stable step, {sim.integrator.stable_step:.3g} s")
            tracks.append(_track(sim, samples))
            calm = not any(r.rejections for r in sim.log)
            sim.close()
            if not calm:
                break
        if calm:
            return tracks[0], tracks[1], f"verlet at {REFERENCE_PARTS[1]:g} of its stable step"
    tracks = []
    for step in (h, h / 2):
        say(f"reference: h = {step:.3g} s, Newton to 1e-7 m")
        sim = Simulation(make(), h=step, integrator="safe", newton_tol=1e-7, cg_tol=1e-5)
        tracks.append(_track(sim, samples))
        sim.close()
    return tracks[0], tracks[1], f"safe at h = {h / 2:.3g} s"


def _track(sim: Simulation, samples: int) -> Track:
    """Runs a simulation to its last sample."""
    out: tuple[list, list, list] = ([], [], [])

    def look(sim: Simulation, frame: int) -> None:
        last = sim.log[-1] if sim.log else None
        energies = last.energies if last else sim.energy()
        for values, value in zip(out, (sim.positions(), sum(energies.values()), last.stretch if last else 1.0)):
            values.append(value)

    sim.run(samples / SAMPLES, SAMPLES, look)
    return Track(*(np.array(values) for values in out))


def _run(case: Case, make: Callable[[], Scene], samples: int) -> tuple[Row, Track | None]:
    """A case's row, with its cost, and its run; None if it failed."""
    row, sim, track = Row(case), None, None
    try:
        substep = substep_of(make(), case.substep, case.arch, case.precision) if case.substep != 1 else None
        sim = Simulation(make(), h=case.h, integrator=case.integrator, cg_tol=case.cg_tol, tolerance=case.tolerance,
                         newton_tol=case.newton_tol, precision=case.precision, arch=case.arch, substep=substep)
        begin = sim.checkpoint()
        walls: list[float] = []
        for _ in range(2):  # the first compiles
            if walls:
                sim.resume(begin)
                sim.log.clear()
            started = time.perf_counter()
            track = _track(sim, samples)
            walls.append(time.perf_counter() - started)
    except ClothError as error:
        row.note, track = str(error).partition(". ")[0], None
        if sim is None:
            return row, None
        walls.append(time.perf_counter() - started)
    row.wall, row.steps = walls[-1], len(sim.log)
    row.iterations, row.evaluations = (sum(getattr(r, name) for r in sim.log) for name in ("iterations", "evaluations"))
    row.fallbacks = sum(bool(r.fallback_reason) for r in sim.log)
    rejections: Counter[str] = Counter()
    for record in sim.log:
        rejections.update(record.rejections)
    row.rejections = dict(rejections)
    sim.close()
    return row, track


def substep_of(scene: Scene, times: float, arch: str = "cpu", precision: str = "f64") -> float:
    """`times` the explicit substep [s] that is stable in a scene."""
    sim = Simulation(scene, arch=arch, precision=precision, integrator="verlet")
    stable = SAFETY * sim.integrator.stable_step
    sim.close()
    return times * stable


def _rms(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.sqrt(np.mean(np.sum((a - b) ** 2, axis=-1), axis=-1))


def methods_for(methods: list[str], scene: Scene) -> list[str]:
    """Those of the methods that can run a scene: explicit ones know no contact."""
    return [name for name in methods if not (scene.touches and name in EXPLICIT)]


def cases_of(integrators: list[str], steps: list[float], tolerances: list[float], cg_tols: list[float | None],
             precisions: list[str], archs: list[str], h: float, substeps: list[float]) -> list[Case]:
    """Every combination that means something: explicit methods choose their own step, tolerances go with "safe"."""
    out = []
    for arch in archs:
        for precision in precisions:
            for name in integrators:
                if name in EXPLICIT:
                    out += [Case(name, h, substep=times, precision=precision, arch=arch) for times in substeps]
                else:
                    out += [Case(name, step, None, cg, precision=precision, arch=arch) for step in steps for cg in cg_tols]
            out += [Case("safe", h, tolerance, precision=precision, arch=arch) for tolerance in tolerances]
    return out
