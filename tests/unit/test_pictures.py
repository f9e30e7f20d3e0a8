"""What pictures are made of, each against what can be worked out from positions, images and colours themselves."""

import io
import struct

import numpy as np
import pytest

import taichi_cloth as tc
from taichi_cloth import colornames
from taichi_cloth.backend import runtime
from taichi_cloth.backend.fields import Fields
from taichi_cloth.backend.language import ti
from taichi_cloth.output import colors, objects
from taichi_cloth.output.camera import frame
from taichi_cloth.output.described import appearances_of, of_appearances, of_view, view_of
from taichi_cloth.output.exr import encode_exr
from taichi_cloth.output.look import Look
from taichi_cloth.output.nearby import nearby
from taichi_cloth.output.picture import Artist, surfaces
from taichi_cloth.output.png import encode_png
from taichi_cloth.output.raster import Raster
from taichi_cloth.output.smooth import Smooth
from taichi_cloth.output.surfaces import back_of
from taichi_cloth.output.text import draw_text
from taichi_cloth.recording import record
from taichi_cloth.recording.drawing import numbers_in
from taichi_cloth.recording.expected import expected
from taichi_cloth.recording.report import paints_of
from taichi_cloth.scene.appearance import appearance
from taichi_cloth.scene.view import Camera, CameraKeys, View

AHEAD = Camera((0.5, 0.5, 3), (0.5, 0.5, 0), fov=2 * np.degrees(np.arctan(0.25)))  # 1.5 m of the plane z = 0, top to bottom
SIZE = (120, 120)
FABRIC = tc.Fabric(0.2, tc.Stretch(100))


@pytest.fixture(scope="module")
def sim():
    """A square metre that faces the camera, at rest, and a ball behind it."""
    scene = tc.Scene(view=View(AHEAD, ground=-5.0))
    scene.add_cloth(tc.grid(1.0, 4, plane="xy"), FABRIC, name="sheet", color="white")
    scene.add_solid(tc.Sphere(0.3), 0.4, 0.005, position=(0.5, 1.0, -1.0), color="#808080")
    made = tc.Simulation(scene, h=1 / 60)
    yield made
    made.close()


def shot(sim, frame=None, **look):
    """(picture, artist) of the sheet, or of arrays put in its place."""
    artist = Artist(record.geometry(sim), SIZE, Look(**look))
    return artist.draw(record.frame(sim) if frame is None else frame), artist


@pytest.mark.parametrize("camera", [None, AHEAD])
def test_the_ground_touches_what_stands_on_it(sim, camera):
    """A pole's foot at -.8, and at -.9 in a later frame; not where cloth comes lower, in any frame."""
    def ground(*frames, **view):
        scene = tc.Scene(view=View(camera, **view))
        scene.add_cloth(tc.grid(1.0, 2, plane="xy"), FABRIC)
        scene.add_solid(tc.Capsule((0, -0.7, 0), (0, 1, 0), 0.1), 0.4, 0.005)
        g = record.as_built(scene)
        made = [{"x": g["x"] - [0, sunk, 0], "solid_x": g["solid_x"] - [0, lower, 0]} for sunk, lower in frames]
        return Artist(g, SIZE, Look(), lambda: made).renderer.ground

    assert ground() == ground((0.7, 0.0)) == pytest.approx(-0.8) and ground((0.85, 0.1)) == pytest.approx(-0.9)
    assert ground((0.85, 0.0)) < -0.85 and ground((0.7, 0.0), ground=-2.0) == -2.0 and ground(reach=0.9) < -1.7
    assert ground((1.0, 0.1)) < -0.9


@pytest.mark.parametrize("camera", [None, AHEAD])
def test_the_ground_is_below_cloth_of_all_frames(camera):
    """By a twentieth of the size at the start: cloth that hangs down later does not go through it."""
    scene = tc.Scene(view=View(camera))
    scene.add_cloth(tc.grid(1.0, 2), FABRIC)
    g = record.as_built(scene)
    frames = [{"x": g["x"] - [0, lower, 0]} for lower in (0.3, 2.0, 0.0)]
    assert Artist(g, SIZE, Look(), lambda: frames).renderer.ground == pytest.approx(-2 - 0.05 * np.sqrt(2))
    assert Artist(g, SIZE, Look()).renderer.ground == pytest.approx(-0.05 * np.sqrt(2))


def test_names_of_colours():
    image_color = pytest.importorskip("PIL.ImageColor")
    assert len(colornames.NAMES) == 148
    for name in colornames.NAMES:
        bytes_ = np.array(image_color.getrgb(name))
        linear = np.array(colornames.linear_of(name))
        assert (np.rint(255 * colornames.to_srgb(linear)) == bytes_).all(), name
    assert colornames.linear_of("#F00") == colornames.linear_of("#ff0000") == (1.0, 0.0, 0.0)
    assert colornames.linear_of("#808080")[0] == pytest.approx(0.2159, abs=1e-4)
    assert colornames.linear_of("Dark Red") == colornames.linear_of("darkred")


@pytest.mark.parametrize("make, what", [
    (lambda: tc.Appearance("crimsn"), "'crimson'"), (lambda: tc.Appearance(back="#12345"), "appearance back"),
    (lambda: View(background="skye"), "sky, transparent"), (lambda: View(floor=3), "floor"),
    (lambda: View(light=(0, 0, 0)), "light = .0, 0, 0.: needs a direction"), (lambda: View({}), "keys are empty"),
    (lambda: View({"a": AHEAD}), "time of a key"), (lambda: View({0: 1}), "camera at 0"),
    (lambda: tc.Texture("no.png"), "'no.png': there is no such file"), (lambda: tc.Texture(__file__), "cannot be read"),
    (lambda: tc.Texture(np.zeros((4, 4))), "uint8"), (lambda: tc.Texture(np.zeros((4, 4, 3), np.uint8), -1), "size"),
    (lambda: tc.Weave(0), "spacing"), (lambda: tc.Weave(kind="knit"), "knit"), (lambda: Look(smooth=4), "smooth"),
    (lambda: Look(bits=12), "bits = 12"), (lambda: Look(cloths={"a": "red"}), "appearance of 'a'"),
    (lambda: numbers_in("1:2:3:4", range(9)), "FIRST:LAST:STEP"), (lambda: numbers_in("a", range(9)), "'a'"),
    (lambda: numbers_in("2:5:0", range(9)), "step"), (lambda: numbers_in("20:30", range(9)), "there are 0 to 8")])
def test_what_cannot_be_is_named(make, what):
    with pytest.raises(tc.SceneError, match=what):
        make()


def test_frames_are_named_by_text():
    there = range(61)
    assert numbers_in("10:60:5", there) == list(range(10, 61, 5)) and numbers_in("7", there) == [7]
    assert numbers_in("58:", there) == [58, 59, 60] and numbers_in(":2", there) == [0, 1, 2]
    assert numbers_in("3,1:5:2,58:99", there) == [1, 3, 5, 58, 59, 60]
    with pytest.raises(tc.SceneError, match="99 is not there; there are 0 to 60"):
        numbers_in("3,1:5:2,99", there)


def test_a_camera_goes_through_its_keys():
    a, b, c = Camera((0, 0, 5), (0, 0, 0), 30), Camera((1, 2, 5), (1, 0, 0), 40), Camera((4, 0, 5), (0, 1, 0), 20)
    keys = CameraKeys({2.0: b, 0.5: a, 3.0: c})
    for t, camera in ((0.0, a), (0.5, a), (2.0, b), (3.0, c), (9.0, c)):
        assert np.allclose(keys.at(t).numbers, camera.numbers)
    near = [keys.at(2.0 + s).numbers for s in (-1e-4, 0, 1e-4)]
    assert np.allclose(near[1] - near[0], near[2] - near[1], atol=1e-6), "as fast before a key as after it"
    assert np.allclose(CameraKeys({0: a, 1: b}).at(0.25).numbers, 0.75 * a.numbers + 0.25 * b.numbers), "two keys: straight"


def test_what_is_recorded_of_a_view_and_of_appearances_comes_back(rng):
    image = rng.integers(0, 256, (5, 7, 4), dtype=np.uint8)
    looks = [tc.Appearance("crimson", "navy"), tc.Appearance(), tc.Appearance(
        squares=True, texture=tc.Texture(image, 0.7, (0.1, 0.2), False), weave=tc.Weave(0.003, 0.5, "twill"),
        sheen=0.5, roughness=0.3, hem=0.01)]
    g = of_appearances(looks) | {"cloth_names": np.array(["a", "b", "c"])}
    back = appearances_of(g)
    for one, other in zip(looks, back):
        assert (one.color, one.back, one.squares, one.weave) == (other.color, other.back, other.squares, other.weave)
        assert one.surface == other.surface
    assert (back[2].texture.image == image).all() and back[2].texture.size == pytest.approx((0.7, 0.5))
    assert back[2].texture.origin == (0.1, 0.2) and not back[2].texture.repeat and back[1].texture is None
    assert set(of_appearances([tc.Appearance("red")])) == {"cloth_colors"}, "nothing more where nothing more is said"
    for view in (View(), View(AHEAD, 0.5, 0.1), View({0: AHEAD, 1: Camera((1, 1, 1), (0, 0, 0))}, background="transparent",
                                                     floor="shadow", light=(0, 1, 0)), View(background="tan", floor="plum"),
                 View(light="studio")):
        again = view_of(of_view(view, view.ground))
        assert (again.ground, again.reach, again.floor, again.background) == (view.ground, view.reach, view.floor,
                                                                              view.background)
        assert again.light == view.light
        for t in (0.0, 0.3, 1.0):
            a, b = (None if v.camera is None else v.camera if isinstance(v.camera, Camera) else v.camera.at(t)
                    for v in (view, again))
            assert a == b


def test_alpha_is_what_is_covered(sim):
    look = {"cloths": {"": tc.Appearance("#ff8000", squares=False)}, "camera": Camera((0.9, 0.8, 3), (0.503, 0.52, 0), 28)}
    image, artist = shot(sim, background="transparent", **look)
    alpha = image[..., 3]
    assert image.shape == (120, 120, 4) and (alpha[:3] == 0).all() and (image[:3] == 0).all() and alpha[60, 60] == 255
    opaque, _ = shot(sim, background="black", floor="none", **look)
    edge = (alpha > 0) & (alpha < 255)
    linear = colornames.from_srgb(image[..., :3] / 255) * (alpha / 255)[..., None]
    assert edge.sum() > 50 and np.abs(linear - colornames.from_srgb(opaque / 255)).max() < 0.01, "over black: the same picture"
    rows = np.flatnonzero(edge[60])
    inside = image[60, 60, :3].astype(int)
    assert len(rows) and np.abs(image[60, rows, :3].astype(int) - inside).max() < 60, "edges keep cloth's colour, undarkened"
    assert artist.renderer.transparent
    draw_text(image, "A", 0, 0, 1)
    assert image[0, 2].tolist() == [25, 28, 33, 255]


@pytest.mark.slow
def test_background_floor_and_light_are_as_said(sim):
    image, _ = shot(sim, background="#204060", floor="none")
    assert image[2, 2].tolist() == [0x20, 0x40, 0x60] and image[-2, 2].tolist() == [0x20, 0x40, 0x60]
    above = Camera((0.5, 3, 3), (0.5, -5, -4))
    plain, checker = (shot(sim, floor=f, camera=above)[0][90:, :40].astype(int) for f in ("tan", "checker"))
    apart = [np.abs(np.diff(floor.mean(axis=2), axis=1)).max() for floor in (plain, checker)]
    assert apart[0] < 1.1 < 1.4 < apart[1], "squares have edges"
    assert plain[10, 10, 0] > plain[10, 10, 2] + 5, "tan, as far as distance leaves it"
    shadow, _ = shot(sim, floor="shadow", background="transparent", camera=above, light=(0, 1, 0.01))
    assert 0 < shadow[..., 3][shadow[..., :3].max(axis=2) == 0].max() < 255, "black, as dense as the shadow"
    left, right = (shot(sim, light=v, cloths={"": tc.Appearance(squares=False)})[0][60, 60, 0]
                   for v in ((0, 0, 1), (0, 1, 0.01)))
    assert left > right + 40, "lit from the front it is brighter than by light that only grazes it"


def test_panels_have_colours_of_their_own(sim):
    mesh = tc.grid(1.0, 4, plane="xy")
    mesh = tc.TriMesh(mesh.x, mesh.faces, mesh.uv, {"left half": np.flatnonzero(mesh.uv[:, 0] < 0.51), "corner": [0, 1, 5, 6]})
    scene = tc.Scene()
    scene.add_cloth(tc.grid(1.0, 1), FABRIC, color="white", name="other")
    scene.add_cloth(mesh, FABRIC, color=tc.Appearance("lime", panels={"left half": "red", "corner": "#0000ff"}), name="flag")
    g = record.as_built(scene)
    side = mesh.uv[mesh.faces].mean(axis=1)
    wanted = np.where(side[:, :1] < 0.5, [1.0, 0, 0], [0, 1.0, 0])
    wanted[(side < 0.25).all(axis=1)] = 0, 0, 1
    drawn = surfaces(g, Look(), None)
    assert (drawn.colors[drawn.owner == 0] == 1).all() and np.allclose(drawn.colors[drawn.owner == 1], wanted)
    assert np.allclose(drawn.backs[drawn.owner == 1], back_of(wanted))
    runs, _ = paints_of(g)  # what the page of a report plays
    assert sum(run[1] for run in runs) == len(drawn.colors) and [run[0] for run in runs[:2]] == [0, 2]
    assert np.allclose(np.concatenate([np.tile(run[2], (run[1], 1)) for run in runs]), drawn.colors, atol=1e-4)
    asked = surfaces(g, Look(cloths={"flag": tc.Appearance("black")}), None)  # over all of its panels
    assert (asked.colors[asked.owner == 1] == 0).all() and (asked.colors[asked.owner == 0] == 1).all()
    for panels, words in (({"rigth": "red"}, "rigth"), ({"left half": "redd"}, "'redd'"), (["red"], "by the names")):
        with pytest.raises(tc.ClothError, match=words):
            scene.add_cloth(mesh, FABRIC, color=tc.Appearance(panels=panels), name="b")
    with pytest.raises(tc.SceneError, match="from the scene"):
        Look(cloths={"": tc.Appearance(panels={"left half": "red"})})


def test_passes_are_what_positions_say(sim):
    artist = Artist(record.geometry(sim), SIZE, Look(camera=Camera((1.2, 0.9, 2.0), (0.5, 0.5, -0.2), 40)))
    passes = artist.passes(record.frame(sim))
    camera = artist.renderer.camera
    faces = np.concatenate([sim.scene.cloths[0].mesh.faces, artist.geometry["solid_faces"] + sim.vertex_count])
    x = artist.points(record.frame(sim))
    rows, columns = np.mgrid[0:120, 0:120]
    rays = ((columns + 0.5 - 60)[..., None] * camera.axes[0] + (60 - rows - 0.5)[..., None] * camera.axes[1]
            - camera.focal * 120 * camera.axes[2]) / (camera.focal * 120)  # 1 m along the view each
    nearest, of = np.full((120, 120), np.inf), np.zeros((120, 120), dtype=int)
    for k, face in enumerate(faces):
        a, e, f = x[face[0]], x[face[1]] - x[face[0]], x[face[2]] - x[face[0]]
        m = np.linalg.inv(np.column_stack([e, f, np.cross(e, f)]))
        o, d = m @ (camera.eye - a), rays @ m.T
        with np.errstate(divide="ignore", invalid="ignore"):
            t = -o[2] / d[..., 2]
            u, v = o[0] + t * d[..., 0], o[1] + t * d[..., 1]
        hit = (u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0) & (t < nearest)
        nearest[hit], of[hit] = t[hit], 1 + (k >= sim.scene.cloths[0].mesh.face_count)
    here = of > 0
    agree = passes["id"][here] == of[here]
    assert set(np.unique(of)) == {0, 1, 2} and agree.mean() > 0.99
    same = here & (passes["id"] == of)
    assert np.abs(passes["depth"][same] - nearest[same]).max() < 2e-3 * 2 and np.median(
        np.abs(passes["depth"][same] - nearest[same])) < 1e-5
    normal = passes["normal"][passes["id"] == 1]
    assert np.allclose(normal, [0, 0, 1], atol=1e-5)
    assert np.allclose(np.linalg.norm(passes["normal"][same], axis=1), 1, atol=1e-4)
    ground = passes["id"] == 3
    point = camera.eye + passes["depth"][ground][:, None] * rays[ground]
    assert ground.any() and np.allclose(point[:, 1], -5.0, atol=1e-3) and np.isinf(passes["depth"][passes["id"] == 0]).all()
    assert not (Artist(record.geometry(sim), SIZE, Look(floor="none")).passes(record.frame(sim))["id"] == 3).any()


@pytest.mark.slow
def test_a_texture_lies_as_the_pattern_says(sim):
    image = np.zeros((8, 8, 3), dtype=np.uint8)
    image[:4, :4], image[:4, 4:], image[4:, :4], image[4:, 4:] = (255, 0, 0), (0, 255, 0), (0, 0, 255), (255, 255, 0)

    def corners(texture, **more):
        picture, _ = shot(sim, cloths={"": tc.Appearance("black", texture=texture, **more)}, light=(0, 0, 1))
        picture = picture.astype(int)
        return ["".join("1" if c > 120 else "0" for c in picture[row, column]) for row, column in
                ((35, 35), (35, 85), (85, 35), (85, 85))]  # the sheet is in the middle two thirds: pixels 20 to 100

    assert corners(tc.Texture(image)) == ["100", "010", "001", "110"], "upper left, upper right, lower left, lower right"
    assert corners(tc.Texture(image, (0.75, 1.0))) == ["100", "100", "001", "001"], "and again from there on"
    half = corners(tc.Texture(image, (1.0, 1.0), (0.5, 0.0)))
    assert half == ["010", "100", "110", "001"], "begins at half the width, and goes round"
    once = corners(tc.Texture(image, (1.0, 1.0), (0.5, 0.0), repeat=False))
    assert once == ["000", "100", "000", "001"], "and is there once"
    clear = np.concatenate([image, np.zeros((8, 8, 1), np.uint8)], axis=2)
    assert corners(tc.Texture(clear)) == ["000"] * 4, "cloth shows through"
    turned = record.frame(sim) | {"x": (record.frame(sim)["x"] * [-1, 1, 1] + [1, 0, 0]).astype(np.float32)}
    for back, sides in ((None, True), ("white", False)):
        look = {"cloths": {"": tc.Appearance("black", back, texture=tc.Texture(image))}, "light": (0, 0, 1)}
        picture = shot(sim, turned, **look)[0].astype(int)
        red = picture[35, 85, 0] > picture[35, 85, 1] + 60
        assert red == sides, "the back shows it too, unless it has a colour of its own"


@pytest.mark.slow
def test_images_go_by_texture_coordinates_of_a_meshs_own():
    flat, fabric = tc.grid((1.5, 1.0), 3), tc.Fabric(0.2, tc.Stretch(100))
    own = flat.corner_uv / [1.5, 1.0]
    image = tc.Texture(np.full((2, 3, 3), 99, dtype=np.uint8))
    scene = tc.Scene()
    scene.add_cloth(tc.grid(1.0, 2), fabric)
    scene.add_cloth(tc.TriMesh(flat.x, flat.faces, texture=own), fabric, color=tc.Appearance(texture=image),
                    tear=tc.Tear(100.0, length=1.0))
    drawn, metres = surfaces(record.as_built(scene), Look(), None), np.sqrt(1.5)  # of area 1.5 m^2, 1 in the texture
    assert (drawn.corner_uv[:8] == scene.cloths[0].mesh.corner_uv.astype(np.float32)).all()
    assert drawn.corner_uv[8:] == pytest.approx(own * metres, rel=1e-6)
    assert drawn.objects[1, objects.ORIGIN: objects.ORIGIN + 2].tolist() == [0, 0]
    assert drawn.objects[1, objects.SIZE: objects.SIZE + 2] == pytest.approx([metres, metres])


def test_small_textures_in_the_distance_are_their_mean(sim):
    dots = np.zeros((64, 64, 3), dtype=np.uint8)
    dots[::2, ::2] = dots[1::2, 1::2] = 255
    far = shot(sim, cloths={"": tc.Appearance("black", texture=tc.Texture(dots, 0.01))}, light=(0, 0, 1))[0][50:70, 50:70]
    grey = shot(sim, cloths={"": tc.Appearance((0.5, 0.5, 0.5), squares=False)}, light=(0, 0, 1))[0][50:70, 50:70]
    assert np.ptp(far) <= 3 and abs(int(far[10, 10, 0]) - int(grey[10, 10, 0])) <= 3


@pytest.mark.slow
def test_threads_show_near_and_not_far(sim):
    def picture(spacing, kind="plain"):
        one = tc.Appearance("grey", squares=False, weave=None if spacing is None else tc.Weave(spacing, 1.0, kind))
        return shot(sim, cloths={"": one}, light=(0.4, 0.6, 0.7))[0][40:80, 40:80, 0].astype(int)

    assert picture(0.1).std() > 5 > picture(0.001).std() and picture(None).std() < 2
    plain = picture(0.1)
    apart = [np.abs(plain[:, :24] - plain[:, k: k + 24]).mean() for k in (8, 16)]  # a thread is 8 pixels
    assert apart[1] < 0.5 * apart[0], "every second thread is alike"
    assert (picture(0.1, "twill") != plain).mean() > 0.3


def test_sixteen_bits_say_more(sim):
    small, large = (shot(sim, bits=b)[0] for b in (8, 16))
    assert large.dtype == np.uint16 and np.abs(large / 257.0 - small).max() <= 0.51
    assert len(np.unique(large)) > 3 * len(np.unique(small)) and (large % 257 != 0).mean() > 0.5
    image_of = pytest.importorskip("PIL.Image")
    data = encode_png(large)
    assert struct.unpack(">IIBB", data[16:26]) == (120, 120, 16, 2)
    assert np.abs(np.array(image_of.open(io.BytesIO(data)).convert("RGB")).astype(int) - large // 256).max() <= 1
    alpha = np.concatenate([small, np.full_like(small[..., :1], 77)], axis=2)
    assert (np.array(image_of.open(io.BytesIO(encode_png(alpha)))) == alpha).all()


def test_exr_holds_the_numbers(rng, tmp_path):
    reader = pytest.importorskip("OpenEXR")
    channels = {"R": rng.normal(size=(37, 21)).astype(np.float32), "depth.Z": np.full((37, 21), np.inf, np.float32),
                "id.I": rng.integers(0, 9, (37, 21)).astype(np.int32), "normal.X": np.zeros((37, 21), np.float32)}
    (tmp_path / "a.exr").write_bytes(encode_exr(channels))
    with reader.File(str(tmp_path / "a.exr"), separate_channels=True) as file:
        read = {name: channel.pixels for name, channel in file.channels().items()}
    assert set(read) == set(channels) and read["id.I"].dtype == np.uint32
    for name, array in channels.items():
        assert (read[name] == array).all(), name


def test_smooth_cloth_is_round_and_stays_in_its_corners(rng):
    n = 9
    angle = np.linspace(0, np.pi, n)
    mesh = tc.grid(1.0, n - 1)
    u = mesh.corner_uv.reshape(-1, 2)[np.argsort(mesh.faces.ravel(), kind="stable")][
        np.searchsorted(np.sort(mesh.faces.ravel()), np.arange(mesh.vertex_count))]
    arc = np.column_stack([np.cos(np.pi * u[:, 0]), np.sin(np.pi * u[:, 0]), u[:, 1]])  # half a tube of radius 1
    fine = Smooth(mesh.faces, mesh.vertex_count, 2)
    x = fine.points(arc)
    assert len(fine.faces) == 16 * mesh.face_count and len(x) == fine.count and fine.faces.max() < fine.count

    def kink(points, faces):
        """Largest angle between triangles that share an edge [rad]."""
        normal = np.cross(points[faces[:, 1]] - points[faces[:, 0]], points[faces[:, 2]] - points[faces[:, 0]])
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        sides = {}
        for f, face in enumerate(faces.tolist()):
            for k in range(3):
                sides.setdefault(frozenset((face[k], face[k - 1])), []).append(f)
        return max(np.arccos(np.clip(normal[s[0]] @ normal[s[1]], -1, 1)) for edge, s in sides.items()
                   if len(s) == 2 and all(0.2 < points[p, 2] < 0.8 for p in edge))

    assert kink(x, fine.faces) < 0.6 * kink(arc, mesh.faces) and kink(arc, mesh.faces) == pytest.approx(angle[1], rel=0.01)
    inner = np.hypot(x[:, 0], x[:, 1])
    assert inner.max() < 1 + 1e-9 and inner.min() > 0.95
    flat = fine.points(np.column_stack([u, np.zeros(len(u))]))
    corners = fine.corners(mesh.corner_uv)
    area = np.abs(np.cross(*(flat[fine.faces[:, k]] - flat[fine.faces[:, 0]] for k in (1, 2)))[:, 2]).sum() / 2
    assert area == pytest.approx(1.0, abs=1e-9), "a flat sheet stays one, with its corners"
    assert np.abs(fine.linear(u)[fine.faces] - corners).max() < 1e-12, "uv and vertices go together"


@pytest.mark.parametrize("level", [1, 2, 3])
def test_smooth_cloth_comes_no_nearer_to_a_solid(level):
    """A dome over a body, and a valley on a floor; every third vertex hovers, and is pushed by nothing."""
    mesh = tc.grid(1.0, 10)
    flat, n = mesh.x - mesh.x.mean(axis=0), mesh.vertex_count
    smooth = Smooth(mesh.faces, n, level)
    push = np.tile([0.0, 0.3, 0.0], (n, 1)) * (np.arange(n) % 3 > 0)[:, None]
    for bend in (-0.6, 0.6):
        x = flat + [0, bend, 0] * (flat[:, :1] ** 2 + flat[:, 2:] ** 2)
        free, held, triangles = smooth.points(x), smooth.points(x, push), smooth.linear(x)
        assert (held[:, 1] >= np.maximum(triangles, free)[:, 1] - 1e-12).all()
        assert np.abs((held - free)[:, [0, 2]]).max() < 1e-12 and (smooth.points(x, 0 * push) == free).all()
        if bend < 0:
            assert (free[:n, 1] < x[:n, 1] - 1e-3).sum() > n / 2, "without the body it would shrink"
            between = held[n:, 1] - triangles[n:, 1]
            assert between.max() > 1e-4, "and it is round between vertices"


def dome(radius: float, cells: int = 8) -> tuple[np.ndarray, np.ndarray]:
    """(vertices, faces) of a cap of a sphere about the origin."""
    mesh = tc.grid(2 * radius, cells)
    flat = 0.6 * (mesh.x - mesh.x.mean(axis=0))[:, [0, 2]]
    up = np.sqrt(radius**2 - (flat**2).sum(axis=1))
    return np.column_stack([flat[:, 0], up, flat[:, 1]]), mesh.faces


def test_smooth_cloth_keeps_to_its_side_without_any_force():
    """As in frame 0: a cap 3 mm over a solid and one 3 mm over the other; a third is far off."""
    (x, faces), n = dome(0.1), 81
    solid = x * 0.97
    whole = np.concatenate([x, x * 1.03, x * 1.3])
    geometry = {"x": whole, "faces": np.concatenate([faces + n * k for k in range(3)]), "cloth_start": n * np.arange(4),
                "cloth_thickness": np.full(3, 0.003), "solid_x": solid, "solid_faces": faces, "solid_start": np.array([0, n]),
                "solid_thickness": np.array([0.003])}
    near = nearby(geometry, {"x": whole.astype(np.float32)}, np.zeros((3 * n, 3)))
    assert near.push[:n].any(axis=1).all() and not near.push[2 * n:].any()
    assert (np.einsum("ij,ij->i", near.push[:n], x) > 0.9 * 0.1).all(), "outwards"
    assert near.layered[: 2 * n].all() and not near.layered[2 * n:].any()
    smooth = Smooth(geometry["faces"], 3 * n, 1)
    fine, triangles, free = smooth.points(whole, near.push, near.layered), smooth.linear(whole), smooth.points(whole)
    kept = np.isin(np.arange(smooth.count), smooth.faces[: 2 * 4 * len(faces)])
    assert np.abs(fine - triangles)[kept].max() < 1e-12 < 1e-3 < np.abs(free - triangles)[kept].max()
    assert (fine == free)[~kept].all()
    artist = Artist.__new__(Artist)
    artist.geometry, artist.smooth, artist.shell = geometry, smooth, None
    drawn = artist.points({"x": whole, "contact": np.zeros_like(whole)})
    assert (drawn == np.concatenate([fine, solid])).all(), "so is the picture"
    alone = nearby(geometry | {"cloth_thickness": np.full(3, np.nan)}, {"x": whole}, None)
    assert not alone.layered.any() and alone.push[:n].any(axis=1).all()


def test_smooth_cloth_keeps_off_the_floor_that_is_drawn_as_ground(rng):
    """As in frame 0, where no force is recorded yet; cloth well above it is rounded as ever."""
    mesh, scene = tc.grid(0.5, 8), tc.Scene()
    x = mesh.x + [0, 0.2, 0] + np.abs(rng.normal(scale=2e-3, size=mesh.x.shape)) * [0, 1, 0] + [0, 0.004, 0]
    for k, up in enumerate((0.0, 0.1)):
        scene.add_cloth(mesh, tc.Fabric(0.2), x + [0, up, 0], name=f"cloth {k}")
    scene.add_solid(tc.Plane(), 0.3, 0.004, position=(0, 0.2, 0))
    scene.add_prop(tc.Plane(), position=(0, 0.25, 0))  # drawn, and no cloth meets it
    geometry = record.as_built(scene)
    both, n = geometry["x"], len(x)
    push = nearby(geometry, {"x": both}, None).push
    assert np.array_equal(push.any(axis=1), np.append(x[:, 1] < 0.206, np.zeros(n, dtype=bool))) and push[:n].any()
    smooth = Smooth(geometry["faces"], 2 * n, 1)
    fine, triangles, free = smooth.points(both, push), smooth.linear(both), smooth.points(both)
    low = triangles[:, 1] < 0.2055
    assert (fine >= triangles - 1e-12)[low, 1].all() and (free < triangles - 1e-5)[low, 1].any()
    high = triangles[:, 1] > 0.29
    assert (fine == free)[high].all()


def test_a_pocket_is_a_layer_and_neighbours_are_none():
    """A flat garment with a pocket 2 mm over it, sewn at one edge, of triangles that are finer than its thickness or not."""
    for edge in (0.02, 0.002):
        mesh = tc.grid(6 * edge, 6)
        x, n = mesh.x, mesh.vertex_count
        over = x + [0, min(0.4 * edge, 0.002), 0]
        seam = np.flatnonzero(x[:, 0] == x[:, 0].min())
        sewn = np.arange(2 * n)
        sewn[n + seam] = seam
        over[seam] = x[seam]
        geometry = {"faces": np.concatenate([mesh.faces, mesh.faces + n]), "cloth_start": np.array([0, 2 * n]), "sewn": sewn,
                    "cloth_thickness": np.array([0.003]), "x": np.concatenate([x, over])}
        assert nearby(geometry, {"x": geometry["x"]}, None).layered.all()
        apart = np.concatenate([x, x + [0, 0, 6 * edge]])  # beside it, sewn to it: no layer
        rim = np.flatnonzero(x[:, 2] == x[:, 2].max())
        sewn = np.arange(2 * n)
        sewn[n + np.flatnonzero(x[:, 2] == x[:, 2].min())] = rim
        assert not nearby(geometry | {"x": apart, "sewn": sewn}, {"x": apart}, None).layered.any()


def test_a_large_triangle_under_a_small_patch_is_near_it_and_so_is_all_that_is_sewn_there():
    """No corner of the large one is near the patch. Sewn to a corner of it is a triangle that is near nothing."""
    large, patch = np.array([(0, 0, 0), (1, 0, 0), (0, 0, 1.0)]), tc.grid(0.1, 2)
    small, far = patch.x - patch.x.mean(axis=0) + [0.3, 0.003, 0.3], np.array([(1, 0, 0), (2, 0, 0), (1, 0, -1.0)])
    x = np.concatenate([large, far, small])
    faces = np.concatenate([[[0, 1, 2], [3, 4, 5]], patch.faces + 6])
    sewn = np.arange(len(x))
    sewn[3] = 1
    geometry = {"faces": faces, "cloth_start": np.array([0, 6, len(x)]), "sewn": sewn, "x": x,
                "cloth_thickness": np.full(2, 0.003)}
    layered = nearby(geometry, {"x": x}, None).layered
    assert layered[[0, 1, 2, 3]].all() and not layered[[4, 5]].any() and layered[6:].all()


def test_smooth_garments_have_no_gap_at_seams():
    faces = np.array([[0, 1, 2], [3, 5, 4]])  # two triangles side by side over the edge 1-2, sewn to 3-4... as vertices 3, 4
    sewn = np.array([0, 1, 2, 1, 2, 5])
    fine = Smooth(faces, 6, 1, sewn)
    x = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 0, 0], [0, 1, 0], [1, 1, 1.0]])
    used = np.unique(fine.faces)
    points = fine.points(x)[used]
    assert len(np.unique(points.round(12), axis=0)) == len(used) == 9, "what is sewn is one: no point is there twice"


@pytest.mark.parametrize("quality, wide, uneven", [("fast", 5, 0.15), ("standard", 7, 0.2)])
def test_the_edge_of_a_shadow_has_no_steps(quality, wide, uneven):
    """Half a metre of cloth over ten metres: a sample of the quick map is five pixels, and a ray goes from every fifth pixel
    each way. Shade is a matter of the distance from the edge's shadow alone, which is where the light's direction says."""
    scene, c, s, light = tc.Scene(), np.cos(0.3), np.sin(0.3), np.array([0.3, 1.0, 0.2])
    scene.add_cloth(tc.grid(10.0, 2), FABRIC, tc.grid(10.0, 2).x - [5, 0, -5], color=tc.Appearance("white", squares=False))
    turned = (tc.grid(0.5, 2).x - [0.25, 0, -0.25]) @ np.array([[c, 0, -s], [0, 1, 0], [s, 0, c]])
    scene.add_cloth(tc.grid(0.5, 2), FABRIC, turned + [0, 0.3, 0])
    middle = np.array([-0.25 * c, 0.3, 0.25 * s]) - 0.3 * light  # of an edge's shadow
    camera = Camera(tuple((middle + [0, 0.25, 0]).tolist()), tuple(middle.tolist()), 40.0)
    runtime.go_on()
    g = record.as_built(scene)
    look = Look(camera=camera, light=tuple(light.tolist()), quality=quality)
    image = Artist(g, SIZE, look).draw({"t": np.array(0.0), "x": g["x"]})
    a, b = frame(camera).project(middle + np.outer([-0.05, 0.05], [s, 0, c]), *SIZE)[:, :2]
    along = (b - a) / np.linalg.norm(b - a)
    rows, columns = np.mgrid[:SIZE[1], :SIZE[0]] + 0.5
    off = (columns - a[0]) * along[1] - (rows - a[1]) * along[0]
    shade = (image[..., 1] - float(image[..., 1].min())) / np.ptp(image[..., 1].astype(float))
    spread = [np.ptp(shade[(off > k) & (off < k + 1)]) for k in range(-40, 40)]
    assert np.ptp(off) > 100 and max(spread) < uneven and np.abs(off[np.abs(shade - 0.5) < 0.1]).max() < wide


def test_a_run_is_framed_by_what_is_known_of_it():
    """A sheet hung up by its upper edge that lies flat at first, led up by a metre; a ball on its way."""
    scene = tc.Scene()
    cloth = scene.add_cloth(tc.grid(1.0, 4), FABRIC)
    scene.move(cloth, "top", lambda t: (0, t, 0), relative=True)
    scene.add_solid(tc.Sphere(0.1), 0.3, 0.005, position=lambda t: (3 * t, 0, 0))
    frames = list(expected(scene, 1.0))
    x = np.concatenate([f["x"] for f in frames])
    solids = np.concatenate([f["solid_x"] for f in frames if "solid_x" in f])
    assert x[:, 1].max() == pytest.approx(1.0) and x[:, 1].min() < -0.4 and solids[:, 0].max() == pytest.approx(3.1, abs=0.01)
    one = tc.Scene()
    one.pin(one.add_cloth(tc.grid(1.0, 4), FABRIC), "top_left")
    assert np.concatenate([f["x"] for f in expected(one, 1.0)])[:, 1].min() == pytest.approx(-np.sqrt(2))
    free = tc.Scene()
    free.add_cloth(tc.grid(1.0, 4), FABRIC, positions=tc.grid(1.0, 4).x + [0, 2, 0])
    free.add_solid(tc.Plane(), 0.3, 0.005, position=(0, -1, 0))
    assert np.concatenate([f["x"] for f in expected(free, 1.0)])[:, 1].min() == -1.0


def test_colours_of_what_is_drawn(sim):
    g = record.geometry(sim)
    drawn = surfaces(g, Look(cloths={"sheet": tc.Appearance("red", "#0000ff")}), None)
    cloth = drawn.owner == 0
    assert (drawn.colors[cloth] == [1, 0, 0]).all() and (drawn.backs[cloth] == [0, 0, 1]).all()
    assert np.allclose(drawn.colors[~cloth], 0.2159, atol=1e-3)
    half = np.full((4, 4, 4), 255, np.uint8)
    half[:2, :, :3] = 0
    drawn = surfaces(g, Look(cloths={"sheet": tc.Appearance(texture=tc.Texture(half))}), None)
    assert np.allclose(drawn.mean_color(0, True), 0.5, atol=0.01)
    with pytest.raises(tc.SceneError, match="no cloth 'shet'; did you mean 'sheet'"):
        Artist(g, SIZE, Look(cloths={"shet": tc.Appearance("red")}))
    assert appearance("c", None).color is None and frame(AHEAD).near > 0


@ti.data_oriented
class Rows:
    """How often a loop over rows came to each."""

    def __init__(self, height: int, wide: bool) -> None:
        self.fields, self.height = Fields(np.float32), height
        self.raster = Raster(self.fields, 1, height)
        self.fields.allocate()
        self.raster.grain = 1 if wide else self.raster.grain
        self.turns = self.raster.turns(height)

    @ti.kernel
    def count(self, times: ti.types.ndarray()):
        for t in range(self.turns):
            row = self.raster.row(t, self.turns, self.height)
            if row < self.height:
                times[row] += 1


@pytest.mark.parametrize("height", [1, 15, 16, 17, 480, 719])
@pytest.mark.parametrize("wide", [False, True])
def test_every_row_has_one_turn(height, wide):
    runtime.go_on()
    rows, times = Rows(height, wide), np.zeros(height, np.int32)
    rows.count(times)
    assert (times == 1).all()
    rows.fields.free()


@pytest.mark.parametrize("low, high, ends", [(0.9, 1.1, ["0.9 or less", "1.1 or more"]), (0.0, 20.0, ["0", "20 or more"]),
                                             (-3.0, 0.0, ["-3 or less", "0"])])
def test_the_bar_says_that_colours_end_where_it_does(monkeypatch, low, high, ends):
    """A stretch of 1.6 has the colour of 1.1: without a word it was read as 1.1."""
    written = []
    monkeypatch.setattr(colors, "draw_text", lambda image, text, *at: written.append((text, at[0])))
    image = np.zeros((360, 640, 3), dtype=np.uint8)
    colors.draw_bar(image, low, high, True, "stretch")
    texts = [text for text, _ in written]
    assert texts == ["stretch", *ends]
    right = written[2][1] + len(ends[1]) * 6
    assert written[1][1] + len(ends[0]) * 6 < written[2][1] and right < 640, "one beside the other"
