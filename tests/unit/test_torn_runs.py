"""What runs of cloth that tears or rips give: by every implicit method and precision, in heat maps, pictures and exports."""

import numpy as np
import pytest

import taichi_cloth as tc
from taichi_cloth.app.summary import describe
from taichi_cloth.output.export import export
from taichi_cloth.output.look import Look
from taichi_cloth.output.picture import Artist
from taichi_cloth.recording import record
from taichi_cloth.system.quantities import evaluate

K, STRENGTH = 1000.0, 100.0


@pytest.mark.parametrize("integrator, precision", [("tr_bdf2", "f64"), ("newton_euler", "f64"), ("safe", "f32")])
@pytest.mark.slow
def test_it_tears_by_every_implicit_method(integrator, precision):
    """A strip that is pulled at a known rate tears through along its scored line when it bears what that does."""
    scene, mesh = tc.Scene(gravity=None), tc.grid((0.12, 0.04), (6, 2))
    fabric = tc.Fabric(0.2, tc.Stretch(K, 1.0), bend=tc.Bend(1e-4, 1e-6))
    cloth = scene.add_cloth(mesh, fabric, tear=tc.Tear(STRENGTH, length=0.03))
    scene.score(cloth, [(0.04, 0), (0.04, 0.04)], 0.5)
    u = cloth.mesh.uv[:, 0]
    scene.pin(cloth, np.flatnonzero(u < 1e-9))
    scene.move(cloth, np.flatnonzero(u > 0.12 - 1e-9), lambda t: (0.06 * t, 0, 0), relative=True)
    with tc.Simulation(scene, h=1 / 60, integrator=integrator, precision=precision) as sim:
        opened = []
        while sim.time < 0.25 - 1e-9:
            sim.step()
            opened.append(sim.log[-1].opened)
        first = next(k for k, o in enumerate(opened) if o)
        assert sim.log[first].t == pytest.approx(0.5 * STRENGTH / K * 0.12 / 0.06, abs=2 / 60)
        gave, x = sim.stitches_open()[0], sim.positions()
        assert (np.abs(cloth.mesh.uv[cloth.split.a[gave], 0] - 0.04) < 1e-6).all() and gave.sum() == 4
        a, b = cloth.split.a[gave], cloth.split.b[gave]
        assert np.abs(x[a, 0] - x[b, 0]).min() > 2e-3
        assert np.linalg.norm(x[cloth.split.a[~gave]] - x[cloth.split.b[~gave]], axis=1).max() == 0


def bent():
    """Two halves bent to a curvature of 8 1/m and sewn along u = .1, the right one may tear: (scene, seam)."""
    mesh = tc.grid((0.2, 0.1), (8, 4))
    edge = np.flatnonzero(np.abs(mesh.uv[:, 0] - 0.1) < 1e-9)
    other = np.arange(mesh.vertex_count)
    other[edge] = mesh.vertex_count + np.arange(len(edge))
    right = (mesh.uv[mesh.faces, 0] > 0.1 - 1e-9).all(axis=1)
    x, uv = np.concatenate([mesh.x, mesh.x[edge]]), np.concatenate([mesh.uv, mesh.uv[edge]])
    whole = tc.TriMesh(x, np.where(right[:, None], other[mesh.faces], mesh.faces), uv)
    s = x[:, 0] - x[:, 0].min()
    rolled = np.column_stack([np.sin(8 * s) / 8, (1 - np.cos(8 * s)) / 8, x[:, 2]])
    scene = tc.Scene(gravity=None)
    cloth = scene.add_cloth(whole, tc.Fabric(0.2, tc.Stretch(K), bend=tc.Bend(1e-3)), rolled,
                            tear=tc.Tear(1e6, where=np.flatnonzero(uv[:, 0] > 0.1 + 1e-9)))
    return scene, scene.sew(cloth, edge, other[edge])


def test_the_closing_lines_say_which_are_tears_and_which_are_seams():
    scene, seam = bent()
    with tc.Simulation(scene, h=1e-6, integrator="backward_euler") as sim:
        sim.unsew(seam, [seam.a[0]])
        sim.step()
        assert "seams: 1 of 5 stitches have opened, at most " in describe(sim, 1.0)
        assert "tears: 0 of 40 edges are torn or cut\n" in describe(sim, 1.0)
    scene = tc.Scene()
    cloth = scene.add_cloth(tc.grid((0.12, 0.04), (6, 2)), tc.Fabric(0.2, tc.Stretch(K)), tear=tc.Tear(STRENGTH, length=0.03))
    scene.score(cloth, [(0.04, 0), (0.04, 0.04)], 0.0)
    with tc.Simulation(scene, h=1e-6, integrator="backward_euler") as sim:
        sim.step()
        said = describe(sim, 1.0)
        assert "tears: 2 of 28 edges are torn or cut\n" in said and "seams" not in said  # 44 less the border's 16


@pytest.fixture
def torn():
    """The two halves at the start; with half of their seam open and torn along u = .15: [(geometry, frame, bend energy)]."""
    scene, seam = bent()
    tear = next(s for s in scene.seams if s.tears)
    with tc.Simulation(scene, h=1e-4, integrator="backward_euler") as sim:
        out = [(record.geometry(sim), record.frame(sim), sim.energy()["bend"])]
        sim.unsew(seam, seam.a[:2])
        u = tear.cloth.mesh.uv[tear.a, 0]
        sim.unsew(tear, tear.a[np.abs(u - 0.15) < 1e-9])
        out.append((out[0][0], record.frame(sim), sim.energy()["bend"]))
        x, v = sim.positions(), sim.velocities()
        x[seam.b[:2], 1] += 0.004
        sim.set_state(x, v)
        out.append((out[0][0], record.frame(sim), sim.energy()["bend"]))
    return out


def test_heat_of_bending_follows_tears(torn):
    """Its sum over the area is the energy that the simulation has, also where hinges went."""
    for geometry, frame, energy in torn[:2]:
        corner = geometry["uv"].astype(float)
        a, b = corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]
        third = np.repeat(np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]) / 6, 3)
        area = np.bincount(frame["faces"].ravel(), third, minlength=len(frame["x"]))
        assert float(evaluate("bend", geometry, frame) @ area) == pytest.approx(energy, rel=1e-4)
    assert 0.5 * torn[0][2] < torn[1][2] < 0.9 * torn[0][2]
    assert torn[1][1]["hinge_whole"].sum() < len(torn[0][0]["hinges"]) and "hinge_whole" not in torn[0][1]


def test_forces_of_contact_are_those_on_all_corners_that_hang_together(torn):
    geometry, frame, _ = torn[1]
    frame = frame | {"contact": np.ones((len(frame["x"]), 3), dtype=np.float32)}
    values = evaluate("contact", geometry, frame)
    assert values.sum() == pytest.approx(np.sqrt(3) * len(frame["x"]))
    assert values[np.setdiff1d(np.arange(len(values)), frame["faces"])].max() == 0


def test_pictures_and_welded_meshes_have_open_what_is_open(torn):
    """Drawn smooth, in any order of frames: sewn sides are one line, open ones are two."""
    (geometry, start, _), _, (_, last, _) = torn
    artist = Artist(geometry, (48, 32), Look(smooth=1, quality="fast"))
    counts = []
    for frame in (start, last, start):
        artist.draw(frame)
        counts.append(len(np.unique(artist.smooth.faces)))
    assert counts[0] == counts[2] < counts[1]
    assert "sewn" in last and "sewn" not in start
    assert len(np.unique(last["sewn"][last["faces"]])) > len(np.unique(geometry["sewn"][start["faces"]])) + 2


@pytest.mark.slow
def test_a_ripped_run_is_welded_where_it_is_whole(tmp_path):
    """Files of frames follow; formats of one set of faces take the cloths, and refuse what is welded anew, by name."""
    import meshio

    scene, seam = bent()
    scene.at(0.04, lambda s: s.unsew(seam, seam.a[:2]))
    with tc.Simulation(scene, h=1 / 60, integrator="backward_euler") as sim:
        recording = tc.record(sim, tmp_path / "run", 0.1, 20)
        gaps = np.linalg.norm(sim.positions()[seam.a] - sim.positions()[seam.b], axis=1)
    files = export(recording, "ply", tmp_path / "p", "welded")
    counts = [len(np.unique(meshio.read(f).cells_dict["triangle"])) for f in files]
    assert counts == [45, 47, 47] and (gaps[2:] == 0).all() and gaps[0] > 1e-4
    for format in ("usda", "obj", "vtu"):
        assert export(recording, format, tmp_path / format, "welded")
    with pytest.raises(tc.ClothError, match="faces of 'cloth0' change from frame to frame, and glb"):
        export(recording, "glb", tmp_path / "glb", "welded")
    assert not (tmp_path / "glb").exists()
    recording.report(tmp_path / "report.html")
