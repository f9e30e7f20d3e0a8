"""Exports of whole scenes, read afresh: USD, glTF, what Blender is told, and cloth whose faces change."""

import json
import re
import signal
import struct
import sys

import numpy as np
import pytest
from test_export import CAMERA, COLORS, FACES, FIRST, FPS, NAMES, SEWN, SOLID_FACES, face_normals, make, read_obj

import taichi_cloth as tc
from taichi_cloth.errors import OutputError
from taichi_cloth.output.export import blend, export
from taichi_cloth.output.export.pieces import Cut
from taichi_cloth.output.export.shot import shot


@pytest.fixture
def made(tmp_path, rng):
    return make(tmp_path / "run", rng)


# One more triangle from frame 4 on: vertex 6, torn, is there twice.
TORN = {"faces": np.concatenate([FACES[:4], [[9, 7, 8]]]).astype(np.int32), "cloth_start": np.array([0, 4, 10]),
        "cloth_faces": np.array([0, 2, 5])}


@pytest.fixture
def torn(tmp_path, rng):
    uv = rng.random((5, 3, 2)).astype(np.float32)
    own = TORN | {"uv": np.concatenate([uv[:4], uv[:1]])}
    own |= {name: rng.normal(size=(10, 3)).astype(np.float32) for name in ("x", "v", "contact")}
    return make(tmp_path / "torn", rng, own={FIRST + 2: own}, uv=uv)


def samples(text, name):
    """Rows of numbers by time code of an attribute's time samples, in every mesh of a .usda file that has them."""
    out = []
    for block in re.findall(rf" {name}\.timeSamples = {{\n(.*?)\n        }}", text, re.DOTALL):
        rows = re.findall(r"(\d+): \[(.*)\],", block)
        out.append({int(k): np.array(re.findall(r"[-\d.e+]+", row), dtype=np.float32).reshape(-1, 3) for k, row in rows})
    return out


def test_usda_as_text(made, tmp_path):
    text = export(made.recording, "usda", tmp_path / "o")[0].read_text()
    for part, (first, last) in enumerate(((0, 4), (4, 9))):
        for k, frame in enumerate(made.frames, FIRST):
            assert (samples(text, "points")[part][k] == frame["x"][first:last]).all()
            assert (samples(text, "velocities")[part][k] == frame["v"][first:last]).all()
            extent = samples(text, "extent")[part][k]
            assert (extent[0] == frame["x"][first:last].min(axis=0)).all()
            assert (extent[1] == frame["x"][first:last].max(axis=0)).all()
        assert list(samples(text, "points")[part]) == [FIRST, FIRST + 1, FIRST + 2]
    assert len(samples(text, "points")) == 3 and len(samples(text, "velocities")) == 2  # the tetrahedron moves too
    index = [[int(i) for i in row.split(",")] for row in re.findall(r"faceVertexIndices = \[(.*?)\]", text)]
    assert index[:2] == [FACES[:2].ravel().tolist(), (FACES[2:] - 4).ravel().tolist()] and len(index) == 5
    assert [row.count("3") for row in re.findall(r"faceVertexCounts = \[(.*?)\]", text)] == [2, 3, 4, 2, 2]
    st = [np.array(re.findall(r"[-\d.e+]+", row), dtype=np.float32) for row in re.findall(r"primvars:st = \[(.*?)\] \(", text)]
    assert (np.concatenate(st).reshape(5, 3, 2) == made.geometry["uv"]).all() and 'interpolation = "faceVarying"' in text
    for line in ("metersPerUnit = 1", 'upAxis = "Y"', f"startTimeCode = {FIRST}", f"endTimeCode = {FIRST + 2}",
                 f"timeCodesPerSecond = {FPS}", 'subdivisionScheme = "none"', "doubleSided = 1"):
        assert line in text
    names = re.findall(r'def Mesh "(.*?)"', text)
    assert all(re.fullmatch(r"[A-Za-z_]\w*", name) for name in names) and len(set(names)) == 5


@pytest.mark.parametrize("parts, takes, cuts", [
    ("panels", ([0, 1, 2, 3], [4, 5, 6, 7], [6, 7, 8]), (0, 2, 4, 5)), ("welded", ([0, 1, 2, 3], [1, 3, 4, 7, 8]), (0, 2, 5))])
def test_usda_of_a_garment(tmp_path, rng, parts, takes, cuts):
    """A mesh a panel, or welded over the seams: points, triangles, and the pattern as st at each of their corners."""
    made = make(tmp_path / "run", rng, **SEWN)
    text = export(made.recording, "usda", tmp_path / "o", parts)[0].read_text()
    index = [np.array(row.split(","), dtype=int).reshape(-1, 3) for row in re.findall(r"faceVertexIndices = \[(.*?)\]", text)]
    st = [np.array(re.findall(r"[-\d.e+]+", row), dtype=np.float32).reshape(-1, 3, 2)
          for row in re.findall(r"primvars:st = \[(.*?)\] \(", text)]
    mine = SEWN["sewn"][FACES] if parts == "welded" else FACES
    assert len(st) == len(takes)
    for k, (take, first, last) in enumerate(zip(takes, cuts, cuts[1:])):
        assert (np.array(take)[index[k]] == mine[first:last]).all() and (st[k] == made.geometry["uv"][first:last]).all()
        for row, frame in zip(samples(text, "points")[k].values(), made.frames):
            assert (row == frame["x"][take]).all()


def stages(made, folder):
    """The stages of a .usda and of a .usdc, opened by usd-core."""
    Usd = pytest.importorskip("pxr.Usd", reason="usd-core is not installed")
    return [Usd.Stage.Open(str(export(made.recording, f, folder / f"x.{f}")[0])) for f in ("usda", "usdc")]


def test_usd_by_its_own_library(made, tmp_path):
    text, crate = stages(made, tmp_path)
    from pxr import UsdGeom, UsdShade

    assert text.GetRootLayer().ExportToString() == crate.GetRootLayer().ExportToString()
    assert crate.GetTimeCodesPerSecond() == FPS and UsdGeom.GetStageUpAxis(crate) == "Y"
    assert UsdGeom.GetStageMetersPerUnit(crate) == 1 and crate.GetDefaultPrim().GetName() == "scene"
    meshes = [UsdGeom.Mesh(p) for p in crate.Traverse() if p.IsA(UsdGeom.Mesh)]
    assert [m.GetPrim().GetDisplayName() for m in meshes] == [NAMES[0].replace("\n", " "), NAMES[1], "tetrahedron", "sheet",
                                                              "ground"]
    for k, frame in enumerate(made.frames, FIRST):
        assert (np.concatenate([m.GetPointsAttr().Get(k) for m in meshes[:2]]) == frame["x"]).all()
        assert (np.concatenate([m.GetPointsAttr().Get(k) for m in meshes[2:4]]) == frame["solid_x"]).all()
        assert (np.concatenate([m.GetVelocitiesAttr().Get(k) for m in meshes[:2]]) == frame["v"]).all()
        area = np.zeros((4, 3))
        x = frame["x"].astype(np.float64)
        for face in FACES[:2]:
            area[face] += np.cross(x[face[1]] - x[face[0]], x[face[2]] - x[face[0]])
        assert np.array(meshes[0].GetNormalsAttr().Get(k)) == pytest.approx(
            area / np.linalg.norm(area, axis=1, keepdims=True), abs=1e-6)
        flat = np.repeat(face_normals(frame["solid_x"].astype(np.float64), SOLID_FACES[:4]), 3, axis=0)
        assert np.array(meshes[2].GetNormalsAttr().Get(k)) == pytest.approx(flat, abs=1e-6)
    assert [m.GetNormalsInterpolation() for m in meshes[:3]] == ["vertex", "vertex", "faceVarying"]
    for mesh, color in ((meshes[0], COLORS[0]), (meshes[2], made.geometry["solid_colors"][0])):
        assert np.array(mesh.GetDisplayColorAttr().Get()) == pytest.approx(color[None], abs=1e-7)
        material = UsdShade.MaterialBindingAPI(mesh).ComputeBoundMaterial()[0]
        shader = material.ComputeSurfaceSource()[0]
        assert shader.GetIdAttr().Get() == "UsdPreviewSurface"
        assert np.array(shader.GetInput("diffuseColor").Get()) == pytest.approx(color, abs=1e-7)


def test_usd_has_the_scenes_camera(made, tmp_path):
    """Seen by USD's own camera: the target in the middle, the opening angle, up."""
    _, stage = stages(made, tmp_path)
    from pxr import UsdGeom

    camera = UsdGeom.Camera(stage.GetPrimAtPath("/scene/camera")).GetCamera(FIRST)
    assert camera.GetFieldOfView(camera.FOVVertical) == pytest.approx(CAMERA[6], abs=1e-3)
    look = np.array(camera.frustum.ComputeViewMatrix())
    seen = np.array([*CAMERA[3:6], 1]) @ look
    assert seen[:2] == pytest.approx(0, abs=1e-6) and seen[2] == pytest.approx(-np.linalg.norm(CAMERA[:3] - CAMERA[3:6]))
    assert np.array([0, 1, 0, 0]) @ look @ [1, 0, 0, 0] == pytest.approx(0, abs=1e-6) and look[1, 1] > 0
    near, far = camera.clippingRange.min, camera.clippingRange.max
    everything = np.concatenate([f[key] for f in made.frames for key in ("x", "solid_x")])
    distance = np.linalg.norm(everything - CAMERA[:3], axis=1)
    assert near < distance.min() and distance.max() < far


def test_a_fitted_camera_sees_all_of_the_motion(tmp_path, rng):
    made = make(tmp_path / "run", rng, frames=6, camera=np.full(10, np.nan), ground=np.array(np.nan))
    _, stage = stages(made, tmp_path)
    from pxr import UsdGeom

    camera = UsdGeom.Camera(stage.GetPrimAtPath("/scene/camera")).GetCamera(FIRST)
    matrix = np.array(camera.frustum.ComputeViewMatrix()) @ np.array(camera.frustum.ComputeProjectionMatrix())
    for frame in made.frames:
        x = np.concatenate([frame["x"], frame["solid_x"]])
        seen = np.column_stack([x, np.ones(len(x))]) @ matrix
        assert (np.abs(seen[:, :2] / seen[:, 3:]) < 1).all() and (seen[:, 3] > 0).all()
    assert not stage.GetPrimAtPath("/scene/ground")


def test_a_camera_that_moves_does_so_by_frames(tmp_path, rng):
    other = np.array([-3.0, 1.0, 4.0, 0.0, 0.5, 0.0, 60.0, 0.0, 1.0, 0.0])
    keys = np.array([[FIRST / FPS, *CAMERA], [(FIRST + 2) / FPS, *other]])
    made = make(tmp_path / "run", rng, camera_keys=keys)
    _, stage = stages(made, tmp_path)
    from pxr import UsdGeom

    half = (CAMERA + other) / 2  # between two keys, a cubic with the slope of their chord is the chord
    for k, want in ((FIRST, CAMERA), (FIRST + 1, half), (FIRST + 2, other)):
        camera = UsdGeom.Camera(stage.GetPrimAtPath("/scene/camera")).GetCamera(k)
        assert camera.GetFieldOfView(camera.FOVVertical) == pytest.approx(want[6], abs=1e-3)
        assert np.array(camera.frustum.position) == pytest.approx(want[:3], abs=1e-6)
    file = Gltf(export(made.recording, "glb", tmp_path / "x.glb")[0])
    node = next(k for k, n in enumerate(file.json["nodes"]) if "camera" in n)
    paths = {c["target"]["path"]: file.array(file.json["animations"][0]["samplers"][c["sampler"]]["output"])
             for c in file.json["animations"][0]["channels"] if c["target"]["node"] == node}
    assert paths["translation"] == pytest.approx(np.array([CAMERA[:3], half[:3], other[:3]])) and len(paths["rotation"]) == 3
    assert blend.arrays(shot(Cut(made.recording, "cloths")))["eye"] == pytest.approx(
        np.array([e[[0, 2, 1]] * [1, -1, 1] for e in (CAMERA, half, other)]))


def problems(path):
    """What usd-core's validators find wrong in a file, in words."""
    Usd = pytest.importorskip("pxr.Usd", reason="usd-core is not installed")
    try:
        from pxr import UsdValidation
    except ImportError:  # before 2025
        from pxr import UsdUtils

        checker = UsdUtils.ComplianceChecker()
        checker.CheckCompliance(str(path))
        return checker.GetErrors() + checker.GetFailedChecks() + checker.GetWarnings()
    validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    assert len(validators) > 10
    found = UsdValidation.ValidationContext(validators).Validate(Usd.Stage.Open(str(path)))
    return [f"{error.GetName()}: {error.GetMessage()}" for error in found]


@pytest.mark.parametrize("case", ["steady", "torn"])
@pytest.mark.parametrize("format", ["usda", "usdc"])
def test_usd_passes_its_validators(format, case, request, tmp_path):
    made = request.getfixturevalue("made" if case == "steady" else "torn")
    file = export(made.recording, format, tmp_path / "o")[0]
    assert problems(file) == []
    if format == "usda":  # and they do look
        text = file.read_text()
        for old, new in (("    metersPerUnit = 1\n", ""), ('        prepend apiSchemas = ["MaterialBindingAPI"]\n', ""),
                         ('defaultPrim = "scene"', 'defaultPrim = "nothing"')):
            assert old in text
            file.write_text(text.replace(old, new))
            assert problems(file), old


def test_usd_of_cloth_that_tears_changes_its_faces(torn, tmp_path):
    text, crate = stages(torn, tmp_path)
    from pxr import UsdGeom

    assert text.GetRootLayer().ExportToString() == crate.GetRootLayer().ExportToString()
    skirt = UsdGeom.Mesh([p for p in crate.Traverse() if p.IsA(UsdGeom.Mesh)][1])
    uv = UsdGeom.PrimvarsAPI(skirt).GetPrimvar("st")
    for k, frame in enumerate(torn.frames, FIRST):
        faces = frame.get("faces", FACES)[2:] - 4
        assert (np.array(skirt.GetFaceVertexIndicesAttr().Get(k)) == faces.ravel()).all()
        assert (np.array(skirt.GetPointsAttr().Get(k)) == frame["x"][4:]).all()
        assert len(skirt.GetNormalsAttr().Get(k)) == len(frame["x"]) - 4
        assert (np.array(uv.Get(k)) == frame.get("uv", torn.geometry["uv"])[2:].reshape(-1, 2)).all()


def test_cloth_that_tears_goes_into_what_has_faces_by_frame(torn, tmp_path):
    import meshio

    _, *files = export(torn.recording, "obj", tmp_path / "obj")
    for file, frame in zip(files, torn.frames):
        skirt = read_obj(file)["4_skirts"]
        assert (skirt.faces == frame.get("faces", FACES)[2:] - 4).all() and (skirt.x == frame["x"][4:]).all()
        assert (skirt.uv == frame.get("uv", torn.geometry["uv"])[2:]).all()
    for format in ("ply", "vtu"):
        files = [f for f in export(torn.recording, format, tmp_path / format) if f.suffix != ".pvd"]
        for file, frame in zip(files, torn.frames):
            mesh = meshio.read(file)
            assert (mesh.points == frame["x"]).all() and (mesh.cells_dict["triangle"] == frame.get("faces", FACES)).all()
            assert len(mesh.point_data["stretch"]) == len(frame["x"])


@pytest.mark.parametrize("format", ["pc2", "glb", "gltf", "blend", "abc"])
def test_other_formats_refuse_cloth_that_tears(torn, tmp_path, monkeypatch, format):
    monkeypatch.setattr(blend, "command", lambda format: ["false"])
    with pytest.raises(OutputError, match=rf"faces of '4 skirts' change .* {format} has one set"):
        export(torn.recording, format, tmp_path / "o")
    assert not (tmp_path / "o").exists()


class Gltf:
    """A .glb, or a .gltf with its buffer, read by the standard's own words."""

    def __init__(self, path):
        data = path.read_bytes()
        if path.suffix == ".gltf":
            self.json = json.loads(data)
            self.bin = (path.parent / self.json["buffers"][0]["uri"]).read_bytes()
        else:
            assert struct.unpack("<4sII", data[:12]) == (b"glTF", 2, len(data))
            length, kind = struct.unpack("<I4s", data[12:20])
            assert kind == b"JSON" and length % 4 == 0
            self.json = json.loads(data[20: 20 + length])
            size, kind = struct.unpack("<I4s", data[20 + length: 28 + length])
            assert kind == b"BIN\0" and size % 4 == 0 and 28 + length + size == len(data)
            self.bin = data[28 + length:]
        assert len(self.bin) == self.json["buffers"][0]["byteLength"]

    def array(self, number):
        """An accessor's values."""
        accessor = self.json["accessors"][number]
        view = self.json["bufferViews"][accessor["bufferView"]]
        width = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}[accessor["type"]]
        kind = {5126: "<f4", 5125: "<u4"}[accessor["componentType"]]
        out = np.frombuffer(self.bin, kind, accessor["count"] * width, view["byteOffset"]).reshape(-1, width)
        assert view["byteLength"] == out.nbytes
        for name, value in (("min", out.min(axis=0)), ("max", out.max(axis=0))):
            assert name not in accessor or accessor[name] == value.tolist()
        return out

    def at(self, mesh, seconds):
        """Positions and normals (m, 3, 3) of a mesh's triangles, blended as its animation says, and uv or None."""
        part = self.json["meshes"][mesh]["primitives"][0]
        x, n = (self.array(part["attributes"][name]).astype(np.float64) for name in ("POSITION", "NORMAL"))
        rows = self.array(part["indices"]).reshape(-1, 3)
        node = next(k for k, node in enumerate(self.json["nodes"]) if node.get("mesh") == mesh)
        animation = self.json["animations"][0]
        for channel in animation["channels"]:
            if channel["target"] == {"node": node, "path": "weights"}:
                sampler = animation["samplers"][channel["sampler"]]
                assert sampler["interpolation"] == "LINEAR"
                times = self.array(sampler["input"])[:, 0]
                weights = self.array(sampler["output"]).reshape(len(times), -1)
                for weight, target in zip(weights.T, part["targets"]):
                    share = np.interp(seconds, times, weight)
                    x, n = x + share * self.array(target["POSITION"]), n + share * self.array(target["NORMAL"])
        uv = self.array(part["attributes"]["TEXCOORD_0"])[rows] if "TEXCOORD_0" in part["attributes"] else None
        return x[rows], n[rows], uv


@pytest.mark.parametrize("format", ["glb", "gltf"])
def test_gltf(made, tmp_path, format):
    file = Gltf(export(made.recording, format, tmp_path / "o")[0])
    assert [m["name"] for m in file.json["meshes"]] == [*NAMES, "tetrahedron", "sheet", "ground"]
    cloths = ((0, FACES[:2], "x"), (1, FACES[2:], "x"), (2, SOLID_FACES[:4], "solid_x"), (3, SOLID_FACES[4:], "solid_x"))
    for mesh, faces, key in cloths:
        for k, frame in enumerate(made.frames):
            x, normals, uv = file.at(mesh, k / FPS)
            assert np.abs(x - frame[key][faces]).max() <= 1e-7 * np.abs(frame[key]).max() * 2
            if mesh == 2:
                assert normals[:, 0] == pytest.approx(face_normals(frame[key].astype(np.float64), faces), abs=1e-6)
            if key == "x":
                flipped = uv * [1, -1] + [0, 1]  # v runs down there
                assert flipped == pytest.approx(made.geometry["uv"][:2] if mesh == 0 else made.geometry["uv"][2:], abs=1e-7)
        half, _, _ = file.at(mesh, 0.5 / FPS)
        assert half == pytest.approx((made.frames[0][key][faces] + made.frames[1][key][faces]) / 2, abs=1e-6)
        color = file.json["materials"][file.json["meshes"][mesh]["primitives"][0]["material"]]["pbrMetallicRoughness"]
        expected = {0: COLORS[0], 2: made.geometry["solid_colors"][0]}.get(mesh)
        assert expected is None or color["baseColorFactor"] == pytest.approx([*expected, 1.0])
    node = next(n for n in file.json["nodes"] if "camera" in n)
    lens = file.json["cameras"][0]["perspective"]
    assert lens["yfov"] == pytest.approx(np.radians(CAMERA[6])) and node["translation"] == pytest.approx(CAMERA[:3])
    x, y, z, w = node["rotation"]
    ahead = -np.array([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)])  # where its -z axis points
    aim = CAMERA[3:6] - CAMERA[:3]
    assert ahead == pytest.approx(aim / np.linalg.norm(aim), abs=1e-6)
    assert 2 * (x * y + w * z) == pytest.approx(0, abs=1e-6) and 1 - 2 * (x * x + z * z) > 0  # level, up is up


def test_what_blender_is_told_is_the_run(made):
    """Arrays with z up: x, -z, y."""
    told = blend.arrays(shot(Cut(made.recording, "cloths")))
    for k, (first, last, key) in enumerate(((0, 4, "x"), (4, 9, "x"), (0, 4, "solid_x"), (4, 8, "solid_x"))):
        for j, x in enumerate(told[f"x_{k}"]):
            y = made.frames[j][key][first:last]
            assert (x == np.column_stack([y[:, 0], -y[:, 2], y[:, 1]])).all()
        assert len(told[f"x_{k}"]) == (1 if k == 3 else 3)
    assert (np.concatenate([told["uv_0"], told["uv_1"]]) == made.geometry["uv"].reshape(-1, 2)).all() and "uv_2" not in told
    assert [told[f"counts_{k}"].tolist() for k in range(2)] == [[3, 3], [3, 3, 3]]
    assert len(told["sharp_2"]) == 6 and not len(told["sharp_0"])  # all edges of the tetrahedron
    assert told["numbers"].tolist() == [2, 3, 4] and told["fps"] == FPS and told["eye"][0] == pytest.approx([1, -5, 2])


@pytest.mark.parametrize("lifted, look", [(0.0, {}), (50.0, {}), (0.0, {"floor": np.array("none")}), (
    0.0, {"background": np.array("transparent")}), (0.0, {"floor": np.array("shadow")})])
def test_a_blend_has_the_ground_of_pictures(tmp_path, rng, lifted, look):
    """Under solids, if they are the lowest in any frame; else below cloth of all frames by .05 of the first one's size."""
    own = {}
    for k in range(3):
        x, y = rng.normal(size=(9, 3)), rng.normal(size=(8, 3)) + [0, lifted - 20 - k, 0]
        x[0, 1] -= k
        own[FIRST + k] = {"x": x.astype(np.float32), "solid_x": y.astype(np.float32)}
    made = make(tmp_path / "run", rng, own=own, ground=np.array(np.nan), **look)
    pieces = Cut(made.recording, "cloths")
    assert [m.name for m in shot(pieces).meshes][-1] == "sheet"
    ground = shot(pieces, floor=True).meshes[-1]
    cloth, solid = (min(float(f[key][:, 1].min()) for f in made.frames) for key in ("x", "solid_x"))
    first = np.concatenate([made.frames[0]["x"], made.frames[0]["solid_x"]]).astype(np.float64)
    below = min(float(first[:, 1].min()), cloth) - 0.05 * np.linalg.norm(np.ptp(first, axis=0))
    if look:
        assert ground.name == "sheet"
        return
    assert ground.name == "ground" and (solid < cloth) == (lifted == 0)
    assert ground.x[0][:, 1] == pytest.approx(solid if solid < cloth else below, rel=1e-6)


@pytest.mark.parametrize("script, words", [
    ("import sys; print('RuntimeError: no room', file=sys.stderr); sys.exit(1)", "no room"),
    ("import os, signal; os.kill(os.getpid(), signal.SIGSEGV)", signal.SIGSEGV.name), ("pass", "nothing")])
def test_a_blender_that_fails_is_named_and_leaves_what_was_there(made, tmp_path, monkeypatch, script, words):
    monkeypatch.setattr(blend, "command", lambda format: [sys.executable, "-c", script])
    (tmp_path / "old.blend").write_text("old")
    with pytest.raises(OutputError, match=rf"cannot write .*old\.blend: Blender .*{words}"):
        export(made.recording, "blend", tmp_path / "old.blend")
    assert [f.name for f in tmp_path.glob("*old*")] == ["old.blend"] and (tmp_path / "old.blend").read_text() == "old"


@pytest.mark.parametrize("format, package", [("blend", "blender"), ("abc", "blender"), ("usdc", "usd")])
def test_a_package_that_is_not_there_is_named_first(made, tmp_path, monkeypatch, format, package):
    monkeypatch.setitem(sys.modules, "pxr", None)
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    monkeypatch.setattr("shutil.which", lambda name: None)
    (made.recording.path / "frames" / "00003.npz").unlink()  # would be said later
    with pytest.raises(OutputError, match=rf"taichi-cloth\[{package}\]"):
        export(made.recording, format, tmp_path / "o")
    assert not (tmp_path / "o").exists()


def test_python_writes_what_the_command_line_writes(made, tmp_path):
    from taichi_cloth.app import cli

    recording = tc.Recording(made.recording.path)
    for format, target in (("glb", "a.glb"), ("obj", "a"), ("usda", "deep/er/a.usda"), ("pc2", None)):
        one, two = (None, None) if target is None else (tmp_path / "py" / target, tmp_path / "cli" / target)
        files = recording.export(format, one)
        kept = [f.read_bytes() for f in files]
        assert cli.main(["export", str(recording.path), "--format", format, *(["--to", str(two)] if two else [])]) == 0
        others = [two.parent / f.name if two and two.suffix else (two or recording.path / "pc2") / f.name for f in files]
        assert [f.read_bytes() for f in others] == kept
    assert files[0].parent == recording.path / "pc2" and "frames 2 to 4" in repr(recording)
    with pytest.raises(tc.SceneError, match="did you mean 'usd[ac]'"):
        recording.export("usd")
    with pytest.raises(tc.SceneError, match="unknown parts 'panel'"):
        recording.export("obj", parts="panel")
