"""The arithmetic of pairs of cloth, pair by pair in kernels: their laws, how a solve takes them, where it leads them.

Arrays of numbers have a row for each kind of number, named below, and a column for each pair.
"""

import numpy as np

from ...backend.fields import Fields
from ...backend.language import ti
from ...forces.conditions import sym_outer, sym_scaled_identity
from ...options import USUAL
from ...system.state import ParticleState
from ..geometry import EDGE_EDGE
from ..solid.pairs import SETTLING, STIFFER
from .barrier import SHALLOW, height, law, potential
from .collision_mesh import CollisionMesh

STEEP = 4.0  # size of a turn from which on friction fades: edges near parallel would turn each other by large normal forces
FLAT = 1e-6  # over that: from which on there is none
REPULSION = 12.0  # stiffness of a pair over mass / h^2, h = USUAL whatever the step, so that resting layers lie as near
STOP = 30.0  # the same of the stop of an approach, h this step
CONE = 1.02  # times the most that friction can be, above which a damped pair slides; with 1 a sheet at 60 m/s takes 42 steps
# for 40 (five starts), `twist` 190 solves for 184, `layers` 121 for 128
CREEP = 2e-5  # slip [m/s] by which friction between layers changes from nothing to all of it, while they stick

# of a pair as it is: the mass that its distance has [kg], its stiffness [N/m], its distance where the step began, along its
# normal [m], its force [N], its potential [J], the most that its friction can be over its force
OWN, STIFF, BEGAN, NOW, POTENTIAL, MU, WEIGHED = range(7)
# as a solve takes it: force [N] and slope [N/m] at a distance [m]; the most that friction can be [N], friction over slip
# [N s/m], from WAY on the direction of the slip of a sliding pair, 0 for one that sticks, and from OFFSET on the slip [m/s]
# that friction counts besides, see `linearize`
FORCE, SLOPE, AT, BEARS, DRAG, WAY, OFFSET, TAKEN = 0, 1, 2, 3, 4, 5, 8, 11
# and as that led it: distance along its normal [m], size of friction [N], 1 where that pushes forwards
GAP, RUBBED, BACK, LED = range(4)


@ti.data_oriented
class PairKernels:
    """Pairs of a model's cloths.

    Args:
        mesh: of the cloths; friction: (n,) square roots of the particles' coefficients.
    """

    def __init__(self, fields: Fields, model: ParticleState, mesh: CollisionMesh, friction: np.ndarray) -> None:
        self.model, self.mesh = model, mesh
        self.friction = fields.real(model.n, data=friction)

    @ti.kernel
    def evaluate(self, pair: ti.types.ndarray(), vertices: ti.types.ndarray(), weights: ti.types.ndarray(),
                 normals: ti.types.ndarray(), end: ti.types.ndarray(), radius: ti.types.ndarray(), factor: ti.types.ndarray(),
                 boost: ti.types.ndarray(), h: float, out: ti.types.ndarray(), rotation_coupling: ti.types.ndarray()):
        """Pairs as they are, and their `rotation_coupling` (k, 4, 3); `boost` (n,) factors of the particles' stiffness."""
        for k in range(vertices.shape[0]):
            light, more = 0 * weights[k, 0], boost[vertices[k, 0]]
            for a in ti.static(range(4)):
                light += weights[k, a] ** 2 / self.model.m[vertices[k, a]]
                more = ti.max(more, boost[vertices[k, a]])
            own = 1 / ti.max(light, 1e-30)
            stiff = ti.static(REPULSION / USUAL**2) * own * factor[k] * more
            n = row_of(normals, k)
            began = n.dot(self.at(vertices, weights, k, self.model.x_saved))
            counts = self.turn(pair[k, 2], vertices, k, n, end[k], rotation_coupling)
            shift = self.shift(vertices, weights, k, radius[k])
            force, slope = self.pull(end[k], radius[k], shift, began, stiff, own, factor[k], h)
            out[OWN, k], out[STIFF, k], out[BEGAN, k], out[NOW, k] = own, stiff, began, force
            out[MU, k] = self.friction[vertices[k, 0]] * self.friction[vertices[k, 3]] * counts
            out[POTENTIAL, k] = stiff * potential(end[k], radius[k], shift)

    @ti.kernel
    def linearize(self, vertices: ti.types.ndarray(), weights: ti.types.ndarray(), normals: ti.types.ndarray(),
                  end: ti.types.ndarray(), radius: ti.types.ndarray(), factor: ti.types.ndarray(), weighed: ti.types.ndarray(),
                  rotation_coupling: ti.types.ndarray(), h: float, c: float, first: int, base: ti.types.ndarray(),
                  there: ti.types.ndarray(), last_force: ti.types.ndarray(), rubbed: ti.types.ndarray(),
                  slipped: ti.types.ndarray(), row: ti.types.ndarray(),
                  before: ti.types.ndarray(), out: ti.types.ndarray(),
                  block: ti.types.ndarray(), rhs: ti.types.ndarray()):
        """Pairs as a solve takes them that begins at base (n, 3), and their blocks (k, 6) and right-hand sides (k, 3).

        Args:
            h, c: step; factor by which the method multiplies forces [s].
            first: 1 in a step's first solve.
            there: (n, 3) where slip is looked at.
            last_force: (k,) normal forces [N] of the last solve, negative where that is not known.
            rubbed: (k, 3) friction [N] with which the last step ended, 0 for new pairs: without slip it stays as it is.
            slipped: (k,) the slip [m/s] with which pairs that stuck ended that step; infinite for others.
            row: (k,) their columns of `before`, from the last solve, or -1.
        """
        for k in range(vertices.shape[0]):
            n = row_of(normals, k)
            own, stiff, began = weighed[OWN, k], weighed[STIFF, k], weighed[BEGAN, k]
            shift = self.shift(vertices, weights, k, radius[k])
            at = self.where(end[k], radius[k], shift, began, first)
            force, slope = self.pull(at, radius[k], shift, began, stiff, own, factor[k], h)
            moved, slip, v = 0 * n, 0 * n, self.at(vertices, weights, k, self.model.v_saved)
            for a in ti.static(range(4)):
                i = vertices[k, a]
                x = self.model.x_saved[i]
                now, then = row_of(base, i) - x, row_of(there, i) - x
                w, turn = weights[k, a], turn_of(rotation_coupling, k, a)
                moved += w * now + n.dot(now) * turn
                slip += (w * then + n.dot(then) * turn) / h
            slip -= n.dot(slip) * n
            expected = last_force[k]
            if expected < 0:  # no more than stops those that are new
                repelled, _ = law(at, radius[k], shift)
                expected = ti.min(stiff * repelled, own / h**2 * ti.max(radius[k] - began - h * n.dot(v), 0.0))
            bears = weighed[MU, k] * expected
            offset = -CREEP / ti.max(bears, 1e-30) * row_of(rubbed, k)
            offset -= n.dot(offset) * n
            offset *= ti.min(1.0, CREEP / ti.max(offset.norm(), 1e-30))
            slip += offset
            speed = slip.norm()
            way = self.slip_direction(slip, speed, bears, row[k], before)
            if own * speed <= h * bears:  # friction can stop it within the step: it is to stick harder than it did
                speed = ti.min(speed, slipped[k] / STIFFER)
            drag = bears / ti.max(speed, CREEP)
            out[FORCE, k], out[SLOPE, k], out[AT, k], out[BEARS, k], out[DRAG, k] = force, slope, at, bears, drag
            normal_step = n.dot(moved)
            across = moved - normal_step * n - way.dot(moved) * way
            rub = c / h * drag  # slip is the step's mean
            push = c * (force + slope * (at - began - normal_step)) * n - rub * across - c * bears * way
            push -= c * drag * (offset - offset.dot(way) * way)
            for a in ti.static(range(3)):
                out[WAY + a, k], out[OFFSET + a, k] = way[a], offset[a]
                rhs[k, a] = push[a]
            both = sym_scaled_identity(c * rub) + (c**2 * slope - c * rub) * sym_outer(n) - c * rub * sym_outer(way)
            for b in ti.static(range(6)):
                block[k, b] = both[b]

    @ti.kernel
    def measure(self, vertices: ti.types.ndarray(), weights: ti.types.ndarray(), normals: ti.types.ndarray(),
                rotation_coupling: ti.types.ndarray(), taken: ti.types.ndarray(), h: float, out: ti.types.ndarray()):
        """Pairs that a solve took, where the model now is."""
        for k in range(vertices.shape[0]):
            n, way = row_of(normals, k), ti.Vector([taken[WAY + c, k] for c in ti.static(range(3))])
            x = self.at(vertices, weights, k, self.model.x)
            slip = (x - self.at(vertices, weights, k, self.model.x_saved)) / h
            for a in ti.static(range(4)):
                i = vertices[k, a]
                slip += n.dot(self.model.x[i] - self.model.x_saved[i]) / h * turn_of(rotation_coupling, k, a)
            slip += ti.Vector([taken[OFFSET + c, k] for c in ti.static(range(3))]) - n.dot(slip) * n
            along = slip.dot(way)
            out[GAP, k] = n.dot(x)
            out[RUBBED, k] = (taken[BEARS, k] * way + taken[DRAG, k] * (slip - along * way)).norm()
            out[BACK, k] = ti.select(along < 0, 1.0, 0.0)

    @ti.func
    def at(self, vertices: ti.template(), weights: ti.template(), k, rows: ti.template()):
        """The pair's difference of values of the particles."""
        return (weights[k, 0] * rows[vertices[k, 0]] + weights[k, 1] * rows[vertices[k, 1]]
                + weights[k, 2] * rows[vertices[k, 2]] + weights[k, 3] * rows[vertices[k, 3]])

    @ti.func
    def shift(self, vertices: ti.template(), weights: ti.template(), k, radius):
        """How much further away [m] than its distance the pair begins to repel."""
        w = ti.Vector([weights[k, a] for a in ti.static(range(4))])
        return radius * self.mesh.shift_part(ti.Vector([vertices[k, a] for a in ti.static(range(4))]), w)

    @ti.func
    def turn(self, kind, vertices: ti.template(), k, n, d, rotation_coupling: ti.template()):
        """Works out a pair's t_a, `rotation_coupling`; part of its friction that it keeps.

        Slip is w . v + sum_a t_a (n . v_a). The t_a add up to 0 on either side, and t_a x_a^T to d (I - n n^T): a
        pair that turns as one does not slip. Friction, which acts at two places a distance d apart, does not turn the pair.
        """
        p, q = self.model.x[vertices[k, 0]], self.model.x[vertices[k, 1]]
        a, b = self.model.x[vertices[k, 2]] - q, self.model.x[vertices[k, 3]] - q  # of the face
        if kind == EDGE_EDGE:
            a, b = q - p, self.model.x[vertices[k, 3]] - self.model.x[vertices[k, 2]]
        over_a, over_b, area = d * b.cross(n), d * n.cross(a), n.dot(a.cross(b))
        counts, steep = 0.0, ti.max(over_a.norm(), over_b.norm())
        if STEEP * ti.abs(area) > FLAT * steep:
            counts = ti.min(1.0, (STEEP * area / ti.max(steep, 1e-30)) ** 2)
            over_a /= area
            over_b /= area
        else:
            over_a, over_b = 0 * over_a, 0 * over_b
        for c in ti.static(range(3)):
            rotation_coupling[k, 0, c] = ti.select(kind == EDGE_EDGE, -over_a[c], 0.0)
            rotation_coupling[k, 1, c] = ti.select(kind == EDGE_EDGE, over_a[c], -over_a[c] - over_b[c])
            rotation_coupling[k, 2, c] = ti.select(kind == EDGE_EDGE, -over_b[c], over_a[c])
            rotation_coupling[k, 3, c] = over_b[c]
        return counts

    @ti.func
    def where(self, end, radius, shift, began, first):
        """Distance [m] at which a pair is linearised: where it is, and in a first solve no nearer than it began, or than half
        of the distance it should keep."""
        least = SHALLOW * radius
        if first == 1:
            least = ti.min(ti.max(began, height(SHALLOW, radius)), height(0.5, radius))
        return ti.min(ti.max(end, least), radius + shift)

    @ti.func
    def pull(self, d, radius, shift, began, stiff, own, factor, h):
        """(force [N], slope [N/m]) of a pair at a distance d: repulsion, and the stop of its approach.

        A pair that comes nearer than at the start of the step, and than it should, is stopped by a stiffness that goes with
        this step's own h. It acts within the step alone, and so gives no speed back.
        """
        force, slope = law(d, radius, shift)
        most, stop = limit(began, radius, h), STOP * own * factor / h**2
        if d >= most:
            stop *= 0
        return stiff * force + stop * (most - d), stiff * slope + stop

    @ti.func
    def slip_direction(self, slip, speed, bears, row, before: ti.template()):
        """Direction of the slip of a sliding pair; 0 for a pair that sticks.

        Friction of a sliding pair has its full size, against that direction. Friction of one that sticks is a damping by its
        last slip: it never pushes backwards, and bounds friction's work from above. A pair slides once the damping is more
        than Coulomb's bound. It sticks again when its slip reverses. Slip counts from that at which friction would be what it
        was at the end of the last step: pairs that stick do not creep.
        """
        way = 0 * slip
        if row >= 0 and bears > 0:
            was = ti.Vector([before[WAY + c, row] for c in ti.static(range(3))])
            slides = before[DRAG, row] * speed > CONE * before[BEARS, row]
            if was.norm_sqr() > 0:
                slides = slip.dot(was) > 0
            if slides:
                way = slip / ti.max(speed, 1e-30)
        return way


@ti.func
def limit(began, radius, h):
    """Distance [m] below which a pair is stopped."""
    return ti.min(ti.max(began - SETTLING * h * radius, height(2 * SHALLOW, radius)), radius)


@ti.func
def turn_of(rotation_coupling: ti.template(), k, a: ti.template()):
    """Row (k, a) of (., 4, 3) as a vector."""
    return ti.Vector([rotation_coupling[k, a, 0], rotation_coupling[k, a, 1], rotation_coupling[k, a, 2]])


@ti.func
def row_of(rows: ti.template(), k):
    """Row k of (., 3) as a vector."""
    return ti.Vector([rows[k, 0], rows[k, 1], rows[k, 2]])
