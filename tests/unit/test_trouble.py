"""Where rejected and slow steps are said to be, against positions."""

from types import SimpleNamespace

import numpy as np
import pytest

import taichi_cloth as tc
from taichi_cloth.app.running import Writer
from taichi_cloth.app.summary import percent
from taichi_cloth.backend.timing import compiling
from taichi_cloth.errors import many
from taichi_cloth.output.recording import Recording
from taichi_cloth.recording.accounts import GAINS, LOSSES, changes
from taichi_cloth.recording.reasons import MEANS, why_refused
from taichi_cloth.recording.why import costliest
from taichi_cloth.step.stepper import ADVICE

FABRIC = tc.Fabric(0.2, tc.Stretch(500, k_d=0.5), tc.Shear(100), tc.Bend(1e-5))


def test_a_blow_is_told_of_where_it_is():
    """One corner of a sheet starts off at 2,000 m/s, out of the sheet: it is where velocities change most."""
    scene, mesh, corner = tc.Scene(gravity=None), tc.grid(0.5, 5), 35
    v = np.zeros((36, 3))
    v[corner] = 0, 2000, 0
    scene.add_cloth(tc.grid(0.2, 3), FABRIC, name="first")
    scene.add_cloth(mesh, FABRIC, positions=mesh.x + [1, 0, 0], velocities=v, name="second")
    sim = tc.Simulation(scene, h=1 / 60, integrator="backward_euler")
    sim.step()
    record = sim.log[0]
    rejected = [t for t in record.troubles if t.name]
    assert len(rejected) == sum(record.rejections.values()) > 0
    assert [t.h for t in rejected] == [2.0**-k / 60 for k in range(len(rejected))]
    for trouble in rejected:
        assert trouble.cloth == "second" and trouble.vertex == corner and trouble.against == ""
        assert 0 < trouble.speed < 2000 and trouble.at[1] == pytest.approx(trouble.h * trouble.speed, rel=0.2)


@pytest.fixture(scope="module")
def pressed():
    """Two sheets on a ball and a lower one beside it."""
    scene, T = tc.Scene(), 0.01
    scene.add_solid(tc.Sphere(0.2), 0.3, T, position=(0.0, -0.2, 0.0), name="ball")
    scene.add_solid(tc.Plane((0, 1, 0)), 0.3, T, position=(0.0, -1.0, 0.0), name="floor")
    mesh = tc.grid(0.4, 8)
    for k, name in enumerate(("under", "over")):
        scene.add_cloth(mesh, FABRIC, positions=mesh.x + [-0.2, 0.011 + 0.011 * k, 0.2], name=name,
                        contact=tc.ClothContact(T, 0.3))
    sim = tc.Simulation(scene, h=1 / 60, integrator="backward_euler")
    sim.run(0.1, fps=60)
    return sim


@pytest.mark.slow
def test_nearest_contact_is_the_nearest(pressed):
    sim, T = pressed, 0.01
    x = sim.positions()
    ball = np.linalg.norm(x - [0, -0.2, 0], axis=1) - 0.2
    place = sim.contacts.solids.nearest()
    vertex = sim.model.user[place.particles[0]]
    assert sim.scene.solids[place.solid].name == "ball"
    assert ball[vertex] == pytest.approx(ball.min(), abs=1e-9)
    assert place.gap == pytest.approx(ball.min() / T, abs=1e-6)
    layers = sim.contacts.layers.nearest()
    assert layers.solid == -1 and layers.gap == pytest.approx(sim.log[-1].min_gap_ratio)
    trouble = sim.stepper.locator.find("CONTACT", 0.1, "", layers)
    names = {trouble.cloth, trouble.against}
    assert names == {"under", "over"} and np.allclose(trouble.at, x[sim.scene.cloths[trouble.cloth == "over"].start
                                                                     + trouble.vertex], atol=1e-9)


@pytest.mark.slow
def test_why_names_the_costliest_steps(tmp_path):
    folder = tmp_path / "run"
    from taichi_cloth.app import cli

    assert cli.main(["run", "fold", "--out", str(folder), "--no-images", "--duration", "0.2", "--set", "cells=6"]) == 0
    log = Recording(folder).telemetry()
    text = costliest(Recording(folder), 3)
    dearest = sorted(range(len(log)), key=lambda k: -log[k]["seconds"]["total"])[:3]
    heads = [line for line in text.splitlines() if line.startswith("step ")]
    assert [int(line.split()[1]) for line in heads] == dearest
    assert all(f", {many(log[k]['solves'], 'solve')}, " in line for k, line in zip(dearest, heads))
    told = {k: "of it to compile" in line for k, line in zip(dearest, heads)}
    assert told == {k: log[k]["seconds"]["compiling"] > 0 for k in dearest}
    assert all(0 <= r["seconds"]["compiling"] <= r["seconds"]["total"] for r in log)
    assert not any(r["seconds"]["compiling"] for r in log[-5:])
    assert cli.main(["why", str(folder), "--steps", "0"]) == 2


def test_why_tells_of_compilation_and_of_the_end():
    """In a run whose second step compiled, and which gave up after it."""
    steps = [{"t": 0.1 * k, "h": 0.1, "solves": 1, "iterations": 9, "seconds": {"total": total, "compiling": compiling}}
             for k, total, compiling in ((1, 0.1, 0.0), (2, 2.0, 1.5))]
    run = SimpleNamespace(path="run", telemetry=lambda: steps, manifest={"status": "gave up: at t = 0.2 s no step passes"})
    text = costliest(run)
    assert "step 1 to t = 0.2 s: 2.0 s, h = 100 ms, 1 solve, 9 CG iterations; 1.5 s of it to compile" in text
    assert text.count("to compile") == 1 and text.splitlines()[-1] == "then it gave up: at t = 0.2 s no step passes"


def told(rejections: int, h: float = 0.1, status: str = "finished", **manifest):
    """`why` of ten steps, the first after attempts that would have ended too deep in a ball."""
    trouble = {"name": "CONTACT", "h": 0.2, "detail": "too deep inside a solid", "cloth": "sheet", "vertex": 7,
               "at": (0.0, 0.1, 0.0), "speed": 2.0, "against": "ball", "gap": -0.6}
    steps = [{"t": 0.1 * k, "h": h if k == 1 else 0.1, "solves": 4, "iterations": 9, "rejections": {},
              "seconds": {"total": 0.15, "CG": 0.06, "C-S": 0.03}} for k in range(1, 11)]
    steps[0] |= {"rejections": {"CONTACT": rejections} if rejections else {}, "troubles": [trouble] * rejections}
    return costliest(SimpleNamespace(path="run", telemetry=lambda: steps, manifest={"status": status, **manifest}), 2)


def test_a_refused_attempt_is_told_by_its_reason_and_advice_is_given_where_there_are_many():
    few, many, small = told(1), told(5), told(1, h=0.001)
    assert "first tried with h = 200 ms, and refused: cloth would end too deep inside a solid (CONTACT), at vertex 7" in few
    assert "in all 1 of 11 attempts at a step was refused and made smaller, as is usual: there is nothing to do" in few
    for text in (few, told(0)):
        assert "settle" not in text and "pinched" not in text and "slow" not in text
    for text in (many, small):
        assert text.splitlines()[-1].startswith("CONTACT ") and "pinned inside one" in text
    ended = told(1, status="gave up: the cloth starts through 'ball'")
    assert ended.splitlines()[-1] == "CONTACT 1, cloth would end too deep inside a solid"
    assert "5 of 15 attempts at a step were refused" in many and "nothing to do" not in many + small and "to 1 ms" in small


def test_why_begins_with_the_parts_of_all_the_time():
    """Drawing is none of the steps' time, and most of this run's; of a run that was gone on with the last part counts."""
    text = told(0, wall_s=10.0, output_seconds={"draw": 7.0, "write": 0.5}).splitlines()
    assert text[0] == "10.0 s in all:" and "70%    7.0 s  drawing pictures: --no-images draws none" in text[1]
    assert "10%    1.0 s  setting up" in text[3] and "5%   500 ms  writing files" in text[4]
    assert "15%    1.5 s  steps: linear solves 600 ms, contact with solids 300 ms" in text[2]
    later = told(0, wall_s=1.0, output_seconds={"draw": 0.2}, steps_before=6).splitlines()
    assert later[0] == "1.0 s in all since it was gone on with:" and "60%   600 ms  steps" in later[1]
    assert told(0, wall_s=0.5).startswith("10 steps took 1.5 s")


def test_why_names_the_worst_step_by_each_measure_before_the_costliest():
    """Energy unaccounted for, refused attempts, stretch: each of another step than the one that took longest."""
    steps = [{"t": 0.1 * k, "h": 0.1, "solves": 4, "iterations": 9, "seconds": {"total": 2 / k**2}, "rejections": {},
              "energies": {"kinetic": 2.0}, "ledger": {"unaccounted": 1e-4}, "stretch": 1.05} for k in range(1, 6)]
    calm = costliest(SimpleNamespace(path="run", telemetry=lambda: steps, manifest={}))
    assert calm.startswith("5 steps took")
    steps[1]["ledger"] = {"unaccounted": -0.3}
    steps[2]["rejections"] = {"ENERGY": 2, "NEWTON": 1}
    steps[3]["stretch"] = 1.75
    lines = costliest(SimpleNamespace(path="run", telemetry=lambda: steps, manifest={})).splitlines()
    assert lines[0] == "worst of 5 steps, by energy, refused attempts and stretch:" and lines[4].startswith("5 steps took")
    assert lines[1] == "    step 1 to t = 0.2 s: most energy unaccounted for, 0.3 J lost"
    assert lines[2] == "    step 2 to t = 0.3 s: most refused attempts, 3"
    assert lines[3] == "    step 3 to t = 0.4 s: largest stretch, 1.750 of the length at rest"


@pytest.mark.parametrize("reason, detail, says", [
    ("NEWTON", "8 solves", "forces were not yet in balance (NEWTON; 8 solves)"), ("OTHER", "", "OTHER (OTHER)"),
    ("CONTACT", "", "contacts did not settle (CONTACT)"),
    ("CONTACT", "3 crossings", "cloth would pass through a solid (CONTACT)"),
    ("CONTACT", "between layers of cloth", "layers of cloth found no step without a collision (CONTACT; between")])
def test_reasons_are_told_in_words(reason, detail, says):
    assert why_refused(reason, detail).startswith(says)
    assert set(MEANS) == set(ADVICE)


@pytest.mark.parametrize("part, text", [(1.004, "100 %"), (0.61, "61 %"), (0.0994, "9.9 %"), (0.012, "1.2 %")])
def test_parts_are_told_in_percent_without_exponents(part, text):
    assert percent(part) == text


def test_accounts_of_energy_are_told_in_words():
    told = changes(dict.fromkeys((*GAINS, *LOSSES), 1.0))
    assert len(told) == len(GAINS) + len(LOSSES) and not [name for name in told if "_" in name]


def test_first_launches_of_kernels_are_no_time_of_writing(monkeypatch):
    """The first checkpoint launches kernels, and was told as so many seconds "to write files"."""
    writer = object.__new__(Writer)
    writer.seconds = {"draw": 0.0, "write": 0.0}

    def checkpoint() -> str:
        monkeypatch.setattr(compiling, "seconds", compiling.seconds + 100.0)
        return "written"

    monkeypatch.setattr("taichi_cloth.app.running.time", SimpleNamespace(perf_counter=iter([0.0, 103.0]).__next__))
    assert writer._timed("write", checkpoint) == "written" and writer.seconds == {"draw": 0.0, "write": 3.0}


def test_a_recorded_simulation_ends_with_the_lines_of_a_run(tmp_path, capsys):
    scene = tc.Scene()
    scene.add_cloth(tc.grid(0.2, 3), FABRIC, contact=tc.ClothContact(0.003, 0.3))
    with tc.Simulation(scene) as sim:
        tc.record(sim, tmp_path / "run", duration=0.1, fps=20)
    said = capsys.readouterr().err
    for line in ("model: 16 vertices", "layers: at most 0 pairs", "cloth through cloth nowhere\n", "trouble: none", "energy: ",
                 "cost: 0.1 s simulated"):
        assert line in said
