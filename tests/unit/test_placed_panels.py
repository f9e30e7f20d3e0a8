"""Panels of a meshed garment are moved and bent to where they can be sewn; dressing closes what the usual pull does not."""

from types import SimpleNamespace

import numpy as np
import pytest

import taichi_cloth as tc
from taichi_cloth.contact.cloth.layers import Layers
from taichi_cloth.garment import dressing
from taichi_cloth.garment.worn import Dressed, crossed_of
from taichi_cloth.scene.intersections import count_crossings, count_self_crossings
from taichi_cloth.step.stepper import Control

FABRIC = tc.Fabric(0.2, tc.Stretch(1000, 0.5), tc.Shear(100, 0.05), tc.Bend(1e-5))


def turned(rng) -> np.ndarray:
    """A rotation (3, 3) at random."""
    q = np.linalg.qr(rng.standard_normal((3, 3)))[0]
    return q * np.linalg.det(q)


def test_a_panel_is_moved_and_the_others_stay():
    mesh = tc.grid(0.2, (4, 4))
    two = tc.TriMesh(np.concatenate([mesh.x, mesh.x + [0.5, 0, 0]]), np.concatenate([mesh.faces, mesh.faces + 25]),
                     np.concatenate([mesh.uv, mesh.uv + [0.5, 0]]), {"left": np.arange(25), "right": np.arange(25, 50)})
    garment = tc.Garment(two, ())
    turned = garment.placed(90.0, (0.0, 0.5, 0.0)).positions  # z comes to x, x to -z
    assert np.allclose(turned, garment.positions[:, [2, 1, 0]] * [1, 1, -1] + [0, 0.5, 0], atol=1e-12)
    by = garment.moved("right", (0.1, -0.2, 0.3)).positions - garment.positions
    assert (by[:25] == 0).all() and by[25:] == pytest.approx(np.tile([0.1, -0.2, 0.3], (25, 1)))
    with pytest.raises(tc.SceneError, match="there is no panel 'middle'; there are left, right"):
        garment.moved("middle", (0, 0, 0))


def test_a_sleeve_is_bent_round_an_arm(rng):
    """However arm and sleeve lie: every vertex at the radius, angles and places along the axis as in the panel, and lengths
    those of the panel but for chords."""
    r, R, at = 0.06, turned(rng), rng.standard_normal(3)
    mesh = tc.grid((0.3, 0.2), (60, 40))
    flat = mesh.uv - [0.15, 0.1]
    above = np.column_stack([flat[:, 1] + 0.25, np.full(len(flat), 0.1), flat[:, 0]])  # 10 cm over an arm along x
    sleeve = tc.Garment(mesh, (), above @ R.T + at)
    arm = np.array([[0.1, 0, 0], [0.5, 0, 0]]) @ R.T + at
    x = (tc.Garment(tc.TriMesh(mesh.x, mesh.faces, mesh.uv, {"sleeve": np.arange(len(flat))}), (), sleeve.positions)
         .bent("sleeve", arm, r).positions - at) @ R
    assert np.hypot(x[:, 1], x[:, 2]) == pytest.approx(r, abs=1e-9) and x[:, 0] == pytest.approx(above[:, 0], abs=1e-9)
    assert r * np.arctan2(x[:, 2], x[:, 1]) == pytest.approx(flat[:, 0], abs=1e-9)  # its middle stays above the arm
    edges = np.sort(mesh.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    was, now = (np.linalg.norm(np.diff(q[edges], axis=1)[:, 0], axis=1) for q in (above, x))
    assert 1 - (0.005 / r) ** 2 / 24 - 1e-9 < (now / was).min() and (now / was).max() < 1 + 1e-9


def test_a_report_says_which_panels_cross():
    """Two sheets through each other at right angles, and a third one through the second."""
    sheet, up = tc.grid(0.2, 4), tc.grid(0.2, 4, plane="xy")
    turned_round = up.x @ np.array([[0, 0, 1], [0, 1, 0], [1, 0, 0]])
    places = [sheet.x, up.x + [0.013, -0.093, -0.117], turned_round + [0.11, -0.09, -0.21]]
    n = sheet.vertex_count
    mesh = tc.TriMesh(np.concatenate(places), np.concatenate([sheet.faces + n * k for k in range(3)]),
                      np.concatenate([sheet.uv + [k, 0] for k in range(3)]),
                      {name: np.arange(n) + n * k for k, name in enumerate(("flat", "front", "side"))})
    crossed = crossed_of([tc.Worn(tc.Garment(mesh, ()), FABRIC, None)])
    assert {(a, b) for a, b, _ in crossed} == {("flat", "front"), ("flat", "side"), ("front", "side")}
    assert sum(k for *_, k in crossed) == count_self_crossings(mesh.x, mesh.faces)
    for a, b, k in crossed:
        pair = [np.arange(n) + n * ("flat", "front", "side").index(name) for name in (a, b)]
        assert k == count_crossings(mesh.x[pair[0]], sheet.faces, mesh.x[pair[1]], sheet.faces)
    said = Dressed(tc.Garment(mesh, ()), 1.0, 0.5, True, 0.01, 7, (("a", "b", 4), ("a", "c", 3))).report()
    assert said.endswith("7 crossings with itself (4 of 'a' and 'b', 3 of 'a' and 'c')")


def test_what_cannot_be_bent_is_named():
    mesh = tc.grid((0.3, 0.2), (6, 4), plane="xy")
    groups = {"sleeve": np.arange(35), "nothing": [], "button": [3, 4]}
    garment = tc.Garment(tc.TriMesh(mesh.x, mesh.faces, mesh.uv, groups), ())
    beside = [[0.15, -1, -0.2], [0.15, 1, -0.2]]
    assert np.hypot(*(garment.bent("sleeve", beside, 0.1).positions - [0.15, 0, -0.2])[:, [0, 2]].T) == pytest.approx(0.1)
    for around, r, what in ((beside, 0.04, "is 0.3 m wide, and the way round is 0.251 m"),
                            ([[0.15, 0.1, -1], [0.15, 0.1, 1]], 0.1, "stands across the axis"),
                            ([[0.15, -1, 0], [0.15, 1, 0]], 0.1, "its middle on it"),
                            ([[0, 0, 1], [0, 0, 1]], 0.1, "one place"), (beside, 0.0, "radius"), (beside[:1], 0.1, "around")):
        with pytest.raises(tc.SceneError, match=what):
            garment.bent("sleeve", around, r)
    with pytest.raises(tc.SceneError, match="is not flat"):
        garment.bent("sleeve", beside, 0.1).bent("sleeve", beside, 0.1)
    for name, count in (("nothing", 0), ("button", 2)):
        with pytest.raises(tc.SceneError, match=f"bent: panel '{name}' has {count} vertices: no plane"):
            garment.bent(name, beside, 0.1)
    with pytest.raises(tc.SceneError, match="there is no panel 'cuff'; there are sleeve"):
        garment.bent("cuff", beside, 0.1)


def trunk() -> tc.Scene:
    """A body that stands up, with a way round of 31.4 cm."""
    scene = tc.Scene(gravity=None)
    scene.add_solid(tc.Capsule((0, -0.3, 0), (0, 0.3, 0), 0.05), friction=0.3, thickness=0.003, name="trunk")
    return scene


def band() -> tc.Garment:
    """29.5 cm long, open: it closes where it is stretched by a tenth, by 100 N/m at 1000 N/m."""
    mesh = tc.grid((0.295, 0.04), (30, 4), plane="xy")
    rows = (np.flatnonzero(abs(mesh.uv[:, 0] - u) < 1e-6) for u in (0.0, 0.295))
    mesh = tc.TriMesh(mesh.x + [-0.1475, -0.02, 0.1], mesh.faces, mesh.uv, {"band": np.arange(mesh.vertex_count)})
    return tc.Garment(mesh, ((*rows, "flat"),)).bent("band", [[0, -1, 0], [0, 1, 0]], 0.056)


@pytest.mark.slow
@pytest.mark.parametrize("contact", [None, tc.ClothContact(0.002, 0.3)])
def test_what_is_too_tight_for_the_usual_pull_is_closed_by_more(monkeypatch, contact):
    """5 N/m leave the band open by some 2 cm, and 80 do; four times as much closes it, and without that it is named. Beside
    what the strongest pull does not close, and there alone, cloth that meets itself rests."""
    rests, around = [], Layers.release_around
    monkeypatch.setattr(Layers, "release_around", lambda self, of: (rests.append(np.unique(of)), around(self, of)))
    made = tc.dress(band(), FABRIC, trunk(), contact, longest=0.5)
    x = made.garment.positions
    assert made.garment.gap() == 0 and made.sewn < 1 and 0.05 < np.hypot(x[:, 0], x[:, 2]).min() < 0.0531
    rests.clear()
    monkeypatch.setattr(dressing, "FIRM", 1.0)
    monkeypatch.setattr(dressing, "FIRMEST", 1.0)
    until = "3.[01]" if contact else "[01].[0-9]"  # resting layers have time to make room; without, nothing more comes
    with pytest.raises(tc.SceneError, match=f"1 of 1 seams are still open after {until} s; the widest is seam 0, "
                                            ".* with 0.02.* Garment.bent.*--pull"):
        tc.dress(band(), FABRIC, trunk(), contact, longest=0.5)
    assert (len(rests) > 20 and all(len(of) == 10 for of in rests)) if contact else not rests
    rests.clear()
    monkeypatch.setattr(dressing, "SEWING", 0.5)
    with pytest.raises(tc.SceneError, match="1 of 1 seams are still open"):
        tc.dress(band(), FABRIC, trunk(), contact, longest=0.5, meets=False)
    assert not rests


def test_the_speed_at_which_seams_close_is_that_of_the_last_half_second():
    """From 1 m by 0.4 m/s for a second, then none: at once 0.4 m/s, and 0 from half a second on."""
    gaps = [1 - 0.04 * min(k, 10) for k in range(17)]
    speeds = [dressing.closing(gaps[:k]) for k in range(1, 18)]
    assert speeds == pytest.approx([0] + 10 * [0.4] + [0.32, 0.24, 0.16, 0.08, 0, 0])


def apart() -> tuple[tc.Garment, tc.Scene]:
    """Two sheets 0.6 m apart, above a ball, whose edges are sewn."""
    sheet = tc.grid(0.2, 4, plane="xy")
    n = sheet.vertex_count
    x = np.concatenate([sheet.x, sheet.x + [0, 0, 0.6]])
    mesh = tc.TriMesh(x, np.concatenate([sheet.faces, sheet.faces + n]), np.concatenate([sheet.uv, sheet.uv]),
                      {"front": np.arange(n), "back": np.arange(n, 2 * n)})
    row = np.flatnonzero(sheet.uv[:, 0] < 1e-6)
    body = tc.Scene(gravity=None)
    body.add_solid(tc.Sphere(0.2), position=(0, -1.5, 0), friction=0.3, thickness=0.003, name="ball")
    return tc.Garment(mesh, ((row, row + n, "flat"),)), body


def test_sewing_goes_on_while_seams_close(monkeypatch):
    """Seams that close within the time bounded, but not within the usual one, are sewn; where no time is left they are named,
    with how fast they closed."""
    garment, body = apart()
    usual = tc.dress(garment, FABRIC, body, longest=0.1, meets=False)
    assert usual.sewn > 0.25
    monkeypatch.setattr(dressing, "SEWING", 0.15)
    made = tc.dress(garment, FABRIC, body, longest=0.1, meets=False)
    assert made.garment.gap() == 0 and made.sewn == pytest.approx(usual.sewn)
    monkeypatch.setattr(dressing, "LONGEST", 0.15)
    with pytest.raises(tc.SceneError, match="of 'front' and 'back', .* closes by .* m/s, too slowly: .*--pull"):
        tc.dress(garment, FABRIC, body, longest=0.1, meets=False)


def pressed() -> tuple[tc.Simulation, int]:
    """Two sheets of a garment that a row of stitches draws together by 1 kN each, with a strip of it between them; how many
    stitches."""
    sheet, strip = tc.grid(0.1, 10), tc.grid((0.06, 0.14), (6, 14))
    n = sheet.vertex_count
    parts = [sheet.x, sheet.x + [0, 0.03, 0], strip.x + [0.002, 0.015, 0.003]]
    scene, contact = tc.Scene(gravity=None), tc.ClothContact(0.004, 0.3)
    three = tc.TriMesh(np.concatenate(parts), np.concatenate([sheet.faces, sheet.faces + n, strip.faces + 2 * n]),
                       np.concatenate([sheet.uv, sheet.uv + [0.2, 0], strip.uv + [0.4, 0]]))
    cloth = scene.add_cloth(three, FABRIC, contact=contact)
    middle = np.flatnonzero(abs(sheet.uv[:, 0] - 0.05) < 1e-6)
    scene.sew(cloth, middle, middle + n, stiffness=0.0, pull=1e5)
    return tc.Simulation(scene, h=1 / 60, cg_tol=1e-3, integrator="backward_euler"), len(middle)


@pytest.mark.slow
def test_layers_that_seams_press_rest_where_no_step_passes(monkeypatch):
    """Those in the way, and not the rest of a row, which closes; without that steps become 2,000 times smaller, and 64
    times with it in one of twenty starts that differ by a rounding."""
    rests, around = [], Layers.release_around
    monkeypatch.setattr(Layers, "release_around", lambda self, of: (rests.append(len(of)), around(self, of)))
    sim, stitches = pressed()
    for _ in range(2):
        dressing._advance(sim, None, "", sim.control.h_max / 32)
    assert sim.seam_gaps()[0] == 0 and sim.stepper.control == sim.control and sim.time == pytest.approx(0.2)
    assert 0 < len(rests) < stitches and all(count == 4 for count in rests)
    assert min(r.h for r in sim.log) >= sim.control.h_max / 128 * (1 - 1e-9)
    sim.close()


def test_what_no_layers_stop_is_tried_by_smaller_steps():
    """As where a solid needs them: the tenth of a second goes on; where those do not pass either, it ends."""
    def sim(passes: float) -> SimpleNamespace:
        control = Control(1 / 60, 1e-5)
        one = SimpleNamespace(time=0.0, control=control, stepper=SimpleNamespace(control=control, h=control.h_max),
                              contacts=SimpleNamespace(layers=SimpleNamespace(nearest=lambda: None)),
                              scene=SimpleNamespace(solids=[]))

        def step(h: float) -> None:
            if one.stepper.control.h_min > passes:
                raise tc.SimulationError("no step passes", "CONTACT", one.time)
            one.time += h

        one.step = step
        return one

    made = sim(1e-5)
    dressing._advance(made, None, "", 1 / 60 / 32)
    assert made.time == pytest.approx(0.1) and made.stepper.control is made.control
    with pytest.raises(tc.SimulationError):
        dressing._advance(sim(1e-6), None, "", 1 / 60 / 32)


@pytest.mark.parametrize("gap, passes, released", [(0.1, 1 / 60 / 16, 0), (0.1, 1 / 60 / 128, 1), (0.5, 1 / 60 / 128, 0)])
def test_layers_rest_where_no_step_passes(gap, passes, released):
    """Of one garment or of two, they rest where no step passes that is a 32nd of the usual one, and some are that near: what
    is caught where seams close would take steps without end. What is not as near is tried by smaller steps."""
    rests: list = []
    control = Control(1 / 60, 1e-5)
    layers = SimpleNamespace(nearest=lambda: SimpleNamespace(gap=gap, particles=(0, 1, 2, 4)), release_around=rests.append)
    one = SimpleNamespace(time=0.0, control=control, stepper=SimpleNamespace(control=control, h=control.h_max),
                          contacts=SimpleNamespace(layers=layers))

    def step(h: float) -> None:
        if one.stepper.control.h_min > passes and not rests:
            raise tc.SimulationError("no step passes", "CONTACT", one.time)
        one.time += h

    one.step = step
    dressing._advance(one, None, "", 1 / 60 / 32)
    assert len(rests) == released and one.time == pytest.approx(0.1)
