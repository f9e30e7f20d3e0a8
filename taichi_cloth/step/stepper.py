"""Step size control: proposes h, judges attempts, rolls back. [BW98 §6]"""

import json
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from functools import partial

from .. import checks
from ..backend.timing import compiling
from ..errors import SceneError, SimulationError
from ..options import LONGEST, SHORTEST
from ..system.assembler import Assembler, Measures
from ..system.checkpoint import Checkpointed
from ..system.state import ParticleState
from .attempt import ACCURACY, APPROACH, CONTACT, ENERGY, NEWTON, NOT_FINITE, SOLVER, STRETCH, Attempt
from .records import Locator, StepRecord, Trouble

CAREFUL = 0.9  # safety factor of error control
SLOW = 4  # steps with so many solves, or more, are recorded in `troubles` with their worst vertex
PARTS = ("EVAL", "CG", "C-C", "C-S")  # [BW98 table 1]: forces and matrix, solve, cloth-cloth, cloth-solid contact
ADVICE = {
    STRETCH: "some triangle stretches too much in one step: slow the motion down, or raise stretch_limit",
    ENERGY: "steps gained energy, or did not lower the incremental potential, and were taken smaller: allow smaller ones, or "
            "more solves with newton_max; where it gives up at the start, look for collapsed or inverted cloth",
    SOLVER: "the linear solve does not converge: raise cg_max_iterations or cg_tol, use K='projected', or precision "
            "'f64'",
    NEWTON: "Newton's method does not converge: raise newton_max or newton_tol, or use the integrator 'safe'",
    ACCURACY: "no step is as accurate as asked for: raise tolerance, or h_min is too large; f32 has no digits to spare",
    CONTACT: "cloth would end inside a solid or in other cloth, or contacts do not settle: is it pinched between solids, "
             "pinned inside one, or pressed through itself?",
    APPROACH: "cloth meets a solid faster than its mesh can follow: slow the motion down, or use a coarser mesh",
    NOT_FINITE: "numbers overflow: a stiffness, mass or prescribed motion is out of scale; try precision 'f64'",
}


@dataclass(frozen=True)
class Control:
    """How step size follows the motion.

    Attributes:
        h_max, h_min: bounds [s].
        adaptive: False does exactly the steps asked for and reports their failures.
        stretch_limit: largest change of any triangle's stretch |w|/b in a step.
        quiet_steps: accepted steps after which h doubles again.

    Raises:
        SceneError: an impossible value.
    """

    h_max: float
    h_min: float
    adaptive: bool = True
    stretch_limit: float = 0.5
    quiet_steps: int = 4

    def __post_init__(self) -> None:
        checks.number("h", self.h_max, "s", least=SHORTEST, most=LONGEST)
        checks.number("h_min", self.h_min, "s", positive=True)
        if self.h_min > self.h_max:
            raise SceneError(f"h_min = {self.h_min:g} s: must be at most h = {self.h_max:g} s")
        checks.number("stretch_limit", self.stretch_limit, positive=True)
        checks.flag("adaptive", self.adaptive)


class Stepper(Checkpointed):
    """Advances the state with an integrator; rejected steps are repeated with a smaller h."""

    STATE = ("h", "quiet", "measured", "last", "dropped")

    def __init__(self, model: ParticleState, integrator, meter: Assembler, control: Control,
                 locator: Locator | None = None, stitch_failure=None) -> None:
        self.model, self.integrator, self.meter, self.control, self.locator = model, integrator, meter, control, locator
        self._accepting = [force for force in meter.forces if force.follows_steps]
        self._recording = [force for force in meter.forces if force.does("record")]
        self.stitch_failure = stitch_failure  # a `stitch_failure.StitchFailure` where anything is sewn
        self.h = control.h_max
        self.quiet = 0
        self.start: Measures | None = None  # measures where the next step starts; None: to be measured
        self.ended: Measures | None = None  # where the last step ended
        self.dropped = 0.0  # energy [J] of contacts that `forget` took away since the last step
        self.advise: Callable[[str], str] = ADVICE.__getitem__  # a remedy, by the name of the last rejection
        self.edited = 0.0, 0.0  # kinetic and potential energy [J] that came between the last step and the next

    def pull_firmer(self, factor: float) -> None:
        """Multiplies the force that closes open seams."""
        if self.stitch_failure is not None:
            self.stitch_failure.pull_firmer(factor)
            self.forget()

    def forget(self, contacts: bool = True) -> None:
        """To be called when the state, or a force on it, was changed between steps: energies are measured anew.

        Args:
            contacts: whether those of the last step still are.
        """
        self.start = None
        if not contacts and self.ended is not None:
            energies = dict(self.ended.energies)
            self.dropped += energies.pop("contact", 0.0)
            self.ended = replace(self.ended, energies=energies)

    def step(self, t: float, h_wanted: float, held_at) -> StepRecord:
        """One accepted step from time t, of `h_wanted` or of the control's h where that is less.

        Args:
            held_at: function of time [s] and step [s] that gives the constraints at the end of that step.

        Raises:
            SimulationError: no step of at least h_min passes; the model is back where it was.
        """
        control = self.control
        h = min(h_wanted, self.h) if control.adaptive else h_wanted
        rejections: dict[str, int] = {}
        troubles: list[Trouble] = []
        seconds = dict.fromkeys(PARTS, 0.0)
        began, compiled = time.perf_counter(), compiling.seconds
        while True:
            self.model.save()
            if self.start is None:
                self._begin(t)
            assert self.start is not None
            attempt = self.integrator.attempt(h, partial(held_at, t), self.start)
            for name, value in attempt.seconds.items():
                seconds[name] += value
            rejection = self.judge(attempt)
            if self.locator is not None and (rejection is not None or len(attempt.solutions) >= SLOW):
                troubles.append(self.locator.find(rejection or "", h, attempt.detail, attempt.place, held_at(t, h)))
            passes = rejection is None or (not control.adaptive and attempt.measures is not None
                                           and attempt.measures.finite)
            if passes and self.stitch_failure is not None and self.stitch_failure.open_overloaded():
                self.start = self._measured(t)  # a stitch broke: again with it open, from the start, which is restored
                continue
            if passes:
                seconds |= {"total": time.perf_counter() - began, "compiling": compiling.seconds - compiled}
                return self._accept(t, h, attempt, rejection, rejections, seconds, troubles)
            assert rejection is not None
            self.model.restore()
            rejections[rejection] = rejections.get(rejection, 0) + 1
            if self.stitch_failure is not None and self.stitch_failure.take_back():
                self.start = self._measured(t)
            if not control.adaptive or h / 2 < control.h_min:
                raise SimulationError(self._gave_up(t, h, rejection, attempt, rejections, troubles), rejection, t)
            smaller = 0.5 if rejection != ACCURACY else _step_factor(attempt, 0.1, 0.7)
            h = self.h = max(h * smaller, control.h_min)
            self.quiet = 0

    def _begin(self, t: float) -> None:
        """Measures a state that was changed between steps, or is a run's first; that change of energy is not the step's."""
        now, before = self._measured(t), self.ended
        if before is not None:
            kinetic = now.energies["kinetic"] - before.energies["kinetic"]
            self.edited = kinetic, now.potential - before.potential - self.dropped
        self.start, self.dropped = now, 0.0

    def _measured(self, t: float) -> Measures:
        """Measures of the state at the start of a step, at t [s]; the energy between layers is kept.

        Raises:
            SimulationError: it is not finite.
        """
        for force in self.meter.forces:
            force.set_time(t)
        made, before = self.meter.measure(), self.start or self.ended
        if not made.finite:
            raise SimulationError(f"the state at t = {t:g} s is not finite", NOT_FINITE, t)
        if before is not None and "contact" in before.energies:
            made = replace(made, energies={**made.energies, "contact": before.energies["contact"]})
        return made

    @property
    def measured(self) -> str:
        """`start`, as it was computed."""
        return _to_json(self.start)

    @measured.setter
    def measured(self, text: str) -> None:
        self.start = _from_json(text)

    @property
    def last(self) -> str:
        """`ended`, as it was computed."""
        return _to_json(self.ended)

    @last.setter
    def last(self, text: str) -> None:
        self.ended = _from_json(text)

    def judge(self, attempt: Attempt) -> str | None:
        """The name of the reason to reject an attempt, or None."""
        if attempt.rejection is not None:
            return attempt.rejection
        limit = self.control.stretch_limit
        if attempt.measures is None or attempt.measures.stretch_change <= limit:
            return None
        if attempt.led is not None and self.meter.change_beside(attempt.led) <= limit:
            return None  # closing solids move these vertices: a smaller step would stretch as much
        return STRETCH

    def _accept(self, t: float, h: float, attempt: Attempt, rejection: str | None, rejections: dict[str, int],
                seconds: dict[str, float], troubles: list[Trouble]) -> StepRecord:
        measures = attempt.measures
        assert measures is not None
        ledger, taken = attempt.ledger, 0.0
        failure = self.stitch_failure
        torn, opened, intersections = (0.0, 0, attempt.known_intersections) if failure is None else failure.commit()
        if torn and ledger is not None:
            ledger = replace(ledger, potential=ledger.potential - torn, torn=torn)
        changed = [force.accept(h) for force in self._accepting]  # each is asked
        changed.append(self.stitch_failure is not None and self.stitch_failure.join())
        if any(changed):
            before, now = measures, self.meter.measure()
            taken = before.potential - before.energies.get("contact", 0.0) - now.potential
            measures = replace(now, energies={**before.energies, **now.energies})
            if ledger is not None:
                ledger = replace(ledger, potential=ledger.potential - taken, plastic=taken)
        self.integrator.commit(taken)
        if ledger is not None and any(self.edited):
            kinetic, potential = self.edited
            ledger = replace(ledger, kinetic=ledger.kinetic + kinetic, potential=ledger.potential + potential,
                             edited=kinetic + potential)
        self.start, self.ended, self.edited = measures, measures, (0.0, 0.0)
        self.quiet += 1
        if attempt.error is not None:
            self.h = min(h * _step_factor(attempt, 0.3, 2.0), self.control.h_max)
        elif self.quiet >= self.control.quiet_steps and self.h < self.control.h_max:
            self.h, self.quiet = min(2 * self.h, self.control.h_max), 0
        worst = max((s for s in attempt.solutions if not s.preliminary), key=lambda s: s.residual, default=None)
        status = rejection or (worst.status if worst else "EXPLICIT")
        if rejection == SOLVER:
            status = attempt.detail
        return StepRecord(t + h, h, sum(s.iterations for s in attempt.solutions), len(attempt.solutions),
                          worst.residual if worst else 0.0, status, rejections, measures.energies, measures.stretch,
                          seconds, attempt.contacts, attempt.unconverged_contacts, attempt.solid_intersections,
                          attempt.evaluations, attempt.error or 0.0, attempt.fallback_reason, attempt.layers,
                          attempt.min_gap_ratio, intersections, attempt.pinched, opened=opened,
                          ledger={} if ledger is None else ledger.record(),
                          gas={k: v for force in self._recording for k, v in force.record().items()},
                          troubles=tuple(troubles), contact_error=attempt.contact_error)

    def _gave_up(self, t: float, h: float, rejection: str, attempt: Attempt, rejections: dict[str, int],
                 troubles: list[Trouble]) -> str:
        detail = "; ".join(([attempt.detail] if attempt.detail else []) + [f"worst at {place}" for place in troubles[-1:]])
        detail = f" ({detail})" if detail else ""
        if not self.control.adaptive:
            return f"step of {h:g} s from t = {t:g} s failed with {rejection}{detail}: {self.advise(rejection)}"
        counts = ", ".join(f"{name} {count}" for name, count in rejections.items())
        return (f"gave up at t = {t:g} s: no step of at least h_min = {self.control.h_min:g} s passes; last rejection "
                f"{rejection}{detail} at h = {h:g} s, in all {counts}. {self.advise(rejection)}")


def _to_json(measures: Measures | None) -> str:
    return json.dumps(None if measures is None else asdict(measures))


def _from_json(text: str) -> Measures | None:
    made = json.loads(text)
    return None if made is None else Measures(**made)


def _step_factor(attempt: Attempt, least: float, most: float) -> float:
    """Ratio of the next step to this one at which its error is the error allowed."""
    error = attempt.error if attempt.error is not None else 0.0
    return min(most, max(least, CAREFUL * max(error, 1e-30) ** (-1 / attempt.order)))
