"""Changes of the cloth's energy over a run, by cause, with one sign for all: gained is positive, lost negative."""

from collections.abc import Mapping
from dataclasses import fields

from ..step.ledger import Work

GAINS = (*(f.name for f in fields(Work)), "wind", "edited")  # works, positive in a ledger where the cloth gains
LOSSES = ("damping", "plastic", "torn", "method")  # positive in a ledger where the cloth loses
SIGN = "+ gained by the cloth, - lost"


def changes(ledger: Mapping[str, float]) -> dict[str, float]:
    """Each account's change of the cloth's energy [J], by the ledger's names; with `unaccounted` they add up to `change`."""
    gains = {name: ledger[name] for name in GAINS if ledger.get(name)}
    return gains | {name: -ledger[name] for name in LOSSES if ledger.get(name)}


def change(ledger: Mapping[str, float]) -> float:
    """Change of kinetic and potential energy together [J]."""
    return ledger.get("kinetic", 0.0) + ledger.get("potential", 0.0)
