"""Error against a converged explicit reference: what second order buys, and whether an error asked for is kept."""

import pathlib

import numpy as np
import pytest

import taichi_cloth as tc
from taichi_cloth import scenefile
from taichi_cloth.study import Case, study

SWING = scenefile.read(str(pathlib.Path(__file__).parents[2] / "scenes" / "swing.py"))


@pytest.fixture(scope="module")
def swung():
    cases = [Case("backward_euler", 1 / 60), Case("tr_bdf2", 1 / 60, newton_tol=1e-3, cg_tol=3e-2), Case("verlet", 1 / 60),
             *(Case("safe", 1 / 30, tolerance) for tolerance in (1e-2, 1e-3, 1e-4))]
    made = study("swing", lambda: SWING.make({"n": 26}), cases, 0.5, 1 / 1000)
    return made, {(r.case.integrator, r.case.tolerance): r for r in made.rows}


def test_second_order_has_an_eighth_of_the_papers_error_for_no_more_iterations(swung):
    _, rows = swung
    paper, second = rows["backward_euler", None], rows["tr_bdf2", None]
    assert second.error < paper.error / 8 and second.iterations <= paper.iterations, (paper, second)


def test_the_error_asked_for_is_kept(swung):
    made, rows = swung
    assert made.predictable == pytest.approx(0.5)
    for tolerance in (1e-2, 1e-3, 1e-4):
        row = rows["safe", tolerance]
        assert 0.1 * tolerance < row.error < 2 * tolerance, row
    assert rows["verlet", None].error < 1e-3


def test_energy_never_grows_by_much_and_the_step_says_why_it_fell_back():
    scene = SWING.make({"n": 11})
    sim = tc.Simulation(scene, h=1 / 30)
    start = sum(sim.energy().values())
    sim.run(1.0, 30)
    total = np.array([start, *(sum(r.energies.values()) for r in sim.log)])
    assert np.diff(total).max() < 0.01 * 0.2 * 9.81
    assert {r.fell_back for r in sim.log} <= {"", "ENERGY", "NEWTON", "SOLVER"}


@pytest.mark.parametrize("settings, tolerance, wanted", [
    ({"n": 11}, None, "verlet"), ({"n": 26, "stretch": 1e5}, None, "safe"),
    ({"n": 26, "stretch": 1e5}, 1e-3, "verlet"), ({"n": 11}, 1e-5, "safe")])
def test_auto_picks_by_stiffness_and_tolerance_and_says_why(settings, tolerance, wanted):
    sim = tc.Simulation(SWING.make(settings), h=1 / 60, integrator="auto", tolerance=tolerance)
    assert sim.integrator_name == wanted and sim.notes[0].startswith(f"integrator {wanted}: ")
    sim.step()
    sim.close()
