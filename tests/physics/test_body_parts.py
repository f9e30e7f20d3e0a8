"""Parts of a solid with friction of their own, or that cloth passes."""

import numpy as np
import pytest

import taichi_cloth as tc

ANGLE, THICK = np.radians(25), 0.004
FABRIC = tc.Fabric(0.2, tc.Stretch(300, 0.3), tc.Shear(100, 0.1), tc.Bend(1e-4))


def slope() -> tuple[tc.SolidMesh, np.ndarray, np.ndarray]:
    """An inclined plane 1 m wide in three strips, way down and way out of it."""
    flat = tc.grid((1.2, 1.6), (12, 4))
    turn = np.array([[1, 0, 0], [0, np.cos(ANGLE), -np.sin(ANGLE)], [0, np.sin(ANGLE), np.cos(ANGLE)]])
    groups = {name: np.flatnonzero((flat.uv[:, 0] > low - 1e-9) & (flat.uv[:, 0] < low + 0.4 + 1e-9))
              for name, low in (("slippery", 0.0), ("grippy", 0.4), ("open", 0.8))}
    return tc.SolidMesh(flat.x @ turn.T, flat.faces, groups=groups), turn @ [0, 0, 1], turn @ [0, 1, 0]


@pytest.mark.slow
def test_each_part_has_its_friction_and_what_is_off_is_passed():
    """Three patches at 25 degrees: g (sin - mu cos), at rest, and free fall."""
    body, down, up = slope()
    scene, patch = tc.Scene(), tc.grid(0.2, 4)
    scene.add_solid(body, 0.3, THICK, name="slope", parts={"slippery": 0.2, "grippy": 0.8, "open": None})
    turn = np.stack([[1, 0, 0], up, down], axis=1)
    for k in range(3):
        at = (patch.x + [0.1 + 0.4 * k, 0, -0.6]) @ turn.T + THICK * up
        scene.add_cloth(patch, FABRIC, at, name=f"patch{k}")
    sim = tc.Simulation(scene, h=1 / 100)
    start = sim.positions().reshape(3, -1, 3)
    sim.run(0.4, fps=10)
    moved = sim.positions().reshape(3, -1, 3) - start
    v = sim.velocities().reshape(3, -1, 3).mean(axis=1)
    slides = 9.81 * (np.sin(ANGLE) - 0.2 * np.cos(ANGLE))
    assert v[0] @ down == pytest.approx(slides * 0.4, rel=0.03) and abs(v[0] @ up) < 1e-3
    assert np.abs(moved[1]).max() < 1e-4
    assert v[2, 1] == pytest.approx(-9.81 * 0.4, rel=1e-3) and moved[2, :, 1].max() < -0.7
    sim.close()


def test_parts_that_cannot_be(tmp_path):
    body, _, _ = slope()
    for parts, what in (({"gripy": 0.5}, "'gripy'"), ({"grippy": -1.0}, "friction of part 'grippy'"),
                        ({"grippy": "x"}, "'grippy'")):
        with pytest.raises(tc.SceneError, match=what):
            tc.Scene().add_solid(body, 0.3, THICK, parts=parts)
    with pytest.raises(tc.SceneError, match="not a group"):
        tc.Scene().add_solid(tc.Sphere(0.1), 0.3, THICK, parts={"grippy": 1.0})
    with pytest.raises(tc.SceneError, match="no face"):
        tc.Scene().add_solid(tc.SolidMesh(body.x, body.faces, groups={"tip": [0, 1]}), 0.3, THICK, parts={"tip": 1.0})
    with pytest.raises(tc.SceneError, match="group 'tip'"):
        tc.SolidMesh(body.x, body.faces, groups={"tip": [0, 999]})
    np.savez(tmp_path / "body.npz", positions=body.x[0], faces=body.faces, group_hand=np.arange(20))
    assert (tc.load_solid(tmp_path / "body.npz").groups["hand"] == np.arange(20)).all()
    (tmp_path / "body.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\ng hand\nf 1 2 3\ng arm\nf 2 4 3\n")
    assert sorted(tc.load_solid(tmp_path / "body.obj").groups["hand"].tolist()) == [0, 1, 2]
