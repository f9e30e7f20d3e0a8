"""Seams that rip, stitches that give: at which force, in which order, and what that does to momentum and energy."""

import pathlib

import numpy as np
import pytest
from reference.geometry import cloth_crossings
from test_seams import cut

import taichi_cloth as tc
from taichi_cloth.app import scenefile
from taichi_cloth.errors import SceneError

K, STRENGTH, SPEED = 1000.0, 100.0, 0.1
FABRIC = tc.Fabric(0.2, tc.Stretch(K, 0.2), tc.Shear(100, 0.1), tc.Bend(1e-4, 1e-6))


def sewn(strength=None, cells=(20, 4), contact=None, gravity=None, **how):
    """A sheet of .4 x .1 m cut across and sewn again: (scene, cloth, seam)."""
    mesh, a, b, _ = cut(tc.grid((0.4, 0.1), cells), 0.2)
    scene = tc.Scene(gravity=gravity)
    cloth = scene.add_cloth(mesh, FABRIC, contact=contact, **how)
    return scene, cloth, scene.sew(cloth, a, b, strength=strength)


def ends(cloth):
    u = cloth.mesh.uv[:, 0]
    return np.flatnonzero(u < 1e-9), np.flatnonzero(u > 0.4 - 1e-9)


def largest_gain(sim) -> float:
    """By how much [J] the energy grew more than work was put in, in any step."""
    return max(r.ledger["kinetic"] + r.ledger["potential"] - r.ledger["pins"] - r.ledger["layers"] for r in sim.log)


@pytest.mark.parametrize("integrator", ["backward_euler", "safe"])
def test_a_strip_rips_at_its_strength(integrator):
    """Pulled at a known rate the seam bears k u / L a length: it rips when that is its strength, as the load cell says."""
    scene, cloth, seam = sewn(STRENGTH)
    left, right = ends(cloth)
    scene.pin(cloth, left)
    scene.move(cloth, right, lambda t: (SPEED * t, 0, 0), relative=True)
    with tc.Simulation(scene, h=1 / 120, integrator=integrator, cg_tol=1e-8) as sim:
        cell, opened, stored = [], [], []
        while sim.time < 0.45:
            sim.step()
            cell.append(abs(sim.constraint_forces()[left, 0].sum()))
            opened.append(sum(int(o.sum()) for o in sim.stitches_open()))
            stored.append(sim.energy()["stretch_u"])
        first = opened.index(next(k for k in opened if k))
        assert sim.log[first].t == pytest.approx(STRENGTH * 0.4 / (K * SPEED), abs=1 / 60)
        assert max(cell) == pytest.approx(STRENGTH * 0.1, rel=0.03) and max(cell) == cell[first - 1]
        assert opened[-1] == 5 and opened[first - 1] == 0
        assert cell[-1] < 0.3 * max(cell) and stored[first] < stored[first - 1]
        assert largest_gain(sim) < 1e-6
        x = sim.positions()
        assert (x[seam.b, 0] - x[seam.a, 0]).min() > 0.03


def test_buttons_give_at_their_force():
    """A load m g hangs on one button each: those that bear less give, and no other."""
    cells, n = (4, 1), 10
    one = tc.grid((0.4, 0.1), cells, plane="xy")
    mesh = tc.TriMesh(np.concatenate([one.x, one.x - [0, 0.1, 0]]), np.concatenate([one.faces, one.faces + n]),
                      np.concatenate([one.uv, one.uv - [0, 0.1]]))
    low, high = (np.flatnonzero(np.abs(one.uv[:, 1] - v) < 1e-9) for v in (0.0, 0.1))
    for force, falls in ((0.30, False), (0.15, True)):
        scene = tc.Scene()
        cloth = scene.add_cloth(mesh, tc.Fabric(0.2, tc.Stretch(500, 1), tc.Shear(500, 1)))
        scene.pin(cloth, high)
        scene.add_mass(cloth, n + low, 0.02 - 0.2 * 0.04 / 5)  # .02 kg and what hangs: about .2 N each
        scene.stitch(cloth, low, n + high, force=force)
        with tc.Simulation(scene, h=1 / 120, integrator="backward_euler", cg_tol=1e-8) as sim:
            for _ in range(60):
                sim.step()
            assert [bool(o.all()) for o in sim.stitches_open()] == [falls]
            loads = sim.stitch_loads()[0]
            total = 9.81 * (0.2 * 0.04 + 5 * (0.02 - 0.2 * 0.04 / 5))
            assert loads.sum() == pytest.approx(0.0 if falls else total, rel=0.02)
            assert (sim.positions()[n + low, 1].max() < -0.4) == falls


@pytest.mark.slow
def test_momentum_is_conserved_and_the_seam_opens_from_its_end():
    """Halves fly apart, the more the further along the seam: stitches give one after the other, from that end."""
    mesh, a, b, _ = cut(tc.grid((0.4, 0.4), (8, 16)), 0.2)
    scene = tc.Scene(gravity=None)
    v = np.zeros_like(mesh.x)
    right = np.isin(np.arange(len(v)), b) | (mesh.uv[:, 0] > 0.2 + 1e-9)
    v[:, 0] = np.where(right, 6.0, -6.0) * (mesh.uv[:, 1] / 0.4) ** 2
    cloth = scene.add_cloth(mesh, FABRIC, velocities=np.where(np.isin(np.arange(len(v)), [*a, *b])[:, None], 0.0, v))
    scene.sew(cloth, a, b, strength=30.0)
    for integrator in ("backward_euler", "safe"):
        with tc.Simulation(scene, h=1 / 1000, integrator=integrator, cg_tol=1e-12, newton_tol=1e-12) as sim:
            m = sim.model.to_user(np.repeat(sim.model.mass[:, None], 3, axis=1))
            before, seen = (m * sim.velocities()).sum(axis=0), []
            for _ in range(5):
                sim.step()
                seen.append(sim.stitches_open()[0].copy())
                assert np.abs((m * sim.velocities()).sum(axis=0) - before).max() < 1e-10
            opened = seen[-1]
            assert 3 < opened.sum() and len({int(o.sum()) for o in seen}) > 2
            for o in seen:  # from the far end on, without a gap
                assert (np.diff(o[np.argsort(mesh.uv[a, 1])].astype(int)) >= 0).all()
            assert largest_gain(sim) < 1e-8


@pytest.mark.slow
def test_what_was_sewn_meets_as_layers_do():
    """Opened by hand, halves are thrown against each other: they keep apart, as two sheets do."""
    x = cut(tc.grid((0.4, 0.1), (20, 4)), 0.2)[0].x.copy()
    scene, cloth, seam = sewn(contact=tc.ClothContact(0.006, 0.0), positions=x)
    side = np.isin(np.arange(len(x)), seam.b) | (cloth.mesh.uv[:, 0] > 0.2 + 1e-9)
    left, right = ends(cloth)
    scene.pin(cloth, left)
    scene.at(0.05, lambda s: s.unsew(seam))
    # the right half goes away, then comes back over the left one, 2 cm above, and down on it
    path = np.array([[0, 0, 0], [0.05, 0.02, 0], [-0.15, 0.02, 0], [-0.15, -0.03, 0]])
    scene.move(cloth, np.flatnonzero(side & ~np.isin(np.arange(len(x)), seam.b)),
               lambda t: [np.interp(t, [0.05, 0.15, 0.55, 0.75], path[:, c]) for c in range(3)], relative=True)
    with tc.Simulation(scene, h=1 / 60) as sim:
        met = 0
        while sim.time < 0.72:
            sim.step()
            met = max(met, sim.log[-1].layers)
            assert cloth_crossings(sim) == 0
        assert met > 10 and sim.stitches_open()[0].all()


@pytest.mark.slow
@pytest.mark.parametrize("contact_tol", [0.1, None])
def test_the_energy_of_a_rip_is_accounted_for(contact_tol):
    """Panels whose sides meet as they recoil (`scenes/rip_seam.py`): step by step less than 4 % of what pulls put in (2 to 3 %
    from six starts; 13 % where steps of layers do not account for it in all of their solves)."""
    scene = scenefile.read(str(pathlib.Path(__file__).parents[2] / "scenes" / "rip_seam.py")).make({"n": 10})
    with tc.Simulation(scene, h=1 / 60, contact_tol=contact_tol) as sim:
        while sim.time < 0.95:
            sim.step()
        lost, put_in = (sum(abs(r.ledger[name]) for r in sim.log) for name in ("unaccounted", "pins"))
        assert sim.log[-1].opened > 12 and sum(r.layers for r in sim.log) > 0
        assert lost < 0.04 * put_in, (lost, put_in)


def test_sides_keep_what_they_have_come_apart_by():
    """Led a third of a thickness apart, and back towards each other by five times as much: they do not pass."""
    scene, cloth, seam = sewn(contact=tc.ClothContact(0.006, 0.0))
    left, right = ends(cloth)
    scene.pin(cloth, left)
    scene.at(0.025, lambda s: s.unsew(seam))
    path = np.array([[0, 0, 0], [0.002, 0.001, 0], [-0.008, 0.001, 0]])
    scene.move(cloth, right, lambda t: [np.interp(t, [0.025, 0.075, 0.175], path[:, c]) for c in range(3)], relative=True)
    with tc.Simulation(scene, h=1 / 60, integrator="backward_euler") as sim:
        met, least = 0, np.inf
        while sim.time < 0.3:
            sim.step()
            met = max(met, sim.log[-1].layers)
            assert met == 0 or sim.time > 0.076, "nothing pushes them apart"
            x = sim.positions()
            assert cloth_crossings(sim) == 0 and sim.log[-1].known_intersections == 0
            if sim.time > 0.08:
                least = min(least, np.linalg.norm(x[seam.a] - x[seam.b], axis=1).min())
        assert met > 10 and 0.0005 < least < 0.0025


def test_sides_that_pass_through_each_other_are_counted():
    """Opened and thrown against each other from one place, nothing parts them: each step's record has the exact count."""
    scene, cloth, seam = sewn(contact=tc.ClothContact(0.006, 0.2))
    u, rng = cloth.mesh.uv[:, 0], np.random.default_rng(0)
    scene.pin(cloth, np.flatnonzero(u < 0.16))
    scene.move(cloth, np.flatnonzero(u > 0.24), lambda t: (-0.05 * t, 0, 0), relative=True)
    with tc.Simulation(scene, h=1 / 60, integrator="backward_euler") as sim:
        sim.step()
        sim.unsew(seam)
        v, push = sim.velocities(), 0.5 * rng.normal(size=(len(seam.b), 3))
        push[:, 0] = -np.abs(push[:, 0])
        v[seam.b] += push
        v[seam.a] -= push
        sim.set_state(sim.positions(), v)
        counts = []
        for _ in range(8):
            sim.step()
            counts.append((sim.log[-1].known_intersections, cloth_crossings(sim)))
    assert all(said == exact for said, exact in counts) and counts[0][1] > 0 and counts[-1][1] == 0, counts


@pytest.mark.parametrize("pull", [None, 50.0])
def test_what_slips_through_beside_a_seam_that_closes_is_counted(pull):
    """The right half begins 2.5 cm before the left one's end and 3 mm below, and goes up through it, until the seam is closed:
    each step's record has the exact count, of what contact leaves alone there, too."""
    mesh, a, b, _ = cut(tc.grid((0.4, 0.1), (20, 4)), 0.2)
    x, u = mesh.x.copy(), mesh.uv[:, 0] - 0.2
    right = np.union1d(np.flatnonzero(u > 1e-9), b)
    x[right] += np.column_stack([np.full(len(right), -0.025), 0.4 * u[right] - 0.003, np.full(len(right), 0.003)])
    scene = tc.Scene(gravity=None)
    cloth = scene.add_cloth(mesh, FABRIC, contact=tc.ClothContact(0.002, 0.2), positions=x)
    scene.sew(cloth, a, b, pull=pull)
    scene.pin(cloth, ends(cloth)[0])
    with tc.Simulation(scene, h=1 / 60, integrator="backward_euler") as sim:
        counts = []
        for _ in range(8):
            sim.step()
            counts.append((sim.log[-1].known_intersections, cloth_crossings(sim)))
        assert sim.seam_gaps()[0] == 0
    assert all(said == exact for said, exact in counts) and counts[0][1] > 0 and counts[-1][1] == 0, counts


def test_a_run_goes_on_bit_for_bit_through_a_rip():
    def made():
        scene, cloth, _ = sewn(STRENGTH, gravity=(0, -9.81, 0), contact=tc.ClothContact(0.004, 0.2))
        left, right = ends(cloth)
        scene.pin(cloth, left)
        scene.move(cloth, right, lambda t: (0.4 * t, 0, 0.1 * t), relative=True)
        return tc.Simulation(scene, h=1 / 60)

    ends_at, state = [], None
    for resumes in (False, False, True):
        with made() as sim:
            if resumes:
                sim.resume(state)
            while sim.time < 0.25 - 1e-9:
                if state is None and sim.log and sim.log[-1].opened:
                    state = sim.checkpoint()
                sim.step()
            ends_at.append((sim.positions(), sim.velocities(), sim.log[-1].opened))
    assert state is not None and ends_at[0][2] > 0
    for x, v, opened in ends_at[1:]:
        assert (x == ends_at[0][0]).all() and (v == ends_at[0][1]).all() and opened == ends_at[0][2]


def test_hinges_go_with_their_seam():
    """A seam folded by a right angle, at rest flat: opened, its hinges' energy is gone, and stands in no other account."""
    mesh, a, b, _ = cut(tc.grid((0.2, 0.1), (4, 4)), 0.1)
    beyond = np.isin(np.arange(mesh.vertex_count), b) | (mesh.uv[:, 0] > 0.1 + 1e-9)
    x = mesh.x.copy()
    x[beyond, 1] = mesh.uv[beyond, 0] - 0.1
    x[beyond, 0] = 0.1
    scene = tc.Scene(gravity=None)
    cloth = scene.add_cloth(mesh, FABRIC, positions=x)
    seam = scene.sew(cloth, a, b)
    with tc.Simulation(scene, h=1 / 60) as sim:
        assert sim.energy()["bend"] > 1e-5
        sim.unsew(seam, [a[0], a[1]])
        part = sim.energy()["bend"]
        sim.unsew(seam)
        assert sim.energy()["bend"] < 1e-12 < 1e-6 < part
        sim.step()
        assert sim.energy()["kinetic"] < 1e-12 and sim.log[-1].opened == 5


def test_what_cannot_rip_is_refused():
    scene, cloth, seam = sewn()
    a, b = seam.a, seam.b
    for wrong in (-1.0, 0.0, float("nan")):
        with pytest.raises(SceneError, match="strength"):
            scene.sew(cloth, a, b, strength=wrong)
    with pytest.raises(SceneError, match="stitch"):
        scene.sew(cloth, a[:1], b[:1], strength=1.0)
    with pytest.raises(SceneError, match="force"):
        scene.stitch(cloth, a[0], b[0], force=-1.0)
    with pytest.raises(SceneError, match="no stitch"):
        scene.unsew(seam, 0)
    with pytest.raises(SceneError, match="not a seam"):
        tc.Scene().unsew(seam)
    with pytest.raises(SceneError, match="seams"):
        tc.Simulation(scene, integrator="verlet")
