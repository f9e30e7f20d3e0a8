"""Drape by Cusick's geometry: stiffer cloth shades more, on any mesh about as much."""

import importlib.util
import pathlib

import pytest

pytestmark = pytest.mark.slow

_spec = importlib.util.spec_from_file_location("validate", pathlib.Path(__file__).parents[2] / "scripts" / "validate.py")
assert _spec is not None and _spec.loader is not None
validate = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(validate)

# Of 30 rings, by `python scripts/validate.py --cases drape` (docs/validation.md), which takes minutes: of rigidity [N m].
FINE = {2e-5: 0.7819, 1e-4: 0.9485}


def test_drape_coefficient_grows_with_rigidity_and_converges():
    soft, stiff = (validate.drape_coefficient(D, 15, t=1.5) for D in FINE)
    plate = validate.drape_coefficient(1e-3, 10, t=1.5)
    assert 0.5 < soft < stiff - 0.05 < plate - 0.05 < 0.96
    assert abs(soft / FINE[2e-5] - 1) < 0.08
    assert abs(stiff / FINE[1e-4] - 1) < 0.02
