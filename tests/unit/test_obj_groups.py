"""Names of groups in exported OBJ files: which faces each has, as read here, and by the package's own reader."""

import numpy as np
import pytest

import taichi_cloth as tc
from taichi_cloth.output.folder import RunFolder
from taichi_cloth.recording import record


def recording(path, scene, **more):
    """A run of one frame, as the scene was built."""
    geometry, folder = record.as_built(scene) | more, RunFolder(path)
    x = geometry["x"].astype(np.float32)
    folder.write_geometry(geometry)
    folder.write_frame(0, {"t": np.array(0.0), "x": x, "v": 0 * x})
    folder.write_manifest({"fps": 10, "frames": [0, 0]})
    folder.close()
    return tc.Recording(path)


def faces_of(text: str) -> dict[tuple[str, str], list[list[int]]]:
    """Faces, as numbers of vertices in the file, by object and group."""
    out, at, group = {}, "", ""
    for line in text.splitlines():
        word, _, rest = line.partition(" ")
        if word in ("o", "g"):
            at, group = (rest, "") if word == "o" else (at, rest)
        elif word == "f":
            out.setdefault((at, group), []).append([int(c.split("/")[0]) for c in rest.split()])
    return out


@pytest.fixture
def scene():
    """Two triangles and a tail, in groups that overlap, that are no faces, and that have blanks in their names."""
    x = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [2, 1, 0.0]])
    faces = np.array([[0, 1, 2], [0, 2, 3], [1, 4, 2]])
    groups = {"front panel": [0, 1, 2, 3], "upper": [0, 2, 3], "edge": [0, 1], "all but one": [0, 1, 2, 4]}
    out = tc.Scene(gravity=None)
    out.add_cloth(tc.TriMesh(x, faces, groups={name: np.array(v) for name, v in groups.items()}), tc.Fabric(0.2), name="coat")
    out.add_cloth(tc.grid(1.0, 3), tc.Fabric(0.2), name="plain")
    return out


def test_faces_are_in_their_groups(scene, tmp_path):
    text = recording(tmp_path / "run", scene).export("obj", tmp_path / "obj")[-1].read_text()
    found = faces_of(text)
    assert found[("coat", "front_panel all_but_one")] == [[1, 2, 3]] and found[("coat", "all_but_one")] == [[2, 5, 3]]
    assert found[("coat", "front_panel upper")] == [[1, 3, 4]]
    assert {name for name, _ in found} >= {"coat", "plain"} and [g for o, g in found if o == "plain"] == ["plain"]
    read = tc.load(tmp_path / "obj" / "00000.obj").groups
    assert all(sorted(read[name]) == v for name, v in {"front_panel": [0, 1, 2, 3], "upper": [0, 2, 3],
                                                       "all_but_one": [0, 1, 2, 4]}.items())
    pc2 = recording(tmp_path / "again", scene).export("pc2", tmp_path / "pc2")[0].read_text()
    assert faces_of(pc2)[("coat", "front_panel upper")] == [[1, 3, 4]]


def test_a_face_in_no_group_is_in_its_objects(scene, tmp_path):
    scene.cloths[0].mesh.groups.pop("all but one")
    found = faces_of(recording(tmp_path / "run", scene).export("obj", tmp_path / "obj")[-1].read_text())
    assert found[("coat", "coat")] == [[2, 5, 3]] and found[("coat", "front_panel")] == [[1, 2, 3]]


def test_welded_panels_keep_their_names(tmp_path):
    x = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0.0]])
    mesh = tc.TriMesh(x, np.array([[0, 1, 2], [3, 4, 5]]), groups={"left": np.arange(3), "right": np.arange(3, 6)})
    scene = tc.Scene(gravity=None)
    scene.add_cloth(mesh, tc.Fabric(0.2), name="bag")
    sewn = {"sewn": np.array([0, 1, 2, 1, 4, 2]), "panel": np.array([0, 1]), "panel_names": np.array(["left", "right"])}
    run = recording(tmp_path / "run", scene, **sewn)
    for parts in ("cloths", "welded"):
        found = faces_of(run.export("obj", tmp_path / parts, parts)[-1].read_text())
        assert {key: len(rows) for key, rows in found.items() if key[0] == "bag"} == {("bag", "left"): 1, ("bag", "right"): 1}
    found = faces_of(run.export("obj", tmp_path / "panels", "panels")[-1].read_text())
    assert {("left", "left"), ("right", "right")} <= set(found)
