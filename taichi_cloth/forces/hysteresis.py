"""Hysteresis of bending: friction between fibres, and creases.

Beside a hinge's own spring there are springs (k_j) in series with sliders (q_j) that give way at the angles d_j [Jenkins]. In
a step the sliders stay where they are, and the torque and energy are, with z = C - q_j,

T_j = k_j z where |z| <= d_j, else +- k_j d_j,    E_j = k_j z^2/2, else k_j d_j (|z| - d_j/2):

convex, with a continuous torque. After an accepted step the sliders follow: q_j goes as far as |C - q_j| <= d_j again, and
the stored energy falls by k_j d_j |change of q_j|. Two of them:

- friction between fibres: k d = HB |e|, d = SLIP |curvature length|; M = D kappa +- HB [Kawabata 1980];
- creases: k = (1 - H) D-stiffness, d = yield curvature; the hinge's own spring keeps H D, its hardening. A fold by C
  springs back to (1 - H) (C - d).

Folded flat, C levels off .1 rad below pi (`hinge`): creases then follow the angle itself, as far as C. A fold that passes
through itself, by less than a radian in a step, has as much energy on either side: its sliders change theirs with it.

The matrix takes T_j / z at the predicted angle of the step. The slope would be 0 if a slider gives; T_j / z is a
semidefinite bound from above, so that no solve goes further than friction lets it.
"""

import math
from dataclasses import dataclass, fields

import numpy as np

from ..backend.fields import Fields
from ..backend.language import ti
from ..backend.rows import read
from ..scene.cloth import Cloth
from ..scene.fabric import Bend, pair
from ..system.elements import Hinges
from ..system.state import Elements, ParticleState
from .hinge import uncrested

FRICTION, CREASE = range(2)
SLIP = 2.0  # 1/m, the curvature by which fibres turn before they slide
PASSED = math.pi - 1.0  # rad on the other side beyond which a fold is one that passed through itself


@dataclass(frozen=True)
class Sliders:
    """Constants of the sliders of hinges.

    Attributes:
        k: (hinges, 2) stiffness of either spring [N m]; reach: (hinges, 2) d_j [rad].
        own: (hinges,) part of the hinge's stiffness that its own spring keeps.
        recovery: (hinges, 2) rate [1/s] at which creases go back while they are pulled back, and angle that stays [rad].
    """

    k: np.ndarray
    reach: np.ndarray
    own: np.ndarray
    recovery: np.ndarray


def sliders(cloth: Cloth, h: Hinges, rest: np.ndarray, seam: bool) -> Sliders:
    """Constants for a cloth's hinges with rows `rest` (stiffness first); the hinges of a seam have no hysteresis.

    If the two sides differ, friction is their mean, and the softer one says where they yield.
    """
    if seam:
        n = len(rest)
        return Sliders(np.zeros((n, 2)), np.zeros((n, 2)), np.ones(n), np.zeros((n, 2)))
    of, length = cloth.fabric_of[h.faces], np.sqrt(h.length2)
    arc = h.areas.sum(axis=1) / length  # over which a hinge turns: theta = kappa arc
    bends = [f.bend or Bend(1.0) for f in cloth.fabrics]
    friction = np.einsum("hj,hj->h", h.across, np.array([pair(b.friction) for b in bends])[of].mean(axis=1))
    curvature = np.array([np.inf if b.yield_ is None else b.yield_ for b in bends])[of].min(axis=1)
    yields = np.isfinite(curvature)
    own = np.where(yields, np.array([b.hardening for b in bends])[of].mean(axis=1), 1.0)
    rate, stays = np.array([pair(b.recovery) for b in bends])[of].mean(axis=1).T
    k = np.column_stack([friction * length / (SLIP * arc), (1 - own) * rest[:, 0]])
    reach = np.column_stack([SLIP * arc, np.where(yields, curvature, 0.0) * arc])
    return Sliders(k, reach, own, np.column_stack([rate, stays * arc]))


def joined(parts: list[Sliders]) -> Sliders:
    """All of them, one after another."""
    return Sliders(*(np.concatenate([getattr(part, field.name) for part in parts]) for field in fields(Sliders)))


@ti.data_oriented
class Hysteresis:
    """Positions of the sliders of hinges, and their response."""

    def __init__(self, made: Fields, model: ParticleState, elements: Elements, law: Sliders) -> None:
        self.elements, self.own, self.yields = elements, law.own, bool(law.k[:, CREASE].any())
        count = len(law.own)
        self.hinge = made.integer(elements.count, data=elements.per_entry(np.arange(count)))
        self.k, self.reach = made.real(count, 2, law.k), made.real(count, 2, law.reach)
        self.recovery = made.real(count, 2, law.recovery)
        self.recovers = bool(law.recovery[:, 0].any())
        self.positions = model.remember("hinge_sliders", count, 2)

    @ti.func
    def way(self, e):
        """-1 where the sliders of a hinge went below 0, else 1."""
        way = 1.0
        if self.positions.now[self.hinge[e]][ti.static(CREASE if self.yields else FRICTION)] < 0:
            way = -1.0
        return way

    @ti.func
    def side(self, e, C):
        """-1 if a hinge at C is one that passed through itself, else 1."""
        side, way = 1.0, self.way(e)
        if C * way < -PASSED:
            side = -1.0
        return side

    @ti.func
    def respond(self, e, C):
        """(torque, torque over displacement from the sliders, slope, energy) at the condition C."""
        i = self.hinge[e]
        torque, secant, slope, energy = 0.0, 0.0, 0.0, 0.0
        for j in ti.static(range(2)):
            k, d, z = self.k[i][j], self.reach[i][j], C - self.positions.now[i][j]
            size = ti.abs(z)
            if size <= d:
                torque += k * z
                secant += k
                slope += k
                energy += 0.5 * k * z * z
            else:
                torque += k * d * (z / size)
                secant += k * d / size
                energy += k * d * (size - 0.5 * d)
        return torque, secant, slope, energy

    @ti.func
    def return_map(self, e, C, h):
        """The sliders follow a hinge that came to C in a step of h."""
        i, angle, side = self.hinge[e], uncrested(C), self.side(e, C)
        for j in ti.static(range(2)):
            d = self.reach[i][j]
            self.positions.now[i][j] = side * self.positions.now[i][j]
            low, high = C - d, C + d
            if C > 0:
                low = ti.max(low, ti.min(angle - d, C))
            else:
                high = ti.min(high, ti.max(angle + d, C))
            self.positions.now[i][j] = ti.min(ti.max(self.positions.now[i][j], low), high)
        if ti.static(self.recovers):
            q, rate, stays = self.positions.now[i][CREASE], self.recovery[i][0], self.recovery[i][1]
            if (C - q) * q < 0 and ti.abs(q) > stays:
                back = q + (1 - ti.exp(-rate * h)) * (C - q)
                sign = 1.0 if q > 0 else -1.0
                self.positions.now[i][CREASE] = sign * ti.max(sign * back, stays)

    def creases(self) -> np.ndarray:
        """(hinges,) angle [rad] that stays where nothing pulls, but for hardening."""
        return read(self.positions.now)[:, CREASE]
