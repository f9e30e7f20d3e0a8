"""Seams that are closed again: how they come together, what they then bear, and what contact and a checkpoint make of it."""

import numpy as np
import pytest
from reference.geometry import cloth_crossings, cloth_faces, edges_of, edges_through
from test_ripping import STRENGTH, ends, sewn
from test_seams import cut

import taichi_cloth as tc
from taichi_cloth.errors import SceneError

THICKNESS = 0.006


def opened(**how):
    """A sewn strip without gravity, held at its left end, whose right end goes 3 cm away and comes back, and whose seam opens
    in between."""
    scene, cloth, seam = sewn(**how)
    left, right = ends(cloth)
    scene.pin(cloth, left)
    scene.at(0.05, lambda s: s.unsew(seam))
    scene.move(cloth, right, lambda t: (np.interp(t, [0.05, 0.2, 0.3, 0.4], [0, 0.03, 0.03, 0]), 0, 0), relative=True)
    return scene, cloth, seam


@pytest.mark.slow
@pytest.mark.parametrize("contact", [None, tc.ClothContact(THICKNESS, 0.2)])
def test_it_comes_together_and_is_as_before(contact):
    """At half a metre a second at most, to one place bit for bit, without a crossing; the strip then lies as it did."""
    scene, cloth, seam = opened(contact=contact)
    scene.at(0.5, lambda s: s.resew(seam))
    x_0 = cloth.positions.copy()
    with tc.Simulation(scene, h=1 / 60, integrator="backward_euler") as sim:
        widest, before, states = 0.0, None, []
        while sim.time < 1.5:
            start = sim.time
            sim.step()
            states += sim.seam_states()
            x = sim.positions()
            gap = np.linalg.norm(x[seam.a] - x[seam.b], axis=1)
            widest = max(widest, gap.max())
            if sim.time > 0.51:
                assert not sim.stitches_open()[0].any()
                assert (gap > before - 2 * 0.51 * (sim.time - start)).all()  # each goes half of the way
            before = gap
            assert contact is None or cloth_crossings(sim) == 0
        assert widest > 0.02 and (gap == 0).all() and sim.log[-1].opened == 0
        assert [s for s, t in zip(states, ["", *states]) if s != t] == ["closed", "open", "closing", "closed"]
        assert np.abs(x - x_0).max() < 2e-3 and np.abs(sim.velocities()).max() < 0.02
        assert contact is None or sim.log[-1].layers == 0


def test_a_bounded_pull_draws_it_together():
    """Where the seam has a pull: what bears more stays apart."""
    for pull, closes in ((60.0, True), (2.0, False)):
        mesh, a, b, _ = cut(tc.grid((0.4, 0.1), (20, 4)), 0.2)
        scene = tc.Scene(gravity=None)
        cloth = scene.add_cloth(mesh, tc.Fabric(0.2, tc.Stretch(1000, 2.0), tc.Shear(100, 0.5)))
        seam = scene.sew(cloth, a, b, pull=pull)
        left, right = ends(cloth)
        scene.pin(cloth, left)
        scene.move(cloth, right, lambda t: (np.interp(t, [0.05, 0.2], [0, 0.01]), 0, 0), relative=True)
        with tc.Simulation(scene, h=1 / 60) as sim:
            sim.unsew(seam)
            sim.run(0.5, fps=10)
            assert sim.seam_gaps()[0] > 0.008 and sim.stitches_open()[0].all()
            sim.resew(seam)
            assert not sim.stitches_open()[0].any()
            sim.run(1.0, fps=10)
            gap = sim.seam_gaps()[0]
            assert gap == 0 if closes else gap == pytest.approx(0.01 - 0.4 * pull / 1000, rel=0.02)


def test_it_bears_as_much_as_before_and_gives_again():
    scene, cloth, seam = sewn(STRENGTH)
    left, right = ends(cloth)
    scene.pin(cloth, left)
    scene.move(cloth, right, lambda t: (np.interp(t, [0, 0.4, 0.5, 0.6, 1.6], [0, 0.06, 0, 0, 0.1]), 0, 0),
               relative=True)
    with tc.Simulation(scene, h=1 / 60) as sim:
        while not sim.stitches_open()[0].any():
            sim.step()
        while sim.time < 0.6:
            sim.step()
        assert sim.stitches_open()[0].all()
        sim.resew(seam, seam.a[:2])
        assert sim.stitches_open()[0].tolist() == [False, False, True, True, True]
        sim.resew(seam)
        forces = []
        while not sim.stitches_open()[0].any():
            sim.step()
            forces.append(sim.constraint_forces()[cloth.start + right, 0].sum())
        assert max(forces) == pytest.approx(STRENGTH * 0.1, rel=0.05) and sim.time > 0.9


def deepest(sim: tc.Simulation) -> float:
    """How far [m] an edge of cloth passes a triangle of cloth at most, by the end that is the nearer to its plane."""
    x, faces = sim.positions(), cloth_faces(sim)
    edges = edges_of(faces)
    i, j = edges_through(x, edges, x, faces, same=True)
    p, q, r = x[faces[j].T]
    n = np.cross(q - p, r - p)
    off = np.einsum("kai,ki->ka", x[edges[i]] - p[:, None], n) / np.linalg.norm(n, axis=1)[:, None]
    return float(np.abs(off).min(axis=1).max(initial=0.0))


def test_a_zip_starts_open_and_closes_stitch_by_stitch():
    """Its sides touch all the while: they pass each other by no more than a rounding."""
    scene, cloth, seam = sewn(contact=tc.ClothContact(THICKNESS, 0.2))
    scene.pin(cloth, ends(cloth)[0])
    scene.unsew(seam)
    for k, vertex in enumerate(seam.a):
        scene.at(0.1 + 0.05 * k, lambda s, v=vertex: s.resew(seam, v))
    with tc.Simulation(scene, h=1 / 60) as sim:
        left = []
        while sim.time < 0.4:
            sim.step()
            left.append(sim.log[-1].opened)
            assert deepest(sim) < 1e-8
        assert left[0] == 5 and left[-1] == 0 and (np.diff(left) <= 0).all() and len(set(left)) == 6


def test_a_run_goes_on_bit_for_bit():
    """Also where a seam has given since an event closed it: that does not close it once more."""
    def made():
        scene, cloth, seam = sewn(STRENGTH, contact=tc.ClothContact(0.004, 0.2))
        left, right = ends(cloth)
        scene.pin(cloth, left)
        scene.at(0.05, lambda s: s.unsew(seam))
        scene.at(0.1, lambda s: s.resew(seam))
        scene.move(cloth, right, lambda t: (np.interp(t, [0.1, 0.4], [0, 0.06]), 0, 0), relative=True)
        return tc.Simulation(scene, h=1 / 60)

    with made() as sim:
        while sim.time < 0.15:
            sim.step(1 / 60)
        closed = sim.checkpoint()
        while not sim.stitches_open()[0].any():
            sim.step(1 / 60)
        torn, end = sim.checkpoint(), sim.time + 0.1
        while sim.time < end:
            sim.step(1 / 60)
        x, v = sim.positions(), sim.velocities()
    for state in (closed, torn):
        with made() as sim:
            sim.resume(state)
            assert sim.stitches_open()[0].any() == (state is torn)
            while sim.time < end:
                sim.step(1 / 60)
            assert (sim.positions() == x).all() and (sim.velocities() == v).all()


def test_what_cannot_be_closed_is_refused():
    scene, cloth, seam = sewn()
    with pytest.raises(SceneError, match="resew: the seam of .* has no stitch at 0"):
        scene.resew(seam, 0)
    with pytest.raises(SceneError, match="resew: not a seam of this scene"):
        tc.Scene().resew(seam)
    with tc.Simulation(scene, h=1 / 60) as sim:
        sim.resew(seam)  # what holds goes on to hold
        assert sim.log == [] and not sim.stitches_open()[0].any()
