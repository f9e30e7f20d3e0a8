"""A glTF file: its document, by pygltflib, and the numbers in its buffers, each held against its own size."""

from __future__ import annotations

import base64
import binascii
import functools
import urllib.parse
import warnings
from pathlib import Path
from typing import Any

import numpy as np

from ...errors import MeshError, near
from ..text import text_of

TYPES = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
COMPRESSED = {"KHR_draco_mesh_compression": "Draco", "EXT_meshopt_compression": "meshopt",
              "KHR_meshopt_compression": "meshopt"}
KNOWN = ("KHR_mesh_quantization", "EXT_mesh_gpu_instancing")
LOOKS = ("KHR_materials_", "KHR_texture_", "EXT_texture_", "KHR_lights_", "EXT_lights_", "KHR_xmp")  # say nothing of shape


class File:
    """A glTF document and its buffers.

    Attributes:
        document: pygltflib's: scenes, nodes, meshes, skins, animations.
    """

    def __init__(self, path: Path) -> None:
        self.path, self.document = path, _parsed(path)
        for name in self.document.extensionsRequired or ():
            if name in COMPRESSED:
                raise MeshError(f"is compressed with {COMPRESSED[name]} ({name}), which is not read: export it without "
                                "compression")
            if name not in KNOWN and not name.startswith(LOOKS):
                raise MeshError(f"needs the extension {name}, which is not known: export it without")
        self._buffers: dict[int, bytes] = {}

    def numbers(self, index: int, what: str, width: int, floats: bool = True) -> np.ndarray:
        """(count, width) float64 of an accessor, or int64 where they are no floats; normalized integers are in [-1, 1].

        Raises:
            MeshError: it is not there, of another type, or longer than its buffer; names `what`.
        """
        accessor = item(self.document.accessors, index, f"{what}: accessor")
        dtype = np.dtype(_known(TYPES, accessor.componentType, f"{what}: component type"))
        if _known(WIDTHS, accessor.type, f"{what}: type") != width or (not floats and dtype.kind == "f"):
            raise MeshError(f"{what}: has numbers of type {accessor.type} {dtype}")
        count = self.count(index, what)
        if accessor.bufferView is None:
            out = np.zeros((count, width), dtype=dtype)
        else:
            out = self._rows(accessor.bufferView, accessor.byteOffset or 0, count, width, dtype, what)
        if accessor.sparse is not None:
            out = self._sparse(out.copy(), accessor.sparse, what)
        return _scaled(out, bool(accessor.normalized)) if floats else out.astype(np.int64)

    def count(self, index: int, what: str) -> int:
        """Rows of an accessor, no more than there are bytes in the longest buffer.

        Raises:
            MeshError: it says something else; names `what`.
        """
        count = item(self.document.accessors, index, f"{what}: accessor").count
        if not isinstance(count, int) or not 0 <= count <= self._longest:
            raise MeshError(f"{what}: says that it has {count} rows, and its buffers {self._longest} bytes")
        return count

    @functools.cached_property
    def _longest(self) -> int:
        """Bytes of the longest buffer."""
        return max((len(self.buffer(k)) for k in range(len(self.document.buffers))), default=0)

    def buffer(self, index: int) -> bytes:
        """The bytes of a buffer: of the file itself, a data URI, or another file.

        Raises:
            MeshError: it is not there, or shorter than the document says.
        """
        if index not in self._buffers:
            said = item(self.document.buffers, index, "buffer")
            data = self.document.binary_blob() if said.uri is None else self._fetched(said.uri)
            if data is None or len(data) < said.byteLength:
                raise MeshError(f"buffer {index} is {len(data or b'')} bytes long, and the document says {said.byteLength}: "
                                "the file is cut off")
            self._buffers[index] = bytes(data)
        return self._buffers[index]

    def _fetched(self, uri: str) -> bytes:
        if uri.startswith("data:"):
            try:
                return base64.b64decode(uri.partition(",")[2], validate=True)
            except binascii.Error as error:
                raise MeshError(f"a buffer in the document is damaged: {error}") from None
        if "://" in uri:
            raise MeshError(f"its buffer is at {uri[:80]}: nothing is fetched; save the file with its buffer inside (.glb)")
        place = self.path.parent / urllib.parse.unquote(uri)
        try:
            return place.read_bytes()
        except OSError as error:
            raise MeshError(f"its buffer {place} cannot be read: {error.strerror or error}{near(place)}") from None

    def _rows(self, view: int, offset: int, count: int, width: int, dtype: np.dtype, what: str) -> np.ndarray:
        """(count, width) numbers of a buffer view."""
        said = item(self.document.bufferViews, view, f"{what}: buffer view")
        data, size = self.buffer(said.buffer), width * dtype.itemsize
        start, stride = said.byteOffset or 0, said.byteStride or size
        end = offset + (count - 1) * stride + size if count else offset
        if min(start, offset, said.byteLength) < 0 or stride < 1 or end > said.byteLength or start + end > len(data):
            raise MeshError(f"{what}: reaches beyond its buffer")
        return np.ndarray((count, width), dtype, data, start + offset, (stride, dtype.itemsize))

    def _sparse(self, out: np.ndarray, said: Any, what: str) -> np.ndarray:
        """Rows (n, width) of which some are replaced."""
        kind = np.dtype(_known(TYPES, said.indices.componentType, f"{what}: component type"))
        at = self._rows(said.indices.bufferView, said.indices.byteOffset or 0, said.count, 1, kind, what).ravel()
        if kind.kind != "u" or (at >= len(out)).any():
            raise MeshError(f"{what}: replaces rows that are not there")
        out[at] = self._rows(said.values.bufferView, said.values.byteOffset or 0, said.count, out.shape[1], out.dtype, what)
        return out


def _parsed(path: Path) -> Any:
    """The document.

    Raises:
        MeshError: pygltflib is not installed, or it is no glTF 2 file.
    """
    try:
        import pygltflib
    except ImportError:
        raise MeshError("glTF is read by the package pygltflib: pip install 'taichi-cloth[gltf]'") from None
    try:
        data = path.read_bytes()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # it asks for reports of unknown parts
            read = pygltflib.GLTF2.load_from_bytes if data[:4] == b"glTF" else pygltflib.GLTF2.gltf_from_json
            document = read(data if data[:4] == b"glTF" else text_of(data))
    except OSError as error:
        raise MeshError(f"cannot be read: {error.strerror or error}") from None
    except RecursionError:
        raise MeshError("is nested too deeply") from None
    except Exception as error:  # of json, struct and dataclasses
        raise MeshError(f"is not a glTF file, or a damaged one: {type(error).__name__}: {error}") from None
    version = document.asset.version if document is not None and document.asset else None
    if not str(version).startswith("2"):
        raise MeshError(f"is of glTF version {version}: 2.0 is read")
    return document


def _scaled(values: np.ndarray, normalized: bool) -> np.ndarray:
    """Values in float64; integers that are normalized go to [0, 1] or [-1, 1]."""
    out = values.astype(np.float64)
    return np.maximum(out / np.iinfo(values.dtype).max, -1.0) if normalized and values.dtype.kind in "iu" else out


def item(items: Any, index: Any, what: str) -> Any:
    """An item of a list of the document; `what` it is, for the message.

    Raises:
        MeshError: it is not there.
    """
    if not isinstance(index, int) or not 0 <= index < len(items or ()):
        raise MeshError(f"{what} {index} is not there: the document has {len(items or ())}")
    return items[index]


def _known(table: dict, key: Any, what: str) -> Any:
    if key not in table:
        raise MeshError(f"{what} {key!r} is unknown")
    return table[key]
