"""Time integrators, one file each, behind one interface.

An integrator is built once for a model and has

- `attempt(h, held, start) -> Attempt`: one step of size h [s] from the model's saved state, which the model's
  current state equals on entry; `held` are the constraints at its end, `start` the measures at its beginning.
  The model ends in the proposed state, also where the attempt names a rejection: rolling back is the stepper's.
- `commit()`: the last attempt was accepted.
- `checkpoint()`, `resume(state)`: what it remembers from step to step, as arrays by name.
- `operator`, `solver`: what it solves with, or None.
- `stable_step`: the largest step [s] that is stable near rest; infinite for implicit methods.

Methods with stages solved by Newton use the operator with their own c in M - c D - c^2 K.
"""

from collections.abc import Callable
from dataclasses import dataclass

from ..fields import Fields
from ..measure import Measures, Meter
from ..model import Model
from ..runtime import Runtime
from ..scene import Scene
from ..solver.pcg import Solution

STRETCH, ENERGY, SOLVER, NOT_FINITE = "STRETCH", "ENERGY", "SOLVER", "NOT_FINITE"
CONTACT, APPROACH = "CONTACT", "APPROACH"


@dataclass(frozen=True)
class Options:
    """What a user may choose about a step.

    Attributes:
        K: which stiffness, see `forces.conditions`.
        cg_tol: relative residual at which a solve stops.
        cg_max_iterations: of one solve.
        preconditioner: "block_jacobi" or "multilevel".
        newton_max: further solves that a step may take when it fails the energy test.
    """

    K: str = "projected"
    cg_tol: float = 1e-6
    cg_max_iterations: int = 10_000
    newton_max: int = 8
    preconditioner: str = "block_jacobi"


@dataclass(frozen=True)
class Attempt:
    """A proposed step.

    Attributes:
        rejection: None, or what is wrong with it.
        detail: more about the rejection, for people.
        measures: of the proposed state; None where it was not reached.
        solutions: of its linear solves, in order.
        seconds: wall time by part, EVAL, CG and C-S.
        contacts: number of contacts with solids; unsettled: how many of them had not settled their state.
        crossings: triangles of cloth and solids that pass through each other.
    """

    rejection: str | None
    detail: str
    measures: Measures | None
    solutions: tuple[Solution, ...]
    seconds: dict[str, float]
    contacts: int = 0
    unsettled: int = 0
    crossings: int = 0


def build(name: str, fields: Fields, model: Model, forces: list, meter: Meter, options: Options, runtime: Runtime,
          scene: Scene, contacts=None):
    """The integrator of a name in `INTEGRATORS`; only its own file is imported.

    Args:
        contacts: `contact.response.Contacts` with the scene's solids, or None.
    """
    return _builders()[name](fields, model, forces, meter, options, runtime, scene, contacts)


INTEGRATORS = ("backward_euler", "symplectic_euler")


def _builders() -> dict[str, Callable]:
    def backward_euler(*args):
        from .backward_euler import BackwardEuler
        return BackwardEuler(*args)

    def symplectic_euler(*args):
        from .symplectic_euler import SymplecticEuler
        return SymplecticEuler(*args)

    return {"backward_euler": backward_euler, "symplectic_euler": symplectic_euler}


