"""Which preconditioner a solve has; only what it needs is imported."""

from ..backend.fields import Fields
from ..scene.scene import Scene
from ..system.operator import Operator

WORTH_LEVELS = 500  # particles from which on the multilevel one pays, where it is left to us


def build_preconditioner(name: str, fields: Fields, operator: Operator, scene: Scene):
    """The preconditioner of a name in `options.PRECONDITIONERS`."""
    if name == "auto":
        name = "multilevel" if operator.model.n >= WORTH_LEVELS else "block_jacobi"
    if name == "multilevel":
        from .multilevel import Multilevel

        return Multilevel(fields, operator, scene)
    from .pointwise import Pointwise

    return Pointwise(fields, operator, name)
