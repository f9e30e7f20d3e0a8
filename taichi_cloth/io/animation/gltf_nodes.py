"""The nodes of a glTF scene: their transforms at any time, and the animation that moves them."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ...errors import MeshError
from . import keys
from .gltf_file import File, item
from .motion import FPS
from .rest import Placing, kept_heading, taken_apart

PATHS = {"translation": 3, "rotation": 4, "scale": 3}
Channels = dict[tuple[int, str], keys.Keys]  # by node and path


class Clip(NamedTuple):
    """An animation.

    Attributes:
        channels: keyframes by node and path; of weights of morph targets (k, targets).
        span: times [s] of its first key and its last.
        fps: frames a second that take its keys, where these are evenly spaced.
        notes: sentences on channels that were left out.
        numbers: of the document's animations in it.
    """

    channels: Channels
    span: tuple[float, float]
    fps: float
    notes: tuple[str, ...]
    numbers: tuple[int, ...]


class Nodes:
    """The nodes of a document.

    Attributes:
        shown: nodes of the scene that is shown, each after its parent.
        notes: sentences on other scenes.
    """

    def __init__(self, file: File) -> None:
        self.file, self.all = file, file.document.nodes or []
        self.parent = _parents(self.all)
        self.shown, self.notes = self._scene()
        self._worlds: dict[int, np.ndarray] = {}
        self.channels: Channels = {}
        self.t, self.way = np.zeros(1), np.ones(1)
        self.rest: dict[int, Placing] = {}
        self._topmost: list[int] = []
        self._turned: dict[int, np.ndarray] = {}  # (frames, 4, 4) of topmost joints, on the way from rest

    def pose(self, channels: Channels, t: np.ndarray, way: np.ndarray) -> None:
        """Places the nodes at times t (frames,) [s]; joints are the parts `way` (frames,) of the way there from rest."""
        self.channels, self.t, self.way, self._worlds, self._turned = channels, t, way, {}, {}
        if self.rest:
            first, next_ = int(np.argmax(way == 1)) + 1, [j for j in self.rest if self.parent[j] in self._topmost]
            x = np.stack([np.broadcast_to(self.world(j), (len(way), 4, 4))[:first] for j in next_ or self.rest], axis=1)
            at = np.concatenate([kept_heading(x, 1), np.tile(np.eye(4), (len(way) - first, 1, 1))])
            self._worlds, self._turned = {}, dict.fromkeys(self._topmost, at)

    def rest_of(self, binds: list[tuple[list[int], np.ndarray]]) -> None:
        """The rest pose of joints below others, by skins: joints and their inverse bind matrices (joints, 4, 4)."""
        for joints, bind in binds:
            row = {joint: k for k, joint in enumerate(joints)}
            for joint, k in row.items():
                above, between = self.parent[joint], np.eye(4)
                while above >= 0 and above not in row:
                    above, between = self.parent[above], self._local(above)[0] @ between
                if above >= 0 and joint not in self.rest:
                    at = np.linalg.inv(between) @ bind[row[above]] @ np.linalg.inv(bind[k])
                    self.rest[joint] = taken_apart(at[None])
        every = {joint for joints, _ in binds for joint in joints}
        self._topmost = [joint for joint in every if not every & self._above(joint)]

    def _above(self, index: int) -> set[int]:
        """All nodes above a node."""
        out: set[int] = set()
        while (index := self.parent[index]) >= 0:
            out.add(index)
        return out

    def name(self, index: int) -> str:
        """A node's name, or its mesh's, or its number."""
        node = self.all[index]
        mesh = self.file.document.meshes[node.mesh].name if node.mesh is not None else None
        return node.name or mesh or f"node {index}"

    def world(self, index: int) -> np.ndarray:
        """(1 or frames, 4, 4) from a node to the world, of columns."""
        chain = []
        while index >= 0 and index not in self._worlds:
            chain.append(index)
            index = self.parent[index]
        at = self._worlds[index] if index >= 0 else np.eye(4)[None]
        for k in reversed(chain):
            at = at @ self._local(k)
            at = self._worlds[k] = self._turned[k] @ at if k in self._turned else at
        return at

    def weights(self, index: int, count: int) -> np.ndarray:
        """(1 or frames, count) weights of a node's morph targets."""
        moved = self.channels.get((index, "weights"))
        if moved is not None:
            out = moved.at(self.t)
        else:
            node = self.all[index]
            said = getattr(node, "weights", None) or self.file.document.meshes[node.mesh].weights or [0.0] * count
            out = np.array([said], dtype=np.float64)
        if out.shape[1] != count:
            raise MeshError(f"part {self.name(index)!r}: has {count} morph targets and {out.shape[1]} weights")
        return out

    def _local(self, index: int) -> np.ndarray:
        """(1 or frames, 4, 4) from a node to its parent."""
        node, moved = self.all[index], [self.channels.get((index, path)) for path in PATHS]
        there = None
        if node.matrix and not any(moved):
            at = _array(node.matrix, 16, self.name(index)).reshape(1, 4, 4).transpose(0, 2, 1)
            if index not in self.rest:
                return at
            there = taken_apart(at)
        usual = (node.translation or (0, 0, 0), node.rotation or (0, 0, 0, 1), node.scale or (1, 1, 1))
        there = there or Placing(*(said.at(self.t) if said is not None else _array(rest, width, self.name(index))[None]
                                   for said, rest, width in zip(moved, usual, PATHS.values())))
        return (self.rest[index].on_the_way(there, self.way) if index in self.rest else there).matrix()

    def _scene(self) -> tuple[list[int], tuple[str, ...]]:
        """The scene that the document shows by default, or its first; all nodes if there is none."""
        scenes = self.file.document.scenes or []
        notes: tuple[str, ...] = ()
        if not scenes:
            roots = [k for k, parent in enumerate(self.parent) if parent < 0]
        else:
            shown = self.file.document.scene or 0
            roots = item(scenes, shown, "scene").nodes or []
            if len(scenes) > 1:
                others = ", ".join(repr(s.name or f"scene {k}") for k, s in enumerate(scenes) if k != shown)
                notes = (f"scene {scenes[shown].name or shown!r} is read, which the file shows first; others: {others}",)
        out, left = [], list(reversed(roots))
        while left:
            k = left.pop()
            out.append(k)
            left += reversed(item(self.all, k, "node").children or [])
        return list(dict.fromkeys(out)), notes


def clip(file: File, index: int, nodes: Nodes) -> Clip:
    """An animation of the document.

    Raises:
        MeshError: it is damaged.
    """
    said = file.document.animations[index]
    channels: Channels = {}
    skipped: list[str] = []
    for channel in said.channels:
        target = channel.target
        if target.node is None or target.path not in (*PATHS, "weights"):
            skipped.append(str(target.path))
            continue
        item(nodes.all, target.node, "the animation's node")
        what = f"{target.path} of {nodes.name(target.node)!r}"
        sampler = item(said.samplers, channel.sampler, f"the animation of {what}: sampler")
        channels[target.node, target.path] = _keys(file, sampler, target.path, what)
    if not channels:
        return Clip({}, (0.0, 0.0), FPS, (), (index,))
    first, last = min(c.t[0] for c in channels.values()), max(c.t[-1] for c in channels.values())
    rates = [round(float(1 / np.median(np.diff(c.t))), 2) for c in channels.values() if len(c.t) > 1]  # times are in f32
    rate = max(rates, default=FPS)
    notes = (f"animations of {', '.join(sorted(set(skipped)))} are left out",) if skipped else ()
    return Clip(channels, (float(first), float(last)), rate * max(1, int(np.ceil(FPS / rate))), notes, (index,))


def together(clips: list[Clip], numbers: tuple[int, ...] | None) -> Clip:
    """Animations that play at once: of two that move the same the first counts.

    Args:
        numbers: of those that are meant; if None the first, and others that move nothing that is moved already.
    """
    out = Clip({}, (0.0, 0.0), FPS, (), ())
    for k in range(len(clips)) if numbers is None else dict.fromkeys(numbers):
        new = clips[k]
        if numbers is None and out.channels.keys() & new.channels.keys():
            continue
        first, last = (new.span if not out.channels else (min(out.span[0], new.span[0]), max(out.span[1], new.span[1])))
        fps = new.fps if not out.channels else max(out.fps, new.fps)
        out = Clip(new.channels | out.channels, (first, last), fps, out.notes + new.notes, (*out.numbers, k))
    return out


def _keys(file: File, sampler: Any, path: str, what: str) -> keys.Keys:
    t = file.numbers(sampler.input, f"times of {what}", 1).ravel()
    kind = sampler.interpolation or "LINEAR"
    values = file.numbers(sampler.output, f"the animation of {what}", PATHS.get(path, 1))
    if path == "weights":
        rows = len(t) * (3 if kind == "CUBICSPLINE" else 1)
        if not rows or values.size % rows:
            raise MeshError(f"the animation of {what}: {len(t)} keys have {values.size} values")
        values = values.reshape(rows, -1)
    return keys.keys(what, t, values, kind, path == "rotation")


def _parents(nodes: list) -> list[int]:
    """Each node's parent, -1 for none.

    Raises:
        MeshError: a node with two parents, or that is above itself.
    """
    parent = [-1] * len(nodes)
    for k, node in enumerate(nodes):
        for child in node.children or ():
            item(nodes, child, f"node {k}: child")
            if parent[child] >= 0:
                raise MeshError(f"node {nodes[child].name or child!r} has two parents")
            parent[child] = k
    for k in range(len(nodes)):
        at = k
        for _ in nodes:
            at = parent[at] if at >= 0 else at
        if at >= 0:
            raise MeshError(f"node {nodes[k].name or k!r} is among its own parents")
    return parent


def _array(values: Any, count: int, name: str) -> np.ndarray:
    out = np.array(values, dtype=np.float64)
    if out.shape != (count,) or not np.isfinite(out).all():
        raise MeshError(f"node {name!r}: {values!r:.60} are not {count} finite numbers")
    return out
