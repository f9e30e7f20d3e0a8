"""Runs laid side by side: where they part, and which frames are picked."""

import numpy as np
import pytest

import taichi_cloth as tc
from taichi_cloth.errors import OutputError
from taichi_cloth.output.folder import RunFolder
from taichi_cloth.output.recording import Recording
from taichi_cloth.recording.material import locate
from taichi_cloth.recording.playback import distances, parting, spread
from taichi_cloth.recording.resuming import differences


def run(path, last, fps=10, off=0.0, at=3, n=4):
    """Frames 0 to `last` of n vertices; from frame `at` on vertex 2 is `off` [m] away."""
    folder = RunFolder(path)
    for k in range(last + 1):
        x = np.arange(3.0 * n).reshape(n, 3) + k
        if k >= at:
            x[2, 1] += off
        folder.write_frame(k, {"x": x.astype(np.float32)})
    folder.write_geometry({"x": np.zeros((n, 3)), "faces": np.array([[0, 1, 2], [0, 2, 3]]), "uv": np.zeros((2, 3, 2)),
                           "cloth_names": np.array([f"cloth of {n}"]), "cloth_faces": np.array([0, 2])})
    folder.write_manifest({"fps": fps, "frames": [0, last]})
    folder.close()
    return Recording(path)


def test_where_runs_part(tmp_path):
    a, b = run(tmp_path / "a", 5), run(tmp_path / "b", 4, off=0.25)
    apart = distances(a, b)
    assert sorted(apart) == [0, 1, 2, 3, 4] and (apart[2] == 0).all() and apart[3].tolist() == [0, 0, 0.25, 0]
    assert parting(a, b, 1e-6) == ["the motion parts at frame 3 (t = 0.3 s): RMS 0.125 m, vertex 2 by 0.25 m",
                                   "at the end, t = 0.4 s: RMS 0.125 m, 0.80% of the size 15.6 m",
                                   "in all 5 frames: RMS 0.0791 m, largest 0.25 m"]  # of 20 distances two are .25
    assert parting(a, b, 0.2) == ["the motion agrees in all 5 frames: no vertex is further apart than 0.25 m"]
    with pytest.raises(OutputError, match="of other cloths: cloth of 4 and cloth of 5"):
        distances(a, run(tmp_path / "c", 4, n=5))


def test_frames_are_picked_evenly_with_both_ends():
    numbers = list(range(3, 20))
    for count in (2, 3, 5, 16):
        picked = spread(numbers, count)
        assert len(picked) == count and picked[0] == 3 and picked[-1] == 19
        assert max(np.diff(picked)) - min(np.diff(picked)) <= 1
    assert spread(numbers, 17) == spread(numbers, 99) == numbers and spread(numbers, 1) == [3]


def test_differences_of_nested_dicts():
    assert differences({"a": 1, "b": {"c": (1, 2)}}, {"a": 1, "b": {"c": [1, 2]}}) == []
    assert differences({"a": 1, "b": {"c": 1}}, {"b": {"c": 2}, "d": 0}) == [
        "a was 1 and is None", "b.c was 1 and is 2", "d was None and is 0"]


def sheet(path, mesh, place, fps=10, last=4):
    """A recorded sheet whose points are where `place`, a function of material coordinates (n, 2) and time, puts them."""
    folder = RunFolder(path)
    for k in range(last + 1):
        folder.write_frame(k, {"x": place(mesh.uv, k / fps).astype(np.float32), "t": np.array(k / fps)})
    folder.write_geometry({"x": mesh.x, "faces": mesh.faces.astype(np.int32), "uv": mesh.corner_uv.astype(np.float32),
                           "cloth_names": np.array(["sheet"]), "cloth_faces": np.array([0, mesh.face_count])})
    folder.write_manifest({"fps": fps, "frames": [0, last]})
    folder.close()
    return Recording(path)


def test_runs_of_other_meshes_are_compared_at_the_same_material(tmp_path):
    def plane(uv, t):
        return uv @ np.array([[1.0, 0.2, 0.1], [0.3, -0.4, 0.8]]) + [t, 0, 0]

    def lifted(uv, t):
        return plane(uv, t) + np.column_stack([0 * uv[:, 0], 0.01 * uv[:, 0], 0 * uv[:, 0]])

    coarse = sheet(tmp_path / "coarse", tc.grid(1.0, 7), plane)
    fine = sheet(tmp_path / "fine", tc.grid(1.0, 16, diagonals="cross"), plane, fps=20, last=8)
    assert sorted(distances(coarse, fine)) == [0, 1, 2, 3, 4]  # frames 0, 2, 4 ... of the other
    for a, b in ((coarse, fine), (fine, coarse)):
        assert max(d.max() for d in distances(a, b).values()) < 1e-6
    bent = sheet(tmp_path / "bent", tc.grid(1.0, 40), lifted)
    mesh = tc.grid(1.0, 7)
    apart = distances(coarse, bent)[2]
    assert apart == pytest.approx(0.01 * np.abs(mesh.uv[:, 0]), abs=1e-6) and apart.max() > 5e-3
    said = parting(coarse, bent, 1e-6)
    expected = np.sqrt(np.average((0.01 * mesh.uv[:, 0]) ** 2, weights=np.bincount(
        mesh.faces.ravel(), np.repeat(mesh.material_areas / 3, 3))))
    assert f"of 64 vertices against 1,681, by material coordinates: RMS {expected:.3g} m" in said[1]
    with pytest.raises(OutputError, match="outside the other run's pattern"):
        distances(sheet(tmp_path / "large", tc.grid(3.0, 5), plane), coarse)


def test_points_are_found_in_their_triangles(rng):
    mesh = tc.disk(0.5, 9)
    triangles = mesh.corner_uv
    points = rng.uniform(triangles.min(axis=(0, 1)), triangles.max(axis=(0, 1)), (300, 2))
    row, weights, off = locate(points, triangles)
    here = np.einsum("nc,ncd->nd", weights, triangles[row])
    assert (weights >= 0).all() and weights.sum(axis=1) == pytest.approx(1)
    centre = triangles.reshape(-1, 2).mean(axis=0)
    inside = np.linalg.norm(points - centre, axis=1) < 0.49
    assert inside.sum() > 150 and np.abs(here - points)[inside].max() < 1e-6 and (off[inside] == 0).all()
    assert off[~inside].max() > 0.05


def test_points_past_a_border_are_given_the_nearest_triangle(rng):
    """Not the one whose centre is nearest: a long triangle lies beside them, a small one further off."""
    long = [[[0.0, 0.0], [9.0, 0.0], [9.0, 1.0]], [[0.0, 0.0], [9.0, 1.0], [0.0, 1.0]]]
    small = [[[x, 1.5], [x + 0.5, 1.5], [x, 2.0]] for x in np.arange(0.0, 9.0, 0.5)]
    triangles = np.array(long + small)
    edge = np.sqrt(2 * (2 * 4.5 + len(small) * 0.125) / len(triangles))  # of what they are in the mean
    points = np.column_stack([rng.uniform(0.5, 8.5, 200), rng.uniform(-0.9 * edge, -0.01, 200)])  # a cell is 2 edges wide
    assert (locate(points, triangles)[0] < len(long)).all()
