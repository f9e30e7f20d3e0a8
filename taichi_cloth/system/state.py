"""Particles and blocks as Taichi fields, in the order of `ordering`; users see their own order."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..backend.fields import Fields
from ..backend.language import ti
from ..backend.ordering import block_bounds, by_slabs, cuthill_mckee, distinct_numbers
from ..backend.rows import by_kernels, read, write
from ..backend.runtime import TASK, Runtime
from ..errors import MeshError, SceneError
from ..scene.scene import Scene
from .elements import lumped_mass

FAR = 8.0  # further from the origin than this many times its size, a scene gets a local origin
ROWS = 300  # vertices of a block from which on a CPU thread of its own pays
GPU_BLOCK = 2, 16  # vertices a block on a GPU, one thread each: least and most
GPU_BLOCKS = 4096  # of them that are wanted
FEW = 32  # blocks that are gone through one by one


@dataclass(frozen=True)
class Entries:
    """Elements as the blocks store them: `element[first[b]:first[b + 1]]` are those that touch block b, from `shared[b]` on
    those that touch another too.

    Attributes:
        element: (entries,) index of the element.
        first: (blocks + 1,).
        shared: (blocks,).
        primary: (entries,) whether the block is the one that counts the element in sums.
    """

    element: np.ndarray
    first: np.ndarray
    shared: np.ndarray
    primary: np.ndarray


def touching(vertices: np.ndarray, bounds: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(elements with vertices (m, k) that touch each of the blocks with the given bounds, one block's after the other's;
    (blocks + 1,) where each block's begin)."""
    if len(bounds) - 1 <= FEW:
        parts = [np.flatnonzero(((vertices >= low) & (vertices < high)).any(axis=1)) for low, high in zip(bounds, bounds[1:])]
        return np.concatenate(parts), np.cumsum([0, *(len(p) for p in parts)])
    m = len(vertices)
    owner = np.searchsorted(bounds, vertices, side="right") - 1
    code = distinct_numbers((owner * m + np.arange(m)[:, None]).ravel())
    return code % m, np.searchsorted(code // m, np.arange(len(bounds)))


def partition(vertices: np.ndarray, bounds: np.ndarray) -> Entries:
    """Entries of elements with vertices (m, k), already renumbered, for blocks with the given bounds.

    A block's are in the order of their vertices, those that it shares last.
    """
    blocks = len(bounds) - 1
    owner = np.searchsorted(bounds, vertices, side="right") - 1
    element, first = touching(vertices, bounds)
    block, common = np.repeat(np.arange(blocks), np.diff(first)), owner.min(axis=1) != owner.max(axis=1)
    element = element[np.lexsort((vertices[element].max(axis=1), vertices[element].min(axis=1), common[element], block))]
    shared = first[1:] - np.bincount(block, common[element], blocks).astype(np.int64)
    return Entries(element, first, shared, owner[element].min(axis=1) == block)


@ti.data_oriented
class Blocks:
    """Contiguous runs of vertices, each worked on by one thread; no two write to the same row.

    Taichi cuts a CPU loop into tasks of 512 iterations: a block is started by one iteration in `grain`.
    """

    def __init__(self, fields: Fields, n: int, runtime: Runtime) -> None:
        cpu = not runtime.device
        rows = ROWS if cpu else int(np.clip(n // GPU_BLOCKS, *GPU_BLOCK))
        count = max(1, n // rows)
        self.bounds = block_bounds(n, min(runtime.threads, count) if cpu else count)
        self.count = len(self.bounds) - 1
        self.largest = int(np.diff(self.bounds).max())  # rows of a block
        self.grain = TASK if cpu else 1
        self.serial = cpu  # loops of little work a row: to wake another thread would take longer
        self.pieces = 1 if cpu else self.count  # of such a loop over the rows that adds something up
        self.row = fields.integer(self.count + 1, data=self.bounds)

    @ti.func
    def first(self, piece):
        """The first row of a piece."""
        return self.row[piece * ti.static(self.count // self.pieces)]

    @ti.func
    def add(self, q: ti.template(), i, value, lo, hi):
        """q_i += value where the block [lo, hi) owns row i."""
        if lo <= i and i < hi:
            q[i] = q[i] + value


@ti.data_oriented
class Elements:
    """Elements of one kind as entries of blocks; fields are per entry."""

    def __init__(self, fields: Fields, blocks: Blocks, vertices: np.ndarray) -> None:
        self.entries: Entries = partition(vertices, blocks.bounds)
        self.host_vertices = vertices[self.entries.element].astype(np.int32)
        self.count = len(self.entries.element)
        self.first = fields.integer(blocks.count + 1, data=self.entries.first)
        self.shared = fields.integer(blocks.count, data=self.entries.shared)
        self.vertices = fields.integer(self.count, vertices.shape[1], self.host_vertices)
        self.primary = fields.integer(self.count, data=self.entries.primary)

    def per_entry(self, data: np.ndarray) -> np.ndarray:
        """Rows of per-element data (elements, ...) for each entry: (entries, ...)."""
        return np.asarray(data)[self.entries.element]


@ti.data_oriented
class Remembered:
    """A field that steps change, and its value when the model was saved.

    Attributes:
        now, saved: fields of n rows.
    """

    def __init__(self, fields: Fields, n: int, width: int, data: np.ndarray | None) -> None:
        self.size = fields.integer(1, data=np.array([n]))
        self.now, self.saved = fields.real(n, width, data), fields.real(n, width)

    @ti.kernel
    def save(self):
        """saved = now"""
        for i in range(self.size[0]):
            self.saved[i] = self.now[i]

    @ti.kernel
    def restore(self):
        """now = saved"""
        for i in range(self.size[0]):
            self.now[i] = self.saved[i]


@ti.data_oriented
class ParticleState:
    """Particles: positions, velocities, masses, and the state that a rejected step goes back to.

    Everything else that a step changes and that belongs to the cloth is declared with `remember`, and is saved, rolled back,
    checkpointed and resumed with them.

    Attributes:
        n: number of simulated particles.
        user: (n,) the user's vertex of each particle.
        sewn: clusters of particles that are sewn together, or None.
        v_base: velocity [m/s] that a step or stage starts from, the saved one unless a method sets another.
        x_offset: predictor offset [m]: the position that it starts from, less the saved one.
        over: span [s] of a step over which damping is an energy of it; 0 where damping goes by velocities.
        origin: (3,) [m] taken off all positions, not zero only far from the world's origin.
    """

    def __init__(self, fields: Fields, scene: Scene, runtime: Runtime) -> None:
        faces = np.concatenate([c.mesh.faces + c.start for c in scene.cloths])
        used = np.flatnonzero(np.bincount(faces.ravel()))
        local = np.full(scene.vertex_count, -1)
        local[used] = np.arange(len(used))
        order = cuthill_mckee(len(used), local[faces])
        if any(c.split is not None for c in scene.cloths):
            order = _corners_together(scene, used)
        if not runtime.device and len(scene.cloths) > 1 and any(c.contact is not None for c in scene.cloths):
            order = by_slabs(order, np.concatenate([c.positions for c in scene.cloths])[used])
        self.user = used[order]
        self.n = len(order)
        self.particle = np.full(scene.vertex_count, -1)
        self.particle[self.user] = np.arange(self.n)
        self.exchange = runtime.exchange
        self.start_positions = np.concatenate([c.positions for c in scene.cloths])
        self.start_velocities = np.concatenate([c.velocities for c in scene.cloths])
        self.origin = _local_origin(self.start_positions)
        self.mass = _masses(scene)[self.user]
        self.blocks = Blocks(fields, self.n, runtime)
        self.sewn: Any = None
        if scene.seams:
            from .seams import Clusters

            self.sewn = Clusters(fields, self, scene)
        self._fields = fields
        self.remembered: dict[str, Remembered] = {}
        self.x = fields.real(self.n, 3, self.start_positions[self.user] - self.origin)
        self.v = fields.real(self.n, 3, self.start_velocities[self.user])
        self.m = fields.real(self.n, data=self.mass)
        self.x_saved, self.v_saved, self.v_base, self.x_offset = (fields.real(self.n, 3) for _ in range(4))
        self.over = fields.real(1, data=np.zeros(1))
        self._known: tuple[np.ndarray, np.ndarray] | None = None  # x and v that the host of a device has, where nothing moved
        self._known_saved: tuple[np.ndarray, np.ndarray] | None = None  # since; the same of the saved state

    def remember(self, name: str, n: int, width: int = 1, data: np.ndarray | None = None) -> Remembered:
        """Declares a field of n numbers, or of n vectors of `width` numbers, that steps change; before fields are allocated.

        Args:
            data: (n,) or (n, width) to begin with; zeros if None.

        Raises:
            ValueError: there is one of this name.
        """
        if name in self.remembered:
            raise ValueError(f"{name!r} is declared already")
        self.remembered[name] = Remembered(self._fields, n, width, data)
        return self.remembered[name]

    @ti.func
    def rows(self):
        """n, as kernels read it."""
        return self.blocks.row[self.blocks.count]

    def save(self) -> None:
        """Remembers the state, for `restore`."""
        self._save()
        self._known_saved = self._known
        for part in self.remembered.values():
            part.save()

    def restore(self) -> None:
        """Goes back to the remembered state, bit for bit."""
        self._restore()
        self._known = self._known_saved
        for part in self.remembered.values():
            part.restore()

    def moved(self) -> None:
        """Whoever launches a kernel that sets x or v says so."""
        self._known = None

    @property
    def STATE(self) -> tuple[str, ...]:
        """Names of the arrays that `checkpoint` gives."""
        return "x", "v", *(f"state_{name}" for name in self.remembered)

    def checkpoint(self) -> dict[str, np.ndarray]:
        """All of the state, as arrays by name."""
        x, v = self.read_particles()
        return {"x": x, "v": v, **{f"state_{name}": read(part.now) for name, part in self.remembered.items()}}

    def resume(self, state: dict[str, np.ndarray]) -> None:
        """Goes on from the arrays of `checkpoint`.

        Raises:
            SceneError: it is of another mesh, or not finite.
        """
        parts = {name: state[f"state_{name}"] for name in self.remembered}
        if state["x"].shape != (self.n, 3):
            raise SceneError(f"the checkpoint has {len(state['x'])} particles and the scene {self.n}")
        for name, value in {"x": state["x"], "v": state["v"], **parts}.items():
            if not np.isfinite(value).all():
                raise SceneError(f"the checkpoint's {name} is not finite")
        self.write_particles(state["x"], state["v"])
        for name, value in parts.items():
            if value.shape != read(self.remembered[name].now).shape:
                raise SceneError(f"the checkpoint's {name} has the shape {value.shape}: it is of another mesh")
            write(self.remembered[name].now, value)

    def read(self) -> tuple[np.ndarray, np.ndarray]:
        """(positions [m], velocities [m/s]), each (user's n, 3) float64; vertices without a face stay put."""
        x, v = self.read_particles()
        positions, velocities = self.start_positions.copy(), np.zeros_like(self.start_velocities)
        positions[self.user], velocities[self.user] = x + self.origin, v
        return positions, velocities

    def read_particles(self) -> tuple[np.ndarray, np.ndarray]:
        """(x [m] from the local origin, v [m/s]), each (n, 3) float64 in particle order."""
        if not by_kernels():
            return _reals(self.x), _reals(self.v)
        if self._known is None:
            both: np.ndarray = np.empty((2, self.n, 3), dtype=self.exchange)
            self._hand_over(both)
            self._known = both[0].astype(np.float64), both[1].astype(np.float64)
        return self._known[0].copy(), self._known[1].copy()

    @ti.kernel
    def _hand_over(self, both: ti.types.ndarray()):
        """x and v at once."""
        for i in range(self.rows()):
            for c in ti.static(range(3)):
                both[0, i, c], both[1, i, c] = self.x[i][c], self.v[i][c]

    def read_saved(self) -> tuple[np.ndarray, np.ndarray]:
        """(x, v) of the saved state, as `read_particles` gives the current one."""
        if not by_kernels():
            return _reals(self.x_saved), _reals(self.v_saved)
        if self._known_saved is None:
            self._known_saved = _reals(self.x_saved), _reals(self.v_saved)
        return self._known_saved[0].copy(), self._known_saved[1].copy()

    def write(self, positions: np.ndarray, velocities: np.ndarray) -> None:
        """Sets positions [m] and velocities [m/s] from (n, 3) arrays in the user's order."""
        self.write_particles(positions[self.user] - self.origin, velocities[self.user])

    def write_particles(self, x: np.ndarray, v: np.ndarray) -> None:
        """Sets x [m] and v [m/s] from (n, 3) arrays as `read_particles` gives them, bit for bit."""
        x, v = x.astype(self.exchange), v.astype(self.exchange)
        write(self.x, x)
        write(self.v, v)
        if by_kernels():
            self._known = x.astype(np.float64), v.astype(np.float64)

    def to_user(self, values: np.ndarray) -> np.ndarray:
        """(user's n, 3) float64 from (n, 3) in particle order; zero for vertices without a face."""
        out = np.zeros((len(self.particle), 3))
        out[self.user] = values[: self.n]
        return out

    def to_particles(self, values: np.ndarray) -> np.ndarray:
        """(n, ...) per-vertex data in particle order, in the type that kernels take."""
        return np.ascontiguousarray(np.asarray(values)[self.user].astype(self.exchange))

    @ti.kernel
    def _save(self):
        ti.loop_config(serialize=self.blocks.serial)
        for i in range(self.rows()):
            self.x_saved[i] = self.x[i]
            self.v_saved[i] = self.v[i]
            self.v_base[i] = self.v[i]
            self.x_offset[i] = ti.Vector.zero(float, 3)

    @ti.kernel
    def _restore(self):
        ti.loop_config(serialize=self.blocks.serial)
        for i in range(self.rows()):
            self.x[i] = self.x_saved[i]
            self.v[i] = self.v_saved[i]
            self.v_base[i] = self.v_saved[i]
            self.x_offset[i] = ti.Vector.zero(float, 3)


def _reals(field) -> np.ndarray:
    return read(field).astype(np.float64, copy=False)


def _masses(scene: Scene) -> np.ndarray:
    """(user's n,) [kg]"""
    mass = np.concatenate([lumped_mass(c.mesh, c.density) for c in scene.cloths])
    for cloth, vertices, extra in scene.masses:
        mass[vertices + cloth.start] += extra
    used = sum(int(np.count_nonzero(np.bincount(c.mesh.faces.ravel()))) for c in scene.cloths)
    if not (np.isfinite(mass).all() and (mass > 1e-30).sum() == used):
        raise MeshError("a vertex has no mass: the mesh is too small for its density (wrong scale?)")
    return mass


def _corners_together(scene: Scene, used: np.ndarray) -> np.ndarray:
    """Order of `cuthill_mckee` for the meshes as handed in, with the corners at a vertex one after another."""
    of = np.concatenate([c.start + (np.arange(c.mesh.vertex_count) if c.split is None else c.split.of) for c in scene.cloths])
    faces = np.concatenate([c.whole.faces + c.start for c in scene.cloths])
    whole = np.unique(faces)
    rank = np.zeros(len(of), dtype=np.int64)
    rank[whole[cuthill_mckee(len(whole), np.searchsorted(whole, faces))]] = np.arange(len(whole))
    return np.argsort(rank[of[used]], kind="stable")


def _local_origin(x: np.ndarray) -> np.ndarray:
    low, high = x.min(axis=0), x.max(axis=0)
    centre, size = (low + high) / 2, float(np.linalg.norm(high - low))
    return np.round(centre) if np.linalg.norm(centre) > FAR * max(size, 1.0) else np.zeros(3)
