"""Recorded runs in notebooks: what `play()` and a recording's own picture hold, read back from the page."""

import base64
import html
import json
import pathlib
import re

import numpy as np
import pytest
from test_export import FPS, make

import taichi_cloth as tc
from taichi_cloth.recording.play import READ, _pages


@pytest.fixture
def made(tmp_path, rng):
    return make(tmp_path / "run", rng)


def played(page):
    """Data of a page: positions of cloth and of solids by frame, times, and the rest."""
    data = json.loads(re.search(r"const data = (\{.*\});", page)[1])
    low, span = np.array(data["low"]), np.array(data["span"])

    def positions(texts):
        return [np.frombuffer(base64.b64decode(text), "<u2").reshape(-1, 3) / 65535 * span + low for text in texts]

    return positions(data["frames"]), positions(data["solidFrames"]), span.max() / 65535, data


def test_a_notebook_plays_a_recording(made):
    recording = tc.Recording(made.recording.path)
    text = recording._repr_html_()
    assert text == recording.play()._repr_html_()
    page = html.unescape(re.fullmatch(r'<iframe srcdoc="([^"]*)"[^>]*></iframe>', text)[1])
    assert page.startswith("<!doctype html>") and "http" not in re.sub(r"base64,[\w+/=]+", "", page)
    cloth, solids, step, data = played(page)
    assert len(cloth) == 3 and data["fps"] == FPS
    for x, y, frame in zip(cloth, solids, made.frames):
        assert np.abs(x - frame["x"]).max() <= step and np.abs(y - frame["solid_x"]).max() <= step


def test_a_browser_is_shown_the_page(made, tmp_path, monkeypatch):
    opened = []
    monkeypatch.setattr("webbrowser.open", opened.append)
    play = tc.Recording(made.recording.path).play()
    file = play.show()
    assert opened == [file.as_uri()] and file.read_text() == play.save(tmp_path / "page.html").read_text()
    assert "3 frames" in repr(play)
    with pytest.raises(tc.OutputError, match="is not a path|must be a path"):
        play.save(3)


def test_pages_that_were_shown_go_with_the_process(made, monkeypatch):
    """All of them are in one folder, which a browser has had time to read; another run's page takes the place of none."""
    waited = []
    monkeypatch.setattr("webbrowser.open", lambda url: True)
    monkeypatch.setattr("time.sleep", waited.append)
    playback, pages = tc.Recording(made.recording.path).play(), _pages()
    folder = pathlib.Path(pages.folder.name)
    assert playback.show() == playback.show() and [f.parent for f in folder.iterdir()] == [folder]
    pages.close()
    assert not folder.exists() and 0 < waited[0] <= READ
    _pages.cache_clear()
    assert playback.show().exists()


def test_what_cannot_be_played_is_said_in_the_notebook(made):
    recording = tc.Recording(made.recording.path)
    (recording.path / "frames" / "00003.npz").unlink()
    assert "00003.npz is missing" in recording._repr_html_() and recording._repr_html_().startswith("<p>")
    with pytest.raises(tc.OutputError, match="is missing"):
        recording.play()


def test_a_long_run_leaves_out_frames_in_a_notebook(made, monkeypatch):
    monkeypatch.setattr("taichi_cloth.recording.play.INLINE", 2.1 * 6 * 17)  # two frames of 17 vertices
    page = html.unescape(tc.Recording(made.recording.path)._repr_html_())
    assert played(page)[3]["numbers"] == [2, 4] and "Every 2th frame" in page
