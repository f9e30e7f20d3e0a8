"""Clothes over clothes: panels hang outside worn garments, and are sewn over them with contact from the start."""

import numpy as np
import pytest
from reference.geometry import count_crossings, count_self_crossings

import taichi_cloth as tc
from taichi_cloth.garment import dressing
from taichi_cloth.garment.outside import hung_outside
from taichi_cloth.garment.worn import Dressed

pytest.importorskip("scipy", reason="meshing patterns needs the extra `garment`")

FABRIC = tc.Fabric(0.19, tc.Stretch(400, 0.4), tc.Shear(50, 0.05), tc.Bend(2e-5, 2e-7))
CONTACT = tc.ClothContact(0.003, 0.3)


def trunk() -> tc.Scene:
    """A body that stands up, 27 cm wide."""
    scene = tc.Scene(air=tc.Air(0.5, 0.1))
    scene.add_solid(tc.Capsule((0, 0.5, 0), (0, 1.5, 0), 0.135), friction=0.8, thickness=0.004, name="trunk")
    return scene


def skirt(low: float, top: float, tall: float, y: float, z: float, *more: tc.Panel) -> tc.Pattern:
    """A front and a back of half widths `low` at the hem and `top` at the waist [m], sewn at the sides."""
    corners = np.array([[-low, 0], [low, 0], [top, tall], [-top, tall]])
    edges = tuple(tc.Curve(k, (k + 1) % 4, label={0: "hem", 2: "waist"}.get(k, "")) for k in range(4))
    front = tc.Panel("front", corners, edges, np.array([0, y, z]))
    back = tc.Panel("back", corners, edges, np.array([0, y, -z]), np.diag([-1.0, 1, -1]))
    return tc.Pattern((front, back, *more), (tc.Stitch(("front", 1), ("back", 3)), tc.Stitch(("front", 3), ("back", 1))))


def square(name: str, size: float, at) -> tc.Panel:
    corners = size * np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]])
    return tc.Panel(name, corners, tuple(tc.Curve(k, (k + 1) % 4) for k in range(4)), np.array(at))


def tube(radius: float, high: float) -> tc.Worn:
    """A tube that is worn, open at its ends."""
    return tc.Worn(tc.Garment(tc.cylinder(radius, high, (48, 12)), ()), FABRIC, CONTACT, "tube")


def limbs(far: float = 0.4) -> tc.Scene:
    """A trunk along y and an arm beside it."""
    scene = tc.Scene()
    for x, r in ((0.0, 0.13), (far, 0.05)):
        scene.add_solid(tc.Capsule((x, -0.3, 0), (x, 0.3, 0), r), friction=0.3, thickness=0.004)
    return scene


def axis_of(worn: tc.Worn) -> tuple[float, float]:
    """Where the tube begins and ends along y [m]."""
    y = worn.garment.positions[:, 1]
    return float(y.min()), float(y.max())


def test_flat_panels_go_out_and_what_lies_over_them_too():
    """A tube of 16 cm round the trunk; the front hangs within it, and with it a pocket 1 cm before it; the back is clear."""
    worn = tube(0.16, 0.3)
    low, high = axis_of(worn)
    middle = (low + high) / 2
    corners = np.array([[-0.2, -0.1], [0.2, -0.1], [0.2, 0.1], [-0.2, 0.1]])
    edges = tuple(tc.Curve(k, (k + 1) % 4) for k in range(4))
    front = tc.Panel("front", corners, edges, np.array([0, middle, 0.15]))
    back = tc.Panel("back", corners, edges, np.array([0, middle, -0.2]), np.diag([-1.0, 1, -1]))
    far = square("flag", 0.1, (0.6, middle, 0.15))
    garment = tc.Pattern((front, back, square("pocket", 0.08, (0, middle, 0.16)), far)).mesh(0.03)
    hung, notes = hung_outside(garment, [worn], 0.005, limbs())
    by = hung.positions - garment.positions
    z = {name: hung.positions[rows, 2] for name, rows in garment.mesh.groups.items()}
    assert np.ptp(z["front"]) < 1e-12 and z["front"][0] == pytest.approx(0.16 + 0.004, abs=5e-4)  # the mean of 3 and 5 mm
    assert z["pocket"] - z["front"][0] == pytest.approx(0.01, abs=1e-9)
    assert (by[garment.mesh.groups["back"]] == 0).all() and (by[garment.mesh.groups["flag"]] == 0).all()
    assert (by[:, :2] == 0).all() and [n.split("'")[1] for n in notes] == ["front", "pocket"]
    assert "1.4 cm further out" in notes[0]
    assert count_crossings(garment.positions, garment.mesh.faces, worn.garment.positions, worn.garment.mesh.faces) > 0
    assert count_crossings(hung.positions, garment.mesh.faces, worn.garment.positions, worn.garment.mesh.faces) == 0


@pytest.mark.parametrize("turned", [False, True])
def test_a_sleeve_is_bent_wider_over_a_sleeve(turned):
    """It comes to 6.4 cm from the arm's axis where what it goes over has 6. No length changes, it stays as far along the arm,
    and neither side of what the trunk beside it wears pushes it."""
    worn = tube(0.06, 0.3)
    middle = sum(axis_of(worn)) / 2
    arm = np.array([[0.23, middle - 0.3, 0], [0.23, middle + 0.3, 0]])
    under = tc.Worn(tc.Garment(worn.garment.mesh, (), worn.garment.positions + [0.23, 0, 0]), FABRIC, CONTACT, "shirt")
    edges = tuple(tc.Curve(k, (k + 1) % 4) for k in range(4))
    corners = np.array([[-0.16, -0.1], [0.16, -0.1], [0.16, 0.1], [-0.16, 0.1]])
    pattern = tc.Pattern((tc.Panel("sleeve", corners, edges),)).wrap(
        "sleeve", arm, 0.058, turn=-np.pi / 2 if turned else 1.0)
    vest, garment = tube(0.14, 0.4), pattern.mesh(0.02)
    hung, notes = hung_outside(garment, [under, vest], 0.005, limbs(0.23))
    r = np.hypot(hung.positions[:, 0] - 0.23, hung.positions[:, 2])
    assert r == pytest.approx(0.06 + 0.004, abs=5e-4) and len(notes) == 1
    assert hung.positions[:, 1] == pytest.approx(garment.positions[:, 1], abs=1e-9)
    edge = np.sort(garment.mesh.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    was, now = (np.linalg.norm(g.positions[edge[:, 0]] - g.positions[edge[:, 1]], axis=1) for g in (garment, hung))
    assert np.abs(now / was - 1).max() < 5e-3
    for other in (under, vest):
        assert count_crossings(hung.positions, garment.mesh.faces, other.garment.positions, other.garment.mesh.faces) == 0


def test_panels_that_do_not_come_outside_are_named():
    """A closed tube within the tube faces all ways; it has no way out."""
    within = tc.Garment(tc.cylinder(0.14, 0.3, (24, 6)), ())
    with pytest.raises(tc.SceneError, match="panel '.*' does not come outside .* place it outside"):
        hung_outside(within, [tube(0.16, 0.3)], 0.003, limbs())


@pytest.mark.parametrize("radius, caught", [(0.17, True), (0.155, False)])
def test_a_garment_that_was_caught_is_named(radius, caught):
    """A tube of 16 cm and a vest of eight sides: it sticks out through their middles where the corners are at 17 cm."""
    under, mesh = tube(0.16, 0.3), tc.cylinder(radius, 0.3, (8, 6))
    vest = tc.Worn(tc.Garment(mesh, (), mesh.x + [0.001, 0.05, 0.002]), FABRIC, CONTACT, "vest")
    count = count_crossings(vest.garment.positions, mesh.faces, under.garment.positions, under.garment.mesh.faces)
    said = f"'tube' sticks out where seams of 'vest' closed, and was caught: {count} crossings are left"
    notes = dressing._caught([under, vest])
    assert (count > 0) == caught and len(notes) == caught and all(said in note for note in notes)


@pytest.mark.parametrize("change, what", [
    ({"over": "skirt"}, "over = 'skirt': must be worn garments"), ({"over": [3]}, "dress: over"),
    ({"name": "tube"}, "two garments are named 'tube'"), ({"contact": None}, "'vest' has no contact"),
    ({"over": [tc.Worn(tube(0.16, 0.3).garment, FABRIC, None, "silk")]}, "'silk' has no contact"),
    ({"meets": False}, "leave out meets=False"), ({"name": ""}, "dress: name"), ({"panels": {"cuff": FABRIC}}, "cuff"),
    ({"panels": {"front": 3}}, "fabric of panel 'front'")])
def test_what_cannot_be_dressed_over_is_named_before_anything_is_computed(change, what):
    garment = skirt(0.25, 0.22, 0.3, 0.85, 0.16).mesh(0.1)
    with pytest.raises((tc.SceneError, tc.MeshError), match=what):
        tc.dress(garment, FABRIC, trunk(), **{"contact": CONTACT, "over": [tube(0.16, 0.3)], "name": "vest", **change})


@pytest.fixture(scope="module")
def under() -> Dressed:
    """A skirt that is worn."""
    return tc.dress(skirt(0.3, 0.205, 0.4, 0.7, 0.16).mesh(0.04), FABRIC, trunk(), CONTACT, longest=0.6, name="skirt")


@pytest.mark.slow
@pytest.mark.parametrize("elastic", [None, FABRIC.elastic((0.9, 1))])
def test_a_garment_is_sewn_over_a_worn_one(under, elastic):
    """A band over the waist of a skirt, and one that is elastic, as a belt: nothing crosses, and the band is outside wherever
    one is over the other, though its panels begin within the skirt's. The belt is drawn tight, the band hangs loose."""
    assert [w.name for w in under.worn] == ["skirt"] and under.notes == ()
    panels = None if elastic is None else {"front": elastic, "back": elastic}
    pattern = skirt(0.235, 0.235, 0.08, 1.0, 0.15) if elastic else skirt(0.25, 0.235, 0.3, 0.85, 0.15)
    made = tc.dress(pattern.mesh(0.045), FABRIC, trunk(), CONTACT, longest=0.6, over=under.worn, name="band", panels=panels)
    inner, outer = (w.garment for w in made.worn)
    assert [w.name for w in made.worn] == ["skirt", "band"] and outer is made.garment
    assert len(made.notes) == (0 if elastic else 2)
    assert count_crossings(inner.positions, inner.mesh.faces, outer.positions, outer.mesh.faces) == 0
    assert sum(count_self_crossings(g.positions, g.mesh.faces) for g in (inner, outer)) == made.intersections == 0
    assert inner.gap() == outer.gap() == 0 and "with those under it" in made.report()
    r, angle = np.hypot(*outer.positions[:, [0, 2]].T), np.arctan2(*outer.positions[:, [0, 2]].T)
    for x in inner.positions[inner.positions[:, 1] > outer.positions[:, 1].min() + 0.03]:
        round_it = r * np.angle(np.exp(1j * (angle - np.arctan2(x[0], x[2]))))
        near = np.argsort(np.hypot(round_it, outer.positions[:, 1] - x[1]))[:3]
        assert np.hypot(x[0], x[2]) < r[near].max()
    waist = outer.positions[outer.mesh.groups["waist"]]
    assert np.median(np.hypot(waist[:, 0], waist[:, 2])) < 0.147 if elastic else made.worn[-1].panels is None
    scene = tc.Scene()
    for w in made.worn:
        scene.add_garment(w.garment, w.fabric, name=w.name, contact=w.contact, panels=w.panels)
    assert scene.cloths[0].positions == pytest.approx(inner.positions)


@pytest.mark.slow
def test_a_panel_that_nothing_holds_is_told_of_and_refused_where_it_falls():
    """A patch that lies 3 cm before the front, sewn to nothing."""
    patch = square("patch", 0.08, (0.0, 0.9, 0.2))
    garment = skirt(0.3, 0.205, 0.4, 0.7, 0.16, patch).mesh(0.06)
    assert any("no seam holds 'patch'" in note for note in garment.mesh.notes)
    with pytest.raises(tc.SceneError, match="'patch' fell off the body: no seam holds it"):
        tc.dress(garment, FABRIC, trunk(), CONTACT, longest=2.0)
