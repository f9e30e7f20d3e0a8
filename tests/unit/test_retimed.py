"""Runs at other times: which, and what lies between two frames, against motions of closed form."""

import numpy as np
import pytest

import taichi_cloth as tc
from taichi_cloth.app import cli
from taichi_cloth.output.folder import RunFolder
from taichi_cloth.output.retimed import Frozen, Retimed

G = np.array([0.0, -9.81, 0.0])
FACES = np.array([[0, 1, 2]])


def recorded(path, x_of, v_of, last=6, fps=10.0, solid=None):
    """Frames 0 to `last` of three points whose positions and velocities are functions of time."""
    folder = RunFolder(path)
    for k in range(last + 1):
        t = k / fps
        more = {} if solid is None else {"solid_x": solid(t)}
        folder.write_frame(k, {"t": np.array(t), "x": x_of(t), "v": v_of(t), "faces": FACES + k // 4,
                               "contact": np.full((3, 3), 2.0 * k), **more})
    folder.write_geometry({"x": x_of(0.0), "faces": FACES})
    folder.write_manifest({"fps": fps, "frames": [0, last], "scene": "by hand"})
    folder.close()
    return tc.Recording(path)


def thrown(t):
    return np.array([[0.0, 1, 2], [3, 4, 5], [6, 7, 9]]) + t * np.array([[1.0, 3, 0], [0, 0, 0], [2, 9, -1]]) + 0.5 * t**2 * G


def speed(t):
    return np.array([[1.0, 3, 0], [0, 0, 0], [2, 9, -1]]) + t * G


@pytest.fixture(scope="module")
def flight(tmp_path_factory):
    return recorded(tmp_path_factory.mktemp("flight") / "run", thrown, speed)


@pytest.mark.parametrize("slow, fps, count, step", [(0.5, None, 13, 0.05), (1.0, 24.0, 15, 1 / 24), (2.0, 10.0, 4, 0.2),
                                                    (0.25, 40.0, 97, 0.00625), (1.0, None, 7, 0.1)])
def test_points_in_free_flight_are_where_they_are(flight, slow, fps, count, step):
    made = flight.retimed(slow, fps)
    assert made.frames() == list(range(count)) and made.fps == (fps or 10.0)
    for k in made.frames():
        frame = made.frame(k)
        assert made.time(k) == pytest.approx(k * step) and float(frame["t"]) == pytest.approx(k * step)
        assert frame["x"] == pytest.approx(thrown(k * step), abs=1e-12)
        assert frame["v"] == pytest.approx(speed(k * step), abs=1e-12)
        assert frame["contact"] == pytest.approx(np.full((3, 3), 20 * k * step), abs=1e-9)
        assert (frame["faces"] == FACES + int(10 * k * step + 1e-6) // 4).all()  # those of the frame before
        assert float(frame["clock"]) == pytest.approx(k / made.fps)


def test_recorded_frames_are_the_recorded_ones(flight):
    made = flight.retimed(0.5)
    for k in range(7):
        assert all(np.array_equal(made.frame(2 * k)[name], array) for name, array in flight.frame(k).items())
    assert made.play().count == 13 and flight.frames() == list(range(7))


@pytest.mark.parametrize("part", np.linspace(0.02, 0.98, 13))
def test_what_is_stopped_on_the_way_does_not_go_beyond(tmp_path, part):
    """A point falls at 5 m/s on a floor at height 0, at some part of the way between frames 2 and 3, and stays."""
    end = 0.2 + 0.1 * part

    def x_of(t):
        return np.array([[0.0, 5 * max(end - t, 0.0), 0], [1, 1, 1], [2, 2, 2]])

    def v_of(t):
        return np.array([[0.0, -5.0 * (t < end), 0], [0, 0, 0], [0, 0, 0]])

    made = recorded(tmp_path / "run", x_of, v_of).retimed(0.05)
    heights = np.array([made.frame(k)["x"][0, 1] for k in made.frames()])
    assert heights.min() > -1e-9 and heights[0] == pytest.approx(5 * end)


def test_what_turns_goes_round(tmp_path):
    """Cloth by its velocity, a solid by its places: 3 turns a second in 60 frames, far nearer than along chords."""
    w = 6 * np.pi

    def x_of(t):
        return np.array([[np.cos(w * t), np.sin(w * t), 0], [0, 0, 0], [0, 0, 1]])

    def v_of(t):
        return w * np.array([[-np.sin(w * t), np.cos(w * t), 0], [0, 0, 0], [0, 0, 0]])

    made = recorded(tmp_path / "run", x_of, v_of, 20, 60.0, x_of).retimed(0.25)
    chord = 1 - np.cos(w / 120)
    for k in range(8, 73):
        exact = x_of(k / 240)
        assert np.abs(made.frame(k)["x"] - exact).max() < chord / 150
        assert np.abs(made.frame(k)["solid_x"] - exact).max() < chord / 15


def test_a_part_of_a_run(flight):
    made = Retimed(flight, 0.5, None, 2, 4)
    assert made.frames() == [0, 1, 2, 3, 4] and made.frame(3)["x"] == pytest.approx(thrown(0.35)) and made.time(4) == 0.4


def test_a_frozen_frame(flight):
    made = Frozen(flight, 3, 8)
    assert made.frames() == list(range(8)) and made.time(5) == pytest.approx(0.3)
    for k in range(8):
        assert (made.frame(k)["x"] == flight.frame(3)["x"]).all() and float(made.frame(k)["clock"]) == k / 10


def test_a_slow_film_of_meshes_has_slow_velocities(tmp_path):
    """Of USD, whose motion blur goes by them: a sheet of tc.grid that moves at 2 m/s along x, at a quarter of that."""
    scene = tc.Scene(gravity=None)
    scene.add_cloth(tc.grid(1.0, 1), tc.Fabric(0.2, tc.Stretch(10)), velocities=(2, 0, 0))
    with tc.Simulation(scene, integrator="verlet") as sim:
        run = tc.record(sim, tmp_path / "run", 0.2, 10)
    text = run.retimed(0.25).export("usda")[0].read_text()
    assert "endTimeCode = 8" in text and "(0.5, 0, 0), (0.5, 0, 0)" in text and "(2, 0, 0)" not in text


@pytest.mark.parametrize("flags, said", [
    (("--speed", "0"), "speed = 0.0: must be a positive number"),
    (("--speed", "-1"), "speed = -1.0: must be a positive number"),
    (("--fps", "0"), "fps = 0.0: must be a positive number"),
    (("--speed", "1e-12"), "number of frames"),
    (("--speed", ".5", "--frames", "0:6:2"), "without gaps"),
    (("--frame", "3"), "--frame is the one that --turntable N goes round"),
    (("--turntable", "1"), "--turntable = 1: must be a whole number of at least 2"),
    (("--turntable", "8", "--frame", "9"), "has no frame 9; it has 0 to 6"),
    (("--turntable", "8", "--frames", "5"), "one frame from all round: --frame K instead of --frames 5"),
    (("--turntable", "8", "--speed", ".5"), "--speed says nothing of that"),
    (("--turntable", "8", "--orbit", "5"), "--orbit says nothing of that"),
])
def test_times_that_cannot_be_are_named(flight, flags, said, capsys):
    assert cli.main(["render", str(flight.path), *flags]) == 2
    assert said in capsys.readouterr().err and not (flight.path / "retimed").exists()
