"""`study`: what it says about errors is true, by positions that are computed afresh."""

import numpy as np
import pytest

import taichi_cloth as tc
from taichi_cloth.studies.study import SAMPLES, Case, Row, Track, judge, mark_front, methods_for, predictable, study

T = 0.2


def make() -> tc.Scene:
    scene = tc.Scene()
    cloth = scene.add_cloth(tc.grid(1.0, 5), tc.Fabric(0.2, tc.Stretch(200, 0.2), tc.Shear(50, 0.1)))
    scene.pin(cloth, "top_left")
    scene.pin(cloth, "top_right")
    return scene


def run(**options) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Positions, mechanical energy and largest stretch of any warp or weft at a study's samples."""
    sim = tc.Simulation(make(), **options)
    x, energy, stretch = [], [], []

    def look(sim, frame):
        mesh = sim.scene.cloths[0].mesh
        x.append(sim.positions())
        energy.append(sum(sim.energy().values()))
        uv = mesh.corner_uv
        rest = np.stack([uv[:, 1] - uv[:, 0], uv[:, 2] - uv[:, 0]], axis=2)
        now = np.stack([x[-1][mesh.faces[:, k]] - x[-1][mesh.faces[:, 0]] for k in (1, 2)], axis=2)
        stretch.append(np.linalg.norm(now @ np.linalg.inv(rest), axis=1).max())

    sim.run(T, SAMPLES, look)
    sim.close()
    return np.array(x), np.array(energy), np.array(stretch)


@pytest.mark.slow
def test_errors_are_those_of_positions_computed_afresh():
    said: list[str] = []
    found = study("swing", make, [Case("backward_euler", 1 / 60), Case("tr_bdf2", 1 / 30)], T, 1 / 1000, said.append)
    fine = run(integrator="tr_bdf2", h=1 / 1500, newton_tol=1e-9, cg_tol=1e-7)  # another method than the study's own reference
    assert found.predictable == pytest.approx(T) and len(found.times) == len(found.doubt) == 7
    assert 0 < found.doubt[-1] < 1e-4 and found.doubt[0] == 0  # two references that are not one and the same
    assert len(said) == 5 and "its positions are good to" in said[2]
    for row in found.rows:
        x, energy, stretch = run(integrator=row.case.integrator, h=row.case.h)
        error = np.sqrt(np.mean(np.sum((x[-1] - fine[0][-1]) ** 2, axis=1)))
        assert row.error == pytest.approx(error, rel=0.02) and error > 1e-4
        assert row.energy_error == pytest.approx(np.abs(energy - fine[1]).max(), rel=0.05)
        assert row.stretch_error == pytest.approx(np.abs(stretch - fine[2])[1:].max(), rel=0.05)
        assert row.wall > 0 and row.steps == round(T / row.case.h) and row.iterations > row.steps
    assert found.rows[0].error > 3 * found.rows[1].error  # of second order, at twice the step
    assert not any(row.note for row in found.rows)


def test_the_default_method_is_studied_and_no_row_is_empty():
    from taichi_cloth.app.studies import METHODS

    free, touching = make(), make()
    touching.add_solid(tc.Sphere(0.1), 0.3, 0.01)
    assert tc.Options().integrator in METHODS.split(",")
    assert methods_for(METHODS.split(","), free) == METHODS.split(",")
    assert set(METHODS.split(",")) - set(methods_for(METHODS.split(","), touching)) == {"verlet"}


def tracks() -> tuple[Track, Track]:
    fine = Track(np.zeros((4, 2, 3)), np.array([5.0, 5, 5, 5]), np.array([1.0, 1.1, 1.2, 1.3]))
    x = np.zeros((4, 2, 3))
    x[1, 0, 0], x[2, 0, 1], x[2, 1, 2], x[3] = 7.0, 3.0, 4.0, 99.0
    return Track(x, np.array([5.0, 5.5, 4.0, 50]), np.array([9.0, 1.1, 1.3, 1.8])), fine


def test_a_row_is_judged_at_the_last_predictable_sample():
    track, fine = tracks()
    row = Row(Case("safe", 0.1), fallbacks=2, rejections={"ENERGY": 3})
    judge(row, track, fine, 2, 0.1)
    assert row.error == pytest.approx(np.sqrt((9 + 16) / 2))  # RMS of two vertices, not of six numbers
    assert row.energy_error == 1.0 and row.stretch_error == pytest.approx(0.5)  # energies up to there, stretch all along
    assert row.note == "2 steps by backward Euler, ENERGY 3"


@pytest.mark.parametrize("part, doubted", [(0.09, False), (0.11, True), (2.0, True)])
def test_an_error_that_the_reference_cannot_tell_is_doubted(part, doubted):
    track, fine = tracks()
    row = Row(Case("safe", 0.1))
    judge(row, track, fine, 2, part * np.sqrt(12.5))
    assert (row.note == "reference not converged") == doubted != row.converged


def test_positions_are_compared_while_the_references_agree():
    doubt = np.array([0.0, 0.5e-3, 0.9e-3, 1.1e-3, 0.1e-3])
    assert predictable(doubt, 1.0) == 2 and predictable(doubt, 2.0) == 4 and predictable(doubt, 0.7) == 1
    assert predictable(np.array([0.0, 1.0, 1.0]), 1.0) == 0


def test_the_front_is_what_nothing_beats():
    rows = [Row(Case("safe", 0.1), wall, error) for wall, error in ((1, 5), (2, 3), (3, 4), (2.5, 3), (4, 1), (0.5, None))]
    mark_front(rows)
    assert [row.best for row in rows] == [True, True, False, False, True, False]
    rows[1].converged, rows[1].best = False, False  # how good it is cannot be told
    mark_front(rows)
    assert [row.best for row in rows] == [True, False, False, True, True, False]


@pytest.mark.parametrize("case", [{"h": 0}, {"h": 0.1, "tolerance": -1}, {"h": 0.1, "cg_tol": float("nan")},
                                  {"h": 0.1, "substep": "2"}, {"h": 0.1, "newton_tol": 0}])
def test_impossible_cases_are_refused_before_anything_runs(case):
    with pytest.raises(tc.SceneError, match="must be a"):
        Case("safe", **case)
    with pytest.raises(tc.SceneError, match="unknown integrator 'rk4'"):
        Case("rk4", 0.1)
