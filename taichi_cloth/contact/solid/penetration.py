"""Particles that a step leaves too deep inside solids, too near to their edges, or across; and whether they may stay.

Such a step is tried smaller; one that is small already is taken as it is where solids leave no room (`room`). Particles
that end wrong then are pinched: for a while they do not make steps small again.

When a solid that pinched cloth opens, edges may be left that pass through it though their vertices are outside. The
vertices of triangles that cross a solid, and are not pinched, are raised slowly until nothing crosses, and let down again.
"""

from dataclasses import replace

import numpy as np

from ...system.checkpoint import Checkpointed
from ...system.held import pinned_particles
from ..points import among
from ..step_start import StepContext
from .pairs import LEAST, PAIR, Pairs, left
from .query import ContactCandidates, SolidCollisionDetector
from .room import has_room, walls
from .vertices import VertexContacts

PENETRATION = 1e-2  # of the thickness that a particle may end inside it without a further round
DEEP, DEEPER = 0.5, 0.7  # of the thickness: deeper ends are not accepted; where pairs guard faces and edges of cloth too
OUT, HIGHEST = 0.05, 0.5  # m/s by which crossing cloth is raised, and mean edges by which it is at most
SPARED = 0.1  # s for which pinched particles do not make steps small again, and their pairs with cloth rest


class Penetration(Checkpointed):
    """Penetration of a model's cloth into solids.

    Attributes:
        deep: (solids,) depth [m] that is not accepted.
        spared: (n,) time [s] for which it does not matter how deep inside solids particles end; pinched: (n,) nor in this
            attempt.
        raised: (n,) by how much [m] particles are to be further from solids than the thickness; most: at most.
        across: (n,) whether a triangle of a raised particle crosses solids: pairs of these alone rest; resting: these pairs.
        sought: (n,) whether a particle was pinched and may be inside a closed solid: it is looked for there however deep,
            brought out like one that starts inside, and is spared until then.
        crossed: (k, 3) particles of triangles that cross solids' at the end of the attempt; before: at its beginning.
    """

    STATE = ("before", "spared", "raised", "across", "sought")

    def __init__(self, n: int, detector: SolidCollisionDetector) -> None:
        self.detector, self.thickness = detector, detector.thickness
        self.deep = np.where(detector.pokes, DEEPER, DEEP) * detector.thickness
        self.raised, self.most = np.zeros(n), HIGHEST * detector.edge
        self.across = np.zeros(n, dtype=bool)
        self.resting: Pairs | None = None
        self.spared, self.pinched, self.sought = np.zeros(n), np.zeros(n, dtype=bool), np.zeros(n, dtype=bool)
        self.crossed = self.before = np.zeros((0, 3), dtype=np.int64)

    def resumed(self) -> None:
        """See `Checkpointed`."""
        self.crossed, self.resting = self.before, None

    @property
    def minded(self) -> np.ndarray:
        """(n,) particles whose depth inside solids is checked: not spared, not pinched."""
        return (self.spared == 0) & ~self.pinched

    def raise_from(self, near: ContactCandidates) -> ContactCandidates:
        """Contacts and pairs, with raised particles measured from where they are to be, without pairs of those across."""
        self.resting = None
        if near.pairs is not None and self.across.any():
            rests = self._rests(near.pairs)
            self.resting, near = near.pairs.take(rests), replace(near, pairs=near.pairs.take(~rests))
        return near.raised(self.raised) if self.raised.any() else near

    def _rests(self, pairs: Pairs) -> np.ndarray:
        """(k,) whether all of a pair's own particles are across."""
        return self.across[pairs.own_vertices].all(axis=1)

    def inside(self, f: VertexContacts, held: np.ndarray) -> VertexContacts:
        """Those contacts that end inside a solid's thickness and are not among the keys (sorted) that are held, or held at
        another plane, and are not pinched; as deep as they are, whatever they are raised by."""
        f = f.nearer(-self.raised[f.index])
        moved_on = (f.gap < -self.deep[f.solid]) & (f.gap < f.start_gap - PENETRATION * self.thickness[f.solid])
        return f.take((f.gap < 0) & (~among(held, f.key) | moved_on) & self.minded[f.index])

    def left(self, near: ContactCandidates, inside: VertexContacts, linearized: Pairs | None) -> tuple[int, bool]:
        """(pairs that are left closer than they should be, whether they or the contacts inside ended too deep).

        Args:
            linearized: pairs as the last solve took them.
        """
        bad = bool((inside.gap < -self.deep[inside.solid]).any())
        if near.pairs is None:
            return 0, bad
        nearer, lost = left(near.pairs, linearized, self.detector.kept_by(near.pairs))
        minded = self._minded_pairs(near.pairs)
        return int(np.sum(nearer & minded)), bad or bool((lost & minded).any())

    def below_least(self, near: ContactCandidates) -> np.ndarray:
        """(k,) whether pairs end nearer than LEAST, and none of their particles is pinched."""
        assert near.pairs is not None
        return (near.pairs.distance < LEAST * PAIR * self.detector.kept_by(near.pairs)) & self._minded_pairs(near.pairs)

    def may_shrink(self, start: StepContext, near: ContactCandidates, held: np.ndarray, linearized: Pairs | None) -> bool:
        """Whether a step that goes wrong is to be tried smaller, and not taken as the best there is. Steps that go
        wrong beside pinched cloth, which draws its neighbours along, are taken."""
        if not start.small:
            return True
        faces, beside = self.detector.faces, ~self.minded
        beside[faces[beside[faces].any(axis=1)]] = True
        rows = self.wrong(near, held, linearized)
        there = walls(near.vertices, near.pairs, near.end_positions, self.thickness)
        return bool(has_room(rows[~beside[rows].any(axis=1)], faces, there, self.thickness, self.detector.yields,
                             pinned_particles(start.pins, len(self.spared))).any())

    def look_across(self) -> bool:
        """Looks for crossings where the model is; whether there are more than at the beginning, pinched ones apart."""
        self.crossed = self.detector.find_crossings()
        return self.more_crossed

    @property
    def more_crossed(self) -> bool:
        """Whether more crosses than at the beginning of the attempt, where crossings were last looked for."""
        return len(self._new(self.crossed)) > len(self._new(self.before))

    def crossings(self, f: VertexContacts) -> int:
        """Pairs of triangles of cloth and solids that cross, and particles inside solids without edges or corners."""
        inside = ~self.detector.pokes[f.solid] & (f.gap < -self.thickness[f.solid])
        across = self.detector.find_crossings(grown=True) if self.detector.rounded else self.crossed
        return len(across) + int(inside.sum())

    def wrong(self, near: ContactCandidates, held: np.ndarray, linearized: Pairs | None) -> np.ndarray:
        """(k, 3) particles of contacts and pairs that end too deep inside solids, too near to them or across."""
        inside = self.inside(near.vertices, held)
        deep = inside.index[inside.gap < -self.deep[inside.solid]]
        rows = [np.repeat(deep[:, None], 3, axis=1)]
        if near.pairs is not None:
            lost = left(near.pairs, linearized, self.detector.kept_by(near.pairs))[1]
            rows.append(self._minded(near.pairs.own_vertices[lost]))
        if self.more_crossed:
            rows.append(self._new(self.crossed))
        return np.concatenate(rows)

    def pass_time(self, h: float, f: VertexContacts) -> None:
        """A step of h [s] was accepted, with contacts f of particles that are not pinched."""
        self.spared = np.maximum(self.spared - h, 0)
        inside = np.zeros(len(self.sought), dtype=bool)
        deep = f.gap + self.raised[f.index] < -self.thickness[f.solid]
        inside[f.index[deep & self.detector.closed[f.solid]]] = True
        inside &= self.sought
        self.spared[inside] = SPARED
        self.sought &= self.spared > 0
        crossed = self.crossed[~(self.pinched | inside)[self.crossed].any(axis=1)]
        if len(crossed) or self.raised.any():
            self.across = np.zeros(len(self.raised), dtype=bool)
            self.across[crossed] = True
            self.raised = np.clip(self.raised + np.where(self.across, OUT * h, -OUT * h), 0, self.most)
        if self.resting is not None:
            back = self.resting.take(~self._rests(self.resting))
            self.detector.thickness_ramp.add(back.vertices, self.detector.part_of(back))

    def spare(self, particles: np.ndarray) -> None:
        """Particles are pinched between solids."""
        self.spared[particles] = SPARED
        self.sought[particles] = True

    def let_out(self, particles: np.ndarray, seconds: np.ndarray) -> None:
        """Particles (k,) start inside solids, and are out after so many seconds (k,): until then it does not matter."""
        np.maximum.at(self.spared, particles, seconds + SPARED)

    def _minded_pairs(self, pairs: Pairs) -> np.ndarray:
        """(k,) whether none of a pair's own particles is pinched."""
        return self.minded[pairs.own_vertices].all(axis=1)

    def _new(self, crossed: np.ndarray) -> np.ndarray:
        """Those rows (k, 3) of crossing triangles that count: no edge of theirs is without pairs."""
        return self._minded(crossed[self.across[crossed].sum(axis=1) < 2])

    def _minded(self, vertices: np.ndarray) -> np.ndarray:
        """Those rows (k, .) of particles none of which is pinched."""
        return vertices[self.minded[vertices].all(axis=1)]
