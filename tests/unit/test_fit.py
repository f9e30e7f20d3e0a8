"""Fits: parameters that made synthetic measurements are found, within intervals that hold as often as they say."""

import importlib
import json

import numpy as np
import pytest

import taichi_cloth as tc
from taichi_cloth.app.cli import main

pytest.importorskip("scipy")
G = 9.81


def elastica(gamma: float) -> tuple[float, float]:
    """Drop and reach over length by a boundary value solver, from the equation as it stands."""
    from scipy.integrate import solve_bvp

    def along(s, y):
        return [y[1], -gamma * (1 - s) * np.cos(y[0]), np.cos(y[0]), np.sin(y[0])]

    s = np.linspace(0, 1, 60)
    guess = np.array([s * min(gamma / 3, 1.3), 0 * s, s, 0 * s])
    found = solve_bvp(along, lambda a, b: np.array([a[0], b[1], a[2], a[3]]), s, guess, tol=1e-9, max_nodes=20_000)
    assert found.success
    return float(found.y[3, -1]), float(found.y[2, -1])


@pytest.mark.slow
def test_the_elastica_against_a_boundary_value_solver():
    from taichi_cloth.fitting.closed_forms import cantilever

    for gamma in (0.02, 0.7, 4.0, 30.0, 150.0):
        assert [float(v) for v in cantilever(np.array(gamma))] == pytest.approx(elastica(gamma), rel=1e-5)
    small = cantilever(np.array([0.01]))[0][0]
    assert small == pytest.approx(0.01 / 8, rel=1e-4)  # a beam under even load


def covered(rng, make, truth: dict) -> int:
    """In how many of 100 synthetic experiments every interval holds the truth."""
    hits = 0
    for _ in range(100):
        found = make(rng)
        hits += all(found.intervals[n][0] < v < found.intervals[n][1] for n, v in truth.items())
        assert {n: found.parameters[n] / v for n, v in truth.items()} == pytest.approx(dict.fromkeys(truth, 1.0), abs=0.25)
    return hits


@pytest.mark.slow
def test_intervals_hold_as_often_as_they_say(rng):
    length, D = np.linspace(0.05, 0.12, 8), 2e-5
    drop = np.array([elastica(0.15 * G * L**3 / D)[0] * L for L in length])
    angle = np.degrees([np.arctan2(*elastica(0.15 * G * L**3 / D)) for L in length])
    strain = np.linspace(0.01, 0.1, 12)
    rate = np.where(np.arange(12) % 2, 2.0, 0.1)

    def cantilever(rng):
        return tc.fit("cantilever", {"length": length, "drop": drop + 5e-4 * rng.normal(size=8)}, density=0.15)

    def strip(rng):
        return tc.fit("strip", {"strain": strain, "rate": rate, "tension": 700 * strain + 5 * rate + rng.normal(size=12)})

    assert 90 <= covered(rng, cantilever, {"D": D}) <= 99
    assert 84 <= covered(rng, strip, {"k": 700.0, "k_d": 5.0}) <= 98  # both at once: .95 squared, and they go together
    found = tc.fit("cantilever", {"length": length, "angle": angle + 0.2 * rng.normal(size=8)}, density=0.15)
    assert found.intervals["D"][0] < D < found.intervals["D"][1] and found.intervals["D"][1] < 1.05 * found.intervals["D"][0]


def test_covariance_of_a_line_is_the_textbook_one(rng):
    strain, noise = np.linspace(0.01, 0.1, 20), rng.normal(size=20)
    tension = 500 * strain + noise
    k = np.sum(strain * tension) / np.sum(strain**2)
    residual = tension - k * strain
    variance = np.sum(residual**2) / 19 / np.sum(strain**2)
    found = tc.fit("strip", {"strain": strain, "force": 0.05 * tension}, width=0.05)
    assert found.parameters["k"] == pytest.approx(k, rel=1e-9)
    assert found.covariance[0, 0] == pytest.approx(variance, rel=1e-6)
    half = (found.curve["high"] - found.curve["low"]) / 2
    t = 2.093024  # Student's, 19, 97.5 %
    assert half[-1] == pytest.approx(t * 0.1 * np.sqrt(variance), rel=1e-5)
    known = tc.fit("strip", {"strain": strain, "tension": tension, "sigma": np.full(20, 2.0)})
    assert known.covariance[0, 0] == pytest.approx(4.0 / np.sum(strain**2), rel=1e-6)
    single = tc.fit("strip", {"strain": [0.1], "tension": [50.0]})
    assert single.intervals["k"] is None and "no interval" in str(single) and single.parameters["k"] == pytest.approx(500)


def test_a_limit_is_found(rng):
    strain = np.linspace(0.005, 0.08, 16)
    tension = 300 * strain + 1000 * 300 * np.maximum(strain - 0.05, 0) ** 2 / 0.05
    found = tc.fit("strip", {"strain": strain, "tension": tension + 0.3 * rng.normal(size=16)}, find="k,limit")
    assert found.parameters == pytest.approx({"k": 300, "limit": 1.05}, rel=5e-3)
    assert found.intervals["limit"][0] < 1.05 < found.intervals["limit"][1]


@pytest.mark.slow
def test_drag_of_a_swing_by_the_decay_of_its_closed_form(rng, monkeypatch, tmp_path):
    """A strip of even mass sigma and drag c: every mode decays as exp(-c t / 2 sigma), whatever its shape."""
    from taichi_cloth.fitting import simulated

    module = importlib.import_module("taichi_cloth.fitting.fit")
    monkeypatch.setattr(module, "POINTS", 4)
    monkeypatch.setattr(module, "CLOSER", 2)
    t, c, sigma = np.linspace(0, 1.0, 11), 0.2, 0.2
    free = simulated.swing_scene(1e-9, "air", 0.2, 0.1, sigma, 1e-5, 1000.0, 0.02, 4)
    with tc.Simulation(free, h=1 / 60, integrator="tr_bdf2", threads=1) as sim:
        sim.step()
        x = np.array([0.02, *simulated.follow(sim, tuple(t[1:])).values()]) * np.exp(-c * t / 2 / sigma)
    x[1:] += 1e-4 * rng.normal(size=10)
    found = tc.fit("swing", {"time": t, "x": x}, density=sigma, length=0.2, width=0.1, cells=4, h=1 / 60, workers=0,
                   range_=(0.05, 0.8), out=tmp_path)
    assert found.parameters["air"] == pytest.approx(c, rel=0.05)
    assert found.intervals["air"][0] < c < found.intervals["air"][1]
    assert (tmp_path / "sweep" / "sweep.csv").is_file() and "6 runs" in str(found)
    monkeypatch.setattr(module, "POINTS", 2)
    monkeypatch.setattr(module, "CLOSER", 0)
    with pytest.raises(tc.SceneError, match="end of the range that was tried"):
        tc.fit("swing", {"time": t, "x": x}, density=sigma, length=0.2, width=0.1, cells=4, h=1 / 60, workers=0,
               range_=(0.4, 0.8), out=tmp_path)


@pytest.mark.slow
def test_rigidity_of_a_drape(monkeypatch):
    from taichi_cloth.fitting import simulated

    module = importlib.import_module("taichi_cloth.fitting.fit")
    monkeypatch.setattr(module, "POINTS", 3)
    monkeypatch.setattr(module, "CLOSER", 3)
    with tc.Simulation(simulated.drape_scene(1e-4, rings=5), h=1 / 60, integrator="backward_euler", threads=1) as sim:
        sim.run(2.0, 0.5)
        shade = simulated.drape_coefficient(sim)
    found = tc.fit("drape", {"coefficient": shade + np.array([-4e-3, 1e-3, 3e-3])}, density=0.15, rings=5, workers=0,
                   range_=(5e-5, 4e-4))
    assert found.intervals["D"][0] < 1e-4 < found.intervals["D"][1] and found.parameters["D"] == pytest.approx(1e-4, rel=0.05)


def test_what_is_wrong_with_data_is_named(tmp_path):
    file = tmp_path / "data.csv"
    for text, words in (("length,drop\n.1,x\n", "line 2: drop = 'x'"), ("length,drop\n.1,.02\n.1\n", "line 3: has 1 values"),
                        ("length,drop\n.1,nan\n", "line 2: drop"), ("lenght,drop\n.1,.02\n", "no column 'length'"),
                        ("length,down\n.1,.02\n", "'drop' or 'angle'"), ("length,drop,x\n.1,.02,1\n", "unknown column 'x'"),
                        ("", "is empty"), ("length,drop\n", "at least one"), ("length,length\n", "a name for each"),
                        ("length,drop\n.1,.2\n", "less than its length"), ("length,drop\n10.5,1\n", "in metres"),
                        ("length,angle\n.1,120\n", "in degrees"), ("# mm\nlength;drop\n-0.1;.02\n", "length of row 0")):
        file.write_text(text)
        with pytest.raises(tc.SceneError, match=words):
            tc.fit("cantilever", file, density=0.15)
    for kind, data, more, words in (
            ("strip", {"strain": [1, 2.0], "force": [1, 2.0]}, {}, "needs width"), ("drape", {"coefficient": [55.0]},
                                                                                      {"density": 0.1}, "not percent"),
            ("strip", {"strain": [-0.1], "tension": [-1.0]}, {}, "under tension"),
            ("cantilever", {"length": [0.1], "drop": [0.01]}, {}, "needs density"),
            ("strip", {"strain": [0.1], "tension": [1.0], "sigma": [0.0]}, {}, "sigma of row 0"),
            ("strip", {"strain": [0.1], "tension": [1.0]}, {"find": "k,limit"}, "do not determine 2"),
            ("swing", {"time": [0.1, 0.2, 0.3], "x": [1, 2, 3]}, {"density": 1, "length": 1, "width": 1}, "begin with 0"),
            ("swing", {"time": [0, 0.2, 0.3], "x": [1, 2, 3]}, {"density": 1, "length": 1, "width": 1}, "less than .9"),
            ("bend", {}, {}, "unknown kind"), ("cantilever", tmp_path / "none.csv", {"density": 1}, "cannot be read")):
        with pytest.raises(tc.SceneError, match=words):
            tc.fit(kind, data, **more)


def test_the_command_writes_what_it_says(tmp_path, capsys):
    file = tmp_path / "strip.csv"
    file.write_text("strain,force\n0.01,0.4\n0.02,0.81\n0.03,1.19\n")
    assert main(["fit", "strip", str(file), "--width", "0.05", "--out", str(tmp_path / "out")]) == 0
    assert "k = 798" in capsys.readouterr().out
    made = json.loads((tmp_path / "out" / "fit.json").read_text())
    assert made["parameters"]["k"] == pytest.approx(np.dot([1, 2, 3], [8, 16.2, 23.8]) / 14 * 100)
    low, high = made["intervals"]["k"]
    assert low < made["parameters"]["k"] < high
    assert (tmp_path / "out" / "fit.csv").read_text().startswith("strain,tension,low,high\n")
    assert (tmp_path / "out" / "fit.svg").read_text().count("<circle") == 3
    assert main(["fit", "strip", str(file)]) == 2 and "needs width" in capsys.readouterr().err
    assert main(["fit", "drape", str(file), "--range", "1"]) == 2 and "LOW:HIGH" in capsys.readouterr().err
