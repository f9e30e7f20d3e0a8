"""Pictures and folders, without a simulation."""

import zlib

import numpy as np
import pytest

import taichi_cloth as tc
from taichi_cloth.backend import runtime
from taichi_cloth.errors import OutputError
from taichi_cloth.output.camera import frame
from taichi_cloth.output.folder import RunFolder
from taichi_cloth.output.framing import fit_all, fit_round
from taichi_cloth.output.png import encode_png
from taichi_cloth.scene.view import Camera, View


def test_png_holds_the_pixels(rng):
    image = rng.integers(0, 256, size=(13, 7, 3), dtype=np.uint8)
    data = encode_png(image)
    start = data.index(b"IDAT")
    length = int.from_bytes(data[start - 4:start], "big")
    rows = np.frombuffer(zlib.decompress(data[start + 4:start + 4 + length]), dtype=np.uint8).reshape(13, 22)
    assert (np.cumsum(rows[:, 1:].reshape(13, 7, 3), axis=1, dtype=np.uint8) == image).all()
    with pytest.raises(ValueError, match="uint8"):
        encode_png(image.astype(float))


def test_camera_projects_and_fits(rng):
    f = frame(Camera((0, 0, 5), (0, 0, 0), fov=90))
    pixels = f.project(np.array([[0, 0, 0], [5, 0, 0], [0, 5, 0], [0, 0, 6]]), 200, 100)
    assert np.allclose(pixels[:3, :2], [[100, 50], [150, 50], [100, 0]]) and pixels[0, 2] == pytest.approx(0.2)
    assert pixels[3, 2] < 0
    x = rng.normal(size=(50, 3)) * [3, 1, 2] + [10, 0, 0]
    for width, height in ((320, 180), (90, 200)):
        for camera in (fit_all([x[:20], x[20:]], 0.2, width / height), fit_round([x[:20], x[20:]], 0.2, width / height)):
            seen = frame(camera).project(x, width, height)
            assert (seen[:, 0] > 0).all() and (seen[:, 0] < width).all()
            assert (seen[:, 1] > 0).all() and (seen[:, 1] < height).all()
        seen = frame(fit_all([x], 0.0, width / height)).project(x, width, height)[:, :2]
        room = np.minimum(seen, [width, height] - seen).min(axis=0) / (width, height)
        assert 0.03 < room.min() < 0.09 and room.max() < 0.6, "as near as the margin lets it, and in the middle"
    assert np.isfinite(frame(Camera((0, 3, 0), (0, 0, 0))).axes).all()  # straight down


def test_a_camera_that_goes_round_is_as_near_as_every_side_lets_it(rng):
    """Points turned about the vertical through the middle of their bounds, in place of the camera: none is outside."""
    for size in ([3, 1, 2], [0.2, 2, 0.1], [1, 0.01, 1]):
        x = rng.uniform(-1, 1, (200, 3)) * size + [4, -2, 1]
        middle = (x.min(axis=0) + x.max(axis=0)) / 2
        for width, height in ((320, 180), (90, 200)):
            view, room = frame(fit_round([x[:90], x[90:]], 0.0, width / height)), 1.0
            for angle in np.linspace(0, 2 * np.pi, 720):
                c, s = np.cos(angle), np.sin(angle)
                seen = view.project((x - middle) @ np.array([[c, 0, -s], [0, 1, 0], [s, 0, c]]) + middle, width, height)[:, :2]
                room = min(room, float((np.minimum(seen, [width, height] - seen) / (width, height)).min()))
            assert 0.055 < room < 0.065


def test_picture_of_a_known_square():
    """Coverage, depth order and the two sides' colours."""
    runtime.start()
    from taichi_cloth.output.renderer import Renderer
    from taichi_cloth.output.surfaces import plain

    square = tc.grid(1.0, 2, plane="xy")
    behind = square.x + [0, 0, -0.5]
    x = np.concatenate([square.x, behind])
    faces = np.concatenate([square.faces, square.faces[:, ::-1] + square.vertex_count])
    uv = np.concatenate([square.corner_uv] * 2)
    colors = np.repeat([[0.8, 0.0, 0.0], [0.0, 0.0, 0.8]], square.face_count, axis=0)
    view = View(Camera((0.5, 0.5, 3), (0.5, 0.5, 0), fov=2 * np.degrees(np.arctan(0.25))), ground=-5)
    image = Renderer(120, 120, plain(faces, uv, colors), x, view).render(x)
    red = (image[..., 0] > 100) & (image[..., 2] < 90)
    assert red.mean() == pytest.approx((1 / 1.5) ** 2, abs=0.02)  # 1 m of the 1.5 m that the picture spans
    assert red[60, 60] and not red[5, 5]
    flipped = Renderer(120, 120, plain(faces[:, ::-1], uv, colors), x, view).render(x)
    front, back = image[60, 60].astype(int), flipped[60, 60].astype(int)
    assert front[0] - 60 < back[0] < front[0] - 10 and back[1] < 90, "the back is a little darker, and as red"


def test_folder_refuses_and_replaces(tmp_path):
    folder = RunFolder(tmp_path / "a" / "b")
    folder.write_image(3, b"x")
    folder.append_telemetry([{"t": 1}])
    folder.close()
    assert (tmp_path / "a/b/images/00003.png").read_bytes() == b"x"
    with pytest.raises(OutputError, match="another run's files"):
        RunFolder(tmp_path / "a" / "b")
    (tmp_path / "a/b/images/notes.png").write_bytes(b"mine")
    RunFolder(tmp_path / "a" / "b", overwrite=True)
    assert [p.name for p in (tmp_path / "a/b/images").iterdir()] == ["notes.png"]
    with pytest.raises(OutputError, match="cannot write"):
        RunFolder(tmp_path / "a/b/images/notes.png/deeper")
