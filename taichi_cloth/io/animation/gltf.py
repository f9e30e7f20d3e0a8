"""glTF 2.0 (.glb, .gltf): meshes with skins and morph targets, in the nodes of a scene, as an animation moves them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ...errors import MeshError
from . import gltf_nodes
from .gltf_file import COMPRESSED, File, item
from .gltf_nodes import Nodes
from .motion import (
    Clip,
    Motion,
    Part,
    Wanted,
    chosen_clips,
    chosen_parts,
    distinct_names,
    finite,
    mirrors,
    refuse_restless,
    shears,
    times,
)
from .rest import Placing, lead
from .skin import skinned, weighed

POINTS, STRIP, FAN = 3, 5, 6  # modes up to POINTS are points and lines, 4 is triangles
INSTANCES = "EXT_mesh_gpu_instancing"


def read(path: Path, wanted: Wanted) -> Motion:
    """The parts of a glTF file; its unit is the metre, and y points up.

    Raises:
        MeshError: it is damaged, or holds no mesh or no such clip.
    """
    file = File(path)
    nodes, document = Nodes(file), file.document
    clips = [gltf_nodes.clip(file, k, nodes) for k in range(len(document.animations or []))]
    names = [clip.name or f"clip {k}" for k, clip in enumerate(document.animations or [])]
    meshes = [k for k in nodes.shown if nodes.all[k].mesh is not None]
    for k in meshes:
        item(document.meshes, nodes.all[k].mesh, f"node {k}: mesh")
    parts = distinct_names([nodes.name(k) for k in meshes], "part")
    found = f"it has {len(nodes.all)} nodes and {len(clips)} animations"
    take = chosen_parts(wanted.only, parts, found)
    taken = chosen_clips(wanted.clip, names) if wanted.moves else ()
    clip = gltf_nodes.together(clips, taken)
    notes, fps = [*nodes.notes, *clip.notes], None
    vertices = sum(_vertices(file, nodes.all[k].mesh, name) for name, k in zip(parts, meshes))
    if clip.span[1] > clip.span[0]:
        fps = wanted.fps or clip.fps
        t = times(*clip.span, fps, vertices)
        way = lead(wanted.rest, fps) if wanted.rest is not None else np.zeros(0)
        if len(way):
            nodes.rest_of([(skin.joints, _bind(file, skin, f"skin {k}")) for k, skin in enumerate(document.skins or ())])
        nodes.pose(clip.channels, np.append(np.full(len(way), t[0]), t), np.append(way, np.ones(len(t))))
    refuse_restless(wanted, bool(nodes.rest))
    made: list[Part] = []
    for name, k in ((name, k) for name, k, taken in zip(parts, meshes, take) if taken):
        made += _parts(file, nodes, k, name, notes)
    if not made:
        raise MeshError("has no mesh: it has points and lines alone")
    lengths = tuple(Clip(name, clip.span[1] - clip.span[0], wanted.fps or clip.fps) for name, clip in zip(names, clips))
    return Motion(made, fps, 1.0, "y", lengths, clip.numbers, tuple(notes))


def _vertices(file: File, mesh: int, name: str) -> int:
    """How many a mesh has, as the file says."""
    accessors = [getattr(p.attributes, "POSITION", None) for p in file.document.meshes[mesh].primitives]
    return sum(file.count(a, f"part {name!r}: POSITION") for a in accessors if a is not None)


def _parts(file: File, nodes: Nodes, index: int, name: str, notes: list[str]) -> list[Part]:
    """A node's mesh: one part, or one for each of its instances."""
    node = nodes.all[index]
    rest = _Rest(file, nodes, index, name, notes)
    if not len(rest.faces):
        notes.append(f"part {name!r} has points and lines alone, and is left out")
        return []
    x = rest.morphed(nodes)
    if node.skin is not None:
        moved, at = rest.skinned(nodes, x, node.skin, notes)
        return [rest.part(name, finite(name, moved), bool((np.linalg.det(at[0, :, :3, :3]) < 0).all()))]
    world = nodes.world(index)
    out = []
    for k, own in enumerate(_instances(file, node, name)):
        at = world @ own
        said = name if not k else f"{name} {k + 1}"
        flipped = mirrors(said, at[:, :3, :3], nodes.t)
        moved = finite(said, x @ at[:, :3, :3].transpose(0, 2, 1) + at[:, None, :3, 3])
        out.append(rest.part(said, moved, flipped, shears(at[:, :3, :3])))
    return out


def _bind(file: File, skin: Any, what: str) -> np.ndarray:
    """(joints, 4, 4) inverse bind matrices of a skin, of columns."""
    if skin.inverseBindMatrices is None:
        return np.tile(np.eye(4), (len(skin.joints), 1, 1))
    bind = file.numbers(skin.inverseBindMatrices, what, 16).reshape(-1, 4, 4).transpose(0, 2, 1)
    if len(bind) < len(skin.joints):
        raise MeshError(f"{what}: has {len(skin.joints)} joints and {len(bind)} inverse bind matrices")
    return bind[: len(skin.joints)]


def _instances(file: File, node: Any, name: str) -> np.ndarray:
    """(k, 4, 4) places of a node's mesh in the node, of columns."""
    said = (node.extensions or {}).get(INSTANCES)
    if said is None:
        return np.eye(4)[None]
    given = said.get("attributes", {})
    columns = [file.numbers(given[key], f"part {name!r}: {key} of its instances", len(usual)) if key in given
               else np.array([usual], dtype=np.float64)
               for key, usual in (("TRANSLATION", (0, 0, 0)), ("ROTATION", (0, 0, 0, 1)), ("SCALE", (1, 1, 1)))]
    return Placing(*columns).matrix()


class _Rest:
    """A mesh before anything moves it: its primitives one after the other."""

    def __init__(self, file: File, nodes: Nodes, index: int, name: str, notes: list[str]) -> None:
        self.file, self.name, self.index = file, name, index
        self.primitives = [p for p in file.document.meshes[nodes.all[index].mesh].primitives
                           if p.mode is None or p.mode > POINTS]
        self.x = self._stacked("POSITION", 3)
        if self.x is None:
            raise MeshError(f"part {name!r}: has vertices without a position")
        finite(name, self.x)
        counts = [file.document.accessors[p.attributes.POSITION].count for p in self.primitives]
        start = np.cumsum([0, *counts])
        faces = [self._faces(p, n) for p, n in zip(self.primitives, counts)]
        self.faces = np.concatenate([np.zeros((0, 3), dtype=np.int64), *(f + k for f, k in zip(faces, start))])
        self.rows = np.cumsum([0, *map(len, faces)])

    def part(self, name: str, x: np.ndarray, flipped: bool, sheared: bool = False) -> Part:
        """The part at positions x (frames, n, 3); flipped: whether it is mirrored there."""
        uv = self._stacked("TEXCOORD_0", 2)
        faces = self.faces[:, [0, 2, 1]] if flipped else self.faces
        corner_uv = None if uv is None else (uv * [1, -1] + [0, 1])[faces]  # v points down in the file
        materials = self.file.document.materials or []
        groups: dict[str, list[np.ndarray]] = {}
        for k, p in enumerate(self.primitives):
            if p.material is not None and (said := item(materials, p.material, "material").name):
                groups.setdefault(said, []).append(np.arange(self.rows[k], self.rows[k + 1]))
        return Part(name, x, faces, corner_uv, {said: np.concatenate(rows) for said, rows in groups.items()},
                    flipped, sheared)

    def morphed(self, nodes: Nodes) -> np.ndarray:
        """(1 or frames, n, 3) positions with the morph targets' displacements."""
        assert self.x is not None
        counts = {len(p.targets or ()) for p in self.primitives}
        if len(counts) > 1:
            raise MeshError(f"part {self.name!r}: its primitives have {sorted(counts)} morph targets")
        count = counts.pop() if counts else 0
        if not count:
            return self.x[None]
        weights = nodes.weights(self.index, count)
        out = np.repeat(self.x[None], len(weights), axis=0)
        for k in np.flatnonzero(weights.any(axis=0)):
            out += weights[:, k, None, None] * self._target(int(k))
        return out

    def skinned(self, nodes: Nodes, x: np.ndarray, skin: int, notes: list[str]) -> tuple[np.ndarray, np.ndarray]:
        """(positions (frames, n, 3) as joints move them, transforms (1 or frames, joints, 4, 4) from rest)."""
        said = item(self.file.document.skins, skin, f"part {self.name!r}: skin")
        for joint in said.joints:
            item(nodes.all, joint, f"part {self.name!r}: joint")
        bind = _bind(self.file, said, f"part {self.name!r}: its skin")
        sets = range(1 + max((int(key[7:]) for p in self.primitives for key in vars(p.attributes)
                              if key.startswith("JOINTS_") and vars(p.attributes)[key] is not None), default=-1))
        columns = [(self._stacked(f"JOINTS_{k}", 4, False), self._stacked(f"WEIGHTS_{k}", 4)) for k in sets]
        if not columns or any(part is None for pair in columns for part in pair):
            raise MeshError(f"part {self.name!r}: has a skin, and vertices without joints or weights")
        joints, weights = (np.concatenate(part, axis=1) for part in zip(*columns))  # type: ignore[arg-type]
        joints, weights, note = weighed(self.name, joints, weights, len(said.joints))
        notes += [note] if note else []
        worlds = [nodes.world(joint) for joint in said.joints]
        frames = max(len(w) for w in worlds)
        at = np.stack([np.broadcast_to(w, (frames, 4, 4)) for w in worlds], axis=1)
        at = at @ bind
        return skinned(x, joints, weights, at), at

    def _stacked(self, key: str, width: int, floats: bool = True) -> np.ndarray | None:
        """(n, width) an attribute of all primitives; None if one has none."""
        out = []
        for p in self.primitives:
            index = getattr(p.attributes, key, None)
            if index is None:
                return None
            self._refuse_compressed(p)
            out.append(self.file.numbers(index, f"part {self.name!r}: {key}", width, floats))
            if len(out[-1]) != self.file.document.accessors[p.attributes.POSITION].count:
                raise MeshError(f"part {self.name!r}: {key} has {len(out[-1])} rows, and POSITION another number")
        return np.concatenate([np.zeros((0, width)), *out]) if floats else np.concatenate(out)

    def _target(self, k: int) -> np.ndarray:
        """(n, 3) displacements of a morph target."""
        out = []
        for p in self.primitives:
            target = p.targets[k]
            index = target.get("POSITION") if isinstance(target, dict) else getattr(target, "POSITION", None)
            count = self.file.document.accessors[p.attributes.POSITION].count
            rows = (np.zeros((count, 3)) if index is None else
                    self.file.numbers(index, f"part {self.name!r}: morph target {k}", 3))
            if len(rows) != count:
                raise MeshError(f"part {self.name!r}: morph target {k} has {len(rows)} rows for {count} vertices")
            out.append(rows)
        return np.concatenate(out)

    def _faces(self, p: Any, count: int) -> np.ndarray:
        """(m, 3) triangles of a primitive."""
        what = f"part {self.name!r}: its triangles"
        index = np.arange(count) if p.indices is None else self.file.numbers(p.indices, what, 1, False).ravel()
        if index.max(initial=-1) >= count:
            raise MeshError(f"{what} name vertex {index.max()}, and there are {count}")
        if p.mode == STRIP:
            out = np.stack([index[:-2], index[1:-1], index[2:]], axis=1) if len(index) > 2 else np.zeros((0, 3), dtype=int)
            out[1::2] = out[1::2, [1, 0, 2]]
            return out
        if p.mode == FAN:
            return np.stack([np.full(len(index) - 2, index[0]), index[1:-1], index[2:]], axis=1)
        if len(index) % 3:
            raise MeshError(f"{what} have {len(index)} corners: not whole ones")
        return index.reshape(-1, 3)

    def _refuse_compressed(self, p: Any) -> None:
        """Refuses data that is there in compressed form alone."""
        for name in p.extensions or ():
            said = self.file.document.accessors[p.attributes.POSITION]
            if name in COMPRESSED and said.bufferView is None and said.sparse is None:
                raise MeshError(f"part {self.name!r}: is compressed with {COMPRESSED[name]} ({name}), which is not read: "
                                "export it without compression")
