"""What is done to Taichi leaves kernels, classes and fields of others as they were."""

import subprocess
import sys

import pytest

from taichi_cloth.backend import runtime, taichi_patches
from taichi_cloth.backend.language import ti
from taichi_cloth.system.state import ParticleState


@pytest.fixture(autouse=True)
def running():
    runtime.start()


def test_our_classes_are_bound_and_others_are_as_taichi_has_them():
    @ti.data_oriented
    class Plain:
        def __init__(self, value: float) -> None:
            self.value = value

        @property
        def twice(self) -> float:
            return 2 * self.value

        @ti.kernel
        def get(self) -> float:
            return self.value

    @ti.data_oriented
    class Heir(Plain):
        @ti.kernel
        def half(self) -> float:
            return self.value / 2

    @ti.data_oriented
    class Static:
        @staticmethod
        @ti.kernel
        def double(x: float) -> float:
            return 2 * x

        @property
        @ti.kernel
        def seven(self) -> float:
            return 7.0

    assert Plain(3.0).get() == 3 and Plain(4.0).get() == 4 and Plain(3.0).twice == 6
    assert Heir(5.0).get() == 5 and Heir(5.0).half() == 2.5
    assert Static().double(2.0) == 4 and Static().seven == 7
    assert "__getattribute__" in vars(Plain)  # Taichi's own
    assert "__getattribute__" not in vars(ParticleState)


def test_errors_in_kernels_of_others_show_the_line():
    @ti.kernel
    def wrong() -> float:
        return not_there + 1.0  # noqa: F821

    with pytest.raises(ti.TaichiCompilationError) as caught:
        wrong()
    assert "return not_there + 1.0" in str(caught.value) and "^^^" in str(caught.value)


def test_fields_of_others_know_where_they_were_declared():
    mine = ti.field(float, 3)
    assert __file__ in mine.vars[0].declaration_tb
    assert taichi_patches.WANTED


def test_taichi_can_be_left_as_it_is():
    code = ("import taichi_cloth.system.state; from taichi_cloth.backend.taichi_patches import kernel_impl, ti; "
            "print(ti.data_oriented.__module__, kernel_impl._inside_class.__name__, "
            "'__getattribute__' in vars(taichi_cloth.system.state.ParticleState))")
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True,
                          env={**__import__("os").environ, "TAICHI_CLOTH_PATCHES": "0"})
    assert done.stdout.split("\n")[-2] == f"{taichi_patches.NAME}.lang.kernel_impl _inside_class True"
