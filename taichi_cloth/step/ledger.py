"""Energy, step by step: work put in, losses, and the change that nothing accounts for. numpy only.

Exactly, whatever made the step, T_1 - T_0 = u . M dv with u = (v_0 + v_1)/2. A method sets M dv = sum_i w_i F_i, with
forces F_i = -dV + damping + air + held + contact + r at its stages i. r is the residual of its solves. Then

    dE = T_1 - T_0 + V_1 - V_0 = sum_i w_i F_i . v_i - [sum_i w_i F_i . (v_i - u)] + V_1 - V_0
       = work of constraints, of contact and of air - damping - method + sum_i w_i r_i . v_i,
    method = sum_i w_i F_i . (v_i - u) + [sum_i w_i dV_i . v_i - (V_1 - V_0)]

`method` is the loss by the method's velocities and by the curvature of V in a step. The change unaccounted for is
the work of the residuals, and rounding. Backward Euler has one stage, w = h, at the end: there the first part
of `method` is 1/2 |dv|_M^2. It also alters positions by y, without motion: x_1 = x_0 + h v_1 + y. Only V is altered with
them, damping and friction go by v. The alteration puts dV . y in, and the second part of `method` has it too, so neither
is negative where V is convex. If damping is an energy of the step, its force k_d (C - C_0)/h dC works along the change of C:
`damping` is k_d (C - C_0)^2/h. `method` has the excess of h C_dot over that change.
"""

from dataclasses import asdict, dataclass, fields, replace

from ..renamed import LedgerTerms
from ..system.assembler import Measures


@dataclass(frozen=True)
class Work:
    """Work on the cloth in a step [J].

    Attributes:
        attachments: of places on solids on particles attached softly to them, letting go included.
        pins: of pins and motions of a script, and of seams while they close.
        solids: of solids: by the particles they hold, static friction, and their edges and corners.
        pushed_out: of alterations of position (y) that push particles out of solids.
        pulled_down: of those that pull particles down to a solid that they would pass: their motion has to pay for this work.
        friction: of friction of cloth that slides on solids.
        layers: of cloth on cloth, besides stored repulsion; it includes energy stored anew as repulsion stiffens.
        gas: of pumps, which change a pressure; see `pump`.
    """

    attachments: float = 0.0
    pins: float = 0.0
    solids: float = 0.0
    pushed_out: float = 0.0
    pulled_down: float = 0.0
    friction: float = 0.0
    layers: float = 0.0
    gas: float = 0.0

    @property
    def total(self) -> float:
        """All of it [J]."""
        held = self.attachments + self.pins + self.solids
        return held + self.pushed_out + self.pulled_down + self.friction + self.layers + self.gas


@dataclass(frozen=True)
class Ledger(Work):
    """All that changed the energy of the cloth in a step [J].

    Attributes:
        kinetic, potential: change of either.
        wind: work of the air, and of loads.
        damping: loss by the cloth's own damping.
        method: further loss by the method; negative if it gained.
        plastic: loss as the cloth's rest shape changed after the step: fibres that slid, creases; energy of the pull on
            stitches that hold since.
        torn: energy stored in hinges over stitches that failed in the step.
        edited: change between steps: another material as a run goes on with an edited scene, other pressures, a state
            that was set by hand.
        kinetic_correction: part of `method`: energy taken off velocities because the step would else have gained it.
        unaccounted: change that none of these explains.
    """

    kinetic: float = 0.0
    potential: float = 0.0
    wind: float = 0.0
    damping: float = 0.0
    method: float = 0.0
    plastic: float = 0.0
    torn: float = 0.0
    edited: float = 0.0
    kinetic_correction: float = 0.0

    @property
    def change(self) -> float:
        """Change of kinetic and potential energy."""
        return self.kinetic + self.potential

    @property
    def unaccounted(self) -> float:
        """See above."""
        given = self.total + self.wind + self.edited
        return self.change - given + self.damping + self.method + self.plastic + self.torn

    def record(self) -> dict[str, float]:
        """By name, as telemetry has it."""
        return LedgerTerms({**asdict(self), "unaccounted": self.unaccounted})


def with_attachments(ledger: Ledger, work: float) -> Ledger:
    """Ledger of a step whose start has attachments' targets at their places of the step's end, moved there by `work` [J]."""
    return replace(ledger, attachments=work, potential=ledger.potential + work) if work else ledger


STILL = 1e-4  # part of its energies that counts as moved in any case: below, all is rounding


def moved(ledger: dict[str, float]) -> float:
    """Energy [J] that moved in a step from one account to another, each joule counted once.

    Accounts are kinetic and potential energy, works, losses, and the change unaccounted for. All of them add up to zero,
    so half the sum of their sizes has moved.
    """
    return sum(abs(ledger[name]) for name in TERMS if name in ledger and name != "kinetic_correction") / 2


TERMS = (*(f.name for f in fields(Ledger)), "unaccounted")


def gained(start: Measures, end: Measures, work: Work) -> float:
    """Growth of the energy [J] beyond the work that may be put in, wind apart."""
    return end.total - start.total - work.total + max(0.0, work.pulled_down)


def one_stage(h: float, start: Measures, end: Measures, work: Work) -> Ledger:
    """Ledger of a backward Euler step of h [s]; `end` as the solve left it."""
    stored = end.energies.get("contact", 0.0) - start.energies.get("contact", 0.0)
    potential = end.potential - start.potential
    method = end.change + h * end.rate + work.pushed_out + work.pulled_down - (potential - stored)
    return Ledger(**asdict(work), kinetic=end.energies["kinetic"] - start.energies["kinetic"], potential=potential,
                  wind=h * end.wind, damping=2 * h * end.damped, method=method)


def three_stages(weights: tuple[float, float, float], stages: tuple[Measures, Measures, Measures], work: Work,
                 lag: float) -> Ledger:
    """Ledger of a step with the weights [s] of its beginning, middle and end.

    Args:
        lag: the first part of the method's own, sum_i w_i F_i . (v_i - u) [J].
    """
    start, _, end = stages
    rate, wind, damped = (sum(w * getattr(m, name) for w, m in zip(weights, stages)) for name in ("rate", "wind", "damped"))
    potential = end.potential - start.potential
    return Ledger(**asdict(work), kinetic=end.energies["kinetic"] - start.energies["kinetic"], potential=potential, wind=wind,
                  damping=2 * damped, method=lag + rate - (potential - work.gas))


def many_steps(start: Measures, end: Measures, work: Work) -> Ledger:
    """Ledger of many explicit steps in one, of which only the start and end are known.

    A fall of the energy beyond the work of pins is the loss by damping, air and method. A rise is unaccounted for.
    """
    grown = gained(start, end, work)
    return Ledger(**asdict(work), kinetic=end.energies["kinetic"] - start.energies["kinetic"],
                  potential=end.potential - start.potential, method=max(0.0, -grown))


def totals(ledgers: list[dict[str, float]]) -> dict[str, float]:
    """Sums over steps, by name; those of steps that were recorded without are 0."""
    return LedgerTerms({name: sum((ledger[name] for ledger in ledgers if name in ledger), 0.0) for name in TERMS})
