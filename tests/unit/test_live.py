"""A session: played, paused, stepped, begun again, changed and pulled at, with a real simulation and no page."""

import os
import signal
import types

import numpy as np
import pytest
from test_second_simulation import Compiled

import taichi_cloth as tc
from taichi_cloth.errors import SimulationError
from taichi_cloth.live import session as module
from taichi_cloth.live import teller as module_of_teller
from taichi_cloth.live import view
from taichi_cloth.live.hand import WEIGHTS
from taichi_cloth.live.parameters import Parameter
from taichi_cloth.live.seen import Building, Seen
from taichi_cloth.live.session import Session
from taichi_cloth.live.teller import Teller
from taichi_cloth.live.view import Given, Made, serve
from taichi_cloth.live.words import costly, state
from taichi_cloth.options import Options

pytestmark = pytest.mark.slow  # the first of them compiles
DENSITY, H = 0.2, 1 / 60
PARAMETERS = (Parameter("cells", 4), Parameter("k", 300.0), Parameter("wind", 0.0), Parameter("damping", 0.3))


def build(settings: dict) -> tc.Scene:
    """A sheet that hangs from two corners, in air."""
    scene = tc.Scene(air=tc.Air(0.5, wind=(settings["wind"], 0, 0)))
    stretch, shear = tc.Stretch(settings["k"], settings["damping"]), tc.Shear(30, settings["damping"] / 10)
    bend = tc.Bend(1e-5, settings["damping"] / 1e6)
    cloth = scene.add_cloth(tc.grid(0.5, settings["cells"]), tc.Fabric(DENSITY, stretch, shear, bend))
    scene.pin(cloth, ["top_left", "top_right"])
    return scene


class Clock:
    """Time goes on by two milliseconds whenever somebody looks: five or so times a step."""

    def __init__(self):
        self.now = 100.0

    def monotonic(self):
        self.now += 0.002
        return self.now


@pytest.fixture
def session(monkeypatch):
    monkeypatch.setattr(module, "time", Clock())
    monkeypatch.setattr(module, "IDLE", 0.0)
    seen = []
    made = Session(Made(build, Options(h=H), PARAMETERS), lambda s: seen.append((s.preview, len(s.arrays["x"]))))
    made.seen = seen
    made.begin(plays=False)
    yield made
    made.end()
    assert not made.sim.is_open


def ask(session, *calls) -> None:
    for call in calls:
        session.orders.put(call)
    session.turn()


def turns(session, count: int) -> None:
    for _ in range(count):
        session.turn()


def test_play_pause_step_and_reset(session):
    assert session.seen == [(True, 25), (False, 25)] and session.sim.time == 0  # the scene is shown before it is simulated
    start = session.sim.positions()
    turns(session, 5)
    assert session.sim.time == 0
    ask(session, session.step)
    assert session.sim.time == pytest.approx(H) and not session.running and session.sim.tally.steps == 1
    ask(session, session.play)
    turns(session, 60)
    assert session.running and session.sim.time > 5 * H
    ask(session, session.pause)
    stopped = session.sim.time
    turns(session, 5)
    assert session.sim.time == stopped and "paused at t = " in state(session) and "steps took" in costly(session)
    ask(session, session.reset)
    assert session.sim.time == 0 and np.array_equal(session.sim.positions(), start) and not session.running


def test_it_keeps_to_the_clock_and_does_not_rush_after_what_it_lost(session):
    clock = module.time
    ask(session, session.play)
    began = clock.now
    turns(session, 100)
    assert clock.now - began - 2 * H < session.sim.time <= clock.now - began + H and session.sim.tally.steps < 80
    before = session.sim.time
    clock.now += 1000.0  # the machine slept
    began = clock.now
    turns(session, 100)
    assert session.sim.time - before <= clock.now - began + 2 * H


def test_another_stiffness_goes_on_with_the_cloth_as_it_is(session):
    ask(session, *[session.step] * 5)
    x, v, t, was = session.sim.positions(), session.sim.velocities(), session.sim.time, session.sim
    session.seen.clear()
    ask(session, lambda: session.set("k", 900.0))
    assert np.allclose(session.sim.positions(), x, atol=1e-12) and np.allclose(session.sim.velocities(), v, atol=1e-12)
    assert session.sim.time == t and session.settings["k"] == session.sim.scene.cloths[0].fabrics[0].stretch.k == 900.0
    assert session.seen == [(False, 25)] and session.trouble == "" and not was.is_open
    ask(session, session.step)
    assert session.sim.time == pytest.approx(t + H)


def test_a_change_is_seen_before_the_next_step(session):
    ask(session, session.step, session.play)
    turns(session, 20)
    t, seen = session.sim.time, []
    session.show = lambda s: seen.append((float(s.arrays["t"]), s.sim.scene.cloths[0].fabric.stretch.k))
    ask(session, lambda: session.set("k", 700.0))
    assert session.running and seen[0] == (pytest.approx(t), 700.0)


def test_nothing_but_the_first_step_is_made_before_somebody_looks(session):
    session.watched = False
    ask(session, session.play)
    turns(session, 20)
    assert session.running and session.sim.tally.steps == 1
    module.time.now += 100.0  # it takes a browser long to start
    session.ask("watch")
    turns(session, 20)
    assert 1 < session.sim.tally.steps <= 21 and session.sim.time < 21 * H


def test_fabrics_with_and_without_damping_take_turns_and_no_kernel_is_compiled(session, monkeypatch):
    """Nor does cloth without damping move otherwise by the kernels of one with it."""
    ask(session, *[session.step] * 3)
    compiled = Compiled(monkeypatch)
    for damping, k in ((0.0, 500.0), (0.2, 400.0), (0.0, 300.0)):
        ask(session, lambda d=damping: session.set("damping", d), lambda k=k: session.set("k", k), session.step)
        assert session.trouble == "" and not compiled.new()
    ask(session, session.reset, *[session.step] * 5)
    with tc.Simulation(build(session.settings), h=H) as alone:
        alone.run(5 * H, 1 / H)
        assert np.allclose(session.sim.positions(), alone.positions(), atol=1e-12)


def test_before_the_first_step_another_fabric_is_shown_at_once(session, monkeypatch):
    """There is nothing to go on from: the energies that going on looks at would take their compiled kernels first."""
    session.seen.clear()
    monkeypatch.setattr(tc.Simulation, "resume", lambda *_, **__: pytest.fail("it goes on"))
    ask(session, lambda: session.set("k", 900.0))
    assert session.seen == [(True, 25), (False, 25)] and session.trouble == "" and session.settings["k"] == 900.0


def test_another_mesh_begins_again_and_is_shown_before_it_is_simulated(session):
    ask(session, *[session.step] * 3)
    session.seen.clear()
    ask(session, lambda: session.set("cells", 6))
    assert session.seen == [(True, 49), (False, 49)] and session.sim.time == 0 and session.settings["cells"] == 6


def test_an_impossible_value_is_told_and_the_scene_before_goes_on(session):
    ask(session, session.step)
    was, settings = session.sim, session.settings
    for name, value, said in (("k", -1.0, "stretch"), ("cells", 0, "cells"), ("wind", np.nan, "wind")):
        ask(session, lambda name=name, value=value: session.set(name, value))
        assert said in session.trouble.lower() and "Error: " in state(session), name
        assert session.sim is was and was.is_open and session.settings == settings
        assert session.seen[-1] == (False, 25)
    session.ask("look")
    session.turn()
    assert "wind" in session.trouble  # it stays while the page is only looked at
    session.ask("step")
    session.turn()
    assert session.trouble == "" and session.sim.time == pytest.approx(2 * H)


def test_what_cannot_be_simulated_leaves_the_one_before(session, monkeypatch):
    ask(session, session.step)
    was = session.sim

    def fails(scene):
        raise tc.SceneError("no such simulation")

    monkeypatch.setattr(session.source, "simulation", fails)
    ask(session, session.reset)
    assert session.trouble == "no such simulation" and session.sim is was and session.seen[-2:] == [(True, 25), (False, 25)]


def test_a_hand_pulls_with_so_many_weights_at_most_and_lets_go(session):
    ask(session, lambda: session.set("cells", 16))
    x = session.sim.positions()
    vertex = int(np.argmin(np.linalg.norm(x - [0.25, 0, -0.25], axis=1)))
    weight = DENSITY * 0.25 * 9.81
    ask(session, lambda: session.grab(x[vertex] + 1e-3))
    assert session.hand.vertex == vertex and not session.sim.attachment_forces().any()
    ask(session, lambda: session.drag(x[vertex] + [0, 3.0, 0]))
    force = session.sim.attachment_forces()
    assert np.flatnonzero(force.any(axis=1)).tolist() == session.hand.patch.tolist() and len(session.hand.patch) > 3
    assert force.sum(axis=0) == pytest.approx([0, WEIGHTS * weight, 0], rel=1e-9)
    for _ in range(20):
        ask(session, session.step)
    assert session.sim.positions()[vertex, 1] > 0.05 and "pulled" in state(session)  # up, where it would have hung down
    ask(session, session.drop)
    assert not session.sim.attachment_forces().any() and session.hand is None
    turned = session.sim.positions()
    ask(session, lambda: session.set("k", 500.0))  # changes by hand are no reason to begin again
    assert np.allclose(session.sim.positions(), turned, atol=1e-12) and session.sim.time > 0.3


def test_a_hand_takes_what_is_free(session):
    corner = session.sim.scene.cloths[0].mesh.select("top_left")[0]
    ask(session, lambda: session.grab(session.sim.positions()[corner]))
    assert session.hand.vertex != corner and session.trouble == ""
    ask(session, session.drop)
    session.sim.pin(session.sim.scene.cloths[0], np.arange(25))
    ask(session, lambda: session.grab(np.zeros(3)))
    assert "held already" in session.trouble


def test_cloth_of_an_explicit_method_is_not_pulled_at():
    source = Made(build, Options(h=H, integrator="verlet"), PARAMETERS)
    session = Session(source, lambda s: None)
    session.begin(plays=False)
    ask(session, lambda: session.grab(np.zeros(3)))
    assert "explicit method 'verlet' cannot be pulled at" in session.trouble and session.hand is None
    session.end()


def test_a_wind_is_added_and_stays_when_it_begins_again(session):
    weight = DENSITY * 0.25 * 9.81
    assert session.sim.forces()[:, 1].sum() == pytest.approx(-weight, rel=1e-9)
    ask(session, lambda: session.blow(np.array([0, 4.0, 0])))
    assert session.sim.forces()[:, 1].sum() == pytest.approx(0.5 * 0.25 * 4.0 - weight, rel=1e-9)
    ask(session, lambda: session.set("wind", 2.0), session.reset)
    assert session.sim.prescribed.script.air.wind_at(0.0).tolist() == [2.0, 4.0, 0]
    assert session.sim.forces()[:, 1].sum() == pytest.approx(0.5 * 0.25 * 4.0 - weight, rel=1e-9)
    ask(session, lambda: session.blow(np.zeros(3)))
    assert session.sim.prescribed.script.air.wind_at(0.0).tolist() == [2.0, 0, 0]


def test_heat_maps_are_those_that_the_scene_has(session):
    assert session.heats() == ["stretch", "shear", "bend", "speed"]
    ask(session, lambda: session.color_by("speed"), session.reset)
    assert session.heat == "speed"
    ask(session, lambda: session.color_by("seam"))
    assert "seam" in session.trouble and session.heat == "speed"


def test_a_step_that_fails_pauses(session, monkeypatch):
    def fails():
        raise SimulationError("gave up here")

    ask(session, session.play)
    monkeypatch.setattr(session.sim, "step", fails)
    turns(session, 3)
    assert not session.running and session.trouble == "gave up here"
    monkeypatch.setattr(session.sim, "step", lambda: 1 / 0)
    ask(session, session.step)
    assert session.trouble == "ZeroDivisionError: division by zero"


def test_a_given_simulation_goes_on_from_where_it_is_and_stays_open():
    with tc.Simulation(build({p.name: p.value for p in PARAMETERS}), h=H) as sim:
        sim.step()
        seen = []
        session = Session(Given(sim), lambda s: seen.append((s.preview, float(s.arrays["t"]))))
        session.begin(plays=False)
        assert session.sim is sim and seen == [(False, pytest.approx(H))]
        ask(session, session.step)
        assert sim.time == pytest.approx(2 * H)
        ask(session, lambda: session.grab(np.zeros(3)))
        assert "without soft attachments" in session.trouble
        session.end()
        assert sim.is_open
        for options, named in (({"h": 0.1}, "h"), ({"plays": 3}, "plays"), ({"host": 3}, "host")):
            with pytest.raises(tc.ClothError, match=named):
                sim.view(**options)
    with pytest.raises(tc.BackendError, match="closed"):
        sim.view()


class Told:
    """Stands for the process of a page."""

    address, made = "http://there:1", []

    def __init__(self, host, port):
        self.messages, self.open = [], True
        Told.made.append(self)

    def wait(self) -> str:
        return self.address

    def tell(self, message):
        self.messages.append(message)

    def listen(self, session, teller):
        self.session, self.teller = session, teller

    def close(self):
        self.open = False


@pytest.mark.parametrize("end", ["click", "interrupt", "signal", "signal as it is made", "error"])
def test_a_page_is_served_until_it_is_ended(monkeypatch, request, end):
    class Ends(Told):
        def tell(self, message):
            super().tell(message)
            if len(self.messages) > 2:  # the opening, the preview, a picture
                if end == "interrupt":
                    raise KeyboardInterrupt
                if end == "signal":
                    os.kill(os.getpid(), signal.SIGINT)
                    return  # of the step nothing is lost
                self.session.ask("finish")

    def fails(scene):
        raise tc.SceneError("no simulation of it")

    def interrupted(scene):
        os.kill(os.getpid(), signal.SIGINT)
        made.append("whole")
        return Made.simulation(source, scene)

    said, made, source = [], [], Made(build, Options(h=H), PARAMETERS)
    before = signal.signal(signal.SIGINT, signal.default_int_handler)  # else it may be ignored
    request.addfinalizer(lambda: signal.signal(signal.SIGINT, before))
    monkeypatch.setattr(view, "Link", Ends)
    monkeypatch.setattr(view.webbrowser, "open", said.append)
    if end == "error":
        monkeypatch.setattr(source, "simulation", fails)
        with pytest.raises(tc.SceneError, match="no simulation of it"):
            serve(lambda: source, "title", "host", None, True, True, said.append)
    else:
        if end == "signal as it is made":
            monkeypatch.setattr(source, "simulation", interrupted)
        serve(lambda: source, "title", "host", None, True, True, said.append)
        assert made == ["whole"] * (end == "signal as it is made")
    link = Told.made[-1]
    assert said[0].split()[:5] == ["title", "is", "shown", "at", "http://there:1"], "nothing clings to the address"
    assert said[1:3] == ["http://there:1", "setting up ..."] and not link.open
    assert link.messages[0].title == "title" and link.messages[0].airy and link.messages[1].heats is None


def test_a_change_is_told_with_the_time_from_which_on_it_holds(session):
    session.begin(plays=False)
    session.step()
    for order, values, told in (("set", ("k", 400.0), "k: 400, from t = 0.017 s"), ("set", ("k", -1.0), "k: -1: not possible"),
                                ("blow", (np.array([1.0, 0, 0]),), "wind added: 1, 0, 0 m/s, from t = 0.017 s"),
                                ("set", ("cells", 5), "cells: 5, from t = 0.000 s")):
        before = session.changes
        session.ask(order, values)
        session.turn()
        assert (session.change, session.changes) == (told, before + 1)
    session.ask("step")
    session.turn()
    assert session.changes == before + 1, "a step is no change"


def test_building_is_told_once_and_how_long_it_took(session, monkeypatch):
    told, said = [], []
    teller = Teller("title", told.append, said.append)
    monkeypatch.setattr(module_of_teller, "time", types.SimpleNamespace(monotonic=lambda: clock[0]))
    clock = [10.0]
    session.show = teller
    ask(session, session.step)
    teller.shown(session)
    for _ in range(3):
        teller.building()  # three kernels
    assert [type(message) for message in told[2:]] == [Building]
    clock[0] = 14.2
    ask(session, session.step)
    assert said == ["loading or compiling kernels took 4 s"] and isinstance(told[-1], Seen) and not told[-1].preview
    teller.shown(session)
    ask(session, session.step)
    assert len(said) == 1
    teller.building()
    clock[0] += 3.0
    ask(session, session.step)  # the page is busy with the picture before
    clock[0] += 9.0
    teller.shown(session)
    ask(session, session.step)
    assert said[1:] == ["loading or compiling kernels took 3 s"]


def test_a_page_is_told_no_faster_than_it_shows(session):
    told = []
    teller = Teller("title", told.append)
    session.show = teller
    ask(session, session.step)
    opened, first = told
    assert opened.parameters == PARAMETERS and opened.again
    assert np.allclose(first.x, session.sim.positions(), atol=1e-6)
    assert sum(len(piece.faces) for piece in first.pieces.values()) == 32
    ask(session, session.step)
    ask(session, session.step)
    assert len(told) == 2  # it has not shown the first yet
    teller.shown(session)
    session.turn()
    assert len(told) == 3 and told[2].pieces is None and "t = 0.050 s" in told[2].state
    assert np.allclose(told[2].x, session.sim.positions(), atol=1e-6) and "A step of 16.7 ms" in told[2].last
    teller.shown(session)
    session.turn()
    assert len(told) == 3  # it has shown all there is
    ask(session, lambda: session.set("cells", 6))
    assert told[3].heats is None and told[3].number != told[2].number and len(told[3].x) == 49  # the preview, at once
    teller.shown(session)
    session.turn()
    assert told[4].heats == ("stretch", "shear", "bend", "speed") and len(told) == 5
    x = session.sim.positions()[10]
    teller.shown(session)
    ask(session, lambda: session.grab(x), lambda: session.drag(x + [0, 0, 0.1]), lambda: session.color_by("speed"))
    assert told[5].hand == pytest.approx(np.array([x, x + [0, 0, 0.1]]), abs=1e-6) and told[5].heat.text == "0 to 2 m/s"
