"""What a user may choose about a step."""

from dataclasses import dataclass

from .. import checks
from ..forces.conditions import K_MODES
from ..solver.preconditioner import PRECONDITIONERS

CG_TOL = 1e-4  # relative residual of the paper's single solve, where none is asked for
NEWTON_TOL = 1e-4  # m, where none is asked for
TANGLES = ("untangle", "ignore", "abort")
CONTACTS = ("repulsion", "springs")
INTEGRATORS = ("auto", "safe", "tr_bdf2", "backward_euler", "newton_euler", "verlet")
EXPLICIT = ("verlet",)


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
