"""Points of contact: weighted sums of particles that a solve pushes and brakes, terms of its system besides held directions.

A point is a weighted sum of up to four particles, with a 3x3 block. It is a particle that slides under friction, the place on
a cloth edge or face that a solid's edge or corner presses, or the difference of two places on cloth. Its block and
right-hand side are worked out on the host, a few numbers a contact, by arithmetic on rows: vectors (k, 3), symmetric blocks
(k, 6), sorted keys. They are added to A and b like any force's. Between layers it also goes by how the cloth round it turns.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..backend import shared_kernels
from ..backend.fields import Fields
from ..backend.language import ti
from ..backend.rows import write
from ..backend.runtime import for_device
from ..forces import conditions
from ..forces.force import Force
from ..system.state import ParticleState, touching
from .device_points import DevicePoints, Resident

CORNERS = 4
EYE = np.array([1.0, 0, 0, 1, 0, 1])  # as symmetric blocks are kept: xx xy xz yy yz zz
ROOM, SPARE = 4, 32768  # points a particle that there is room for to begin with, and more than those
MOST = 40  # a particle that there may be, and SPARE more


@dataclass(frozen=True)
class ContactRows:
    """Places on cloth, or differences of two, that contacts add to the system of a step.

    A point moves by J p = sum_a (w_a I + t_a n^T) p_a where its particles move by p_a. The rows t, at right angles to n, take
    off its motion by the turning of the cloth round it.

    Attributes:
        vertices: (k, 4) particles; weights: (k, 4) w.
        block: (k, 6) symmetric A [kg]: J^T A J is added to the system's matrix.
        rhs: (k, 3) r [kg m/s]: J^T r is added to its right-hand side.
        normal: (k, 3) n; rotation_coupling: (k, 4, 3) t. None for points that do not turn.
        resident: those of them that a device has, too.
    """

    vertices: np.ndarray
    weights: np.ndarray
    block: np.ndarray
    rhs: np.ndarray
    normal: np.ndarray | None = None
    rotation_coupling: np.ndarray | None = None
    resident: Resident | None = None

    def of(self, rows: np.ndarray) -> np.ndarray:
        """(k, 3) how the points move where the particles move by rows (n, 3)."""
        mine = rows.take(self.vertices, axis=0)
        out = np.einsum("ka,kai->ki", self.weights, mine)
        if self.rotation_coupling is None or self.normal is None:
            return out
        return out + np.einsum("kai,ka->ki", self.rotation_coupling, np.einsum("kai,ki->ka", mine, self.normal))

    def shares(self, forces: np.ndarray) -> np.ndarray:
        """(k, 4, 3) [N] of forces (k, 3) on the points, as their particles take them."""
        push = self.weights[:, :, None] * forces[:, None, :]
        if self.rotation_coupling is not None and self.normal is not None:
            push += np.einsum("kai,ki->ka", self.rotation_coupling, forces)[:, :, None] * self.normal[:, None, :]
        return push

    def spread(self, forces: np.ndarray, to: np.ndarray) -> None:
        """Adds to (n, 3) forces on the particles their shares of forces (k, 3) on the points."""
        add_at(to, self.vertices, self.shares(forces))

    def forces(self, moved: np.ndarray, h: float) -> np.ndarray:
        """(k, 3) [N] on the points, where particles moved by (n, 3) [m] in a solve of a step of h [s]: (r - A J dv)/h."""
        return (self.rhs - sym_times(self.block, self.of(moved) / h)) / h

    def work(self, moved: np.ndarray, h: float, way: np.ndarray) -> float:
        """Work [J] of those forces where the particles go by way (n, 3) [m]."""
        return float(np.einsum("ki,ki->k", self.forces(moved, h), self.of(way)).sum())

    def potential(self, moved: np.ndarray, h: float) -> float:
        """Their part of the incremental potential [J] there: sum 1/2 (J dv)^T A J dv - r . J dv."""
        dv = self.of(moved) / h
        return float(np.sum((sym_times(self.block, dv) / 2 - self.rhs) * dv))

    @staticmethod
    def at(particles: np.ndarray, block: np.ndarray, rhs: np.ndarray) -> "ContactRows":
        """Points that are particles (k,)."""
        vertices, weights = np.repeat(particles[:, None], CORNERS, axis=1), np.tile(np.eye(CORNERS)[0], (len(rhs), 1))
        return ContactRows(vertices, weights, block, rhs)

    @staticmethod
    def none() -> "ContactRows":
        """No points."""
        return ContactRows(np.zeros((0, CORNERS), dtype=np.int64), np.zeros((0, CORNERS)), np.zeros((0, 6)), np.zeros((0, 3)))

    @staticmethod
    def join(parts: Sequence["ContactRows"]) -> "ContactRows":
        """Points one after the other; the only ones that there are as they are."""
        some = [p for p in parts if len(p.rhs)]
        if len(some) == 1:
            return some[0]
        vertices, weights, block, rhs = (np.concatenate([getattr(p, name) for p in parts])
                                         for name in ("vertices", "weights", "block", "rhs"))
        starts = np.cumsum([0] + [len(p.rhs) for p in parts])
        resident = next((replace(p.resident, first=p.resident.first + int(start)) for p, start in zip(parts, starts)
                         if p.resident is not None), None)
        if all(p.rotation_coupling is None for p in parts):
            return ContactRows(vertices, weights, block, rhs)
        zero = [np.zeros((len(p.rhs), CORNERS + 1, 3)) for p in parts]
        return ContactRows(vertices, weights, block, rhs,
                           np.concatenate([z[:, 0] if p.normal is None else p.normal for p, z in zip(parts, zero)]),
                           np.concatenate([z[:, 1:] if p.rotation_coupling is None else p.rotation_coupling
                                           for p, z in zip(parts, zero)]), resident)


@dataclass(frozen=True)
class Pushes:
    """Forces of k contacts on the j particles of each.

    Attributes:
        key: (k,) one number each.
        vertices: (k, j) particles.
        force: (k, j, 3) [N] on them.
    """

    key: np.ndarray
    vertices: np.ndarray
    force: np.ndarray

    @staticmethod
    def none() -> "Pushes":
        """No forces."""
        ids = np.zeros((0, CORNERS), dtype=np.int64)
        return Pushes(ids[:, 0], ids, np.zeros((0, CORNERS, 3)))

    def of(self, rows: np.ndarray) -> np.ndarray:
        """(k,) power [W] where the particles go with velocities (n, 3) [m/s]."""
        return np.einsum("kai,kai->k", self.force, rows.take(self.vertices, axis=0))

    def add(self, to: np.ndarray, parts: np.ndarray | float = 1.0) -> np.ndarray:
        """Adds them to forces (n, 3) on the particles, or parts (k,) of them; returns these."""
        return add_at(to, self.vertices, self.force * np.reshape(parts, (-1, 1, 1)))


def add_at(to: np.ndarray, vertices: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Adds rows (k, j, 3) to those (n, 3) of vertices (k, j); returns these. A fifth of the time of np.add.at."""
    for c in range(3):
        to[:, c] += np.bincount(vertices.ravel(), rows[:, :, c].ravel(), len(to))
    return to


def tangential(rows: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Rows (k, 3) without their part along the normals (k, 3)."""
    return rows - np.einsum("ki,ki->k", rows, normal)[:, None] * normal


def length(rows: np.ndarray) -> np.ndarray:
    """(k,) lengths of rows (k, 3); three times as fast as `np.linalg.norm`."""
    return np.sqrt(np.einsum("ki,ki->k", rows, rows))


def sym_outer(rows: np.ndarray) -> np.ndarray:
    """(k, 6) symmetric blocks r r^T of rows (k, 3)."""
    x, y, z = np.ascontiguousarray(rows.T)
    return np.stack([x * x, x * y, x * z, y * y, y * z, z * z], axis=1)


def sym_times(blocks: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """(k, 3) symmetric blocks (k, 6) times rows (k, 3)."""
    return np.einsum("kij,kj->ki", blocks[:, [0, 1, 2, 1, 3, 4, 2, 4, 5]].reshape(-1, 3, 3), rows)


def unit(rows: np.ndarray) -> np.ndarray:
    """Rows (k, 3) of length 1, or 0 where they are 0."""
    return rows / np.maximum(length(rows), 1e-30)[:, None]


def among(keys: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Whether each wanted key is among sorted keys; an eighth of the time of `np.isin`."""
    return rows_of(keys, wanted) >= 0


def rows_of(keys: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Row of each wanted key among sorted keys, or -1."""
    if not len(keys):
        return np.full(len(wanted), -1)
    where = np.minimum(np.searchsorted(keys, wanted), len(keys) - 1)
    return np.where(keys[where] == wanted, where, -1)


@ti.data_oriented
class ContactForce(Force):
    """Points of contact as a force of the operator.

    Attributes:
        capacity: points that there is room for, which grows; most: that there may be.
    """

    of_contact = True

    def __init__(self, fields: Fields, model: ParticleState, layered: bool = False) -> None:
        self.model, self._fields, self.layered = model, fields, layered
        self.capacity = ROOM * model.n + SPARE
        self.most = MOST * model.n + SPARE
        self.first = fields.integer(model.blocks.count + 1, data=np.zeros(model.blocks.count + 1))
        self.exchange, self.device = model.exchange, for_device()
        self._on_device = DevicePoints(self, CORNERS)

    def rounding_energy(self, d: float) -> float:
        """None: points have no energy of their own."""
        return 0.0

    def build_stiffness(self) -> None:
        """Declares the points."""
        self.stiff = True
        self._declare(self._fields)

    def _declare(self, fields: Fields) -> None:
        self.vertices = fields.integer(self.capacity, CORNERS)
        self.weights = fields.real(self.capacity, CORNERS)
        self.A = fields.real(self.capacity, 6)
        self.rhs = fields.real(self.capacity, 3)
        if self.layered:
            self.normal = fields.real(self.capacity, 3)
            self.rotation_coupling = fields.real(self.capacity, 3 * CORNERS)
        self._use(0)

    def _use(self, rows: int) -> None:
        """Sets how many rows of the points' fields are used."""
        for field in self._points():
            field.rows = rows

    def _points(self) -> list:
        """Fields with a row a point."""
        layered = [self.normal, self.rotation_coupling] if self.layered else []
        return [self.vertices, self.weights, self.A, self.rhs, *layered]

    def _grow(self, count: int) -> None:
        """Makes room for so many points, and some. Kernels that read points are compiled for the new fields."""
        self.capacity = min(max(2 * self.capacity, count), self.most)
        fields = self._fields.more()
        self._declare(fields)
        fields.allocate()
        shared_kernels.look_again()

    def set(self, p: ContactRows) -> bool:
        """Replaces the points; False where there are more than there may be."""
        e, first = touching(p.vertices, self.model.blocks.bounds)
        if len(e) > self.most:
            return False
        if len(e) > self.capacity:
            self._grow(len(e))
        before = self.vertices.rows
        self._use(len(e))
        if self.device:
            if len(e) or before:
                self._on_device.put(p, e, first)
            return True
        write(self.first, first.astype(np.int32))
        write(self.vertices, p.vertices.take(e, axis=0).astype(np.int32))
        for field, numbers in ((self.weights, p.weights), (self.A, p.block), (self.rhs, p.rhs)):
            write(field, numbers.take(e, axis=0).astype(self.exchange, copy=False))
        if self.layered:
            none = np.zeros((len(p.rhs), CORNERS, 3))
            normal, t = p.normal, p.rotation_coupling
            if normal is None or t is None:
                normal, t = none[:, 0], none
            write(self.normal, normal.take(e, axis=0).astype(self.exchange, copy=False))
            write(self.rotation_coupling, t.take(e, axis=0).astype(self.exchange, copy=False))
        return True

    def clear(self) -> None:
        """Takes all points out of the system."""
        if self.vertices.rows:
            self.set(ContactRows.none())

    @ti.func
    def add_force(self, block, f: ti.template()):
        """Nothing: points are of a solve, explicit methods know no contact."""

    @ti.func
    def evaluate(self, block, linearizes, moves, c, to: ti.template(), base: ti.template(), report: ti.template(),
                 dtype: ti.template()):
        """With `linearizes`, adds the right-hand sides to b and the blocks to P. No energy, no dissipation."""
        if linearizes == 1:
            lo, hi = self.model.blocks.row[block], self.model.blocks.row[block + 1]
            for e in range(self.first[block], self.first[block + 1]):
                for k in ti.static(range(CORNERS)):
                    w, i, r = self.weights[e][k], self.vertices[e][k], self.rhs[e]
                    push = w * r
                    if ti.static(self.layered):
                        push += self.turn(e, k).dot(r) * self.normal[e]
                    self.model.blocks.add(to.b, i, push, lo, hi)
                    self.model.blocks.add(to.P, i, self.own(e, k), lo, hi)
        report[block, base] = 0
        report[block, base + 1] = 0

    @ti.func
    def add_diagonal(self, block, P: ti.template()):
        """Adds the blocks to P."""
        lo, hi = self.model.blocks.row[block], self.model.blocks.row[block + 1]
        for e in range(self.first[block], self.first[block + 1]):
            for k in ti.static(range(CORNERS)):
                self.model.blocks.add(P, self.vertices[e][k], self.own(e, k), lo, hi)

    @ti.func
    def turn(self, e, k: ti.template()):
        """Turn of corner k of entry e."""
        t = self.rotation_coupling[e]
        return ti.Vector([t[3 * k], t[3 * k + 1], t[3 * k + 2]])

    @ti.func
    def own(self, e, k: ti.template()):
        """Diagonal block of corner k of entry e."""
        w, A = self.weights[e][k], self.A[e]
        out = w * w * A
        if ti.static(self.layered):
            n, t = self.normal[e], self.turn(e, k)
            pull = conditions.sym_times(A, t)
            out += w * conditions.sym_both(pull, n) + t.dot(pull) * conditions.sym_outer(n)
        return out

    @ti.func
    def add_product(self, block, p: ti.template(), q: ti.template()):
        """q += the blocks times p"""
        lo, hi = self.model.blocks.row[block], self.model.blocks.row[block + 1]
        for e in range(self.first[block], self.first[block + 1]):
            v, w = self.vertices[e], self.weights[e]
            moved = w[0] * p[v[0]] + w[1] * p[v[1]] + w[2] * p[v[2]] + w[3] * p[v[3]]
            if ti.static(self.layered):
                for k in ti.static(range(CORNERS)):
                    moved += self.normal[e].dot(p[v[k]]) * self.turn(e, k)
            r = conditions.sym_times(self.A[e], moved)
            for k in ti.static(range(CORNERS)):
                push = w[k] * r
                if ti.static(self.layered):
                    push += self.turn(e, k).dot(r) * self.normal[e]
                self.model.blocks.add(q, v[k], push, lo, hi)

    def build_levels(self, levels) -> None:
        """Nothing: the levels take the points' diagonal, see `add_diagonal`."""

    @ti.func
    def add_level_block(self, n, c, D, levels: ti.template()):
        """D"""
        return D
