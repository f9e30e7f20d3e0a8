"""Sewing patterns: what is read, meshed, placed, refused; garments in files; measured fabrics."""

import json
import pathlib
from dataclasses import replace

import numpy as np
import pytest

import taichi_cloth as tc
from taichi_cloth.app import cli, scenefile
from taichi_cloth.backend.rows import write
from taichi_cloth.garment import dressing
from taichi_cloth.garment.mesher import mesh_polygon
from taichi_cloth.io.garment import load_garment
from taichi_cloth.scene.intersections import count_crossings, count_self_crossings

pytest.importorskip("scipy", reason="meshing patterns needs the extra `garment`")


def skirt(**change) -> dict:
    """A front with a dart and a back that is longer along one side, in GarmentCode's format."""
    front = {"translation": [0, 90, 15], "rotation": [0, 0, 0],
             "vertices": [[-30, 0], [30, 0], [22, 50], [2, 50], [0, 38], [-2, 50], [-22, 50]],
             "edges": [{"endpoints": [0, 1], "label": "hem"}, {"endpoints": [1, 2], "curvature": {"type": "quadratic",
                                                                                                    "params": [[0.5, -0.1]]}},
                       {"endpoints": [2, 3], "label": "waist"}, {"endpoints": [3, 4]}, {"endpoints": [4, 5]},
                       {"endpoints": [5, 6], "label": "waist"},
                       {"endpoints": [6, 0], "curvature": [0.5, -0.1]}]}
    back = {"translation": [0, 90, -15], "rotation": [0, 180, 0], "vertices": [[-30, 0], [30, 0], [20, 52], [-20, 52]],
            "edges": [{"endpoints": [0, 1], "label": "hem"}, {"endpoints": [1, 2]},
                      {"endpoints": [2, 3], "curvature": {"type": "circle", "params": [30, 0, 1]}, "label": "waist"},
                      {"endpoints": [3, 0], "curvature": {"type": "cubic", "params": [[0.3, 0.02], [0.7, -0.02]]}}]}
    end = lambda panel, edge: {"panel": panel, "edge": edge}  # noqa: E731
    stitches = [[end("front", 1), end("back", 3)], [end("front", 6), end("back", 1)], [end("front", 3), end("front", 4)]]
    return {"pattern": {"panels": {"front": front, "back": back}, "stitches": stitches, "panel_order": ["front", "back"]},
            "properties": {"units_in_meter": 100, **change}}


def read(tmp_path, data) -> tc.Pattern:
    path = tmp_path / "skirt.json"
    path.write_text(json.dumps(data))
    return tc.load_pattern(path)


def least_angles(mesh: tc.TriMesh) -> np.ndarray:
    corner, out = mesh.corner_uv, []
    for k in range(3):
        a, b = corner[:, (k + 1) % 3] - corner[:, k], corner[:, (k + 2) % 3] - corner[:, k]
        cosine = np.einsum("ij,ij->i", a, b) / np.linalg.norm(a, axis=1) / np.linalg.norm(b, axis=1)
        out.append(np.degrees(np.arccos(cosine)))
    return np.min(out, axis=0)


SCENES = pathlib.Path(__file__).parents[2] / "scenes"


SHIPPED = ["skirt", "dress", "shirt", "trousers", "jacket"]


@pytest.mark.parametrize("name", SHIPPED)
def test_hems_and_cuffs_go_on_smoothly_over_their_seams(name):
    """Where two panels are sewn, their hems make a straight angle: else a corner sticks out below or is a notch. From the
    file's own numbers: chords, and control points along an edge and to its left."""
    body = json.loads((SCENES / "patterns" / f"{name}.json").read_text())["pattern"]

    def leaves(panel: str, corner: int) -> dict[int, complex]:
        """Directions of the edges that leave a corner, by their numbers."""
        at = [complex(*place) for place in body["panels"][panel]["vertices"]]
        out = {}
        for k, edge in enumerate(body["panels"][panel]["edges"]):
            a, b = (at[i] for i in edge["endpoints"])
            points = [a, *(a + (b - a) * complex(*c) for c in edge.get("curvature", {}).get("params", [])), b]
            if corner in edge["endpoints"]:
                out[k] = points[1] - points[0] if edge["endpoints"][0] == corner else points[-2] - points[-1]
        return out

    def angle(panel: str, edge: int, corner: int) -> tuple[float, str]:
        """(degrees between a sewn edge and the other one at a corner, that one's label)."""
        ways = leaves(panel, corner)
        other, = set(ways) - {edge}
        return abs(np.degrees(np.angle(ways[other] / ways[edge]))), body["panels"][panel]["edges"][other].get("label", "")

    seen = 0
    for ends in ([end for end in stitch[:2] if "edge" in end] for stitch in body["stitches"] if "right_wrong" not in stitch):
        if len(ends) == 2:
            one, other = (body["panels"][end["panel"]]["edges"][end["edge"]]["endpoints"] for end in ends)
            for corners in zip(one, other[::-1]):
                (a, label), (b, same) = (angle(end["panel"], end["edge"], corner) for end, corner in zip(ends, corners))
                if label == same and label in ("hem", "cuff"):
                    assert a + b == pytest.approx(180, abs=0.5), (ends, label)
                    seen += 1
    assert seen == {"skirt": 2, "dress": 2, "shirt": 4, "trousers": 4, "jacket": 4}[name]


@pytest.mark.parametrize("name", SHIPPED)
def test_patterns_that_come_with_scenes_are_meshed(name):
    garment = tc.load_pattern(SCENES / "patterns" / f"{name}.json").mesh(0.02)
    angles = least_angles(garment.mesh)
    assert angles.min() >= 28 and angles.mean() >= 54.9 and garment.mesh.notes == ()


def nearest(a, b, points: np.ndarray) -> np.ndarray:
    """(n,) distances of points from the line between a and b [m]."""
    a, b = np.array(a), np.array(b)
    along = np.clip((points - a) @ (b - a) / max((b - a) @ (b - a), 1e-30), 0, 1)
    return np.linalg.norm(points - a - along[:, None] * (b - a), axis=1)


@pytest.mark.slow
@pytest.mark.parametrize("name, seams, places", [
    ("skirt", 6, {"waist": 1.11, "hem": 0.65}), ("dress", 8, {"shoulder": 1.46, "waist": 1.08, "hem": 0.66}),
    ("shirt", 14, {"shoulder": 1.47, "hem": 0.90, "cuff": 1.22, "collar": 1.51}),
    ("trousers", 8, {"waist": 1.03, "hem": 0.12}), ("jacket", 15, {"shoulder": 1.45, "hem": 1.06, "cuff": 1.20})])
def test_patterns_are_put_on_with_nobodys_hand_on_them(name, seams, places, monkeypatch):
    """Hung round a figure, sewn and let down: every seam closed, at rest where it is worn, through nothing; sleeves round
    arms, legs round legs. The dress's skirt is half as wide again as the bodice that it is sewn to: .62 m to .40."""
    monkeypatch.syspath_prepend(str(SCENES))
    import dress_up

    # at .0588 and .06 m the dress slides off a shoulder while it is sewn; at .054, .0612 and .066 m it does not
    garment = tc.load_pattern(SCENES / "patterns" / f"{name}.json").mesh(0.066 if name == "dress" else 0.06)
    body = tc.Scene(air=tc.Air(0.5, 0.1))
    dress_up.figure(body, 0.4)
    fabric = tc.Fabric(0.19, tc.Stretch(400, 0.4), tc.Shear(50, 0.05), tc.Bend(2e-5, 2e-7))
    made = tc.dress(garment, fabric, body, tc.ClothContact(0.003, 0.4), longest=1.5, pull=dress_up.PULL)
    x, mesh, groups = made.garment.positions, made.garment.mesh, made.garment.mesh.groups
    assert made.rests and len(made.garment.seams) == seams and made.garment.gap() == 0
    assert made.intersections == count_self_crossings(x, mesh.faces) == 0
    inner = np.random.default_rng(1).dirichlet((1, 1, 1), 40)  # places in every triangle
    points = np.einsum("pk,fkd->pfd", inner, x[mesh.faces]).reshape(-1, 3)
    for solid in body.solids:
        assert nearest(solid.shape.a, solid.shape.b, points).min() > solid.shape.radius, solid.name
    for label, height in places.items():
        assert x[groups[label], 1].mean() == pytest.approx(height, abs=0.04), label
    if name == "dress":
        wide, gathered = (np.ptp(mesh.uv[np.intersect1d(groups[label], groups[panel]), 0])
                          for label, panel in (("waist", "bodice front"), ("gathered", "skirt front")))
        assert gathered == pytest.approx(0.62, abs=1e-9) and wide == pytest.approx(0.4, abs=1e-9)
    for end, limb in {"shirt": [("cuff", "arm")], "jacket": [("cuff", "arm")], "trousers": [("hem", "leg")]}.get(name, []):
        for side, sign in (("right", 1), ("left", -1)):
            ring = x[groups[end]][sign * x[groups[end], 0] > 0]
            shape = next(s for s in body.solids if s.name == f"{side} {limb}").shape
            assert nearest(shape.a, shape.b, ring.mean(axis=0)[None])[0] < 0.04  # it is round the limb


@pytest.mark.slow
def test_the_scene_takes_any_pattern_and_any_body(tmp_path):
    """`dress_up --set` with a pattern's and a mesh's file: the skirt hangs on that body, outside of it."""
    from scipy.spatial import ConvexHull

    k = np.arange(400) + 0.5  # places on an ellipsoid, a trunk without legs, evenly by a spiral
    up, turn = 1 - k / 200, np.pi * (1 + 5**0.5) * k
    unit = np.column_stack([np.sqrt(1 - up**2) * np.cos(turn), up, np.sqrt(1 - up**2) * np.sin(turn)])
    faces = ConvexHull(unit).simplices
    inward = np.linalg.det(unit[faces]) < 0
    faces[inward] = faces[inward][:, ::-1]
    x = unit * [0.15, 0.45, 0.11] + [0, 1.1, 0]
    (tmp_path / "body.obj").write_text("".join(f"v {a} {b} {c}\n" for a, b, c in x)
                                       + "".join(f"f {a} {b} {c}\n" for a, b, c in faces + 1))
    out = tmp_path / "out"
    options = {"pattern": SCENES / "patterns" / "skirt.json", "body": tmp_path / "body.obj", "spacing": 0.06}
    sets = [word for name, value in options.items() for word in ("--set", f"{name}={value}")]
    assert cli.main(["run", str(SCENES / "dress_up.py"), *sets, "--duration", "0.8", "--no-images", "--out", str(out)]) == 0
    run = tc.Recording(out)
    last = run.frame(run.frames()[-1])["x"]
    inside = (((last - [0, 1.1, 0]) / [0.15, 0.45, 0.11]) ** 2).sum(axis=1)
    assert run.geometry["solid_x"] == pytest.approx(x, abs=1e-6) and (last[:, 1] < 1.55).all()
    assert inside.min() > 0.95 and np.ptp(np.arctan2(last[:, 2], last[:, 0])) > 5.5
    assert count_crossings(last.astype(float), run.geometry["faces"], x, faces) == 0


def test_the_scene_turns_and_moves_a_pattern_as_dress_does():
    """A quarter from z towards x, and then aside."""
    build = scenefile.read(str(SCENES / "dress_up.py")).make
    x, there = (build({"spacing": "0.1", **more}).cloths[0].positions for more in ({}, {"turn": "90", "shift": "1,.2,-3"}))
    assert there == pytest.approx(np.column_stack([x[:, 2], x[:, 1], -x[:, 0]]) + [1, 0.2, -3], abs=1e-12)


@pytest.mark.slow
def test_the_scene_refuses_panels_inside_the_body_as_dress_does(tmp_path, capsys):
    """Moved back by 20 cm the skirt's front starts in the trunk: `run` says so before it writes anything, as tc.dress does."""
    made = scenefile.read(str(SCENES / "dress_up.py")).make({"spacing": "0.1", "shift": "0,0,-.2"})
    deep = np.max([s.shape.radius - nearest(s.shape.a, s.shape.b, made.cloths[0].positions) for s in made.solids], axis=0)
    out = tmp_path / "out"
    words = ["--set", "spacing=0.1", "--set", "shift=0,0,-.2", "--no-images", "--out", str(out)]
    assert cli.main(["run", str(SCENES / "dress_up.py"), *words]) == 2
    said = capsys.readouterr().err
    assert f"garment: {(deep > 0).sum()} vertices start inside the body, the first of them of 'front" in said
    assert f"at most {1e3 * deep.max():.3g} mm deep: fit a pattern" in said and deep.max() > 0
    assert "(--fit of `dress`, tc.fitted), hang" in said
    assert "turn and shift of `dress`" in said and not out.exists()
    body = tc.Scene()
    body.solids += made.solids
    with pytest.raises(tc.SceneError) as refused:
        tc.dress(made.hung[0][1], "denim", body)
    assert str(refused.value) in said
    fitted, _ = tc.fitted(made.hung[0][1], body, 0.003)
    with pytest.raises(tc.SceneError, match="deep: hang the panels") as refused:  # by hand, after it was fitted
        tc.dress(fitted.placed(0.0, (0, 0, -0.2)), "denim", body)
    assert "fit a pattern" not in str(refused.value)


@pytest.mark.slow
@pytest.mark.parametrize("spacing, vertices", [(0.0225, 1875), pytest.param(0.0110, 7551, marks=pytest.mark.slow)])
def test_seams_cost_few_iterations(spacing, vertices):
    """A shirt laid flat and sewn, against the same panels loose and a square of as many vertices: CG to 1e-4, a random
    right-hand side."""
    garment = tc.load_pattern(SCENES / "patterns" / "shirt.json").mesh(spacing)
    mesh, n = garment.mesh, round(garment.mesh.vertex_count**0.5)
    flat, count = np.insert(mesh.uv, 2, 0.0, axis=1), []
    square = tc.grid(n * spacing / 1.125, n - 1)  # its mean edge is the panels'
    for pieces, x, seams in ((mesh, flat, garment.seams), (mesh, flat, ()), (square, square.x, ())):
        scene = tc.Scene(gravity=None)
        cloth = scene.add_cloth(pieces, tc.Fabric(0.15, tc.Stretch(1000, 1), tc.Shear(100, 0.1), tc.Bend(1e-5, 1e-7)), x)
        for a, b, rest, *_ in seams:
            scene.sew(cloth, a, b, rest)
        with tc.Simulation(scene, h=1 / 60, integrator="backward_euler", preconditioner="multilevel") as sim:
            system = sim._linearized(1 / 60)
            write(system.operator.b, np.random.default_rng(5).normal(size=(sim.model.n, 3)))
            solution = system.solve(1e-4, sim.prescribed.at(0.0, 1 / 60), 1 / 60)
            assert solution.status == "CONVERGED"
            count.append(solution.iterations)
    assert abs(mesh.vertex_count - vertices) < 1 and count[0] < 0.7 * count[1] and count[0] < 1.1 * count[2], count


@pytest.mark.parametrize("spacing", [0.04, 0.02, 0.011])
def test_a_pattern_is_meshed(tmp_path, spacing):
    """Good triangles that fill the panels, rows of seams that fit, in the places that the file gives."""
    garment = read(tmp_path, skirt()).mesh(spacing)
    mesh, angles = garment.mesh, least_angles(garment.mesh)
    assert angles.min() > 20 and angles.mean() > 53
    front = mesh.material_areas[np.isin(mesh.faces[:, 0], mesh.groups["front"])].sum()
    outline = 0.5 * (0.60 + 0.44) * 0.50 - 0.5 * 0.04 * 0.12
    bulge = 2 / 3 * 0.5 * 0.1 * np.hypot(0.08, 0.50) ** 2  # of a quadratic curve, two thirds of its control triangle
    assert front == pytest.approx(outline + 2 * bulge, rel=6 * spacing**1)
    for (a, b, rest, *_), stitched in zip(garment.seams, (("front", "back"), ("front", "back"), ("front", "front"))):
        assert len(a) == len(b) and rest == 0.0
        assert np.isin(a, mesh.groups[stitched[0]]).all() and np.isin(b, mesh.groups[stitched[1]]).all()
        lengths = [np.linalg.norm(np.diff(mesh.uv[row], axis=0), axis=1) for row in (a, b)]
        assert all(np.ptp(part) < 0.02 * part.mean() for part in lengths)  # equal by arc length
        assert all(part.mean() < 1.001 * spacing * 1.1 for part in lengths)
    side, other, *_ = garment.seams[0]
    assert mesh.x[side[0], 1] == pytest.approx(0.9) and mesh.x[other[0], 1] == pytest.approx(0.9)  # hem to hem
    assert mesh.x[side[0], 0] == pytest.approx(0.30) and mesh.x[other[0], 0] == pytest.approx(0.30)
    assert mesh.x[side, 2] == pytest.approx(0.15) and mesh.x[other, 2] == pytest.approx(-0.15)
    dart = garment.seams[2]
    assert dart[0][-1] == dart[1][-1] and np.linalg.norm(mesh.uv[dart[0][0]] - mesh.uv[dart[1][0]]) == pytest.approx(0.04)
    hem = mesh.uv[mesh.groups["hem"]]
    assert np.abs(hem[:, 1]).max() < 1e-12 and len(hem) == 2 * (int(np.ceil(0.6 / spacing - 1e-6)) + 1)


def test_circles_bend_to_their_side():
    """Small and large arcs, left and right: through the point that geometry says."""
    corners = np.array([[0.0, 0.0], [2.0, 0.0]])
    for large in (False, True):
        for right in (False, True):
            curve = tc.Curve(0, 1, "circle", (1.25, large, right))
            middle = curve.points(corners, np.array([0.5]))[0]
            depth = 1.25 + 0.75 if large else 1.25 - 0.75
            assert middle == pytest.approx([1.0, -depth if right else depth])
            sweep = 2 * np.arcsin(0.8)
            assert curve.length(corners) == pytest.approx(1.25 * (2 * np.pi - sweep if large else sweep), rel=1e-4)
            assert np.ptp(np.linalg.norm(np.diff(curve.divided(corners, 9), axis=0), axis=1)) < 1e-3


def test_panels_turn_about_x_then_y_then_z(tmp_path):
    from scipy.spatial.transform import Rotation

    data = skirt()
    data["pattern"]["panels"]["back"]["rotation"] = [20, 50, -70]
    garment = read(tmp_path, data).mesh(0.05)
    index = garment.mesh.groups["back"]
    flat = np.insert(garment.mesh.uv[index], 2, 0.0, axis=1)
    turned = Rotation.from_euler("xyz", [20, 50, -70], degrees=True).apply(flat) + [0, 0.9, -0.15]
    assert np.abs(garment.mesh.x[index] - turned).max() < 1e-12


def test_a_bent_panel_is_turned_round_its_axis(tmp_path):
    at = []
    for turn in (0, 40):
        data = skirt()
        data["pattern"]["panels"]["back"].update(around=[[5, 90, -3], [5, 140, -3]], radius=12, turn=turn)
        garment = read(tmp_path, data).mesh(0.05)
        at.append(garment.mesh.x[garment.mesh.groups["back"]] - [0.05, 0, -0.03])
    c, s = np.cos(np.radians(40)), np.sin(np.radians(40))
    assert np.hypot(at[0][:, 0], at[0][:, 2]) == pytest.approx(0.12)
    assert at[1] == pytest.approx(at[0] @ np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]).T, abs=1e-12)


def test_stitches_that_run_together(tmp_path):
    data = skirt()
    data["pattern"]["stitches"][0].append("right_wrong")
    rows = read(tmp_path, data).mesh(0.04).seams
    other = read(tmp_path, skirt()).mesh(0.04).seams
    assert (rows[0][1] == other[0][1][::-1]).all() and (rows[1][1] == other[1][1]).all()


def test_what_a_seam_is_like_is_in_the_file_and_in_the_scene(tmp_path):
    data = skirt()
    data["pattern"]["stitches"][0] += ["right_wrong", {"rest": 30, "strength": 40}]
    data["pattern"]["stitches"][1].append({"stiffness": 3, "rest": "given"})
    garment = read(tmp_path, data).mesh(0.05)
    assert [s[2:] for s in garment.seams] == [(pytest.approx(np.pi / 6), 1.0, 40.0), ("given", 3.0, None), (0.0, 1.0, None)]
    scene = tc.Scene()
    scene.add_garment(garment, tc.Fabric(0.2), pull=7.0)
    assert [s.stiffness for s in scene.seams] == [1, 3, 1] and scene.seams[1].rest == "given"
    long = np.mean([np.linalg.norm(np.diff(garment.mesh.uv[row], axis=0), axis=1).sum() for row in garment.seams[0][:2]])
    assert scene.seams[0].bears.sum() == pytest.approx(40 * long) and np.isinf(scene.seams[1].bears).all()
    garment.save(tmp_path / "skirt.npz")
    assert [s[2:] for s in load_garment(tmp_path / "skirt.npz").seams] == [s[2:] for s in garment.seams]
    with np.load(tmp_path / "skirt.npz") as file:  # as it was before seams had these
        np.savez(tmp_path / "old.npz", **{name: file[name] for name in file.files if name not in ("stiffness", "strength")})
    assert [s[2:] for s in load_garment(tmp_path / "old.npz").seams] == [(s[2], 1.0, None) for s in garment.seams]


@pytest.mark.parametrize("like, what", [({"stiff": 1}, "unknown word of stitch 2 'stiff'; did you mean 'stiffness'"),
                                        ({"rest": 200}, "stitch 2: rest = 200"),
                                        ({"rest": "bent"}, "stitch 2: unknown .*rest 'bent'"),
                                        ({"stiffness": -1}, "stitch 2: .*stiffness = -1"),
                                        ({"strength": 0}, "stitch 2: .*strength = 0")])
def test_what_a_seam_cannot_be_like_is_named(tmp_path, like, what):
    data = skirt()
    data["pattern"]["stitches"][2].append(like)
    with pytest.raises(tc.SceneError, match=what):
        read(tmp_path, data)


@pytest.mark.parametrize("change, what", [
    (lambda p: p["stitches"].append([{"panel": "front", "edge": 1}, {"panel": "back", "edge": 0}]), "sewn twice"),
    (lambda p: p["stitches"].append([{"panel": "sleeve", "edge": 1}, {"panel": "back", "edge": 0}]), "no panel 'sleeve'"),
    (lambda p: p["stitches"].append([{"panel": "front", "edge": 9}, {"panel": "back", "edge": 0}]), "no edge 9"),
    (lambda p: (p["stitches"].append([{"panel": "front", "edge": 2}, {"panel": "back", "edge": 0}]),
                p["panels"]["back"]["vertices"][0].__setitem__(0, -40)), "0.2 m long.*0.7 m"),
    (lambda p: p["panels"]["back"]["edges"].pop(1), "edge 1 begins at corner 2"),
    (lambda p: p["panels"]["back"]["edges"][2]["curvature"].update(params=[3, 0, 1]), "does not reach"),
    (lambda p: p["panels"]["back"]["edges"][0].update(endpoints=[0, 7]), "corner 7"),
    (lambda p: p["panels"]["back"].pop("vertices"), "vertices"),
    (lambda p: p["panels"]["back"]["vertices"][0].__setitem__(0, float("nan")), "vertices of panel 'back'"),
    (lambda p: p.pop("panels"), "panels"),
    (lambda p: p["stitches"].append([{"panel": "front", "edge": 2}, {"panel": "front", "edge": 2}]),
     "stitch 3: sews edge 2 of panel 'front' to itself"),
    (lambda p: p["stitches"][2].append("right_wrong"), "edges 3 and 4 of panel 'front' share a corner"),
    (lambda p: p["panels"]["back"].update(vertices=[[-30, 0], [30, 0], [-20, 52], [20, 52]]),
     "panel 'back': edges 1 and 3 cross"),
    (lambda p: p["panels"]["front"]["edges"][0].update(curvature=[0.5, 1.4]), "panel 'front': edges 0 and [34] cross"),
    (lambda p: p["panels"]["front"]["edges"][0].update(curvature={"type": "cubic", "params": [[2, -1], [-1, -1]]}),
     "panel 'front': edge 0 crosses itself"),
    (lambda p: p["panels"]["front"]["vertices"][4].__setitem__(1, 0), "panel 'front': edges 0 and [34] cross or touch"),
    (lambda p: p["panels"]["back"].update(around=[[0, 90, 0], [0, 140, 0]]), "radius of panel 'back'"),
    (lambda p: p["panels"]["back"].update(around=[[0, 90, 0], [0, 140, 0]], radius=9),
     "'back' is 0.6 m wide, and the way round is 0.565 m"),
])
def test_what_is_wrong_with_a_pattern_is_named(tmp_path, change, what):
    data = skirt()
    change(data["pattern"])
    with pytest.raises(tc.SceneError, match=what):
        read(tmp_path, data)


@pytest.mark.parametrize("per_metre, what", [(1, "198 m .*centimetres taken for metres"), (10, "millimetres taken for cent"),
                                             (0.1, "millimetres taken for metres"), (1e4, "metres taken for cent"),
                                             (1e5, "metres taken for millimetres")])
def test_units_that_cannot_be_right(tmp_path, per_metre, what):
    data = skirt(units_in_meter=per_metre)
    data["pattern"]["panels"]["front"]["translation"][1] = 238  # as hung, 1.98 m from hem to waist
    with pytest.raises(tc.SceneError, match=what):
        read(tmp_path, data)


def test_units_and_files(tmp_path):
    with pytest.raises(tc.SceneError, match="positive"):
        read(tmp_path, skirt(units_in_meter=0))
    for name, text, what in (("a.json", "{", "not JSON"), ("b.json", "[]", "not a pattern"), ("c.txt", "", ".json")):
        (tmp_path / name).write_text(text)
        with pytest.raises(tc.SceneError, match=what):
            tc.load_pattern(tmp_path / name)
    with pytest.raises(tc.SceneError, match="cannot be read"):
        tc.load_pattern(tmp_path / "missing.json")


def test_spacings_that_no_panel_has_triangles_of_are_refused():
    """So wide that a border of two edges has two points; so narrow that no memory holds them."""
    edges = tc.Curve(0, 1), tc.Curve(1, 0, "quadratic", ((0.5, 0.3),))
    pattern = tc.Pattern((tc.Panel("lens", [[0, 0], [0.4, 0.0]], edges),))
    with pytest.raises(tc.MeshError, match="'lens': its border of 2 points has no area: take a smaller spacing"):
        pattern.mesh(10.0)
    for tiny in (1e-6, 1e-30):
        with pytest.raises(tc.MeshError, match=f"spacing = {tiny:g} m makes about .* vertices"):
            pattern.mesh(tiny)
    with pytest.raises(tc.MeshError, match="spacing = 1e-06 m makes"):
        tc.remesh(pattern.mesh(0.05), 1e-6)
    with pytest.raises(tc.SceneError, match="wrap: the part of the body has no points"):
        pattern.wrap("lens", np.zeros((0, 3)))


def test_a_line_that_crosses_itself_is_refused():
    with pytest.raises(tc.MeshError, match="'bow': its border crosses itself"):
        mesh_polygon(np.array([[0.0, 0], [1, 1], [1, 0], [0, 1]]), 0.1, "bow")


def test_a_garment_in_a_file(tmp_path):
    garment = read(tmp_path, skirt()).mesh(0.05)
    garment = replace(garment, positions=garment.positions + [0.1, 0, 0.3])
    path = tmp_path / "skirt.npz"
    garment.save(path)
    again = load_garment(path)
    assert (again.mesh.x == garment.mesh.x).all() and (again.mesh.faces == garment.mesh.faces).all()
    assert (again.positions == garment.positions).all() and again.gap() == garment.gap() > 0.2
    assert all((p[0] == q[0]).all() and (p[1] == q[1]).all() and p[2] == q[2] for p, q in zip(again.seams, garment.seams))
    assert set(again.mesh.groups) == set(garment.mesh.groups)
    data = path.read_bytes()
    for damaged in (data[:-40], b"", data[:30] + b"\0\0\0\0" + data[34:]):
        path.write_bytes(damaged)
        with pytest.raises(tc.SceneError, match="skirt.npz"):
            load_garment(path)
    with pytest.raises(tc.SceneError, match="cannot be written"):
        garment.save(tmp_path / "no" / "where.npz")


def test_measured_fabrics_have_a_source():
    assert len(tc.fabrics) == 12
    for name, fabric in tc.fabrics.items():
        assert isinstance(fabric, tc.Fabric) and fabric.source and name.isidentifier()
        assert 0.05 < fabric.density < 0.6 and fabric.stretch.k_d == fabric.bend.k_d == 0
        assert 3e-6 < min(fabric.bend.D) and max(fabric.bend.D) < 1e-4 and fabric.shear.k < min(fabric.stretch.k) * 1.2


def test_measured_fabrics_are_as_published(shared):
    """Against the tables' numbers in reference data: rounded, never more than one in the last digit that is given."""
    names = {"interlock": "wang_gray_interlock", "rib_knit": "wang_ivory_rib_knit", "ponte": "wang_camel_ponte_roma",
             "swimwear": "wang_white_swim_solid", "jacket_polyester": "wang_tango_red_jet_set",
             "trousers": "wang_royal_target", "tablecloth": "wang_white_dots_on_blk", "denim": "wang_denim_11oz",
             "shirting": "clyde_cotton_shirting", "charmeuse": "clyde_silk_charmeuse",
             "canvas": "clyde_canvas", "wool_coating": "clyde_wool_coating"}
    table = {m["name"]: m for m in json.loads((shared / "validation" / "materials.json").read_text())["materials"]}
    assert set(names) == set(tc.fabrics)
    for name, fabric in tc.fabrics.items():
        row = table[names[name]]
        pairs = [(fabric.density, row["density"], 5e-4), (fabric.stretch.k[0], row["k_stretch_warp"], 0.5),
                 (fabric.stretch.k[1], row["k_stretch_weft"], 0.5), (fabric.shear.k, row["k_shear"], 0.5)]
        if "D_warp" in row:
            pairs += [(1e6 * fabric.bend.D[0], 1e6 * row["D_warp"], 0.5), (1e6 * fabric.bend.D[1], 1e6 * row["D_weft"], 0.5)]
        pairs += [(fabric.thickness, row["thickness"], 1e-9)] if fabric.thickness else []
        for mine, which in zip(fabric.far or (), ("warp", "weft")):
            pairs.append((mine, row[f"k_stretch_{which}_17pct"], 0.5))
        assert all(mine == pytest.approx(theirs, abs=digit) for mine, theirs, digit in pairs), (name, pairs)
    for name, bend in tc.bends.items():
        row = table[name.replace("denim_", "denim_kes_").replace("kes_" + name[-1], "kes_" + name[-1].upper())]
        assert bend.D == pytest.approx(row["D"], rel=1e-3)
        assert 2 * bend.friction == pytest.approx(row["bending_hysteresis_2HB_N"], rel=1e-3)


def test_a_fabric_that_is_not_there_is_answered_with_the_nearest():
    for table, wrong, right in ((tc.fabrics, "denimm", "denim"), (tc.bends, "denim_g", "denim_")):
        with pytest.raises(tc.SceneError, match=f"^unknown [a-z]+ '{wrong}'; did you mean '{right}") as found:
            table[wrong]
        assert isinstance(found.value, KeyError) and table.get(wrong) is None and wrong not in table


def test_measured_loops_of_bending_have_a_source():
    """HB over D [1/m]: faille 18, wool 25, broadcloth and denims 23 to 54."""
    ratio = {name: bend.friction / bend.D for name, bend in tc.bends.items()}
    assert ratio["polyester_faille"] == pytest.approx(18, abs=0.6) and ratio["wool_tropical"] == pytest.approx(25, abs=0.6)
    assert len(ratio) == 9 and 18 < min(ratio.values()) < max(ratio.values()) < 54.5
    assert all(isinstance(b, tc.Bend) and b.source and b.yield_ is None for b in tc.bends.values())
    assert tc.Fabric(0.12, bend=tc.bends["wool_tropical"]).bend.D == pytest.approx(6.57e-6)


@pytest.mark.parametrize("crossed, part", [([10], True), ([10, 10, 10, 10], True), ([10, 10, 10, 10, 10], False),
                                           ([10, 10, 8, 8, 8, 8], True), ([10, 10, 8, 8, 8, 8, 8], False), ([10, 0], False),
                                           ([0], False), ([10, 9, 8, 9, 9, 9, 7], True)])
def test_a_garment_settles_as_long_as_crossings_become_fewer(crossed, part):
    assert dressing._part(crossed) == part


@pytest.mark.slow
def test_dressing(tmp_path):
    """The skirt is sewn round a cylinder and hangs on it; panels that start inside the body are refused."""
    garment = read(tmp_path, skirt()).mesh(0.05)
    weak = garment.seams[0]._replace(strength=0.05)  # N/m: it would rip at once
    garment = replace(garment, seams=(weak, *garment.seams[1:]))
    fabric = tc.Fabric(0.2, tc.Stretch(300, 0.3), tc.Shear(40, 0.04), tc.Bend(1e-5, 1e-7))

    def body(radius: float, low: float = 0.4) -> tc.Scene:
        scene = tc.Scene()
        scene.add_solid(tc.Capsule((0, low, 0), (0, 1.6, 0), radius), friction=0.8, thickness=0.004, name="trunk")
        return scene

    with pytest.raises(tc.SceneError, match="without solids"):
        tc.dress(garment, fabric, tc.Scene())
    made = tc.dress(garment, fabric, body(0.125), contact=tc.ClothContact(0.003, 0.3), longest=0.6)
    assert made.garment.seams[0].strength == 0.05
    assert made.garment.gap() == 0 and 0.2 < made.sewn < 1.3 and made.intersections == 0 and "seams closed" in made.report()
    assert np.hypot(*made.garment.positions[:, [0, 2]].T).min() > 0.125
    with pytest.raises(tc.SceneError, match="'(front|back)' in 'trunk', at most [0-9.]+ mm deep"):
        tc.dress(garment, fabric, body(0.17))
    by = (garment.positions - made.garment.positions)[:, 1].mean()
    assert by > np.ptp(garment.positions[:, 1]) / 3, "a cylinder has no hips"
    assert made.notes == (f"the garment fell by {by:.2f} m: nothing holds it up there",)
    with pytest.raises(tc.SceneError, match="fell: is the body too small"):
        tc.dress(garment, fabric, body(0.03, 1.3))


def tube(radius: float, low: float, high: float, around: int = 24) -> tuple[np.ndarray, np.ndarray]:
    """A closed tube along y: (vertices, triangles)."""
    angle = np.arange(around) * 2 * np.pi / around
    ring = np.column_stack([radius * np.sin(angle), np.zeros(around), radius * np.cos(angle)])
    x = np.concatenate([ring + [0, low, 0], ring + [0, high, 0], [[0, low, 0], [0, high, 0]]])
    i, j = np.arange(around), (np.arange(around) + 1) % around
    low_end, high_end = np.full(around, 2 * around), np.full(around, 2 * around + 1)
    faces = [(i, j, j + around), (i, j + around, i + around), (j, i, low_end), (i + around, j + around, high_end)]
    return x, np.concatenate([np.column_stack(f) for f in faces])


def test_a_body_through_a_panel_between_its_vertices_is_refused(tmp_path):
    """A needle through the middle of a triangle."""
    garment = read(tmp_path, skirt()).mesh(0.05)
    at = garment.mesh.x[garment.mesh.faces[20]].mean(axis=0)
    x, faces = tube(0.002, -0.05, 0.05)
    body = tc.Scene()
    body.add_solid(tc.SolidMesh(x[:, [2, 0, 1]], faces), position=at, friction=0.3, thickness=1e-4, name="needle")
    with pytest.raises(tc.SceneError, match="garment: panels pass through 'needle', in [0-9]+ pairs .* further out"):
        tc.dress(garment, tc.Fabric(0.2, tc.Stretch(300)), body)


@pytest.mark.parametrize("name, words", [
    ("folder.npz", "must be a .npz in a folder"), ("no/a.npz", "must be a .npz in a folder"), ("a.obj", "must be a .npz"),
    ("a" * 250 + ".npz", "cannot be written: "), ("a.npz", "No such file")])
def test_a_garment_that_cannot_be_written_is_said_before_anything_is_read(tmp_path, capsys, name, words):
    (tmp_path / "folder.npz").mkdir()
    assert cli.main(["dress", "no.json", "--body", "nobody.obj", "--out", str(tmp_path / name)]) == 2
    said = capsys.readouterr().err
    assert words in said and (name in said) == (name != "a.npz") and len(list(tmp_path.iterdir())) == 1


@pytest.mark.slow
def test_the_command_dresses(tmp_path, capsys):
    """A skirt on a body that its file has in centimetres; without their scale the body is refused by its size."""
    pattern, body, out = tmp_path / "skirt.json", tmp_path / "body.npz", tmp_path / "worn.npz"
    pattern.write_text(json.dumps(skirt()))
    x, faces = tube(12.5, 30, 170)
    np.savez(body, positions=x, faces=faces)
    command = ["dress", str(pattern), "--body", str(body), "--out", str(out), "--spacing", "0.06", "--longest", "0.3",
               "--friction", "0.8"]
    assert cli.main(command) == 2
    said = capsys.readouterr().err
    assert "note: body: size = 140 m looks like another unit" in said and "UserWarning" not in said and not out.exists()
    assert cli.main([*command, "--scale", "0.01"]) == 0
    said, made = capsys.readouterr().out, load_garment(out)
    assert "3 seams" in said and "seams closed after" in said and f"written to {out}" in said
    x, mesh = made.positions, made.mesh
    assert made.gap() == 0 and np.hypot(x[:, 0], x[:, 2]).min() > 0.124 and count_self_crossings(x, mesh.faces) == 0
    assert 0.7 < x[mesh.groups["hem"], 1].mean() < 0.95 and x[mesh.groups["waist"], 1].mean() > 1.25
    for change, what in (({"--fabric": "velvet"}, "velvet"), ({"--out": str(tmp_path / "no" / "a.npz")}, "a.npz"),
                         ({"--body": "nobody.obj"}, "nobody.obj"), ({"--over": "nothing.npz"}, "nothing.npz"),
                         ({"--over": str(out)}, "two garments are named 'worn'"),
                         ({"--over-fabric": "velvet"}, "--over-fabric")):
        other = [part for flag, value in change.items() for part in (flag, value)]
        assert cli.main([*command, "--scale", "0.01", *other]) == 2 and what in capsys.readouterr().err
    assert load_garment(out).positions == pytest.approx(x)  # what was there stays
    pattern.write_text(json.dumps(skirt(units_in_meter=95)))
    coat, under = tmp_path / "coat.npz", tmp_path / "coat-over-worn.npz"
    assert cli.main([*command[:5], str(coat), *command[6:], "--scale", "0.01", "--over", str(out)]) == 0
    said = capsys.readouterr()
    assert "further out, over worn garments" in said.err and f"written to {under}, {coat}" in said.out
    (inner, outer), y = (load_garment(file) for file in (under, coat)), x
    assert count_crossings(inner.positions, inner.mesh.faces, outer.positions, outer.mesh.faces) == 0
    assert inner.gap() == outer.gap() == 0 and (load_garment(out).positions == y).all()


def test_an_edge_through_points_is_as_long_as_they_are():
    """And it is divided along them, crossings of its pieces are refused, and the warp is along the grain."""
    corners = np.array([[0, 0], [0.3, 0], [0.3, 0.2], [0, 0.2]])
    lines = [tc.Curve(k, (k + 1) % 4) for k in range(4)]
    stairs = tc.Curve(0, 1, "polyline", ((0.5, 0.0), (0.5, -1 / 6), (1.0, -1 / 6)))  # .15 m on, .05 m out, and again
    panel = tc.Panel("a", corners, (stairs, *lines[1:]), grain=np.pi / 2)
    assert stairs.length(corners) == pytest.approx(0.4, abs=1e-15)
    want = np.array([[0, 0], [0.1, 0], [0.15, -0.05], [0.25, -0.05], [0.3, 0]])
    assert np.abs(stairs.divided(corners, 4) - want).max() < 1e-15
    assert np.abs(panel.outline()[0][:4] - [[0, 0], [0.15, 0], [0.15, -0.05], [0.3, -0.05]]).max() < 1e-15
    mesh = tc.Pattern((panel,)).mesh(0.05).mesh
    assert mesh.uv == pytest.approx(mesh.x[:, [1, 0]] * [1, -1], abs=1e-15)
    with pytest.raises(tc.SceneError, match="panel 'a': edges 0 and 2 cross"):
        tc.Panel("a", corners, (replace(stairs, parameters=((0.4, 0.9), (0.6, 0.9))), *lines[1:]))
