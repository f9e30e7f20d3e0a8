"""Detection of contacts on the way through a step: the detectors that a scene needs, and where its solids are."""

from dataclasses import dataclass, replace

import numpy as np

from ...backend.device_arrays import Mirror
from ...backend.device_lists import lists
from ...backend.fields import Fields
from ...scene.scene import Scene
from ...scene.solids import MESH, Solid, SolidMesh
from ...system.held import kernel_array
from ...system.state import ParticleState
from ..growth import ThicknessRamp
from ..points import tangential
from .pairs import PAIR, Pairs
from .tree import TriangleTree, smooth
from .vertices import SLOTS, WIDTH, VertexContacts, VertexDetector

SOLIDS = 65536  # more than a scene can have


@dataclass(frozen=True)
class ContactCandidates:
    """Contacts and pairs of cloth on its way from the saved state to where the model was.

    Attributes:
        end_positions: (n, 3) positions where it was [m].
        vertices: contacts of particles; slip: (k, 3) their velocity against the solid [m/s].
        pairs: with edges and corners of solids; None where none has any.
        end_velocities: (n, 3) [m/s] with which it was there.
    """

    end_positions: np.ndarray
    vertices: VertexContacts
    slip: np.ndarray
    pairs: Pairs | None
    end_velocities: np.ndarray

    @property
    def any_pairs(self) -> bool:
        """Whether there are pairs."""
        return self.pairs is not None and len(self.pairs.key) > 0

    def without(self, pinched: np.ndarray, around: np.ndarray) -> "ContactCandidates":
        """But contacts of pinched particles (n,), and pairs of any that are around these (n,), themselves among them."""
        if not around.any():
            return self
        keep, pairs = ~pinched[self.vertices.index], self.pairs
        if pairs is not None:
            pairs = pairs.take(~around[pairs.own_vertices].any(axis=1))
        return ContactCandidates(self.end_positions, self.vertices.take(keep), self.slip[keep], pairs, self.end_velocities)

    def raised(self, by: np.ndarray) -> "ContactCandidates":
        """Particles (n,) are to be so much [m] further from solids."""
        return replace(self, vertices=self.vertices.nearer(by[self.vertices.index]))


@dataclass(frozen=True)
class StartsInside:
    """Particles (k,) that start inside solids, how far [m] they have to go (k,), these solids' numbers (k,), and the way
    out (k, 3)."""

    particles: np.ndarray
    depth: np.ndarray
    solid: np.ndarray
    normal: np.ndarray


class SolidCollisionDetector:
    """Looks for contacts of a model's particles, edges and faces with a scene's solids.

    Attributes:
        time: [s] to which the solids were last moved.
        edge: mean edge length of the cloth at the start [m].
        thickness_ramp: of the thickness that pairs go by, where they start nearer.
        inside: which particles started inside solids; crossed: (k, 3) those of triangles that crossed solids' then.
        faces: (m, 3) particles of the cloth's faces.
        pokes: (solids,) whether a solid could come through a triangle of cloth; yields: whether it deforms; moves: whether
            it moves; meshes: is a mesh; closed: is one with an inside.
    """

    def __init__(self, fields: Fields, model: ParticleState, scene: Scene) -> None:
        self.model, self.solids, self.exchange, self.time = model, scene.solids, model.exchange, 0.0
        self.thickness = np.array([s.thickness for s in self.solids])
        self.friction = np.array([s.friction for s in self.solids])
        self.thickness_ramp = ThicknessRamp(model.n)
        none = np.zeros(0, dtype=np.int64)
        self.inside = StartsInside(none, np.zeros(0), none, np.zeros((0, 3)))
        self.crossed = np.zeros((0, 3), dtype=np.int64)
        edges = np.concatenate([np.linalg.norm(np.diff(c.positions[c.mesh.faces], axis=1), axis=2).ravel()
                                for c in scene.cloths])
        self.edge, longest = float(edges.mean()), float(edges.max())
        self.meshes = np.array([s.shape.kind == MESH for s in self.solids], dtype=bool)
        meshes = self.meshes.tolist()
        poking = [k for k, s in enumerate(self.solids) if meshes[k] or _pokes(s, longest)]
        self.pokes = np.isin(np.arange(len(self.solids)), poking)
        self.rounded = any(self.solids[k].shape.core()[2] > 0 for k in poking)
        self.moves = np.array([s.moves for s in self.solids], dtype=bool)
        self.yields = np.array([s.deforms for s in self.solids], dtype=bool)
        self.closed = np.array([isinstance(s.shape, SolidMesh) and s.shape.closed for s in self.solids], dtype=bool)
        self.faces = np.concatenate([model.particle[c.mesh.faces + c.start] for c in scene.cloths]).astype(np.int32)
        self.vertices = None if all(meshes) else VertexDetector(fields, model, scene)
        self.tree = self.surfaces = self.pairs = self.crossings = None
        if poking:
            from .mesh import SurfaceDetector
            from .pair_detector import CrossingCounter, PairDetector

            self.tree = TriangleTree(fields, scene, poking, model.origin, longest)
            self.surfaces = SurfaceDetector(fields, model, scene, self.tree) if any(meshes) else None
            self.pairs = PairDetector(fields, model, scene, self.tree)
            self.crossings = CrossingCounter(model, self.pairs.near, self.tree)
        poses: np.ndarray = np.array([2 * self._pose(solid, 0.0) for solid in self.solids], dtype=self.exchange)
        self.poses, self._mirror = poses.reshape(-1, 24), Mirror()  # at the two ends of a step
        self.size, self.depth, self.sought = 0.0, np.zeros(model.n), np.zeros(model.n, dtype=bool)
        self._slots = lists(model.n, SLOTS, [(WIDTH, self.exchange)])  # of each particle

    @property
    def fastest(self) -> float:
        """How far any vertex of a mesh goes in the step [m]."""
        return self.tree.fastest if self.tree is not None else 0.0

    def inspect(self) -> list[str]:
        """Notes on faults of the scene from the start; remembers which particles are inside, before anything moves."""
        notes = [f"{s.name}: {note}" for s in self.solids if isinstance(s.shape, SolidMesh) for note in s.shape.notes]
        notes += [f"{s.name}: its thickness {s.thickness:g} m is more than the cloth's mean edge {self.edge:.3g} m: contacts "
                  "will look swollen" for s in self.solids if s.thickness > self.edge]
        self.model.save()
        self.set_time(0.0, 0.0)
        if self.tree is not None:
            self.tree.set_time(0.0, 0.0)
        if self.surfaces is not None:
            x = np.concatenate([s.surface_at(0.0) for s in self.solids if isinstance(s.shape, SolidMesh)])
            self.size = float(np.linalg.norm(np.ptp(x, axis=0)))
            self.surfaces.set_depth(np.full(self.model.n, self.size, dtype=self.exchange))
        found = self.detect()
        inside = found.start_gap + self.thickness[found.solid] < 0
        self.inside = StartsInside(found.index[inside], -found.start_gap[inside], found.solid[inside], found.normal[inside])
        if self.surfaces is not None:
            self.depth = np.zeros(self.model.n, dtype=self.exchange)
            np.maximum.at(self.depth, found.index[inside], -found.start_gap[inside] * 1.5)
            self.surfaces.set_depth(self.depth)
        if self.tree is not None:
            self.crossed = self.find_crossings()
            self.tree.due = True
        self.time = 0.0
        return notes

    def seek(self, particles: np.ndarray) -> None:
        """Particles (n,) are looked for inside mesh solids, however deep, in the step to come."""
        if self.surfaces is None:
            return
        if particles.any():
            self.surfaces.buried.look()
        if (particles != self.sought).any():
            self.sought = particles.copy()
            self.surfaces.set_depth(np.where(particles, self.size, self.depth).astype(self.exchange, copy=False))

    def begin(self) -> None:
        """Cloth starts where the model is: pairs that are nearer than they should be have a part of their thickness."""
        self.thickness_ramp.part[:] = 1.0
        if self.pairs is not None:
            self.model.save()
            self.set_time(self.time, 0.0)
            pairs = self.pairs.find(self._mirror.of(self.poses))
            self.thickness_ramp.begin(pairs.vertices, self.part_of(pairs))

    def set_time(self, t: float, h: float) -> None:
        """Poses of the solids at the two ends of the step from t to t + h [s]."""
        self.time = t + h
        for row, solid, moves in zip(self.poses, self.solids, self.moves):
            if moves:
                row[:] = self._pose(solid, t) + self._pose(solid, t + h)
        if self.tree is not None and self.tree.due:
            self.tree.set_time(t, h)

    def _pose(self, solid: Solid, t: float) -> list[float]:
        """R, row by row, and p [m], from the local origin, at t [s]."""
        R, p = solid.pose(t)
        return [*R.ravel(), *(p - self.model.origin)]

    def look(self, h: float) -> ContactCandidates:
        """Contacts and pairs of cloth on its way from the saved state to where the model now is, in a step of h [s]."""
        f, (there, v) = self.detect(), self.model.read_particles()
        return ContactCandidates(there, f, tangential((there[f.index] - f.carried) / h, f.normal), self.find_pairs(), v)

    def detect(self) -> VertexContacts:
        """Contacts of the particles on their way from the saved to the current positions."""
        poses = self._mirror.of(self.poses)
        if self.vertices is not None:
            self.vertices.detect(poses, self._slots.count, *self._slots.arrays)
        if self.surfaces is not None:
            self.surfaces.detect(poses, self._slots.count, *self._slots.arrays, int(self.vertices is None))
        index, rows = self._slots.owned()
        rows = rows.astype(np.float64, copy=False)
        solid, triangle = rows[:, 8].astype(np.int64), rows[:, 9].astype(np.int64)
        mu = self.friction[solid]
        if self.tree is not None:
            mu = np.where(triangle >= 0, self.tree.friction[triangle], mu)
        key = index * SOLIDS + solid
        found = VertexContacts(index, solid, rows[:, :3], rows[:, 3], rows[:, 4], rows[:, 5:8], mu, key)
        return found if (np.diff(key) > 0).all() else found.take(np.argsort(key))

    def above(self, x: np.ndarray, solid: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Points x (k, 3) at the start of the step [m] above solids (k,) that are no meshes: (heights (k,) [m], normals
        (k, 3), motions (k, 3) of the solids there in the step [m])."""
        out: np.ndarray = np.zeros((len(x), 4), dtype=self.exchange)
        if len(x) and self.vertices is not None:
            analytic = np.cumsum([s.shape.kind != MESH for s in self.solids]) - 1
            self.vertices.heights(self.poses, kernel_array(x, self.exchange), kernel_array(analytic[solid], np.int32), out)
        poses = self.poses.astype(np.float64)[solid]
        (R_0, p_0), (R_1, p_1) = ((poses[:, k: k + 9].reshape(-1, 3, 3), poses[:, k + 9: k + 12]) for k in (0, 12))
        there = np.einsum("kij,kj->ki", R_1, np.einsum("kji,kj->ki", R_0, x - p_0)) + p_1
        return out[:, 0].astype(np.float64), out[:, 1:].astype(np.float64), there - x

    def find_crossings(self, grown: bool = False) -> np.ndarray:
        """(k, 3) particles of the cloth's in pairs of triangles of cloth and solids that cross; none where nothing pokes.
        `grown` as in `CrossingCounter.find`."""
        return self.crossings.find(grown) if self.crossings is not None else np.zeros((0, 3), dtype=np.int64)

    def friction_of(self, pairs: Pairs) -> np.ndarray:
        """(k,) Coulomb's coefficient at pairs."""
        triangle = (pairs.key & 0xFFFFFFFF) // 8
        return self.friction[pairs.solid] if self.tree is None else self.tree.friction[triangle]

    def kept_by(self, pairs: Pairs) -> np.ndarray:
        """(k,) thickness [m] that pairs go by."""
        thickness = self.thickness[pairs.solid]
        return self.thickness_ramp.of(pairs.vertices) * thickness if self.thickness_ramp.active else thickness

    def part_of(self, pairs: Pairs) -> np.ndarray:
        """(k,) how far pairs are from each other over the distance they should keep in the end."""
        return pairs.distance / (PAIR * self.thickness[pairs.solid])

    def find_pairs(self) -> Pairs | None:
        """Pairs that come within range on that way, or None where no solid has edges or corners to fear."""
        return self.pairs.find(self._mirror.of(self.poses)) if self.pairs is not None else None


def _pokes(solid: Solid, edge: float) -> bool:
    """Whether a solid could come through a triangle of cloth with edges of this length [m] between its vertices."""
    x, _, radius = solid.shape.core()
    return len(x) > 0 and not smooth(radius, solid.thickness, edge)
