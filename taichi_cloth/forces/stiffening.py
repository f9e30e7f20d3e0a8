"""Stiffening: tension of a fabric beyond k C, from curves of measured cloth and limits of strain.

With s the size of a condition (|w_u|, |w_v| or, in shear, |C|), s_j the strains at which a curve bends, and L the limit:

T = sum_j a_j max(s - s_j, 0) + q max(s - L, 0)^2, which has the energy sum_j a_j/2 max(s - s_j, 0)^2 + q/3 max(s - L, 0)^3:

convex, with a continuous slope where a limit begins and a step in it where a curve bends.
"""

from dataclasses import dataclass

import numpy as np

from ..backend.fields import Fields
from ..backend.language import ti
from ..scene.fabric import STIFFER, Fabric, Stretch, pair

WARP, WEFT, SHEAR = range(3)
NEVER = 1e30  # a limit that nothing comes to
REACHED = 0.1  # of the way from rest to a limit that fabric is expected to go beyond it: bounds for explicit steps


@dataclass(frozen=True)
class Law:
    """The law of one material in one direction.

    Attributes:
        bends: (s_j, a_j) of each; limit: L; q [N/m]; way: from rest to the limit.
    """

    bends: tuple[tuple[float, float], ...] = ()
    limit: float = NEVER
    q: float = 0.0
    way: float = 0.0

    @property
    def tangent(self) -> float:
        """The largest stiffness that is expected beyond k [N/m]."""
        return sum(a for _, a in self.bends) + 2 * self.q * REACHED * self.way


@ti.data_oriented
class Stiffening:
    """The laws of materials, a row for each of them in each of warp, weft and shear.

    Attributes:
        limits: whether there is one.
    """

    def __init__(self, fields: Fields, fabrics: list[Fabric]) -> None:
        rows = [laws(f) for f in fabrics]
        self.pieces = max(len(law.bends) for row in rows for law in row)
        self.limits = any(law.limit < NEVER for row in rows for law in row)
        width = 2 + 2 * self.pieces
        table = np.zeros((len(rows), 3, width))
        for m, row in enumerate(rows):
            for axis, law in enumerate(row):
                table[m, axis, :2] = law.limit, law.q
                for j, bend in enumerate(law.bends):
                    table[m, axis, 2 + 2 * j: 4 + 2 * j] = bend
        self.tangent = np.array([[law.tangent for law in row] for row in rows])
        self.table = fields.real(3 * len(rows), width, table.reshape(-1, width))

    @ti.func
    def used(self, material, axis: ti.template(), s, rest):
        """Strain over its limit at the size s, both from rest on: 1 at the limit."""
        return (s - rest) / (self.table[3 * material + axis][0] - rest)

    @ti.func
    def beyond(self, material, axis: ti.template(), s):
        """(tension, its slope, its energy) at the size s."""
        law = self.table[3 * material + axis]
        over = ti.max(s - law[0], 0.0)
        force, slope, energy = law[1] * over * over, 2 * law[1] * over, law[1] / 3 * over * over * over
        for j in ti.static(range(self.pieces)):
            up = ti.max(s - law[2 + 2 * j], 0.0)
            force += law[3 + 2 * j] * up
            energy += 0.5 * law[3 + 2 * j] * up * up
            if up > 0:
                slope += law[3 + 2 * j]
        return force, slope, energy


def stiffens(fabric: Fabric) -> bool:
    """Whether a fabric has more than k C."""
    return any(law.bends or law.limit < NEVER for law in laws(fabric))


def laws(fabric: Fabric) -> tuple[Law, Law, Law]:
    """The laws of warp, weft and shear."""
    warp = weft = shear = Law()
    if fabric.stretch:
        warp, weft = (_of_stretch(fabric.stretch, axis) for axis in (WARP, WEFT))
    if fabric.shear and fabric.shear.limit is not None:
        shear = Law((), fabric.shear.limit, STIFFER * fabric.shear.k / fabric.shear.limit, fabric.shear.limit)
    return warp, weft, shear


def _of_stretch(stretch: Stretch, axis: int) -> Law:
    b = pair(stretch.b)[axis]
    bends: tuple[tuple[float, float], ...] = ()
    if stretch.curve is not None:
        strain, tension = np.array(stretch.curve_of(axis)).T
        slopes = np.diff(tension) / np.diff(strain)
        bends = tuple(zip((b + strain[1:-1]).tolist(), np.diff(slopes).tolist()))
    if stretch.limit is None:
        return Law(bends)
    limit = pair(stretch.limit)[axis]
    return Law(bends, limit, STIFFER * stretch.k_of(axis) / (limit - b), limit - b)
