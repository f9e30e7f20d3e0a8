"""`taichi-cloth look`: the content of a file, in words and in a picture; pictures of solids alone."""

import contextlib
import io

import numpy as np
import pytest
from inside import ROOT, call
from test_cli import read_png

import taichi_cloth as tc
from taichi_cloth.app import looking
from taichi_cloth.app.cli import _parser
from taichi_cloth.app.looking import told
from taichi_cloth.io.animation.motion import Clip, Motion
from taichi_cloth.recording import looked
from taichi_cloth.scene.solids import SolidMesh


def drum(path, **more):
    """A drum that rises by .3 m in a second; its rims are there twice."""
    x, faces = tc.Cylinder(0.2, 0.4).surface()
    np.savez(path, positions=np.stack([x, x + [0, 0.1, 0], x + [0, 0.3, 0]]), faces=faces, fps=2.0,
             group_all=np.arange(len(x)), **more)
    return path


def test_look_says_what_a_file_holds(tmp_path):
    done = call("look", drum(tmp_path / "drum.npz"), "--scale", "1000")
    assert done.returncode == 0, done.stderr
    lines = done.stdout.splitlines()
    assert "drum.npz: <SolidMesh of" in lines[0] and "open, 3 frames>" in lines[0]
    assert lines[1].startswith("size    400 x 400 x 400 m (y is up), the lowest point at -200 m")
    assert lines[2] == "moves   3 frames at 2 a second, 1 s; a vertex goes 300 m from where it starts"
    assert lines[3].startswith("group   'all', ") and " border edges, 400 x 400 x" in lines[3]
    assert any("weld=" in line for line in lines)  # which would close it
    assert any("scale=0.01" in line for line in lines)  # which would make it a usual size
    welded = call("look", tmp_path / "drum.npz", "--weld", "1e-6")
    assert "closed, 3 frames>" in welded.stdout and "triangles, closed, 0.4 x" in welded.stdout


def test_look_at_a_scene_names_its_clips_and_parts(tmp_path):
    pytest.importorskip("pxr")
    from pxr import Usd, UsdGeom

    stage = Usd.Stage.CreateNew(str(tmp_path / "a.usda"))
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    for name in ("Hand", "Foot"):
        mesh = UsdGeom.Mesh.Define(stage, f"/{name}")
        mesh.CreatePointsAttr([(0, 0, 0), (1, 0, 0), (0, 1, 0)])
        mesh.CreateFaceVertexCountsAttr([3])
        mesh.CreateFaceVertexIndicesAttr([0, 1, 2])
    stage.GetRootLayer().Save()
    done = call("look", tmp_path / "a.usda", "--apart")
    assert "group   'Hand', 3 vertices, 1 triangles, 3 border edges" in done.stdout and "2 parts; no animation" in done.stdout
    assert "2 parts, together <SolidMesh" in done.stdout and "moves   no animation\n" in done.stdout
    assert "1 x 1 x 0 m, the lowest point at 0 m" in done.stdout
    assert "group   'Foot'" not in call("look", tmp_path / "a.usda", "--only", "Hand").stdout


def test_each_part_says_how_far_it_moves():
    """A walker beside a post: the whole goes as far as the walker, and a still solid says nothing of it."""
    x, faces = tc.Box((0.4, 1.0, 0.4), 0.0).surface()
    n = len(x)
    both, groups = np.concatenate([x, x + [2.0, 0, 0]]), {"walker": np.arange(n), "post": np.arange(n, 2 * n)}
    frames = np.stack([both + np.where(np.arange(2 * n) < n, s, 0.0)[:, None] * [0, 0, 1.5] for s in (0, 1, 0.2)])
    faces = np.concatenate([faces, faces + n])
    walker, post = told(SolidMesh(frames, faces, 24.0, groups), None)[-2:]
    assert walker.endswith(", goes 1.5 m") and post.endswith(", goes 0 m")
    assert "goes" not in "".join(told(SolidMesh(both, faces, groups=groups), None))


@pytest.mark.parametrize("size, up, scale, lies", [
    ((0.5, 1.7, 0.3), None, False, False),  # stands
    ((67.0, 15.0, 15.0), None, True, False), ((17.0, 67.0, 12.0), None, True, False),  # inches, or centimetres
    ((0.5, 6.7, 0.3), None, True, False), ((0.1, 0.17, 0.1), None, True, False),
    ((0.5, 0.3, 1.7), None, False, True), ((0.5, 0.3, 1.7), "y", False, False), ((20.0, 12.0, 67.0), None, True, True),
    ((0.5, 1.0, 1.7), None, False, False)])  # it sits
def test_a_figure_too_long_or_lying_is_told_with_the_way_out(size, up, scale, lies):
    x, faces = tc.Box(size, 0.0).surface()
    said = " ".join(looking.doubts(SolidMesh(np.stack([x, x + [0.1, 0, 0]]), faces, 24.0), up))
    assert ("tc.load_solid(path, scale=" in said and "`--scale`" in said) == scale
    assert ('tc.load_solid(path, up="z")' in said and "`--up z`" in said) == lies


def test_what_stands_still_need_not_be_as_long_as_a_person():
    assert looking.doubts(SolidMesh(*tc.Box((0.5, 6.7, 0.3), 0.0).surface())) == []


def test_clips_are_told_by_name_frames_and_length():
    x, faces = tc.Box((0.4, 1.0, 0.4), 0.0).surface()
    clips = (Clip("Walk", 29 / 24, 24.0), Clip("Wave", 0.5, 30.0))
    lines = told(SolidMesh(x, faces), Motion([], None, 1.0, "y", clips, (1,), ()))
    assert [line for line in lines if line.startswith("clip")] == ["clip    0 'Walk', 30 frames, 1.208 s",
                                                                   "clip    1 'Wave', 16 frames, 0.5 s, read"]


def test_parts_have_colours_of_their_own(tmp_path):
    """A file's body and what it wears beside it: two colours in the picture, in the middle of each."""
    x, faces = tc.Box((0.4, 1.0, 0.4), 0.0).surface()
    both = SolidMesh(np.concatenate([x, x + [1.0, 0, 0]]), np.concatenate([faces, faces + len(x)]),
                     groups={"body": np.arange(len(x)), "coat": np.arange(len(x), 2 * len(x))})
    looked.draw(both, tmp_path / "two.png", (96, 64), ["body", "coat"])
    looked.draw(both, tmp_path / "one.png", (96, 64))
    two, one = (read_png(tmp_path / f"{name}.png").astype(int) for name in ("two", "one"))
    hues = [image[..., 0] - image[..., 2] for image in (two, one)]  # red and blue against grey
    assert (hues[0] > 60).sum() > 100 and (hues[0] < -60).sum() > 100 and np.abs(hues[1]).max() < 60


def test_long_lists_are_summed_up():
    """Sixty groups and twenty clips: a line counts the rest; `--all` has them all; one left over is no line shorter."""
    x, faces = tc.Box((0.4, 1.0, 0.4), 0.0).surface()
    shape = SolidMesh(x, faces, groups={f"g{k}": np.arange(len(x)) for k in range(60)})
    clips = Motion([], None, 1.0, "y", tuple(Clip(f"c{k}", 1.0, 24.0) for k in range(20)), (1,), ())
    lines, every = told(shape, clips, 15), told(shape, clips)
    assert len(every) == 2 + 20 + 60 and len(lines) < 40
    assert lines[17].split() == "and 5 clips more; --all lists them".split()
    assert lines[-1].split() == "and 45 groups more; --all lists them".split()
    assert told(shape, clips, 59)[-60:] == every[-60:]


@pytest.mark.parametrize("name, made", [("drum.npz", "a.png"), ("shirt.json", "a.svg")])
def test_a_reader_that_goes_costs_no_picture(tmp_path, name, made):
    """`look FILE --to PICTURE | head -1`: the pipe is closed before all is printed, and the picture is there."""
    path = drum(tmp_path / name) if name == "drum.npz" else ROOT / "scenes" / "patterns" / name

    class Closed(io.StringIO):
        def write(self, text):
            if text:
                raise BrokenPipeError
            return 0

    args = _parser().parse_args(["look", str(path), "--to", str(tmp_path / made), "--size", "16x16"])
    with contextlib.redirect_stdout(Closed()), pytest.raises(BrokenPipeError):
        looking.run(args)
    assert (tmp_path / made).stat().st_size > 100


def test_look_refuses_before_it_draws(tmp_path):
    path = drum(tmp_path / "a.npz")
    for words, message in (((tmp_path / "none.glb",), "no such file"), ((path, "--to", "a.jpg"), "must end with .png"),
                           ((path, "--clip", "Walk"), "clip: has no animations to choose from")):
        done = call("look", *words)
        assert done.returncode == 2 and message in done.stderr and not list(tmp_path.glob("*.jpg"))


def test_look_at_a_pattern(tmp_path):
    """In words and as a drawing, whose panels are read as those of any other SVG."""
    path, to = ROOT / "scenes" / "patterns" / "shirt.json", tmp_path / "sheet.svg"
    done = call("look", path, "--to", to)
    pattern, lines = tc.load_pattern(path), done.stdout.splitlines()
    assert done.returncode == 0 and lines[0].endswith(f"shirt.json: {pattern!r}"), done.stderr
    for line, panel, again in zip(lines[1:], pattern.panels, tc.load_pattern(to).panels, strict=False):
        wide, high = np.ptp(panel.outline()[0], axis=0)
        assert line.startswith(f"panel   {panel.name!r}, {wide:.4g} x {high:.4g} m, warp at 0 degrees, {len(panel.edges)} ")
        assert f"{panel.edges[0].length(panel.corners):.3f}" in line
        one, other = (p.outline()[0] - p.corners[0] for p in (panel, again))
        assert panel.name == again.name and np.abs(one - other).max() < 1e-5
    for words, message in ((("--to", "a.png"), "must end with .svg"), (("--clip", "Walk"), "is a sewing pattern"),
                           (("--pattern-size", "M"), "has one size")):
        done = call("look", path, *words)
        assert done.returncode == 2 and message in done.stderr
    done = call("look", drum(tmp_path / "a.npz"), "--pattern-size", "M")
    assert done.returncode == 2 and "is not a sewing pattern" in done.stderr


@pytest.mark.slow
def test_a_solid_is_drawn_as_it_moves(tmp_path):
    done = call("look", drum(tmp_path / "drum.npz"), "--to", tmp_path / "a.png", "--size", "96x96")
    assert done.returncode == 0, done.stderr
    sheet = read_png(tmp_path / "a.png").astype(float)
    assert sheet.shape == (96, 4 * 96, 3)
    moments = [sheet[:, 96 * k: 96 * k + 96] for k in range(4)]
    dark = [np.argwhere(np.abs(m - np.median(m, axis=1, keepdims=True)).sum(axis=2) > 60)[:, 0].mean() for m in moments]
    assert dark[0] > dark[-1] + 5  # it rises
    scene = tc.Scene()
    with pytest.raises(tc.SceneError, match="the scene has no cloth and no solid"):
        tc.render(scene)
    scene.add_solid(tc.Sphere(0.3), friction=0.1, thickness=0.01)
    image = tc.render(scene, size=(96, 96))
    assert np.ptp(image[48].astype(int)) > 20
