"""Additive multilevel preconditioner: block Jacobi, and the same on lattices over the cloth. [Bramble, Pasciak, Xu 1990]

    P^-1 = S (B^-1 + sum over levels of c_l Q_l B_l^-1 Q_l^T) S

Q_l interpolates from the nodes of level l to the particles, B_l is the block diagonal of Q_l^T A Q_l, summed up from
the elements without assembling A. Hats end where particles are held in all directions; air drag is left out, and hinges
count with their trace, as they are in flat cloth and as if nothing were held. In scenes with contact a node's block also
counts its held particles' own blocks in the directions that are held.
Symmetric positive definite by its form, for any mesh. Values pass from level to level, so that a cycle costs little
more than the finest one.

Differs from Bramble, Pasciak and Xu: the factors c_l, in scenes with contact. Levels overlap, and a wide hat fits the motion
of curved or pressed cloth less well.
"""

from collections.abc import Callable

import numpy as np

from ..backend.dealing import Dealer
from ..backend.fields import Fields
from ..backend.language import ti
from ..backend.runtime import for_device
from ..forces.conditions import sym, sym_scaled_identity, sym_times, sym_unpack
from ..scene.scene import Scene
from ..system.checkpoint import Checkpointed
from ..system.held import Held
from ..system.operator import Operator
from .coarse import Coarse, most_nodes
from .device_coarse import DeviceCoarse
from .hierarchy import Hierarchy, LevelFields, links, material
from .lattice import levels
from .pointwise import Pointwise

COUNTS, FADE = 0.6, 0.85  # c of the finest level, and of each over that of the one below; 1 for a level solved exactly
ALIKE = 0.02, 0.1  # parts of all particles, and of those then held, that others may be held of, where contact holds them
MOST_EXACT = 1000  # nodes of a level that is solved exactly: the time grows with their cube, here to seconds
WORTH = 15  # iterations that making the levels costs: they are made anew when age has cost as many
LONGEST = 31  # solves in which levels are made anew every time, after they have not lasted
NOTHING = 1e-24  # trace [kg] of a node's block below which it says nothing


class Age(Checkpointed):
    """Whether levels that were made for an earlier system do for this one.

    Attributes:
        made_for: (k,) numbers that describe the held particles then, and the effective step c [s] last.
        cost: iterations of the first solve with new levels; excess: iterations beyond that in all solves since; kept: these.
        wait: solves for which levels are still made anew each time; pause: how many these were at first. The pause doubles
            each time that levels did not last for two solves.
    """

    STATE = ("made_for", "cost", "excess", "kept", "wait", "pause")

    def __init__(self) -> None:
        self.made_for: np.ndarray = np.zeros(0)
        self.cost = self.excess = self.kept = self.wait = self.pause = 0

    def allows(self, wanted: np.ndarray, most: float = 0.0) -> bool:
        """Whether the levels serve one more solve.

        Args:
            wanted: (k,) as `made_for`, for the new system; the last must be the same.
            most: how many of the others may differ.
        """
        if len(wanted) != len(self.made_for) or wanted[-1] != self.made_for[-1]:
            return False
        if np.count_nonzero(wanted != self.made_for) > most:
            return False
        if not self.wait and self.excess <= WORTH:
            self.kept += 1
            return True
        if self.wait:
            self.wait -= 1
        else:  # levels that did not last for two solves are not kept again at once
            self.pause = min(2 * self.pause + 1, LONGEST) if self.kept < 2 else 0
            self.wait = self.pause
        return False

    def begin(self, made_for: np.ndarray) -> None:
        """The levels are made anew."""
        self.made_for, self.cost, self.excess, self.kept = made_for, 0, 0, 0

    def count_iterations(self, iterations: int) -> None:
        """Counts the iterations of a solve."""
        self.cost = self.cost or iterations
        self.excess += max(iterations - self.cost, 0)


@ti.data_oriented
class Multilevel(Checkpointed):
    """Block Jacobi on the particles and on every level; `sweep` applies it to all of a field at once."""

    pointwise = False
    STATE = ("inverse_l", "summed", "age", "coarsest")

    def __init__(self, fields: Fields, operator: Operator, scene: Scene, tell: Callable[[str], None]) -> None:
        model = operator.model
        edges = np.concatenate([np.linalg.norm(np.diff(c.mesh.corner_uv, axis=1), axis=2).ravel() for c in scene.cloths])
        self.exact = model.sewn is not None
        most = most_nodes(model.n) if self.exact else 0
        made = levels(*material(scene, model), float(np.median(edges)), links(scene, model), most)
        if self.exact and made[-1].count > MOST_EXACT:
            self.exact = False
            tell(f"preconditioner: its coarsest level has {made[-1].count:,} nodes, too many to be solved exactly, for as "
                 "many pieces of cloth: solves may take longer")
        self.jacobi, self.operator = Pointwise(fields, operator), operator
        self.hats = Hierarchy(fields, made, model.n)
        self.dealer = Dealer(fields, model.blocks, self.hats.start[-1])
        self.blocks = model.blocks.count
        self.inverse_l, self.summed = (fields.real(self.hats.start[-1], 6) for _ in range(2))
        self.own = fields.real(model.n, 6)  # of particles, for all nodes that meet them: masses and contacts, as they are held
        self.age = Age()
        self.forces = operator.forces
        self.contact = next((f for f in self.forces if f.of_contact), None)
        self.has_contact = self.contact is not None
        counts: np.ndarray = np.ones(len(made))
        if self.has_contact:
            self.T = fields.real(model.n, 6)
            counts = COUNTS * FADE ** np.arange(len(made))
        self.counts = fields.real(self.hats.start[-1], data=np.repeat(counts, [level.count for level in made]))
        for force in self.forces:
            force.build_levels(LevelFields(fields, made, model.blocks.count))
        self.coarsest: Coarse | None = None
        if self.exact:
            faces = np.concatenate([model.particle[c.mesh.faces + c.start] for c in scene.cloths])
            coarse = DeviceCoarse if for_device() else Coarse
            self.coarsest = coarse(fields, operator, self.jacobi, made[-1], self.hats.start[-2], faces, tell)

    def make(self, c: float, held: Held | None, reuse_levels: bool = False) -> None:
        """Prepares for the system A = M - c D - c^2 K as it is linearized.

        Args:
            c: effective step [s].
            held: the held directions.
            reuse_levels: whether levels of an earlier system may serve until they have aged.
        """
        self.jacobi.make(c, held)
        if self.has_contact:
            self._contact_diagonal()
        if self.coarsest is not None:
            self.coarsest.make(c, self.T if self.has_contact else None)
        made_for = np.append(self._held_numbers(held), np.float32(c))  # without its last digits
        anew = not (reuse_levels and self.age.allows(made_for, self._others()))
        if anew:
            self.age.begin(made_for)
        if anew or self.has_contact:
            self._make_levels(c, int(anew))

    def _others(self) -> float:
        """Number of particles that may have become held, or free, since the levels were made; levels still hold the latter."""
        held = np.count_nonzero(self.age.made_for[:-1])
        return min(ALIKE[0] * self.operator.model.n, ALIKE[1] * held) if self.has_contact else 0.0

    def _held_numbers(self, held: Held | None) -> np.ndarray:
        """Numbers that the levels depend on: the held particles, and without contact also their projectors."""
        if self.has_contact:
            out = np.zeros(self.operator.model.n)
            out[() if held is None else held.index] = 1
            return out
        return np.zeros(0) if held is None else np.column_stack([held.index, held.projector.reshape(-1, 9)]).ravel()

    def forget(self) -> None:
        """Drops the levels: the next `make` makes them anew."""
        self.age.made_for = np.zeros(0)
        if self.coarsest is not None:
            self.coarsest.span = 0.0

    def count_iterations(self, iterations: int) -> None:
        """Iterations of the first solve after `make`: how well the levels still do."""
        self.age.count_iterations(iterations)
        if self.coarsest is not None:
            self.coarsest.count_iterations(iterations)

    @ti.func
    def average(self, i, q: ti.template()):
        """The seams' part of S."""
        return self.jacobi.average(i, q)

    @ti.func
    def filter(self, i, r):
        """S_i r_i [BW98 §5.3]"""
        return self.jacobi.filter(i, r)

    @ti.func
    def apply(self, i, r):
        """The particles' own part of s_i."""
        return self.jacobi.apply(i, r)

    @ti.func
    def norm_sqr(self, i, x):
        """x_i . P_i x_i"""
        return self.jacobi.norm_sqr(i, x)

    @ti.kernel
    def _contact_diagonal(self):
        """T = diagonal blocks of the points of contact."""
        ti.loop_config(serialize=self.operator.blocks.serial)
        for i in range(self.operator.model.rows()):
            self.T[i] = ti.Vector.zero(float, 6)
        for t in range(self.operator.blocks.count * self.operator.blocks.grain):
            if t % self.operator.blocks.grain == 0:
                self.contact.add_diagonal(t // self.operator.blocks.grain, self.T)

    @ti.kernel
    def _make_levels(self, c: float, anew: int):
        """Inverts the nodes' diagonal blocks: elements, summed up `anew` or as they were, masses, and current contacts."""
        for i in range(self.operator.model.rows()):
            own = sym_scaled_identity(self.operator.model.m[i])
            if ti.static(self.has_contact):
                own += self.T[i]
            self.own[i] = self.seen(i, own)
            if ti.static(self.has_contact):
                self.own[i] = self.own[i] + self.kink(i)
        self.dealer.begin()
        for t in range(self.dealer.tasks):
            if t % self.dealer.grain == 0:
                n = self.hats.size[2] - 1 - self.dealer.next()  # those of wide hats take longest: first
                while n >= 0:
                    if anew == 1:
                        self.summed[n] = self.element_block(n, c)
                    self.inverse_l[n] = self.inverse_block(n)
                    n = self.hats.size[2] - 1 - self.dealer.next()

    @ti.func
    def element_block(self, n, c):
        """The elements' part of a node's block, over free particles. If hats meet only seams, the cloth on the other side
        counts by the particles' blocks."""
        D = ti.Vector.zero(float, 6)
        if ti.static(self.jacobi.sews):
            for k in range(self.hats.particles.first[n], self.hats.particles.first[n + 1]):
                i = self.hats.particles.source[k]
                if self.jacobi.sewn.of[i] >= 0:
                    D += self.hats.particle_weight[k] ** 2 * self.seen(i, self.jacobi.block(i))
        for k in ti.static(range(len(self.forces))):
            D = self.forces[k].add_level_block(n, c, D, self)
        return D

    @ti.func
    def inverse_block(self, n):
        """c_l B_l^-1 of a node; 0 if all that it meets is held."""
        D, out = self.summed[n], ti.Vector.zero(float, 6)
        for k in range(self.hats.particles.first[n], self.hats.particles.first[n + 1]):
            D += self.hats.particle_weight[k] ** 2 * self.own[self.hats.particles.source[k]]
        size = D[0] + D[3] + D[5]
        if size > NOTHING:
            D = D / size + sym_scaled_identity(1e-6)  # of size 1: its determinant is no rounding in f32 either
            out = self.counts[n] / size * sym(sym_unpack(D).inverse())
        return out

    @ti.func
    def seen(self, i, block):
        """S_i block S_i, 0 if particle i is held in all directions."""
        out = self.free(i) * block
        if ti.static(self.has_contact):
            if self.partly(i):
                S = sym_unpack(self.jacobi.S[i])
                out = sym(S @ sym_unpack(block) @ S)
        return out

    @ti.func
    def kink(self, i):
        """C_i P_i C_i with C = I - S: how much a hat bends cloth where it ends at what holds particle i."""
        out = ti.Vector.zero(float, 6)
        if self.jacobi.is_held[i] == 1:
            C = ti.Matrix.identity(float, 3) - sym_unpack(self.jacobi.S[i])
            out = sym(C @ sym_unpack(self.operator.P[i]) @ C)
        return out

    @ti.func
    def hat(self, n, i):
        """The hat of node n at particle i."""
        return self.hats.hat(n, i)

    @ti.func
    def free(self, i):
        """1, or 0 for a particle that is held in all directions: hats end there."""
        out = 1.0
        if self.jacobi.is_held[i] == 1:
            S = self.jacobi.S[i]
            if S[0] + S[3] + S[5] < 0.5:
                out = 0.0
        return out

    @ti.func
    def add_diagonal(self, n, D, blocks: ti.template()):
        """D + sum_i w_i^2 blocks_i over the particles i that node n's hat w meets and that are not held."""
        for k in range(self.hats.particles.first[n], self.hats.particles.first[n + 1]):
            i = self.hats.particles.source[k]
            w = self.hats.particle_weight[k]
            D += w * w * self.free(i) * blocks[i]
        return D

    @ti.func
    def partly(self, i):
        """Whether a particle is held in one or two directions."""
        out = False
        if self.jacobi.is_held[i] == 1:
            S = self.jacobi.S[i]
            out = S[0] + S[3] + S[5] >= 0.5
        return out

    @ti.func
    def shape(self, i, w):
        """w S_i, the motion of particle i with a node whose hat is w there."""
        out = sym_scaled_identity(w)
        if self.jacobi.is_held[i] == 1:
            out = w * self.jacobi.S[i]
        return sym_unpack(out)

    @ti.func
    def sweep(self, r: ti.template(), going):
        """The levels' part for a filtered r, level by level: afterwards `correction(i)` has it for every particle. Nothing if
        not `going`."""
        for n in range(self.hats.size[0]):
            if going == 1:
                self.hats.restrict(n, r)
        for level in ti.static(range(1, len(self.hats.start) - 1)):
            for n in range(self.hats.start[level], self.hats.start[level + 1]):
                if going == 1:
                    self.hats.restrict(n, self.hats.r)
        if ti.static(self.exact):
            for n in range(self.hats.size[1], self.hats.size[2]):
                if going == 1:
                    self.solve_exactly(n)
        for level in ti.static(range(len(self.hats.start) - 2, 0, -1)):
            for n in range(self.hats.start[level], self.hats.start[level + 1]):
                if going == 1:
                    self.prolong(n)
        for n in range(self.hats.size[0]):
            if going == 1:
                self.prolong(n)

    @ti.func
    def restrict_block(self, block, r: ti.template()):
        """The finest level's sums, a block's share."""
        for n in range(self.hats.size[0] * block // self.blocks, self.hats.size[0] * (block + 1) // self.blocks):
            self.hats.restrict(n, r)

    @ti.func
    def restrict_rest(self):
        """Sums of all levels but the finest, each from the one below."""
        for n in range(self.hats.size[0], self.hats.size[2]):
            self.hats.restrict(n, self.hats.r)

    @ti.func
    def solve_exactly(self, n):
        """The value of a node of the coarsest level."""
        self.hats.z[n] = self.coarsest.solve(n, self.hats.r)

    @ti.func
    def solve_block(self, block):
        """The values of the level that is solved exactly, a block's share."""
        first, count = self.hats.size[1], self.hats.size[2] - self.hats.size[1]
        for n in range(first + count * block // self.blocks, first + count * (block + 1) // self.blocks):
            self.solve_exactly(n)

    @ti.func
    def prolong_rest(self):
        """Values of all levels but the finest, from the coarsest down."""
        for back in range(self.hats.size[2] - self.hats.size[0]):
            self.prolong(self.hats.size[2] - 1 - back)

    @ti.func
    def prolong_block(self, block):
        """The finest level's values, a block's share."""
        for n in range(self.hats.size[0] * block // self.blocks, self.hats.size[0] * (block + 1) // self.blocks):
            self.prolong(n)

    @ti.func
    def prolong(self, n):
        """A node's value: its own part plus that of the level above. A node that is solved exactly has its value already."""
        inner = n < self.hats.size[1]
        if inner or ti.static(not self.exact):
            z = sym_times(self.inverse_l[n], self.hats.r[n])
            if inner:
                for k in ti.static(range(self.hats.width)):
                    z += self.hats.parent_weight[n][k] * self.hats.z[self.hats.parent[n][k]]
            self.hats.z[n] = z

    @ti.func
    def correction(self, i):
        """The levels' part at particle i, after `sweep`; the mean over particles sewn together."""
        out = self.hats.interpolated(i)
        if ti.static(self.jacobi.sews):
            k = self.jacobi.sewn.of[i]
            if k >= 0:
                lo, hi = self.jacobi.sewn.begins[k], self.jacobi.sewn.begins[k + 1]
                out = ti.Vector.zero(float, 3)
                for j in range(lo, hi):
                    out += self.hats.interpolated(self.jacobi.sewn.members[j]) / (hi - lo)
        return out
