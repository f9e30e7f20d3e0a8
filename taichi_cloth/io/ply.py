"""PLY, text or binary: positions and faces; every other property is passed over."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from .polygon import triangles_of
from .text import unmarked

KINDS = {"char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2", "ushort": "u2",
         "uint16": "u2", "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4", "int64": "i8", "uint64": "u8",
         "float": "f4", "float32": "f4", "double": "f8", "float64": "f8"}
FORMATS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
Columns = dict[str, np.ndarray | list[np.ndarray]]


@dataclass
class Element:
    """A table of the file: its rows have `properties` (name, type of the value, type of a list's length or None)."""

    name: str
    count: int
    properties: list[tuple[str, str, str | None]]


def read_ply(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Positions (n, 3) and triangles (m, 3).

    Raises:
        ValueError: names the fault of the file.
    """
    data = unmarked(path)
    order, elements, body = _header(data)
    tables = dict(_text(elements, body) if order == "" else _binary(elements, body, order))
    vertex, face = tables.get("vertex", {}), tables.get("face", {})
    missing = [c for c in "xyz" if c not in vertex]
    if missing:
        raise ValueError(f"its vertices have no {missing[0]}")
    x = np.column_stack([np.asarray(vertex[c], dtype=np.float64) for c in "xyz"])
    polygons = face.get("vertex_indices", face.get("vertex_index"))
    if polygons is None or not len(polygons):
        raise ValueError("the mesh has no faces")
    if isinstance(polygons, np.ndarray) and polygons.ndim == 1:
        raise ValueError("the vertices of its faces are not lists")
    return x, triangles_of(x, polygons)  # type: ignore[arg-type]


def _header(data: bytes) -> tuple[str, list[Element], bytes]:
    """Byte order ("" of text), elements and the data after the header; sizes are held against the file's own."""
    head, end, body = data.partition(b"end_header")
    if not data.startswith(b"ply") or not end:
        raise ValueError("is not a PLY file, or its header is cut off")
    body = body[2:] if body.startswith(b"\r\n") else body[1:]
    order, elements = None, []
    for line in head.decode("ascii", "replace").splitlines():
        words = line.split() or ["comment"]
        try:
            if words[0] == "format":
                order = FORMATS[words[1]]
            elif words[0] == "element":
                elements.append(Element(words[1], int(words[2]), []))
                if not 0 <= elements[-1].count <= len(body):
                    raise ValueError(f"its header says {words[2]} of {words[1]!r}, and {len(body)} bytes follow it")
            elif words[0] == "property" and words[1] == "list":
                elements[-1].properties.append((words[4], KINDS[words[3]], KINDS[words[2]]))
            elif words[0] == "property":
                elements[-1].properties.append((words[2], KINDS[words[1]], None))
        except (IndexError, KeyError):
            raise ValueError(f"its header has a line that says nothing: {line[:60]!r}") from None
    if order is None:
        raise ValueError("its header has no format")
    return order, elements, body


def _text(elements: list[Element], body: bytes):
    """(name, columns) of every element of a text file."""
    words, at = body.split(), 0
    for element in elements:
        width = len(element.properties)
        if not any(count for _, _, count in element.properties):
            _enough(element, len(words) - at, element.count * width, "numbers")
            table = np.array(words[at: at + element.count * width], dtype=np.float64).reshape(element.count, width)
            yield element.name, {name: table[:, k] for k, (name, _, _) in enumerate(element.properties)}
            at += element.count * width
            continue
        columns: Columns = {name: [] for name, _, _ in element.properties}
        for _ in range(element.count):
            for name, kind, count in element.properties:
                _enough(element, len(words) - at, 1, "numbers")
                length = 1 if count is None else int(words[at])
                at += count is not None
                _enough(element, len(words) - at, length, "numbers")
                row = words[at: at + length]
                columns[name].append(np.array([float(w) if kind[0] == "f" else int(w) for w in row]))  # type: ignore[union-attr]
                at += length
        yield element.name, columns


def _binary(elements: list[Element], body: bytes, order: str):
    """(name, columns) of every element of a binary file."""
    at = 0
    for element in elements:
        lengths = _lengths(element, body, at, order)
        kind = np.dtype([(f"{name} {k}", order + value) if count is None else (f"{name} {k}", [
            ("n", order + count), ("row", order + value, (lengths[k],))]) for k, (name, value, count) in
            enumerate(element.properties)])
        if kind.itemsize == 0:
            continue
        if element.count * kind.itemsize <= len(body) - at:
            table = np.frombuffer(body, kind, element.count, at)
            if all((table[f"{name} {k}"]["n"] == lengths[k]).all()
                   for k, (name, _, count) in enumerate(element.properties) if count):
                yield element.name, {name: table[f"{name} {k}"]["row"] if count else table[f"{name} {k}"]
                                     for k, (name, _, count) in enumerate(element.properties)}
                at += element.count * kind.itemsize
                continue
        columns, at = _ragged(element, body, at, order)
        yield element.name, columns


def _lengths(element: Element, body: bytes, at: int, order: str) -> list[int]:
    """Lengths of the first row's lists, by property: most files have the same in all rows."""
    lengths = []
    for _, value, count in element.properties:
        length, size = 1, 0
        if count is not None and element.count:
            size = np.dtype(count).itemsize
            _enough(element, len(body) - at, size, "bytes")
            length = int(np.frombuffer(body, order + count, 1, at)[0])
        size += length * np.dtype(value).itemsize
        _enough(element, len(body) - at if element.count else size, size if length >= 0 else -1, "bytes")
        lengths.append(length)
        at += size
    return lengths


def _ragged(element: Element, body: bytes, at: int, order: str) -> tuple[Columns, int]:
    """The columns of rows of different lengths, and where they end."""
    columns: Columns = {name: [] for name, _, _ in element.properties}
    kinds = [(name, np.dtype(order + value), None if count is None else np.dtype(order + count))
             for name, value, count in element.properties]
    for _ in range(element.count):
        for name, value, count in kinds:
            length = 1
            if count is not None:
                _enough(element, len(body) - at, count.itemsize, "bytes")
                length, at = int(np.frombuffer(body, count, 1, at)[0]), at + count.itemsize
            _enough(element, len(body) - at, length * value.itemsize, "bytes")
            columns[name].append(np.frombuffer(body, value, length, at))  # type: ignore[union-attr]
            at += length * value.itemsize
    return columns, at


def _enough(element: Element, there: int, needed: int, what: str) -> None:
    if not 0 <= needed <= there:
        raise ValueError(f"is cut off or damaged: {element.name!r} needs {needed} {what} more, and {max(there, 0)} are left")
