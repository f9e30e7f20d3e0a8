"""The contract of a force: energy, force, linearization and products, as a class."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any

import numpy as np

from ..backend.language import ti
from ..renamed import old_names, take_over
from ..scene.attachment import Script


@old_names
class Force(ABC):
    """A force on a model's particles: its energy, its part of eq. (18), and the traits that other parts of a step rely on.

    Make subclasses `ti.data_oriented`. Methods with a `block` are Taichi functions that work on the rows of one block. A
    force is made with (fields, model, scene, K), see `forces.build_forces`; fields that a step changes and that have to be
    saved, rolled back and resumed are declared with `ParticleState.remember`.

    Attributes:
        energies: names of its energy terms; empty for a force without energy.
        extremes: number of columns at the end of its report: 0, 2 (largest stretch and its change) or 3 (also the largest used
            part of a limit of strain).
        stiff: whether `build_stiffness` was called.
        rates: bounds at rest on the squared frequency [1/s^2] and the damping rate [1/s] of any mode, for explicit steps.
        multirate: whether explicit methods may evaluate it once in several substeps.
        time_dependent: whether it changes with time by itself.
        interpolated_wind: whether only its `wind` changes, which explicit methods interpolate linearly over a step.
        stiffens_sharply: whether its stiffness can grow many times over within a step, as at a limit of strain.
        of_contact: whether its elements come and go with contact.
        attached: (k, 3) particle, stiffness [N/m] and largest force [N] of its soft attachments; None if it never has any.
        low_rank: whether its matrix has a part of low rank, whose product takes sums over all of the cloth: `sum_up`,
            `add_low_rank`.
        dead_load: whether it has no derivative, and so is in b alone: no product and no level takes it.
        time_dependent_energy: whether its energy changes with time by itself.
        indefinite: whether the matrix has a part of it that may not be semidefinite, see `leave_out`.
        notes: sentences for the user, found when it was made.
    """

    energies: tuple[str, ...] = ()
    extremes: int = 0
    stiff: bool = False
    rates: tuple[float, ...] = (0.0, 0.0)
    multirate: bool = False
    time_dependent: bool = False
    interpolated_wind: bool = False
    stiffens_sharply: bool = False
    of_contact: bool = False
    attached: np.ndarray | None = None
    low_rank: bool = False
    dead_load: bool = False
    time_dependent_energy: bool = False
    indefinite: bool = False
    notes: Sequence[str] = ()

    def __init_subclass__(cls) -> None:
        take_over(cls, "Force")

    @classmethod
    def does(cls, method: str) -> bool:
        """Whether a method that does nothing in this contract does something here; else it need not be called."""
        return getattr(cls, method) is not getattr(Force, method)

    @property
    def follows_steps(self) -> bool:
        """Whether `accept` may change it in this scene; else it is not called."""
        return self.does("accept")

    @abstractmethod
    def rounding_energy(self, d: float) -> float:
        """Energy [J] that positions off by d [m] put into the rest shape."""

    @abstractmethod
    def build_stiffness(self) -> None:
        """Allocates the fields that only implicit steps need, and sets `stiff`."""

    @abstractmethod
    def add_force(self, block, f):
        """f += its force at the model's x and v."""

    @abstractmethod
    def evaluate(self, block, linearizes, moves, c, to, base, report, dtype):
        """Measures the force on the rows of a block, and linearizes it on request.

        Writes into columns of the report from `base`: its energies [J], half the power it dissipates [W], the rate at which
        its energies grow [W], and its `extremes`. A force without energies has the power that it takes in place of the rate.

        With `linearizes`, for an `Operator` `to`: b += c f, or c (f + K `to.rhs_displacement`) with `moves`. It
        then keeps the block of -c D - c^2 K, and adds its diagonal to P.

        Where the model's `over` is not 0, damping is an energy of a step of so many seconds: k_d/(2 over) (C - C_0)^2, C_0 of
        the saved state, kept at the first call in such a step, the one with `moves`. Else, and for forces without a condition
        C, it goes by velocities.
        """

    @abstractmethod
    def add_product(self, block, p, q):
        """q += (-c D - c^2 K) p, symmetric and linear in p."""

    @abstractmethod
    def build_levels(self, levels) -> None:
        """Prepares the tables of `add_level_block`; `levels` is a `solver.hierarchy.LevelFields`."""

    @abstractmethod
    def add_level_block(self, n, c, D, levels):
        """D, 6 numbers, plus the block of node n of the preconditioner's levels: s^T (-c D - c^2 K) s, s the node's hat."""

    def prepare(self, motion=None) -> None:  # noqa: B027 (the following methods are empty for most forces)
        """Computes global quantities, such as the volume of a gas, at the model's x and v, before `add_force` and `evaluate`.

        Args:
            motion: (n, 3) field [m] that `evaluate` applies K to, if it does.
        """

    def sum_up(self, block, p):  # noqa: B027
        """The block's parts of the sums over all of p that the product takes."""

    def gather(self):  # noqa: B027
        """After `sum_up` of all blocks, at the top of a kernel: adds these parts up where one thread would take long to."""

    def add_low_rank(self, block, q):  # noqa: B027
        """q += the part of these sums on the rows of a block, the part of low rank in (-c D - c^2 K) p."""

    def leave_out(self, part: bool) -> None:  # noqa: B027
        """Leaves the part that may be indefinite out of the matrix, or not, from the next linearization on."""

    def change_beside(self, led: np.ndarray) -> float:
        """Change of the largest stretch in its report, over the elements with no corner among the particles `led` (n,)."""
        return 0.0

    def set_time(self, t: float) -> None:  # noqa: B027
        """Sets prescribed functions of time, such as wind or pressure, to their values at t [s]."""

    def geometry(self) -> dict[str, np.ndarray]:
        """Arrays by name that a recording keeps, from which `quantities` are computed."""
        return {}

    def led(self, before: float, part: float) -> float:
        """Work [J] that prescribed motion put into its energy in a step, from the model's saved state to the current one.

        Args:
            before: energy with which the step began [J].
            part: weight of the end of the step against its beginning.
        """
        return 0.0

    def follow(self, script: Script) -> None:  # noqa: B027
        """From now on the force is as this script says, which events change."""

    def record(self) -> dict[str, tuple[float, float]]:
        """Volume [m^3] and pressure [Pa] of gas by name, for the step's record."""
        return {}

    def recorded(self) -> dict[str, np.ndarray]:
        """Arrays of its internal variables by name, kept with every frame."""
        return {}

    def accept(self, h: float) -> bool:
        """A step of h [s] was accepted; True where the force has changed by that."""
        return False

    def release(self, whole: np.ndarray, pulled: np.ndarray) -> None:  # noqa: B027 (most forces know no stitches)
        """Only the stitches (k,) of the scene's seams that are whole hold anything from now on; others are pulled together,
        with so many times their pull."""


class ElementForce(Force):
    """A force whose part of the preconditioner's levels is summed up element by element.

    Attributes:
        elements: `system.state.Elements`.
        meets: for each node the elements that its hat meets.
    """

    elements: Any

    def build_levels(self, levels) -> None:
        """See `Force`."""
        self.meets = levels.meeting(self.elements)

    @ti.func
    def add_level_block(self, n, c, D, levels: ti.template()):
        """D + s^T (-c D - c^2 K) s of the elements that node n's hat meets."""
        out = D
        for k in range(self.meets.first[n], self.meets.first[n + 1]):
            out += self.level_block(self.meets.source[k], n, levels)
        return out

    @abstractmethod
    def level_block(self, e, n, levels):
        """Element e's part of it, 6 numbers."""
