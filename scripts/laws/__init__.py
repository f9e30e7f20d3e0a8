"""Cases of contact with a law in closed form, one function each; `scripts/contact_laws.py` runs them."""

from . import edges, folds, landing, layers, sliding, starts  # noqa: F401
from .case import CASES

__all__ = ["CASES"]
