"""`verify` itself: every one of its checks holds where nothing is wrong, and fails where what it checks is."""

import argparse

import numpy as np
import pytest

import taichi_cloth as tc
from taichi_cloth.app import studies as cli_study
from taichi_cloth.simulation import Simulation
from taichi_cloth.studies import verify

WORDS = ["pins drift", "every solve of every step converged", "force against differences of the energy",
         "stiffness product against differences", "the matrix is symmetric", "damping product against differences",
         "internal forces add up", "their torques add up", "damping takes power", "cut loose it falls with g",
         "CG against a direct solve on 32 of its triangles"]
FULL = tc.Fabric(0.2, tc.Stretch(300, 0.3), tc.Shear(100, 0.1), tc.Bend(1e-3, 1e-5))


def make() -> tc.Scene:
    scene = tc.Scene(air=tc.Air(0.3, 0.1))
    cloth = scene.add_cloth(tc.grid(1.0, 4), FULL, velocities=(0.1, 0, 0))
    scene.pin(cloth, "top_left")
    scene.move(cloth, "top_right", lambda t: (-0.3 * t, 0, 0), relative=True)
    scene.add_mass(cloth, [12], 0.02)
    return scene


class OneThread(Simulation):
    """Right; more threads than one are no faster on so small a mesh."""

    def __init__(self, scene, **options):
        super().__init__(scene, threads=1, **options)


class Wrong(OneThread):
    """Everything that is checked is off by little more than may be."""

    def positions(self):
        return super().positions() + [0, 0, 1e-3 * self.time]

    def velocities(self):
        return super().velocities() + [0, 0, 2e-3]

    def run(self, *args, **kwargs):
        super().run(*args, **kwargs)
        self.log[len(self.log) // 2].status = "MAX_ITERATIONS"

    def energy(self):
        return {name: (1 + 1e-4) * value for name, value in super().energy().items()}

    def forces(self, renew=True):
        f, v = super().forces(renew), self.velocities()
        return f + 10 * v + 1e-9 * np.abs(f).max() * np.array([0.3, 1, 0.2])  # driven by its motion, and pushed

    def product(self, p, h):
        q = super().product(p, h)
        return q - 1e-4 * h**2 * self.scene.cloths[0].fabric.stretch.k * p + 1e-8 * np.abs(q).max() * np.roll(p, 1, axis=1)

    def solve(self, h, constraints=None):
        return (1 + 1e-6) * super().solve(h, constraints)


@pytest.mark.slow
def test_all_hold_where_nothing_is_wrong():
    found = list(verify.verify(make, 0.05, OneThread))
    assert len(found) == len(WORDS)
    for (name, figure, good), words in zip(found, WORDS):
        assert words in name and good, (name, figure)


@pytest.mark.slow
def test_each_fails_where_what_it_checks_is_wrong():
    found = list(verify.verify(make, 0.05, Wrong))
    assert len(found) == len(WORDS)
    for (name, figure, good), words in zip(found, WORDS):
        assert words in name and not good, (name, figure)


@pytest.mark.slow
@pytest.mark.parametrize("kind, good", [(OneThread, True), (Wrong, False)])
def test_plates_in_a_wind_that_varies_are_damped_by_what_a_step_begins_with(kind, good):
    """Coefficients go by the square of the speed, and a step keeps those of its start."""
    scene, rng = tc.Scene(air=tc.Air(wind=tc.Gusts((1, 0, -2), 1.0), drag=1.2, lift=0.8)), np.random.default_rng(20_261_128)
    cloth = scene.add_cloth(tc.grid(1.0, 4), FULL)
    found = {name: (figure, holds) for name, figure, holds in
             verify._forces(scene, cloth.positions, rng.normal(size=cloth.positions.shape), kind)}
    figure, holds = found["damping product against differences of the force"]
    assert holds is good, figure


class Rough(OneThread):
    """Only its solves are off, by a millionth."""

    def solve(self, h, constraints=None):
        return (1 + 1e-6) * super().solve(h, constraints)


@pytest.mark.slow
def test_a_millionth_off_is_no_solution():
    cloth = make().cloths[0]
    for kind, good in ((OneThread, True), (Rough, False)):
        assert verify._against_direct(cloth, cloth.positions, kind)[2] is good


def test_what_falls_is_weighed_with_its_point_masses():
    """A sheet that contracts as it falls: only its centre of mass, heavy corner included, falls with g."""
    scene, mesh = tc.Scene(), tc.grid(1.0, 4)
    cloth = scene.add_cloth(mesh, FULL, positions=1.05 * mesh.x)
    scene.add_mass(cloth, [0], 0.1)
    (_, figure, good), = verify._fall(scene, OneThread)
    assert good, figure


def test_what_is_being_sewn_falls_as_fast():
    """Its first steps are backward Euler's, which go further: their speed is right."""
    scene, one = tc.Scene(), tc.grid(1.0, 4)
    k = one.vertex_count
    mesh = tc.TriMesh(np.concatenate([one.x, one.x + [1.01, 0, 0]]), np.concatenate([one.faces, one.faces + k]),
                      np.concatenate([one.uv, one.uv + [1.0, 0]]))
    cloth = scene.add_cloth(mesh, FULL)
    scene.sew(cloth, np.flatnonzero(one.uv[:, 0] > 1 - 1e-9), k + np.flatnonzero(one.uv[:, 0] < 1e-9))
    (_, figure, good), = verify._fall(scene, OneThread)
    assert good, figure


def test_what_may_tear_falls_and_is_solved_as_it_was_handed_in():
    scene = tc.Scene()
    cloth = scene.add_cloth(tc.grid(1.0, 4), FULL, contact=tc.ClothContact(0.01, 0.3), tear=tc.Tear(300.0, length=0.3))
    (_, figure, good), = verify._fall(scene, OneThread)
    assert good, figure
    name, figure, good = verify._against_direct(cloth, cloth.whole.x, OneThread)
    assert name == WORDS[-1] and good, figure


class Springs:
    """A linear system with an exact answer, as `verify` asks for it."""

    M, D, K = np.random.default_rng(20_261_123).normal(size=(3, 6, 6))

    def product(self, p, h):
        return ((self.M - h * self.D - h**2 * self.K) @ p.ravel()).reshape(p.shape)


def test_products_are_taken_apart():
    p = np.random.default_rng(20_261_124).normal(size=(2, 3))
    K_p, D_p = verify._products(Springs(), p)
    assert np.abs(K_p - (Springs.K @ p.ravel()).reshape(2, 3)).max() < 1e-12
    assert np.abs(D_p - (Springs.D @ p.ravel()).reshape(2, 3)).max() < 1e-12


def test_the_ladder_takes_its_best_rung_relative_to_the_exact_value():
    assert verify._ladder(lambda e: 5.0 + 5e-4 if abs(e - 1e-5) < 1e-12 else 9.0, 5.0) == pytest.approx(1e-4)
    assert verify._ladder(lambda e: np.array([3.0, 4.5]), np.array([3.0, 4.0])) == pytest.approx(0.1)


def test_a_patch_grows_by_shared_edges():
    mesh = tc.grid(1.0, 6)
    patch = verify._patch(mesh.faces, 20)
    assert len(set(patch.tolist())) == 20 and patch[0] == 0
    edges = [{frozenset(e) for e in ((a, b), (b, c), (c, a))} for a, b, c in mesh.faces[patch].tolist()]
    assert all(any(e & o for o in edges if o is not e) for e in edges)
    assert verify._patch(mesh.faces, 1000).tolist() == list(range(72))


@pytest.mark.parametrize("results, code", [((True, True), 0), ((True, False), 1), ((False, True), 1), ((False, False), 1)])
def test_the_exit_code_says_whether_all_hold(results, code, monkeypatch, capsys):
    asked = []

    def found(make, t):
        asked.append((make().vertex_count, t))
        yield from ((f"check {k}", f"{k} m", good) for k, good in enumerate(results))

    monkeypatch.setattr(verify, "verify", found)
    args = argparse.Namespace(scene="hang", set=["cells=3"], small=False, time=0.125)
    assert cli_study.COMMANDS["verify"](args) == code
    lines = capsys.readouterr().out.splitlines()
    assert lines == [f"{'ok    ' if good else 'FAILED'} check {k}: {k} m" for k, good in enumerate(results)]
    assert asked == [(16, 0.125)]


@pytest.mark.parametrize("t", [0, -1, float("nan"), "1"])
def test_a_time_that_is_none(t):
    with pytest.raises(tc.SceneError, match="time = .*: must be a positive number"):
        next(verify.verify(make, t))
