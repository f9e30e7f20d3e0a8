"""Fabrics and winds in words, fabrics with factors, and what lies between two of them."""

import warnings

import numpy as np
import pytest

import taichi_cloth as tc
from taichi_cloth.app import cli
from taichi_cloth.errors import did_you_mean
from taichi_cloth.scene.blending import air_between, fabric_between
from taichi_cloth.scene.fliers import fliers
from taichi_cloth.scene.winds import WINDS, flat_from, lifted

FULL = tc.Fabric(0.2, tc.Stretch((800, 600), (0.8, 0.6), limit=1.2), tc.Shear(200, 0.2),
                 tc.Bend((2e-4, 3e-4), 2e-6, friction=1e-3, yield_=50.0))
CURVE = tc.Stretch(k_d=1.0, curve=((0, 0), (0.1, 3), (0.2, 20)))


def test_known_names_come_once():
    assert did_you_mean("x", ["cells", "fabric", "fabric"]) == "known: cells, fabric"
    assert did_you_mean("fabrik", iter(("fabric", "cells", "fabric"))) == "did you mean 'fabric'? known: cells, fabric"
    assert did_you_mean("x", []) == "known: none"


def test_a_fabric_is_named():
    scene = tc.Scene()
    cloth = scene.add_cloth(tc.grid(1.0, 2), "denim")
    assert cloth.fabric is tc.fabrics["denim"]
    scene.set_fabric(cloth, "canvas")
    assert cloth.fabric is tc.fabrics["canvas"] and cloth.density.tolist() == [0.294] * 8
    for wrong, said in (("denin", "unknown fabric 'denin'; did you mean 'denim'"),
                        (3, "fabric of 'cloth0' = 3: must be a Fabric")):
        with pytest.raises(tc.SceneError, match=said):
            scene.set_fabric(cloth, wrong)
    assert cloth.fabric is tc.fabrics["canvas"]
    with tc.Simulation(scene, integrator="verlet"), pytest.raises(tc.SceneError, match="set_fabric: a simulation of this"):
        scene.set_fabric(cloth, "denim")


@pytest.mark.parametrize("word, meant", [("jeans", "denim"), ("Jeans", "denim"), ("silk", "charmeuse"),
                                         ("T-shirt", "interlock"), ("wool", "wool_coating"), ("denmi", "denim")])
def test_everyday_words_lead_to_the_nearest_fabric(word, meant):
    with pytest.raises(tc.SceneError, match=f"unknown fabric '{word}'; did you mean '{meant}'. known: canvas, charmeuse, "):
        tc.fabrics[word]


def test_everyday_words_are_of_fabrics_that_there_are():
    for word, meant in tc.fabrics.everyday.items():
        assert word.isalpha() and word.islower() and word not in tc.fabrics and meant in tc.fabrics


CURTAIN = '''"""A curtain."""
import taichi_cloth as tc


def build(normal: float = 0.0):
    scene = tc.Scene(air=tc.Air(normal) if normal else None)
    scene.add_cloth(tc.grid(1.0, 2), "denim")
    return scene
'''


@pytest.mark.parametrize("fabric, wind, normal, flies", [
    ("shirting", "gusty moderate_breeze -z", 0.0, True), ("shirting", "moderate_breeze -z", 0.0, True),
    ("shirting", "draught", 0.0, False), ("wool_coating", "gusty breeze", 0.0, False), ("shirting", "", 0.0, False),
    ("shirting", "own", 0.0, True), ("shirting", "gusty moderate_breeze", 2.0, True), ("shirting", "breeze", 1.5, False)])
def test_cloth_that_flies_flat_is_told(tmp_path, fabric, wind, normal, flies):
    """80 degrees from the vertical, by the balance of weight and air along the normal: shirting does from 3.1 m/s on."""
    from taichi_cloth.app import scenefile

    text = CURTAIN
    if wind == "own":  # an option of the scene itself
        text, wind = text.replace("normal: float = 0.0", "normal: float = 0.0, wind: str = 'calm'").replace(
            "tc.Air(normal) if normal else None", "tc.Air(drag=1.2, lift=0.8, wind=wind)"), "moderate_breeze"
    (tmp_path / "curtain.py").write_text(text)
    with warnings.catch_warnings(record=True) as notes:
        warnings.simplefilter("always")
        scenefile.read(str(tmp_path / "curtain.py")).make({"fabric": fabric, "wind": wind, "normal": str(normal)})
    told = [str(note.message) for note in notes]
    assert len(told) == flies
    if flies:
        flat = 0.104 * 9.81 * np.tan(np.radians(80)) / normal if normal else 3.1  # m/s
        assert told[0].startswith(f"shirting flies flat from {flat:.1f} m/s on, and this wind has 6.5")
        assert ("gusts" in told[0]) == wind.startswith("gusty")


def test_each_cloth_that_flies_flat_is_named_unless_the_wind_changes():
    """Of two cloths the second flies; where the wind is a function of time nobody says for how long."""
    for wind, told in (((6.5, 0, 0), ["light"]), (lambda t: (6.5, 0, 0), [])):
        scene = tc.Scene(air=tc.Air(drag=1.2, lift=0.8, wind=wind))
        for name, density in (("heavy", 2.0), ("light", 0.1)):
            scene.add_cloth(tc.grid(1.0, 2), tc.Fabric(density), name=name)
        assert [sentence.split("'")[1] for sentence in fliers(scene)] == told


def test_panels_keep_their_fabric_unless_they_are_meant_too():
    scene = tc.Scene()
    flat = tc.grid(1.0, 2)
    mesh = tc.TriMesh(flat.x, flat.faces, groups={"one": flat.faces[0]})
    cloth = scene.add_cloth(mesh, "denim", color="red", panels={"one": "canvas"})
    scene.set_fabric(cloth, "shirting")
    assert list(cloth.fabrics) == [tc.fabrics["shirting"], tc.fabrics["canvas"]]
    scene.set_fabric(cloth, "shirting", panels=True)
    assert cloth.fabrics == (tc.fabrics["shirting"],) and cloth.color == tc.Appearance("red").color


def test_factors():
    made = FULL.scaled(density=2, stretch=0.5, shear=3, bend=10)
    assert made.density == 0.4 and made.stretch == tc.Stretch((400, 300), (0.4, 0.3), limit=1.2)
    assert made.shear.k == 600 and made.shear.k_d == pytest.approx(0.6)
    assert made.bend.D == pytest.approx((2e-3, 3e-3)) and made.bend.k_d == pytest.approx(2e-5)
    assert made.bend.friction == pytest.approx(1e-2) and made.bend.yield_ == 50
    assert FULL.scaled() == FULL
    curved = tc.Fabric(0.2, CURVE).scaled(stretch=2).stretch
    assert curved.curve == ((0, 0), (0.1, 6), (0.2, 40)) and curved.k == pytest.approx(60) and curved.k_d == 2
    two = tc.Fabric(0.2, tc.Stretch(curve=(CURVE.curve, ((0, 0), (1, 5))))).scaled(stretch=2).stretch
    assert two.curve == (((0, 0), (0.1, 6), (0.2, 40)), ((0, 0), (1, 10)))
    assert type(tc.fabrics["denim"].scaled(density=2)) is tc.Fabric  # nobody measured it


@pytest.mark.parametrize("factors, said", [({"density": 0}, "scaled: density = 0: must be a positive number"),
                                           ({"shear": 2}, "scaled: shear = 2: the fabric has no shear"),
                                           ({"stretch": "2"}, "scaled: stretch = '2'")])
def test_factors_that_cannot_be(factors, said):
    with pytest.raises(tc.SceneError, match=said):
        tc.Fabric(0.2, tc.Stretch(10)).scaled(**factors)


def test_between_two_fabrics_every_number_is():
    other = tc.Fabric(0.6, tc.Stretch(100, 0.1, limit=1.6), tc.Shear(100), tc.Bend(1e-4, friction=3e-3))
    assert fabric_between(FULL, other, 1.0) is other and fabric_between(FULL, FULL, 0.3) is FULL
    made = fabric_between(FULL, other, 0.25)
    assert made.density == pytest.approx(0.3)
    assert made.stretch.k == pytest.approx((625, 475)) and made.stretch.k_d == pytest.approx((0.625, 0.475))
    assert made.stretch.limit == pytest.approx(1.3) and made.shear.k == 175 and made.shear.k_d == pytest.approx(0.15)
    assert made.bend.D == pytest.approx((1.75e-4, 2.5e-4)) and made.bend.friction == pytest.approx(1.5e-3)
    assert made.bend.yield_ is None  # as the other has it, from the start
    bare = fabric_between(FULL, tc.Fabric(0.6, tc.Stretch(100)), 0.5)
    assert bare.shear is None and bare.bend is None and bare.density == pytest.approx(0.4)


def test_between_a_curve_and_a_number_tensions_are_added():
    made = fabric_between(tc.Fabric(0.2, CURVE), tc.Fabric(0.2, tc.Stretch((40, 80))), 0.5).stretch
    strain = np.array([0.05, 0.1, 0.15, 0.2, 0.5])
    curve = np.array([1.5, 3, 11.5, 20, 71])  # the last piece goes on with 170 N/m
    for axis, k in enumerate((40, 80)):
        points = np.array(made.curve_of(axis))
        inner = strain <= points[-1, 0]
        tension = np.interp(strain[inner], *points.T)
        assert tension == pytest.approx(0.5 * curve[inner] + 0.5 * k * strain[inner])
        assert (points[-1, 1] - points[-2, 1]) / (points[-1, 0] - points[-2, 0]) == pytest.approx(0.5 * 170 + 0.5 * k)


def test_between_two_airs():
    a, b = tc.Air(0.4, wind=(1, 0, 0)), tc.Air(drag=1.2, lift=0.8, wind=lambda x, t: x * t)
    made = air_between(a, b, 0.25)
    assert (made.normal, made.drag, made.lift) == pytest.approx((0.3, 0.3, 0.2))
    assert made.wind_at(2.0, np.array([[0.0, 4, 0]]))[0].tolist() == [0.75, 2, 0]
    from_none = air_between(None, b, 0.25)
    assert (from_none.normal, from_none.drag, from_none.density) == pytest.approx((0, 0.3, 1.2))
    assert from_none.wind_at(2.0, np.array([[0.0, 4, 0]]))[0].tolist() == [0, 8, 0]
    assert air_between(a, None, 0.25).normal == pytest.approx(0.3) and air_between(a, None, 1.0) is None
    assert air_between(None, None, 0.5) is None and air_between(a, b, 0.0) is a


def test_winds_in_words():
    assert tc.Air(1.0, wind="breeze").wind.tolist() == [3, 0, 0]
    assert tc.Air(1.0, wind="Strong breeze -z").wind.tolist() == [0, 0, -12.5]
    scene = tc.Scene(air=tc.Air(1.0))
    scene.set_wind("gale y")
    assert scene.air.wind_at(0.0).tolist() == [0, 19, 0]
    for wrong in ("breze", "breeze up", "", "-z"):
        with pytest.raises(tc.SceneError, match="needs a wind's name, and an axis unless it is"):
            tc.Air(1.0, wind=wrong)
    speeds = [wind.speed for wind in WINDS.values()]
    assert speeds == sorted(speeds) and [w.force for w in WINDS.values()] == sorted(w.force for w in WINDS.values())


def test_a_gusty_wind_has_gusts_round_its_mean():
    """By samples: the mean is the named wind's, the gusts' root mean square three tenths of it."""
    wind = tc.Air(1.0, wind="gusty breeze -z").wind
    x = np.random.default_rng(5).uniform(-50, 50, (4000, 3))
    v = np.concatenate([wind(x, t) for t in (0.0, 3.0, 7.0)])
    assert v.mean(axis=0) == pytest.approx([0, 0, -3], abs=0.05)
    assert np.sqrt(((v - [0, 0, -3]) ** 2).sum(axis=1).mean()) == pytest.approx(0.9, rel=0.05)
    assert tc.Air(1.0, wind="Gusty strong breeze").wind_at(0.0, x).mean(axis=0)[0] == pytest.approx(12.5, abs=0.4)
    for wrong, said in (("gusty", "needs a wind's name"), ("gusty breze", "mean 'breeze'"), ("gusty calm", "no gusts")):
        with pytest.raises(tc.SceneError, match=said):
            tc.Air(1.0, wind=wrong)


@pytest.mark.parametrize("density", [0.05, 0.324, 0.6])
def test_the_wind_in_which_a_curtain_flies_flat(density):
    """There it hangs 80 degrees from the vertical; the speed goes with the root of the weight."""
    assert lifted(flat_from(density), density) == pytest.approx(80, abs=0.01)
    assert flat_from(density) == pytest.approx(9.7 * density**0.5, rel=0.005)


def test_the_command_lists_winds(capsys):
    assert cli.main(["winds", "--fabric", "denim", "--fabric", "0.1"]) == 0
    lines = capsys.readouterr().out.splitlines()
    breeze = next(line for line in lines if line.startswith("breeze ")).split()
    assert breeze[1:3] == ["3.0", "2"] and breeze[3] == f"{lifted(3.0, 0.324):.0f}" and breeze[5] == f"{lifted(3.0, 0.1):.0f}"
    assert len(lines) == len(WINDS) + 6
    for wrong, said in (("denin", "unknown fabric 'denin'; did you mean 'denim'"), ("-1", "--fabric = -1.0 kg/m^2: must be")):
        assert cli.main(["winds", "--fabric", wrong]) == 2 and said in capsys.readouterr().err


def test_beauforts_numbers():
    """v = .836 B^1.5 is within the range of every number."""
    for name, wind in WINDS.items():
        low, high = (0.836 * max(wind.force + d, 0) ** 1.5 for d in (-0.5, 0.5))
        assert low <= wind.speed <= high * 1.02, name


@pytest.mark.parametrize("speed, density", [(0.0, 0.1), (0.5, 0.083), (3.0, 0.324), (9.5, 0.481)])
def test_cloth_hangs_where_weight_and_air_point_along_it(speed, density):
    a = np.radians(lifted(speed, density))
    along, normal = np.array([np.sin(a), -np.cos(a)]), np.array([np.cos(a), np.sin(a)])
    e = np.array([-1.0, 0.0])  # of the cloth against the air
    c = abs(normal @ e)
    force = -0.6 * speed**2 * (1.2 * c * e + 0.8 * ((normal @ e) * normal - c**2 * e)) + [0, -9.81 * density]
    assert abs(force @ normal) < 1e-6 * np.linalg.norm(force) and force @ along > 0


def test_a_sweep_varies_fabric_and_wind_of_every_scene():
    from taichi_cloth.app import scenefile, sweeping
    from taichi_cloth.sweeps.plan import runs_of

    scene = scenefile.read("hang")
    grid = sweeping.grid_of(["cells=2", "fabric=denim,canvas", "wind=breeze -z"], scene)
    build = sweeping.FromFile(scene.path)
    runs = runs_of(build, grid, {}, {})
    assert [run.settings for run in runs] == [{"cells": 2, "fabric": f, "wind": "breeze -z"} for f in ("denim", "canvas")]
    made = build(**runs[1].settings)
    assert made.cloths[0].fabric is tc.fabrics["canvas"] and made.air.wind_at(0.0).tolist() == [0, 0, -3]
