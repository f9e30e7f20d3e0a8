"""Time integrators, one file each, behind one interface.

An integrator is built once for a model and has

- `attempt(h, held_at, start) -> Attempt`: one step of size h [s] from the model's saved state, which the model's
  current state equals on entry; `held_at(s)` gives the constraints s seconds into it, and sets the wind there. `start`
  are the measures at its beginning. The model ends in the proposed state, also where the attempt names a rejection:
  rolling back is the stepper's.
- `commit()`: the last attempt was accepted. `reset()`: the state was changed by hand. `loosen()`: seams
  have opened; only methods that know seams.
- `checkpoint()`, `resume(state)`: its state kept from step to step, as arrays by name.
- `system`: the linear system that it solves, or None.
- `stable_step`: the largest step [s] that is stable near rest; infinite for implicit methods.

Methods with stages solved by Newton use the operator with their own c in M - c D - c^2 K.
"""

from ...backend.fields import Fields
from ...backend.runtime import Runtime
from ...errors import SceneError
from ...options import CG_TOL, EXPLICIT, NEWTON_TOL, Options
from ...scene.scene import Scene
from ...system.assembler import Assembler
from ...system.state import ParticleState


def build(name: str, fields: Fields, model: ParticleState, forces: list, meter: Assembler, options: Options, runtime: Runtime,
          scene: Scene, contacts=None):
    """The integrator of a name in `INTEGRATORS`; only its own modules are imported.

    Args:
        meter: with an operator, unless the method is explicit.
        contacts: `contact.contacts.Contacts` with the scene's solids, or None.

    Raises:
        SceneError: the method does not know contact, tears or seams.
    """
    if name in EXPLICIT:
        if contacts is not None:
            raise SceneError(f"integrator {name!r} knows no contact, with solids or between layers of cloth: use 'safe' or "
                             "'backward_euler'")
        torn = next((s.cloth.name for s in scene.seams if s.tears), None)
        if torn is not None:
            raise SceneError(f"integrator {name!r} solves no system, and cloth tears in one ({torn!r} may): use 'safe' or "
                             "'backward_euler'")
        if scene.seams:
            raise SceneError(f"integrator {name!r} solves no system, and seams are constraints of one: use 'safe' or "
                             "'backward_euler'")
        from .verlet import Verlet

        return Verlet(fields, model, forces, meter, options.substep, runtime, scene)
    from ..nonlinear.linear_system import System

    system = System(fields, model, meter.operator, forces, meter, options, runtime, scene, contacts)
    if name in ("backward_euler", "newton_euler"):
        from ..nonlinear.newton import FURTHER, PRELIMINARY, NewtonTolerance
        from .backward_euler import BackwardEuler

        first, others = (PRELIMINARY, FURTHER) if contacts is None else (CG_TOL, CG_TOL)  # on which contacts' states depend
        exact = NewtonTolerance(options.newton_tol or NEWTON_TOL, 0.0, first, others, CG_TOL)
        return BackwardEuler(system, options, exact if name == "newton_euler" else None)
    from .tr_bdf2 import TRBDF2

    if name == "tr_bdf2" and contacts is None and not scene.seams:
        return TRBDF2(fields, system, options, scene.gravity)
    from .safe import Safe

    accurate = TRBDF2(fields, system, options, scene.gravity)
    solved = contacts is not None and contacts.layers is None and options.contact_tol is not None
    if contacts is None or contacts.sprung or not (solved or name == "bdf2" or options.tolerance is not None):
        from .backward_euler import BackwardEuler

        return Safe(system, accurate, BackwardEuler(system, options), only_contact=name == "tr_bdf2")
    from .bdf2 import BDF2

    return Safe(system, accurate, BDF2(system, options, scene.gravity), only_contact=name == "tr_bdf2")
