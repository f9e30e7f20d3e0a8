"""Cloth that starts inside solids or through them: notes and last words, by places that are known."""

import numpy as np
import pytest

import taichi_cloth as tc

FABRIC = tc.Fabric(0.15, tc.Stretch(1000, k_d=1.0), tc.Shear(100), tc.Bend(5e-5))
THICKNESS = 0.008
TUBE = tc.SolidMesh(*tc.Box((0.04, 1.0, 0.04)).core()[:2])


def sheet(shape, lift: float, **solid) -> tc.Simulation:
    """A square of .8 m with its middle, vertex 144, above the solid's by `lift` [m]."""
    scene, mesh = tc.Scene(), tc.grid(0.8, 16)
    scene.add_solid(shape, 0.3, THICKNESS, name="thing", **solid)
    scene.add_cloth(mesh, FABRIC, positions=mesh.x + [-0.4, lift, 0.4], name="cloth")
    return tc.Simulation(scene, h=1 / 60)


@pytest.mark.parametrize("shape, lift, deep, move", [
    (tc.Sphere(0.24), 0.0, 0.24, (0, 0.248, 0)), (tc.Sphere(0.24), -0.01, 0.23, (0, -0.238, 0)),
    (tc.Box((0.2, 0.3, 0.2)), 0.0, 0.1, (0, 0.158, 0)),
    (tc.Capsule((0, -0.6, 0), (0, 0.6, 0), 0.1), 0.0, 0.1, (0.508, 0, 0))])
def test_cloth_that_starts_through_a_solid_is_told_how_deep_and_where_to_start(shape, lift, deep, move):
    """And where it is told to start, there is nothing to tell."""
    said, = (note for note in sheet(shape, lift).notes if "starts through" in note)
    assert said.startswith("thing: 'cloth' starts through it: ")
    assert f"the deepest, vertex 144 at (0, {lift:.4g}, 0) m, by {deep:g} m" in said
    if isinstance(shape, tc.Sphere):
        flat = np.linalg.norm(tc.grid(0.8, 16).x - [0.4, -lift, -0.4], axis=1)
        assert f": {(flat < 0.24).sum()} of 289 vertices start inside" in said
    there = [float(c) for c in said.partition("moved by (")[2].partition(")")[0].split(",")]
    assert there == pytest.approx(np.multiply(move, 1.01), abs=2e-3)
    assert not any("start" in note for note in moved(shape, lift, there).notes)


def moved(shape, lift: float, by: list[float]) -> tc.Simulation:
    scene, mesh = tc.Scene(), tc.grid(0.8, 16)
    scene.add_solid(shape, 0.3, THICKNESS)
    scene.add_cloth(mesh, FABRIC, positions=mesh.x + [-0.4, lift, 0.4] + np.array(by))
    return tc.Simulation(scene, h=1 / 60)


def test_a_thin_solid_between_vertices_is_told_of_too():
    said, = (note for note in sheet(TUBE, 0.0, position=(0.025, 0.0, 0.025)).notes if "starts through" in note)
    assert said.startswith("thing: 'cloth' starts through it, in ") and "start it clear" in said


@pytest.mark.parametrize("shape, lift", [(tc.Plane((0, 1, 0)), -0.05), (tc.Sphere(0.25), 0.2)])
def test_cloth_that_comes_out_on_one_side_is_only_said_to_be_pushed_out(shape, lift):
    said, = (note for note in sheet(shape, lift).notes if "start inside" in note)
    assert said.endswith("they are pushed out over the first steps") and "through" not in said


def test_a_run_that_gives_up_names_the_start_and_no_slower_motion():
    sim = sheet(tc.Sphere(0.25), 0.0)
    with pytest.raises(tc.SimulationError, match="STRETCH") as caught:
        sim.step()
    said = str(caught.value)
    assert "The start is the likely cause. thing: 'cloth' starts through it" in said and "moved by (0, 0.261, 0) m" in said
    assert "slow the motion down" not in said and "stretch_limit" not in said


def test_a_run_that_gives_up_later_is_told_of_its_motion():
    """Once cloth that started inside is out, another cause has its own advice."""
    sim = sheet(tc.Plane((0, 1, 0)), -0.05)
    assert "start inside it" in sim.stepper.advise("STRETCH")
    sim.run(0.5, 30)
    assert "slow the motion down" in sim.stepper.advise("STRETCH")


def test_a_garment_is_to_be_put_on_the_body_as_it_starts():
    """A tube sewn along a line, half in its body, as one that was put on in another pose: to move it off is no advice."""
    scene, sheet = tc.Scene(), tc.grid((0.4 * np.pi, 0.5), (24, 10))
    scene.add_solid(tc.SolidMesh(*tc.Capsule((0.1, -0.2, 0.0), (0.1, 0.7, 0.0), 0.18).surface()), 0.3, THICKNESS, name="body")
    angle = sheet.uv[:, 0] / 0.2
    x = np.column_stack([0.2 * np.cos(angle), sheet.uv[:, 1], 0.2 * np.sin(angle)])
    cloth = scene.add_cloth(sheet, FABRIC, positions=x, name="shirt")
    scene.sew(cloth, sheet.select("left"), sheet.select("right"))
    said, = (note for note in tc.Simulation(scene).notes if "starts through" in note)
    assert said.endswith("with the same scale, clip and rest as load_solid has") and "moved by" not in said
