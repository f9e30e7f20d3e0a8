"""Step control on attempts that are made up: when steps get smaller and larger, what is counted, what is rolled back."""

import numpy as np
import pytest

import taichi_cloth as tc
from taichi_cloth.step.attempt import Attempt
from taichi_cloth.step.stepper import Control, Stepper
from taichi_cloth.system.assembler import Measures

FINE = {"energies": {"kinetic": 1.0}, "dissipation": 0.0, "change": 0.0, "stretch": 1.0, "stretch_change": 0.0, "finite": True}


class Counted:
    """A model that counts, and an integrator whose attempts come from a list: a rejection's name, an error, or None."""

    def __init__(self, script=()):
        self.script, self.asked, self.calls = list(script), [], []
        self.order, self.forces, self.led, self.beside = 2, (), None, {}

    def save(self):
        self.calls.append("save")

    def restore(self):
        self.calls.append("restore")

    def commit(self, taken):
        self.calls.append("commit")

    def measure(self):
        return Measures(**FINE)

    def attempt(self, h, held_at, start):
        self.asked.append(h)
        what = self.script.pop(0) if self.script else None
        measures, rejection, error = Measures(**FINE), None, None
        if isinstance(what, Measures):
            measures = what
        elif isinstance(what, tuple):
            rejection, error = what
        else:
            rejection = what
        return Attempt(rejection, "why", measures, (), {}, error=error, order=self.order, led=self.led)

    def change_beside(self, led):
        return self.beside[led.sum()]


def held(t, h):
    """Nothing is."""


def stepper(script=(), **options):
    made = Counted(script)
    return Stepper(made, made, made, Control(**{"h_max": 0.08, "h_min": 0.01, **options})), made


def test_a_rejected_step_is_rolled_back_halved_and_counted_by_name():
    control, made = stepper(["ENERGY", "CONTACT", "ENERGY"])
    record = control.step(1.0, 0.08, held)
    assert made.asked == [0.08, 0.04, 0.02, 0.01] and record.h == 0.01 and record.t == 1.01
    assert record.rejections == {"ENERGY": 2, "CONTACT": 1}
    assert made.calls == ["save", "restore"] * 3 + ["save", "commit"]
    assert control.h == 0.01


def test_a_change_of_stretch_beyond_the_limit_is_a_rejection():
    wild = Measures(**{**FINE, "stretch_change": 0.5001})
    control, made = stepper([wild], stretch_limit=0.5)
    assert control.step(0.0, 0.08, held).rejections == {"STRETCH": 1} and made.asked == [0.08, 0.04]
    control, made = stepper([Measures(**{**FINE, "stretch_change": 0.4999})], stretch_limit=0.5)
    assert control.step(0.0, 0.08, held).rejections == {}


@pytest.mark.parametrize("beside, rejected", [(0.4999, {}), (0.5001, {"STRETCH": 1})])
def test_stretch_of_what_solids_lead_rejects_no_step(beside, rejected):
    control, made = stepper([Measures(**{**FINE, "stretch_change": 2.0})], stretch_limit=0.5)
    made.led, made.beside = np.array([True, False, True]), {2: beside}
    assert control.step(0.0, 0.08, held).rejections == rejected


@pytest.mark.parametrize("name", ["STRETCH", "ENERGY", "SOLVER", "NEWTON", "ACCURACY", "CONTACT", "APPROACH", "NOT_FINITE"])
def test_no_step_below_h_min_is_tried_and_giving_up_says_why(name):
    control, made = stepper([(name, 1e9)] * 99)
    with pytest.raises(tc.SimulationError, match=rf"gave up at t = 2 s.*h_min = 0.01.*{name} \(why\)") as caught:
        control.step(2.0, 0.08, held)
    assert min(made.asked) >= 0.01 and caught.value.reason == name
    assert made.calls.count("restore") == len(made.asked) and "commit" not in made.calls
    assert len(str(caught.value).split(f"{name} {len(made.asked)}. ")[1]) > 20  # advice


def test_h_doubles_after_quiet_steps_and_no_sooner_nor_further():
    control, made = stepper(["ENERGY"] * 3, quiet_steps=4)
    control.step(0.0, 0.08, held)
    taken = [control.h]
    for _ in range(14):
        control.step(0.0, 1.0, held)
        taken.append(control.h)
    assert taken == [0.01] * 3 + [0.02] * 4 + [0.04] * 4 + [0.08] * 4


def test_a_rejection_makes_quiet_steps_count_anew():
    control, made = stepper(["ENERGY", None, None, "ENERGY"], h_min=1e-9)
    for _ in range(3):
        control.step(0.0, 1.0, held)
    assert control.h == 0.02
    for _ in range(2):
        control.step(0.0, 1.0, held)
    assert control.h == 0.02
    control.step(0.0, 1.0, held)
    assert control.h == 0.04


@pytest.mark.parametrize("order, error, factor", [(2, 0.25, 1.8), (1, 0.6, 1.5), (2, 1e-9, 2.0), (2, 0.81, 1.0),
                                                  (1, 0.99, 0.9 / 0.99)])
def test_with_an_error_the_next_step_follows_it(order, error, factor):
    control, made = stepper([(None, error)], h_max=10.0)
    made.order = order
    control.step(0.0, 0.08, held)
    assert control.h == pytest.approx(0.08 * factor, rel=1e-12)


@pytest.mark.parametrize("error, factor", [(1.05, 0.7), (4.0, 0.45), (1e9, 0.1)])
def test_a_step_that_is_not_accurate_gets_as_small_as_its_error_says(error, factor):
    control, made = stepper([("ACCURACY", error)], h_min=1e-9)
    control.step(0.0, 0.08, held)
    assert made.asked[1] == pytest.approx(0.08 * factor, rel=1e-12)


def test_fixed_steps_are_taken_as_asked_for_and_named():
    control, made = stepper(["ENERGY"], adaptive=False)
    record = control.step(0.0, 0.03, held)
    assert made.asked == [0.03] and record.status == "ENERGY" and record.rejections == {}
    bad = Measures(**{**FINE, "finite": False, "stretch_change": 9.0})
    control, made = stepper([bad], adaptive=False)
    with pytest.raises(tc.SimulationError, match="step of 0.03 s from t = 0 s failed with STRETCH"):
        control.step(0.0, 0.03, held)
    assert made.calls[-1] == "restore"


def test_what_it_remembers_comes_back():
    control, _ = stepper(["ENERGY"])
    control.step(0.0, 0.08, held)
    other, _ = stepper()
    other.resume(control.checkpoint())
    assert (other.h, other.quiet, other.start) == (0.04, 1, Measures(**FINE))
