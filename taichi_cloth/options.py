"""Options of a simulation: the one place of defaults, checks, flags and their meaning. No numpy, no Taichi.

`Simulation` takes them by name, the command line makes its flags of them, the docs their table, and a run's manifest keeps
them.
"""

import inspect
from dataclasses import MISSING, Field, asdict, dataclass, field, fields
from typing import Any

CG_TOL = 1e-4  # relative residual of the paper's single solve, if none is asked for
NEWTON_TOL = 1e-4  # m, if none is asked for
INTEGRATORS = ("auto", "safe", "tr_bdf2", "bdf2", "backward_euler", "newton_euler", "verlet")
EXPLICIT = ("verlet",)
PRECONDITIONERS = ("auto", "multilevel", "block_jacobi", "jacobi", "none")
SHORTEST, LONGEST = 1e-12, 100.0  # steps [s] that may be asked for: time has no digits for shorter ones
USUAL = 1 / 60  # s: with larger steps, contact is as stiff, and tried in as small steps, as with that one
H_MIN_FACTOR = 4096.0  # h_min is the less of h and USUAL over this, if it is not given
ARCHS, PRECISIONS = ("cpu", "cuda", "vulkan", "metal"), ("f32", "f64")
MACHINE = ("arch", "precision", "threads", "quiet", "debug")  # Taichi is started with these, and they are recorded
MOST_FRAMES = 10_000_000  # of a run: more have no end
APART = (*MACHINE, "h", "h_min", "count_intersections", "log")  # a record has steps as control keeps them; the last two
# decide nothing


def _option(default: Any, kind: str, meaning: str, flag: str | None = None, unit: str = "", **bounds: Any) -> Any:
    """A field.

    Args:
        kind: the check of `checks` that it has to pass, unless it is None.
        flag: of the command line; None if it has none.
        bounds: for the check.
    """
    return field(default=default, metadata={"kind": kind, "meaning": meaning, "flag": flag, "unit": unit, "bounds": bounds})


@dataclass(frozen=True, kw_only=True)
class Options:
    """Options of a `Simulation`, all by name; `Options.table()` lists them with their meaning.

    Raises:
        SceneError: an impossible value, an unknown name, or two that do not go together.
    """

    h: float | None = _option(
        None, "number", "step size [s], such as 1/60; if steps adapt, the largest one (an explicit method's stable step "
        "bounds it too). None takes 1/60; an explicit method may then join substeps up to 1/10 s if no wind changes", "--h",
        "s", least=SHORTEST, most=LONGEST)
    arch: str = _option("cpu", "choice", '"cpu", "cuda", "vulkan" or "metal"', "--arch", choices=ARCHS)
    precision: str = _option("f64", "choice", '"f32" or "f64"', "--precision", choices=PRECISIONS)
    integrator: str = _option(
        "safe", "choice", '"safe" (TR-BDF2, in contact with solids BDF2; backward Euler for impacts, layers, sewn cloth, '
        'contact_tol=None, and steps that these cannot take), "bdf2" (BDF2 for layers and without contact_tol too), '
        '"tr_bdf2", '
        '"backward_euler" (the paper\'s single solve), "newton_euler" (nonlinear backward Euler), "verlet" (explicit), or '
        '"auto": "safe" or "verlet", by stiffness, mesh, solids and tolerance; `notes` say why', "--integrator",
        choices=INTEGRATORS)
    K: str = _option(
        "projected", "choice", 'stiffness matrix: "projected" (positive semidefinite), "gauss_newton" or "paper" (exact)',
        "--K", choices=("projected", "gauss_newton", "paper"))
    cg_tol: float | None = _option(
        None, "number", "relative residual of a linear solve. None takes 1e-4 for backward Euler; .03 and less for "
        "'newton_euler' without contact; .03 and then .1 for stages; 1e-4 and then .05 with contact_tol", "--cg-tol",
        positive=True, most=1.0)
    adaptive: bool = _option(
        True, "flag", "a step that fails is repeated with a smaller h; False makes exactly the steps asked for, and counts "
        "those that fail",
        "--fixed-step")
    h_min: float | None = _option(
        None, "number", f"smallest step [s]; None takes h, or 1/60 if that is less, over {H_MIN_FACTOR:g}", None, "s",
        positive=True)
    stretch_limit: float = _option(
        0.5, "number", "largest change of a triangle's stretch |w|/b in a step", "--stretch-limit", positive=True)
    newton_max: int = _option(
        8, "integer", "Newton iterations of a stage; further solves of a step that fails the energy test (with contact_tol "
        "two more, and nine more than that with layers of cloth; 12 solves with layers without contact_tol)", None,
        least=0, most=1_000_000)
    preconditioner: str = _option(
        "auto", "choice", '"multilevel", "block_jacobi", "jacobi" or "none" (masses). "auto" takes multilevel from 500 '
        'particles on, else block_jacobi; always block_jacobi with K="paper"', "--preconditioner", choices=PRECONDITIONERS)
    cg_max_iterations: int = _option(10_000, "integer", "most CG iterations of one solve", None, least=1, most=100_000_000)
    threads: int | None = _option(None, "integer", "CPU threads; None takes all", "--threads", least=1)
    quiet: bool = _option(True, "flag", "no messages of Taichi's own")
    debug: bool = _option(False, "flag", "bounds checks in kernels (slow)", "--debug")
    newton_tol: float | None = _option(
        None, "number", "RMS of the last change of position [m] at which Newton's method stops. None takes 1e-4 for "
        "'newton_euler', and half of a stage's first change for TR-BDF2", "--newton-tol", "m", positive=True)
    contact_tol: float | None = _option(
        0.1, "number", "largest residual of the force balance of cloth in contact at the end of a step, as a "
        "part of the forces on it: steps are solved to it, by more solves or smaller steps, and contacts agree to a hundredth "
        "of it. .01 is for measurements. None accepts steps after one linearization, by their energy: two thirds of the time "
        "on smooth solids, for previews", "--contact-tol", positive=True, most=100.0)
    tolerance: float | None = _option(
        None, "number", "RMS error of positions [m] that half a second may add, as estimated; it drives h. None takes the "
        'steps asked for. Needs "safe", "bdf2" or "tr_bdf2"', "--tolerance", "m", positive=True)
    tangles: str = _option(
        "untangle", "choice", 'cloth that passes through cloth where it should not: "untangle" pulls it apart, "ignore" '
        'leaves it until it is apart, "abort" refuses such a start', "--tangles", choices=("untangle", "ignore", "abort"))
    contact: str = _option(
        "repulsion", "choice", 'how cloth is kept from cloth: "repulsion", or the paper\'s damped "springs", one solve a '
        "step, for comparison", "--contact", choices=("repulsion", "springs"))
    count_intersections: bool = _option(
        False, "flag", "whether places where cloth passes through cloth are counted exactly after every step, for the log",
        "--count-intersections")
    log: int | str = _option(
        "all", "kept", 'steps that `sim.log` keeps: "all" (2.3 kB each), a number of the last, or "none"; sums and a '
        "folder's telemetry have all", "--log")
    substep: float | None = _option(
        None, "number", 'substep of "verlet" [s]; None takes the largest stable one. Triangles that are unstable with a '
        "larger one are softened until they are stable; `notes` say how many and how much",
        "--substep", "s", positive=True)

    def __post_init__(self) -> None:
        from . import checks
        from .errors import SceneError

        for option in fields(self):
            value, kind = getattr(self, option.name), option.metadata["kind"]
            if value is None and (option.default is None or "None" in str(option.type)):
                continue
            bounds = dict(option.metadata["bounds"])
            if kind == "number":
                bounds["unit"] = option.metadata["unit"]
            object.__setattr__(self, option.name, getattr(checks, kind)(option.name, value, **bounds))
        if self.tolerance is not None and (self.integrator not in ("auto", "safe", "bdf2", "tr_bdf2") or not self.adaptive):
            raise SceneError(f"tolerance = {self.tolerance:g} m: error control needs integrator 'safe', 'bdf2' or 'tr_bdf2' "
                             f"and adaptive steps, not {self.integrator!r}")
        if self.substep is not None and self.integrator not in EXPLICIT:
            raise SceneError(f"substep = {self.substep:g} s: is for the integrator 'verlet', not {self.integrator!r}")

    @classmethod
    def named(cls, values: dict[str, Any]) -> "Options":
        """Options of these names.

        Raises:
            SceneError: an unknown name as well.
        """
        from .errors import SceneError, did_you_mean

        unknown = [name for name in values if name not in BY_NAME]
        if unknown:
            raise SceneError(f"a simulation has no option {unknown[0]!r}; {did_you_mean(unknown[0], BY_NAME)}")
        return cls(**values)

    def record(self) -> dict[str, Any]:
        """By name the options that decide how a run goes, wherever it runs."""
        return {name: value for name, value in asdict(self).items() if name not in APART}

    @staticmethod
    def table() -> list[tuple[str, Any, str, str]]:
        """A row for each option: name, default, flag of the command line or "", meaning."""
        return [(name, o.default, o.metadata["flag"] or "", o.metadata["meaning"]) for name, o in BY_NAME.items()]


BY_NAME: dict[str, Field] = {option.name: option for option in fields(Options)}
assert all(option.default is not MISSING for option in BY_NAME.values())


def signature(*first: inspect.Parameter) -> inspect.Signature:
    """Signature of a call that takes `first` and every other option by name."""
    named = {p.name for p in first}
    return inspect.Signature([*first, *(inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=option.default,
                                                          annotation=option.type)
                                        for name, option in BY_NAME.items() if name not in named)])
