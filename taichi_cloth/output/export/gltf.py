"""glTF 2.0: one .glb, or a .gltf with its .bin. Motion is a morph target a frame, between which players blend linearly.

A vertex has one normal and one uv there, so vertices on uv seams and sharp edges come as often as they have different ones.
v runs down, as glTF wants it.
"""

import json
import pathlib
import struct

import numpy as np

from ...errors import OutputError
from ..camera import frame as axes_of
from ..folder import write_whole, written_aside
from ..png import encode_png
from .shot import ASPECT, Mesh, Shot

FLOAT, UINT = 5126, 5125  # component types
VERTICES, INDICES = 34962, 34963  # the purpose of a buffer
REPEAT, CLAMP, LINEAR, MIPMAPS = 10497, 33071, 9729, 9987  # how an image goes on, and is read between its pixels
MOST = 2**32 - 1  # bytes that the header of a .glb can say


class _Buffer:
    """The bytes, and their table of contents."""

    def __init__(self) -> None:
        self.parts: list[bytes] = []
        self.views: list[dict] = []
        self.accessors: list[dict] = []
        self.size = 0

    def add(self, array: np.ndarray, kind: str, bounds: bool = False, target: int | None = None) -> int:
        """The number of an accessor of an array (k,) or (k, d) of float32 or uint32."""
        data = np.ascontiguousarray(array).tobytes()
        view = {"buffer": 0, "byteOffset": self.size, "byteLength": len(data)} | ({"target": target} if target else {})
        accessor = {"bufferView": len(self.views), "componentType": UINT if array.dtype == np.uint32 else FLOAT,
                    "count": len(array), "type": kind}
        if bounds:
            rows = array.reshape(len(array), -1)
            accessor |= {"min": rows.min(axis=0).tolist(), "max": rows.max(axis=0).tolist()}
        self.views.append(view)
        self.accessors.append(accessor)
        self.parts.append(data)  # all are of four bytes: the next part is aligned
        self.size += len(data)
        return len(self.accessors) - 1


    def file(self, data: bytes) -> int:
        """The number of a view of a file's bytes."""
        self.views.append({"buffer": 0, "byteOffset": self.size, "byteLength": len(data)})
        self.parts.append(data + bytes(-len(data) % 4))
        self.size += len(self.parts[-1])
        return len(self.views) - 1


def write(shot: Shot, path: pathlib.Path, format: str) -> list[pathlib.Path]:
    """The .glb, or the .gltf and the .bin of the same name.

    Raises:
        OutputError: more than a .glb can hold.
    """
    buffer = _Buffer()
    content = _content(shot, buffer)
    if format == "gltf":
        data = path.with_suffix(".bin")
        content["buffers"] = [{"byteLength": buffer.size, "uri": data.name}]
        write_whole(data, b"".join(buffer.parts))
        write_whole(path, json.dumps(content).encode())
        return [path, data]
    content["buffers"] = [{"byteLength": buffer.size}]
    text = json.dumps(content).encode()
    text += b" " * (-len(text) % 4)
    total = 12 + 8 + len(text) + 8 + buffer.size
    if total > MOST:
        raise OutputError(f"{path}: {total / 2**30:.1f} GiB, and a .glb holds 4 at most: export gltf, usdc or abc")
    with written_aside(path) as aside, open(aside, "wb") as file:
        file.write(struct.pack("<4sII", b"glTF", 2, total))
        file.write(struct.pack("<I4s", len(text), b"JSON") + text)
        file.write(struct.pack("<I4s", buffer.size, b"BIN\0"))
        file.writelines(buffer.parts)
    return [path]


def _content(shot: Shot, buffer: _Buffer) -> dict:
    """The JSON but for its buffers."""
    meshes, materials, nodes, channels, samplers = [], [], [], [], []
    images: dict[str, list[dict]] = {"images": [], "textures": [], "samplers": []}
    clock = ((np.array(shot.numbers) - shot.numbers[0]) / shot.fps).astype(np.float32)
    times = buffer.add(clock, "SCALAR", bounds=True)

    def animate(node: int, path: str, values: np.ndarray, kind: str) -> None:
        samplers.append({"input": times, "interpolation": "LINEAR", "output": buffer.add(values.astype(np.float32), kind)})
        channels.append({"sampler": len(samplers) - 1, "target": {"node": node, "path": path}})

    for k, mesh in enumerate(shot.meshes):
        materials.append({"name": mesh.name, "doubleSided": True, "pbrMetallicRoughness": {
            **_color(mesh, images, buffer), "metallicFactor": 0.0, "roughnessFactor": 0.8}})
        meshes.append(_mesh(mesh, k, buffer))
        nodes.append({"name": mesh.name, "mesh": k})
        if len(mesh.x) > 1:
            animate(k, "weights", np.eye(len(mesh.x), dtype=np.float32)[:, 1:].ravel(), "SCALAR")
    at, turned = _cameras(shot)
    nodes.append({"name": "camera", "camera": 0, "translation": at[0].tolist(), "rotation": turned[0].tolist()})
    if len(at) > 1:
        animate(len(nodes) - 1, "translation", at, "VEC3")
        animate(len(nodes) - 1, "rotation", turned, "VEC4")
    near, far = shot.clipping
    lens = {"yfov": float(np.radians(shot.cameras[0].fov)), "aspectRatio": ASPECT, "znear": near, "zfar": far}
    out = {"asset": {"version": "2.0", "generator": "taichi_cloth"}, "scene": 0,
           "scenes": [{"name": "scene", "nodes": list(range(len(nodes))), "extras": {"fps": shot.fps}}],
           "nodes": nodes, "meshes": meshes, "materials": materials, "accessors": buffer.accessors,
           "bufferViews": buffer.views, "cameras": [{"type": "perspective", "perspective": lens}]}
    if images["images"]:
        out |= images
    return out | ({"animations": [{"name": "cloth", "channels": channels, "samplers": samplers}]} if channels else {})


def _color(mesh: Mesh, images: dict[str, list[dict]], buffer: _Buffer) -> dict:
    """A mesh's colour, or its print, which is added to the images in the buffer."""
    on = mesh.printed
    if on is None:
        return {"baseColorFactor": [*mesh.color.tolist(), 1.0]}
    number, wrap = len(images["images"]), REPEAT if on.repeats else CLAMP
    images["images"].append({"name": mesh.name, "mimeType": "image/png", "bufferView": buffer.file(encode_png(on.image))})
    images["samplers"].append({"magFilter": LINEAR, "minFilter": MIPMAPS, "wrapS": wrap, "wrapT": wrap})
    images["textures"].append({"source": number, "sampler": number})
    return {"baseColorTexture": {"index": number}}


def _mesh(mesh: Mesh, material: int, buffer: _Buffer) -> dict:
    surface = mesh.surface(0)
    rows, vertex, uv, normal = _split(mesh)

    def add(values: np.ndarray, bounds: bool = False, kind: str = "VEC3") -> int:
        return buffer.add(values.astype(np.float32), kind, bounds, VERTICES)

    x, normals = mesh.position(0), mesh.normals(0)
    attributes = {"POSITION": add(x[vertex], True), "NORMAL": add(normals[normal])}
    if surface.uv is not None:
        attributes["TEXCOORD_0"] = add(uv * [1, -1] + [0, 1], kind="VEC2")
    part = {"attributes": attributes, "indices": buffer.add(rows.ravel().astype(np.uint32), "SCALAR", target=INDICES),
            "material": material}
    if len(mesh.x) > 1:
        part["targets"] = [{"POSITION": add((mesh.x[k] - x)[vertex], True), "NORMAL": add((mesh.normals(k) - normals)[normal])}
                           for k in range(1, len(mesh.x))]
    weights = {"weights": [0.0] * (len(mesh.x) - 1)} if len(mesh.x) > 1 else {}
    return {"name": mesh.name, "primitives": [part], **weights}


def _split(mesh: Mesh) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """(rows (m, 3) of the following; vertex (k,), uv (k, 2), number of the normal (k,)), different from each other."""
    surface = mesh.surface(0)
    uv = np.zeros((*surface.faces.shape, 2)) if surface.uv is None else surface.uv
    corners = np.column_stack([surface.faces.ravel(), surface.normal_of.ravel(), uv.reshape(-1, 2)])  # exact in f64
    table, rows = np.unique(corners, axis=0, return_inverse=True)
    return rows.reshape(-1, 3), table[:, 0].astype(np.int64), table[:, 2:], table[:, 1].astype(np.int64)


def _cameras(shot: Shot) -> tuple[np.ndarray, np.ndarray]:
    """(positions (k, 3), unit quaternions (k, 4) x y z w) of the cameras, neighbours on the same side."""
    turned: list[np.ndarray] = []
    for camera in shot.cameras:
        q = _quaternion(axes_of(camera).axes.T)
        turned.append(-q if turned and q @ turned[-1] < 0 else q)
    return np.array([c.eye for c in shot.cameras]), np.array(turned)


def _quaternion(R: np.ndarray) -> np.ndarray:
    """(4,) x y z w of a rotation (3, 3): the eigenvector of the largest eigenvalue of Bar-Itzhack's matrix (2000)."""
    K = np.array([[R[0, 0] - R[1, 1] - R[2, 2], 0, 0, 0],
                  [R[1, 0] + R[0, 1], R[1, 1] - R[0, 0] - R[2, 2], 0, 0],
                  [R[2, 0] + R[0, 2], R[2, 1] + R[1, 2], R[2, 2] - R[0, 0] - R[1, 1], 0],
                  [R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1], R[0, 0] + R[1, 1] + R[2, 2]]]) / 3
    return np.linalg.eigh(K)[1][:, -1]  # reads the lower triangle
