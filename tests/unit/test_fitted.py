"""A pattern is brought to a body of another size, that stands elsewhere and faces another way: measured afresh."""

import pathlib
import re
import runpy
from contextlib import nullcontext
from dataclasses import replace

import numpy as np
import pytest
from reference.geometry import count_crossings, winding

import taichi_cloth as tc
from taichi_cloth.garment.clear import exit_from, hung_clear, pieces_of
from taichi_cloth.garment.figure import AT, measured, surface_of
from taichi_cloth.garment.fitted import DRAWN_FOR
from taichi_cloth.garment.limbs import round_limbs

TORSO, HIPS = 2 * np.pi * 0.098 + 4 * 0.05, 2 * np.pi * 0.12 + 4 * 0.055  # m round two capsules side by side
THICKNESS = 0.003
SCENES = pathlib.Path(__file__).parents[2] / "scenes"


def shipped() -> tc.Scene:
    """The figure round which shipped patterns hang."""
    scene = tc.Scene()
    runpy.run_path(str(SCENES / "dress_up.py"))["figure"](scene, 0.4)
    return scene


def somebody(size: float = 1.0, turn: float = 0.0, at: tuple[float, float] = (0.0, 0.0), wide: float = 1.0) -> tc.Scene:
    """That figure, with feet, so many times as large, turned [degrees] from z towards x, standing elsewhere, and so many
    times as wide."""
    old, body = shipped(), tc.Scene()
    for x in (-0.165, 0.165):
        old.add_solid(tc.Capsule((x, 0.08, 0.0), (x, 0.08, 0.16), 0.05), friction=0.4, thickness=0.004)
    for k, solid in enumerate(old.solids):
        a, b = (size * np.array(end) * [wide, 1, wide] for end in (solid.shape.a, solid.shape.b))
        body.add_solid(tc.Capsule(a, b, size * wide * solid.shape.radius), friction=0.4, thickness=0.004, name=f"part {k}",
                       position=(at[0], 0, at[1]), rotation=(0, np.radians(turn), 0))
    return body


def within(x: np.ndarray, body: tc.Scene) -> np.ndarray:
    """(n,) whether points are within any solid: by how often its surface goes round them."""
    return np.any([winding(x, s.surface_at(0.0), s.shape.surface()[1]) > 0.5 for s in body.solids], axis=0)


def skirt() -> tc.Garment:
    pytest.importorskip("scipy", reason="meshing patterns needs the extra `garment`")
    return tc.load_pattern(SCENES / "patterns" / "skirt.json").mesh(0.06)


def test_the_shipped_figure_has_the_measures_that_patterns_are_drawn_for():
    """By closed forms: girths of two capsules side by side, of hips and trunk; and it has what `DRAWN_FOR` says."""
    found = measured(*surface_of(shipped()))
    assert found.girths[AT > 0.35] == pytest.approx(TORSO, rel=0.02) and found.girths[0] == pytest.approx(HIPS, rel=0.02)
    assert 0.80 < found.crotch < 0.86 and found.neck == pytest.approx(1.385 + 0.06, abs=0.02)
    assert found.crotch == pytest.approx(DRAWN_FOR.crotch, abs=2e-3) and found.neck == pytest.approx(DRAWN_FOR.neck, abs=2e-3)
    assert found.girths == pytest.approx(DRAWN_FOR.girths, rel=5e-3) and found.centre == pytest.approx([0, 0], abs=1e-3)
    assert not found.faces  # it has no feet


@pytest.mark.parametrize("size, turn, at", [(0.8, 70.0, (1.2, -0.4)), (1.3, -130.0, (-3.0, 2.0))])
def test_a_skirt_goes_where_a_body_stands_and_faces(size, turn, at):
    """Its panels are where they are round the shipped figure, as the body is; what they are cut like is as large."""
    garment, body = skirt(), somebody(size, turn, at)
    found = measured(*surface_of(body))
    assert found.faces and (found.turn - turn + 180) % 360 - 180 == pytest.approx(0, abs=2)
    made, notes = tc.fitted(garment, body, THICKNESS)
    c, s = np.cos(np.radians(turn)), np.sin(np.radians(turn))
    there = size * garment.positions @ np.array([[c, 0, -s], [0, 1, 0], [s, 0, c]]) + [at[0], 0, at[1]]
    assert np.abs(made.positions - there).max() < 0.03 * size and len(notes) == 1
    edge = np.sort(garment.mesh.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    was, now = (np.linalg.norm(g.mesh.uv[edge[:, 0]] - g.mesh.uv[edge[:, 1]], axis=1) for g in (garment, made))
    assert now / was == pytest.approx(size, rel=0.03)
    hangs = np.linalg.norm(made.positions[edge[:, 0]] - made.positions[edge[:, 1]], axis=1)
    assert hangs == pytest.approx(now, rel=1e-6)  # no panel is strained where it hangs


@pytest.mark.parametrize("turn", [0.0, 90.0, -160.0])
def test_a_round_body_without_arms_faces_where_its_toes_are(turn):
    body = tc.Scene()
    ends = [((0, 0.75, 0), (0, 0.95, 0), 0.1), ((0, 0.95, 0), (0, 1.2, 0), 0.04)]
    for x in (-0.06, 0.06):
        ends += [((x, 0.08, 0), (x, 0.65, 0), 0.05), ((x, 0.04, 0), (x, 0.04, 0.12), 0.04)]
    for k, (a, b, r) in enumerate(ends):
        body.add_solid(tc.Capsule(a, b, r), friction=0.4, thickness=0.004, name=str(k), position=(2, 0, 1),
                       rotation=(0, np.radians(turn), 0))
    found = measured(*surface_of(body))
    assert found.faces and (found.turn - turn + 180) % 360 - 180 == pytest.approx(0, abs=2)
    assert found.centre == pytest.approx([2, 1], abs=0.01)


def test_a_thinner_body_gets_a_narrower_garment_that_is_as_long():
    garment = skirt()
    made, _ = tc.fitted(garment, somebody(wide=0.7), THICKNESS)
    wide, tall = (np.ptp(made.positions, axis=0) / np.ptp(garment.positions, axis=0))[:2]
    assert wide == pytest.approx(0.7, rel=0.03) and 0.9 < tall < 1.01  # the trunk of thinner hips is a little shorter


def test_panels_that_start_within_a_body_come_out():
    """A front 5 cm before the middle of the hips, by as little as clears it; a back that is clear stays. Counted afresh."""
    body, garment = somebody(), skirt()
    front = garment.mesh.groups["front"]
    close = garment.moved("front", (0, 0, 0.05 - garment.positions[front, 2].mean()))
    assert within(close.positions, body).sum() > 10
    made, notes = hung_clear(close, body, THICKNESS)
    assert not within(made.positions, body).any()
    assert not any(count_crossings(made.positions, garment.mesh.faces, s.surface_at(0.0), s.shape.surface()[1])
                   for s in body.solids)
    assert "'front' was hung" in notes[0] and len(notes) == 1
    by = made.positions - close.positions
    assert np.ptp(by[front], axis=0).max() < 1e-9 and (np.delete(by, front, axis=0) == 0).all()
    assert 0.05 + by[front, 2].max() < 0.17  # the hips reach .12 m


@pytest.mark.slow
@pytest.mark.parametrize("size, drop, ahead", [(0.85, 10.0, 25.0), (1.1, 55.0, -10.0), (0.9, -10.0, 0.0)])
def test_sleeves_go_round_arms_that_are_held_another_way(size, drop, ahead):
    """Patterns hang round arms that drop by 45 degrees. The arm's line is in the middle of each sleeve, and the way in, where
    it is not sewn yet, is less than half of the way round."""
    pytest.importorskip("scipy", reason="meshing patterns needs the extra `garment`")
    garment, body = tc.load_pattern(SCENES / "patterns" / "shirt.json").mesh(0.05), tc.Scene()
    down, fore = np.radians([drop, ahead])
    out, front = np.cos(down) * np.array([np.cos(fore), np.sin(fore)])
    ways = {side: np.array([side * out, -np.sin(down), front]) for side in (1, -1)}
    for solid in somebody(size).solids:
        a, b, r = np.array(solid.shape.a), np.array(solid.shape.b), solid.shape.radius
        if abs(b[0]) > 0.4 * size:  # an arm
            b = a + size * 0.5 * ways[np.sign(b[0])]
        body.add_solid(tc.Capsule(a, b, r), friction=0.4, thickness=0.004, name=solid.name)
    made, _ = tc.fitted(garment, body, THICKNESS)
    for name, side in (("right sleeve", 1), ("left sleeve", -1)):
        x, way = made.positions[garment.mesh.groups[name]] - size * np.array([side * 0.17, 1.39, 0.0]), ways[side]
        off = x - (x @ way)[:, None] * way
        far = np.linalg.norm(off, axis=1)
        assert far.min() > 0.042 * size and np.ptp(far) < 0.03, name
        first = np.cross(way, [0.0, 0.0, 1.0])
        angle = np.sort(np.arctan2(off @ np.cross(way, first), off @ first))
        assert np.diff(np.append(angle, angle[0] + 2 * np.pi)).max() < np.pi, name


def test_a_collar_is_moved_to_a_neck_and_stays_level():
    """It is shorter than wide: a neck that leans by 30 degrees, cut eight times in 4 cm, does not turn it."""
    uv = np.stack(np.meshgrid(np.linspace(0.0, 0.4, 21), np.linspace(0.0, 0.04, 5)), axis=-1).reshape(-1, 2)
    x = np.column_stack([0.08 * np.cos(uv[:, 0] / 0.08), 1.4 + uv[:, 1], 0.08 * np.sin(uv[:, 0] / 0.08)])
    faces = np.array([[k, k + 1, k + 21 + j] for k in range(84) if k % 21 < 20 for j in (0, 1)])
    collar = tc.Garment(tc.TriMesh(x, faces, uv), ())
    neck = tc.Scene()
    lean = np.array([0.0, np.cos(np.pi / 6), np.sin(np.pi / 6)])
    place = np.array([0.02, 1.42, 0.01])
    neck.add_solid(tc.Capsule(place - 0.3 * lean, place + 0.3 * lean, 0.05), friction=0.4, thickness=0.004)
    made = round_limbs(collar, *surface_of(neck)).positions
    assert np.ptp(made - x, axis=0).max() < 1e-12 and (made - x)[0] == pytest.approx([0.02, 0.0, 0.01], abs=2e-3)


def test_lines_leave_a_body_by_where_they_are_within_it():
    """A cube of 2 m: from its middle 1 m, from 0.3 m before its side 0.3 m; from outside, or past a second cube, nothing."""
    x, faces = tc.Box((2.0, 2.0, 2.0)).surface()
    points = np.array([[0.1, 0.2, 0.0], [0.3, 0.1, 0.7], [0.2, 0.1, -1.5]])
    ways = np.tile([0.0, 0.0, 1.0], (3, 1))
    for solid in somebody().solids:
        assert [closed for *_, closed in pieces_of(solid.surface_at(0.0), solid.shape.surface()[1])] == [True]
    for rows, far in (([0, 1, 2], 1.0), ([1, 2], 0.3), ([2], 0.0)):
        assert exit_from(points[rows], ways[rows], 9.0, x, faces) == pytest.approx(far, abs=1e-4)


def forked(x: float) -> list[tuple]:
    """Capsules (ends, radius) of a thick arm that hangs at x, well above the floor: two fingers, a forearm, a thin end."""
    return [((x, 0.9, 0), (x, 1.1, 0), 0.2), ((x, 1.3, 0), (x, 1.6, 0), 0.05),
            *(((x + off, 0.5, 0), (x + off, 0.8, 0), 0.06) for off in (-0.1, 0.1))]


def test_a_thick_arm_beside_a_body_is_not_its_trunk():
    """Half way up the arm is wider than the trunk, and it parts below; the feet are under the trunk."""
    body = somebody()
    for k, (a, b, r) in enumerate(forked(1.2)):
        body.add_solid(tc.Capsule(a, b, r), friction=0.4, thickness=0.004, name=f"arm {k}")
    found, alone = measured(*surface_of(body)), measured(*surface_of(somebody()))
    assert found.centre == pytest.approx(alone.centre, abs=0.01) and found.girths == pytest.approx(alone.girths, rel=0.02)


def test_a_waist_narrower_than_the_neck_is_not_the_neck():
    """As some robots have it, whose hips and chest meet in a joint."""
    body = tc.Scene()
    for solid in somebody().solids:
        a, b, r = solid.shape.a, solid.shape.b, solid.shape.radius
        if a[1] == 0.98:
            a = (a[0], 1.24, 0.0)
        body.add_solid(tc.Capsule(a, b, r), friction=0.4, thickness=0.004, name=solid.name)
    body.add_solid(tc.Capsule((0, 1.0, 0), (0, 1.2, 0), 0.04), friction=0.4, thickness=0.004, name="joint")
    found, usual = measured(*surface_of(body)), measured(*surface_of(somebody()))
    assert found.girths.min() < 0.3 < usual.girths.min()
    assert found.neck == usual.neck


@pytest.mark.parametrize("high", [1.26, 1.2])
def test_arms_that_are_stretched_out_are_no_girth_of_the_trunk(high):
    """As of a soldier with a collar as wide as a trunk: his neck is found high up, and his shoulders far below it."""
    body = somebody()
    body.add_solid(tc.Capsule((-0.8, high, 0), (0.8, high, 0), 0.06), friction=0.4, thickness=0.004, name="arms")
    found = measured(*surface_of(body))
    level = found.crotch + AT * (found.neck - found.crotch)
    assert (np.abs(level - high) < 0.06).any()
    assert found.girths == pytest.approx(measured(*surface_of(somebody())).girths, rel=0.02)
    _, notes = tc.fitted(skirt(), body, THICKNESS)
    assert notes[0].startswith("the garment is made 1 times as wide")


def test_where_nothing_is_over_the_feet_there_is_no_trunk():
    body = tc.Scene()
    feet = [((x, 0.1, 0), (x, 0.1, 0.1), 0.09) for x in (-0.15, 0.15)]
    for k, (a, b, r) in enumerate(feet + forked(1.2)):
        body.add_solid(tc.Capsule(a, b, r), friction=0.4, thickness=0.004, name=f"part {k}")
    with pytest.raises(tc.SceneError, match=r"over its feet, whose middle is \(0, .* 1.26 m round, at \(1.2, .*out --fit"):
        tc.fitted(skirt(), body, THICKNESS)


def test_a_trunk_as_wide_as_no_persons_is_refused_with_its_girths():
    """Capsules whose sections are 2.1 times as wide: the waist that is told is that of the figure, as many times."""
    with pytest.raises(tc.SceneError, match="times as wide .*as no person is.*leave out --fit") as told:
        tc.fitted(skirt(), somebody(wide=2.1), THICKNESS)
    girths = str(told.value).split("girths of ")[1].split(" m from below")[0].split(", ")
    assert float(girths[-1]) == pytest.approx(2.1 * TORSO, rel=0.05)  # rounder ends reach into it


def in_one(parts: dict[str, tc.Scene]) -> tc.Scene:
    """A body of one mesh, whose groups are these parts."""
    surfaces = {name: surface_of(body) for name, body in parts.items()}
    first = np.cumsum([0, *(len(x) for x, _ in surfaces.values())])
    groups = {name: np.arange(a, b) for name, a, b in zip(parts, first, first[1:])}
    mesh = tc.SolidMesh(np.concatenate([x for x, _ in surfaces.values()]),
                        np.concatenate([f + a for (_, f), a in zip(surfaces.values(), first)]), groups=groups)
    body = tc.Scene()
    body.add_solid(mesh, friction=0.4, thickness=0.004)
    return body


@pytest.mark.slow
def test_advice_names_ways_that_are_open():
    """Of a figure in a barrel the part that is a person; of one part alone no parts; a scale that makes it as wide."""
    barrel = tc.Scene()
    barrel.add_solid(tc.Cylinder(0.5, 0.9), friction=0.4, thickness=0.004, position=(0, 1.1, 0))
    parts = {"figure": somebody(), "barrel": barrel}
    with pytest.raises(tc.SceneError, match="--only 'figure'$"):
        tc.fitted(skirt(), in_one(parts), THICKNESS, parts=["figure", "barrel"])
    wide = in_one({"figure": somebody(wide=2.1)})
    with pytest.raises(tc.SceneError) as told:
        tc.fitted(skirt(), wide, THICKNESS, parts=["figure"])
    said = str(told.value)
    assert "--only" not in said and "--clip" not in said
    x, faces = surface_of(wide)
    scaled = measured(float(re.search(r"--scale ([.\d]+) times", said)[1]) * x, faces)
    assert (scaled.girths / DRAWN_FOR.girths).max() == pytest.approx(1.0, rel=0.02)


@pytest.mark.parametrize("wide, long, right", [(0.5, 1.0, False), (0.6, 1.0, True), (1.7, 1.0, True), (2.0, 1.0, False),
                                               (2.0, 2.0, True), (1.0, 2.0, False)])
def test_width_and_length_of_a_trunk_belong_together(monkeypatch, wide, long, right):
    neck = DRAWN_FOR.crotch + long * (DRAWN_FOR.neck - DRAWN_FOR.crotch)
    figure = replace(DRAWN_FOR, neck=neck, girths=wide * DRAWN_FOR.girths)
    monkeypatch.setattr("taichi_cloth.garment.fitted.measured", lambda x, faces: figure)
    with nullcontext() if right else pytest.raises(tc.SceneError, match="as no person is"):
        tc.fitted(skirt(), somebody(), THICKNESS)


@pytest.mark.parametrize("neck, right", [(0.68, True), (0.62, False)])
def test_a_neck_half_way_up_is_a_gap(monkeypatch, neck, right):
    """As of a figure whose joints are another part of its file, which was left out."""
    body = somebody()
    top = max(s.surface_at(0.0)[:, 1].max() for s in body.solids)
    low = min(s.surface_at(0.0)[:, 1].min() for s in body.solids)
    figure = replace(DRAWN_FOR, neck=low + neck * (top - low), crotch=low + 0.4 * (top - low), girths=0.5 * DRAWN_FOR.girths)
    monkeypatch.setattr("taichi_cloth.garment.fitted.measured", lambda x, faces: figure)
    with nullcontext() if right else pytest.raises(tc.SceneError, match="neck would be at .* lower than any person's"):
        tc.fitted(skirt(), body, THICKNESS)


@pytest.mark.parametrize("shape, what", [(tc.Sphere(0.5), "no legs"), (None, "without solids")])
def test_what_is_no_body_is_named(shape, what):
    body = tc.Scene()
    if shape is not None:
        body.add_solid(shape, friction=0.4, thickness=0.004)
    with pytest.raises(tc.SceneError, match=what):
        tc.fitted(skirt(), body, THICKNESS)
