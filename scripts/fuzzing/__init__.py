"""Random trials by kind; `scripts/fuzz.py` runs them."""
