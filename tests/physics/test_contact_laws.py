"""Laws of contact with the usual settings: those that hold, and those that do not yet, with what was measured.

The cases and their derivations are in scripts/laws/; `scripts/contact_laws.py` runs them with more starts, meshes and steps.
A law that begins to hold fails here as XPASS: take it off the list.
"""

import pathlib
import sys
from dataclasses import replace
from functools import cache

import pytest

sys.path.insert(0, str(pathlib.Path(__file__).parents[2] / "scripts"))
from laws import CASES  # noqa: E402
from laws.case import Result  # noqa: E402

pytestmark = pytest.mark.slow

HOLDS = {
    "drum": ("goes along", "slides"),
    "conveyor": ("slipped", "slip after"),
    "plane_sticks": ("slid", "slip after"),
    "plane_slips": ("gains", "slid", "slip after"),
    "sticks_again": ("slid", "slip after"),
    "slip_front": ("moved",),
    "turntable": ("slip",),
    "turntable_catches": ("lags", "slip after"),
    "edge_smooth": ("way", "speed"),
    "edge_round": ("way",),
    "edge_slope": ("way", "speed"),
    "edge_sharp": ("way",),
    "towel": ("way",),
    "grip": ("slip",),
    "layers_stick": ("slip",),
    "landing_ball": ("gravity's work", "unaccounted"),
    "landing_table": ("gravity's work", "unaccounted"),
    "middle_drawn": ("upper gains", "creeps"),
    "capstan_180_05": ("ratio", "spread"),
    "capstan_180_08": ("ratio", "spread"),
    "capstan_90_03": ("ratio",),
    "capstan_180_01": ("ratio", "spread"),
    "capstan_180_03": ("ratio", "spread"),
    "capstan_360_03": ("ratio", "spread"),
    "capstan_720_01": ("ratio", "spread"),
    "landing_cloth": ("unaccounted",),
    "order_impact": ("order",),
    "order_contact": ("order", "order of backward Euler"),
    "layers_slip": ("gains",),
    "layers_momentum": ("lost",),
    "ten_at_rest": ("least gap", "floor bears"),
    "pressed": ("least gap",),
    "hit_at_10": ("least gap",),
    "smooth_on_smooth": ("upper went", "steps"),
    **{f"near_{part}_free": ("speed",) for part in (0, 10, 20, 50, 90)},
    **{f"near_{part}_pinned": ("speed",) for part in (0, 10, 20, 50, 90)},
}
MEASURED = {  # of the law
    ("edge_round", "speed"): ".85 of .87 m/s, .82 at worst (.827 to .914 asked)",
    ("edge_sharp", "speed"): ".74 of .78 m/s, .70 at worst (.737 asked); 8 of 20 runs",
    ("edge_mesh", "way"): ".104 of .107 m, .083 at worst; 18 of 20 runs",
    ("edge_mesh", "speed"): ".71 of .78 m/s, .53 at worst; 2 of 20 runs",
    ("towel", "speed"): ".57 of .51 m/s",
    ("rope_holds", "slip"): "1.4 of 1 um/s at worst",
    ("rope_runs", "gains"): "1.08 of 1.11 m/s^2, 1.063 at worst (1.073 asked)",
    ("capstan_90_03", "spread"): "1.1 of 1 %",
    ("pillow", "speed"): "1.94 m/s at worst (1.34 asked); 18 of 20 runs",
    ("taut_over_ridge", "least gap"): ".39",
    ("crease", "crossings"): "0 from 7 of 8 starts",
    ("crease", "in order"): "from 8 of 8 starts",
}
KNOWN = [(case, name) for case, names in HOLDS.items() for name in names]


@cache
def run(name: str) -> dict[str, Result]:
    """The results of a case by their names, at 1/60 s on its smallest mesh."""
    case = CASES[name]
    return {r.name: r for r in case.run(1 / 60, case.cells[0], 0, 1)}


def test_every_case_is_tested():
    assert set(HOLDS) | {case for case, _ in MEASURED} == set(CASES) and not set(KNOWN) & set(MEASURED)


# a rounding decides how vertices come to a sharp edge, on which side each starts, when a polygon's corner comes on, and
# whether the crease is passed
BY_CHANCE = {("edge_round", "speed"), ("edge_sharp", "speed"), ("edge_mesh", "way"), ("edge_mesh", "speed"),
             ("rope_holds", "slip"), ("rope_runs", "gains"), ("pillow", "speed"), ("crease", "crossings"),
             ("crease", "in order")}
LAWS = [*KNOWN, *(pytest.param(*key, marks=pytest.mark.xfail(strict=key not in BY_CHANCE, reason=f"measured today: {text}"))
                  for key, text in MEASURED.items())]
ORDER = list(CASES)


@pytest.mark.parametrize("case, name", sorted(LAWS, key=lambda law: ORDER.index(getattr(law, "values", law)[0])),
                         ids=lambda word: word.replace(" ", "_"))
def test_law(case, name):
    results = run(case)
    assert set(results) == {n for c, n in [*KNOWN, *MEASURED] if c == case}
    assert results[name].holds, str(results[name])


@pytest.mark.parametrize("case, name", sorted(KNOWN, key=lambda law: ORDER.index(law[0])))
def test_a_wrong_law_does_not_hold(case, name):
    """What is measured tells the law from twice the friction, or from what would have been without."""
    result = run(case)[name]
    assert result.wrong is not None and not result.fits(result.wrong), str(result)


def test_a_bound_is_one_sided_and_nan_holds_nothing():
    r = Result("gap", 0.6, 0.5, 0.05, sense=">=")
    assert r.holds and replace(r, measured=0.46).holds and not replace(r, measured=0.44).holds
    assert not replace(r, sense="<=").holds and replace(r, measured=0.1, sense="<=").holds
    assert not replace(r, sense="=").holds and not replace(r, measured=float("nan")).holds
