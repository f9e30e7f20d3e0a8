"""The law of contact with solids, and the states of contacts that follow from it. numpy only.

A contact puts an impulse p on its particle, in a step of c [s]. Its gap d [m] at the end and its slip u [m/s] satisfy the law
if, for any positive m and r [kg],

    p_n = max(0, p_n - m d/c),    p_t = (p_t - r u) min(1, mu p_n / |p_t - r u|):

Then no contact pulls, no particle is inside, and an open contact carries no load. A contact whose friction is less than mu p_n
sticks; one that slides has as much against its slip [Alart and Curnier 1991]. Inserting the p of a linear solve on the right
gives the states in the next one: open, sticking or sliding. With a pure active set one row of a cloth begins to slip in
each solve. With layers, and with `contact_tol`, friction is therefore viscous in the second solve (`SMOOTH`), if more contacts
begin to slide than to stick in the first.

Solutions are the same with any r, but not the way to them. With the particle's own mass a taut rope round a bar never settles.
r is the effective inertia of the particle in the cloth, `System.inertia`.
"""

from dataclasses import dataclass, fields

import numpy as np

from ..points import EYE, length, rows_of, sym_outer, tangential
from .vertices import VertexContacts

SMOOTH = 0.01  # slip [m/s] below which friction is viscous, in one solve. .1, .03 and three falling ones take more solves
MOST = 0.999  # largest part of the friction bound in the linearization: with all of it drag would be infinite
EXACT = 1e-12  # m: smaller gaps count as 0


@dataclass(frozen=True)
class Rows:
    """The states of contacts in a linear solve, sorted by key. A sticking one is held; a sliding or viscous one feels

        p_t = mu p_n d - drag (u across d),    d = 0 where it is viscous.

    Attributes:
        key: (k,) particle and solid.
        stick: (k,) whether all directions are held.
        normal: (k,) normal impulse p_n [N s] that bounds friction.
        push: (k, 3) d, the direction of friction on a sliding contact; 0 elsewhere.
        drag: (k,) [kg].
    """

    key: np.ndarray
    stick: np.ndarray
    normal: np.ndarray
    push: np.ndarray
    drag: np.ndarray

    def take(self, which: np.ndarray) -> "Rows":
        """Some of them."""
        return Rows(*(getattr(self, f.name)[which] for f in fields(self)))

    def of(self, key: np.ndarray) -> tuple[np.ndarray, "Rows"]:
        """(whether each wanted key is among them, its row; 0 where it is not)."""
        row = rows_of(self.key, key)
        known, row = row >= 0, np.maximum(row, 0)
        if not len(self.key):
            k = len(key)
            return known, Rows(key, np.zeros(k, dtype=bool), np.zeros(k), np.zeros((k, 3)), np.zeros(k))
        old = self.take(row)
        return known, Rows(key, old.stick & known, old.normal * known, old.push * known[:, None], old.drag * known)

    def blocks(self, normals: np.ndarray) -> np.ndarray:
        """(k, 6) drag across the normals (k, 3) and d [kg]."""
        return self.drag[:, None] * (EYE - sym_outer(normals) - sym_outer(self.push))


def smoothed(key: np.ndarray, cone: np.ndarray, normal: np.ndarray, slip: np.ndarray, smooth: float) -> Rows:
    """Rows by Coulomb's law with viscous friction below a slip of `smooth` [m/s].

    Args:
        cone: (k,) mu p_n [N s]; normal: (k,) p_n; slip: (k, 3) [m/s].
    """
    speed = length(slip)
    slides = (speed >= smooth) & (cone > 0)
    push = np.where(slides[:, None], -slip / np.maximum(speed, 1e-300)[:, None], 0.0)
    return Rows(key, np.zeros(len(key), dtype=bool), normal, push, cone / np.maximum(speed, smooth))


def tangential_impulses(f: VertexContacts, was: Rows, slip: np.ndarray, held: np.ndarray) -> np.ndarray:
    """(k, 3) tangential impulses [N s] that a linear solve took, which ended with slip (k, 3) [m/s].

    Args:
        held: (k, 3) impulses on held contacts, by the solve.
    """
    cone = f.friction * was.normal
    along = np.einsum("ki,ki->k", slip, was.push)
    slid = cone[:, None] * was.push - was.drag[:, None] * (slip - along[:, None] * was.push)
    slid *= (cone / np.maximum(np.maximum(length(slid), cone), 1e-300))[:, None]
    return np.where(was.stick[:, None], tangential(held, f.normal), slid)


def project_to_coulomb(f: VertexContacts, was: Rows, slip: np.ndarray, held: np.ndarray, normal: np.ndarray, mass: np.ndarray,
                       inertia: np.ndarray, c: float) -> tuple[Rows, np.ndarray, np.ndarray]:
    """Projects the result of a linear solve to the law, by the formulas of the module.

    Args:
        f: contacts where it ended, with their gaps; was: their states in it; slip: (k, 3) there [m/s].
        held: (k, 3) impulses [N s] on held contacts; normal: (k,) along the normals.
        mass, inertia: (k,) m and r of the rule, of the particles [kg].

    Returns:
        (their next states, impulses (k, 3) by the law, whether they bear anything).
    """
    gap = np.where(np.abs(f.gap) < EXACT, 0.0, f.gap)
    p_n = np.maximum(normal - mass * gap / c, 0.0)
    cone, rubs = f.friction * p_n, f.friction > 0
    tau = tangential_impulses(f, was, slip, held) - inertia[:, None] * slip
    size = length(tau)
    back = was.push.any(axis=1) & (np.einsum("ki,ki->k", slip, was.push) > 0)  # slip is now along friction: it has reversed
    slides = (size > cone * (1 + 1e-9)) & ~back
    part = np.minimum(1, cone / np.maximum(size, 1e-300))
    push = np.where(slides[:, None], tau / np.maximum(size, 1e-300)[:, None], 0.0)
    edge = np.minimum(part, MOST)
    rows = Rows(f.key, ~slides & rubs, p_n, push * rubs[:, None], np.where(slides & rubs, inertia * edge / (1 - edge), 0.0))
    across = np.where(rubs[:, None], part[:, None] * tau, 0.0)
    bears = p_n > 0
    return rows, np.where(bears[:, None], p_n[:, None] * f.normal + across, 0.0), bears
