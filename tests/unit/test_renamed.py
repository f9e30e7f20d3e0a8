"""Old names: read and set with a warning, in old recordings without one, and listed."""

import ast
import dataclasses
import pathlib

import pytest

import taichi_cloth as tc
from taichi_cloth.backend.language import ti
from taichi_cloth.forces.force import Force
from taichi_cloth.output.folder import RunFolder
from taichi_cloth.renamed import RENAMED, UNTIL
from taichi_cloth.step.ledger import Ledger
from taichi_cloth.step.records import StepRecord, Tally
from taichi_cloth.studies.study import Row

PACKAGE = pathlib.Path(__file__).parents[2] / "taichi_cloth"
OLD = {"t": 0.5, "h": 0.25, "iterations": 9, "solves": 2, "residual": 1e-4, "status": "CONVERGED",  # a step of version 0.1
       "rejections": {"CONTACT": 1}, "energies": {"kinetic": 2.0}, "stretch": 1.5, "seconds": {"total": 0.1}, "contacts": 7,
       "unsettled": 3, "crossings": 4, "evaluations": 0, "error": 0.0, "fell_back": "TOUCH", "layers": 6, "least": 0.25,
       "tangled": 5, "pinched": 2, "ledger": {"pins": 1.0, "lifted": 0.25, "lowered": -0.5, "braked": 0.125}}


def told(caught) -> list[str]:
    return [str(w.message).split(",")[0].split(": ")[1] for w in caught]


def test_every_new_name_is_there():
    for cls in (Force, StepRecord, Ledger, Tally, Row):
        there = {*dir(cls), *(vars(cls()) if cls is Tally else ())}
        assert set(RENAMED[cls.__name__].values()) <= there, cls
    assert set(RENAMED) == {"Force", "StepRecord", "Ledger", "Tally", "Row"}


def test_a_force_with_old_flags_keeps_them():
    """Declared in the class, set in `__init__`, and read from outside."""
    with pytest.warns(DeprecationWarning) as caught:
        class Gusts(Force):
            gusty = True
            slow = True

    assert told(caught) == ["`slow` is called `multirate` now", "`gusty` is called `time_dependent` now"]
    assert caught[0].filename == __file__
    Gusts.__abstractmethods__ = frozenset()
    force = Gusts()
    assert force.time_dependent and force.multirate and not force.dead_load and not Force.time_dependent
    with pytest.warns(DeprecationWarning, match="`uniform` is called `interpolated_wind` now") as caught:
        force.uniform = True
    assert force.interpolated_wind and not Force.interpolated_wind and caught[0].filename == __file__
    with pytest.warns(DeprecationWarning, match="Gusts: `gusty`.*no longer read from"):
        assert force.gusty


def test_explicit_steps_go_by_old_flags():
    """`slow = True` puts a force among those that are evaluated once in several substeps."""
    from test_own_force import Counter

    with pytest.warns(DeprecationWarning, match="Slow: `slow`"):
        @ti.data_oriented
        class Slow(Counter):
            slow = True

    scene = tc.Scene()
    scene.add_cloth(tc.grid(0.3, 2), tc.Fabric(0.2, tc.Stretch(100)))
    scene.add_force(Slow)
    with tc.Simulation(scene, integrator="verlet") as sim:
        assert [type(f).__name__ for f in sim.integrator.slow] == ["Slow"]


def test_a_record_has_its_old_names_too():
    record = StepRecord(0.5, 0.25, 9, 2, 1e-4, "CONVERGED", {}, {}, 1.5, min_gap_ratio=0.25, fallback_reason="TOUCH")
    with pytest.warns(DeprecationWarning) as caught:
        assert record.least == 0.25 and record.fell_back == "TOUCH"
        record.tangled = 3
    assert record.known_intersections == 3 and len(caught) == 3 and caught[2].filename == __file__
    assert not set(RENAMED["StepRecord"]) & set(dataclasses.asdict(record))


@pytest.mark.filterwarnings("error")
def test_an_old_recording_is_read(tmp_path):
    folder = RunFolder(tmp_path / "run")
    folder.write_telemetry([OLD, {**OLD, "least": 0.75, "fell_back": ""}])
    folder.write_manifest({"scene": "old", "status": "finished", "summary": {"steps": 2}})
    folder.close()
    records = tc.Recording(tmp_path / "run").telemetry()
    assert (records[0]["unconverged_contacts"], records[0]["solid_intersections"], records[0]["min_gap_ratio"],
            records[0]["known_intersections"], records[0]["fallback_reason"]) == (3, 4, 0.25, 5, "TOUCH")
    assert records[0]["ledger"] == {"pins": 1.0, "pushed_out": 0.25, "pulled_down": -0.5, "kinetic_correction": 0.125}
    assert [v for k, v in records[0].items() if k != "ledger"] == [v for k, v in OLD.items() if k != "ledger"]
    tally = Tally.of(StepRecord(**record) for record in records)
    assert tally.min_gap_ratio == 0.25 and tally.solid_intersections == 4 and tally.known_intersections == 5
    assert tally.fallbacks == {"TOUCH": 1} and tally.ledger["kinetic_correction"] == 0.25
    assert "least" not in records[0] and "nothing" not in records[0] and records[0].get("nothing") is None
    for asked in (lambda: records[0]["least"], lambda: records[0].get("least", 9.0), lambda: records[0]["ledger"]["lifted"]):
        with pytest.warns(DeprecationWarning, match="is called `(min_gap_ratio|pushed_out)` now") as caught:
            assert asked() == 0.25 and caught[0].filename == __file__
    with pytest.raises(KeyError, match="nothing"):
        records[0]["nothing"]


def test_all_warnings_of_old_names_come_from_one_list():
    """So that the page of old names has all of them."""
    warn = set()
    for path in PACKAGE.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Call) and ast.unparse(node.func).endswith("warn"):
                warn |= {path.name} if "DeprecationWarning" in ast.unparse(node) else set()
    assert warn == {"renamed.py"}
    page = (PACKAGE.parent / "docs" / "reference" / "deprecations.md").read_text()
    for owner, names in RENAMED.items():
        for old, new in names.items():
            assert f"| `{owner}` | `{old}` | `{new}` |" in page
    assert f" {UNTIL} will not know them" in page
