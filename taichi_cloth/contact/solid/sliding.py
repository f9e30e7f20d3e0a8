"""Coulomb friction of particles that slide on solids, as points of contact. numpy only.

The force is -mu lambda u/|u|, with the last known normal force lambda. Where it cannot stop the slip u that is expected
within the step, it is linearised about it: constant along u, a damping across. Where it could, it is a damping in all
directions with the |u| expected: it never pushes backwards, and bounds the friction's work from above, so that solves
go downhill. What has just begun to slide feels its cone's force against the shear.
"""

from dataclasses import dataclass, field

import numpy as np

from ..points import EYE, Points, sym_outer, sym_times
from ..step_start import StepStart
from .active_set import States
from .vertices import VertexContacts

SLOW = 5e-5  # slip [m/s] below which friction holds


@dataclass(frozen=True)
class Sliding:
    """Contacts of an active set that slide.

    Attributes:
        rows: (k,) which contacts of the set do.
        lag: (k,) slip [m/s] at which friction of a contact was taken as a damping; infinite where it was not.
        points: one for each that slides.
    """

    rows: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=bool))
    lag: np.ndarray = field(default_factory=lambda: np.zeros(0))
    points: Points = field(default_factory=Points.none)


def dragged(f: VertexContacts, slides: np.ndarray, begins: np.ndarray, faces: np.ndarray, n: int) -> np.ndarray:
    """(k,) which of the contacts that begin are connected, over edges of the cloth between such, to one that slides on the
    same solid: cloth is stiff, and takes along what would stick by its own motion.

    Args:
        slides, begins: (k,) which of the contacts slide, and which begin.
        faces: (m, 3) particles of the cloth's faces, of n particles.
    """
    out = np.zeros(len(begins), dtype=bool)
    for solid in np.unique(f.solid[begins]).tolist():
        here = f.solid == solid
        may, moves = np.zeros(n, dtype=bool), np.zeros(n, dtype=bool)
        may[f.index[here & begins]], moves[f.index[here & slides]] = True, True
        beside, grows = faces[may[faces].any(axis=1)], True
        while grows:
            near = np.zeros(n, dtype=bool)
            near[beside[moves[beside].any(axis=1)]] = True
            near &= may & ~moves
            moves |= near
            grows = bool(near.any())
        out |= here & begins & moves[f.index]
    return out


def slide(f: VertexContacts, states: States, slip: np.ndarray, friction: np.ndarray, mass: np.ndarray,
          start: StepStart, v: np.ndarray, begins: np.ndarray) -> Sliding:
    """Friction of what slides.

    Args:
        slip: (k, 3) expected velocity against the solid [m/s]; friction: (k,) mu of each contact's solid.
        mass: (n,) [kg]; start: of the attempt; v: (n, 3) velocities that the solve begins with [m/s].
        begins: (k,) whether what slides stuck in the step before: nothing is remembered of its friction, which counts for h.
    """
    rows = ~states.stick & (friction * states.force > 0)
    f, size, u, push = f.take(rows), friction[rows] * states.force[rows], slip[rows], states.push[rows]
    fresh, speed = push.any(axis=1), np.linalg.norm(u, axis=1)
    c = np.where(begins[rows], start.h, start.c)
    stopped = size * c / mass[f.index]  # slip that friction would stop in a step
    fast = ~fresh & (speed > stopped)
    push = np.where(fast[:, None], -u / np.maximum(speed, 1e-30)[:, None], push)
    speed = np.where(fresh, stopped, np.maximum(speed, SLOW))
    lag = np.full(len(rows), np.inf)
    lag[np.flatnonzero(rows)[~fast & ~fresh]] = speed[~fast & ~fresh]
    block = (c * size / speed)[:, None] * (EYE - sym_outer(f.normal) - sym_outer(push))
    against = start.mean(v)[f.index] - (f.carried - start.x[f.index]) / start.h  # slip with which the solve begins
    rhs = (c * size)[:, None] * push - sym_times(block, against)
    return Sliding(rows, lag, Points.at(f.index, start.c / start.h * block, rhs))
