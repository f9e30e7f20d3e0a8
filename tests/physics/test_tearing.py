"""Cloth that tears: at which force, along which way, and what that does to momentum, energy and runs that go on."""

import numpy as np
import pytest
from reference.geometry import count_crossings, count_self_crossings

import taichi_cloth as tc
from taichi_cloth.errors import SceneError
from taichi_cloth.output.export import export

K = 5000.0
FABRIC = tc.Fabric(0.2, tc.Stretch(K, K / 1000), tc.Shear(K / 4, K / 4000))


def piece(cells, other=False):
    """100 x 63 mm of (across, rows below 20 mm, rows above) cells, with either diagonal."""
    nx, low, high = cells
    mesh = tc.grid((0.1, 0.063), (nx, low + high))
    row = np.round(mesh.uv[:, 1] / 0.063 * (low + high))
    v = np.where(row <= low, row * 0.02 / low, 0.02 + (row - low) * 0.043 / high)
    u = 0.1 - mesh.uv[:, 0] if other else mesh.uv[:, 0]
    faces = mesh.faces[:, [0, 2, 1]] if other else mesh.faces
    return tc.TriMesh(np.column_stack([u, np.zeros(len(u)), v]), faces, np.column_stack([u, v]))


def pulled(cells, other=False, speed=0.05, strength=1000.0):
    """The piece with a slit of 20 mm, held and pulled at its short sides: (scene, cloth, vertices that are held)."""
    scene = tc.Scene(gravity=None)
    cloth = scene.add_cloth(piece(cells, other), FABRIC, tear=tc.Tear(strength, length=0.01))
    scene.score(cloth, [(0.05, 0), (0.05, 0.02)], 0.0)
    u = cloth.mesh.uv[:, 0]
    left, right = np.flatnonzero(u < 1e-9), np.flatnonzero(u > 0.1 - 1e-9)
    scene.pin(cloth, left)
    scene.move(cloth, right, lambda t: (speed * t, 0, 0), relative=True)
    return scene, cloth, left


def peak(cells, other):
    """Largest force [N] of the load cell before it tears through; how far from the line of the slit it tears [m]."""
    scene, cloth, left = pulled(cells, other)
    with tc.Simulation(scene, h=1 / 60, integrator="backward_euler", cg_tol=1e-5) as sim:
        cell = []
        while not cell or sim.log[-1].opened <= 2 * cells[1]:
            sim.step()
            cell.append(abs(sim.constraint_forces()[left, 0].sum()))
        sim.step()
        assert max(r.ledger["kinetic"] + r.ledger["potential"] - r.ledger["pins"] for r in sim.log) < 1e-5
        opened = sim.stitches_open()[0]
        return max(cell), np.abs(cloth.mesh.uv[cloth.split.a[opened], 0] - 0.05).max()


@pytest.mark.slow
def test_the_force_from_a_slit_does_not_depend_on_the_mesh():
    """Two meshes, both diagonals of the coarse one, within 15 %, and along the slit."""
    forces = {}
    for cells, other in (((16, 3, 7), False), ((16, 3, 7), True), ((30, 6, 13), False)):
        forces[cells, other], astray = peak(cells, other)
        assert astray < 0.011
    assert max(forces.values()) < 1.15 * min(forces.values()), forces
    assert 25 < min(forces.values()) < 63


def test_it_is_the_whole_sheet_until_it_tears():
    ends = []
    for tear in (None, tc.Tear(1e6, length=0.05)):
        scene = tc.Scene()
        cloth = scene.add_cloth(tc.grid(0.5, 6), tc.Fabric(0.2, tc.Stretch(1000, 1), tc.Shear(100, 0.1), tc.Bend(1e-3, 1e-5)),
                                tear=tear)
        scene.pin(cloth, "top_left")
        with tc.Simulation(scene, h=1 / 100, integrator="backward_euler", cg_tol=1e-10) as sim:
            for _ in range(20):
                sim.step()
            ends.append(sim.positions()[:49])
            assert (sim.faces() == cloth.whole.faces).all() and sim.energy()["bend"] > 1e-7
    assert np.abs(ends[0] - ends[1]).max() < 1e-8 < 0.1 < np.abs(ends[0] - tc.grid(0.5, 6).x).max()


def test_a_length_that_triangles_do_not_resolve_is_refused():
    """No vertex would have a stress to judge, and nothing would tear, whatever the load."""
    with pytest.raises(tc.SceneError, match="length = 0.01 m is shorter than its triangles resolve: give it 0.024 m"):
        tc.Scene().add_cloth(tc.grid(1.0, 20), tc.Fabric(0.2, tc.Stretch(1000)), tear=tc.Tear(50.0))


def test_what_is_put_on_a_group_is_the_same_where_cloth_may_tear():
    """Corners at one vertex share its load, its mass and its spring."""
    found = []
    for tear in (None, tc.Tear(1e6, length=0.05)):
        scene = tc.Scene(gravity=None)
        cloth = scene.add_cloth(tc.grid((0.3, 0.1), (6, 2)), tc.Fabric(0.2, tc.Stretch(1000, 1), tc.Shear(100)), tear=tear)
        scene.pin(cloth, "left")
        scene.add_load(cloth, "right", (0.2, 0, 0))
        scene.add_mass(cloth, "right", 0.01)
        prop = scene.add_prop(tc.Sphere(0.1), position=lambda t: (0, 0, -0.1 * t))
        scene.attach(cloth, "right", prop, stiffness=20.0)
        with tc.Simulation(scene, h=1 / 100, cg_tol=1e-8, newton_tol=1e-9) as sim:
            assert sim.model.mass.sum() == pytest.approx(0.3 * 0.1 * 0.2 + 3 * 0.01)
            for _ in range(10):
                sim.step()
            held = sim.attachment_forces()[:, 0].sum()
            assert sim.forces()[:, 0].sum() == pytest.approx(3 * 0.2 + held, rel=1e-9) and -0.2 < held < -0.05
            found.append(sim.positions()[:21])
    assert found[0] == pytest.approx(found[1], abs=1e-9)


def test_momentum_energy_and_layers_through_a_tear():
    """A stretched sheet is let go over another one: momentum stays, energy does not grow, nothing crosses."""
    mesh, soft = piece((10, 2, 4)), tc.Fabric(0.2, tc.Stretch(500, 0.02), tc.Shear(125, 0.02))
    scene = tc.Scene(gravity=None)
    contact = tc.ClothContact(0.002, 0.2)
    top = scene.add_cloth(mesh, soft, mesh.x * [1.15, 1, 1] + [0, 0.0025, 0], velocities=(0, -0.5, 0), contact=contact,
                          tear=tc.Tear(40.0, length=0.02))
    below = scene.add_cloth(mesh, soft, contact=contact)
    scene.score(top, [(0.05, 0), (0.05, 0.02)], 0.0)
    state, ends = None, []
    for resumes in (False, True):
        with tc.Simulation(scene, h=1 / 2000, integrator="backward_euler", cg_tol=1e-12) as sim:
            m = sim.model.to_user(np.repeat(sim.model.mass[:, None], 3, axis=1))
            before = (m * sim.velocities()).sum(axis=0)
            if resumes:
                sim.resume(state)
            while sim.time < 0.006 - 1e-9:
                sim.step()
                assert np.abs((m * sim.velocities()).sum(axis=0) - before).max() < 1e-10
                x = sim.positions()
                assert count_crossings(x, top.mesh.faces, x, below.mesh.faces + below.start) == 0
                assert count_self_crossings(x, sim.faces()) == 0  # the sides of the tear among them
                if state is None and sim.log[-1].opened > 4:
                    state = sim.checkpoint()
            gains = [r.ledger["kinetic"] + r.ledger["potential"] - r.ledger["layers"] for r in sim.log]
            assert max(gains) < 1e-7 and sim.log[-1].opened > 6
            ends.append((sim.positions(), sim.velocities(), sim.faces()))
    assert all((a == b).all() for a, b in zip(*ends))


@pytest.mark.parametrize("integrator", ["safe", "backward_euler"])
def test_the_energy_of_a_tear_is_accounted_for(integrator):
    """Sum over steps of what is not, the one in which it parts included: less than 8 % of what pulls put in."""
    scene, _, _ = pulled((12, 2, 5), speed=0.2)
    with tc.Simulation(scene, h=1 / 60, integrator=integrator) as sim:
        while not sim.log or sim.log[-1].opened <= 12:
            sim.step()
        sim.step()
        lost, put_in = (sum(abs(r.ledger[name]) for r in sim.log) for name in ("unaccounted", "pins"))
    assert lost < 0.08 * put_in, (lost, put_in)


def test_a_scored_line_tears_at_its_fraction():
    """A strip whose stress is the same everywhere tears along the line, at the fraction of its strength."""
    mesh = tc.grid((0.1, 0.04), (10, 4))
    for fraction in (0.5, 1.0):
        scene = tc.Scene(gravity=None)
        cloth = scene.add_cloth(mesh, tc.Fabric(0.2, tc.Stretch(1000, 1)), tear=tc.Tear(100.0, length=0.02))
        scene.score(cloth, [(0.03, 0), (0.03, 0.04)], fraction)
        scene.pin(cloth, np.flatnonzero(cloth.mesh.uv[:, 0] < 1e-9))
        scene.move(cloth, np.flatnonzero(cloth.mesh.uv[:, 0] > 0.1 - 1e-9), lambda t: (0.05 * t, 0, 0), relative=True)
        with tc.Simulation(scene, h=1 / 100, integrator="backward_euler", cg_tol=1e-8) as sim:
            while not sim.log or not sim.log[-1].opened:
                sim.step()
            assert sim.time == pytest.approx(fraction * 100 / 1000 * 0.1 / 0.05, abs=0.012)
            edge = cloth.split.edge
            assert (np.isin(edge, edge[sim.stitches_open()[0]]) == sim.stitches_open()[0]).all(), "an edge opens at both ends"
            if fraction < 1:
                opened = sim.stitches_open()[0]
                assert (np.abs(cloth.mesh.uv[cloth.split.a[opened], 0] - 0.03) < 1e-9).all()


def test_recorded_faces_follow(tmp_path):
    """Frames, a renderer's faces and exported ones are those that hang together; pc2 refuses by name."""
    code = ("import taichi_cloth as tc\nRUN = {'duration': .1, 'fps': 20, 'h': 1 / 60, 'integrator': 'backward_euler'}\n"
            "def build():\n    scene = tc.Scene(gravity=None)\n"
            "    fabric = tc.Fabric(.2, tc.Stretch(1000, 1), tc.Shear(100, .1))\n"
            "    scene.add_cloth(tc.grid(.1, 4), fabric, tear=tc.Tear(1e5))\n"
            "    seam = scene.seams[0]\n    scene.at(.06, lambda s: s.unsew(seam))\n    return scene\n")
    (tmp_path / "apart.py").write_text(code)
    from taichi_cloth.app.cli import main

    assert main(["run", str(tmp_path / "apart.py"), "--out", str(tmp_path / "out"), "--size", "32x32"]) == 0
    recording = tc.Recording(tmp_path / "out")
    first, last = (recording.frame(k)["faces"] for k in (0, 2))
    assert (first == tc.grid(0.1, 4).faces).all() and len(np.unique(last)) == 3 * len(last)
    files = export(recording, "ply", tmp_path / "ply")
    import meshio

    counts = [len(np.unique(meshio.read(f).cells_dict["triangle"])) for f in files]
    assert counts == [25, 25, 96]
    with pytest.raises(tc.ClothError, match="pc2"):
        export(recording, "pc2", tmp_path / "pc2")


def test_what_cannot_tear_is_refused():
    scene, mesh = tc.Scene(), tc.grid(0.1, 4)
    for wrong in ({"strength": -1.0}, {"strength": (1.0, 0.0)}, {"strength": (1.0, 2.0, 3.0)},
                  {"strength": 1.0, "length": 0.0}):
        with pytest.raises(SceneError, match="tear"):
            tc.Tear(**wrong)
    with pytest.raises(SceneError, match="pattern"):
        scene.add_cloth(tc.TriMesh(mesh.x, mesh.faces), FABRIC, tear=tc.Tear(1.0))
    with pytest.raises(SceneError, match="curvature"):
        scene.add_cloth(mesh, tc.Fabric(0.2, tc.Stretch(1), bend=tc.Bend(1e-4, model="curvature")), tear=tc.Tear(1.0))
    with pytest.raises(SceneError, match="stretch"):
        scene.add_cloth(mesh, tc.Fabric(0.2, bend=tc.Bend(1e-4)), tear=tc.Tear(1.0))
    cloth = scene.add_cloth(mesh, FABRIC)
    with pytest.raises(SceneError, match="does not tear"):
        scene.score(cloth, [(0, 0), (0.1, 0)], 0.5)
    torn = scene.add_cloth(mesh, FABRIC, tear=tc.Tear(1.0))
    with pytest.raises(SceneError, match="fraction"):
        scene.score(torn, [(0, 0), (0.1, 0)], -0.5)
    with pytest.raises(SceneError, match=f"'verlet' solves no system, and cloth tears in one \\('{torn.name}' may\\)"):
        tc.Simulation(scene, integrator="verlet")
