"""States of the contacts with solids from solve to solve of a step, and the residual of the force balance. numpy only.

Let b = M (v_base - v) + c f be the residual impulse at the end state, and p the impulse of contacts by Coulomb's law
(`coulomb`). The step is solved if b + p = 0 in all directions that are not pinned. A contact that bears is held along its
normal by the next linear solve. One that sticks is held in all directions, one that slides feels drag.

A particle that is inside a solid at the start, or is predicted to end there, is brought to the surface by y in the first
solve. One that enters later is led there, with the velocity that this takes.
"""

from dataclasses import dataclass, replace

import numpy as np

from ...system.cones import Cones
from ..points import ContactRows, length, rows_of, sym_times, tangential
from .active_set import ActiveSet, States, hold_together
from .coulomb import MOST, SMOOTH, Rows, project_to_coulomb, smoothed, tangential_impulses
from .sliding import Sliding
from .solid_contacts import EARTH, SolidContacts
from .vertices import VertexContacts

MET = 4  # solves after which contacts keep their planes: between an arm and a trunk these would change in every solve. Without
# end steps there are cut to 1/80. With 2, 4 and 6 all of `test_drives` pass
Impulses = tuple[np.ndarray, np.ndarray]  # (k, 3) on contacts [N s], and (k,) along their normals


@dataclass(frozen=True)
class Residual:
    """How far a state is from solving a step.

    Attributes:
        relative: |b + p| over all that acts: weight, contact, pins, changes of momentum.
        worst: the particle that most of it is at.
        acting: all that acts [N s].
        changed: contacts whose state changes.
        law: |p by the law - p that the last linear solve took| over all that acts; with `contact_tol` only.
    """

    relative: float
    worst: int
    acting: float
    changed: int = 0
    law: float = 0.0


@dataclass(frozen=True)
class Found:
    """The contacts of a state, by the law: `Balance`'s attributes.

    Attributes:
        rubbed: whether more contacts begin to slide than to stick.
        near: contacts, those that bear nothing too: (them, their rows, slips (k, 3), goals (k,)).
    """

    residual: Residual
    f: VertexContacts
    rows: Rows
    slip: np.ndarray
    goal: np.ndarray
    rubbed: bool
    near: tuple[VertexContacts, Rows, np.ndarray, np.ndarray]


class Balance:
    """Balance of a step from the saved state, in contact with solids.

    Attributes:
        rows: the contacts' states in the next solve; f: these contacts, with where they were met.
        goal: (k,) gap [m] that each is led to; less than 0 where it starts too deep to come out in a step.
        inertia: (n,) by which particles resist a force [kg]: `System.inertia`, their mass before a solve.
        k: linear solves so far; smoothed: whether friction was viscous in the last one below `SMOOTH`; rubbed: whether
            more contacts began to slide in it than to stick.
    """

    def __init__(self, solids: SolidContacts, base_v: np.ndarray) -> None:
        self.solids, self.start, self.mass = solids, solids.start, solids.model.mass
        self.inertia = self.mass
        self.base_v = base_v
        self.slip, self.k = np.zeros((0, 3)), 0
        self.smoothed = self.rubbed = False

    def begin(self) -> None:
        """The contacts of the first solve, `solids.active`: those that `SolidContacts.choose_active` chooses."""
        self.closing = self.solids.choose_active()
        a = self.solids.active
        self.f, c = a.contacts, self.start.c
        self.goal = np.minimum(self.f.start_gap + a.normal_shift, 0.0)
        self.held = self.start.altered(a.holding.held, a.sticking)
        p_n, speed = c * a.states.force, length(a.slip)
        cone = self.f.friction * p_n
        slides = ~a.states.stick & (cone > 0)
        push = np.where((slides & (speed > 0))[:, None], -a.slip / np.maximum(speed, 1e-300)[:, None], 0.0)
        stopped = cone / self.mass[self.f.index]  # slip that friction would stop
        push[speed < stopped] = 0.0  # a drag in all directions, which never pushes backwards
        before = slides & a.states.push.any(axis=1)
        push[before] = a.states.push[before]
        drag = np.where(slides, cone / np.maximum(np.maximum(speed, stopped), 1e-12), 0.0)
        self.rows = Rows(self.f.key, a.states.stick, p_n, push, drag)

    def constrain(self) -> None:
        """The contacts of a further solve: those that bear, where the law leads them."""
        rows, start, f = self.rows, self.start, self.f
        normal_shift = self.goal - f.start_gap
        holding = hold_together(f, rows.stick, normal_shift, start.pins, self.solids.model.n, self.solids.model.exchange)
        sewn = self.solids.model.sewn
        held = holding.held if sewn is None else sewn.spread(holding.held, start.c)
        states = States(f.key, rows.stick, rows.normal / start.c, rows.push)
        active = self.solids.active = ActiveSet(f, states, self.slip, normal_shift, replace(holding, held=held))
        self.held = start.altered(held, active.sticking)

    def rubs(self, v: np.ndarray) -> ContactRows:
        """Friction of sliding contacts, for a solve that begins with velocities v (n, 3) [m/s]."""
        slides, start = ~self.rows.stick, self.start
        f, rows = self.f.take(slides), self.rows.take(slides)
        block = rows.blocks(f.normal)
        against = start.mean(v)[f.index] - (f.carried - start.x[f.index]) / start.h
        push = (f.friction * rows.normal)[:, None] * rows.push - sym_times(block, against)
        self.solids.sliding = Sliding(slides, ContactRows.at(f.index, start.c / start.h * block, push))
        return self.solids.sliding.points

    @property
    def near(self) -> np.ndarray:
        """Particles (k,) that contacts were found of, or that have some in the last solve."""
        return np.union1d(self.solids.near.vertices.index, self.f.index)

    def unrubbed(self, inertia: np.ndarray) -> np.ndarray:
        """`System.inertia` (n,) [kg] of the system that was last solved, without the friction of sliding contacts in it."""
        points = self.solids.sliding.points
        drag = np.bincount(points.vertices[:, 0], points.block[:, [0, 3, 5]].mean(axis=1), len(inertia))
        return np.maximum(inertia - drag, self.mass)

    def assess_linear(self, v: np.ndarray, reaction: np.ndarray, base: np.ndarray) -> Found:
        """Like `assess`, of the balance of a linear solve that began at positions base (n, 3), and put reaction (k, 3) [N s]
        on the particles that it held."""
        solids, b, c = self.solids, np.zeros_like(v), self.start.c
        if self.held is not None:
            b[self.held.index] -= reaction
        points = solids.sliding.points
        points.spread(-c * points.forces(solids.near.end_positions - base, c), b)
        solve_impulses = solids.active.holding.forces(solids.active.contacts, reaction)
        return self.assess(b, v, solve_impulses, solve_impulses, fixed=self.k >= MET and not self.start.together)

    def assess(self, b: np.ndarray, v: np.ndarray, solve_impulses: Impulses, balance_impulses: Impulses, enough: float = 0.0,
               agreed: float = 0.0, fixed: bool = False) -> Found:
        """How far the state that the model is in is from solving the step, and the contacts' next states by the law.

        Args:
            b: (n, 3) impulses [N s] that the step lacks there, without friction of contacts that slide on solids.
            v: (n, 3) velocities there [m/s].
            solve_impulses: on contacts in the last linear solve: by them goes the next one.
            balance_impulses: those that balance the state where it ended: with these the step is solved sooner.
            enough: `relative` with which it is, where `law` is no more than `agreed`.
        """
        solids = self.solids
        keep = ~solids.pinned[solids.near.vertices.index]
        f, slip = solids.near.vertices.take(keep), solids.near.slip[keep]
        if fixed:
            f, slip = self._where_met(f, slip)
        r, rows, p, bears = self._by(solve_impulses, f, slip, b, v)
        if solve_impulses is not balance_impulses:
            r = replace(r, law=_norm(p - self._by_solve(solve_impulses, f, slip, bears)) / r.acting)
            there = self._by(balance_impulses, f, slip, b, v) if r.law <= agreed else None
            if there is not None and there[0].relative <= enough:
                r, rows, p, bears = replace(there[0], law=r.law), *there[1:]
        known, was = self.rows.of(f.key)
        other = ~known[bears] | (was.stick[bears] != rows.stick[bears])
        r = replace(r, changed=int(np.sum(other)) + int(np.sum(known & ~bears)))
        change = (known & (f.friction > 0))[bears] * (was.stick[bears].astype(int) - rows.stick[bears])
        rubbed = bool(change.sum() > 0)
        goal = self._goals(f)
        return Found(r, f.take(bears), rows.take(bears), slip[bears], goal[bears], rubbed, (f, rows, slip, goal))

    def cones(self, found: Found) -> Cones | None:
        """The contacts near by of particles with a single one, from where they were found; None without any that rubs.
        Particles that are pinned, sewn, or held by several contacts stay fixed."""
        (f, rows, slip, goal), start, n = found.near, self.start, len(self.mass)
        single, normal = self._single(f), rows.normal
        size = (f.friction * normal)[single]
        if not size.any():
            return None
        mine, stays = f.take(single), np.zeros(n, dtype=bool)
        stays[f.index[~single & (normal > 0)]] = True
        if start.pins is not None:
            stays[start.pins.index] = True
        if self.solids.model.sewn is not None:
            stays[self.solids.model.sewn.member] = True
        opens = (mine.gap - goal[single]) / start.c
        way = -slip[single] * start.h / start.c - opens[:, None] * mine.normal
        points, block, push = self.solids.sliding.points, np.zeros((n, 6)), np.zeros((n, 3))
        points.spread(points.rhs, push)
        np.add.at(block, points.vertices[:, 0], points.block)
        return Cones(mine.index, mine.normal, size, way, stays, block, push)

    def _single(self, f: VertexContacts) -> np.ndarray:
        """(k,) which contacts are the only constraint of their particles."""
        out = np.bincount(f.index, minlength=len(self.mass))[f.index] == 1
        if self.start.pins is not None:
            out &= ~np.isin(f.index, self.start.pins.index)
        sewn = self.solids.model.sewn
        return out if sewn is None else out & ~np.isin(f.index, sewn.member)

    def relaxed(self, found: Found, slip: np.ndarray, pressed: np.ndarray) -> Found:
        """`found` with the states that follow from slips (k, 3) [m/s] of its `cones`, as parts of dv, and of those that
        press, by their impulses (k,) [N s]. New ones have no friction in the next solve, which gives their load."""
        (f, rows, slips, goal), single = found.near, self._single(found.near[0])
        slip = slip * self.start.c / self.start.h
        bears = rows.normal > 0
        bears[single] |= pressed > 0
        speed, cone = length(slip), (f.friction * rows.normal)[single]
        slides = (speed > 0) & (cone > 0)
        stick, push, drag, slips = rows.stick.copy(), rows.push.copy(), rows.drag.copy(), slips.copy()
        stick[single] = ~slides & (cone > 0)
        push[single] = np.where(slides[:, None], -slip / np.maximum(speed, 1e-300)[:, None], 0.0)
        most = self.inertia[f.index[single]] * MOST / (1 - MOST)
        drag[single] = np.where(slides, np.minimum(cone, most * speed) / np.maximum(speed, 1e-300), 0.0)
        slips[single] = slip
        rows = Rows(rows.key, stick, rows.normal, push, drag)
        return replace(found, f=f.take(bears), rows=rows.take(bears), slip=slips[bears], goal=goal[bears])

    def reached(self, found: Found, short: np.ndarray) -> Found:
        """`found` without new contacts that were not reached when the update was shortened by `short` (n, 3) [m]."""
        f = found.f
        met = f.gap + np.einsum("ki,ki->k", short[f.index], f.normal) < 0
        kept = self.rows.of(f.key)[0] | met
        return replace(found, f=f.take(kept), rows=found.rows.take(kept), slip=found.slip[kept], goal=found.goal[kept])

    def next_states(self, found: Found) -> States:
        """The states with which a step ends that goes no further."""
        return States(found.f.key, found.rows.stick, found.rows.normal / self.start.c, found.rows.push)

    def take(self, found: Found) -> None:
        """The contacts go on as found."""
        self.f, self.rows, self.slip, self.goal = found.f, found.rows, found.slip, found.goal
        self.rubbed = found.rubbed
        self.k += 1

    def _where_met(self, f: VertexContacts, slip: np.ndarray) -> tuple[VertexContacts, np.ndarray]:
        """Contacts that were known, by the planes with which they were first met."""
        new = ~np.isin(f.key, self.f.key)
        there = self.solids.near.end_positions[self.f.index]
        away = there - self.f.carried
        gap = np.einsum("ki,ki->k", away, self.f.normal) + self.f.start_gap
        known = replace(self.f, gap=gap)
        order = np.argsort(np.concatenate([known.key, f.key[new]]), kind="stable")
        both = VertexContacts(*(np.concatenate([getattr(known, name), getattr(f, name)[new]])[order]
                                for name in f.__dataclass_fields__))
        slips = np.concatenate([tangential(away / self.start.h, known.normal), slip[new]])[order]
        return both, slips

    def _by(self, impulses: Impulses, f: VertexContacts, slip: np.ndarray, b: np.ndarray, v: np.ndarray,
            ) -> tuple[Residual, Rows, np.ndarray, np.ndarray]:
        """(residual, next states, impulses (k, 3), whether each contact bears) by the law with such impulses."""
        solids, start, n = self.solids, self.start, len(b)
        known, was = self.rows.of(f.key)
        held, normal = (_rows(self.rows.key, values, f.key) for values in impulses)
        rows, p, bears = project_to_coulomb(replace(f, gap=f.gap - self._goals(f)), was, slip, held, normal,
                                            self.mass[f.index], self.inertia[f.index], start.c)
        total = b.copy()
        for c in range(3):
            total[:, c] += np.bincount(f.index, p[:, c], n)
        if solids.model.sewn is not None:
            total -= solids.model.sewn.tension(total)
        acting = _norm(p) + _norm(self.mass[:, None] * (v - self.base_v))
        acting += max(float(np.linalg.norm(solids.gravity)), EARTH) * start.c * _norm(self.mass)
        if start.pins is not None:
            i, P = start.pins.index, start.pins.projector.astype(np.float64)
            by_pins = np.einsum("kij,kj->ki", P, total[i])
            acting += _norm(by_pins)
            total[i] -= by_pins
        size = np.einsum("ni,ni->n", total, total)
        return Residual(float(np.sqrt(size.sum())) / acting, int(size.argmax()), acting), rows, p, bears

    def _goals(self, f: VertexContacts) -> np.ndarray:
        """(k,) `goal` of contacts. The nearest surface of cloth that is brought out of a solid may be another after a solve,
        and further: it goes no further than a step pushes it."""
        goal, most = _rows(self.rows.key, self.goal, f.key), f.start_gap + self.solids.push
        return np.where(self.solids.penetration.sought[f.index], np.minimum(goal, most), goal)

    def _by_solve(self, solve_impulses: Impulses, f: VertexContacts, slip: np.ndarray, bears: np.ndarray) -> np.ndarray:
        """(k, 3) impulses [N s] that the last linear solve put on contacts, of which some bear (k,) now."""
        known, was = self.rows.of(f.key)
        held, normal = (_rows(self.rows.key, values, f.key) for values in solve_impulses)
        took = normal[:, None] * f.normal + tangential_impulses(f, was, slip, held)
        return np.where((known | bears)[:, None], took, 0.0)

    def go_on(self, solved: bool) -> None:
        """A further solve follows. If contacts began to slide in the first one, friction is viscous below `SMOOTH` in the
        next, unless all is in balance (`solved`). With that, slower slip looks like sticking.
        """
        self.smoothed = self.k == 1 and self.rubbed and not solved
        if self.smoothed:
            f = self.f
            self.rows = smoothed(f.key, f.friction * self.rows.normal, self.rows.normal, self.slip, SMOOTH)


def _rows(keys: np.ndarray, values: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Values (k, ...) of sorted keys (k,) at wanted ones; 0 where there are none."""
    row = rows_of(keys, wanted)
    out = np.zeros((len(wanted), *values.shape[1:]))
    out[row >= 0] = values[row[row >= 0]]
    return out


def _norm(values: np.ndarray) -> float:
    return float(np.sqrt((values**2).sum()))
