"""Two runs beside each other: which frames, how far apart, and what the pictures show."""

import csv

import numpy as np
import pytest
from test_playback import run

from taichi_cloth.errors import OutputError
from taichi_cloth.recording.comparing import Pair, _above, files_at, film


def test_distances_are_a_row_a_frame(tmp_path):
    pair = Pair(run(tmp_path / "a", 30), run(tmp_path / "b", 30, off=0.25))
    rows = pair.table()
    assert [k for k, *_ in rows] == list(range(31)) and rows[2][1:] == (0.2, 0, 0)
    assert rows[3][1:] == pytest.approx((0.3, 0.25, 0.125))  # one vertex of four
    said = pair.said()
    assert len(said) == 14 and "   30    3.000         0.25      0.125" in said[-2]
    assert said[-1].startswith("in all 31 frames: RMS 0.119 m, largest 0.25 m")  # 28 of 124 distances are .25
    pair.written(tmp_path / "apart.csv")
    with open(tmp_path / "apart.csv") as lines:
        table = list(csv.DictReader(lines))
    assert len(table) == 31 and float(table[7]["largest_m"]) == 0.25 and float(table[7]["t_s"]) == pytest.approx(0.7)
    assert float(table[7]["rms_m"]) == pytest.approx(0.125)


@pytest.mark.parametrize("last, fps, said", [(5, 10, "frames 0 to 5, 10 a second"),
                                             (4, 20, "frames 0 to 4, 20 a second")])
def test_runs_whose_frames_do_not_match_are_named(tmp_path, last, fps, said):
    a, b = run(tmp_path / "a", 4), run(tmp_path / "b", last, fps)
    with pytest.raises(OutputError, match=said) as error:
        Pair(a, b)
    assert str(a.path) in str(error.value) and str(b.path) in str(error.value) and "--common" in str(error.value)
    assert list(Pair(a, b, True).frames) == ([0, 1, 2] if fps == 20 else [0, 1, 2, 3, 4])


def test_names_are_the_folders_or_more_of_their_paths_where_they_are_the_same(tmp_path):
    for folder in ("x", "y"):
        (tmp_path / folder).mkdir()
    a, b, c = run(tmp_path / "x" / "a", 1), run(tmp_path / "y" / "a", 1), run(tmp_path / "b", 1)
    assert Pair(a, c).names == ["a", "b"] and Pair(a, b).names == ["x/a", "y/a"]


def test_runs_of_other_cloths_have_no_distances_and_say_why(tmp_path):
    pair = Pair(run(tmp_path / "a", 1), run(tmp_path / "b", 1, n=5))
    assert pair.apart is None and pair.table() == []
    assert pair.said() == ["note: the runs are of other cloths: cloth of 4 and cloth of 5: no distances"]


def test_times_are_under_the_columns():
    """A strip of white below, with dark letters in the half of each column."""
    image = np.full((8, 400, 3), 77, dtype=np.uint8)
    made = _above(image, [0.5, 12.0])
    assert (made[:8] == image).all() and len(made) == 28 and (made[8] == 255).all()
    letters = (made[8:] < 100).all(axis=2)
    assert letters[:, 5:100].any() and letters[:, 205:300].any() and not letters[:, 120:200].any()
    assert not np.array_equal(letters[:, :200], letters[:, 200:])
    clear = _above(np.zeros((8, 400, 4), dtype=np.uint16), [0.5, 12.0])
    assert (clear[8:, :, 3] == 65535).all() and (clear[:8] == 0).all()


@pytest.mark.parametrize("width, first, count", [(90, "t = 0.500 s", 3), (66, "t = 0.500 s", 3), (60, "0.500 s", 3),
                                                 (40, "0.500", 3), (20, "0.500", 1), (5, "0.500", 1)])
def test_times_under_narrow_columns_are_shorter_or_fewer_and_never_over_each_other(monkeypatch, width, first, count):
    from taichi_cloth.recording import comparing

    drawn = []
    monkeypatch.setattr(comparing, "draw_text", lambda strip, text, column, row, scale: drawn.append(
        (text, column, column + 6 * scale * len(text) - scale)))  # letters of 5 dots, and one between them
    _above(np.zeros((8, 3 * width, 3), dtype=np.uint8), [0.5, 1.25, 2.0])
    assert len(drawn) == count and drawn[0][0] == first and drawn[0][1] >= 0
    assert all(end < after for (_, _, end), (_, after, _) in zip(drawn, drawn[1:]))
    assert width == 5 or drawn[-1][2] <= 3 * width


def test_runs_of_other_cloths_whose_frames_do_not_match_are_not_told_of_common_times(tmp_path):
    with pytest.raises(OutputError, match="the runs are of other cloths.*draws each by itself") as error:
        Pair(run(tmp_path / "a", 4), run(tmp_path / "b", 5, n=5))
    assert "--common" not in str(error.value)


class Flat:
    """Pictures of one grey each, instead of drawn ones."""

    def __init__(self, pair):
        self.pair = pair

    def both(self, k):
        return [np.full((8, 12, 3), 10 * k, dtype=np.uint8), np.full((8, 12, 3), 10 * k + 5, dtype=np.uint8)]


def test_a_film_has_both_side_by_side(tmp_path, monkeypatch):
    from taichi_cloth.recording import comparing

    def refuse():
        raise OutputError("absent")

    monkeypatch.setattr(comparing, "encoder", refuse)
    pair = Pair(run(tmp_path / "a", 3), run(tmp_path / "b", 3))
    _, out = files_at(tmp_path / "both.png", pair.a.path, True)
    film(pair, Flat(pair), out, (12, 8))
    data = out.read_bytes()
    assert out == tmp_path / "both.apng" and data.count(b"fcTL") == 4
    assert data[16:24] == (24).to_bytes(4, "big") + (28).to_bytes(4, "big")  # wide as both, with times


def test_a_folder_a_picture_or_a_film_is_named(tmp_path, monkeypatch):
    from taichi_cloth.recording import comparing

    monkeypatch.setattr(comparing, "encoder", lambda: None)
    folder, run_at = tmp_path / "with.dot", tmp_path / "run"
    folder.mkdir()
    for to, movie, picture, film_at in (
            (None, False, run_at / "compare.png", None), (None, True, run_at / "compare.png", run_at / "compare.mp4"),
            (folder, False, folder / "compare.png", None), (tmp_path / "new", True, tmp_path / "new/compare.png",
                                                           tmp_path / "new/compare.mp4"),
            (tmp_path / "a.PNG", False, tmp_path / "a.PNG", None),
            (tmp_path / "a.mp4", False, tmp_path / "a.png", tmp_path / "a.mp4"),
            (tmp_path / "a.apng", True, tmp_path / "a.png", tmp_path / "a.apng")):
        assert files_at(to, run_at, movie) == (picture, film_at), to
    for name in ("a.gif", "a.mov", "a.jpg"):
        with pytest.raises(OutputError, match=rf"{name}.*folder.*\.png.*\.mp4, \.apng"):
            files_at(tmp_path / name, run_at, True)


def test_a_film_that_is_named_needs_the_package_before_anything_is_drawn(tmp_path, monkeypatch):
    from taichi_cloth.recording import comparing

    def refuse():
        raise OutputError("absent")

    monkeypatch.setattr(comparing, "encoder", refuse)
    with pytest.raises(OutputError, match="absent"):
        files_at(tmp_path / "a.mp4", tmp_path, False)
