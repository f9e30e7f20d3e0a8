"""Parts of a live page that need neither a simulation nor viser: parameters, orders, ports, winds, pieces, controls."""

import dataclasses
import inspect
import io
import itertools
import socket
import subprocess
import sys
import threading
import time
import types
import unittest.mock

import numpy as np
import pytest

import taichi_cloth as tc
from taichi_cloth.app import scenefile
from taichi_cloth.live import counting, pages, server
from taichi_cloth.live.controls import LOOK, SETTING_UP, Controls
from taichi_cloth.live.hand import pullable
from taichi_cloth.live.orders import Orders
from taichi_cloth.live.page import Page
from taichi_cloth.live.parameters import Parameter, parameters
from taichi_cloth.live.seen import Opening, Scale, Seen
from taichi_cloth.live.session import ASKED, added
from taichi_cloth.live.shapes import BANDS, Shapes, points
from taichi_cloth.live.teller import opening
from taichi_cloth.live.words import last_step
from taichi_cloth.output import drawn
from taichi_cloth.output.camera import frame
from taichi_cloth.output.look import Heat
from taichi_cloth.recording import record
from taichi_cloth.recording.why import lasting
from taichi_cloth.step.records import StepRecord


def options(function) -> dict:
    return dict(inspect.signature(function).parameters)


def build(cells: int = 20, speed: float = 2.0, down: float = -0.5, free: float = 0.0, itself: bool = False, clip: str = "a",
          path=None):
    """Parameters of every kind."""


def test_parameters_have_a_control_that_fits_their_type():
    found = {p.name: p for p in parameters(options(build), {"speed": (0, 12)}, {"cells": 90})}
    assert list(found) == ["cells", "speed", "down", "free", "itself", "clip"]  # what has no plain default has no control
    assert found["cells"] == Parameter("cells", 90, (1, 90)) and found["cells"].step == 1
    assert found["speed"].range == (0, 12) and type(found["speed"].range[0]) is float and found["speed"].step == 0.05
    assert found["down"].range == (-2.0, 0.0) and found["free"].range is found["itself"].range is found["clip"].range is None


@pytest.mark.parametrize("ranges, named", [({"sped": (0, 1)}, "'speed'"), ({"speed": 3}, "pair"), ({"speed": (2, 1)}, "less"),
                                           ({"speed": (0, "x")}, "RANGES"), ([1], "RANGES")])
def test_impossible_ranges_are_refused(ranges, named):
    with pytest.raises(tc.SceneError, match=named):
        parameters(options(build), ranges)


def test_of_orders_with_one_key_the_last_is_made():
    orders, made = Orders(), []
    for k in range(3):
        orders.put(lambda k=k: made.append(("slid", k)), "slider")
        orders.put(lambda k=k: made.append(("stepped", k)))
    for call in orders.take():
        call()
    assert made == [("stepped", 0), ("stepped", 1), ("slid", 2), ("stepped", 2)] and orders.take() == []


def test_an_order_from_another_thread_ends_the_wait():
    orders = Orders()
    threading.Timer(0.05, lambda: orders.put(lambda: "done")).start()
    assert [call() for call in orders.take(30.0)] == ["done"]


def test_a_breeze_is_added_to_any_wind():
    x, breeze = np.arange(6.0).reshape(2, 3), np.array([1.0, 0.0, -2.0])
    assert added(tc.Air(1.0, wind=(3.0, 0, 0)), breeze).tolist() == [4.0, 0.0, -2.0]
    assert added(tc.Air(1.0, wind=lambda t: (t, 0, 0)), breeze)(5.0).tolist() == [6.0, 0.0, -2.0]
    gusts = tc.Gusts((1.0, 0, 0), 0.5)
    air = tc.Air(1.0, wind=added(tc.Air(1.0, wind=gusts), breeze))
    assert air.varies_in_space and np.array_equal(air.wind_at(0.3, x), gusts(x, 0.3) + breeze)


def test_a_scene_is_pullable_for_a_simulation_and_then_as_it_was():
    scene = tc.Scene()
    with pullable(scene):
        assert len(scene.forces) == 1
    assert scene.forces == []
    cloth, ball = scene.add_cloth(tc.grid(1.0, 2), tc.Fabric(0.2)), scene.add_solid(tc.Sphere(0.1), 0.3, 0.01)
    scene.attach(cloth, 0, ball, stiffness=3.0)
    with pullable(scene):
        assert scene.forces == []  # soft attachments are there already, and there may be but one such force


def test_a_port_that_is_taken_is_refused_by_its_number_or_passed_over(monkeypatch):
    with socket.create_server((server.HOST, 0)) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(tc.OutputError, match=f"port {port} .*--port"):
            server.free_port(server.HOST, port)
        monkeypatch.setattr(server, "FIRST", port)
        assert port < server.free_port(server.HOST, None) < port + server.TRIES
        monkeypatch.setattr(server, "TRIES", 1)
        with pytest.raises(tc.OutputError, match="none of the ports"):
            server.free_port(server.HOST, None)
    for port in (0, 70000):
        with pytest.raises(tc.OutputError, match="--port"):
            server.free_port(server.HOST, port)
    with pytest.raises(tc.OutputError, match="no such host"):
        server.free_port("no host", None)


def test_without_viser_one_line_says_how_to_get_it(monkeypatch, capsys):
    from taichi_cloth.app.cli import main

    monkeypatch.setitem(sys.modules, "viser", None)
    assert main(["view", "hang", "--no-open"]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1 and "pip install 'taichi-cloth[view]'" in said
    assert main(["view", "hnag", "--no-open"]) == 2 and "did you mean 'hang'" in capsys.readouterr().err


def test_the_page_of_any_scene_takes_a_fabric_and_a_wind(monkeypatch):
    """Texts beside the scene's own parameters, each with the line that says what it is; empty, the scene's own is there."""
    from taichi_cloth.app.cli import main
    from taichi_cloth.live import view

    given: list = []
    monkeypatch.setattr(view, "serve", lambda make, *_: given.append(make()))
    assert main(["view", "hang", "--set", "cells=3", "--set", "wind=gale", "--no-open"]) == 0
    source = given[0]
    values = {p.name: p.value for p in source.parameters}
    assert [p.name for p in source.parameters if p.every] == ["fabric", "wind"]
    assert values["cells"] == 3 and (values["fabric"], values["wind"]) == ("", "gale")
    said = {p.name: p.meaning for p in source.parameters}
    assert all(said.values()) and "[m]" in said["size"]
    own, denim, still = (source.scene({**values, **more}) for more in ({}, {"fabric": "denim"}, {"wind": ""}))
    assert own.cloths[0].fabric.density == 0.15 and denim.cloths[0].fabric.density == tc.fabrics["denim"].density
    assert own.air.wind_at(0.0).tolist() == [19, 0, 0] and not np.any(still.air.wind_at(0.0))
    for name, wrong, meant in (("fabric", "denmi", "denim"), ("wind", "breze", "breeze")):
        with pytest.raises(tc.SceneError, match=f"'{wrong}'.*did you mean '{meant}'"):
            source.scene({**values, name: wrong})


@pytest.mark.parametrize("odd", [{"host": 3}, {"host": None}, {"port": "x"}, {"port": 0}, {"port": 1.5}, {"port": 70_000},
                                 {"opens": 3}, {"plays": None}, {"h": -1.0}, {"colour": "red"}])
def test_odd_arguments_of_a_view_are_refused_before_anything_starts(monkeypatch, odd):
    from taichi_cloth.live import view

    monkeypatch.setattr(view, "serve", lambda *_: pytest.fail("it started"))
    with pytest.raises(tc.SceneError, match=next(iter(odd))):
        tc.view(tc.Scene(), **odd)


@pytest.mark.parametrize("what, named", [(3, "must be a Scene or a Simulation"), ("hang", "Scene")])
def test_only_scenes_and_simulations_are_shown(what, named):
    with pytest.raises(tc.SceneError, match=named):
        tc.view(what)


def two_colours() -> dict:
    """A red and a blue cloth over a ball and a floor."""
    scene = tc.Scene()
    scene.add_cloth(tc.grid(1.0, 3), tc.Fabric(0.2), color=(1.0, 0, 0))
    scene.add_cloth(tc.grid(1.0, 2), tc.Fabric(0.2), color=(0, 0, 1.0))
    scene.add_solid(tc.Sphere(0.1), 0.3, 0.01)
    scene.add_solid(tc.Plane(), 0.3, 0.01, position=(0, -1, 0))
    return record.as_built(scene)


def test_pieces_are_all_triangles_each_in_its_colour():
    g = two_colours()
    arrays = {"x": g["x"], "solid_x": g["solid_x"] + [0, 5, 0]}
    shapes, x = Shapes(g), points(g, arrays)
    pieces = list(shapes.pieces(g, arrays, None).values())
    assert sorted((p.cloth, p.color) for p in pieces)[1:] == [(True, (0, 0, 255)), (True, (255, 0, 0))]
    corners = np.concatenate([x[p.index][p.faces] for p in pieces]).reshape(-1, 9)
    wanted = np.concatenate([g["x"][g["faces"]], arrays["solid_x"][g["solid_faces"]]]).reshape(-1, 9)
    assert np.allclose(np.sort(corners, axis=0), np.sort(wanted, axis=0), atol=1e-6)
    assert shapes.pieces(g, arrays, None) is shapes.pieces(g, arrays, None)  # what stays is not made again


def test_hems_that_a_page_does_not_draw_are_not_sought(monkeypatch):
    """They took a third of the time up to its first picture."""
    monkeypatch.setattr(drawn, "borders", None)
    scene = tc.Scene()
    scene.add_cloth(tc.grid(1.0, 2), tc.Fabric(0.2, tc.Stretch(100)), color=tc.Appearance("teal", hem=0.02))
    assert len(Shapes(record.as_built(scene)).colors) == 8


def test_a_heat_map_has_the_colour_of_each_triangles_value():
    from taichi_cloth.output.colors import heat_colors, to_srgb

    g = two_colours()
    arrays, n = {"x": g["x"]}, len(g["x"])
    heat = Heat("height", "m", lambda frame: np.linspace(0, 1, n), (0.0, 1.0), False)
    pieces = [p for p in Shapes(g).pieces(g, arrays, heat).values() if p.cloth]
    assert sum(len(p.faces) for p in pieces) == len(g["faces"]) and 2 < len(pieces) <= 2 * BANDS
    scale = np.linspace(0, 1, 1001)
    table = to_srgb(heat_colors(scale, 0, 1, False)).astype(int)
    for p in pieces:
        value = np.linspace(0, 1, n)[p.index[p.faces]].mean(axis=1)
        shown = scale[np.abs(table - p.color).sum(axis=1).argmin()]
        assert (np.abs(value - shown) <= 0.5 / BANDS + 2e-3).all()


def test_torn_cloth_has_its_new_triangles():
    g = two_colours()
    shapes, arrays = Shapes(g), {"x": g["x"]}
    shapes.pieces(g, arrays, None)
    torn = g["faces"].copy()
    torn[0] = torn[0, ::-1]
    moved = shapes.pieces(g, arrays | {"faces": torn}, None)
    triangles = np.concatenate([p.index[p.faces] for p in moved.values() if p.cloth])
    assert {tuple(row) for row in triangles} == {tuple(row) for row in torn}


@pytest.mark.parametrize("seconds, words", [(0.0123, "12.3 ms"), (3.26, "3.3 s"), (0.9996, "1.0 s"),
                                            (0.9994, "999 ms"), (123.0, "123.0 s")])
def test_times_are_in_ms_or_s(seconds, words):
    assert lasting(seconds) == words


def test_a_step_is_told_in_sentences():
    step = StepRecord(0.5, 1 / 60, 23, 1, 1e-4, "CONVERGED", {"STRETCH": 2}, {}, 1.25, {"total": 0.0123}, contacts=3,
                      fallback_reason="")
    said = last_step(step)
    assert "1 solve, 23 iterations" in said and "took 12.3 ms" in said and "1.250" in said and "3 places" in said
    assert "2 longer attempts were refused: a triangle would stretch by more than stretch_limit" in said


class Gui:
    """Stands for viser's: a control is a bag of what it was made with, and remembers whom it is to tell."""

    def __init__(self):
        self.made = {}

    def __getattr__(self, kind):
        def add(label="", *args, **options):
            control = types.SimpleNamespace(kind=kind, label=label, args=args, options=options, calls=[], content="",
                                            visible=options.get("visible", True))
            control.value = args[-1] if args else options.get("initial_value")
            if kind == "add_dropdown":
                control.options, control.value = args[0], options["initial_value"]
            control.on_update = control.on_click = control.calls.append
            control.__enter__ = control.__exit__ = lambda *_: None
            self.made[str(label) if isinstance(label, str) else kind] = control
            return Folder() if kind == "add_folder" else control

        return add

    def clicked(self, label, value=None, client="a browser"):
        """A person turns a control."""
        control = self.made[label]
        control.value = value
        for call in control.calls:
            coroutine = call(types.SimpleNamespace(client=client))
            with pytest.raises(StopIteration):
                coroutine.send(None)


class Folder:
    __enter__ = __exit__ = lambda *_: None


def opened(airy: bool) -> Opening:
    offered = parameters(options(build), {})
    return Opening("a title", offered, True, airy, (0, 0, 1), (0, 0, 0), (0, 1, 0), 35.0, (0, 0, 0), 1.0)


def seen(**changed) -> Seen:
    usual = {"number": 1, "x": np.zeros((0, 3)), "pieces": {}, "state": "paused", "running": False, "preview": False,
             "changes": 0, "change": "", "heats": ("stretch", "bend"), "heat": None, "hand": None, "last": None,
             "costly": None}
    return Seen(**{**usual, **changed})


def test_every_control_asks_for_what_it_says():
    gui, asked = Gui(), []
    controls = Controls(gui, opened(airy=True), lambda *wish: asked.append(wish))
    controls.show(seen())
    assert gui.made["by"].options == (LOOK, "stretch", "bend") and gui.made["Play"].label == "Play"
    turned = {"Play": None, "Step": None, "Reset": None, "cells": 12.0, "speed": 3, "itself": True, "clip": "walk", "x": 4.0}
    for label, value in {**turned, "by": "bend", "edges": True, "End": None}.items():
        gui.clicked(label, value)
    assert asked[:7] == [("play", (), "run"), ("step", (), ""), ("reset", (), "reset"), ("set", ("cells", 12), "set cells"),
                         ("set", ("speed", 3.0), "set speed"), ("set", ("itself", True), "set itself"),
                         ("set", ("clip", "walk"), "set clip")]
    assert type(asked[3][1][1]) is int and type(asked[4][1][1]) is float
    assert asked[7][0] == "blow" and asked[7][1][0].tolist() == [4.0, 0.0, 0.0]
    assert asked[8:] == [("color_by", ("bend",), "heat"), ("look", (), "look"), ("finish", (), "")]
    assert {name for name, *_ in asked} | {"pause", "grab", "drag", "drop", "watch"} == set(ASKED)
    gui.clicked("by", LOOK)
    gui.clicked("cells", 5, client=None)  # the program's own change is no wish
    controls.show(seen(running=True, last="a step", costly="one\ntwo", heat=Scale(np.zeros((1, 1, 3)), "0 to 1 m")))
    gui.clicked("Play")
    assert asked[11:] == [("color_by", ("",), "heat"), ("pause", (), "run")]
    assert controls.last.content == "a step" and controls.costly.content == "one\n\ntwo" and controls.bar.visible
    controls.show(seen(heats=("speed",)))
    assert gui.made["by"].options == (LOOK, "speed") and controls.last.content == "a step" and not controls.bar.visible


def test_a_change_is_told_before_the_session_answers():
    """At once as it is asked for, then from when on it holds; pictures of before change nothing of it."""
    gui = Gui()
    controls = Controls(gui, opened(airy=True), lambda *wish: None)
    controls.show(seen())
    assert not controls.change.visible
    gui.clicked("clip", "walk")
    assert controls.change.visible and controls.change.content == "clip: walk ..."
    controls.show(seen())
    assert controls.change.content == "clip: walk ..."
    controls.show(seen(changes=1, change="clip: walk, from t = 1.000 s"))
    assert controls.change.content == "clip: walk, from t = 1.000 s"
    gui.clicked("y", 2.5)
    assert controls.change.content == "wind added: 0, 2.5, 0 m/s ..."
    gui.clicked("edges", True)
    assert controls.change.content == "wind added: 0, 2.5, 0 m/s ...", "a look is seen by itself"


def test_a_wrong_word_is_told_without_the_session_and_a_right_one_asked_for():
    """The session may be building kernels for half a minute. The page has the command line's own message."""
    gui, asked = Gui(), []
    of_all = [Parameter(name, "", every=True) for name in ("fabric", "wind")]
    own = dataclasses.replace(opened(airy=True), parameters=(*of_all, Parameter("clip", "")))
    controls = Controls(gui, own, lambda *wish: asked.append(wish[1]))
    for name, wrong, right in (("fabric", "denmi", "denim"), ("wind", "breze -z", "breeze -z")):
        with pytest.raises(tc.SceneError) as told:
            scenefile.read("hang").typed({name: wrong})
        gui.clicked(name, wrong)
        assert controls.change.content == f"{name}: {wrong}: not possible: {told.value}" and not asked
        gui.clicked(name, right)
        assert controls.change.content == f"{name}: {right} ..." and asked == [(name, right)]
        gui.clicked(name, "")
        assert asked.pop() == (name, "") and asked.pop()
    gui.clicked("clip", "denmi")  # a word of the scene's own
    assert asked == [("clip", "denmi")]


def test_seconds_count_while_kernels_are_built(monkeypatch):
    """On the page, which has a process of its own, from one picture to the next."""
    monkeypatch.setattr(counting, "EVERY", 0.01)
    clock = itertools.count(100.0, 0.5)
    monkeypatch.setattr(counting, "time", types.SimpleNamespace(monotonic=lambda: next(clock)))
    said, enough = [], threading.Event()

    def tell(text):
        said.append(text)
        if len(said) == 5:
            enough.set()

    state = counting.Counting(tell)
    state.count("building kernels")
    assert enough.wait(20)
    state.show("runs at t = 0.017 s")
    time.sleep(0.05)
    assert said[:5] == [f"building kernels, {s} s" for s in (0, 1, 2, 2, 2)] and said[-1] == "runs at t = 0.017 s"
    gui = Gui()
    controls = Controls(gui, opened(airy=False), print)
    monkeypatch.setattr(controls, "state", unittest.mock.Mock())
    controls.show(seen(preview=True))
    assert controls.state.count.call_args.args == (SETTING_UP,) and not controls.state.show.called
    controls.show(seen(state="paused"))
    assert controls.state.show.call_args.args == ("paused",)


def test_every_scene_is_shown_before_taichi_is_imported():
    program = """if True:
        import sys
        from taichi_cloth.app import scenefile
        from taichi_cloth.live.session import Session
        from taichi_cloth.live.teller import Teller
        from taichi_cloth.live.view import Made
        from taichi_cloth.options import Options

        for name in scenefile.available():
            scene, told = scenefile.read(name), []
            teller = Teller(name, told.append)
            teller(Session(Made(lambda changed: scene.make(dict(scene.small)), Options()), teller))
            assert len(told[1].x) and told[1].preview and "taichi" not in sys.modules, name"""
    subprocess.run([sys.executable, "-c", program], timeout=60, check=True)


@pytest.mark.parametrize("camera", [None, tc.Camera((2.0, 0.5, 3.0), (0.5, -0.5, 0.0))])
def test_a_page_begins_with_room_for_cloth_that_will_hang(camera):
    """Its ground is below, and a fitted camera sees the lowest corner where it will hang."""
    scene = tc.Scene(view=tc.View(camera))
    cloth = scene.add_cloth(tc.grid(1.0, 2), tc.Fabric(0.2, tc.Stretch(100)))
    scene.pin(cloth, "top_left")
    lowest = cloth.positions[cloth.mesh.select("top_left")] - [0, np.sqrt(2), 0]
    geometry = record.as_built(scene)
    source = types.SimpleNamespace(parameters=(), again=True)
    opened = opening(types.SimpleNamespace(scene=scene, geometry=geometry, source=source), "a sheet")
    assert opened.middle[1] == pytest.approx(-np.sqrt(2) - 0.05 * np.sqrt(2))
    at = frame(tc.Camera(opened.eye, opened.target, opened.fov)).project(lowest, 130, 100)
    assert (at[0, :2] > 0).all() and (at[0, :2] < (130, 100)).all()


def test_without_air_there_is_no_wind_to_add():
    gui = Gui()
    Controls(gui, opened(airy=False), print)
    assert "x" not in gui.made and "cells" in gui.made


def test_the_page_is_lit_by_lamps_alone():
    """The surroundings that viser lights by without being told took a browser without a GPU eight of ten seconds."""
    server = unittest.mock.MagicMock()
    Page(server, opened(airy=False), print)
    assert server.scene.configure_environment_map.call_args.args == (None,)
    assert server.scene.add_light_hemisphere.called


def test_the_page_starts_before_taichi_is_imported():
    program = """if True:
        import sys
        from taichi_cloth.app import cli
        from taichi_cloth.live import view

        def link(host, port):
            print("taichi" in sys.modules, "numpy.linalg" in sys.modules)
            raise SystemExit

        view.Link = link
        cli.main(["view", "hang", "--set", "fabric=denim", "--no-open"])"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60, check=True)
    assert done.stdout.split() == ["False", "True"]


def test_messages_of_processes_are_whole_or_none():
    file = io.BytesIO()
    pages.write(file, seen(state="one"))
    pages.write(file, ("two", 2))
    file.seek(0)
    assert pages.read(file).state == "one" and pages.read(file) == ("two", 2) and pages.read(file) is None
    file.close()
    pages.write(file, "nobody reads this")
    assert pages.read(io.BytesIO(b"\x80 no pickle")) is None


def test_ranges_of_the_scenes_are_possible():
    from taichi_cloth.app import scenefile

    named = [scenefile.read(str(path)) for path in scenefile.available().values() if "RANGES = " in path.read_text()]
    assert {"hang", "flag", "laundry"} <= {scene.name for scene in named}
    for scene in named:
        for p in parameters(scene.options, scene.ranges):
            assert p.range is None or p.range[0] <= p.value <= p.range[1], (scene.name, p)


def test_a_page_tells_that_a_browser_is_there():
    """The process of a page, with a server to which somebody comes at once."""
    code = """
import types
from taichi_cloth.live import pages
server = types.SimpleNamespace(get_port=lambda: 7, on_client_connect=lambda call: call("a client"))
pages.started = lambda host, port: server
pages.stop = lambda server: None
pages.main("here", 7)
"""
    done = subprocess.run([sys.executable, "-c", code], stdin=subprocess.DEVNULL, capture_output=True, check=True)
    said = io.BytesIO(done.stdout)
    assert [pages.read(said) for _ in range(3)] == [("ask", "watch", (), "watch"), ("at", 7), None]
