"""Refused attempts at steps in plain words: why each was refused, whether there are many of them, remedies."""

from ..step.attempt import ACCURACY, APPROACH, CONTACT, ENERGY, NEWTON, NOT_FINITE, SOLVER, STRETCH, TOUCH
from ..step.stepper import ADVICE

NOTHING = ": there is nothing to do"
FEW, SMALLER = 0.1, 16  # part of all attempts that are usually refused; times that a step is made smaller for it
MEANS = {
    STRETCH: "a triangle would stretch by more than stretch_limit in one step",
    ENERGY: "the step would gain energy",
    SOLVER: "a linear solve did not converge",
    NEWTON: "forces were not yet in balance",
    ACCURACY: "the estimated error was more than tolerance allows",
    CONTACT: "contacts did not settle",
    APPROACH: "cloth would come nearer to a solid than its mesh can follow",
    NOT_FINITE: "numbers overflowed",
}
ENDS = (("too deep", "cloth would end too deep inside a solid"), ("after further solves", "cloth would end inside a solid"),
        ("crossings", "cloth would pass through a solid"), ("points of contact", "contact would need more room in memory"),
        ("between layers", "layers of cloth found no step without a collision"))  # of CONTACT, by a word of its detail
IN_CONTACT = "contact_tol could not be reached: expected where cloth hits something; a larger one is reached sooner"


def meaning(name: str, detail: str) -> str:
    """The reason of a rejection, by its name and its detail."""
    ends = ENDS if name == CONTACT else ()
    return next((end for word, end in ends if word in detail), MEANS.get(name, name))


def why_refused(name: str, detail: str) -> str:
    """The reason of a rejection, by its name and its detail, and the name behind it."""
    means = meaning(name, detail)
    told = name != CONTACT or means in (MEANS[CONTACT], ENDS[3][1], ENDS[4][1])
    return f"{means} ({name}{f'; {detail}' if detail and told else ''})"


def fell_back(reason: str) -> str:
    """Why a step was made by BDF2 or backward Euler in place of TR-BDF2."""
    if reason == TOUCH:
        return "cloth touches something, is being sewn or tears"
    return f"in the usual one {MEANS[reason]} ({reason})" if reason in MEANS else reason


def remedy(name: str, touches: bool) -> str:
    """What helps against many rejections of a name; touches: whether all of them were beside a solid or other cloth."""
    return IN_CONTACT if name == NEWTON and touches else ADVICE[name]


def usual(rejected: int, steps: int, smallest: float, largest: float) -> bool:
    """Whether so many refused attempts, for so many steps between these sizes [s], are no reason to change anything."""
    return rejected == 0 or (rejected <= FEW * (rejected + steps) and SMALLER * smallest >= largest)


def refused(rejected: int, steps: int, smallest: float, largest: float) -> str:
    """A sentence on refused attempts, and whether there is anything to do; see `usual`."""
    if not rejected:
        return "no attempt at a step was refused"
    said = f"{rejected} of {rejected + steps} attempts at a step {'was' if rejected == 1 else 'were'} refused and made smaller"
    if usual(rejected, steps, smallest, largest):
        return f"{said}, as is usual{NOTHING}"
    return f"{said}, down to {1e3 * smallest:.3g} ms"
