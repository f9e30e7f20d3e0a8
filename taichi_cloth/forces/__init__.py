"""The forces that a scene needs; `force.Force` is the contract.

A force that no cloth asks for is not in the list, so it has no fields, and no kernel contains it. Forces that few scenes
need are imported where one does.
"""

from functools import partial
from typing import Any

from ..backend import compiler
from ..backend.fields import Fields
from ..errors import SceneError
from ..scene.scene import Scene
from ..system.state import ParticleState
from .bend import Bend
from .external import Drag, Gravity
from .force import Force
from .membrane import Membrane
from .pulls import Pulls


def build_forces(fields: Fields, model: ParticleState, scene: Scene, mode: str, substep: float | None = None) -> list[Force]:
    """The forces of a scene.

    Args:
        mode: K of the conditions, as `options.Options` has it.
        substep: explicit step [s] for which triangles are softened, see `Membrane`; None leaves them as they are.
    """
    bends = [f.bend.model for c in scene.cloths if c.whole.has_hinges for f in c.fabrics if f.bend]
    kinds: list[Any] = []
    if any(f.stretch or f.shear for c in scene.cloths for f in c.fabrics):
        kinds.append(partial(Membrane, substep=substep))
    if any(bend == "hinge" for bend in bends):
        kinds.append(Bend)
    if any(bend == "curvature" for bend in bends):
        from .curvature_bend import CurvatureBend

        kinds.append(CurvatureBend)
    if scene.gravity.any():
        kinds.append(Gravity)
    if scene.air is not None and scene.air.local:
        from .local_drag import LocalDrag

        kinds.append(LocalDrag)
    elif scene.air is not None:
        kinds.append(Drag)
    return [kind(fields, model, scene, mode) for kind in kinds + _from_outside(scene)]


def _from_outside(scene: Scene) -> list:
    """Kinds of forces that are no fabric's."""
    kinds: list[Any] = []
    if scene.script.bears:
        from .loads import Loads

        kinds.append(Loads)
    if pulled_softly(scene):
        kinds.append(Pulls)
    if any(s.pulls.any() for s in scene.seams):
        from .closing import Closing

        kinds.append(Closing)
    kinds += [_spoken(kind) for kind in scene.forces]
    if scene.pieces:
        from .gas import Gas

        kinds.append(Gas)
    return kinds


def _spoken(kind: Any) -> Any:
    """A kind of force of the user's own, which must be written in the language of the compiler that runs."""
    made = getattr(kind, "func", kind)
    other = compiler.foreign(made) if isinstance(made, type) else ""
    if other:
        raise SceneError(f"{made.__name__}: is written in {other}'s language, and {compiler.chosen().name} compiles the "
                         f"kernels: write `from taichi_cloth import ti` instead of `import {other} as ti`")
    return kind


def pulled_softly(scene: Scene) -> bool:
    """Whether anything is attached softly, or may be by an event."""
    script = scene.script
    may = scene.solids or any(c.mesh.weights for c in scene.cloths)
    return any(a.stiffness is not None for a in script.attachments) or bool(script.events and may)
