"""Changes of the cloth's energy over a run, by cause, with one sign for all: gained is positive, lost negative."""

from collections.abc import Mapping
from dataclasses import fields

from ..step.ledger import Work

GAINS = (*(f.name for f in fields(Work)), "wind", "edited")  # works, positive in a ledger where the cloth gains
LOSSES = ("damping", "plastic", "torn", "method")  # positive in a ledger where the cloth loses
IN_WORDS = {"pushed_out": "let out of solids", "pulled_down": "set down on solids", "method": "numerical damping",
            "plastic": "bending for good", "torn": "tearing", "edited": "changes by hand"}
NUMERICAL_GAIN = "numerical gain"  # the method's, where it did not damp
SIGN = "+ gained by the cloth, - lost"


def changes(ledger: Mapping[str, float]) -> dict[str, float]:
    """Each account's change of the cloth's energy [J], in words; with `unaccounted` they add up to `change`."""
    signed = {name: ledger[name] for name in GAINS if ledger.get(name)}
    signed |= {name: -ledger[name] for name in LOSSES if ledger.get(name)}
    words = IN_WORDS | ({"method": NUMERICAL_GAIN} if signed.get("method", 0.0) > 0 else {})
    return {words.get(name, name): value for name, value in signed.items()}


def change(ledger: Mapping[str, float]) -> float:
    """Change of kinetic and potential energy together [J]."""
    return ledger.get("kinetic", 0.0) + ledger.get("potential", 0.0)
