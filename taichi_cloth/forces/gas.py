"""Gas in closed pieces of cloth: forces p dV of its pressure, and their stiffness K.

With V the volume of a room, E(V) the energy of its gas and p = -dE/dV its pressure over that outside,

| gas | p | E |
|---|---|---|
| constant | p | -p V |
| isothermal | N/V - p_a, N = (p_0 + p_a) V_0 | p_a (V - V_0) - N ln(V/V_0) |
| volume | B (1 - V/V_0) | B (V - V_0)^2 / (2 V_0) |

f = p dV,    K = p ddV + p' dV dV^T,    6 dV_i = sum over faces (i, b, c) of (x_b - x_i) x (x_c - x_i).

Sewn corners of faces count as their mean, so that V is that of a closed surface also while seams close: no room pushes itself,
and V does not depend on the origin. p' dV dV^T, p' <= 0, couples all of a room: a product takes dV . p of all blocks first.
p ddV is symmetric, as that of a closed surface, but indefinite; its diagonal blocks are 0, so that preconditioners have none
of it. For gas of constant pressure p ddV is kept, and left out once conjugate gradients find that A is indefinite. For other
gases it is left out, because p changes within the solve.
"""

import warnings

import numpy as np

from ..backend.fields import Fields
from ..backend.language import ti
from ..backend.rows import read, write
from ..backend.sums import Sums
from ..errors import SceneError
from ..scene.attachment import Script
from ..scene.inflation import GASES, Inflation
from ..scene.scene import Scene
from ..system.checkpoint import Checkpointed
from ..system.enclosures import Enclosure, enclosures
from ..system.state import ParticleState
from .conditions import sym_outer
from .corners import Corners
from .force import Force

CONSTANT, ISOTHERMAL, VOLUME = range(len(GASES))
LEAST = 1e-3  # of V_0, below which isothermal gas is a spring: no N/V is infinite on the way of a line search


@ti.data_oriented
class Gas(Force, Checkpointed):
    """Gas in the closed volumes ("rooms") of a scene.

    A cluster is a set of particles sewn together, or a particle that is not sewn. A corner is a cluster of a room; a particle
    is part of the corners of its cluster.

    Attributes:
        rooms: the closed pieces; known: (V_0, p_0) of inflations, by their keys, as they were found when they began.
    """

    energies = ("gas",)
    low_rank = indefinite = True
    STATE = ("known",)

    def __init__(self, fields: Fields, model: ParticleState, scene: Scene, mode: str) -> None:
        self.model, self.script, self._fields = model, scene.script, fields
        self.rooms = enclosures(scene)
        self.known: dict[str, np.ndarray] = {}
        begun = (room.inflation.check_begin(room.name, room.volume) for room in self.rooms)
        self.notes = [said for said in begun if said]
        self.sum_type = ti.f64 if model.exchange is np.float64 else ti.f32
        self.sews = model.sewn is not None
        blocks, of = model.blocks.count, Corners(model, self.rooms)
        self.size = fields.integer(2, data=np.array([len(of.cluster), len(self.rooms)]))
        self.cluster = fields.integer(len(of.cluster), data=of.cluster)
        self.begin = fields.integer(len(of.first), data=of.first)
        self.ring = fields.integer(len(of.ring), 2, of.ring)
        self.share = fields.integer(len(of.share), data=of.share)
        self.own = fields.integer(len(of.own), data=of.own)
        self.part = fields.integer(len(of.part), 2, of.part)
        self.weight = fields.real(len(of.part), data=of.weight)
        self.at, self.g = fields.real(len(of.cluster), 3), fields.real(len(of.cluster), 3)
        self.device = not model.blocks.serial
        self.volume = Sums(fields, blocks, 3, self.device, len(self.rooms), self.sum_type)  # V, its rate, its change as moved
        self.law = fields.real(len(self.rooms), 4, dtype=self.sum_type)  # kind and parameters, see `_row`
        self.state = fields.real(len(self.rooms), 6, dtype=self.sum_type)  # V, its rate, its change, p, -p', E
        self._law = np.zeros((len(self.rooms), 4))
        self._members = np.column_stack([of.cluster[of.part[:, 1]], of.part[:, 0]])  # a corner's particle, and one sewn to it
        self._room_of = np.searchsorted(of.own[::blocks], np.arange(len(of.part)), side="right") - 1
        self._area = sum(room.area for room in self.rooms)

    def rounding_energy(self, d: float) -> float:
        """Energy [J] that positions off by d [m] amount to."""
        return sum(abs(room.inflation.pressure_at(0.0) or 0.0) * room.area for room in self.rooms) * d

    def build_stiffness(self) -> None:
        """Allocates the fields that only an implicit step needs: the places of the last linearization."""
        n, self.stiff = self.at.rows, True
        self.x_l, self.g_l = self._fields.real(n, 3), self._fields.real(n, 3)
        self.taken = self._fields.real(len(self.rooms), 2)  # c^2 p, -c^2 p'
        self.left_out = self._fields.integer(1, data=np.zeros(1))
        self.change = Sums(self._fields, self.model.blocks.count, 1, self.device, len(self.rooms), self.sum_type)  # dV . p

    def leave_out(self, part: bool) -> None:
        """Leaves p ddV out of the matrix, or not."""
        write(self.left_out, np.array([part], dtype=np.int32))

    @property
    def time_dependent_energy(self) -> bool:  # type: ignore[override]
        """Whether any gas is a function of time, or goes out where seams opened."""
        return any(inflation.time_dependent for inflation in self.script.inflations) or bool(self._open().any())

    @property
    def time_dependent(self) -> bool:  # type: ignore[override]
        """Whether any gas is a function of time."""
        return any(inflation.time_dependent for inflation in self.script.inflations)

    def _open(self) -> np.ndarray:
        """(rooms,) whether any corner of a room has lost a particle that was sewn to it."""
        out: np.ndarray = np.zeros(len(self.rooms), dtype=bool)
        if self.sews:
            now = self.model.sewn.representative
            out[np.unique(self._room_of[now[self._members[:, 0]] != now[self._members[:, 1]]])] = True
        return out

    # the gas of each room

    def follow(self, script: Script) -> None:
        """See `Force`."""
        self.script = script

    def set_time(self, t: float) -> None:
        """Pressures, amounts and volumes as they are at t [s]."""
        gone = self._open()
        rows = np.array([[CONSTANT, 0.0, 0.0, 0.0] if gone[k] else self._row(k, room, t) for k, room in enumerate(self.rooms)])
        if not np.array_equal(rows, self._law):
            self._law = rows
            write(self.law, rows.astype(self.model.exchange))

    def _row(self, k: int, room: Enclosure, t: float) -> list[float]:
        """(kind, three numbers): p; N, p_a, V_0; B, V_0."""
        now = next((i for i in self.script.inflations if i.of(room.inflation.cloth, room.inflation.part)), None)
        if now is None:
            return [CONSTANT, 0.0, 0.0, 0.0]
        if now.gas == "constant":
            return [CONSTANT, now.pressure_at(t) or 0.0, 0.0, 0.0]
        if not self.stiff:
            raise SceneError(f"inflate: an explicit method knows gas of constant pressure only, and {room.name!r} has "
                             f"gas={now.gas!r}: use the integrator 'safe' or 'backward_euler'")
        volume, pressure = self._found(k, room, now)
        if now.gas == "volume":
            return [VOLUME, now.bulk, now.volume_at(t) or volume, 0.0]
        asked = now.pressure_at(t)
        amount = (now.ambient + (pressure if asked is None else asked)) * volume
        return [ISOTHERMAL, amount, now.ambient, volume]

    def _found(self, k: int, room: Enclosure, now: Inflation) -> tuple[float, float]:
        """(V_0, p_0) of an inflation that gives neither: those when it began."""
        key = f"{now.key}_{k}"
        if key not in self.known:
            self.prepare()
            volume, pressure = read(self.state)[k, [0, 3]]
            if callable(now.volume) or now.volume is None:
                if not volume > 0:
                    raise SceneError(f"inflate: {room.name!r} encloses {volume:.3g} m^3 where its gas begins: give it "
                                     "a positive volume, by `volume` or by positions that are not flat")
            else:
                if now is not room.inflation and (said := now.check_begin(room.name, float(volume))):
                    warnings.warn(said, stacklevel=2)
                volume = now.volume_at(0.0)
            self.known[key] = np.array([volume, pressure])
        volume, pressure = self.known[key]
        return float(volume), float(pressure)

    def record(self) -> dict[str, tuple[float, float]]:
        """(volume [m^3], pressure over that outside [Pa]) of the rooms."""
        self.prepare()
        return {room.name: (float(v), float(p)) for room, v, p in zip(self.rooms, *read(self.state)[:, [0, 3]].T)}

    def prepare(self, motion=None) -> None:
        """Volumes, and pressures there."""
        self._weigh(int(motion is not None), self.model.v if motion is None else motion)

    @ti.kernel
    def _weigh(self, moves: int, motion: ti.template()):
        for j in range(self.size[0]):
            self.at[j] = self.place(j, self.model.x)
        for j in range(self.size[0]):
            self.g[j] = self.gradient(j, self.at)
        for t in range(self.model.blocks.count * self.model.blocks.grain):
            if t % self.model.blocks.grain == 0:
                self.weigh(t // self.model.blocks.grain, moves, motion)
        self.volume.finish(self.size[1])
        ti.loop_config(serialize=self.model.blocks.serial)
        for k in range(self.size[1]):
            total = self.volume.all[k]
            p, s, energy = self.respond(k, total[0])
            self.state[k] = ti.Vector([total[0], total[1], total[2], p, s, energy])

    @ti.func
    def weigh(self, block, moves, motion: ti.template()):
        """A block's share of 3 V = dV . x, of the rate dV . v and of the change dV . motion."""
        for k in range(self.size[1]):
            row = k * self.model.blocks.count + block
            total = ti.Vector.zero(self.sum_type, 3)
            origin = self.at[self.share[k * self.model.blocks.count]]
            for j in range(self.share[row], self.share[row + 1]):
                g = self.g[j]
                total[0] += g.dot(self.at[j] - origin) / 3
                total[1] += g.dot(self.place(j, self.model.v))
                if moves == 1:
                    total[2] += g.dot(self.place(j, motion))
            self.volume.of_piece[row] = total

    @ti.func
    def respond(self, k, V):
        """(p, -p', E) of room k at the volume V."""
        law = self.law[k]
        p, s, energy = law[1], 0 * V, -law[1] * V
        if law[0] == ISOTHERMAL:
            N, p_a, V_0 = law[1], law[2], law[3]
            least = LEAST * V_0
            part, short = ti.max(V, least), ti.max(least - V, 0 * V)
            s = N / (part * part)
            p = N / part + s * short - p_a
            energy = p_a * (V - V_0) - N * ti.log(part / V_0) + N / part * short + 0.5 * s * short * short
        if law[0] == VOLUME:
            B, V_0 = law[1], law[2]
            s = B / V_0
            p = s * (V_0 - V)
            energy = 0.5 * s * (V_0 - V) ** 2
        return p, s, energy

    # a corner

    @ti.func
    def place(self, j, q: ti.template()):
        """q of corner j's cluster."""
        i = self.cluster[j]
        out = q[i]
        if ti.static(self.sews):
            out = self.model.sewn.mean(i, q)
        return out

    @ti.func
    def gradient(self, j, x: ti.template()):
        """dV of corner j, for places x of the corners [m^2]."""
        out, here = ti.Vector.zero(float, 3), x[j]
        for r in range(self.begin[j], self.begin[j + 1]):
            out += (x[self.ring[r][0]] - here).cross(x[self.ring[r][1]] - here)
        return out / 6

    @ti.func
    def second(self, j, x: ti.template(), p: ti.template()):
        """(ddV p) of corner j [m^2 per p]."""
        out, here, mine = ti.Vector.zero(float, 3), x[j], self.place(j, p)
        for r in range(self.begin[j], self.begin[j + 1]):
            b, c = self.ring[r][0], self.ring[r][1]
            out += (self.place(b, p) - mine).cross(x[c] - here) + (x[b] - here).cross(self.place(c, p) - mine)
        return out / 6

    @ti.func
    def now_at(self, j):
        """dV of corner j where the model is, with nothing prepared."""
        out, here = ti.Vector.zero(float, 3), self.place(j, self.model.x)
        for r in range(self.begin[j], self.begin[j + 1]):
            b, c = self.place(self.ring[r][0], self.model.x), self.place(self.ring[r][1], self.model.x)
            out += (b - here).cross(c - here)
        return out / 6

    # the contract

    @ti.func
    def add_force(self, block, f: ti.template()):
        """f += p dV; p of gas that is not of constant pressure as it was prepared."""
        for k in range(self.size[1]):
            row = k * self.model.blocks.count + block
            p = ti.cast(self.state[k][3], float)
            if self.law[k][0] == CONSTANT:
                p = ti.cast(self.law[k][1], float)
            for o in range(self.own[row], self.own[row + 1]):
                i = self.part[o][0]
                f[i] = f[i] + p * self.weight[o] * self.now_at(self.part[o][1])

    @ti.func
    def evaluate(self, block, linearizes, moves, c, to: ti.template(), base: ti.template(), report: ti.template(),
                 dtype: ti.template()):
        """Energy [J] in column `base`, no dissipation, the rate at which the energy grows [W]: the first block's.

        With `linearizes`, b += c (f + K `to.rhs_displacement`), P += -c^2 p' dV dV^T; keeps where that is."""
        energy, rate = ti.cast(0, dtype), ti.cast(0, dtype)
        if block == 0:
            for k in range(self.size[1]):
                energy += self.state[k][5]
                rate -= self.state[k][3] * self.state[k][1]
        report[block, base] = energy
        report[block, base + 1] = 0
        report[block, base + 2] = rate
        if ti.static(self.stiff):
            if linearizes == 1:
                self.linearize(block, moves, c, to)

    @ti.func
    def linearize(self, block, moves, c, to: ti.template()):
        """See `evaluate`."""
        for k in range(self.size[1]):
            row = k * self.model.blocks.count + block
            p, s = ti.cast(self.state[k][3], float), ti.cast(self.state[k][4], float)
            change = ti.cast(self.state[k][2], float)
            fixed_p = ti.select(s > 0 or self.left_out[0] == 1, 0.0, p)  # 0 if p changes in the solve, or if indefinite
            if block == 0:
                self.taken[k] = ti.Vector([c * c * fixed_p, c * c * s])
            for j in range(self.share[row], self.share[row + 1]):
                self.x_l[j], self.g_l[j] = self.at[j], self.g[j]
            for o in range(self.own[row], self.own[row + 1]):
                i, j, w = self.part[o][0], self.part[o][1], self.weight[o]
                f = p * self.g[j]
                if moves == 1:
                    f += fixed_p * self.second(j, self.at, to.rhs_displacement) - s * change * self.g[j]
                to.b[i] = to.b[i] + c * w * f
                to.P[i] = to.P[i] + c * c * s * w * w * sym_outer(self.g[j])

    @ti.func
    def add_product(self, block, p: ti.template(), q: ti.template()):
        """q += -c^2 p ddV p"""
        for k in range(self.size[1]):
            row, scale = k * self.model.blocks.count + block, self.taken[k][0]
            if scale != 0:
                for o in range(self.own[row], self.own[row + 1]):
                    i = self.part[o][0]
                    q[i] = q[i] - scale * self.weight[o] * self.second(self.part[o][1], self.x_l, p)

    @ti.func
    def sum_up(self, block, p: ti.template()):
        """A block's share of dV . p."""
        for k in range(self.size[1]):
            row = k * self.model.blocks.count + block
            total = ti.cast(0, self.sum_type)
            if self.taken[k][1] > 0:
                for j in range(self.share[row], self.share[row + 1]):
                    total += self.g_l[j].dot(self.place(j, p))
            self.change.of_piece[row] = total

    @ti.func
    def gather(self):
        """See `Force`."""
        self.change.finish(self.size[1])

    @ti.func
    def change_of(self, k):
        """dV . p of room k."""
        total = ti.cast(0, self.sum_type)
        if ti.static(self.device):
            total = self.change.all[k]
        else:
            for block in range(self.model.blocks.count):
                total += self.change.of_piece[k * self.model.blocks.count + block]
        return total

    @ti.func
    def add_low_rank(self, block, q: ti.template()):
        """q += -c^2 p' dV (dV . p)"""
        for k in range(self.size[1]):
            first = k * self.model.blocks.count
            total = self.change_of(k)
            scale = self.taken[k][1] * ti.cast(total, float)
            if scale != 0:
                for o in range(self.own[first + block], self.own[first + block + 1]):
                    i = self.part[o][0]
                    q[i] = q[i] + scale * self.weight[o] * self.g_l[self.part[o][1]]

    def build_levels(self, levels) -> None:
        """Nothing: no level has a part of it."""

    @ti.func
    def add_level_block(self, n, c, D, levels: ti.template()):
        """D: s^T ddV s is 0, and p' dV dV^T has rank one, a direction that conjugate gradients find by themselves."""
        return D
