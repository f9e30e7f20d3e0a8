"""The only place that starts Taichi: arch, precision, threads; they are recorded, and nothing falls back silently."""

import contextlib
import gc
import io
import os
import subprocess
import sys
import tempfile
import weakref
from collections.abc import Iterator
from dataclasses import asdict, dataclass

import numpy as np

from .. import checks
from ..errors import BackendError
from ..options import ARCHS, PRECISIONS
from .quota import cores

TASK = 512  # iterations of a loop that Taichi gives to a CPU thread at once
MOST_THREADS = 64  # that may be asked for where there are fewer cores: thousands take minutes to start
VARIABLES = ("ARCH", "OFFLINE_CACHE_FILE_PATH")  # of the environment: to a compiler they come before a program's arguments
SPARED = {"cfg_optimization": False, "simplify_after_lower_access": False}  # passes that LLVM makes again
LAYOUT = "TAICHI_CLOTH_LAYOUT"  # of the environment: "cpu" or "device"
NO_DOUBLE = ("vulkan", "metal")  # f64 there is absent, or lacks atan2


@dataclass(frozen=True)
class Runtime:
    """Arch, precision and threads.

    Attributes:
        arch: "cpu", "cuda", "vulkan" or "metal".
        precision: "f32" or "f64".
        threads: CPU threads, also the number of blocks on the CPU.
        debug: Taichi's checks of bounds are on (slow).
        taichi: the compiler's version, with the name of one that is not Taichi itself.
    """

    arch: str
    precision: str
    threads: int
    debug: bool
    taichi: str

    @property
    def device(self) -> bool:
        """Whether data and loops are laid out for a GPU: on one, and on a CPU where `LAYOUT` in the environment says so, to
        be compared."""
        return self.arch != "cpu" or os.environ.get(LAYOUT, "cpu") == "device"

    @property
    def sums(self) -> str:
        """Precision of sums and of arrays that are exchanged with numpy."""
        return "f32" if self.arch in NO_DOUBLE else "f64"

    @property
    def exchange(self) -> type:
        """numpy type of arrays handed to kernels."""
        return np.float32 if self.sums == "f32" else np.float64

    @property
    def epsilon(self) -> float:
        """Distance from 1 to the next number of this precision."""
        return float(np.finfo(np.float32 if self.precision == "f32" else np.float64).eps)

    def record(self) -> dict:
        """For manifests."""
        return asdict(self)


_current: Runtime | None = None
generation = 0  # counts the starts: fields made in an earlier generation are dead
direct = False  # whether numbers of fields are read and written where they lie, and not handed over by kernels: see `rows`
_holders: weakref.WeakSet = weakref.WeakSet()  # of fields


def start(arch: str = "cpu", precision: str = "f64", threads: int | None = None, quiet: bool = True,
          debug: bool = False) -> Runtime:
    """Starts Taichi, or goes on with it where the same is running already and something still holds fields.

    A start with other settings ends the simulations made before it; they say so when used. If no simulation
    and no pool holds fields any more, Taichi starts anew: it numbers fields afresh, and finds the kernels of the same fields
    in its cache.

    Args:
        threads: CPU threads; None takes all that the process may use.
        quiet: Taichi's own messages off.
        debug: bounds checks in kernels.

    Raises:
        BackendError: an arch that is not there, or a precision that it lacks.
    """
    global _current, generation, direct
    checks.choice("arch", arch, ARCHS)
    checks.choice("precision", precision, PRECISIONS)
    checks.choice(LAYOUT, os.environ.get(LAYOUT, "cpu"), ("cpu", "device"), BackendError)
    there = cores()
    threads = checks.maybe(threads, checks.integer, "threads", most=max(there, MOST_THREADS), error=BackendError)
    quiet, debug = checks.flag("quiet", quiet), checks.flag("debug", debug)
    if arch in NO_DOUBLE and precision == "f64":
        raise BackendError(f"arch {arch!r} has no f64; use precision='f32', or arch 'cpu' or 'cuda'")
    if arch != "cpu" and not available(arch):
        others = [a for a in ARCHS if a == "cpu" or (a != arch and available(a))]
        raise BackendError(f"arch {arch!r} does not run here; what does: {', '.join(others)}")
    from . import compiler, field_pool, kernel_cache, pages, placement
    from .language import ti

    pages.map_large_arrays()
    wanted = Runtime(arch, precision, threads or there, debug, compiler.version(ti))
    seen = arch == "cpu" and field_pool.SEEN and not wanted.device
    if wanted == _current and (len(_holders) or field_pool.holds()):
        if len(_holders):
            gc.collect()  # simulations that nobody knows any more hold fields until then
        field_pool.trim()
        direct = seen
        return wanted
    fp = ti.f32 if precision == "f32" else ti.f64
    words, before = io.StringIO() if quiet else sys.stdout, placement.running()
    options = {**compiler.options(SPARED), **kernel_cache.options(keep=not debug)}
    try:
        with contextlib.redirect_stdout(words), _unasked():
            # fast_math would let the compiler assume that there is no NaN, and drop the tests for it; passes that are
            # spared take a third of the time to compile
            ti.init(arch=getattr(ti, arch), default_fp=fp, cpu_max_num_threads=wanted.threads, debug=debug,
                    enable_fallback=False, log_level=ti.ERROR if quiet else ti.INFO, fast_math=False, unrolling_limit=0,
                    **options)
    except RuntimeError as error:
        raise BackendError(f"arch {arch!r} does not start: {error}") from None
    placement.place(before, wanted.threads if arch == "cpu" else 0)
    _holders.clear()
    field_pool.forget()
    _current, generation, direct = wanted, generation + 1, seen
    return wanted


@contextlib.contextmanager
def _unasked() -> Iterator[None]:
    """Within it a compiler starts on the arch, and with the cache, that it is told, and not with those of the environment."""
    from .compiler import chosen

    names = [chosen().prefix + name for name in VARIABLES]
    asked = {name: os.environ.pop(name) for name in names if name in os.environ}
    try:
        yield
    finally:
        os.environ.update(asked)


def go_on() -> Runtime:
    """Taichi as it was started last, for drawing and the like; on the CPU in f32 where it was not."""
    if _current is None:
        return start("cpu", "f32")
    return start(_current.arch, _current.precision, _current.threads, debug=_current.debug)


def on_cpu() -> bool:
    """Whether Taichi runs on the CPU."""
    return _current is not None and _current.arch == "cpu"


def for_device() -> bool:
    """Whether data and loops are laid out for a GPU: see `Runtime.device`."""
    return _current is not None and _current.device


def hold(thing: object) -> None:
    """Taichi goes on as it is while a thing with fields lives, or until `let_go`."""
    _holders.add(thing)


def let_go(thing: object) -> None:
    """A thing has given its fields back."""
    _holders.discard(thing)


def available(arch: str) -> bool:
    """Whether an arch starts on this machine; tried in a process of its own, because a missing one may crash."""
    from .compiler import chosen

    code = (f"import {chosen().name} as ti; ti.init(arch=ti.{arch}, enable_fallback=False, offline_cache=False)\n"
            "f = ti.field(ti.i32, 4)\n"
            "@ti.kernel\ndef k():\n    for i in f: f[i] = i\n"
            "k(); assert f[3] == 3")
    with tempfile.TemporaryDirectory() as folder, _unasked():
        probe = os.path.join(folder, "probe.py")  # Taichi reads a kernel's source from its file
        with open(probe, "w", encoding="utf-8") as out:
            out.write(code)
        try:
            done = subprocess.run([sys.executable, probe], capture_output=True, timeout=120, check=False)
        except subprocess.TimeoutExpired:
            return False
    return done.returncode == 0
