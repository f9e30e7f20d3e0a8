"""Parts of a file in one surface: seams that close, sheets on each other, edges of more than two triangles, borders."""

import numpy as np
import pytest

import taichi_cloth as tc
from taichi_cloth.io.animation.motion import Motion, Part
from taichi_cloth.io.animation.surface import joined
from taichi_cloth.scene.mesh import distinct, face_edges

SQUARE = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], dtype=float)
TWO = np.array([[0, 1, 2], [0, 2, 3]])


def cube_of_faces() -> tuple[np.ndarray, np.ndarray]:
    """A unit cube whose six faces have vertices of their own, as where a file's normals are sharp."""
    x, faces = [], []
    for axis in range(3):
        for side in (0, 1):
            face = np.roll(SQUARE, axis, axis=1) if side else np.roll(SQUARE[::-1], axis, axis=1)
            normal = np.roll([0, 0, 1], axis)
            faces.append(TWO + 4 * len(x))
            x.append(face + side * normal)
    return np.concatenate(x), np.concatenate(faces)


def motion(*parts: tuple, fps=None) -> Motion:
    made = [Part(name, np.asarray(x, dtype=float).reshape(-1, *np.shape(x)[-2:]), np.asarray(faces), None, {})
            for name, x, faces in parts]
    return Motion(made, fps, 1.0, "y", (), (), ())


def most_at_an_edge(faces) -> int:
    return int(distinct(face_edges(faces))[1].max())


def test_a_cube_of_six_faces_is_closed(rng):
    x, faces = cube_of_faces()
    frames = np.stack([x, x @ np.linalg.qr(rng.normal(size=(3, 3)))[0], 3 * x + 1e-9 * rng.normal(size=x.shape)])
    made = joined(motion(("cube", frames, faces), fps=24), True, None)
    body = tc.SolidMesh(made.x, made.faces, 24)
    assert body.closed and body.x.shape == (3, 8, 3) and not made.notes
    assert joined(motion(("cube", x, faces)), True, 0.0).x.shape[1] == 24


def test_vertices_that_part_later_are_not_made_one():
    """Lips that are closed at first."""
    lower, upper = SQUARE - [0, 1, 0], SQUARE
    opened = np.stack([upper, upper + [0, 0.3, 0]])
    for frames, count in ((np.stack([upper, upper]), 6), (opened, 8)):
        x = np.concatenate([np.stack([lower, lower]), frames], axis=1)
        made = joined(motion(("face", x, np.concatenate([TWO, TWO + 4])), fps=24), True, None)
        assert made.x.shape[1] == count


def test_two_sides_of_a_sheet_become_one():
    back = np.concatenate([SQUARE, SQUARE]), np.concatenate([TWO, TWO[:, ::-1] + 4])
    made = joined(motion(("hair", *back)), True, None)
    assert made.x.shape[1] == 4 and len(made.faces) == 2 and made.groups["hair"].tolist() == [0, 1]
    assert "2 triangles lie on others" in made.notes[0]


def test_parts_that_lie_on_each_other_both_keep_their_faces():
    x, faces = cube_of_faces()
    made = joined(motion(("a", x, faces), ("b", x, faces)), True, None)
    assert len(made.faces) == 12 and made.groups["a"].tolist() == made.groups["b"].tolist() == list(range(12))
    apart = joined(motion(("a", x, faces), ("b", x, faces)), False, None)
    assert len(apart.faces) == 24 and not set(apart.groups["a"]) & set(apart.groups["b"])


def test_an_edge_of_three_triangles_is_cut_open():
    """A fin on a closed cube: the cube stays closed round it."""
    x, faces = cube_of_faces()
    made = joined(motion(("cube", x, faces)), True, None)
    edge = made.faces[0][:2]
    fin = np.concatenate([made.faces, [[edge[1], edge[0], 8]]])
    cut = joined(motion(("finned", np.concatenate([made.x[0], [[-3, -3, -3]]]), fin)), True, None)
    assert most_at_an_edge(fin) == 3 and most_at_an_edge(cut.faces) <= 2 and len(cut.faces) == 13
    assert "more than two triangles meet at an edge" in cut.notes[0]
    assert cut.x.shape[1] == 11 and tc.SolidMesh(cut.x, cut.faces[:12]).closed  # the fin has corners of its own
    x, faces = cut.x[0][cut.faces], fin  # every triangle is where it was
    assert np.allclose(np.sort(x.mean(axis=1), axis=0),
                       np.sort(np.concatenate([made.x[0], [[-3, -3, -3]]])[fin].mean(axis=1), axis=0))
    tc.SolidMesh(cut.x, cut.faces)  # which refuses such an edge


def test_a_part_that_vanishes_is_named():
    frames = np.stack([SQUARE, 0 * SQUARE + 5])
    with pytest.raises(tc.MeshError, match=r"part 'sword': has no size at 0.0417 s: leave it out \(only=\)"):
        joined(motion(("body", SQUARE, TWO), ("sword", frames, TWO), fps=24), True, None)


def test_an_open_solid_says_how_it_would_be_closed(tmp_path):
    x, faces = tc.Cylinder(0.2, 0.4).surface()
    np.savez(tmp_path / "split.npz", positions=x, faces=faces)
    split = tc.load_solid(tmp_path / "split.npz")
    assert not split.closed and "may be made one with them (tc.load_solid(weld=...))" in split.notes[0]
    whole = tc.load_solid(tmp_path / "split.npz", weld=1e-6)
    assert whole.closed and "were made one with others (weld=1e-06)" in whole.notes[0]
    more = tc.SolidMesh(np.concatenate([x, x[:3] + 5]), np.concatenate([faces, len(x) + np.arange(3)[None]]))
    assert "triangles over them would close it" in more.notes[0]  # not all of its border lies on itself
    top = whole.x[0][whole.faces].mean(axis=1)[:, 1] > 0.1999
    tube = tc.SolidMesh(whole.x[0], whole.faces[~top])
    note = next(note for note in tube.notes if "open" in note)
    assert "in a loop 0.4 m wide at (" in note and ", 0.2, " in note and "triangles over them would close it" in note
    bottom = whole.x[0][whole.faces].mean(axis=1)[:, 1] < -0.1999
    assert "border edges in 2 loops, the widest 0.4 m wide" in tc.SolidMesh(whole.x[0], whole.faces[~(top | bottom)]).notes[0]
