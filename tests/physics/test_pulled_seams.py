"""Seams that a bounded force draws together: how far they come, how fast, and what it takes."""

import numpy as np
import pytest

import taichi_cloth as tc
from taichi_cloth.step.ledger import totals

LENGTH, WIDTH, GAP, K = 0.2, 0.1, 0.02, 400.0
FABRIC = tc.Fabric(0.2, tc.Stretch((K, 1e-3), (4.0, 0.0)), bend=None)


def apart(pull, held=True, gap=GAP, **options) -> tuple[tc.Simulation, np.ndarray, np.ndarray]:
    """Two strips in a line with a gap between them, their far ends held."""
    left, right = tc.grid((LENGTH, WIDTH), (8, 4)), tc.grid((LENGTH, WIDTH), (8, 4))
    n = left.vertex_count
    mesh = tc.TriMesh(np.concatenate([left.x, right.x + [LENGTH + gap, 0, 0]]), np.concatenate([left.faces, right.faces + n]),
                      np.concatenate([left.uv, right.uv + [0.5, 0]]))
    scene = tc.Scene(gravity=None)
    cloth = scene.add_cloth(mesh, FABRIC)
    a = np.flatnonzero(left.uv[:, 0] > LENGTH - 1e-9)
    b = n + np.flatnonzero(right.uv[:, 0] < 1e-9)
    if held:
        far = n + np.flatnonzero(right.uv[:, 0] > LENGTH - 1e-9)
        scene.pin(cloth, np.concatenate([np.flatnonzero(left.uv[:, 0] < 1e-9), far]))
    scene.sew(cloth, a, b, stiffness=0.0, pull=pull)
    return tc.Simulation(scene, h=1 / 60, **options), a, b


@pytest.mark.slow
def test_it_comes_as_near_as_the_pull_reaches():
    """Each strip is stretched by pull/K, and GAP - 2 LENGTH pull/K are left; twice the pull that is needed closes it to
    one place, bit for bit, the ends bear K GAP/2 LENGTH then, and all of every step's energy is accounted for."""
    weak = 8.0
    sim, a, b = apart(weak)
    sim.run(2.0, fps=10)
    left = GAP - 2 * LENGTH * weak / K
    x = sim.positions()
    assert x[b, 0] - x[a, 0] == pytest.approx(left, rel=1e-3) and sim.seam_gaps()[0] == pytest.approx(left, rel=1e-3)
    assert sim.constraint_forces()[:, 0].clip(0).sum() == pytest.approx(weak * WIDTH, rel=1e-3)
    assert not np.concatenate(sim.stitches_open()).any()
    sim.close()
    sim, a, b = apart(2 * K * GAP / (2 * LENGTH), integrator="newton_euler", newton_tol=1e-10, cg_tol=1e-11, newton_max=60)
    before, works = sum(sim.energy().values()), []
    for _ in range(60):
        sim.log.clear()
        sim.step()
        after, row = sum(sim.log[-1].energies.values()), totals([r.ledger for r in sim.log])
        assert row["kinetic"] + row["potential"] == pytest.approx(after - before, abs=1e-9)
        scale = abs(row["pins"]) + row["damping"] + abs(row["method"]) + sim.log[-1].energies["kinetic"]
        assert abs(row["unaccounted"]) < 1e-6 * scale + 1e-12, row
        works.append(row["plastic"])
        before = after
    assert sum(works) > 0  # the pull of what became whole
    sim.run(1.0, fps=10)
    x = sim.positions()
    assert (x[a] == x[b]).all() and sim.seam_gaps()[0] == 0
    assert sim.constraint_forces()[:, 0].clip(0).sum() == pytest.approx(K * GAP / (2 * LENGTH) * WIDTH, rel=1e-3)
    sim.close()


@pytest.mark.slow
def test_free_pieces_come_together_at_half_a_metre_a_second_and_keep_their_momentum():
    sim, a, b = apart(20.0, held=False, gap=0.1)
    mass, x_0, fastest = sim.model.mass[:, None], sim.positions(), 0.0
    for k in range(40):
        sim.step()
        v = sim.velocities()[sim.model.user]
        assert np.abs((mass * v).sum(axis=0)).max() < 1e-9
        apart_now = sim.seam_gaps()[0] > 2e-3
        if apart_now:
            speed = (sim.velocities()[a, 0] - sim.velocities()[b, 0]).max()
            fastest = max(fastest, speed)
        if k == 5:
            state = sim.checkpoint()
    assert fastest == pytest.approx(0.5, rel=0.1) and fastest <= 0.5 * (1 + 1e-4)
    x = sim.positions()
    assert (x[a] == x[b]).all()
    centre = [(mass * p[sim.model.user]).sum(axis=0) / mass.sum() for p in (x_0, x)]
    assert np.abs(centre[1] - centre[0]).max() < 1e-9
    sim.close()
    again, _, _ = apart(20.0, held=False, gap=0.1)
    again.resume(state)
    for _ in range(34):
        again.step()
    assert (again.positions() == x).all()
    again.close()


@pytest.mark.slow
def test_derivatives(rng):
    """f = -dE/dx, D = df/dv; a first solve's stiffness is a bound, symmetric; nothing moves or turns as a whole."""
    sim, a, b = apart(20.0)
    x, p = sim.positions() + 2e-3 * rng.normal(size=(sim.vertex_count, 3)), rng.normal(size=(sim.vertex_count, 3))
    zero = np.zeros_like(x)

    def at(eps, v=zero):
        sim.model.write(x + eps * p, v)
        return sim.energy()["seams"], sum(e for name, e in sim.energy().items() if name != "kinetic"), sim.forces()

    low, high = at(-1e-7), at(1e-7)
    seams, _, f = at(0.0)
    assert seams > 20.0 * WIDTH * GAP / 2
    assert np.sum(f * p) == pytest.approx(-(high[1] - low[1]) / 2e-7, rel=1e-6)
    assert np.abs(f.sum(axis=0)).max() < 1e-9 and np.abs(np.cross(x, f).sum(axis=0)).max() < 1e-9
    m = np.zeros((len(x), 1))
    m[sim.model.user, 0] = sim.model.mass
    one, two = (m * p - sim.product(p, h) for h in (1.0, 2.0))
    K_p, D_p = two / 2 - one, 2 * one - two / 2
    damped = (at(0.0, 1e-3 * p)[2] - at(0.0, -1e-3 * p)[2]) / 2e-3
    assert np.abs(D_p - damped)[a].max() < 1e-6 * np.abs(damped).max() and np.sum(p * D_p) < 0
    at(0.0)
    q = rng.normal(size=x.shape)
    one, two = (m * q - sim.product(q, h) for h in (1.0, 2.0))
    assert np.sum(p * (two / 2 - one)) == pytest.approx(np.sum(q * K_p), rel=1e-9)
    assert np.sum(p * K_p) <= np.sum(p * (high[2] - low[2])) / 2e-7
    sim.close()


def test_what_cannot_be_pulled():
    scene = tc.Scene()
    cloth = scene.add_cloth(tc.grid(0.2, 3), FABRIC)
    for pull in (0.0, -1.0, np.nan, "x"):
        with pytest.raises(tc.SceneError, match="pull"):
            scene.sew(cloth, [0, 1], [12, 13], pull=pull)


def test_a_stitch_alone_is_pulled_for_what_it_stands_for():
    """Half of the border beside it on either side, the mean of both ends; an edge where there is no border."""
    scene = tc.Scene()
    cloth = scene.add_cloth(tc.grid((0.4, 0.2), (4, 4)), FABRIC)  # edges of .1, .05 and .112 m, 5 vertices a row
    rows = cloth.mesh.uv.reshape(5, 5, 2)
    assert rows[0, 1, 0] > 0 == rows[0, 1, 1]

    def pulls(a, b):
        return scene.sew(cloth, [a], [b], pull=30.0).pulls

    assert pulls(1, 2) == pytest.approx(30.0 * 0.1)
    assert pulls(1, 5) == pytest.approx(30.0 * (0.1 + 0.05) / 2)
    assert pulls(0, 24) == pytest.approx(30.0 * (0.1 + 0.05) / 2)
    within = np.linalg.norm(np.diff(cloth.mesh.uv[[e for e in cloth.mesh.inner_edges if 12 in e]], axis=1), axis=2).mean()
    assert 0.05 < within < 0.12 and pulls(12, 1) == pytest.approx(30.0 * (within + 0.1) / 2)


@pytest.mark.slow
def test_a_firmer_pull_closes_what_stayed_apart():
    """The gap that is left goes with the pull; a run resumed knows it; what the pulls store more is not the step's."""
    exact = {"integrator": "newton_euler", "newton_tol": 1e-10, "cg_tol": 1e-11, "newton_max": 60}
    sim, a, b = apart(4.0, **exact)
    sim.run(1.0, fps=10)
    for pull in (4.0, 8.0):
        x, left = sim.positions(), GAP - 2 * LENGTH * pull / K
        assert x[b, 0] - x[a, 0] == pytest.approx(left, rel=2e-3)
        sim.stepper.pull_firmer(2.0)
        sim.step()
        ledger = totals([sim.log[-1].ledger])
        given_off = ledger["potential"] - ledger["edited"]
        assert abs(ledger["unaccounted"]) < 1e-6 * abs(given_off) and given_off < 0 < ledger["edited"]
        sim.run(1.0, fps=10)
    state, ended = sim.checkpoint(), []
    for resumed in (False, True):
        if resumed:
            sim.close()
            sim, _, _ = apart(4.0, **exact)
            sim.resume(state)
        sim.stepper.pull_firmer(2.0)
        sim.run(1.0, fps=10)
        assert sim.seam_gaps()[0] == 0
        ended.append(sim.positions())
    assert (ended[0] == ended[1]).all()
    sim.close()
