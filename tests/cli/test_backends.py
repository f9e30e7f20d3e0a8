"""Other backends, where this machine has them: the same scene passes its check there."""

import pytest
from test_cli import call

from taichi_cloth import runtime


@pytest.mark.parametrize("arch", ["cuda", "vulkan", "metal"])
def test_hang_on(arch):
    if not runtime.available(arch):
        pytest.skip(f"{arch} does not run here")
    done = call("check", "hang", "--small", "--arch", arch, "--precision", "f32")
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("ok ") == 4
