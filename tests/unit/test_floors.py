"""A floor among the parts of a file with a scene: found, told, left out by `look`."""

import numpy as np
import pytest
from glb import Glb

import taichi_cloth as tc
from taichi_cloth.app import cli
from taichi_cloth.io.floor import floor_among

TRIANGLES = [0, 1, 2, 0, 2, 3]


def square(side: float, height: float, tilt: float = 0.0) -> np.ndarray:
    """(4, 3) corners round the origin [m]."""
    return np.array([[a * side / 2, height + tilt * a, b * side / 2] for a, b in ((-1, 1), (1, 1), (1, -1), (-1, -1))])


def among(*parts: np.ndarray) -> str | None:
    """The floor among parts (4, 3) or (frames, 4, 3), named by their numbers."""
    frames = max(len(p) if p.ndim == 3 else 1 for p in parts)
    x = np.concatenate([np.broadcast_to(p, (frames, 4, 3)) for p in parts], axis=1)
    groups = {str(k): np.arange(4 * k, 4 * k + 4) for k in range(len(parts))}
    return floor_among(x, groups, list(groups))


CLOTH = np.stack([square(1.0, 1.0), square(1.0, 0.8, 0.3)])


@pytest.mark.parametrize("part, found", [
    (square(5.0, 0.0), True), (square(5.0, 0.51), True),  # the cloth dips into it by a little
    (square(5.0, 0.9), False), (square(5.0, 3.0), False),  # a table that the cloth hangs over; a ceiling
    (square(0.6, 0.0), False), (square(5.0, 0.0, 0.1), False), (square(5.0, 0.0) + [4.0, 0, 0], False),
    (np.stack([square(5.0, 0.0), square(5.0, -0.2)]), False),  # a lift
    (np.stack([square(5.0, 0.0), square(5.0, 0.0) + [0.3, 0, 0]]), False)])  # a cart
def test_it_is_level_and_still_and_lies_below_and_round_all_others(part, found):
    assert among(CLOTH, part) == ("1" if found else None)
    assert among(part) is None


@pytest.fixture
def file(tmp_path):
    """A sheet of 1 m above a floor of 20 m."""
    glb = Glb(nodes=[{"name": "sheet", "mesh": 0}, {"name": "ground", "mesh": 1}])
    glb.document["meshes"] = [{"primitives": [{"attributes": {"POSITION": glb.add(x)}, "indices": glb.add(TRIANGLES, "u2")}]}
                              for x in (square(1.0, 0.0), square(20.0, -1.25))]
    return glb.write(tmp_path / "a.glb")


def test_loading_it_says_how_it_is_left_out(file):
    pytest.importorskip("pygltflib")
    for load in (tc.load, tc.load_solid):
        assert any("part 'ground' is level and lies below" in note and "only='sheet'" in note for note in load(file).notes)
        assert not any("floor" in note for note in load(file, only="sheet").notes)


def test_look_leaves_it_out_of_sizes_and_pictures(file, tmp_path, capsys, monkeypatch):
    pytest.importorskip("pygltflib")
    drawn = []
    monkeypatch.setattr("taichi_cloth.recording.looked.draw", lambda *words: drawn.append(words))
    assert cli.main(["look", str(file), "--to", str(tmp_path / "a.png")]) == 0
    said = capsys.readouterr().out
    assert "size    1 x 0 x 1 m" in said and "floor   'ground', 20 x 20 m at -1.25 m" in said
    assert "--up z" not in said and "scale" not in said and "as a floor" not in said
    shape, *_, ground = drawn[0]
    assert np.ptp(shape.x[0], axis=0) == pytest.approx([1, 0, 1]) and ground == pytest.approx(-1.25)
    assert cli.main(["look", str(file), "--only", "ground"]) == 0
    assert "size    20 x 0 x 20 m" in capsys.readouterr().out
