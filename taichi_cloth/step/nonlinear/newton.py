"""Newton's method with line search, on any `StepProblem`."""

from ...system.assembler import Measures
from ..attempt import NOT_FINITE
from .problem import Outcome, StepProblem

HALVINGS = 9  # of a Newton step; one that helps at no size is left there: an exact fold needs that little to find a side


def minimize(problem: StepProblem, most: int) -> Outcome:
    """Solves a problem from where the model is; the model is left in the solution, or where the method stopped.

    Args:
        most: Newton steps.
    """
    for k in range(most):
        outcome = problem.solve(k)
        if outcome is not None:
            return outcome
        part, measures = line_search(problem, k)
        if not measures.finite:
            return Outcome(NOT_FINITE, f"Newton step {k + 1}", measures)
        outcome = problem.judge(k, part, measures)
        if outcome is not None:
            return outcome
        problem.before = measures
    return problem.give_up(problem.before)


def line_search(problem: StepProblem, k: int) -> tuple[float, Measures]:
    """Takes a Newton step as far as nothing collides and the problem accepts: (part of it, measures there)."""
    part, taken = problem.advance(k), 1.0
    for halving in range(HALVINGS + 1):
        if part < taken:
            problem.shift(k, part, taken)
            taken = part
        measures = problem.measure(k)
        if halving == HALVINGS or problem.acceptable(k, part, measures):
            break
        part /= 2
    return part, measures
