"""Random trials of damaged runs, a few of them; `scripts/fuzz.py damage` makes more."""

import sys

import pytest
from inside import ROOT

pytestmark = pytest.mark.slow

sys.path.append(str(ROOT / "scripts"))


@pytest.mark.parametrize("seed", [5002, 5003, 5007, 5012, 5022, 5026, 5029, 5030])
def test_a_damaged_run_gives_what_it_gave_or_is_refused(seed):
    from fuzzing.damage import trial

    outcome = trial(seed, "f64")
    assert outcome.verdict == "ok", outcome.text
