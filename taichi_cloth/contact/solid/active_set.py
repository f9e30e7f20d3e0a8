"""Contacts with solids: their states from round to round, and the active ones, with pins, as one set of held directions.
numpy only."""

from dataclasses import dataclass, field

import numpy as np

from ...system.held import Held
from .vertices import VertexContacts

APART = 0.3  # sine of the angle between directions below which the second is no further constraint of a particle


@dataclass
class States:
    """States of the contacts of a step, sorted by key; kept from step to step.

    Attributes:
        key: (k,) particle and solid.
        stick: (k,) whether friction holds it.
        force: (k,) normal force [N].
        push: (k, 3) direction of friction on contacts that have just begun to slide, 0 elsewhere.
    """

    key: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    stick: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=bool))
    force: np.ndarray = field(default_factory=lambda: np.zeros(0))
    push: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))


@dataclass(frozen=True)
class Holding:
    """The contacts and pins that hold particles.

    Attributes:
        held: contacts and pins; None where there are neither.
        alone: (k,) whether a contact is the only thing that holds its particle.
        rows: (k,) which of the held particles is a contact's.
    """

    held: Held | None
    alone: np.ndarray
    rows: np.ndarray

    def forces(self, f: VertexContacts, on_held: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(forces [N] (k, 3) of contacts on their particles, their parts (k,) along the normals) from those on held particles.

        Several contacts of one particle share its force: by their normals, and evenly the rest that these cannot make up.
        Normals that are hardly apart count as one, as they do where they hold: each would bear many times the force, and
        rub by it.
        """
        if not len(self.rows):
            return np.zeros((0, 3)), np.zeros(0)
        force = on_held[self.rows]
        normal = np.einsum("ki,ki->k", force, f.normal)
        for i in np.unique(f.index[~self.alone]):
            mine = np.flatnonzero(f.index == i)
            if len(mine) > 1:
                whole = force[mine[0]]
                normal[mine] = np.linalg.lstsq(f.normal[mine].T, whole, rcond=APART / 2)[0]
                made_up = normal[mine, None] * f.normal[mine]
                force[mine] = made_up + (whole - made_up.sum(axis=0)) / len(mine)
        return force, normal


@dataclass(frozen=True)
class ActiveSet:
    """The contacts that a solve holds.

    Attributes:
        contacts: k of them; states: of each.
        slip: (k, 3) their velocity against the solid before the solve [m/s].
        normal_shift: (k,) how far [m] each moves its particle along its normal.
        holding: them and pins, as the solve's filter holds them.
    """

    contacts: VertexContacts
    states: States
    slip: np.ndarray
    normal_shift: np.ndarray
    holding: Holding

    @property
    def sticking(self) -> np.ndarray | None:
        """(k, 3, 3) projectors on the directions in which held particles stick to the only solid that they touch."""
        held = self.holding.held
        if held is None:
            return None
        out, one = np.zeros(held.projector.shape), self.holding.alone & self.states.stick
        n = self.contacts.normal[one]
        out[self.holding.rows[one]] = np.eye(3) - n[:, :, None] * n[:, None, :]
        return out

    @classmethod
    def none(cls) -> "ActiveSet":
        """Nothing."""
        nothing = np.zeros(0)
        return cls(VertexContacts.none(), States(), np.zeros((0, 3)), nothing,
                   Holding(None, nothing.astype(bool), nothing.astype(np.int64)))


def hold_together(f: VertexContacts, stick: np.ndarray, normal_shift: np.ndarray, pinned: Held | None, n: int,
                  exchange: type) -> Holding:
    """Contacts and pins of n particles as one.

    Args:
        stick: (k,) whether a contact holds all directions.
        normal_shift: (k,) how far [m] along its normal it moves its particle.
    """
    if not len(f.index):
        return Holding(pinned, np.zeros(0, dtype=bool), np.zeros(0, dtype=np.int64))
    projectors = np.einsum("ki,kj->kij", f.normal, f.normal)
    projectors[stick] = np.eye(3)
    shifts = normal_shift[:, None] * f.normal
    again = f.index[1:] == f.index[:-1]
    alone = ~(np.append(again, False) | np.append(False, again))
    if pinned is not None:
        alone &= ~np.isin(f.index, pinned.index)
    index, projector, target, y = [f.index[alone]], [projectors[alone]], [(f.carried + shifts)[alone]], [shifts[alone]]
    shared = np.unique(f.index[~alone])
    if len(shared):
        several = [_combine(f, stick, shifts, i, pinned) for i in shared]
        for parts, values in zip((index, projector, target, y), zip(*several)):
            parts.append(np.array(values))
    if pinned is not None:
        free = ~np.isin(pinned.index, shared)
        index.append(pinned.index[free])
        projector.append(pinned.projector[free])
        target.append(pinned.target[free])
        y.append(np.zeros((int(free.sum()), 3)))
    all_index = np.concatenate(index)
    row = np.full(n, -1)
    row[all_index] = np.arange(len(all_index))
    P, goal, shift = (np.concatenate(parts) for parts in (projector, target, y))
    return Holding(Held.of(all_index, P, goal, True, shift, exchange), alone, row[f.index])


def _combine(f: VertexContacts, stick: np.ndarray, shifts: np.ndarray, i: int, pinned: Held | None) -> tuple:
    """Everything that holds particle i, one direction after the other: (i, projector, target, y)."""
    rows: list[tuple[np.ndarray, float, float]] = []  # direction, position along it, y along it
    if pinned is not None and i in pinned.index:
        k = int(np.flatnonzero(pinned.index == i)[0])
        values, vectors = np.linalg.eigh(pinned.projector[k].astype(np.float64))
        rows += [(q, float(q @ pinned.target[k]), 0.0) for q, value in zip(vectors.T, values) if value > 0.5]
    mine = np.flatnonzero(f.index == i)
    for k in mine.tolist():
        n = f.normal[k]
        rows.append((n, float(n @ (f.carried[k] + shifts[k])), float(n @ shifts[k])))
    for k in mine[stick[mine]]:
        rows += [(q, float(q @ f.carried[k]), 0.0) for q in np.eye(3)]
    basis: list[tuple[np.ndarray, float, float]] = []
    for q, value, y in rows:
        for b, b_value, b_y in basis:
            c = float(q @ b)
            q, value, y = q - c * b, value - c * b_value, y - c * b_y
        size = float(np.linalg.norm(q))
        if size > APART:
            basis.append((q / size, value / size, y / size))
    projector = sum(np.outer(q, q) for q, _, _ in basis)
    return (i, projector, sum(value * q for q, value, _ in basis), sum(y * q for q, _, y in basis))
