"""Images printed on cloth, read back from what other tools get: at each place of the pattern the colour that belongs there."""

import io

import numpy as np
import pytest
from test_export import COLORS, make, read_obj
from test_export_scenes import Gltf, problems

from taichi_cloth.output.export import blend, export
from taichi_cloth.output.export.pieces import Cut
from taichi_cloth.output.export.shot import shot

Image = pytest.importorskip("PIL.Image", reason="Pillow is not installed")

SIZE, ORIGIN = np.array([0.5, 0.25]), np.array([0.1, -0.2])
AGAIN = np.array([[[255, 0, 0, 255], [0, 255, 0, 128], [0, 0, 255, 0]], [[9, 99, 199, 255], [50, 60, 70, 255], [1, 2, 3, 64]]],
                 dtype=np.uint8)
ONCE = np.arange(2 * 4 * 4, dtype=np.uint8).reshape(2, 4, 4) * 7 | np.uint8([0, 0, 0, 255])


@pytest.fixture
def made(tmp_path, rng):
    """The first cloth has an image that goes on, the second one that is there once."""
    return make(tmp_path / "run", rng, cloth_colors=np.array([COLORS[0], [0.9, 0.5, 0.1]]),
                texture_0=AGAIN, texture_place_0=np.array([*SIZE, *ORIGIN, 1.0]),
                texture_1=ONCE, texture_place_1=np.array([0.5, 0.4, 0.3, 0.2, 0.0]))


def encoded(linear):
    """sRGB bytes of linear light."""
    return 255 * np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * np.maximum(linear, 1e-9) ** (1 / 2.4) - 0.055)


def linear(bytes_):
    c = bytes_ / 255
    return np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4)


def pixel(image, s, repeats):
    """Colours of an image (h, w, 3) at coordinates s (k, 2) from its lower left corner, the nearest pixels'."""
    h, w = image.shape[:2]
    at = np.floor(s * [w, h]).astype(int)
    at = at % [w, h] if repeats else np.clip(at, 0, [w - 1, h - 1])
    return image[h - 1 - at[:, 1], at[:, 0]]


def check(made, cloth, uv, image, repeats):
    """That an exported image has, by exported coordinates of corners, the right colours all over the pattern."""
    rows = slice(0, 2) if cloth == 0 else slice(2, 5)
    pattern = made.geometry["uv"][rows].reshape(-1, 2).astype(np.float64)
    lines = [np.polyfit(pattern[:, d], uv.reshape(-1, 2)[:, d], 1) for d in range(2)]  # the way from pattern to image
    assert all(np.polyval(lines[d], pattern[:, d]) == pytest.approx(uv.reshape(-1, 2)[:, d], abs=1e-5) for d in range(2))
    own, size, origin = ((AGAIN, SIZE, ORIGIN), (ONCE, np.array([0.5, 0.4]), np.array([0.3, 0.2])))[cloth]
    count = own.shape[1::-1]
    cells = np.stack(np.meshgrid(*(np.arange(-n, 2 * n) + 0.5 for n in count)), axis=-1).reshape(-1, 2)
    places = origin + cells / count * size  # the middles of pixels, of those beyond the image too
    got = pixel(image, np.column_stack([np.polyval(lines[d], places[:, d]) for d in range(2)]), repeats)
    rgba = pixel(own, cells / count, True).astype(np.float64)
    alpha = rgba[:, 3:] / 255
    if not repeats:
        alpha = alpha * ((cells > 0) & (cells < count)).all(axis=1, keepdims=True)
    color = made.geometry["cloth_colors"][cloth]
    assert np.abs(got - encoded(linear(rgba[:, :3]) * alpha + color * (1 - alpha))).max() <= 1


def test_blender_gets_images(made):
    told = blend.arrays(shot(Cut(made.recording, "cloths")))
    for k, repeats in enumerate((True, False)):
        assert bool(told[f"repeats_{k}"]) == repeats
        check(made, k, told[f"uv_{k}"].reshape(-1, 3, 2), told[f"image_{k}"], repeats)


def test_texture_coordinates_of_a_meshs_own_are_exported_and_placed_by(tmp_path, rng):
    own = np.full((5, 3, 2), np.nan, dtype=np.float32)
    own[:2] = rng.random((2, 3, 2))
    nothing = [np.nan, np.nan]
    for k, more in enumerate(({}, {"texture_0": AGAIN, "texture_place_0": np.array([*nothing, *nothing, True])})):
        made = make(tmp_path / f"run{k}", rng, image_uv=own, **more)
        files = export(made.recording, "obj", tmp_path / f"o{k}")
        a, b = list(read_obj(next(f for f in files if f.suffix == ".obj")).values())[:2]
        assert a.uv == pytest.approx(own[:2], abs=1e-6) and (b.uv == made.geometry["uv"][2:]).all()
    corner, image = made.geometry["uv"][:2].astype(float), own[:2].astype(float)
    areas = [np.abs(np.linalg.det(c[:, 1:] - c[:, :1])).sum() for c in (corner, image)]
    metre = np.sqrt(areas[1] / areas[0])  # of the pattern, in texture coordinates
    made = make(tmp_path / "sized", rng, image_uv=own, uv=made.geometry["uv"], texture_0=AGAIN,
                texture_place_0=np.array([0.5, 0.25, 0.1, 0.2, True]))
    files = export(made.recording, "obj", tmp_path / "sized_o")
    a = next(iter(read_obj(next(f for f in files if f.suffix == ".obj")).values()))
    assert a.uv == pytest.approx((image / metre - [0.1, 0.2]) / [0.5, 0.25], abs=1e-5)


def test_obj_has_them_in_its_materials(made, tmp_path):
    mtl, *files = export(made.recording, "obj", tmp_path / "o")
    blocks = {words[0]: words for words in (block.split() for block in mtl.read_text().split("newmtl ")[1:])}
    for cloth, (name, found) in enumerate(list(read_obj(files[-1]).items())[:2]):
        words, repeats = blocks[name], cloth == 0
        assert words[1:5] == ["Kd", "1", "1", "1"] and ("-clamp" in words) != repeats
        image = tmp_path / "o" / words[-1]
        assert image in files and words[words.index("map_Kd")] == "map_Kd"
        check(made, cloth, found.uv, np.array(Image.open(image)), repeats)
    assert "map_Kd" not in blocks["sheet"] and len(files) == 2 + 3


def test_pc2_has_them_beside_it(made, tmp_path):
    files = {file.name: file for file in export(made.recording, "pc2", tmp_path / "o")}
    check(made, 1, read_obj(files["4_skirts.obj"])["4_skirts"].uv, np.array(Image.open(files["4_skirts.png"])), False)


@pytest.mark.parametrize("format", ["glb", "gltf"])
def test_gltf_has_them_inside(made, tmp_path, format):
    files = export(made.recording, format, tmp_path / "o")
    assert len(files) == (1 if format == "glb" else 2)
    file = Gltf(files[0])
    for cloth in (0, 1):
        material = file.json["materials"][file.json["meshes"][cloth]["primitives"][0]["material"]]["pbrMetallicRoughness"]
        texture = file.json["textures"][material["baseColorTexture"]["index"]]
        assert "baseColorFactor" not in material
        sampler, source = file.json["samplers"][texture["sampler"]], file.json["images"][texture["source"]]
        assert sampler["wrapS"] == sampler["wrapT"] == (10497, 33071)[cloth] and source["mimeType"] == "image/png"
        view = file.json["bufferViews"][source["bufferView"]]
        data = file.bin[view["byteOffset"]: view["byteOffset"] + view["byteLength"]]
        _, _, uv = file.at(cloth, 0.0)
        check(made, cloth, uv * [1, -1] + [0, 1], np.array(Image.open(io.BytesIO(data))), cloth == 0)
    assert "baseColorTexture" not in file.json["materials"][2]["pbrMetallicRoughness"]


@pytest.mark.parametrize("format", ["usda", "usdc"])
def test_usd_has_them_beside_it(made, tmp_path, format):
    Usd = pytest.importorskip("pxr.Usd", reason="usd-core is not installed")
    from pxr import UsdGeom, UsdShade

    path, *images = export(made.recording, format, tmp_path / f"a@b.{format}")
    stage = Usd.Stage.Open(str(path))
    meshes = [UsdGeom.Mesh(p) for p in stage.Traverse() if p.IsA(UsdGeom.Mesh)]
    for cloth, mesh in enumerate(meshes[:2]):
        shader = UsdShade.MaterialBindingAPI(mesh).ComputeBoundMaterial()[0].ComputeSurfaceSource()[0]
        image = UsdShade.Shader(shader.GetInput("diffuseColor").GetConnectedSources()[0][0].source.GetPrim())
        assert image.GetIdAttr().Get() == "UsdUVTexture" and image.GetInput("sourceColorSpace").Get() == "sRGB"
        assert image.GetInput("wrapS").Get() == image.GetInput("wrapT").Get() == ("repeat", "clamp")[cloth]
        place = UsdShade.Shader(image.GetInput("st").GetConnectedSources()[0][0].source.GetPrim())
        primvar = UsdGeom.PrimvarsAPI(mesh).GetPrimvar(place.GetInput("varname").Get())
        file = image.GetInput("file").Get().resolvedPath
        assert file == str(images[cloth])
        check(made, cloth, np.array(primvar.Get()), np.array(Image.open(file)), cloth == 0)
    assert problems(path) == [] and len(images) == 2


def test_panels_have_their_part_of_it(tmp_path, rng):
    """An image that is spread over a cloth is not spread over each of its panels."""
    nothing = [np.nan, np.nan]
    made = make(tmp_path / "run", rng, texture_1=AGAIN, texture_place_1=np.array([*nothing, *nothing, 1.0]),
                panel=np.array([0, 0, 1, 2, 2]), panel_names=np.array(["a", "b", "c"]), sewn=np.arange(9))
    whole = list(read_obj(export(made.recording, "obj", tmp_path / "o")[-1]).values())[1].uv
    parts = [part.uv for part in list(read_obj(export(made.recording, "obj", tmp_path / "p", "panels")[-1]).values())[1:3]]
    assert (np.concatenate(parts) == whole).all()
    assert whole.reshape(-1, 2).min(axis=0) == pytest.approx(0, abs=1e-6)
    assert whole.reshape(-1, 2).max(axis=0) == pytest.approx(1, abs=1e-6)


def test_colours_of_panels_are_in_a_palette(tmp_path, rng):
    """Each face at the colour that it has; a piece of one colour needs no image, and keeps its pattern."""
    own = np.full((5, 3), np.nan)
    own[0], own[3], own[4] = (1, 0, 0), (0, 0.5, 1), (0, 0.5, 1)
    made = make(tmp_path / "run", rng, cloth_colors=np.array([COLORS[0], [0.9, 0.5, 0.1]]), face_colors=own,
                panel=np.array([0, 0, 2, 1, 1]), panel_names=np.array(["a", "b", "c"]), sewn=np.arange(9))
    colors = np.where(np.isnan(own), made.geometry["cloth_colors"][[0, 0, 1, 1, 1]], own)
    mtl, *files = export(made.recording, "obj", tmp_path / "o")
    images = [np.array(Image.open(file)) for file in files if file.suffix == ".png"]
    for (name, found), image, rows in zip(read_obj(files[-1]).items(), images, (slice(0, 2), slice(2, 5))):
        for uv, color in zip(found.uv, colors[rows]):
            assert np.abs(pixel(image, uv, False) - encoded(color)).max() <= 1 and np.ptp(uv) < 1, name
    mtl, *files = export(made.recording, "obj", tmp_path / "p", "panels")
    blocks = {words[0]: words for words in (block.split() for block in mtl.read_text().split("newmtl ")[1:])}
    assert "map_Kd" in blocks["a"] and blocks["b"][2:5] == ["0", "0.5", "1"] and blocks["c"][2:5] == ["0.9", "0.5", "0.1"]
    assert read_obj(files[-1])["b"].uv == pytest.approx(made.geometry["uv"][3:])
    file = Gltf(export(made.recording, "glb", tmp_path / "g", "panels")[0])
    assert [len(file.json["materials"][k]["pbrMetallicRoughness"].get("baseColorFactor", [])) for k in range(3)] == [0, 4, 4]


@pytest.mark.parametrize("parts, order", [("cloths", [0, 1, 2, 3, 4]), ("panels", [0, 1, 3, 4, 2])])
def test_vertices_have_the_colours_of_panels(tmp_path, rng, parts, order):
    """Of the first face that each is a corner of, as bytes: ParaView and mesh viewers show them as they are."""
    import meshio

    own = np.full((5, 3), np.nan)
    own[0], own[3], own[4] = (1, 0, 0), (0, 0.5, 1), (0, 0.5, 1)
    made = make(tmp_path / "run", rng, cloth_colors=np.array([COLORS[0], [0.9, 0.5, 0.1]]), face_colors=own,
                panel=np.array([0, 0, 2, 1, 1]), panel_names=np.array(["a", "b", "c"]), sewn=np.arange(9))
    colors = np.where(np.isnan(own), made.geometry["cloth_colors"][[0, 0, 1, 1, 1]], own)[order]
    for format in ("ply", "vtu"):
        mesh = meshio.read(next(f for f in export(made.recording, format, tmp_path / format, parts) if f.suffix != ".pvd"))
        parted = [mesh.point_data[name].view(np.uint8) for name in ("red", "green", "blue") if format == "ply"]
        found = np.column_stack(parted) if parted else mesh.point_data["color"]
        faces = mesh.cells_dict["triangle"]
        for vertex, shown in enumerate(found):
            first = int(np.flatnonzero((faces == vertex).any(axis=1))[0])
            assert found.dtype == np.uint8 and np.abs(shown - encoded(colors[first])).max() <= 1, (format, vertex)
    plain = make(tmp_path / "plain", rng)
    assert "color" not in meshio.read(export(plain.recording, "vtu", tmp_path / "n")[0]).point_data
