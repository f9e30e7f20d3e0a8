"""Solids and cloth from USD: stages written here, positions computed afresh."""

import os
import subprocess
import sys

import numpy as np
import pytest

import taichi_cloth as tc

pytest.importorskip("pxr", reason="the package usd-core is not installed: pip install 'taichi-cloth[usd]'")
from pxr import Gf, Sdf, Usd, UsdGeom, UsdSkel, Vt  # noqa: E402

# A square post of three rings, 0, 1 and 2 up, with quads for sides, and lids.
RING = np.array([[0.2, 0, 0.2], [0.2, 0, -0.2], [-0.2, 0, -0.2], [-0.2, 0, 0.2]])
POST = np.concatenate([RING, RING + [0, 1, 0], RING + [0, 2, 0]])
QUADS = [(4 * r + k, 4 * r + (k + 1) % 4, 4 * r + 4 + (k + 1) % 4, 4 * r + 4 + k) for r in (0, 1) for k in range(4)]
QUADS += [(3, 2, 1, 0), (8, 9, 10, 11)]
UPPER = np.repeat([0.0, 0.5, 1.0], 4)


def stage(path, up="Y", unit=1.0, codes=(1, 10), rate=24.0):
    made = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageUpAxis(made, up)
    if unit:
        UsdGeom.SetStageMetersPerUnit(made, unit)
    made.SetTimeCodesPerSecond(rate)
    if codes:
        made.SetStartTimeCode(codes[0])
        made.SetEndTimeCode(codes[1])
    return made


def mesh(made, path, points=POST, faces=QUADS):
    out = UsdGeom.Mesh.Define(made, path)
    out.CreatePointsAttr(Vt.Vec3fArray([tuple(map(float, p)) for p in points]))
    out.CreateFaceVertexCountsAttr([len(f) for f in faces])
    out.CreateFaceVertexIndicesAttr([v for f in faces for v in f])
    out.CreateSubdivisionSchemeAttr("none")
    return out


def turn_z(angle: float) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])


def skinned(path, off=1.0, shape=False):
    """A post whose upper joint turns by .1 rad a frame; `off`: what its weights sum to."""
    made = stage(path)
    UsdSkel.Root.Define(made, "/Model")
    skeleton = UsdSkel.Skeleton.Define(made, "/Model/Skel")
    joints = ["Lower", "Lower/Upper"]
    bind = [Gf.Matrix4d(1), Gf.Matrix4d().SetTranslate((0, 1, 0))]
    skeleton.CreateJointsAttr(joints)
    skeleton.CreateBindTransformsAttr(bind)
    skeleton.CreateRestTransformsAttr(bind)
    UsdGeom.Xformable(skeleton).AddTranslateOp().Set((5, 0, 0))
    animation = UsdSkel.Animation.Define(made, "/Model/Anim")
    animation.CreateJointsAttr(joints)
    animation.CreateTranslationsAttr([(0, 0, 0), (0, 1, 0)])
    animation.CreateScalesAttr(Vt.Vec3hArray([(1, 1, 1), (1, 1, 1)]))
    turns = animation.CreateRotationsAttr()
    for k in range(10):
        turns.Set([Gf.Quatf(1), Gf.Quatf(float(np.cos(0.05 * k)), 0, 0, float(np.sin(0.05 * k)))], 1 + k)
    UsdSkel.BindingAPI.Apply(skeleton.GetPrim()).CreateAnimationSourceRel().SetTargets(["/Model/Anim"])
    body = mesh(made, "/Model/Body")
    binding = UsdSkel.BindingAPI.Apply(body.GetPrim())
    binding.CreateSkeletonRel().SetTargets(["/Model/Skel"])
    binding.CreateJointIndicesPrimvar(False, 2).Set([0, 1] * 12)
    binding.CreateJointWeightsPrimvar(False, 2).Set([float(off * w) for u in UPPER for w in (1 - u, u)])
    if shape:
        wide = UsdSkel.BlendShape.Define(made, "/Model/Body/Wide")
        wide.CreateOffsetsAttr([tuple(map(float, o)) for o in POST * [0.5, 0, 0.25]])
        binding.CreateBlendShapesAttr(["Wide"])
        binding.CreateBlendShapeTargetsRel().SetTargets(["/Model/Body/Wide"])
        animation.CreateBlendShapesAttr(["Wide"])
        for k in (0, 9):
            animation.CreateBlendShapeWeightsAttr().Set([k / 9.0], 1 + k)
    made.GetRootLayer().Save()
    return path


def bent(k: int, shape: bool) -> np.ndarray:
    rest = POST * (1 + np.array([0.5, 0, 0.25]) * k / 9) if shape else POST
    turned = (rest - [0, 1, 0]) @ turn_z(0.1 * k).T + [0, 1, 0]
    return rest + UPPER[:, None] * (turned - rest) + [5, 0, 0]


@pytest.mark.parametrize("suffix", [".usda", ".usdc"])
@pytest.mark.parametrize("shape", [False, True])
def test_a_skinned_body_with_a_blend_shape(tmp_path, suffix, shape):
    body = tc.load_solid(skinned(tmp_path / f"a{suffix}", shape=shape))
    assert body.x.shape == (10, 12, 3) and body.fps == 24 and body.closed and body.start == 0
    for k in range(10):
        assert np.abs(body.x[k] - bent(k, shape)).max() < 1e-5
    assert set(body.groups) == {"Body"}
    slow = tc.load_solid(tmp_path / f"a{suffix}", fps=48)
    assert len(slow.x) == 19 and np.abs(slow.x[::2] - body.x).max() < 1e-6


def test_weights_are_scaled_or_refused(tmp_path):
    body = tc.load_solid(skinned(tmp_path / "a.usda", off=0.5))
    assert np.abs(body.x[9] - bent(9, False)).max() < 1e-5
    assert "part 'Body': the skin weights of 12 vertices do not sum to 1 (0.5 to 0.5), and are scaled so" in body.notes
    with pytest.raises(tc.MeshError, match="a.usda: part 'Body': the skin weights of vertex 0 are"):
        tc.load_solid(skinned(tmp_path / "b" / "a.usda", off=0.0))


def test_units_axes_transforms_and_mirrors(tmp_path):
    """In centimetres, z up; a moving parent; a mirrored child; a left-handed mesh."""
    made = stage(tmp_path / "a.usda", "Z", 0.01, (0, 4), 24)
    root = UsdGeom.Xform.Define(made, "/Root")
    move = root.AddTranslateOp()
    for k in range(5):
        move.Set((0, 0, 10.0 * k), k)
    mesh(made, "/Root/A", 100 * POST)
    flipped = UsdGeom.Xform.Define(made, "/Root/Other")
    flipped.AddTranslateOp().Set((300, 0, 0))
    flipped.AddScaleOp().Set((-1, 1, 1))
    mesh(made, "/Root/Other/A", 100 * POST)
    left = mesh(made, "/Root/Left", 100 * POST + [600, 0, 0], [f[::-1] for f in QUADS])
    left.CreateOrientationAttr("leftHanded")
    made.GetRootLayer().Save()
    body = tc.load_solid(tmp_path / "a.usda")
    assert body.x.shape == (5, 36, 3) and body.closed and set(body.groups) == {"Root/A", "Other/A", "Left"}
    for name, x in (("Root/A", POST), ("Other/A", POST * [-1, 1, 1] + [3, 0, 0]), ("Left", POST + [6, 0, 0])):
        mine = body.groups[name]
        upright = np.column_stack([x[:, 0], x[:, 2], -x[:, 1]])
        for k in range(5):
            assert np.abs(body.x[k][mine] - upright - [0, 0.1 * k, 0]).max() < 1e-5
        corner = body.x[0][body.faces[np.isin(body.faces, mine).all(axis=1)]]
        assert np.linalg.det(corner - corner[0, 0]).sum() > 0, name
    assert [note for note in body.notes if "transform" in note] == [
        "mirrored by its transform: 'Other/A'; triangles are turned there, so that the outside stays outside"]
    assert np.allclose(tc.load_solid(tmp_path / "a.usda", scale=10, up="y").x[0][:, 1].max(), 20)
    assert np.allclose(tc.load_solid(tmp_path / "a.usda", only="Left").x[0].mean(axis=0), [6, 0, -1])


def test_points_that_change(tmp_path):
    made = stage(tmp_path / "a.usda", codes=None, rate=30)
    body = mesh(made, "/Body")
    for k in range(4):
        body.GetPointsAttr().Set(Vt.Vec3fArray([tuple(map(float, p)) for p in POST * (1 + k)]), 1000 + 2 * k)
    made.GetRootLayer().Save()
    read = tc.load_solid(tmp_path / "a.usda")
    assert read.fps == 30 and len(read.x) == 7 and read.start == 0
    assert all(np.allclose(x, POST * (1 + k / 2), atol=1e-5) for k, x in enumerate(read.x))
    made.SetStartTimeCode(1002)
    made.SetEndTimeCode(1004)
    made.GetRootLayer().Save()
    part = tc.load_solid(tmp_path / "a.usda")  # the range that the stage names
    assert len(part.x) == 3 and np.allclose(part.x, read.x[2:5])


def test_instances(tmp_path):
    made = stage(tmp_path / "a.usda", codes=None)
    many = UsdGeom.PointInstancer.Define(made, "/Many")
    mesh(made, "/Many/Protos/Post")
    many.CreatePrototypesRel().SetTargets(["/Many/Protos/Post"])
    many.CreateProtoIndicesAttr([0, 0])
    many.CreatePositionsAttr([(3, 0, 0), (6, 0, 0)])
    UsdGeom.Xform.Define(made, "/Library")
    made.OverridePrim("/Library").SetSpecifier(Sdf.SpecifierClass)
    mesh(made, "/Library/Post")
    for name, far in (("One", 9), ("Two", 12)):
        prim = UsdGeom.Xform.Define(made, f"/{name}")
        prim.AddTranslateOp().Set((far, 0, 0))
        prim.GetPrim().GetReferences().AddInternalReference("/Library")
        prim.GetPrim().SetInstanceable(True)
    made.GetRootLayer().Save()
    body = tc.load_solid(tmp_path / "a.usda")
    sides = [far + side for far in (3, 6, 9, 12) for side in (-0.2, 0.2)]
    assert sorted({round(float(x), 6) for x in body.x[0][:, 0]}) == pytest.approx(sides)
    assert body.closed and len(body.groups) == 4


def test_cloth_keeps_its_texture_coordinates(tmp_path):
    made = stage(tmp_path / "a.usda", "Z", 0.01, None)
    x = np.array([[0, 0, 0], [100, 0, 0], [100, 0, 100], [0, 0, 100]])
    sheet = mesh(made, "/Sheet", x, [(0, 1, 2, 3)])
    uv = UsdGeom.PrimvarsAPI(sheet).CreatePrimvar("st", Sdf.ValueTypeNames.TexCoord2fArray, "faceVarying")
    uv.Set([(0, 0), (0.5, 0), (0.5, 0.5), (0, 0.5)])
    UsdGeom.Subset.CreateGeomSubset(sheet, "hem", "face", [0])
    made.GetRootLayer().Save()
    read = tc.load(tmp_path / "a.usda")
    assert np.allclose(np.ptp(read.x, axis=0), [1, 1, 0]) and set(read.groups) == {"Sheet", "hem"}
    assert np.allclose(read.corner_uv.reshape(-1, 2).max(axis=0), 1) and read.material_areas.sum() == pytest.approx(1)


def test_what_is_left_out_and_not_named_is_said(tmp_path):
    made = stage(tmp_path / "a.usda", unit=None, codes=None)
    mesh(made, "/Body").CreateSubdivisionSchemeAttr("catmullClark")
    UsdGeom.Imageable(mesh(made, "/Hidden")).MakeInvisible()
    mesh(made, "/Proxy").CreatePurposeAttr("proxy")
    UsdGeom.Sphere.Define(made, "/Ball")
    made.GetRootLayer().Save()
    body = tc.load_solid(tmp_path / "a.usda", scale=100)
    assert set(body.groups) == {"Body"} and body.x[0][:, 1].max() == pytest.approx(2)
    said = " | ".join(body.notes)
    for words in ("names no unit: USD's own is taken, of 0.01 m; scale=100 if it is in metres",
                  "hidden are left out: Hidden, Proxy", "each Sphere is left out",
                  "part 'Body': is the cage of a subdivision surface"):
        assert words in said


def test_bad_stages_are_refused_by_name(tmp_path):
    path = tmp_path / "a.usda"

    def refused(message, **options):
        with pytest.raises(tc.MeshError, match=message) as caught:
            tc.load_solid(path, **options)
        assert "\n" not in str(caught.value)

    made = stage(path)
    UsdGeom.Sphere.Define(made, "/Ball")
    made.GetRootLayer().Save()
    refused("a.usda: has no mesh: it has 1 prims")
    body = mesh(made, "/Body")
    made.GetRootLayer().Save()
    refused("a.usda: clip = 'Walk': the file has no animation to choose from", clip="Walk")
    body.GetPointsAttr().Set(body.GetPointsAttr().Get(), 1)
    body.GetPointsAttr().Set(body.GetPointsAttr().Get(1)[:8], 4)
    made.GetRootLayer().Save()
    refused("part 'Body': has 8 vertices at time code 4, and 12 at first")
    body.GetPointsAttr().Set(body.GetPointsAttr().Get(1), 4)
    indices = body.GetFaceVertexIndicesAttr()
    usual = list(indices.Get())
    indices.Set(usual, 1)
    indices.Set(usual[::-1], 6)
    made.GetRootLayer().Save()
    refused("part 'Body': has other faces at time code 6 than before")
    for text, message in (("#usda 1.0\n(\n metersPerUnit = 0\n)\n", "is in an unknown unit: metersPerUnit = 0"),
                          ("#usda 1.0\n(\n", "cannot be read"), ("", "cannot be read")):
        path = tmp_path / f"b{len(text)}.usda"
        path.write_text(text)
        refused(message)


def test_a_file_of_an_older_version_is_read_without_a_word(tmp_path):
    """usd-core tells users of such files on stderr, by its own means, what only their makers can do anything about."""
    make = "from pxr import Usd, UsdGeom; s = Usd.Stage.CreateNew('a.usdc'); m = UsdGeom.Mesh.Define(s, '/m'); " \
           "m.CreatePointsAttr([(0, 0, 0), (1, 0, 0), (0, 1, 0)]); m.CreateFaceVertexCountsAttr([3]); " \
           "m.CreateFaceVertexIndicesAttr([0, 1, 2]); s.Save()"
    load = "import taichi_cloth as tc; print(tc.load('a.usdc').vertex_count)"
    old = os.environ | {"USD_WRITE_NEW_USDC_FILES_AS_VERSION": "0.7.0"}
    subprocess.run([sys.executable, "-c", make], cwd=tmp_path, env=old, timeout=100, check=True)
    assert tuple((tmp_path / "a.usdc").read_bytes()[8:11]) == (0, 7, 0)
    done = subprocess.run([sys.executable, "-c", load], cwd=tmp_path, capture_output=True, text=True, timeout=100, check=True)
    assert done.stdout == "3\n" and done.stderr == ""
