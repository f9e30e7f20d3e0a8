"""What is done to Taichi leaves classes of others as they were."""

import taichi as ti

from taichi_cloth import quicken, runtime


def test_classes_of_others_work():
    assert ti.data_oriented is quicken._data_oriented
    runtime.start()

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
