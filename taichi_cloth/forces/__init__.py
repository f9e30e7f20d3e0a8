"""The forces that a scene needs; `force.Force` is the contract.

A force that no cloth asks for is not in the list, so it has no fields, and no kernel contains it.
"""

from functools import partial

from ..backend.fields import Fields
from ..scene.scene import Scene
from ..system.state import ParticleState
from .bend import Bend
from .closing import Closing
from .curvature_bend import CurvatureBend
from .external import Drag, Gravity
from .force import Force
from .loads import Loads
from .local_drag import LocalDrag
from .membrane import Membrane
from .pulls import Pulls


def build_forces(fields: Fields, model: ParticleState, scene: Scene, mode: str, substep: float | None = None) -> list[Force]:
    """The forces of a scene.

    Args:
        mode: K of the conditions, as `options.Options` has it.
        substep: explicit step [s] for which triangles are softened, see `Membrane`; None leaves them as they are.
    """
    bends = [f.bend.model for c in scene.cloths if c.whole.has_hinges for f in c.fabrics if f.bend]
    wanted = (
        (partial(Membrane, substep=substep), any(f.stretch or f.shear for c in scene.cloths for f in c.fabrics)),
        (Bend, any(bend == "hinge" for bend in bends)),
        (CurvatureBend, any(bend == "curvature" for bend in bends)),
        (Gravity, bool(scene.gravity.any())),
        (Drag, scene.air is not None and not scene.air.local),
        (LocalDrag, scene.air is not None and scene.air.local),
        (Loads, scene.script.bears),
        (Pulls, _pulls(scene)),
        (Closing, any(s.pulls.any() for s in scene.seams)),
    )
    kinds = [kind for kind, needed in wanted if needed] + scene.forces
    if scene.pieces:
        from .gas import Gas

        kinds.append(Gas)
    return [kind(fields, model, scene, mode) for kind in kinds]


def _pulls(scene: Scene) -> bool:
    """Whether anything is attached softly, or may be by an event."""
    script = scene.script
    return any(a.stiffness is not None for a in script.attachments) or bool(script.events and scene.solids)
