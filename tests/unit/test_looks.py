"""Lights, highlights, hems, thickness, lens and shutter, each against what can be worked out by hand."""

from dataclasses import replace

import numpy as np
import pytest

import taichi_cloth as tc
from taichi_cloth.output import rig
from taichi_cloth.output.camera import frame
from taichi_cloth.output.exposure import between, spots
from taichi_cloth.output.hems import NEAREST, borders, distance, half_edges
from taichi_cloth.output.look import Look
from taichi_cloth.output.picture import Artist
from taichi_cloth.output.shell import Shell
from taichi_cloth.recording import record
from taichi_cloth.scene.view import Camera, View

AHEAD = Camera((0.5, 0.5, 3), (0.5, 0.5, 0), fov=2 * np.degrees(np.arctan(0.25)))  # 80 pixels of 120 are a metre at z = 0
PLAIN = {"background": "transparent", "floor": "none"}


@pytest.fixture(scope="module")
def geometry():
    """A square metre that faces the camera, with a ball behind it."""
    scene = tc.Scene(view=View(AHEAD, ground=-5.0))
    scene.add_cloth(tc.grid(1.0, 4, plane="xy"), tc.Fabric(0.2, tc.Stretch(100)), name="sheet", color="white")
    with tc.Simulation(scene) as sim:
        yield record.geometry(sim)


def light(geometry, moved=None, next_=None, size=(120, 120), **look):
    """(h, w, 4) linear light of the sheet, at velocities of 0."""
    still = {"t": np.array(0.0), "x": geometry["x"], "v": np.zeros_like(geometry["x"])}
    return Artist(geometry, size, Look(**look)).light(still | (moved or {}), next_=next_)


def test_edges_are_what_is_covered(geometry):
    """An edge that is nearly level, against the same one in 32 x 32 samples of a pixel."""
    tilt = Camera(AHEAD.eye, AHEAD.target, AHEAD.fov, up=(0.06, 1, 0))
    alpha = light(geometry, camera=tilt, **PLAIN)[..., 3]
    corners = frame(tilt).project(np.array([[0, 1.0, 0], [1, 1, 0]]), 120, 120)[:, :2]
    (x, y), slope = corners[0], np.diff(corners[:, 1])[0] / np.diff(corners[:, 0])[0]
    at = (np.arange(40 * 32) + 0.5) / 32
    inside = at[:, None] > y + slope * (40 + at[None] - x)
    covered = inside.reshape(40, 32, 40, 32).mean(axis=(1, 3))
    part = (covered > 0) & (covered < 1)
    assert part.sum() > 40 and np.sqrt(np.mean((alpha[:40, 40:80] - covered)[part] ** 2)) < 0.11, "a quarter at most"
    assert len(np.unique(alpha[:40, 40:80].round(3))) == 5


@pytest.mark.parametrize("quality", ["fast", pytest.param("standard", marks=pytest.mark.slow)])
def test_grey_under_a_white_sky_is_that_grey(geometry, monkeypatch, quality):
    monkeypatch.setitem(rig.RIGS, "soft", replace(rig.RIGS["soft"], up=(1, 1, 1), down=(1, 1, 1)))
    matt = {"": tc.Appearance((0.5, 0.25, 0.125), squares=False, sheen=0, specular=0)}
    seen = light(geometry, light="soft", cloths=matt, quality=quality, **PLAIN)
    assert seen[25:95, 25:95] == pytest.approx(np.broadcast_to([0.5, 0.25, 0.125, 1], (70, 70, 4)), abs=1e-6)


@pytest.mark.parametrize("name", ["day", "sun"])
def test_ground_near_the_cloth_has_no_haze_and_the_horizon_has_no_edge(geometry, name):
    """In the sun beside it, as light and colour say; far away it is the sky's."""
    lights, up = rig.RIGS[name], np.array([0.0, 1.0, 0.0])
    key = np.array(lights.key) / np.linalg.norm(lights.key)
    colour = np.array(lights.floor) * (np.array(lights.power) * (key @ up) + np.array(lights.up))
    camera = Camera((0.5, 1.0, 3.0), (0.5, 0.0, 0.0), fov=50.0)
    g = geometry | {"ground": np.array(-1.0)}
    seen = light(g, light=name, camera=camera, floor="plain")
    assert seen[-1, 110, :3] == pytest.approx(colour, rel=0.03)
    level = int(frame(camera).project(np.array([[0.5, 1.0, -1e6]]), 120, 120)[0, 1])
    assert np.abs(np.diff(seen[: 60, 110, :3], axis=0)).max() < 0.08 and level < 60
    assert seen[level + 1, 110, :3] == pytest.approx(lights.horizon, rel=0.15)


def test_a_highlight_holds_the_light_that_is_thrown_back(geometry, monkeypatch):
    """All of it over the half space, by the pixels of a wide camera near the sheet: each sees it from another side."""
    fov, n = 150.0, 160
    alone = replace(rig.RIGS["day"], key=(0, 0, 1), power=(1, 1, 1), up=rig.DARK, down=rig.DARK)
    monkeypatch.setitem(rig.RIGS, "sun", alone)
    near = Camera((0.5, 0.5, 0.1), (0.5, 0.5, 0), fov)
    half = np.tan(np.radians(fov / 2))
    side = (np.arange(n) + 0.5) * 2 * half / n - half
    cos = 1 / np.sqrt(1 + side[:, None] ** 2 + side[None] ** 2)
    solid_angle = (2 * half / n) ** 2 * cos**3
    for part, roughness in ((0.3, 0.5), (0.1, 0.4)):
        shine = {"": tc.Appearance("black", squares=False, sheen=0, specular=part, roughness=roughness)}
        seen = light(geometry, size=(n, n), camera=near, light="sun", cloths=shine, **PLAIN)[..., 1]
        assert (seen * cos * solid_angle).sum() / np.pi == pytest.approx(part, rel=0.2)  # of what white cloth throws back
        middle = seen[n // 2, n // 2]
        assert seen.max() == pytest.approx(middle, rel=0.02) and seen[n // 2, n // 8] < middle / 3


def test_sheen_is_along_outlines(geometry):
    """As much of what white cloth throws back as the cube of what the view is off the normal."""
    steep = Camera((0.5, 0.5, 0.25), (0.5, 0.5, 0), 120)
    looks = (tc.Appearance(color, squares=False, sheen=sheen, specular=0) for color, sheen in
             (("white", 0), ("navy", 0), ("navy", 0.8)))
    white, matt, velvet = (light(geometry, camera=steep, cloths={"": one}, **PLAIN)[60, :, :3] for one in looks)
    across = (np.arange(120) + 0.5 - 60) / 60 * np.tan(np.radians(60))
    cos = 1 / np.sqrt(1 + across**2 + (0.5 / 60 * np.tan(np.radians(60))) ** 2)
    assert velvet - matt == pytest.approx((0.8 * (1 - cos) ** 3)[:, None] * white, abs=1e-5) and (velvet - matt).max() > 0.05


def test_lights_of_a_studio_stand_round_the_camera():
    for eye in ((0, 1, 3), (3, 1, 0), (-2, 1, -1)):
        camera = frame(Camera(eye, (0, 1, 0)))
        turned, first = rig.rig_of("studio", camera), rig.RIGS["studio"]
        for name in ("key", "fill", "rim"):
            assert camera.axes @ getattr(turned, name) == pytest.approx(getattr(first, name), abs=1e-12)
    assert rig.rig_of((1, 2, 3), camera).key == (1, 2, 3) and rig.rig_of("sun", camera) == rig.RIGS["sun"]
    assert View(background="white", light="studio").drawn_floor == "shadow"
    assert View(background="#ffffff", floor="plain").drawn_floor == "plain"
    assert View(background="transparent").drawn_floor == "none"
    assert View(light="studio").drawn_floor == "plain" and View(light="sun").drawn_floor == "checker"


@pytest.mark.slow
def test_named_lights_differ_and_fill_reaches_shadows(geometry):
    above = Camera((0.5, 3.0, 3), (0.5, -5.0, -1), 60)
    means = {name: light(geometry, light=name, camera=above, quality="standard").mean() for name in rig.RIGS}
    assert len({round(float(v), 3) for v in means.values()}) == len(rig.RIGS)
    one = {"": tc.Appearance("white", squares=False)}
    day = light(geometry, light="day", cloths=one)
    assert np.array_equal(day, light(geometry, cloths=one)), "the day is as usual"


def test_the_inner_edge_of_a_hem_is_a_line_without_steps(geometry):
    """Seen nearly level, 8 pixels wide: across it the shade is about the same in all places, wherever pixels' middles are."""
    tilt = Camera(AHEAD.eye, AHEAD.target, AHEAD.fov, up=(0.1, 1, 0))
    plain, hemmed = (light(geometry, camera=tilt, cloths={"": tc.Appearance("white", squares=False, **more)}, size=(240, 240),
                           **PLAIN)[..., 1] for more in ({}, {"hem": 0.05}))
    left, right = frame(tilt).project(np.array([[0, 1.0, 0], [1, 1, 0]]), 240, 240)[:, :2]
    way = (right - left) / np.linalg.norm(right - left)
    rows, columns = np.mgrid[:240, :240] + 0.5
    down = (rows - left[1]) * way[0] - (columns - left[0]) * way[1]  # pixels from the upper edge
    across = (rows - left[1]) * way[1] + (columns - left[0]) * way[0]
    within = (across > 20) & (across < 140)
    spread = []
    for k in np.arange(7, 9.5, 0.25):
        at = within & (np.abs(down - k) < 0.15)
        spread.append(np.ptp(hemmed[at] / plain[at]))
    assert max(spread) < 0.3


def test_a_hem_is_as_wide_as_it_says(geometry):
    def seen(**more):
        return light(geometry, cloths={"": tc.Appearance("white", squares=False, **more)}, **PLAIN)[..., 1]

    changed = np.abs(seen(hem=0.1) - seen()) > 1e-4  # 8 pixels; the sheet is from 20 to 100
    for middle in (changed[60], changed[60, ::-1], changed[:, 60], changed[::-1, 60]):
        at = np.flatnonzero(middle[:60])
        assert at.min() in (20, 21) and at.max() in (27, 28)
    assert not changed[29:91, 29:91].any() and changed[24, 24:96].any()


def test_borders_of_a_pattern_are_the_nearest_ones(rng):
    """Squares that are all cut the same way: two of the sheet's corners are one triangle's, with two borders."""
    x = np.stack(np.meshgrid(np.arange(11), np.arange(11)), axis=-1).reshape(-1, 2) / 10
    low = np.flatnonzero((x < 1).all(axis=1))
    faces = np.concatenate([low[:, None] + [0, 1, 12], low[:, None] + [0, 12, 11]])
    mesh = tc.TriMesh(np.column_stack([x, 0 * x[:, 0]]), faces)
    uv = x[mesh.faces]
    found = borders(mesh.faces, uv, np.full(mesh.face_count, 0.15)).reshape(-1, NEAREST, 4)
    k = rng.dirichlet([1, 1, 1], size=mesh.face_count)
    at = np.einsum("mc,mcd->md", k, uv)
    away = distance(at[:, None], found).min(axis=1)
    wanted = np.minimum(at, 1 - at).min(axis=1)
    near = wanted < 0.15
    assert near.sum() > 60 and np.abs(away - wanted)[near].max() < 1e-9
    assert (away[wanted > 0.3] > 1e3).all() and (borders(mesh.faces, uv, np.zeros(mesh.face_count)) > 1e5).all()
    two = np.concatenate([mesh.faces, mesh.faces + mesh.vertex_count])
    sewn = np.arange(2 * mesh.vertex_count)
    right, left = (np.flatnonzero(x[:, 0] == u) for u in (1, 0))
    sewn[mesh.vertex_count + left] = right
    assert (half_edges(two) == -1).sum() == 80 and (half_edges(sewn[two]) == -1).sum() == 60, "what is sewn has no hem"


def test_thick_cloth_is_closed_and_holds_its_volume():
    mesh, n = tc.grid((1.0, 2.0), 4), 25
    shell = Shell(mesh.faces, mesh.vertex_count, np.full(mesh.vertex_count, 0.02))
    x = shell.points(mesh.x)
    assert len(x) == shell.count and shell.faces.max() < shell.count
    turned = shell.faces.copy()
    back = slice(mesh.face_count, 2 * mesh.face_count)
    turned[back] = turned[back, ::-1]
    a, b, c = (x[turned[:, k]] for k in range(3))
    assert np.einsum("ij,ij", a, np.cross(b, c)) / 6 == pytest.approx(2.0 * 0.02), "all walls face outwards"
    _, at = np.unique(x.round(9), axis=0, return_inverse=True)
    assert (half_edges(at.reshape(-1)[turned]) >= 0).all()
    some = np.zeros(mesh.vertex_count)
    assert len(Shell(mesh.faces, mesh.vertex_count, some).faces) == mesh.face_count and n


def test_thick_cloth_shows_its_edge(geometry):
    aside = Camera((3.5, 0.5, 0), (0.5, 0.5, 0), AHEAD.fov)

    def across(**more):
        return light(geometry, camera=aside, cloths={"": tc.Appearance("white", **more)}, **PLAIN)[60, :, 3].sum()

    assert across() < 0.5 and across(thickness=0.1) == pytest.approx(0.1 * 0.25 / 0.5 * 120 / 0.625, abs=1.2)


def width(alpha):
    """Standard deviation [pixels] of the edge at the left of a profile."""
    step = np.diff(alpha[:60])
    at = np.arange(len(step))
    middle = (step * at).sum() / step.sum()
    return np.sqrt((step * (at - middle) ** 2).sum() / step.sum())


def test_a_lens_blurs_by_its_circle_of_confusion(geometry):
    def edge(**look):
        return width(light(geometry, cloths={"": tc.Appearance("white")}, **PLAIN, **look)[60, :, 3])

    focal = 0.5 / np.tan(np.radians(AHEAD.fov / 2)) * 120
    assert edge(aperture=0.15, focus=1.5) == pytest.approx(0.15 * focal * (1 / 1.5 - 1 / 3) / 4, rel=0.12)
    assert edge(aperture=0.15) < 0.6, "the middle of the cloth is sharp"


@pytest.mark.slow
def test_a_shutter_blurs_by_the_way_that_is_gone(geometry):
    moved = {"v": np.broadcast_to([1.5, 0, 0], geometry["x"].shape)}
    after = {"t": np.array(0.1), "x": geometry["x"] + [0.15, 0, 0], "v": moved["v"]}
    for next_ in ((None, 0.1), (after, 0.1)):
        alpha = light(geometry, moved, next_, shutter=0.8, cloths={"": tc.Appearance("white")}, **PLAIN)[60, :, 3]
        gone = 0.8 * 0.15 * 80
        assert width(alpha) == pytest.approx(gone / np.sqrt(12), rel=0.1)
        first = np.flatnonzero(alpha > 0.5)[0]
        assert first == pytest.approx(20 + gone / 2, abs=1), "it opens at the frame's own time"


def test_between_frames_cloth_falls_as_it_does(rng):
    x, v, g, h = rng.normal(size=(5, 3)), rng.normal(size=(5, 3)), np.array([0, -9.81, 0]), 0.04
    frames = [{"t": np.array(t), "x": x + t * v + t * t / 2 * g, "v": v + t * g, "solid_x": np.full((1, 3), t)}
              for t in (0, h)]
    for s in (0.0, 0.3, 1.0):
        out = between(*frames, s, h)
        t = s * h
        assert out["x"] == pytest.approx(x + t * v + t * t / 2 * g, abs=1e-12) and float(out["t"]) == pytest.approx(t)
        assert out["solid_x"] == pytest.approx(np.full((1, 3), t))
    time, lens, pixel = (np.array(a) for a in zip(*spots(64)))
    assert np.abs(np.diff(time) - 1 / 64).max() < 1e-12 and np.linalg.norm(lens, axis=1).max() <= 1
    assert np.abs(lens.mean(axis=0)).max() < 0.05 and (lens**2).sum(axis=1).mean() == pytest.approx(0.5, abs=0.03)
    assert np.abs(pixel).max() <= 0.5 and np.abs(pixel.mean(axis=0)).max() < 0.05


@pytest.mark.parametrize("make, what", [
    (lambda: Look(light="studoi"), "light 'studoi'; did you mean 'studio'"), (lambda: View(light="sunn"), "'sun'"),
    (lambda: Look(aperture=-1), "aperture = -1"), (lambda: Look(focus=0), "focus = 0"), (lambda: Look(shutter=1.5), "shutter"),
    (lambda: tc.Appearance(sheen=2), "sheen = 2"), (lambda: tc.Appearance(specular=-0.1), "specular"),
    (lambda: tc.Appearance(roughness=0.01), "roughness"), (lambda: tc.Appearance(hem=0), "hem = 0"),
    (lambda: tc.Appearance(thickness="a"), "thickness = 'a'"),
    (lambda: tc.render(tc.Scene(), shutter=0.5), "shutter: only a recorded run")])
def test_impossible_looks_are_named(make, what):
    with pytest.raises(tc.SceneError, match=what):
        make()
