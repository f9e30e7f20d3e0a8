"""Shared by all tests: golden data, small scenes, a Taichi cache of its own kind."""

import gc
import os
import pathlib
import signal
from collections.abc import Iterator

import pytest

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy: idle threads of its own spin, on cores that others need
import numpy as np  # noqa: E402

import taichi_cloth as tc  # noqa: E402

os.environ.setdefault("TI_OPT_LEVEL", "0")  # a quarter less to compile; bits are the same, as test_second_simulation.py holds
LONGEST = 600  # s that a test may take
THREADS = 1  # CPU threads where a test asks for no number, whatever the machine has; scripts/perturbing.py sets both of these


def shared_data() -> pathlib.Path | None:
    """A folder with validation/ and data/, from TAICHI_CLOTH_SHARED or beside the checkout; None where absent."""
    beside = pathlib.Path(__file__).parents[2] / "shared"
    folder = pathlib.Path(os.environ.get("TAICHI_CLOTH_SHARED", beside))
    return folder if folder.is_dir() else None


@pytest.fixture(autouse=True)
def time_limit() -> Iterator[None]:
    """A test that waits for what does not come fails; it does not keep all others waiting."""
    if not hasattr(signal, "SIGALRM"):
        yield
        return

    def late(*_: object) -> None:
        raise TimeoutError(f"the test took longer than {LONGEST} s")

    before = signal.signal(signal.SIGALRM, late)
    signal.alarm(LONGEST)
    yield
    signal.alarm(0)
    signal.signal(signal.SIGALRM, before)


@pytest.fixture
def asked_to_end() -> Iterator[None]:
    """Signals end a process, and those that it starts, as at a terminal: under nohup SIGHUP is ignored, and SIGINT by what a
    script runs in the background, and children take that over."""
    usual = {"SIGINT": signal.default_int_handler, "SIGTERM": signal.SIG_DFL, "SIGHUP": signal.SIG_DFL}
    before = {number: signal.signal(number, does) for name, does in usual.items()
              if (number := getattr(signal, name, None)) is not None}
    yield
    for number, did in before.items():
        signal.signal(number, did)


@pytest.fixture
def shared() -> pathlib.Path:
    """That folder; the test is skipped where there is none."""
    folder = shared_data()
    if folder is None:
        pytest.skip("reference data absent: set TAICHI_CLOTH_SHARED to their folder")
    return folder


def many_blocks() -> None:
    """Small meshes in as many blocks as there are threads, as large ones are; one thread where a test asks for no more, as
    workers of pytest-xdist would wait for each other's cores, and as answers do not depend on the machine then; fields of one
    size for all meshes of tests, and a kernel for each force, so that less is compiled."""
    from taichi_cloth.backend import rows, runtime
    from taichi_cloth.system import assembler
    from taichi_cloth.system import state as model

    model.ROWS, rows.SMALL, assembler.FUSED = 1, rows.MIDDLE, False
    runtime.cores = lambda: THREADS


@pytest.fixture(scope="session", autouse=True)
def blocks_of_tests() -> None:
    """All tests run so."""
    many_blocks()


def _in_f32(item: pytest.Item) -> bool:
    return "f32" in item.name  # of the function, or a parameter


def _restarts(item: pytest.Item) -> bool:
    return _in_f32(item) or item.get_closest_marker("restarts") is not None


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """What starts Taichi anew comes last, in f32 after all other: what was compiled before is compiled again after it."""
    items.sort(key=lambda item: _restarts(item) + _in_f32(item))


@pytest.hookimpl(hookwrapper=True)
def pytest_collection() -> Iterator[None]:
    """Nothing looks for garbage while tests are collected: trees of their sources are none."""
    gc.disable()
    yield
    gc.enable()


@pytest.fixture(scope="module", autouse=True)
def what_stays() -> None:
    """Tests, modules and compiled kernels stay to the end: simulations collect garbage as they start, and it took up to a
    fifth of a worker's time while that went through all of these."""
    gc.collect()
    gc.freeze()


@pytest.fixture(autouse=True)
def goes_on(request: pytest.FixtureRequest) -> Iterator[None]:
    """Of a test that is not marked with `restarts`: Taichi goes on as it was."""
    from taichi_cloth.backend import runtime

    before, usual = runtime.generation, THREADS == 1 and _usual()
    yield
    if usual and not _restarts(request.node):
        assert _usual() and runtime.generation <= before + 1, "it starts Taichi anew: mark it with `restarts`"


def _usual() -> bool:
    """Whether Taichi runs as for most tests."""
    from taichi_cloth.backend import runtime

    now = runtime._current
    return now is not None and now.precision == "f64" and now.threads == runtime.cores() and not now.debug


@pytest.fixture
def rng() -> np.random.Generator:
    """Random numbers, the same in every run."""
    return np.random.default_rng(20240611)


FULL = tc.Fabric(0.2, tc.Stretch((800, 600), (0.8, 0.6), (1.0, 0.98)), tc.Shear(200, 0.2), tc.Bend((2e-4, 3e-4), 2e-6))
