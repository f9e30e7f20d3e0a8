"""Pictures by the command line and from Python, of a run whose cloth falls further than its scene foresees."""

import json
import re
import sys

import numpy as np
import pytest

import taichi_cloth as tc
from taichi_cloth.app import cli
from taichi_cloth.output.camera import frame as axes_of
from taichi_cloth.output.look import Look

SCENE = '''"""A handkerchief that falls through nothing."""
import taichi_cloth as tc


def build(speed: float = 4.0):
    scene = tc.Scene()
    scene.add_cloth(tc.grid(0.4, 4), tc.Fabric(0.2, tc.Stretch(100)), velocities=(speed, 0, 0), name="cloth")
    return scene
'''
pytestmark = pytest.mark.restarts  # the command `render` draws in f32

SIZE, SMALL = (64, 48), ["--size", "64x48"]


@pytest.fixture(scope="module")
def fallen(tmp_path_factory):
    folder = tmp_path_factory.mktemp("pictures")
    (folder / "falls.py").write_text(SCENE)
    assert cli.main(["run", str(folder / "falls.py"), "--out", str(folder / "run"), *SMALL, "--duration", "0.3", "--fps", "30",
                     "--frames", "2:8:3", "--background", "transparent", "--passes", "id", "--light", "-1,1,0.5",
                     "--checkpoint-every", "0"]) == 0
    return folder / "run"


def alpha_of(path):
    image = pytest.importorskip("PIL.Image").open(path)
    return np.array(image)[..., 3]


def test_a_run_draws_what_was_asked_and_says_that_cloth_was_cut(fallen, capsys):
    names = sorted(p.name for p in (fallen / "images").iterdir())
    assert names == [f"{k:05d}{end}" for k in (2, 5, 8) for end in (".id.npy", ".png")]
    assert cli.main(["run", str(fallen.parent / "falls.py"), "--out", str(fallen.parent / "again"), *SMALL, "--fps", "30",
                     "--duration", "0.3", "--frames", "9"]) == 0
    said = capsys.readouterr().err
    assert "cloth left the picture in 1 of 1 frames" in said and "taichi-cloth render" in said


def test_a_run_says_that_cloth_came_below_the_ground_of_its_pictures(fallen, capsys):
    """Which was placed before, by a scene that names a camera and no ground: drawn again, the ground is below all frames."""
    scene = fallen.parent / "seen.py"
    scene.write_text(SCENE.replace("tc.Scene()", "tc.Scene(view=tc.View(tc.Camera((1, 1, 2), (0, 0, 0))))"))
    assert cli.main(["run", str(scene), "--out", str(fallen.parent / "seen"), *SMALL, "--fps", "30", "--duration", "0.3",
                     "--frames", "0:9:9"]) == 0
    assert "below the ground of the picture in 1 of 2 frames" in capsys.readouterr().err
    assert cli.main(["render", str(fallen.parent / "seen"), *SMALL]) == 0
    assert "below the ground" not in "".join(capsys.readouterr())


@pytest.mark.parametrize("flags, count", [
    ([], 10), (["--frames", "7:9"], 3), (["--frames", "9"], 1), (["--frames", "8:9", "--speed", "0.5"], 3)])
def test_all_of_the_cloth_is_in_all_pictures(fallen, tmp_path, flags, count):
    """And fills them, as far as it moves in the frames that are drawn."""
    assert cli.main(["render", str(fallen), "--to", str(tmp_path), *SMALL, "--background", "transparent", *flags]) == 0
    files = sorted(tmp_path.glob("*.png"))
    assert len(files) == count
    seen = [alpha_of(f) for f in files]
    for alpha in seen:
        assert alpha.max() == 255 and not (alpha[0].any() or alpha[-1].any() or alpha[:, 0].any() or alpha[:, -1].any())
    across = np.flatnonzero(np.max(seen, axis=0).any(axis=0))
    down = np.flatnonzero(np.max(seen, axis=0).any(axis=1))
    assert np.ptp(across) > 0.75 * 64 or np.ptp(down) > 0.75 * 48, "and fills them"


@pytest.mark.parametrize("side, towards", [("front", (0, 1)), ("back", (0, -1)), ("left", (-1, 0)), ("right", (1, 0))])
def test_a_camera_is_named_by_its_side(fallen, side, towards):
    """From there it sees all cloth of all frames, as near as the usual one: it fills the picture."""
    from taichi_cloth.output.picture import Artist

    run = tc.Recording(fallen)
    artist = Artist(run.geometry, SIZE, Look(camera=side), lambda: map(run.frame, run.frames()))
    eye, target = (np.array(point)[[0, 2]] for point in (artist.camera.eye, artist.camera.target))
    assert (eye - target) / np.linalg.norm(eye - target) == pytest.approx(towards, abs=1e-9)
    x = np.concatenate([run.frame(k)["x"] for k in run.frames()]).astype(float)
    seen = axes_of(artist.camera).project(x, *SIZE)[:, :2]
    assert (seen > 0).all() and (seen < SIZE).all() and (np.ptp(seen, axis=0) / SIZE).max() > 0.75


def test_a_side_is_drawn_and_a_wrong_one_names_all(fallen, tmp_path, capsys):
    assert cli.main(["render", str(fallen), "--to", str(tmp_path), *SMALL, "--camera", "back", "--frames", "9"]) == 0
    assert (tmp_path / "00009.png").is_file()
    with pytest.raises(SystemExit):
        cli.main(["render", str(fallen), "--camera", "rear"])
    assert "'rear': needs front, back, left, right, or EYE:TARGET" in capsys.readouterr().err
    with pytest.raises(tc.SceneError, match="unknown camera 'rear'; known: back, front, left, right"):
        Look(camera="rear")


@pytest.mark.parametrize("camera, cut", [("0.5,2,5:0.5,0,0", 0), ("0,0.4,0.8:0,0,0", 4)])
def test_a_camera_that_cuts_cloth_off_is_named(fallen, tmp_path, capsys, camera, cut):
    """The cloth goes along x, out of a picture of where it begins."""
    flags = ["--to", str(tmp_path), *SMALL, "--frames", "6:9", "--camera", camera]
    assert cli.main(["render", str(fallen), *flags]) == 0
    x = np.concatenate([np.load(fallen / f"frames/{k:05d}.npz")["x"] for k in (6, 7, 8, 9)])
    low, high = (", ".join(f"{v:.3g}" for v in end) for end in (x.min(axis=0), x.max(axis=0)))
    said = f"outside the picture in 4 of 4 frames, through the camera that was given: it is from ({low}) to ({high}) m"
    assert (said in capsys.readouterr().err) == bool(cut)


def test_a_turntable_sees_a_frame_from_all_round(fallen, tmp_path):
    """The handkerchief is nearly a square that is moved level: after a quarter turn it looks the same, after an eighth not."""
    flags = ["--to", str(tmp_path), *SMALL, "--background", "transparent", "--floor", "none", "--turntable", "8"]
    assert cli.main(["render", str(fallen), *flags, "--frame", "4"]) == 0
    files = sorted(tmp_path.glob("*.png"))
    assert [f.name for f in files] == [f"{k:05d}.png" for k in range(8)]
    seen = [alpha_of(f).astype(int) for f in files]
    for alpha in seen:
        assert alpha.max() == 255 and not (alpha[0].any() or alpha[-1].any() or alpha[:, 0].any() or alpha[:, -1].any())
    across, down = (np.ptp(np.flatnonzero(np.max(seen, axis=0).any(axis=k))) for k in (0, 1))
    assert across > 0.75 * 64 or down > 0.75 * 48
    apart = [np.abs(alpha - seen[0]).mean() for alpha in seen]
    assert max(apart[2], apart[4], apart[6]) < 0.5 * min(apart[1], apart[3], apart[5], apart[7])


def test_a_slow_film_has_the_frames_between(fallen, tmp_path):
    flags = ["--to", str(tmp_path), *SMALL, "--background", "transparent", "--speed", "0.5", "--frames", "3:5"]
    assert cli.main(["render", str(fallen), *flags, "--camera", "0,1,3:0.5,0,0"]) == 0
    across = [np.flatnonzero(alpha_of(f).any(axis=0)).mean() for f in sorted(tmp_path.glob("*.png"))]
    steps = np.diff(across)
    assert len(across) == 5 and (steps > 0.4).all() and np.ptp(steps) < 1.1  # level and steady, within a pixel


@pytest.mark.slow
def test_python_and_the_command_draw_the_same(fallen, tmp_path):
    pil = pytest.importorskip("PIL.Image")
    plaid = np.zeros((6, 4, 3), np.uint8)
    plaid[::2] = (200, 30, 30)
    pil.fromarray(plaid).save(tmp_path / "plaid.png")
    flags = ["--frames", "1:7:3", "--camera", "-1,0.5,2:0.5,-0.2,0", "--passes", "depth,id", "--smooth", "1", "--bits", "16",
             "--texture", f"cloth={tmp_path / 'plaid.png'}@0.1x0.15", "--back", "navy", "--floor", "tan", "--no-squares"]
    assert cli.main(["render", str(fallen), "--to", str(tmp_path / "a"), *SMALL, *flags]) == 0
    look = {"camera": tc.Camera((-1, 0.5, 2), (0.5, -0.2, 0)), "smooth": 1, "bits": 16, "floor": "tan", "quality": "fast",
            "appearance": {"": tc.Appearance(back="navy", squares=False),
                           "cloth": tc.Appearance(texture=tc.Texture(tmp_path / "plaid.png", (0.1, 0.15)))}}
    recording = tc.Recording(fallen)
    tc.render_frames(recording, tmp_path / "b", range(1, 8, 3), SIZE, passes=("depth", "id"), **look)
    names = sorted(p.name for p in (tmp_path / "a").iterdir())
    assert names == [f"{k:05d}{end}" for k in (1, 4, 7) for end in (".depth.npy", ".id.npy", ".png")] + ["id_names.json"]
    for name in names:
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes(), name
    assert json.loads((tmp_path / "a" / "id_names.json").read_text()) == {"0": "nothing", "1": "cloth", "2": "ground"}
    passes = tc.passes(recording, 4, SIZE, **{k: v for k, v in look.items() if k not in ("bits", "appearance")})
    assert (np.load(tmp_path / "a" / "00004.depth.npy") == passes["depth"]).all() and set(np.unique(passes["id"])) >= {1, 2}
    assert tc.render(recording, frame=4, size=SIZE, **look).dtype == np.uint16


@pytest.mark.slow
def test_a_shutter_is_open_until_the_next_frame(fallen, tmp_path):
    """Cloth that goes 4 m/s is seen as far as it gets until the next frame, of which there is none for the last."""
    look = {"size": SIZE, "quality": "fast", "background": "transparent",
            "camera": tc.Camera((0.6, -0.2, 4), (0.6, -0.2, 0), 35)}
    recording = tc.Recording(fallen)

    def ends(frame, **more):
        at = np.flatnonzero((tc.render(recording, frame=frame, **look, **more)[..., 3] > 8).any(axis=0))
        return at[0], at[-1]

    first, second, blurred = ends(4), ends(5), ends(4, shutter=1)
    assert second[1] > first[1] + 1 and abs(blurred[0] - first[0]) <= 1 and abs(blurred[1] - second[1]) <= 1
    assert ends(9, shutter=1)[1] > ends(9)[1] + 1
    assert cli.main(["render", str(fallen), "--to", str(tmp_path), *SMALL, "--frames", "4", "--shutter", "1",
                     "--aperture", "0.1", "--light", "studio", "--hem", "0.02", "--specular", "0.2:0.3",
                     "--thickness", "0.01"]) == 0


def test_exr_has_light_and_passes(fallen, tmp_path):
    reader = pytest.importorskip("OpenEXR")
    assert cli.main(["render", str(fallen), "--to", str(tmp_path), *SMALL, "--frames", "3", "--passes", "depth,normal,id",
                     "--pass-format", "exr"]) == 0
    with reader.File(str(tmp_path / "00003.exr"), separate_channels=True) as file:
        assert set(file.channels()) == {"R", "G", "B", "depth.Z", "normal.X", "normal.Y", "normal.Z", "id.I"}
        red, number = file.channels()["R"].pixels, file.channels()["id.I"].pixels
    assert red.shape == number.shape == (48, 64) and 0 < red.max() < 2 and 1 in number


@pytest.mark.slow
def test_a_keyed_camera_is_at_its_keys(fallen):
    recording = tc.Recording(fallen)
    a, b = tc.Camera((1, 0.5, 2), (0.3, 0, 0)), tc.Camera((-1, 1, 1.5), (1, -0.4, 0), 50)
    t = [float(recording.frame(k)["t"]) for k in (0, 6)]

    def picture(frame, camera):
        return tc.render(recording, frame=frame, size=SIZE, quality="fast", camera=camera)

    keys = {t[0]: a, t[1]: b}
    for frame, camera in ((0, a), (6, b), (9, b)):
        assert (picture(frame, keys) == picture(frame, camera)).all()
    assert (picture(3, keys) != picture(3, a)).any()


def test_a_film_that_cannot_be_written_costs_no_pictures(fallen, tmp_path, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    assert cli.main(["render", str(fallen), "--to", str(tmp_path / "none"), *SMALL, "--mp4"]) == 2
    assert "taichi-cloth[film]" in capsys.readouterr().err and not (tmp_path / "none").exists()


def test_a_folder_that_cannot_be_made_is_named(fallen, tmp_path, capsys):
    (tmp_path / "file").write_text("kept")
    for folder in (tmp_path / "file", tmp_path / "file" / "x"):
        assert cli.main(["render", str(fallen), "--to", str(folder), *SMALL]) == 2
        assert f"error: cannot write to {folder}: " in capsys.readouterr().err
        with pytest.raises(tc.OutputError, match=f"cannot write to {folder}: "):
            tc.render_frames(tc.Recording(fallen), folder, size=SIZE)
    assert (tmp_path / "file").read_text() == "kept"


@pytest.mark.parametrize("name", ["x.jpg", "x"])
def test_pictures_are_png_by_name_too(fallen, tmp_path, capsys, name):
    assert cli.main(["compare", str(fallen), str(fallen), "--to", str(tmp_path / "x.gif"), *SMALL]) == 2
    assert re.search(r"--to '.*x.gif': takes a folder, .*\.png.*\.mp4, \.apng", capsys.readouterr().err)
    with pytest.raises(tc.OutputError, match=f"render: path = '.*{name}': must end with .png"):
        tc.render(tc.Recording(fallen), tmp_path / name, frame=4, size=SIZE)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("flags, what", [
    (["--frames", "40:50"], "frames = '40:50': none of them is there; there are 0 to 9"),
    (["--frames", "3,5,200"], "frames = '3,5,200': 200 is not there; there are 0 to 9"),
    (["--color", "cloht=red"], "did you mean 'cloth'"),
    (["--color", "redd"], "'redd': is not a colour"), (["--background", "sea"], "'sea'"), (["--passes", "deep"], "'deep'"),
    (["--pass-format", "tiff"], "'tiff'"), (["--texture", "no.png"], "'no.png': there is no such file"),
    (["--texture", "no.png@a"], "WIDTHxHEIGHT"), (["--weave", "wide"], "SPACING"), (["--smooth", "9"], "smooth = 9"),
    (["--bits", "4"], "bits = 4"), (["--light", "0,0,0"], "light"), (["--mp4", "--background", "transparent"], "transparent"),
    (["--light", "studoi"], "did you mean 'studio'"), (["--hem", "cloth=wide"], "--hem 'wide': needs a number"),
    (["--hem", "0"], "hem = 0"), (["--specular", "0.2:rough"], "--specular 'rough'"), (["--sheen", "3"], "sheen = 3"),
    (["--thickness", "-1"], "thickness = -1"), (["--aperture", "-1"], "aperture = -1"), (["--shutter", "2"], "shutter = 2")])
def test_mistakes_are_named(fallen, tmp_path, capsys, flags, what):
    assert cli.main(["render", str(fallen), "--to", str(tmp_path / "none"), *SMALL, *flags]) == 2
    assert what in capsys.readouterr().err and not list(tmp_path.rglob("*.png"))


@pytest.mark.parametrize("flags, what", [(["--camera", "1,2:0,0,0"], "EYE:TARGET"), (["--light", "1,2"], "X,Y,Z"),
                                         (["--camera", "0@1,1,1:0,0,0; 2,2,2:0,0,0"], "needs its time")])
def test_flags_that_cannot_be_read(flags, what, capsys):
    with pytest.raises(SystemExit):
        cli.main(["render", "nothing", *flags])
    assert what in capsys.readouterr().err
