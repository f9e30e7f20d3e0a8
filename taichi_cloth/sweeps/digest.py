"""Digest of any value, the same in every process: arrays by their bytes, functions by their code and all that it reads.

Numbers count exactly, dicts and sets in no order, objects by their class and state. Installed code (Python, packages, this
one) counts by its name and version; code of one's own is followed wherever it is called. Formatting and comments are no code.
"""

import copyreg
import dis
import functools
import hashlib
import importlib
import os
import sys
import sysconfig
import types
from collections.abc import Iterable, Iterator
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np

from ..backend.compiler import COMPILERS
from ..errors import shown
from ..scene.contents import Contents

OPEN = ("followers", "_running")  # of a scene: who simulates it
MAIN = ("__main__", "__mp_main__")
ATOMS = (type(None), bool, float, complex, str, type(Ellipsis), type(NotImplemented))
WRAPPERS = (staticmethod, classmethod)
PLACES = tuple({os.path.realpath(sysconfig.get_paths()[name]) + os.sep for name in ("stdlib", "platstdlib", "purelib",
                                                                                  "platlib")}
               | {os.path.dirname(os.path.dirname(os.path.realpath(__file__))) + os.sep})


class Unknown(Exception):
    """Something whose content cannot be read, such as an open file; the message says where it is."""


def combined(kind: str, parts: Iterable[bytes]) -> bytes:
    """One digest of several parts, in order."""
    total = hashlib.sha256(kind.encode())
    for part in parts:
        total.update(len(part).to_bytes(8, "little"))
        total.update(part)
    return b"#" + total.digest()


class Digest:
    """Digests of values, each object looked at once."""

    def __init__(self) -> None:
        self._known: dict[int, tuple[object, bytes]] = {}  # with the object, so that no other gets its id
        self._within: list[tuple[int, str]] = []  # objects that are being looked at, and their names there

    def of(self, value: object, name: str = "") -> bytes:
        """The digest of a value.

        Args:
            name: its name where it stands, for messages.

        Raises:
            Unknown: it, or something in it, cannot be read.
        """
        kind = type(value)
        if kind in ATOMS:
            return f"{kind.__name__} {value!r}".encode()
        if kind is int:
            return f"int {value:x}".encode()
        if kind is bytes:
            return b"bytes " + value  # type: ignore[operator]
        if id(value) in self._known:
            return self._known[id(value)][1]
        for depth, (other, _) in enumerate(self._within):
            if other == id(value):
                return b"within %d" % depth
        self._within.append((id(value), name or kind.__name__))
        try:
            out = self._of(value)
        finally:
            self._within.pop()
        self._known[id(value)] = value, out
        return out

    def _of(self, value: Any) -> bytes:
        kind = type(value)
        if isinstance(value, np.generic) or kind in (np.ndarray, np.memmap):
            return self._array(np.asarray(value))
        if kind in (list, tuple):
            return combined(kind.__name__, [self.of(v, f"[{k}]") for k, v in enumerate(value)])
        if kind in (dict, types.MappingProxyType):
            pairs = sorted(((Digest().of(k, shown(k)), k) for k in value), key=lambda pair: pair[0])
            return combined("dict", [part for digest, k in pairs for part in (digest, self.of(value[k], shown(k)))])
        if kind in (set, frozenset):
            return combined("set", sorted(Digest().of(v, "an element") for v in value))
        if kind is types.FunctionType:
            return self._function(value)
        if kind is types.CodeType:
            return self._code(value)
        if kind is types.MethodType:
            return combined("method", [self.of(value.__func__), self.of(value.__self__, "self")])
        if kind is types.ModuleType:
            return self._module(value, None)
        if isinstance(value, type):
            return self._class(value)
        return self._described(value)

    def _array(self, value: np.ndarray) -> bytes:
        shape = repr(value.shape).encode()
        if value.dtype.hasobject:
            return combined("objects", [shape, *(self.of(v, f"[{k}]") for k, v in enumerate(value.ravel().tolist()))])
        little = np.ascontiguousarray(value, dtype=value.dtype.newbyteorder("<"))
        return combined("array", [repr(little.dtype.descr).encode(), shape, little.tobytes()])

    def _described(self, value: Any) -> bytes:
        """An object by its class and its state."""
        kind = self.of(type(value))
        if isinstance(value, property):
            return combined("property", [kind, *(self.of(f) for f in (value.fget, value.fset, value.fdel))])
        if isinstance(value, functools.cached_property):
            return combined("property", [kind, self.of(value.func)])
        if isinstance(value, WRAPPERS):
            return combined("wrapper", [kind, self.of(value.__func__)])
        if hasattr(value, "cache_info"):  # of functools: its cache decides nothing
            return combined("wrapper", [kind, self.of(value.__wrapped__)])
        if isinstance(value, Contents):
            return combined("scene", [kind, self.of({n: v for n, v in vars(value).items() if n not in OPEN}, "")])
        if is_dataclass(value) and type(value).__module__.startswith(__name__.split(".")[0] + "."):
            return combined("data", [kind, *(self.of(getattr(value, f.name), f.name) for f in fields(value))])
        try:
            reduce = copyreg.dispatch_table.get(type(value))
            made = value.__reduce_ex__(4) if reduce is None else reduce(value)
        except Exception:  # pickle's way to say that there is more to it than can be told
            raise Unknown(f"{self._where()}, {_article(type(value).__name__)}") from None
        if isinstance(made, str):
            return combined("named", [kind, f"{getattr(value, '__module__', '')} {made}".encode()])
        made, items, pairs = made[:3], *(list(part or ()) for part in (*made[3:5], None, None)[:2])
        return combined("object", [kind, *(self.of(part, "") for part in (*made, items, dict(pairs)))])

    def _where(self) -> str:
        """Names of objects being looked at, from the outside in."""
        names = [name for _, name in self._within]
        return " of ".join(name for name in reversed(names) if name and name not in ("dict", "tuple", "cell"))

    def _function(self, value: types.FunctionType) -> bytes:
        code, globals_ = value.__code__, value.__globals__
        wrapped = getattr(value, "__wrapped__", None)
        parts = [self.of(wrapped, "what it wraps"), self.of(value.__defaults__), self.of(value.__kwdefaults__)]
        name = str(globals_.get("__name__"))
        if name.partition(".")[0] in COMPILERS:  # a kernel's wrapper: its closure holds Taichi's objects
            return combined("function", [_installed_name(name, code.co_name), *parts])
        names = _names(code)
        cells = {n: _content(c) for n, c in zip(code.co_freevars, value.__closure__ or ())}
        parts += [self._read(cells, names)]
        if _is_installed(code.co_filename):
            return combined("function", [_installed_name(name, code.co_name), *parts])
        read = {n: globals_[n] for n in _globals(code) if n in globals_ and not n.startswith("__")}
        read |= _imports(code, globals_)
        own = {n: v for n, v in vars(value).items() if n != "__wrapped__"}
        return combined("function", [self._code(code, value.__doc__), *parts, self._read(read, names), self.of(own)])

    def _read(self, values: dict[str, object], names: set[str]) -> bytes:
        """Values that a function finds under names; of modules, those parts whose names it has in it."""
        return combined("read", [part for n, v in sorted(values.items()) for part in (n.encode(), self._module(
            v, names) if type(v) is types.ModuleType else self.of(v, n))])

    def _code(self, code: types.CodeType, doc: str | None = None) -> bytes:
        consts = code.co_consts
        if doc is not None and consts and consts[0] == doc:
            consts = consts[1:]
        what = (code.co_argcount, code.co_posonlyargcount, code.co_kwonlyargcount, code.co_flags, code.co_code, code.co_names,
                code.co_varnames, code.co_freevars, code.co_cellvars, getattr(code, "co_exceptiontable", b""))
        return combined("code", [self.of(what), *(self.of(c, "a constant") for c in consts)])

    def _module(self, module: types.ModuleType, names: set[str] | None) -> bytes:
        """A module by its name and version, or one's own by those parts that are read (all if None)."""
        if _is_installed(getattr(module, "__file__", None)) or any(other == id(module) for other, _ in self._within):
            return _installed_name(module.__name__, "")
        self._within.append((id(module), module.__name__))
        try:
            return self._read({n: v for n, v in vars(module).items() if (
                n in names if names is not None else not n.startswith("__"))}, names or set())
        finally:
            self._within.pop()

    def _class(self, value: type) -> bytes:
        module = sys.modules.get(value.__module__)
        if value.__module__ not in MAIN and module is not None and _is_installed(getattr(module, "__file__", None)):
            return _installed_name(value.__module__, value.__qualname__)
        own = {n: v for n, v in vars(value).items() if n != "_abc_impl" and (
            not n.startswith("__") or isinstance(v, (types.FunctionType, property, *WRAPPERS)))}
        return combined("class", [value.__qualname__.encode(), *(self.of(b) for b in value.__bases__), self.of(own, "")])


def _content(cell: types.CellType) -> object:
    try:
        return cell.cell_contents
    except ValueError:  # nothing yet
        return None


def _nested(code: types.CodeType) -> Iterator[types.CodeType]:
    """Code, and that of functions and classes within it."""
    yield code
    for const in code.co_consts:
        if isinstance(const, types.CodeType):
            yield from _nested(const)


def _names(code: types.CodeType) -> set[str]:
    """All names in it, of attributes too."""
    return {name for c in _nested(code) for name in c.co_names}


def _globals(code: types.CodeType) -> set[str]:
    """Names that it looks for in its module."""
    return {i.argval for c in _nested(code) for i in dis.get_instructions(c) if i.opname in ("LOAD_GLOBAL", "LOAD_NAME")}


def _imports(code: types.CodeType, globals_: dict[str, Any]) -> dict[str, object]:
    """Modules that it imports itself, by name, as far as they are there."""
    out: dict[str, object] = {}
    for c in _nested(code):
        consts: list[object] = []
        for i in dis.get_instructions(c):
            if i.opname.startswith("LOAD_CONST") or i.opname == "LOAD_SMALL_INT":
                consts.append(i.argval)
            elif i.opname == "IMPORT_NAME":
                level = consts[-2] if len(consts) > 1 and isinstance(consts[-2], int) else 0
                name = "." * level + i.argval
                try:
                    out[f"import {name}"] = importlib.import_module(name, globals_.get("__package__"))
                except Exception:  # it is not there: then its code decides
                    out[f"import {name}"] = None
    return out


@functools.cache
def _is_installed(file: str | None) -> bool:
    """Whether a file belongs to Python, to an installed package or to this one; modules without a file are built in."""
    if file is None or file.startswith("<frozen"):
        return True
    return os.path.realpath(file).startswith(PLACES) and not file.startswith("<")


def _installed_name(module: str, name: str) -> bytes:
    version = getattr(sys.modules.get(module.partition(".")[0]), "__version__", "")
    return f"installed {module} {name} {version}".encode()


def _article(name: str) -> str:
    return f"{'an' if name[0].lower() in 'aeiou' else 'a'} {name}"
