"""The force contract, and the forces that a scene needs.

A force is a data-oriented object whose functions work on one block of rows at a time:

- `energies`: names of its energy terms; `extremes`: how many columns of the report after them are maxima.
- `rates`: bounds at rest on the squared frequency [1/s^2] and the damping rate [1/s] of any mode, for explicit steps.
- `rounding_energy(d)`: energy [J] that positions off by d [m] put into the rest shape.
- `build_stiffness()`: allocates what only implicit steps need; `stiff` says whether that was done.
- `add_force(block, f)`: f += its force at the model's x and v.
- `evaluate(block, linearizes, moves, c, to, base, report, dtype)`: its energy terms [J], half the power it dissipates [W],
  the rate at which its energies grow (the power that it takes where it has none) [W] and its extremes into columns of the
  report, from column `base`. With `linearizes`, of an `Operator` `to`: b += c f, with
  `moves` c (f + K motion); keeps the block of -c D - c^2 K, adds its diagonal to P.
- `add_product(block, p, q)`: q += (-c D - c^2 K) p. Symmetric and linear in p.

A force that no cloth asks for is not in the list, so it has no fields, and no kernel contains it.
"""

from functools import partial

from ..backend.fields import Fields
from ..scene.scene import Scene
from ..system.state import Model
from .bend import Bend
from .curvature_bend import CurvatureBend
from .external import Drag, Gravity
from .membrane import Membrane


def build_forces(fields: Fields, model: Model, scene: Scene, mode: str, substep: float | None = None) -> list:
    """The forces of a scene.

    Args:
        mode: K of the conditions, as `options.Options` has it.
        substep: explicit step [s] for which triangles are softened, see `Membrane`; None leaves them as they are.
    """
    bends = [c.fabric.bend.model for c in scene.cloths if c.fabric.bend and c.mesh.has_hinges]
    wanted = (
        (partial(Membrane, substep=substep), any(c.fabric.stretch or c.fabric.shear for c in scene.cloths)),
        (Bend, any(bend == "hinge" for bend in bends)),
        (CurvatureBend, any(bend == "curvature" for bend in bends)),
        (Gravity, bool(scene.gravity.any())),
        (Drag, scene.air is not None),
    )
    return [kind(fields, model, scene, mode) for kind, needed in wanted if needed]
