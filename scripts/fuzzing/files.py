"""Trials of mesh and solid files: random ones in every format, whole or damaged.

A whole file must give back what was put into it; a damaged one must load, or be refused by one of the project's own errors
that names the file, within seconds and a bounded amount of memory.
"""

import contextlib
import json
import pathlib
import re
import signal
import struct
import tempfile
import warnings

import numpy as np
from fuzz import FAILED, OK, Outcome

import taichi_cloth as tc
from taichi_cloth.errors import ClothError

try:
    import resource
except ImportError:  # not on Windows
    resource = None  # type: ignore[assignment]

SECONDS, MEMORY = 10, 1 << 30  # that reading one file may take; bytes beside what is taken before it
SUFFIXES = (".obj", ".ply", ".ply text", ".off", ".stl", ".stl text", ".vtk", ".vtk text", ".vtu", ".npz", ".pc2",
            ".mdd", ".glb")
NUMBERS = ("nan", "inf", "-1", "1e300", "99999999999", "-2147483648", "4294967295", "1e-320", "0", "x", "")
LENGTH = 1e-6  # of what is written in decimals


def mesh_of(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """A jittered sheet of random size, moved and scaled."""
    grid = tc.grid(1.0, int(rng.integers(1, 9)))
    x = (grid.x + 0.2 / 9 * rng.normal(size=grid.x.shape)) * 10 ** rng.uniform(-2, 2) + rng.normal(size=3)
    return x, grid.faces


def write(path: pathlib.Path, kind: str, x: np.ndarray, faces: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """A file of one of `SUFFIXES`, not by the project's code; the positions that must come back."""
    rows = "\n".join(" ".join(f"{v:.9g}" for v in p) for p in x)
    if kind == ".obj":
        path.write_text("v " + rows.replace("\n", "\nv ") + "\n" + "".join(f"f {a} {b} {c}\n" for a, b, c in faces + 1))
    elif kind == ".ply text":
        header = ["ply", "format ascii 1.0", f"element vertex {len(x)}", *(f"property double {c}" for c in "xyz"),
                  f"element face {len(faces)}", "property list uchar int vertex_indices", "end_header"]
        path.write_text("\n".join([*header, rows, *(f"3 {a} {b} {c}" for a, b, c in faces)]) + "\n")
    elif kind == ".off":
        path.write_text(f"OFF\n{len(x)} {len(faces)} 0\n{rows}\n" + "".join(f"3 {a} {b} {c}\n" for a, b, c in faces))
    elif kind == ".npz":
        saver = np.savez_compressed if rng.random() < 0.5 else np.savez
        saver(path, positions=np.stack([x, x + 1.0]), faces=faces, fps=np.array(24.0))
    elif kind == ".pc2":
        header = b"POINTCACHE2\0" + struct.pack("<iiffi", 1, len(x), 0, 1, 2)
        path.write_bytes(header + np.stack([x, x]).astype("<f4").tobytes())
        return x.astype(np.float32)
    elif kind == ".mdd":
        path.write_bytes(struct.pack(">iiff", 2, len(x), 0.0, 0.5) + np.stack([x, x]).astype(">f4").tobytes())
        return x.astype(np.float32)
    elif kind == ".glb":
        write_glb(path, x, faces)
        return x.astype(np.float32)
    else:
        import meshio

        suffix, _, text = kind.partition(" ")
        options = {} if suffix == ".vtu" else {"binary": not text}
        with contextlib.redirect_stderr(None):  # it warns of every cast
            meshio.write(path, meshio.Mesh(x, [("triangle", faces)]), file_format=suffix[1:], **options)
        return x.astype(np.float32) if kind == ".stl" else x
    return x


def write_glb(path: pathlib.Path, x: np.ndarray, faces: np.ndarray) -> None:
    """A mesh that moves by its own size in a second."""
    far = float(np.ptp(x))
    parts = [x.astype("<f4"), faces.astype("<u4"), np.array([0, 1], "<f4"), np.array([[0, 0, 0], [far, 0, 0]], "<f4")]
    ends = np.cumsum([0] + [part.nbytes for part in parts]).tolist()
    kinds = [("VEC3", 5126), ("SCALAR", 5125), ("SCALAR", 5126), ("VEC3", 5126)]
    counts = len(x), faces.size, 2, 2
    text = json.dumps({
        "asset": {"version": "2.0"}, "buffers": [{"byteLength": ends[-1]}], "nodes": [{"mesh": 0}],
        "bufferViews": [{"buffer": 0, "byteOffset": a, "byteLength": b - a} for a, b in zip(ends, ends[1:])],
        "accessors": [{"bufferView": k, "componentType": code, "type": kind, "count": count}
                      for k, (count, (kind, code)) in enumerate(zip(counts, kinds))],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "animations": [{"samplers": [{"input": 2, "output": 3}],
                        "channels": [{"sampler": 0, "target": {"node": 0, "path": "translation"}}]}]}).encode()
    text += b" " * (-len(text) % 4)
    data = b"".join(part.tobytes() for part in parts)
    path.write_bytes(struct.pack("<4sIIII", b"glTF", 2, 28 + len(text) + len(data), len(text), 0x4E4F534A) + text
                     + struct.pack("<I4s", len(data), b"BIN\0") + data)


def damage(data: bytes, rng: np.random.Generator) -> tuple[bytes, str]:
    """The bytes of a file, spoilt in one of many ways, and which."""
    way = rng.choice(["cut", "bits", "number", "number", "header", "header", "drop", "double", "noise"])
    if way == "cut":
        at = int(rng.integers(len(data)))
        return data[:at], f"cut off after {at} bytes"
    if way == "bits":
        out = bytearray(data)
        for at in rng.integers(len(data), size=int(rng.integers(1, 6))):
            out[at] ^= 1 << int(rng.integers(8))
        return bytes(out), "bits turned"
    if way in ("number", "header"):
        places = list(re.finditer(rb"(?<![\w.])[-+]?\d[\d.e+-]*", data[:400] if way == "header" else data))
        if places:
            place, text = places[int(rng.integers(len(places)))], str(rng.choice(NUMBERS))
            spoilt = data[:place.start()] + text.encode() + data[place.end():]
            return spoilt, f"{place[0]!r} at {place.start()} is now {text!r}"
    a, b = sorted(rng.integers(len(data), size=2).tolist())
    if way == "drop":
        return data[:a] + data[b:], f"bytes {a} to {b} are gone"
    if way == "double":
        return data[:b] + data[a:], f"bytes {a} to {b} are doubled"
    return data[:a] + rng.integers(256, size=b - a, dtype=np.uint8).tobytes() + data[b:], f"noise from {a} to {b}"


class Limits:
    """Time and memory that what happens within may take; there is none where the system knows none."""

    def __enter__(self) -> None:
        if resource is not None:
            self.before = resource.getrlimit(resource.RLIMIT_AS)
            pages = int(pathlib.Path("/proc/self/statm").read_text().split()[0]) if pathlib.Path("/proc").is_dir() else 0
            if pages:
                resource.setrlimit(resource.RLIMIT_AS, (pages * resource.getpagesize() + MEMORY, self.before[1]))
            signal.signal(signal.SIGALRM, self.late)
            signal.alarm(SECONDS)

    def __exit__(self, *error: object) -> None:
        if resource is not None:
            signal.alarm(0)
            resource.setrlimit(resource.RLIMIT_AS, self.before)

    @staticmethod
    def late(number: int, frame: object) -> None:
        raise TimeoutError(f"no end in {SECONDS} s")


def trial(seed: int, precision: str) -> Outcome:
    """One file, read as cloth or as a solid; `precision` makes no difference."""
    rng = np.random.default_rng([seed, 77])
    kind, whole = str(rng.choice(SUFFIXES)), rng.random() < 0.15
    as_solid = kind in (".npz", ".pc2", ".mdd") or rng.random() < 0.5
    x, faces = mesh_of(rng)
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        path = pathlib.Path(folder) / f"mesh{kind.split()[0]}"
        expected, way = write(path, kind, x, faces, rng), "whole"
        topology = pathlib.Path(folder) / "topology.obj"
        write(topology, ".obj", x, faces, rng)
        if not whole:
            data, way = damage(path.read_bytes(), rng)
            path.write_bytes(data)
        case = f"seed {seed}: {kind}, {way}, read as {'a solid' if as_solid else 'cloth'}"
        try:
            with Limits():
                cache = topology if kind in (".pc2", ".mdd") else None
                made = tc.load_solid(path, mesh=cache, fps=24) if as_solid else tc.load(path)
        except ClothError as error:
            if whole or str(path) not in str(error) or len(str(error)) > 600:
                return Outcome(FAILED, f"{case}: refused: {str(error)[:600]}")
            return Outcome(OK)
        except Exception as error:
            return Outcome(FAILED, f"{case}: {type(error).__name__}: {error}")
        got = made.x[0] if as_solid else made.x
        if not np.isfinite(got).all():
            return Outcome(FAILED, f"{case}: positions that are not finite")
        if whole and not same(got, made.faces, expected, faces, kind):
            return Outcome(FAILED, f"{case}: another mesh came back")
    return Outcome(OK)


def same(x: np.ndarray, faces: np.ndarray, expected: np.ndarray, expected_faces: np.ndarray, kind: str) -> bool:
    """Whether triangles have the same corners, in order; numbers of vertices may differ in STL."""
    if faces.shape != expected_faces.shape:
        return False
    if not kind.startswith(".stl") and (faces != expected_faces).any():
        return False
    return bool(np.abs(x[faces] - expected[expected_faces]).max() <= LENGTH * np.abs(expected).max())
