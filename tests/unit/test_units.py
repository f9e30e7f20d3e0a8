"""Numbers that look like another unit's are said, once, and taken."""

import warnings

import numpy as np
import pytest

import taichi_cloth as tc


def plain(size, cells):
    """A grid without material coordinates."""
    return tc.TriMesh(tc.grid(size, cells).x, tc.grid(size, cells).faces)


@pytest.mark.parametrize("mesh, fabric, more, words", [
    (tc.grid(1000.0, 2), tc.Fabric(0.15), {}, "size = 1,000 m"), (tc.grid(1e-3, 2), tc.Fabric(0.15), {}, "size = 0.001 m"),
    (plain(600.0, 30), tc.Fabric(0.15), {}, "size = 600 m"), (plain(1000.0, 10), tc.Fabric(0.15), {}, "size = 1,000 m"),
    (tc.grid(65.0, 2), tc.Fabric(0.15), {}, r"size = 65 m .*scale=0.0254\) if those are inches .*scale=0.01 if"),
    (tc.grid(1.0, 2), tc.Fabric(150.0), {}, r"density = 150 kg/m\^2"),
    (tc.grid(1.0, 2), tc.Fabric(0.15, bend=tc.Bend(20.0)), {}, "D = 20 N m"),
    (tc.grid(1.0, 2), tc.Fabric(0.15), {"contact": tc.ClothContact(0.5)}, "thickness = 0.5 m")])
def test_what_looks_like_another_unit_is_said(mesh, fabric, more, words):
    scene = tc.Scene()
    with pytest.warns(UserWarning, match=words) as said:
        scene.add_cloth(mesh, fabric, **more)
    assert len(said) == 1 and said[0].filename == __file__ and len(scene.cloths) == 1
    with pytest.warns(UserWarning, match="gravity = 9,810"):
        tc.Scene(gravity=(0, -9810, 0)).add_cloth(tc.grid(1.0, 2), tc.Fabric(0.15))


@pytest.mark.parametrize("size, words, scale", [
    (170.0, "statue: size = 170 m", r"scale=0.01\) if those are centimetres \(1.7 m\), scale=0.0254 if those are inches"),
    (1700.0, "size = 1,700 m",
     r"scale=0.001\) if those are millimetres \(1.7 m\), times any scale it was read with$"),
    (68.0, "size = 68 m", r"scale=0.0254\) if those are inches \(1.73 m\), scale=0.01 if those are centimetres"),
    (1e-3, "0.001 m", r"scale=1000\) makes it a usual size")])
def test_a_body_in_another_unit_is_said(size, words, scale):
    x, faces = tc.Box((1.0, 1.0, 1.0)).surface()
    x, corner = np.unique(x.round(9), axis=0, return_inverse=True)
    faces = corner.reshape(-1)[faces]
    scene = tc.Scene()
    with pytest.warns(UserWarning, match=f"{words} looks like another unit.*{scale}") as said:
        scene.add_solid(tc.SolidMesh(size * x, faces), 0.3, 0.004, name="statue")
    assert len(said) == 1 and said[0].filename == __file__ and len(scene.solids) == 1
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for usual in (0.02, 1.7, 30.0):
            scene.add_solid(tc.SolidMesh(usual * x, faces), 0.3, 0.004)
        scene.add_solid(tc.SolidMesh(size * tc.grid(1.0, 2).x, tc.grid(1.0, 2).faces), 0.3, 0.004)  # a hill, open
        scene.add_solid(tc.Plane(), 0.3, 0.004)
    hole = size * np.stack([x, x + 0.01])
    with pytest.warns(UserWarning, match=words):  # what deforms is no hill, open or not
        tc.Scene().add_solid(tc.SolidMesh(hole, faces[1:], fps=24), 0.3, 0.004, name="statue")


def test_usual_cloth_is_not_doubted():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        scene = tc.Scene()
        for size in (0.02, 1.0, 50.0):
            fabric = tc.Fabric(0.02, tc.Stretch(1e5), bend=tc.Bend(1e-7))
            scene.add_cloth(tc.grid(size, 2), fabric, contact=tc.ClothContact(5e-4))
        for fabric in tc.fabrics.values():
            scene.add_cloth(tc.grid((0.5, 2.0), 2), fabric)
        scene.add_cloth(plain(0.1, 50), fabric)  # triangles of 2 mm
    assert np.isclose(scene.vertex_count, 9 * (3 + len(tc.fabrics)) + 51**2)
