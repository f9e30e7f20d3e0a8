"""A run on the objects of a user's .blend: evaluated by Blender, and held against the run's own positions."""

import json

import numpy as np
import pytest
from blends import FIRST, FPS, content, made_blend, with_blender  # noqa: F401  (a fixture)

from taichi_cloth.app.cli import main
from taichi_cloth.errors import OutputError
from taichi_cloth.io import blender, blendfile
from taichi_cloth.output.export.onto import onto
from taichi_cloth.output.export.pc2 import read_pc2
from taichi_cloth.output.folder import RunFolder
from taichi_cloth.output.recording import Recording

COUNT = 12  # frames


def fans(item) -> np.ndarray:
    """(m, 3) triangles of an object's polygons, from the last corner of each."""
    parts = np.split(item.corners, np.cumsum(item.counts)[:-1])
    return np.array([[p[-1], a, b] for p in parts for a, b in zip(p[:-2], p[1:-1])])


def recorded(folder, rng, pieces, fps=FPS):
    """A run of cloths (name, vertices, faces) at random places, from frame 2 on."""
    start = np.cumsum([0] + [n for _, n, _ in pieces])
    faces = [np.asarray(f) + k for (_, _, f), k in zip(pieces, start)]
    geometry = {"faces": np.concatenate(faces).astype(np.int32), "cloth_start": start,
                "cloth_faces": np.cumsum([0] + [len(f) for f in faces]), "cloth_names": np.array([p[0] for p in pieces])}
    x = rng.normal(size=(COUNT, start[-1], 3)).astype(np.float32)
    out = RunFolder(folder)
    out.write_geometry(geometry)
    for k in range(COUNT):
        out.write_frame(2 + k, {"t": np.array((2 + k) / fps), "x": x[k], "v": 0 * x[k]})
    out.write_manifest({"fps": fps, "frames": [2, 1 + COUNT]})
    out.close()
    return Recording(folder), x


@pytest.fixture(scope="module")
def items(made_blend):  # noqa: F811
    """Its objects, as the package reads them."""
    return blendfile.read(made_blend, None).items


@with_blender
@pytest.mark.parametrize("fps", [FPS, 30])
def test_objects_move_as_the_run_and_all_else_stays(tmp_path, rng, made_blend, items, fps):  # noqa: F811
    pieces = [(name, len(items[name].x), fans(items[name])) for name in ("Flag", "Curtain")]
    recording, x = recorded(tmp_path / "run", rng, pieces, fps)
    before, bytes_before = content(made_blend)[0], made_blend.read_bytes()
    files = onto(recording, made_blend, tmp_path / "new" / "shop.blend")
    n = len(items["Flag"].x)
    frames = [FIRST + (2 + k) / fps * FPS for k in range(COUNT)]
    after, got = content(files[0], frames)
    for k, frame in enumerate(frames):
        assert np.abs(got[f"{frame:g} Flag"] - x[k, :n]).max() < 1e-6 * (1 if fps == FPS else 4)
        assert np.abs(got[f"{frame:g} Curtain"] - x[k, n:]).max() < 1e-6 * (1 if fps == FPS else 4)
    assert made_blend.read_bytes() == bytes_before
    assert after["Curtain"][4].pop(1) == ["taichi_cloth", "MESH_CACHE", True, True]  # behind its rig's, before the rest
    assert after["Flag"][4].pop(0) == ["taichi_cloth", "MESH_CACHE", True, True]
    assert after == before
    assert str(got["path Curtain"]) == "//shop_cache/Curtain.pc2" and (files[0].parent / "shop_cache/Curtain.pc2") in files


@with_blender
def test_a_second_bake_takes_the_place_of_the_first(tmp_path, rng, made_blend, items, capsys):  # noqa: F811
    curtain = items["Curtain"]
    recorded(tmp_path / "run", rng, [("sheet", len(curtain.x), fans(curtain))])
    one, two = tmp_path / "one.blend", tmp_path / "two.blend"
    assert main(["blend", str(tmp_path / "run"), "--onto", str(made_blend), "--object", "Curtain", "--to", str(one)]) == 0
    assert main(["blend", str(tmp_path / "run"), "--onto", str(one), "--object", "sheet=Curtain", "--to", str(two)]) == 0
    assert "two_cache" in capsys.readouterr().out
    assert content(two)[0] == content(one)[0]
    assert sorted(f.name for f in tmp_path.glob("*.blend*")) == ["one.blend", "two.blend"]  # no copy of Blender's own


def item(counts=(4, 4), corners=(0, 1, 4, 3, 1, 2, 5, 4), n=6, linked=False, scale=1.0):
    """An object of two quads side by side."""
    world = np.tile(scale * np.eye(4), (COUNT, 1, 1))
    return blendfile.Item(np.zeros((n, 3)), np.array(corners), np.array(counts), None, np.zeros(len(counts), int), [], {},
                          world, "", [], linked)


def test_caches_are_in_the_objects_own_axes(tmp_path, rng, monkeypatch):
    """Positions of a cache, moved as its object is at that frame, are the run's, z up and in the file's unit."""
    recording, x = recorded(tmp_path / "run", rng, [("a", 6, QUADS)], 30)
    world = np.tile(np.eye(4), (COUNT, 1, 1))
    world[:, :3] += rng.normal(size=(COUNT, 3, 4))
    found = blendfile.Blend(["a"], 24.0, (5, 9), 0.1, {"a": item()._replace(world=world, before="Led", late=["Hook"])})
    asked = []
    monkeypatch.setattr(blendfile, "read", lambda path, only, times: asked.append((only, times)) or found)
    monkeypatch.setattr("taichi_cloth.output.export.onto._run", lambda source, target, choices: None)
    (tmp_path / "s.blend").write_bytes(b"any")
    target, cache, listed = onto(recording, tmp_path / "s.blend")
    assert target == tmp_path / "run/blend/s.blend" and cache == tmp_path / "run/blend/s_cache/a.pc2"
    (only, times), local = asked[0], read_pc2(cache)
    assert only == ["a"] and times == pytest.approx([k / 30 for k in range(2, 2 + COUNT)])
    for k in range(COUNT):
        there = local[k].astype(float) @ world[k, :3, :3].T + world[k, :3, 3]
        assert 0.1 * there == pytest.approx(x[k][:, [0, 2, 1]] * [1, -1, 1], abs=1e-5)
    assert json.loads(listed.read_text()) == [{"object": "a", "file": "a.pc2", "before": "Led", "scale": 1.25,
                                               "start": pytest.approx(1.25 * (5 + 2 / 30 * 24))}]
    assert recording.notes == ["'a': modifier 'Hook' comes after its cache and moves it once more, as the modifiers "
                               "before that change its vertices",
                               "the run ends at frame 15.4, and the scene at 9"]


QUADS = [[0, 1, 4], [0, 4, 3], [1, 2, 4], [2, 5, 4]]  # cut along one diagonal, and along the other


@pytest.mark.parametrize("there, words", [
    (item(n=7), "'a' has 7 vertices, and cloth 'a' of the run 6: it was made of another mesh"),
    (item(corners=(0, 1, 4, 3, 2, 1, 5, 4)), "other faces than cloth 'a' of the run, or its vertices in another order"),
    (item(counts=(4,), corners=(0, 1, 4, 3)), "other faces than cloth 'a'"),
    (item(linked=True), "'a' is linked from another file"),
    (item(scale=0.0), "'a' is scaled to nothing at frame 2 of the run")])
def test_another_mesh_is_refused_and_nothing_written(tmp_path, rng, monkeypatch, there, words):
    recording, _ = recorded(tmp_path / "run", rng, [("a", 6, QUADS)])
    (tmp_path / "s.blend").write_bytes(b"any")
    monkeypatch.setattr(blendfile, "read", lambda *_: blendfile.Blend(["a"], 24.0, (1, 9), 1.0, {"a": there}))
    with pytest.raises(OutputError, match=words):
        onto(recording, tmp_path / "s.blend")
    assert not (tmp_path / "run/blend").exists()


@pytest.mark.parametrize("words, said", [
    (["--onto", "SHOP", "--object", "b"], "--object 'b': the run has the cloths a, flag: say CLOTH=OBJECT"),
    (["--onto", "SHOP", "--object", "fleg=b"], "the run has no cloth 'fleg'; did you mean 'flag'"),
    (["--onto", "SHOP", "--object", "a=b", "--object", "flag=b"], "object 'b' is named for 2 cloths"),
    (["--onto", "SHOP", "--object", "a=b", "--object", "a=c"], "cloth 'a' has 'b' already"),
    (["--onto", "SHOP", "--to", "SHOP"], "is the file that it is read from, and stays as it is"),
    (["--onto", "SHOP", "--to", "x.usd"], "the new file must be a .blend"),
    (["--onto", "SHOP", "--weld"], "leave out --panels and --weld"),
    (["--object", "a"], "name a .blend with --onto"),
    (["--onto", "shap.blend"], "no such file: shap.blend"),
    (["--onto", "SHOP"], "a .blend is read by Blender, and neither its module bpy nor")])
def test_what_cannot_be_put_on_is_one_line(tmp_path, rng, monkeypatch, capsys, words, said):
    monkeypatch.setattr(blender, "command", lambda script: None)
    recorded(tmp_path / "run", rng, [("a", 6, QUADS), ("flag", 6, QUADS)])
    shop = tmp_path / "shop.blend"
    shop.write_bytes(b"any")
    assert main(["blend", str(tmp_path / "run"), *(str(shop) if w == "SHOP" else w for w in words)]) == 2
    told = capsys.readouterr().err
    assert told.startswith("error: ") and said in told and told.count("\n") == 1
    assert sorted(f.name for f in tmp_path.iterdir()) == ["run", "shop.blend"]


@with_blender
def test_an_object_that_is_not_there(tmp_path, rng, made_blend):  # noqa: F811
    recording, _ = recorded(tmp_path / "run", rng, [("a", 6, QUADS)])
    with pytest.raises(OutputError, match="has no mesh object 'Curtian'; did you mean 'Curtain'"):
        onto(recording, made_blend, objects={"a": "Curtian"})
    assert json.loads((tmp_path / "run/manifest.json").read_text())["fps"] == FPS
