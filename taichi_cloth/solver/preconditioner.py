"""Choice of the preconditioner of a solve; only its own modules are imported."""

from collections.abc import Callable

from ..backend.fields import Fields
from ..scene.scene import Scene
from ..system.operator import Operator

WORTH_LEVELS = 500  # particles from which on the multilevel one pays, where it is left to us


def build_preconditioner(name: str, fields: Fields, operator: Operator, scene: Scene, tell: Callable[[str], None]):
    """The preconditioner of a name in `options.PRECONDITIONERS`, or the next simpler one that can be made.

    Args:
        tell: takes a sentence about a preconditioner that cannot be made, now or later.
    """
    if name == "auto":
        name = "multilevel" if operator.model.n >= WORTH_LEVELS else "block_jacobi"
    if name == "multilevel":
        from .lattice import LatticeError
        from .multilevel import Multilevel

        try:
            return Multilevel(fields, operator, scene, tell)
        except LatticeError as error:
            name = "block_jacobi"
            tell(f"preconditioner: {error}, so that it is block_jacobi: solves may take longer")
    from .pointwise import Pointwise

    return Pointwise(fields, operator, name)
