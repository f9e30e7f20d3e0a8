"""glTF files written by hand, for tests: a document, and arrays in a buffer."""

import base64
import json
import struct

import numpy as np

CODES = {"i1": 5120, "u1": 5121, "i2": 5122, "u2": 5123, "u4": 5125, "f4": 5126}
TYPES = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}


class Glb:
    """A file that is being made.

    Attributes:
        document: what it says, to be added to.
    """

    def __init__(self, **document) -> None:
        self.blob = b""
        self.document = {"asset": {"version": "2.0"}, "bufferViews": [], "accessors": [], **document}

    def view(self, data: bytes, **more) -> int:
        """Bytes in the buffer."""
        self.blob += bytes(-len(self.blob) % 4)
        self.document["bufferViews"].append({"buffer": 0, "byteOffset": len(self.blob), "byteLength": len(data), **more})
        self.blob += data
        return len(self.document["bufferViews"]) - 1

    def add(self, values, kind: str = "f4", spread: int = 0, **more) -> int:
        """An accessor of rows; `spread`: bytes between them."""
        rows = np.atleast_1d(np.asarray(values))
        rows = np.ascontiguousarray(rows.reshape(len(rows), -1), dtype="<" + kind)
        row = [r.tobytes() + bytes(spread) for r in rows]
        view = self.view(b"".join(row), **({"byteStride": len(row[0])} if spread else {}))
        self.document["accessors"].append({"bufferView": view, "componentType": CODES[kind], "count": len(rows),
                                           "type": TYPES[rows.shape[1]], **more})
        return len(self.document["accessors"]) - 1

    def sparse(self, count: int, at, values, base=None) -> int:
        """An accessor of rows of three that are 0, or `base`, but for some."""
        said = {"componentType": 5126, "count": count, "type": "VEC3", "sparse": {
            "count": len(at), "indices": {"bufferView": self.view(np.asarray(at, "<u2").tobytes()), "componentType": 5123},
            "values": {"bufferView": self.view(np.asarray(values, "<f4").tobytes())}}}
        if base is not None:
            said["bufferView"] = self.view(np.asarray(base, "<f4").tobytes())
        self.document["accessors"].append(said)
        return len(self.document["accessors"]) - 1

    def clip(self, name: str, **channels) -> None:
        """An animation; each channel is "path node": (times, values, interpolation)."""
        said = {"name": name, "channels": [], "samplers": []}
        for key, (t, values, kind) in channels.items():
            path, node = key.split("_")
            said["channels"].append({"sampler": len(said["samplers"]), "target": {"node": int(node), "path": path}})
            values = np.asarray(values).reshape(-1, {"translation": 3, "rotation": 4, "scale": 3}.get(path, 1))
            said["samplers"].append({"input": self.add(t), "output": self.add(values), "interpolation": kind})
        self.document.setdefault("animations", []).append(said)

    def write(self, path, how: str = "inside"):
        """The file; its buffer is "inside", a "uri" in the document, or a file "beside" it."""
        document = dict(self.document)
        buffer = {"byteLength": len(self.blob)}
        if how == "uri":
            buffer["uri"] = "data:application/gltf-buffer;base64," + base64.b64encode(self.blob).decode()
        elif how == "beside":
            (path.parent / "a buffer.bin").write_bytes(self.blob)
            buffer["uri"] = "a%20buffer.bin"
        text = json.dumps(document | {"buffers": [buffer]}).encode()
        if how != "inside":
            path.write_bytes(text)
            return path
        text += b" " * (-len(text) % 4)
        blob = self.blob + bytes(-len(self.blob) % 4)
        chunks = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(blob), b"BIN\0") + blob
        path.write_bytes(struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks)
        return path
