"""Pins by the weights of a vertex group: held, by springs, or refused."""

import re

import numpy as np
import pytest

import taichi_cloth as tc

WEIGHTS = {"top": [1.0, 0.5, 0.25]}


def weighted(weights=WEIGHTS) -> tuple[tc.Scene, tc.Cloth]:
    flat = tc.grid(0.2, 2, plane="xy")
    mesh = tc.TriMesh(flat.x, flat.faces, flat.uv, {"top": flat.select("top")}, weights=weights)
    scene = tc.Scene()
    return scene, scene.add_cloth(mesh, tc.Fabric(0.2, tc.Stretch(100), tc.Shear(20)))


@pytest.mark.slow
def test_weights_between_are_springs():
    """Weight 1 holds; w pulls with k w / (1 - w) times the distance, away from its place."""
    scene, cloth = weighted()
    scene.pin(cloth, "top", stiffness=3.0)
    top = cloth.mesh.select("top")
    with tc.Simulation(scene, h=1 / 60) as sim:
        sim.run(0.3, fps=10)
        away = sim.positions()[top] - cloth.mesh.x[top]
        pulled = sim.attachment_forces()[top]
    assert away[0].tolist() == [0, 0, 0] and np.linalg.norm(away[1:], axis=1).min() > 1e-3
    assert pulled == pytest.approx(-away * np.array([[0.0], [3.0], [1.0]]), rel=1e-6)


def test_an_event_pins_softly_too():
    scene, cloth = weighted()
    scene.at(0.0, lambda: scene.pin(cloth, "top", stiffness=3.0))
    with tc.Simulation(scene, h=1 / 60) as sim:
        sim.run(1 / 30, fps=30)
        assert sim.attachment_forces()[cloth.mesh.select("top")[1:]].any(axis=1).all()


def test_a_garment_keeps_weights_and_polygons(tmp_path):
    flat = tc.grid(0.2, 2)
    mesh = tc.TriMesh(flat.x, flat.faces, flat.uv, {"top": flat.select("top")}, weights=WEIGHTS, polygon=np.arange(8) // 2)
    tc.Garment(mesh, (), mesh.x).save(tmp_path / "a.npz")
    again = tc.load_garment(tmp_path / "a.npz").mesh
    assert again.select_weights("top").tolist() == WEIGHTS["top"] and (again.polygon == mesh.polygon).all()


@pytest.mark.parametrize("law, words", [
    ({}, "pin: 2 of 3 vertices in 'top' have weights between 0 and 1, as 7 has 0.5: give stiffness="),
    ({"stiffness": 3.0, "directions": "y"}, "springs hold them in all directions: leave out directions"),
    ({"stiffness": -1.0}, "pin: stiffness")])
def test_weights_that_say_nothing_are_refused(law, words):
    scene, cloth = weighted()
    with pytest.raises(tc.SceneError, match=re.escape(words)):
        scene.pin(cloth, "top", **law)
    assert not scene.script.attachments
    scene.pin(cloth, cloth.mesh.select("top"))  # all the same
    with pytest.raises(tc.SceneError, match="already held"):
        scene.pin(cloth, "top", stiffness=3.0)
    with tc.Simulation(scene) as sim, pytest.raises(tc.SceneError, match="pin: this simulation was made without soft"):
        sim.pin(cloth, "top", stiffness=3.0)


@pytest.mark.parametrize("weights, words", [
    ({"tip": [1.0]}, "weights: no vertex group 'tip'; did you mean 'top'"), ({"top": [1.0]}, "weights of group 'top'"),
    ({"top": [1.0, 0.0, 1.0]}, "vertex 7 has 0: they are above 0"), ({"top": [1.0, 2.0, 1.0]}, "vertex 7 has 2")])
def test_weights_that_are_none(weights, words):
    with pytest.raises(tc.MeshError, match=words):
        weighted(weights)


def test_weights_stay_where_cloth_may_tear():
    flat = tc.grid(0.2, 2)
    mesh = tc.TriMesh(flat.x, flat.faces, flat.uv, {"top": flat.select("top")}, weights=WEIGHTS)
    cloth = tc.Scene().add_cloth(mesh, tc.Fabric(0.2, tc.Stretch(100)), tear=tc.Tear(10.0, length=0.05))
    of = cloth.split.of[cloth.mesh.select("top")]
    wanted = np.select([of == v for v in mesh.select("top")], WEIGHTS["top"])
    assert len(of) > 3 and (cloth.mesh.select_weights("top") == wanted).all()
