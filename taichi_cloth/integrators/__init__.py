"""Time integrators, one file each, behind one interface.

An integrator is built once for a model and has

- `attempt(h, held_at, start) -> Attempt`: one step of size h [s] from the model's saved state, which the model's
  current state equals on entry; `held_at(s)` gives the constraints s seconds into it, and sets the wind there; `start`
  are the measures at its beginning. The model ends in the proposed state, also where the attempt names a rejection:
  rolling back is the stepper's.
- `commit()`: the last attempt was accepted. `reset()`: the state was changed by hand.
- `checkpoint()`, `resume(state)`: what it remembers from step to step, as arrays by name.
- `system`: what it solves with, or None.
- `stable_step`: the largest step [s] that is stable near rest; infinite for implicit methods.

Methods with stages solved by Newton use the operator with their own c in M - c D - c^2 K.
"""

import math
from dataclasses import dataclass

from .. import checks
from ..errors import SceneError
from ..fields import Fields
from ..forces.conditions import K_MODES
from ..ledger import Ledger
from ..measure import Measures, Meter
from ..model import Model
from ..runtime import Runtime
from ..scene import Scene
from ..solver.pcg import Solution
from ..solver.preconditioner import PRECONDITIONERS

CG_TOL = 1e-4  # relative residual of the paper's single solve, where none is asked for
NEWTON_TOL = 1e-4  # m, where none is asked for
TANGLES = ("untangle", "ignore", "abort")
CONTACTS = ("repulsion", "springs")
STRETCH, ENERGY, SOLVER, NOT_FINITE = "STRETCH", "ENERGY", "SOLVER", "NOT_FINITE"
CONTACT, APPROACH, NEWTON, ACCURACY = "CONTACT", "APPROACH", "NEWTON", "ACCURACY"


@dataclass(frozen=True)
class Options:
    """What a user may choose about a step.

    Attributes:
        K: which stiffness, see `forces.conditions`.
        cg_tol: relative residual at which a solve stops; None is the method's own choice.
        cg_max_iterations: of one solve.
        preconditioner: one of `solver.preconditioner.PRECONDITIONERS`.
        newton_max: Newton iterations of a stage; further solves of a step that fails the energy test.
        newton_tol: RMS of the last change of position [m] at which Newton's method stops; None is the method's own choice.
        tolerance: RMS error of positions [m] that the run may gather, or None for steps as they are asked for.
        adaptive: whether a step that is rejected is tried smaller.
        tangles: what to do with cloth that passes through cloth.
        contact: by what cloth is kept from cloth.
        substep: of explicit methods [s]; None is the stable one.

    Raises:
        SceneError: an impossible value or an unknown name.
    """

    K: str = "projected"
    cg_tol: float | None = None
    cg_max_iterations: int = 10_000
    newton_max: int = 8
    preconditioner: str = "block_jacobi"
    newton_tol: float | None = None
    tolerance: float | None = None
    adaptive: bool = True
    tangles: str = "untangle"
    contact: str = "repulsion"
    substep: float | None = None

    def __post_init__(self) -> None:
        known = {"K": K_MODES, "preconditioner": PRECONDITIONERS, "tangles": TANGLES, "contact": CONTACTS}
        for name, choices in known.items():
            checks.choice(name, getattr(self, name), choices)
        checks.maybe(self.cg_tol, checks.number, "cg_tol", positive=True, most=1.0)
        for name, unit in (("newton_tol", "m"), ("tolerance", "m"), ("substep", "s")):
            checks.maybe(getattr(self, name), checks.number, name, unit, positive=True)
        for name, least, most in (("cg_max_iterations", 1, 100_000_000), ("newton_max", 0, 1_000_000)):
            object.__setattr__(self, name, checks.integer(name, getattr(self, name), least, most))
        checks.flag("adaptive", self.adaptive)


@dataclass(frozen=True)
class Attempt:
    """A proposed step.

    Attributes:
        rejection: None, or what is wrong with it.
        detail: more about the rejection, for people.
        measures: of the proposed state; None where it was not reached.
        solutions: of its linear solves, in order.
        seconds: wall time by part, EVAL, CG and C-S.
        contacts: number of contacts with solids; unsettled: how many of them, and of pairs of cloth, had not settled.
        crossings: triangles of cloth and solids that pass through each other.
        layers: pairs of cloth in contact with cloth; least: their smallest distance over what they should keep.
        tangled: pairs of an edge and a triangle of cloth that pass through each other; pinched: particles that were let go.
        evaluations: of the forces, by explicit methods.
        error: estimated, over what the tolerance allows in this step; None where it was not estimated.
        order: of the method, which says how the error goes with the step.
        fell_back: why the step was redone by a more robust method, or "".
        ledger: of its energy; None where the step was not finished.
    """

    rejection: str | None
    detail: str
    measures: Measures | None
    solutions: tuple[Solution, ...]
    seconds: dict[str, float]
    contacts: int = 0
    unsettled: int = 0
    crossings: int = 0
    layers: int = 0
    least: float = 1.0
    tangled: int = 0
    pinched: int = 0
    evaluations: int = 0
    error: float | None = None
    order: int = 1
    fell_back: str = ""
    ledger: Ledger | None = None


INTEGRATORS = ("auto", "safe", "tr_bdf2", "backward_euler", "newton_euler", "verlet")
EXPLICIT = ("verlet",)
SAFETY = 0.9  # part of the stable step that explicit ones take
SUBSTEPS = 150  # in a step, up to which explicit ones cost less than TR-BDF2's solves (swing, 26 to 101 squared: 133 to 213)
ACCURATE = 4  # times as many where the error asked for is small: explicit ones have it without asking
EXPLICIT_ERROR = 1e-3  # m: and so is this small
FINEST = 1e-4  # m: explicit steps estimate no error, so that a smaller one is not theirs to promise


def choose(forces: list, touches: bool, h: float, tolerance: float | None, adaptive: bool) -> tuple[str, str]:
    """(the method that "auto" stands for, why): explicit where it is stable at no more substeps than a solve costs.

    Args:
        h: step asked for [s]; tolerance: error asked for [m], or None.
    """
    if touches:
        return "safe", "the scene has contact, which explicit methods do not know"
    if not adaptive:
        return "safe", "fixed steps are too large to be explicit ones"
    if tolerance is not None and tolerance < FINEST:
        return "safe", f"an error of {tolerance:g} m needs an estimate, which explicit steps do not make"
    omega2, damping = (sum(force.rates[k] for force in forces) for k in (0, 1))
    count = h / stable_step(omega2, damping)
    most = SUBSTEPS * (ACCURATE if tolerance is not None and tolerance <= EXPLICIT_ERROR else 1)
    if count <= most:
        return "verlet", f"{math.ceil(count)} explicit substeps in a step of {h:.3g} s are stable, and cheaper than solves"
    return "safe", f"explicit steps would need {math.ceil(count)} substeps in {h:.3g} s; from {most} on solves are cheaper"


def stable_step(omega2: float, damping: float) -> float:
    """The step [s] up to which h^2 omega^2 + 2 h damping <= 4, the limit of stability at rest.

    Args:
        omega2: largest squared frequency [1/s^2]; damping: largest damping rate [1/s].
    """
    if omega2 == 0:
        return 2 / damping if damping else math.inf
    return (math.sqrt(damping**2 + 4 * omega2) - damping) / omega2


def build(name: str, fields: Fields, model: Model, forces: list, meter: Meter, options: Options, runtime: Runtime,
          scene: Scene, contacts=None):
    """The integrator of a name in `INTEGRATORS`; only what it needs is imported.

    Args:
        meter: with an operator, unless the method is explicit.
        contacts: `contact.response.Contacts` with the scene's solids, or None.

    Raises:
        SceneError: the method does not know contact.
    """
    if name in EXPLICIT:
        if contacts is not None:
            raise SceneError(f"integrator {name!r} knows no contact, with solids or between layers of cloth: use 'safe' or "
                             "'backward_euler'")
        from .verlet import Verlet

        return Verlet(fields, model, forces, meter, options.substep, runtime, scene)
    from .system import System

    system = System(fields, model, meter.operator, forces, meter, options, runtime, scene, contacts)
    if name in ("backward_euler", "newton_euler"):
        from .backward_euler import BackwardEuler

        return BackwardEuler(system, options, converge=name == "newton_euler")
    from .tr_bdf2 import TRBDF2

    if name == "tr_bdf2" and contacts is None:
        return TRBDF2(fields, system, options, scene.gravity)
    from .backward_euler import BackwardEuler
    from .safe import Safe

    return Safe(system, TRBDF2(fields, system, options, scene.gravity), BackwardEuler(system, options),
                only_contact=name == "tr_bdf2")
