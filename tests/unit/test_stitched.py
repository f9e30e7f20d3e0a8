"""Meshed panels with stitches: edges that are split, seams that close, positions of another program, what is refused."""

import numpy as np
import pytest

import taichi_cloth as tc


def write_panels(tmp_path, cells=(3, 4), lines: str = "", name: str = "two.obj") -> tuple:
    """Panels of .3 m, 5 cm apart, with as many cells along the seam as asked for: (path, meshes, rows of the seam)."""
    meshes = [tc.grid(0.3, (2, n)) for n in cells]
    rows = [np.flatnonzero(m.uv[:, 0] < 1e-9 if k else m.uv[:, 0] > 0.2999) for k, m in enumerate(meshes)]
    text, first = "", 1
    for k, mesh in enumerate(meshes):
        away = 0.35 * k
        text += f"g panel{k}\n" + "".join("v {:.9f} {:.9f} {:.9f}\n".format(*(p + [away, 0, 0])) for p in mesh.x)
        text += "".join("vt {:.9f} {:.9f}\n".format(*(p + [away, 0])) for p in mesh.uv)
        text += "".join("f " + " ".join(f"{i + first}/{i + first}" for i in f) + "\n" for f in mesh.faces)
        first += mesh.vertex_count
    path = tmp_path / name
    path.write_text(text + lines)
    before = np.cumsum([0] + [m.vertex_count for m in meshes])
    return path, meshes, tuple(row + start for row, start in zip(rows, before))


@pytest.mark.parametrize("own", [False, True])
@pytest.mark.slow
def test_stitches_split_the_edges_of_both_sides(tmp_path, own):
    """Four vertices a side against five: each is sewn to a place on the other's edges, and they close."""
    _, meshes, (left, right) = write_panels(tmp_path)
    n = meshes[0].vertex_count
    stitches = []
    for v, s in zip(right, np.linspace(0, 3, 5)):
        k = min(int(s), 2)
        stitches.append((v, left[k], left[k + 1], s - k))
    if own:
        path, _, _ = write_panels(tmp_path, lines="".join(f"stitch {v} {a} {b} {t:.9f}\n" for v, a, b, t in stitches))
        garment = tc.load_stitched(path)
    else:
        path, _, _ = write_panels(tmp_path)
        rows = "".join(f"{v},{a},{b},{t:.9f}\n" for v, a, b, t in stitches)
        (tmp_path / "s.csv").write_text("vertex,edge_a,edge_b,t\n" + rows)
        garment = tc.load_stitched(path, tmp_path / "s.csv")
    mesh = garment.mesh
    assert mesh.vertex_count == n + meshes[1].vertex_count + 3 + 2  # three splits on the left, two on the right
    assert mesh.material_areas.sum() == pytest.approx(0.18, rel=1e-6) and mesh.uv.shape == (mesh.vertex_count, 2)
    assert sorted(len(a) for a, *_ in garment.seams) == [2] * 6  # edges against edges
    sewn = {int(i) for a, b, *_ in garment.seams for i in (*a, *b)}
    assert len(sewn) == 14 and all(mesh.x[a, 2] == pytest.approx(mesh.x[b, 2], abs=1e-7) for a, b, *_ in garment.seams)
    assert set(mesh.groups) == {"panel0", "panel1"} and sum(len(g) for g in mesh.groups.values()) == mesh.vertex_count
    scene = tc.Scene(gravity=None)
    scene.add_garment(garment, tc.Fabric(0.2, tc.Stretch(500, 1), tc.Shear(50), tc.Bend(1e-4)))
    sim = tc.Simulation(scene, h=1 / 60, integrator="backward_euler")
    sim.run(0.2, fps=60)
    x = sim.positions()
    assert all((x[a] == x[b]).all() for a, b, *_ in garment.seams)


def test_every_layer_of_a_seam_is_divided_alike(tmp_path):
    """Three panels on one seam, with an edge, two and three: places of the second lie between those of the third, so that each
    has to be split where another has vertices, its own or new ones. Else they would stand off the edge opposite."""
    lines, (_, _, (one, two, three)) = "", write_panels(tmp_path, (1, 2, 3))
    for row in (two, three):
        for v, t in zip(row, np.linspace(0, 1, len(row))):
            lines += f"stitch {v} {one[0]} {one[-1]} {t:.9f}\n"
    path, _, _ = write_panels(tmp_path, (1, 2, 3), lines=lines)
    garment = tc.load_stitched(path)
    mesh, z = garment.mesh, [0.0, 0.1, 0.15, 0.2, 0.3]
    for panel, where in (("panel0", 0.3), ("panel1", 0.35), ("panel2", 0.7)):
        rows = mesh.groups[panel]
        assert np.sort(np.abs(mesh.x[rows[np.abs(mesh.x[rows, 0] - where) < 1e-9], 2])) == pytest.approx(z, abs=1e-7)
    assert [len(a) for a, *_ in garment.seams].count(2) == 8  # edges against edges
    assert all(mesh.x[a, 2] == pytest.approx(mesh.x[b, 2], abs=1e-7) for a, b, *_ in garment.seams)
    assert mesh.material_areas.sum() == pytest.approx(0.27, rel=1e-6)


def test_edges_without_a_face_are_stitches(tmp_path):
    _, _, (left, right) = write_panels(tmp_path, (4, 4))
    path, _, _ = write_panels(tmp_path, (4, 4), "".join(f"l {a + 1} {b + 1}\n" for a, b in zip(left, right)))
    garment = tc.load_stitched(path)
    assert len(garment.seams) == 4 and garment.gap() == pytest.approx(0.05, abs=1e-6)


def test_a_stitched_garment_starts_as_it_was_draped(tmp_path):
    """Positions are those of the file's vertices; those of new ones are as far along the split edges as in the pattern."""
    _, meshes, (left, right) = write_panels(tmp_path)
    lines = [f"stitch {v} {left[0]} {left[-1]} 0\n" for v in right[:1]]
    lines += [f"stitch {right[1]} {left[0]} {left[1]} 0.75\n", f"stitch {right[4]} {left[3]} {left[2]} 0\n"]
    path, _, _ = write_panels(tmp_path, lines="".join(lines))
    garment = tc.load_stitched(path, scale=0.5)
    n, flat = sum(m.vertex_count for m in meshes), garment.mesh.x
    assert (garment.positions == flat).all() and len(flat) == n + 1

    def bent(x):  # affine along every edge: parameters are kept, lengths are not
        return x @ np.array([[0.3, 0.1, 0.9], [-0.2, 1.4, 0.0], [0.5, 0.0, 0.2]]) + [0.1, 1.0, -0.3]

    in_file = flat[:n] / 0.5
    worn = tc.load_stitched(path, scale=0.5, positions=bent(in_file))
    assert (worn.mesh.x == flat).all() and (worn.mesh.faces == garment.mesh.faces).all()
    assert np.abs(worn.positions - 0.5 * bent(flat / 0.5)).max() < 1e-12
    assert tc.Scene().add_garment(worn, tc.Fabric(0.2)).positions == pytest.approx(worn.positions)
    for wrong, what in ((flat, rf"positions: needs shape \({n}, 3\), not \({len(flat)}, 3\): two.obj has {n} vertices"),
                        (np.where(np.arange(n)[:, None] == 4, np.nan, in_file), "positions: vertex 4 is not finite"),
                        ("here", "positions: needs numbers")):
        with pytest.raises(tc.SceneError, match=what):
            tc.load_stitched(path, positions=wrong)


def test_a_place_near_the_end_of_an_edge_is_its_end(tmp_path):
    """But where its vertex has a neighbour sewn there: a triangle would be lost, so the edge is split."""
    _, meshes, (left, right) = write_panels(tmp_path)
    for sewn_too, new in (((right[3], left[3]), 0), ((right[0], left[0]), 1)):
        lines = f"stitch {sewn_too[0]} {sewn_too[1]} {sewn_too[1]} 0\n"
        lines += f"stitch {right[1]} {left[0]} {left[1]} 0.2\n"
        garment = tc.load_stitched(write_panels(tmp_path, lines=lines)[0])
        assert garment.mesh.vertex_count == sum(m.vertex_count for m in meshes) + new
        assert garment.mesh.material_areas.sum() == pytest.approx(0.18, rel=1e-6)
        sewn = {(int(i), int(j)) for a, b, *_ in garment.seams for i, j in zip(a, b)}
        assert ((right[1], left[0]) in sewn or (left[0], right[1]) in sewn) == (new == 0)


@pytest.mark.parametrize("t, new", [(0.0, 0), (0.015, 0), (0.2, 0), (0.4, 1), (0.6, 1), (0.8, 0), (0.985, 0), (1.0, 0)])
def test_a_stitch_may_name_its_edge_from_either_end(tmp_path, t, new):
    """(v, a, b, t) and (v, b, a, 1 - t) are one place, on edges that run either way in their triangle, in the OBJ or beside
    it: at (1 - t) a + t b, or, near an end, at that end; in the pattern, in space, and where another program has draped it."""
    path, meshes, (left, right) = write_panels(tmp_path)
    x, uv = (np.concatenate([getattr(m, what) + [0.35 * k, 0, 0][:size] for k, m in enumerate(meshes)])
             for what, size in (("x", 3), ("uv", 2)))
    worn, n = x[:, [2, 0, 1]] * [1, 2, 1] + x**2, len(x)
    for v, a, b in ((right[1], left[1], left[2]), (left[1], right[2], right[3])):
        near = n if new else a if t < 0.5 else b
        (tmp_path / "s.csv").write_text(f"vertex,edge_a,edge_b,t\n{v},{b},{a},{1 - t}\n")
        own = write_panels(tmp_path, lines=f"stitch {v} {a} {b} {t}\n", name="own.obj")[0]
        for garment in (tc.load_stitched(own, positions=worn), tc.load_stitched(path, tmp_path / "s.csv", positions=worn)):
            mesh = garment.mesh
            assert mesh.vertex_count == n + new and mesh.uv.shape == (n + new, 2)
            (one, other, *_), = garment.seams
            assert {int(one[0]), int(other[0])} == {int(v), int(near)}
            if new:
                for had, made in ((x, mesh.x), (uv, mesh.uv), (worn, garment.positions)):
                    assert made[n] == pytest.approx((1 - t) * had[a] + t * had[b], abs=1e-8)
            signed = np.linalg.det(mesh.corner_uv[:, 1:] - mesh.corner_uv[:, :1])
            assert (signed > 0).all() and signed.sum() / 2 == pytest.approx(0.18, rel=1e-6)


@pytest.mark.parametrize("cells", [(1, 4), (4, 1)])
def test_places_on_an_edge_are_in_order_from_whichever_end_they_are_named(tmp_path, cells):
    """Three on one edge, which runs one way or the other in its triangle: three new vertices, each where its stitch says."""
    _, meshes, rows = write_panels(tmp_path, cells)
    (a, b), sewn_to = rows if cells[0] == 1 else rows[::-1]
    named = [(sewn_to[1], a, b, 0.3), (sewn_to[2], b, a, 0.45), (sewn_to[3], b, a, 0.26)]
    lines = "".join(f"stitch {v} {p} {q} {t}\n" for v, p, q, t in named)
    garment = tc.load_stitched(write_panels(tmp_path, cells, lines=lines)[0])
    mesh, n = garment.mesh, sum(m.vertex_count for m in meshes)
    sewn = dict(pair for s in garment.seams for one, other in zip(s.a.tolist(), s.b.tolist())
                for pair in ((one, other), (other, one)))
    assert mesh.vertex_count == n + 3 and mesh.material_areas.sum() == pytest.approx(0.18, rel=1e-6)
    for v, p, q, t in named:
        assert sewn[int(v)] >= n and mesh.x[sewn[int(v)]] == pytest.approx((1 - t) * mesh.x[p] + t * mesh.x[q], abs=1e-8)


def test_of_two_neighbours_near_the_end_of_edges_the_nearer_is_sewn_to_it(tmp_path):
    """Whichever end of its own edge that is; for the other one the edge is split."""
    _, meshes, (left, right) = write_panels(tmp_path)
    garment = tc.load_stitched(write_panels(tmp_path, lines=f"stitch {right[1]} {left[1]} {left[2]} 0.2\n"
                                                            f"stitch {right[2]} {left[0]} {left[1]} 0.9\n")[0])
    n = sum(m.vertex_count for m in meshes)
    sewn = {frozenset((int(i), int(j))) for s in garment.seams for i, j in zip(s.a, s.b)}
    assert garment.mesh.vertex_count == n + 1 and {frozenset((right[2], left[1])), frozenset((right[1], n))} <= sewn


@pytest.mark.parametrize("t", [0.985, 0.015])
def test_a_place_at_the_end_of_an_edge_is_that_end_whatever_is_lost_by_it(tmp_path, t):
    _, meshes, (left, right) = write_panels(tmp_path)
    end, far = (left[0], left[1]) if t < 0.5 else (left[1], left[0])
    lines = f"stitch {right[0]} {end} {end} 0\nstitch {right[1]} {left[0]} {left[1]} {t}\n"
    garment = tc.load_stitched(write_panels(tmp_path, lines=lines)[0])
    assert garment.mesh.vertex_count == sum(m.vertex_count for m in meshes) and far not in {
        int(i) for s in garment.seams for i in (*s.a, *s.b)}
    assert "1 triangles, two corners of which are sewn" in garment.mesh.notes[0]


def test_stitches_are_named_by_vertices_of_either_side():
    """Of both rows of a seam, whatever order these are in."""
    mesh, scene = tc.grid(0.4, 4), tc.Scene()
    seam = scene.sew(scene.add_cloth(mesh, tc.Fabric(0.2)), [4, 2, 0], [20, 22, 24])
    for vertices, rows in ((2, [1]), (20, [0]), ([24, 4], [0, 2]), ([22, 2], [1]), (None, [0, 1, 2])):
        assert seam.stitches(vertices).tolist() == rows
    with pytest.raises(tc.SceneError, match="has no stitch at 3"):
        seam.stitches(3)


def test_what_is_wrong_with_stitches_is_named(tmp_path):
    path, _, (left, right) = write_panels(tmp_path)
    for text, what in (("stitch 1 2\n", "line"), (f"stitch {right[0]} {left[0]} {right[2]} 0.5\n", "no edge between"),
                       ("stitch 999 0 1 0.5\n", "vertices go from 0"),
                       (f"stitch 0 {left[0]} {left[1]} 1.5\n", "t from 0 to 1"), ("", "no stitches")):
        wrong, _, _ = write_panels(tmp_path, lines=text, name="wrong.obj")
        with pytest.raises(tc.SceneError, match=what):
            tc.load_stitched(wrong)
    (tmp_path / "s.csv").write_text("vertex,edge_a\n1,2\n")
    with pytest.raises(tc.SceneError, match="four columns"):
        tc.load_stitched(path, tmp_path / "s.csv")
    with pytest.raises((tc.SceneError, tc.MeshError), match="none.obj"):
        tc.load_stitched(tmp_path / "none.obj")


def reference_dress(shared) -> tc.Garment:
    """The dress of the reference data, where it is."""
    folder = shared / "data"
    if not (folder / "dress_pattern.obj").is_file():
        pytest.skip("the dress of the reference data is not there")
    with pytest.warns(UserWarning, match="belong to no face"):
        return tc.load_stitched(folder / "dress_pattern.obj", folder / "dress_stitches.csv")


@pytest.mark.slow
def test_the_dress_of_the_reference_data(shared):
    """Nearly all stitches become edges that are sewn to edges."""
    garment = reference_dress(shared)
    rows = [len(a) for a, *_ in garment.seams]
    assert rows.count(2) > 950 and rows.count(1) < 60 and len(garment.mesh.groups) == 14
