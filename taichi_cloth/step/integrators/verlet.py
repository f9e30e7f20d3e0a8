"""Velocity Verlet: explicit, second order, no solver; many substeps at its stable step in one step.

Bending is much softer than the membrane and need not be evaluated as often. Its force acts every few substeps
with as many times its weight (an impulse method [Tuckerman, Berne, Martyna 1992]), which keeps the order.
On the CPU all substeps of a step are one launch, by a phase scheduler.
"""

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from ...backend.fields import Fields
from ...backend.language import ti
from ...backend.phases import END, TASK, PhaseScheduler
from ...backend.rows import read, write
from ...backend.runtime import Runtime
from ...backend.sums import GROUPS
from ...backend.timing import Clock
from ...forces.pulls import Pulled, Pulls
from ...scene.scene import Scene
from ...system.assembler import Assembler, Measures
from ...system.checkpoint import Checkpointed
from ...system.constraints import project, row
from ...system.held import Held
from ...system.state import ParticleState
from ..attempt import ENERGY, NOT_FINITE, Attempt
from ..choice import SAFETY, stable_step
from ..ledger import Work, gained, many_steps, with_attachments
from ..prescribed import ExplicitTimeWork

SLOW = 16  # substeps between two evaluations of bending, at most
SLOW_SAFETY = 0.5  # part of bending's own stable step that these take together
STRAIGHT = 8  # substeps in which held particles that are led go along a line
FORCE, MOVE = 1, 2  # kinds of a phase scheduler's phases
ROUNDING = 64  # roundings of its terms by which energy may grow, and of positions
PULLS = Pulls.energies[0]
GAIN = 0.001  # part of the motion's scale by which energy may grow in a step


@ti.data_oriented
class Verlet(Checkpointed):
    """Velocity Verlet on a model.

    Args:
        substep: asked for [s], or None.

    Attributes:
        part: of the stable step that substeps take; less after steps that gained energy.
    """

    system = None
    STATE = ("part",)

    def __init__(self, fields: Fields, model: ParticleState, forces: list, meter: Assembler, substep: float | None,
                 runtime: Runtime, scene: Scene) -> None:
        self.model, self.meter, self.blocks, self.time_work = model, meter, model.blocks, ExplicitTimeWork(meter)
        self.fast = [f for f in forces if not f.multirate]
        self.slow = [f for f in forces if f.multirate]
        self.f, self.f_slow = fields.real(model.n, 3), fields.real(model.n if self.slow else 1, 3)
        self.u = fields.real(model.n, 3)  # velocity half a substep ahead or behind
        self.soft: Any = next((f for f in forces if isinstance(f, Pulls)), None)
        self.tows = self.soft is not None
        self.pieces = GROUPS if runtime.device else 1  # of the held particles, a thread each
        self.pulled, self.towed = (fields.real(self.pieces, dtype=ti.f32 if runtime.sums == "f32" else ti.f64)
                                   for _ in range(2))  # a piece's work [J]: of led particles, of places that pull softly
        self.drag = next((f for f in forces if f.interpolated_wind), None)
        self.ramps, self.time_dependent = self.drag is not None, any(f.time_dependent for f in forces)
        self.stable_step, bending = (stable_step(sum(f.rates[0] for f in of), sum(f.rates[1] for f in of))
                                     for of in (self.fast, self.slow))
        if self.stable_step == math.inf:
            self.stable_step = bending
        asked = math.inf if substep is None else substep / SAFETY
        self.stable_step = min(self.stable_step, asked)
        self.every = int(min(SLOW, max(1, SLOW_SAFETY * bending / self.stable_step))) if self.slow else 1
        if self.every == 1:
            self.stable_step = min(asked, stable_step(sum(f.rates[0] for f in forces), sum(f.rates[1] for f in forces)))
        self.together = not runtime.device  # a phase scheduler, or a launch for each substep
        self.phases = PhaseScheduler(fields, self.blocks.count if self.together else 1, self.blocks.largest)
        self.damps = any(force.rates[1] > 0 for force in forces)
        self.subcycles = True
        self.part = SAFETY
        self.weight = float(np.linalg.norm(scene.gravity) * model.mass.sum())
        self.epsilon = runtime.epsilon
        extent = float(np.abs(model.start_positions[model.user] - model.origin).max())
        self.floor = ROUNDING * sum(force.rounding_energy(runtime.epsilon * extent) for force in forces)  # [J]
        self.exchange = model.exchange
        self.waiting = self.gained = False  # whether the last attempt was not accepted yet, and gained energy
        nothing: np.ndarray = np.zeros((0, 3), dtype=self.exchange)
        self.free: tuple = (np.zeros(0, dtype=np.int32), np.zeros((0, 3, 3), dtype=self.exchange), nothing, nothing)

    def attempt(self, h: float, held_at: Callable[[float], Held | None], start: Measures) -> Attempt:
        """One step of as many substeps as stability needs; see the package."""
        clock = Clock()
        if self.waiting and self.gained:  # the last attempt was not accepted
            self.part /= 2
        self.waiting = True
        count = 1
        if self.subcycles and self.stable_step < math.inf:
            count = self.every * math.ceil(h / (self.part * self.stable_step * self.every))
        every = self.every if count % self.every == 0 else 1
        small, done = h / count, 0
        with clock.part("EVAL"):
            for work in (self.pulled, self.towed):
                write(work, np.zeros(self.pieces, dtype=self.exchange))
            if self.ramps:
                held_at(0.0)
            wind = self._wind()
            held, pumped, led = held_at(h), 0.0, 0.0
            moving = self.time_work.runs or self.soft is not None or (held is not None and held.moving)
            if self.time_work.runs or self.soft is not None:
                held_at(0.0)
            if self.soft is not None:
                led = self.soft.now.energy(self.model.read_particles()[0]) - start.energies[PULLS]
            chunk = count if not moving else max(every, STRAIGHT // every * every)
            while done < count:
                steps = min(chunk, count - done)
                ways = self.free[0], self.free[2]
                if moving:
                    before = None if self.soft is None else self.soft.now
                    held, work_in = self.time_work.go_on(held_at, (done + steps) * small)
                    pumped += work_in
                    if before is not None:
                        ways, begun = self._ways(before, steps)
                        led += begun
                self._go(small, steps, every, held, wind, ways)
                done, wind = done + steps, self._wind()
            measures, led = self.meter.measure(), led + float(np.sum(read(self.towed)))
            if led:
                start = replace(start, energies={**start.energies, PULLS: start.energies[PULLS] + led})
            work = Work(pins=float(np.sum(read(self.pulled))) if moving else 0.0, gas=pumped)
        evaluations = count + math.ceil(count / chunk)
        rejection, detail = None if measures.finite else NOT_FINITE, f"{count} substeps of {small:.3g} s"
        blown = h * max(0.0, -start.dissipation, -measures.dissipation)
        scale = start.energies["kinetic"] + measures.energies["kinetic"] + self.weight * 0.1 * h + start.size
        allowed = GAIN * (scale + abs(work.pins)) + 2 * blown + self.floor
        allowed += ROUNDING * self.epsilon * (start.size + measures.size)
        if measures.finite and self.subcycles and gained(start, measures, work) > allowed:
            rejection = ENERGY
        self.gained = rejection is not None
        return Attempt(rejection, detail, measures, (), clock.seconds, evaluations=evaluations, order=2,
                       ledger=with_attachments(many_steps(start, measures, work), led))

    def _ways(self, before: Pulled, steps: int) -> tuple[tuple[np.ndarray, np.ndarray], float]:
        """((particles (k,), ways (k, 3) [m] that their places go), work [J] of the first half substep, or of attachments
        that begin or let go). Places at the end of some substeps go back to their positions `before` these."""
        now, x = self.soft.now, self.model.read_particles()[0]
        if np.array_equal(before.index, now.index) and np.array_equal(before.law, now.law):
            self.soft.put(before)
            way = now.place - before.place
            begun = float(np.sum(before.forces(x) * way)) / (2 * steps)
            return (now.index.astype(np.int32), way.astype(self.exchange)), begun
        return (self.free[0], self.free[2]), now.energy(x) - before.energy(x)

    def commit(self, taken: float = 0.0) -> None:
        """The attempt was accepted; forces with memory took the energy `taken` [J] after it."""
        self.waiting = False

    def reset(self) -> None:
        """The state was changed by hand: nothing is remembered."""
        self.waiting = False

    def _wind(self) -> np.ndarray:
        """Wind at the time of the last constraints [m/s]."""
        return np.zeros(3) if self.drag is None else self.drag.now

    def _go(self, h: float, steps: int, every: int, held: Held | None, wind: np.ndarray,
            ways: tuple[np.ndarray, np.ndarray]) -> None:
        """Substeps in which the wind changes evenly.

        Held particles go along lines to their targets and arrive with the lines' velocity. Places of soft attachments
        go their ways.
        """
        pins, gust = self.free, (self._wind() - wind) / steps
        if held is not None:
            x = self.model.read_particles()[0][held.index].astype(self.exchange) if held.moving else held.target
            pins = (held.index, held.projector, x, held.target)
        if self.drag is not None:
            self.drag.set_wind(wind)
            self.drag.now = wind + steps * gust
        self.model.moved()
        if self.together:
            self._together(h, steps, every, *gust, *pins, *ways)
            return
        for s in range(steps + 1):
            self._substep(h, s, steps, every, *gust, *pins, *ways)

    @ti.kernel
    def _together(self, h: float, steps: int, every: int, gust_x: float, gust_y: float, gust_z: float,
                  index: ti.types.ndarray(), projector: ti.types.ndarray(), start: ti.types.ndarray(),
                  target: ti.types.ndarray(), soft: ti.types.ndarray(), way: ti.types.ndarray()):
        """All substeps, by a phase scheduler."""
        self.phases.start(FORCE)
        for t in range(self.phases.tasks):
            if t % TASK == 0:
                phase, kind, block, waited = 0, FORCE, 0, 0
                while kind != END:
                    phase, kind = self.phases.phase(), self.phases.kind(waited)
                    if kind != END:
                        block, waited = self.phases.claim(t // TASK, phase, waited)
                        if block >= 0:
                            s, following = phase // 2, MOVE
                            if kind == FORCE:
                                self.compute(block, s, every)
                            else:
                                self.move(block, h, s, steps, every)
                            if self.phases.last(phase):
                                if kind == MOVE:
                                    self.lead(0, h, s, steps, index, projector, start, target)
                                    self.tow(0, s, steps, soft, way)
                                    self.blow(s, steps, gust_x, gust_y, gust_z)
                                    following = FORCE
                                    if s == steps:
                                        following = END
                                self.phases.turn(following)

    @ti.kernel
    def _substep(self, h: float, s: int, steps: int, every: int, gust_x: float, gust_y: float, gust_z: float,
                 index: ti.types.ndarray(), projector: ti.types.ndarray(), start: ti.types.ndarray(),
                 target: ti.types.ndarray(), soft: ti.types.ndarray(), way: ti.types.ndarray()):
        """Substep s on all threads."""
        for t in range(self.blocks.count * self.blocks.grain):
            if t % self.blocks.grain == 0:
                self.compute(t // self.blocks.grain, s, every)
        for t in range(self.blocks.count * self.blocks.grain):
            if t % self.blocks.grain == 0:
                self.move(t // self.blocks.grain, h, s, steps, every)
        for piece in range(self.pieces):
            self.lead(piece, h, s, steps, index, projector, start, target)
            if piece == 0:
                self.blow(s, steps, gust_x, gust_y, gust_z)
        if ti.static(self.tows):
            for piece in range(self.pieces):
                self.tow(piece, s, steps, soft, way)

    @ti.func
    def compute(self, block, s, every):
        """f from 0, and every few substeps f_slow, on the rows of a block."""
        for k in ti.static(range(len(self.fast))):
            self.fast[k].add_force(block, self.f)
        if ti.static(len(self.slow) > 0):
            if s % every == 0:
                for i in range(self.blocks.row[block], self.blocks.row[block + 1]):
                    self.f_slow[i] = ti.Vector.zero(float, 3)
                for k in ti.static(range(len(self.slow))):
                    self.slow[k].add_force(block, self.f_slow)

    @ti.func
    def move(self, block, h, s, steps, every):
        """u += h f/m, half of it at the two ends; x += h u; v, predicted for the next f, as u + h/2 f/m; f = 0 again."""
        share, step = 1.0, h
        if s == 0 or s == steps:
            share = 0.5
        if s == steps:
            step = 0.0
        bends = 0.0
        if s % every == 0:
            bends = ti.cast(every, float)
        for i in range(self.blocks.row[block], self.blocks.row[block + 1]):
            f, kick, u = self.f[i], self.f[i], self.u[i]
            self.f[i] = ti.Vector.zero(float, 3)
            if s == 0:
                u = self.model.v[i]
            if ti.static(len(self.slow) > 0):
                kick += bends * self.f_slow[i]
                f += self.f_slow[i]
            a = h / self.model.m[i]
            u += share * a * kick
            self.u[i] = u
            self.model.x[i] = self.model.x[i] + step * u
            if s == steps:
                self.model.v[i] = u
            elif ti.static(self.damps):
                self.model.v[i] = u + 0.5 * a * f

    @ti.func
    def share(self, piece, rows):
        """(the first of a piece's rows, the end of them)."""
        length = (rows + self.pieces - 1) // self.pieces
        return ti.min(piece * length, rows), ti.min((piece + 1) * length, rows)

    @ti.func
    def lead(self, piece, h, s, steps, index: ti.template(), projector: ti.template(), start: ti.template(),
             target: ti.template()):
        """Held directions of a piece to where they must be after substep s, exactly at the target after the last."""
        first, end = self.share(piece, index.shape[0])
        for k in range(first, end):
            i = index[k]
            a, b = row(start, k), row(target, k)
            part = ti.min(1.0, (s + 1.0) / steps)
            goal = a + part * (b - a)
            if s + 1 >= steps:
                goal = b
            self.model.x[i] += project(projector, k, goal - self.model.x[i])
            along = (b - a) / (steps * h)
            self.model.v[i] += project(projector, k, along - self.model.v[i])
            change = project(projector, k, along - self.u[i])
            self.u[i] += change
            self.pulled[piece] = self.pulled[piece] + self.model.m[i] * change.dot(along)  # an impulse, on its way

    @ti.func
    def tow(self, piece, s, steps, soft: ti.template(), way: ti.template()):
        """Places that pull softly go on after substep s. Their work is that of f on their ways by the trapezoidal rule, as the
        kicks are on the cloth's; the first half of it is `_ways`'s."""
        if ti.static(self.tows):
            if s < steps:
                part = 1.0
                if s + 1 == steps:
                    part = 0.5
                first, end = self.share(piece, soft.shape[0])
                for k in range(first, end):
                    i, way_k = soft[k], row(way, k) / steps
                    self.soft.place[i] += way_k
                    x = self.model.x[i]
                    ratio = self.soft.pull(i, x)[2]
                    self.towed[piece] = self.towed[piece] + part * ratio * (self.soft.place[i] - x).dot(way_k)

    @ti.func
    def blow(self, s, steps, x, y, z):
        """The wind after substep s."""
        if ti.static(self.ramps):
            if s < steps:
                self.drag.wind[0] += ti.Vector([x, y, z])
