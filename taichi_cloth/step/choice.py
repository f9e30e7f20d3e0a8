"""Which method "auto" stands for: explicit where that is stable at no more substeps than a solve costs."""

import math

from ..scene.scene import Scene

SAFETY = 0.9  # part of the stable step that explicit ones take
SUBSTEPS = 150  # in a step, up to which explicit ones cost less than TR-BDF2's solves (swing, 26 to 101 squared: 133 to 213)
ACCURATE = 4  # times as many where the error asked for is small: explicit ones have it without asking
EXPLICIT_ERROR = 1e-3  # m: and so is this small
FINEST = 1e-4  # m: explicit steps estimate no error, so that a smaller one is not theirs to promise


def choose(forces: list, scene: Scene, h: float, tolerance: float | None, adaptive: bool) -> tuple[str, str]:
    """(the method that "auto" stands for, why): explicit where it is stable at no more substeps than a solve costs.

    Args:
        h: step asked for [s]; tolerance: error asked for [m], or None.
    """
    if scene.touches:
        return "safe", "the scene has contact, which explicit methods do not know"
    if scene.seams:
        return "safe", "the scene has seams, which explicit methods do not know"
    if any(inflation.gas != "constant" for inflation in scene.script.inflations):
        return "safe", "the scene has gas whose pressure depends on its volume, which explicit methods do not know"
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
