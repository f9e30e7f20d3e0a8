"""What a notebook shows of scenes and simulations, and that objects say what they are in one short line."""

import base64
import re

import numpy as np
import pytest
from test_cli import read_png

import taichi_cloth as tc

FABRIC = tc.Fabric(0.2, tc.Stretch(100))


@pytest.fixture
def picture(tmp_path):
    """A function: the picture in what a notebook shows."""
    def read(text):
        data = base64.b64decode(re.search(r'<img src="data:image/png;base64,([\w+/=]+)"', text)[1])
        (tmp_path / "shown.png").write_bytes(data)
        return read_png(tmp_path / "shown.png")

    return read


@pytest.fixture
def scene():
    made = tc.Scene(view=tc.View(tc.Camera((1.5, 1.5, 2.0), (0.25, 0, 0.25))))
    sheet = made.add_cloth(tc.grid(0.5, 4), FABRIC, name="<sheet>", color="crimson", contact=tc.ClothContact(0.004, 0.2))
    made.add_solid(tc.Sphere(0.1), 0.4, 0.005, position=lambda t: (0, -1 - t, 0), name="ball")
    made.pin(sheet, "top")
    made.sew(sheet, [0, 1], [24, 23])
    return made


def test_a_scene_is_shown_before_it_runs(scene, picture):
    text = scene._repr_html_()
    cells = [re.findall("<td>(.*?)</td>", row) for row in re.findall("<tr>(.*?)</tr>", text)]
    assert [row[:2] for row in cells] == [["cloth", "&lt;sheet&gt;"], ["solid", "ball"], ["seams", "&lt;sheet&gt;"]]
    assert cells[0][2] == "25 vertices, 32 triangles, 0.5 x 0 x 0.5 m, 0.05 kg, 5 vertices held, layers 0.004 m apart"
    assert cells[1][2] == "Sphere(radius=0.1), friction 0.4, thickness 0.005 m, moves" and "1 of 2 stitches" in cells[2][2]
    image = picture(text)
    assert image.shape == (360, 480, 3)
    red = (image[..., 0].astype(int) - image[..., 1:].max(axis=-1) > 60).mean()
    assert 0.01 < red < 0.5  # crimson cloth, nothing else


def test_a_simulation_is_shown_as_it_now_is(picture):
    made = tc.Scene(view=tc.View(tc.Camera((1, 1, 2), (0.25, 0, 0.25))))
    made.add_cloth(tc.grid(0.5, 4), FABRIC)
    with tc.Simulation(made, h=1 / 60, integrator="verlet") as sim:
        before = picture(sim._repr_html_())
        sim.run(0.2, fps=30)
        text = sim._repr_html_()
        assert "t = 0.2 s" in text and "verlet" in text and (picture(text) != before).any()
    text = sim._repr_html_()
    assert "closed" in text and "<img" not in text


def test_what_cannot_be_shown_is_said(scene, monkeypatch):
    assert "no cloth" in tc.Scene()._repr_html_()
    monkeypatch.setattr("taichi_cloth.recording.shown.render", lambda *a, **k: 1 / 0)
    text = scene._repr_html_()
    assert "<td>ball</td>" in text and "no picture: ZeroDivisionError" in text and "<img" not in text
    scene.cloths[0].contact.__dict__["thickness"] = None
    text = scene._repr_html_()
    assert text.startswith("<p>") and "TypeError" in text and "\n" not in text


def test_a_scene_that_cannot_be_drawn_is_named(scene):
    with pytest.raises(tc.SceneError, match="heat: a scene has no state"):
        tc.render(scene, heat="stretch")
    with pytest.raises(tc.SceneError, match="no cloth"):
        tc.render(tc.Scene())
    with pytest.raises(tc.SceneError, match="a Simulation, a Recording or a Scene"):
        tc.render("scene")


def test_objects_say_what_they_are_in_a_short_line(scene):
    bent = tc.Scene()
    fabric = tc.Fabric(0.2, tc.Stretch(100), bend=tc.Bend(1e-5))
    cloth = bent.add_cloth(tc.grid(0.5, 4), fabric, tear=tc.Tear(50.0, length=0.2))
    score = bent.score(cloth, [(0, 0.25), (0.5, 0.25)], 0.5)
    mesh = tc.grid(0.5, 4)
    ironed = bent.add_cloth(mesh, tc.Fabric(0.2, tc.Stretch(100), bend=tc.Bend(1e-5)))
    corners = np.array([[0.0, 0], [1, 0], [0, 1]])
    panel = tc.Panel("front", corners, (tc.Curve(0, 1), tc.Curve(1, 2), tc.Curve(2, 0)))
    x = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    faces = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]
    gas = bent.add_cloth(tc.TriMesh(x, faces), FABRIC)
    for what, words in (
            (mesh, "25 vertices, 32 triangles"), (scene.cloths[0], "'<sheet>' of 25 vertices, 32 triangles"),
            (cloth, "25 vertices"), (scene.solids[0], "'ball': Sphere(radius=0.1), moves"), (scene.seams[0], "2 stitches"),
            (tc.SolidMesh(np.stack([x, x + 1]), faces, fps=24), "4 vertices, 4 triangles, closed, 2 frames"),
            (score, "4 edges"), (bent.crease(ironed, 1.0, edges=mesh.inner_edges[:3]), "3 edges"),
            (panel, "'front' with 3 edges"),
            (tc.Pattern((panel,)), "1 panels"), (tc.Garment(mesh, (([0, 1], [24, 23], "flat"),)), "25 vertices, 1 seams"),
            (tc.Texture(np.zeros((4, 6, 3), dtype=np.uint8)), "6 x 4 pixels"), (bent.inflate(gas, 5.0), "'constant'"),
            (scene, "seams"), (tc.Scene(), "no cloth")):
        assert words in repr(what) and "\n" not in repr(what) and len(repr(what)) < 100, repr(what)
