"""Other backends, where this machine has them: the same scene passes its check there."""

import numpy as np
import pytest
from test_cli import QUICK, call, read_png

from taichi_cloth.backend import runtime


@pytest.mark.parametrize("arch", ["cuda", "vulkan", "metal"])
def test_hang_on(arch):
    if not runtime.available(arch):
        pytest.skip(f"{arch} does not run here")
    done = call("check", "hang", "--small", "--arch", arch, "--precision", "f32")
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("ok ") == 4


@pytest.mark.parametrize("arch", ["cuda", "vulkan", "metal"])
def test_pictures_agree(arch, tmp_path):
    """The same frames, drawn on the CPU and there, are alike to 4/255 but for single pixels on edges."""
    if not runtime.available(arch):
        pytest.skip(f"{arch} does not run here")
    done = call("run", "hang", *QUICK, "--out", tmp_path / "run", "--precision", "f32", "--no-images")
    assert done.returncode == 0, done.stderr
    for quality in ("fast", "standard"):
        images = []
        for where in ("cpu", arch):
            folder = tmp_path / f"{where}_{quality}"
            done = call("render", tmp_path / "run", "--arch", where, "--size", "160x120", "--to", folder, "--quality", quality)
            assert done.returncode == 0, done.stderr
            images.append(read_png(folder / "00002.png").astype(int))
        assert (np.abs(images[0] - images[1]).max(axis=2) > 4).mean() < 1e-3, quality
