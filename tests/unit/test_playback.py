"""Runs laid side by side: where they part, and which frames are picked."""

import numpy as np
import pytest

from taichi_cloth.errors import OutputError
from taichi_cloth.output.folder import RunFolder
from taichi_cloth.output.recording import Recording
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
    folder.write_manifest({"fps": fps, "frames": [0, last]})
    folder.close()
    return Recording(path)


def test_where_runs_part(tmp_path):
    a, b = run(tmp_path / "a", 5), run(tmp_path / "b", 4, off=0.25)
    apart = distances(a, b)
    assert sorted(apart) == [0, 1, 2, 3, 4] and (apart[2] == 0).all() and apart[3].tolist() == [0, 0, 0.25, 0]
    assert parting(a, b, 1e-6) == ["the motion parts at frame 3 (t = 0.3 s): RMS 0.125 m, vertex 2 by 0.25 m"]
    assert parting(a, b, 0.2) == ["the motion agrees in all 5 frames: no vertex is further apart than 0.25 m"]
    with pytest.raises(OutputError, match="cannot be compared"):
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
