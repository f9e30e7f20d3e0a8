"""Garments in files: what comes back is what was saved; sizes are looked at first; lattices over any kind of pattern."""

import os
import zipfile

import numpy as np
import pytest

import taichi_cloth as tc
from taichi_cloth.backend.rows import read
from taichi_cloth.io import npz
from taichi_cloth.solver import multilevel
from taichi_cloth.solver.lattice import coordinates, levels

FABRIC = tc.Fabric(0.15, tc.Stretch(1000, 1), tc.Shear(100, 0.1), tc.Bend(1e-5, 1e-7))

WEAK = tc.Fabric(0.15, tc.Stretch(1000, 1), tc.Shear(100, 0.1))


def panels(cells: int = 4, kind: str = "vertex") -> tc.Garment:
    """Two panels that face each other, sewn along two sides, with all that a garment may have."""
    one = tc.grid(0.4, cells, plane="xy")
    n, sides = one.vertex_count, [np.flatnonzero(np.abs(one.uv[:, 0] - u) < 1e-9) for u in (0.0, 0.4)]
    x = np.concatenate([one.x + [0, 0, 0.13], one.x + [0, 0, -0.17]])
    uv, faces = np.concatenate([one.uv, one.uv + [0.7, 0.1]]), np.concatenate([one.faces, one.faces[:, ::-1] + n])
    groups = {"front": range(n), "back": range(n, 2 * n), "hem": [3, 1, 2], "nothing": []}
    mesh = tc.TriMesh(x, faces, {"vertex": uv, "corner": uv[faces], "flattened": None}[kind], groups, ("made by hand",))
    seams = ((sides[0], sides[0] + n, "given", 2.0, 300.0), (sides[1], sides[1] + n, 0.1 + 0.2), ([3], [n + 3], 0.0, 0.0))
    return tc.Garment(mesh, seams, x * [1.01, 1, 0.5])


def as_before(garment: tc.Garment, path) -> None:
    """The file that was written before material coordinates had a place for each vertex."""
    garment.save(path)
    with np.load(path) as file:
        old = {name: file[name] for name in file.files if name not in ("uv", "flattened", "notes")}
    np.savez_compressed(path, **old, corner_uv=garment.mesh.corner_uv)


@pytest.mark.parametrize("kind", ["vertex", "corner", "flattened"])
def test_what_is_loaded_is_what_was_saved(tmp_path, kind):
    """Bit for bit, with the same types, in the same order."""
    garment = panels(kind=kind)
    garment.save(tmp_path / "g.npz")
    again = tc.load_garment(tmp_path / "g.npz")
    for name in ("x", "faces", "uv", "corner_uv"):
        was, now = getattr(garment.mesh, name), getattr(again.mesh, name)
        assert was.dtype == now.dtype and was.shape == now.shape and (was == now).all(), name
    assert again.mesh.notes == garment.mesh.notes and again.mesh.notes[0] == "made by hand"
    assert again.mesh.flattened == garment.mesh.flattened == (kind == "flattened")
    assert list(again.mesh.groups) == list(garment.mesh.groups)
    assert all((again.mesh.groups[name] == index).all() for name, index in garment.mesh.groups.items())
    assert (again.positions == garment.positions).all() and len(again.seams) == 3
    for was, now in zip(garment.seams, again.seams):
        assert was[2:] == now[2:] and (was.a == now.a).all() and (was.b == now.b).all()


@pytest.mark.parametrize("kind", ["vertex", "corner"])
def test_what_is_done_with_garments_is_done_with_loaded_ones(tmp_path, kind):
    """Meshed anew, torn, sewn: as with the one that was saved, from new files and from old ones."""
    pytest.importorskip("scipy", reason="meshing panels needs the extra `garment`")
    garment = panels(kind="vertex")
    wanted = tc.remesh(garment, 0.05)
    panels(kind=kind).save(tmp_path / "new.npz")
    as_before(garment, tmp_path / "old.npz")
    for name in ("new", "old"):
        again = tc.load_garment(tmp_path / f"{name}.npz")
        made = tc.remesh(again, 0.05)
        assert (made.mesh.uv == wanted.mesh.uv).all() and (made.mesh.faces == wanted.mesh.faces).all()
        assert (coordinates(again.mesh) == garment.mesh.uv).all()
        scene, given = tc.Scene(), tc.Scene()
        scene.add_garment(again, FABRIC, pull=7.0), given.add_garment(garment, FABRIC, pull=7.0)
        for was, now in zip(given.seams, scene.seams):
            assert (was.bears == now.bears).all() and (was.pulls == now.pulls).all()
        torn = [tc.Scene().add_cloth(g.mesh, WEAK, tear=tc.Tear(500.0, 0.2)) for g in (again, garment)]
        assert (torn[0].mesh.uv == torn[1].mesh.uv).all() and (torn[0].mesh.faces == torn[1].mesh.faces).all()


def test_seams_over_a_cut_of_the_pattern_are_as_long_as_their_cloth():
    """A tube half as large in space as in its pattern: what its seams bear goes by the pattern, on the cut too."""
    tube = tc.cylinder(0.1, 0.3, (12, 6))
    small = tc.TriMesh(tube.x * [1, 0.5, 1], tube.faces, tube.corner_uv)
    across = np.flatnonzero(np.abs(tube.x[:, 0] - tube.x[0, 0]) + np.abs(tube.x[:, 2] - tube.x[0, 2]) < 1e-9)
    row = across[np.argsort(tube.x[across, 1])]
    assert len(row) == 7 and small.vertex_uv is None
    scene = tc.Scene()
    bears = scene.sew(scene.add_cloth(small, FABRIC), row[:4], row[::-1][:4], strength=10.0).bears
    assert bears == pytest.approx(10.0 * 0.05 * np.array([0.5, 1, 1, 0.5]))


def test_lattices_lie_in_the_pattern():
    """Where it is cut too; in space only where it says nothing of what lies beside what."""
    tube = tc.cylinder(0.1, 0.3, (12, 6))
    places = coordinates(tube)
    assert places.shape == (tube.vertex_count, 2) and tube.uv.shape == (tube.face_count, 3, 2)
    whole = (places[tube.faces] == tube.corner_uv).all(axis=2)
    beside = np.unique(tube.faces[~whole.all(axis=1)])  # of the triangles on one side of the cut
    assert 0 < len(beside) <= 2 * 7 and all((tube.corner_uv[tube.faces == v] == places[v]).all(axis=1).any() for v in beside)
    parts = tube.corner_uv + np.arange(tube.face_count)[:, None, None]
    assert coordinates(tc.TriMesh(tube.x, tube.faces, parts)) is not places
    assert coordinates(tc.TriMesh(tube.x, tube.faces, parts)).shape == coordinates(tc.TriMesh(tube.x, tube.faces)).shape == (
        tube.vertex_count, 3)


def test_levels_end_where_wider_hats_say_no_more():
    """A hundred patches of four places each, apart from each other: every level has fewer nodes than the one below."""
    one = np.array([[0, 0], [1, 0], [0, 1], [1, 1]])
    points = np.concatenate([one + [3 * (k % 10), 3 * (k // 10)] for k in range(100)])
    links = np.concatenate([[[0, 1], [0, 2], [1, 3], [2, 3]] + 4 * np.full((4, 2), k) for k in range(100)])
    counts = [level.count for level in levels(points, np.zeros(400, dtype=np.int64), 1.0, links)]
    assert counts[-1] >= 100 and (np.diff(counts) < 0).all()


@pytest.mark.slow
def test_a_loaded_garment_moves_as_the_one_that_was_saved(tmp_path):
    """Bit for bit, with levels, whose coarsest is solved exactly; an old file's too. What is not finite of that is found
    anew."""
    garment = panels(17)
    garment.save(tmp_path / "new.npz")
    as_before(garment, tmp_path / "old.npz")
    ways = []
    for g in (garment, tc.load_garment(tmp_path / "new.npz"), tc.load_garment(tmp_path / "old.npz")):
        scene = tc.Scene()
        scene.pin(scene.add_garment(g, FABRIC), [0, 17])
        with tc.Simulation(scene, h=1 / 60, integrator="backward_euler") as sim:
            assert sim.integrator.system.preconditioner.coarsest is not None
            for _ in range(3):
                sim.step()
            ways.append((sim.positions(), [r.iterations for r in sim.log]))
            assert not any("preconditioner" in note for note in sim.notes)
            coarsest = sim.integrator.system.preconditioner.coarsest
            coarsest.matrix = np.nan * coarsest.matrix  # as what overflows leaves it
            for _ in range(2):
                assert sim.step(1 / 100).rejections == {}
            assert np.isfinite(coarsest.matrix).all() and np.isfinite(read(coarsest.inverse)).all()
    assert all((x == ways[0][0]).all() and count == ways[0][1] for x, count in ways[1:])


@pytest.mark.slow
def test_what_cannot_be_made_of_levels_is_left_out_with_a_note(monkeypatch):
    """Panels that lie flat beside each other, without a pattern: their lattice is one in space, in which each meets two layers
    of hats that are the same but for a factor. They fall and are sewn as the same cloth does with the particles' own blocks,
    and with a coarsest level that has too many nodes to be solved exactly."""
    ends = []
    for preconditioner, most, words in (("multilevel", 1000, "directions to the finer ones"),
                                        ("multilevel", 10, "too many to be solved exactly"), ("block_jacobi", 1000, "")):
        monkeypatch.setattr(multilevel, "MOST_EXACT", most)
        scene = tc.Scene()
        garment = panels(12, "flattened")
        scene.pin(scene.add_garment(garment, FABRIC), [0, 12])
        with tc.Simulation(scene, h=1 / 60, preconditioner=preconditioner, integrator="backward_euler", cg_tol=1e-8) as sim:
            sim.step()
            before = list(sim.notes)
            sim.step()
            said = [note for note in sim.notes if note.startswith(("solver:", "preconditioner"))]
            assert len(said) == bool(words) and all(words in note for note in said) and sim.notes == before, sim.notes
            assert sim.log[-1].rejections == {}
            ends.append(sim.positions())
            if len(ends) == 1:
                sim.set_state(1e29 * ends[0], sim.velocities())
                with pytest.raises(tc.SimulationError, match="no step"):
                    sim.step()
                sim.set_state(ends[0], np.zeros_like(ends[0]))  # nothing of what overflowed is left
                assert sim.step().rejections == {}
    assert all(np.abs(x - ends[2]).max() < 1e-6 * np.abs(ends[2]).max() for x in ends[:2])


@pytest.mark.slow
def test_cloth_that_no_lattice_goes_over_has_the_particles_own_blocks():
    """A triangle 1e13 m away from a sheet with edges of 3 cm: with a note, and it falls."""
    sheet, far = tc.grid(0.5, 17), 1e13 * np.eye(3)[0] + [[0, 0, 0], [0, 0, 1], [1, 0, 0]]
    mesh = tc.TriMesh(np.concatenate([sheet.x, far]), [*sheet.faces, [324, 325, 326]], [*sheet.uv, *far[:, [0, 2]]])
    scene = tc.Scene()
    with pytest.warns(UserWarning, match="another unit"):
        scene.add_cloth(mesh, FABRIC)
    with tc.Simulation(scene, h=1 / 60, preconditioner="multilevel", integrator="backward_euler") as sim:
        assert [note for note in sim.notes if "times as long as its edges are, so that it is block_jacobi" in note]
        sim.step()
        assert sim.velocities()[:324, 1] == pytest.approx(-9.81 / 60, rel=1e-6)


def bomb(path, expands: int) -> None:
    """A whole garment, and beside its arrays one of zeros: some 400 times as large as the file."""
    panels().save(path)
    with zipfile.ZipFile(path, "a", zipfile.ZIP_DEFLATED) as file:
        with file.open("padding.npy", "w") as entry:
            np.lib.format.write_array_header_1_0(entry, {"descr": "<f8", "fortran_order": False, "shape": (expands << 17,)})
            for _ in range(expands):
                entry.write(bytes(1 << 20))


def test_what_expands_too_far_is_refused_by_its_sizes(tmp_path, monkeypatch):
    """Before any of it is read, whoever reads."""
    path = tmp_path / "g.npz"
    bomb(path, 80)
    assert 80 << 20 > 100 * os.path.getsize(path)
    monkeypatch.setattr(zipfile.ZipFile, "open", lambda *_, **__: pytest.fail("it was read"))
    for load, error in ((tc.load_garment, tc.SceneError), (tc.load_solid, tc.MeshError), (npz.unpack, npz.DamagedError)):
        with pytest.raises(error, match=r"its arrays are 83,\d{3},\d{3}: no data are packed as tightly.*numpy.savez"):
            load(path)


def test_what_no_memory_holds_is_refused_by_its_sizes(tmp_path, monkeypatch):
    path = tmp_path / "g.npz"
    np.savez(path, positions=np.zeros((5000, 3)), faces=[[0, 1, 2]])
    monkeypatch.setattr(os, "sysconf", lambda name: {"SC_PAGE_SIZE": 4096, "SC_PHYS_PAGES": 25}[name])
    with pytest.raises(tc.MeshError, match="more than this machine has"):
        tc.load_solid(path)
    monkeypatch.setattr(os, "sysconf", lambda name: {"SC_PAGE_SIZE": 4096, "SC_PHYS_PAGES": 40}[name])
    assert tc.load_solid(path).x.shape[-2:] == (5000, 3)


@pytest.mark.parametrize("name, shape", [("positions", (49, 3)), ("positions", (50, 2)), ("faces", (64, 4)), ("x", (50, 2))])
def test_arrays_that_do_not_go_together_are_refused_by_their_shapes(tmp_path, monkeypatch, name, shape):
    path = tmp_path / "g.npz"
    panels().save(path)
    with np.load(path) as file:
        arrays = {key: file[key] for key in file.files}
    np.savez(path, **{**arrays, name: np.zeros(shape, arrays[name].dtype)})
    monkeypatch.setattr(np.lib.format, "read_array", lambda *_, **__: pytest.fail("it was read"))
    with pytest.raises(tc.SceneError, match=r"g\.npz: is not a garment: .* needs shape \(.*, 3\), not \("):
        tc.load_garment(path)
