"""The compiler of kernels: Taichi, or a fork of it, as the environment variable TAICHI_CLOTH_COMPILER names it.

Kernels are written in Taichi's language, and get it from `language.py`. Parts of a compiler that it does not offer to all
come from `private`: one that lacks some of these is slower, and a simulation's notes say so.
"""

import functools
import importlib
import importlib.util
import inspect
import operator
import os
from dataclasses import dataclass
from types import ModuleType
from typing import Any

from ..errors import BackendError, did_you_mean

VARIABLE = "TAICHI_CLOTH_COMPILER"
PATCHED = os.environ.get("TAICHI_CLOTH_PATCHES", "1") != "0"  # whether this package may change how a compiler works


@dataclass(frozen=True)
class Compiler:
    """A compiler of kernels.

    Attributes:
        name: of its package in Python.
        distribution: name by which pip knows it.
        extra: of this package, that installs it; "" where this package always does.
        prefix: of its environment variables.
        own: arguments of its `init` that others do not know.
    """

    name: str
    distribution: str
    extra: str = ""
    prefix: str = "TI_"
    own: tuple[tuple[str, Any], ...] = ()

    @property
    def installed(self) -> bool:
        """Whether it is here; it is not imported for that."""
        return importlib.util.find_spec(self.name) is not None


DEFAULT = "taichi"
COMPILERS = {compiler.name: compiler for compiler in (
    Compiler(DEFAULT, "taichi"), Compiler("taichi_forge", "taichi-forge", "forge", own=(
        ("compile_tier", "full"), ("kernel_specialization_limit", 1 << 30), ("unrolling_kernel_warning_limit", 0))),
    Compiler("quadrants", "quadrants", "quadrants", "QD_"))}


@functools.cache
def chosen() -> Compiler:
    """The compiler that the environment names.

    Raises:
        BackendError: it is not known, or not installed.
    """
    name = os.environ.get(VARIABLE) or DEFAULT
    if name not in COMPILERS:
        raise BackendError(f"{VARIABLE}: no compiler is named {name!r}; {did_you_mean(name, COMPILERS)}")
    found = COMPILERS[name]
    if not found.installed:
        way = f"pip install 'taichi-cloth[{found.extra}]'" if found.extra else f"pip install {found.distribution}"
        here = " or ".join(other.name for other in COMPILERS.values() if other.installed)
        raise BackendError(f"{VARIABLE}: {name} is not installed: {way}" + (f", or set it to {here}" if here else ""))
    return found


@functools.cache
def language() -> ModuleType:
    """The compiler's package. Taichi would go through all modules for the source of each of its own kernels."""
    getmodule = inspect.getmodule
    if PATCHED:
        inspect.getmodule = lambda *_, **__: None  # type: ignore[assignment]
    try:
        return importlib.import_module(chosen().name)
    finally:
        inspect.getmodule = getmodule


def private(*places: str) -> list[Any]:
    """Modules "lang.impl", or things "lang.impl:get_runtime" in them, of the compiler; None for each that it does not have."""
    out, package = [], language().__name__
    for place in places:
        module, _, name = place.partition(":")
        try:
            found = importlib.import_module(f"{package}.{module}".rstrip("."))
            out.append(operator.attrgetter(name)(found) if name else found)
        except (ImportError, AttributeError):
            out.append(None)
    return out


def foreign(kind: type) -> str:
    """Another compiler in whose language a class has functions or kernels; "" where there is none."""
    for value in (value for base in kind.__mro__ for value in vars(base).values()):
        made = getattr(value, "__globals__", {}).get("__name__") or type(value).__module__
        name = str(made).partition(".")[0]
        if name in COMPILERS and name != chosen().name:
            return name
    return ""


def told() -> dict[str, str]:
    """For settings that tell runs apart: nothing of the usual compiler, the name of another."""
    return {} if chosen().name == DEFAULT else {"compiler": chosen().name}


def version(language: Any) -> str:
    """A compiler's version for records: Taichi's is the number alone, that of a fork follows its name."""
    number = ".".join(map(str, language.__version__))
    return number if chosen().name == DEFAULT else f"{chosen().name} {number}"


def options(wanted: dict[str, Any]) -> dict[str, Any]:
    """Those arguments of `init` that the chosen compiler knows, and its own."""
    [usual] = private("lang.impl:default_cfg")
    known = usual() if usual else None
    return {**{name: value for name, value in wanted.items() if hasattr(known, name)}, **dict(chosen().own)}
