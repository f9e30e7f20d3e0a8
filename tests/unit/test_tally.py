"""What steps add up to, and logs that are shorter than a run. Most of it without a simulation."""

import json
import re
from dataclasses import asdict, replace

import pytest

import taichi_cloth as tc
from taichi_cloth.app import cli
from taichi_cloth.app.summary import _damps as damps_line
from taichi_cloth.app.summary import _energy as energy_line
from taichi_cloth.app.summary import _trouble as trouble_line
from taichi_cloth.app.summary import describe, summary
from taichi_cloth.recording.accounts import IN_WORDS, NUMERICAL_GAIN, changes
from taichi_cloth.recording.report import _energy, _trouble
from taichi_cloth.step.ledger import Ledger
from taichi_cloth.step.records import StepRecord, Tally, Trouble


def step(unaccounted: float = 0.0, **ledger: float) -> StepRecord:
    """One in which 2 J fell, 1.5 of them became motion and .5 were damped, but for what nobody knows of."""
    made = Ledger(**{"kinetic": 1.5 + unaccounted, "potential": -2.0, "damping": 0.5, **ledger})
    return StepRecord(0.1, 0.1, 7, 2, 1e-5, "CONVERGED", {"ENERGY": 1}, {"gravity": -2.0, "kinetic": 1.5}, 1.01, {"CG": 0.5},
                      contacts=3, min_gap_ratio=0.8, fallback_reason="TOUCH", ledger=made.record())


def test_what_moved_is_what_left_one_account_for_another():
    """Each joule once, whichever way it went; `kinetic_correction` is part of `method`, and no account of its own."""
    assert Tally.of([step()]).moved == pytest.approx(2.0)
    assert Tally.of([step(), step()]).moved == pytest.approx(4.0)
    assert Tally.of([step(pins=1.0, potential=-1.0)]).moved == pytest.approx(2.0)
    assert Tally.of([step(potential=-1.5, kinetic_correction=0.5, damping=0.0)]).moved == pytest.approx(1.5)
    assert Tally.of([step(0.5)]).moved == pytest.approx(2.5)  # 2 J that fell, and .5 from nowhere


@pytest.mark.parametrize("lost, told", [((0.1, -0.1), False), ((0.3, -0.3), True), ((0.0, 0.5), True), ((-1.0, 0.0), True)])
def test_more_than_a_tenth_of_it_unaccounted_for_is_said_with_what_helps(lost, told):
    """Of both signs: what one step loses another does not make up for."""
    tally = Tally.of([step(part) for part in lost])
    share = sum(map(abs, lost)) / sum(abs(1.5 + part) / 2 + 1.25 + abs(part) / 2 for part in lost)
    assert tally.share == pytest.approx(share, rel=1e-3) and bool(tally.doubt()) == told
    if told:
        assert f"{share:.0%} of the energy that moved is unaccounted for" in tally.doubt()
        assert all(way in tally.doubt() for way in ("smaller h", "--tolerance", "newton_euler"))
    assert ("of the energy that moved" in _energy(tally)) == told


def test_steps_whose_contacts_are_off_their_law_are_counted():
    """Those that are off by more than a hundredth, and by how much the worst is."""
    tally = Tally.of([replace(step(), contact_error=error) for error in (0.0, 0.009, 0.02, 0.3)])
    assert tally.unsolved == 2 and tally.contact_error == 0.3


def test_cloth_that_lies_still_is_not_doubted():
    still = StepRecord(0.1, 0.1, 1, 1, 1e-5, "CONVERGED", {}, {"gravity": -2.0}, 1.0,
                       ledger=Ledger(kinetic=1e-12, potential=1e-12).record())
    assert not Tally.of([still] * 100).doubt() and Tally().share == 0


@pytest.fixture(scope="module")
def simulations():
    """The same run three times, with all of its log, the last two steps, and none."""
    made = []
    for kept in ("all", 2, "none"):
        scene = tc.Scene()
        cloth = scene.add_cloth(tc.grid(0.5, 3), tc.Fabric(0.2, tc.Stretch(500)))
        scene.pin(cloth, "top_left")
        made.append(tc.Simulation(scene, h=1 / 60, integrator="backward_euler", log=kept))
    yield made
    for sim in made:
        sim.close()


@pytest.mark.slow
def test_a_log_is_as_long_as_was_asked_for_and_sums_are_of_all(simulations, tmp_path):
    runs = [tc.record(sim, tmp_path / str(k), 0.2, 10) for k, sim in enumerate(simulations)]
    every, last, none = simulations
    assert [len(sim.log) for sim in simulations] == [every.tally.steps, 2, 0] and every.tally.steps > 2
    assert [r.t for r in last.log] == [r.t for r in every.log[-2:]] and none.last.t == every.last.t
    apart = [{k: v for k, v in summary(sim).items() if k != "seconds"} for sim in simulations]
    assert apart[0] == apart[1] == apart[2] and apart[0] == json.loads(json.dumps(apart[0]))
    assert [len(run.telemetry()) for run in runs] == [every.tally.steps] * 3
    said = [describe(sim, 1.0, verbose=True).split("cost:")[0] for sim in simulations]
    assert said[0] == said[1] == said[2] and f"cloth through solids {every.tally.solid_intersections}\n" in said[0]
    assert "crossings" not in said[0] and "intersections" not in said[0]
    assert [sim.checkpoint()["records"] for sim in simulations] == [every.tally.steps] * 3
    assert f"{every.tally.steps} steps" in repr(none)
    # what the log says, added up here
    total = {name: sum(r.ledger[name] for r in every.log) for name in every.log[0].ledger}
    assert {k: v for k, v in summary(none)["energy"].items() if k in total} == pytest.approx(total, abs=1e-15)
    assert none.tally.iterations == sum(r.iterations for r in every.log)
    assert none.tally.residual == max(r.residual for r in every.log)
    # a page says the same of the folder as the last lines of the run
    page = Tally.of(StepRecord(**r) for r in runs[2].telemetry())
    assert _energy(page) == _energy(none.tally) and _trouble(page) == _trouble(none.tally)


def numbers_in(text: str) -> dict[str, float]:
    """Numbers with a sign, by the words before them."""
    words = re.sub("<[^>]+>", " ", text).replace("unaccounted for", "unaccounted")
    for name, said in [*IN_WORDS.items(), ("method", NUMERICAL_GAIN)]:
        words = words.replace(said, name)
    return {name: float(value) for name, value in re.findall(r"(\w+) +([+-][\d.e+-]*\d)", words)}


@pytest.mark.parametrize("ledger", [{"pins": 1.0, "damping": 0.5}, {"wind": -0.25, "method": -0.125, "plastic": 2.0}])
def test_a_run_and_its_report_give_energies_one_sign_and_say_which(ledger):
    """Gained is positive, lost negative, and the accounts add up to the change."""
    total = Tally.of([step(0.125, **ledger)]).ledger
    line, page = energy_line(total), _energy(Tally.of([step(0.125, **ledger)]))
    assert "+ gained by the cloth, - lost" in line and "+ gained by the cloth, - lost" in page
    said, told = numbers_in(line), numbers_in(page)
    change = said.pop("by")
    assert set(said) == {*ledger, "damping", "unaccounted"} and change == pytest.approx(sum(said.values()), abs=0.06)
    assert {name: told[name] for name in said} == pytest.approx(said, rel=0.05) and told["all"] == change
    assert all(said[name] == (-value if name in ("damping", "method", "plastic") else value) for name, value in ledger.items())


@pytest.mark.parametrize("lost, words", [(0.25, "numerical damping -0.25"), (-0.25, "numerical gain +0.25")])
def test_loss_and_gain_by_the_method_have_words_of_their_own(lost, words):
    """"The method of steps +0.25" did not say whether it was lost or gained."""
    total = Tally.of([step(method=lost)]).ledger
    assert words in energy_line(total) and sum(changes(total).values()) == pytest.approx(-0.5 - lost)


@pytest.mark.slow
def test_parts_of_the_time_add_up_to_the_one_total(simulations):
    """Steps, pictures, files and the rest."""
    sim = simulations[0]
    own = sim.tally.seconds["total"]
    said = describe(sim, own + 3.02, spent={"draw": 1.5, "write": 0.25}).split("cost: ")[1]
    assert f" simulated in {own + 3.02:.1f} s on cpu f64: " in said and "total" not in said
    assert f" for {sim.tally.steps} steps (linear solves " in said
    assert ", 1.5 s to draw pictures, 250 ms to write files, 1.3 s for set-up and all else; " in said


def test_what_a_log_cannot_keep_is_refused():
    for kept in (-1, 1.5, "some", "-2", None, True):
        with pytest.raises(tc.SceneError, match="^log = "):
            tc.Options(log=kept)
    assert [tc.Options(log=kept).log for kept in ("all", "12", 3, "none", 0)] == ["all", 12, 3, 0, 0]


def test_the_command_takes_it_too(tmp_path):
    args = cli._parser().parse_args(["run", "hang", "--log", "5"])
    assert tc.Options(log=args.log).log == 5 and "log" not in tc.Options(log=5).record()


def ended(**other):
    """`summary` of a run of 100 steps without any trouble, but for what is said."""
    return {"steps": 100, "rejections": {}, "smallest_h": 0.01, "unsolved_contact": 0, "contact_error": 0.0,
            "solid_intersections": 0, "known_intersections": 0, "pinched": 0, **other}


@pytest.mark.parametrize("other, says", [
    ({}, ["none"]), ({"rejections": {"CONTACT": 2, "NEWTON": 1}}, ["none; 3 of 103 attempts", "nothing to do"]),
    ({"rejections": {"CONTACT": 30}}, ["30 of 130 attempts", "`taichi-cloth why out` says where"]),
    ({"unsolved_contact": 20, "contact_error": 0.3}, ["none; ", "20 of 100 steps, by 30 % of all forces", "usual where"]),
    ({"unsolved_contact": 30, "contact_error": 0.3}, ["30 of 100 steps", "a smaller --h"]),
    ({"unsolved_contact": 30, "contact_error": 33.0}, ["30 of 100 steps", "by more than all forces together"]),
    ({"unsolved_contact": 1, "contact_error": 1.5}, ["trouble: forces", "by more than all forces together", "a smaller --h"]),
    ({"known_intersections": 895}, ["through cloth in 895 places at most, 7 at the end", "start it apart"]),
    ({"known_intersections": 8, "crossed": 0}, ["none; ", "through cloth in 8 places at most, none at the end: there"]),
    ({"known_intersections": 2, "pinched": 1}, ["through cloth in 2 places", "no room"]),
    ({"solid_intersections": 1}, ["through solids in 1 place at most", "start it where there is room"]),
    ({"solid_intersections": 9, "pinched": 2}, ["through solids in 9 places at most", "solids leave it no room"])])
def test_the_last_lines_say_whether_there_is_anything_to_do(other, says):
    """In plain words: names of rejections, residuals and the method of steps are told with --verbose alone."""
    line = trouble_line(ended(**other), 0.02, "out", other.get("crossed", 7))
    assert ("none" in line) == (line == "trouble: none\n" or "usual" in line or "nothing to do" in line)
    assert line.startswith("trouble: ") and all(word in line for word in says)
    for word in ("CONTACT", "NEWTON", "backward Euler", "Coulomb", "residual"):
        assert word not in line


def test_steps_too_large_for_their_motion_are_told_with_when_why_and_where():
    """Steps in contact are none of them, and three in ten are told of no more."""
    slow, fast = (Trouble("", 0.1, "", "flag", vertex, (0.0, 1.0, 2.0), speed) for vertex, speed in ((3, 2.0), (8, 5.0)))
    made = [replace(step(), t=0.1 * k, fallback_reason=reason, troubles=places)
            for k, reason, places in ((1, "", ()), (2, "ENERGY", (slow,)), (3, "NEWTON", (asdict(fast),)), (4, "ENERGY", ()),
                                      (5, "TOUCH", (replace(fast, speed=9.0),)), (6, "", ()))]
    line = damps_line(Tally.of(made))
    assert "3 of 6 steps were too large for their motion, from t = 0.1 to 0.4 s, which" in line
    assert "(the step would gain energy in 2, forces were not yet in balance in 1; fastest at vertex 8 of 'flag' at" in line
    assert damps_line(Tally.of(made[:1] * 5 + made)) == damps_line(Tally.of([made[4]] * 4)) == ""
    assert "fastest" not in damps_line(Tally.of(made[3:4]))


@pytest.mark.parametrize("other", [{"unsolved_contact": 30, "contact_error": 0.3}, {"solid_intersections": 1}, {}])
def test_nothing_to_do_is_told_only_where_no_advice_is(other):
    """A smaller --h and "there is nothing to do" stood in one line."""
    calm = {"rejections": {"CONTACT": 3}, "known_intersections": 8}
    line = trouble_line(ended(**calm, **other), 0.02, "out", 0)
    assert ("nothing to do" in line) == (not other) and "as is usual" in line and "none at the end" in line
    assert "nothing to do" not in trouble_line(ended(**calm), 0.02, "out", 0, other=True)


def test_numbers_of_the_solver_are_told_where_they_are_asked_for(simulations):
    plain, told = (describe(simulations[0], 1.0, verbose=verbose) for verbose in (False, True))
    assert "worst residual" in told and "rejected attempts: " in told and "worst residual" not in plain
    assert plain.splitlines() == [line for line in told.splitlines() if not line.startswith("detail: ")]
