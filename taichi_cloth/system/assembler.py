"""One pass over the state: energies by term, the incremental potential, largest stretch, finiteness, and where it is
wanted the linear system there.

Each block of vertices writes its numbers to a row of a report, to be added up over all of the cloth. On the CPU rows are as
few as threads, and numpy adds them up. On a device there are thousands. They stay there, and the host reads sums and largest
numbers alone.
"""

import json
from dataclasses import dataclass, replace

import numpy as np

from ..backend.answers import Answer
from ..backend.language import ti
from ..backend.rows import write
from ..backend.runtime import Runtime
from ..backend.sums import GROUPS
from .checkpoint import numbered
from .operator import Operator
from .state import ParticleState

LEAST = -1e30  # less than any number of a report
FUSED = True  # one launch for all forces; apart, a force is compiled once for all scenes, which pays where they are many


@dataclass(frozen=True)
class Measures:
    """Energies and other measures of a state.

    Attributes:
        energies: J by term, kinetic included.
        dissipation: half the dissipated power [W] (the Rayleigh function).
        damped: the part of it that is the cloth's own damping, without the air's.
        rate: at which the energies but the kinetic grow by the motion [W].
        wind: power of the air and of loads on the cloth [W].
        change: 1/2 (v - v_base)^T M (v - v_base) [J].
        stretch: largest |w|/b; 1 is the pattern's size, 0 if no cloth has stretch or shear.
        stretch_change: its largest change away from 1 in any triangle since the saved state.
        used: largest part of its way from rest to its limit of strain that any triangle went, in stretch or in shear.
        finite: no NaN and no infinity in x or v.
    """

    energies: dict[str, float]
    dissipation: float
    change: float
    stretch: float
    stretch_change: float
    finite: bool
    damped: float = 0.0
    rate: float = 0.0
    wind: float = 0.0
    used: float = 0.0

    @property
    def air(self) -> float:
        """The part of the dissipation that is not the cloth's own [W]."""
        return self.dissipation - self.damped

    @property
    def potential(self) -> float:
        """Energy of everything but motion [J]."""
        return sum(e for name, e in self.energies.items() if name != "kinetic")

    @property
    def total(self) -> float:
        """Mechanical energy [J]."""
        return sum(self.energies.values())

    @property
    def size(self) -> float:
        """Sum of the terms' absolute values [J], to which rounding is relative."""
        return sum(abs(e) for e in self.energies.values()) + self.change


@ti.data_oriented
class Assembler:
    """Measures a model under its forces, and linearizes them: both need the same strains.

    Args:
        operator: the linearized system, or None if no step is implicit.
    """

    operator: Operator

    def __init__(self, model: ParticleState, forces: list, runtime: Runtime, operator: Operator | None) -> None:
        self.model, self.forces, self.blocks = model, forces, model.blocks
        self._prepared = [force for force in forces if force.does("prepare")]
        self._over = 0.0  # `ParticleState.over` as it is
        self.operator = operator  # type: ignore[assignment]
        self.sum_type = ti.f32 if runtime.sums == "f32" else ti.f64
        self._rows = Rows(model, operator, self.sum_type)
        self._each = [OneForce(force, model, operator, self.sum_type) for force in forces]
        self.base, column = [], 0
        self.extremes: list[int] = []  # columns of the largest stretch, each before that of its change
        self.used: list[int] = []  # columns of the limits' use
        for force in forces:
            self.base.append(column)
            column += len(force.energies) + 2 + force.extremes
            self.extremes += [column - force.extremes] if force.extremes else []
            self.used += [column - 1] if force.extremes > 2 else []
        self.column = column  # of kinetic energy; then change, a sum over x and v
        peaks = sorted({*self.extremes, *(k + 1 for k in self.extremes), *self.used})
        self._report = (Report if runtime.device else HostReport)(self.blocks.count, column + 3, peaks, runtime)

    def measure(self, over: float = 0.0) -> Measures:
        """The model's current state, against its saved one.

        Args:
            over: span [s] of a step over which damping is an energy, see `Force.evaluate`. Then R times it is this energy,
                `damped` half of k_d ((C - C_0)/over)^2, and the further loss by damping's force is part of `rate`.
        """
        return self._look(0, 0, 0.0, over)

    def felt(self) -> str:
        """Energies and powers of each force at the state, without contact, and kinetic energy, as text. Scenes of the same
        material give the same text for the same state."""
        self.measure()
        sums = self._report.columns()[0].tolist()
        bases = {id(force): base for force, base in zip(self.forces, self.base)}
        made = {name: sums[bases[id(force)]: bases[id(force)] + len(force.energies) + 2]
                for name, force in numbered(force for force in self.forces if not force.of_contact).items()}
        return json.dumps({**made, "kinetic": sums[self.column]})

    @property
    def attached(self) -> np.ndarray:
        """(k, 3) soft attachments: particle, stiffness, largest force."""
        return next((force.attached for force in self.forces if force.attached is not None), np.zeros((0, 3)))

    def led(self, start: Measures, part: float) -> tuple[Measures, float]:
        """(measures of a step's start, as if parts that move by themselves had moved before; its work [J]): see `Force.led`.

        Args:
            start: the step's; the model is at its end, or with `part` 0 anywhere.
        """
        energies, total = dict(start.energies), 0.0
        for force in self.forces:
            if force.attached is not None:
                name = force.energies[0]
                work = force.led(energies.get(name, 0.0), part)
                energies[name], total = energies.get(name, 0.0) + work, total + work
        return (replace(start, energies=energies) if total else start), total

    def change_beside(self, led: np.ndarray) -> float:
        """`Measures.stretch_change` of triangles without a corner among the particles `led` (n,); 0 if none may stretch."""
        return max((force.change_beside(led) for force in self.forces), default=0.0)

    def linearize(self, c: float, moves: bool, over: float = 0.0) -> Measures:
        """The same; the operator becomes that of the current state.

        b = M (v_base - v) + c f, with `moves` + c K motion.
        """
        return self._look(1, int(moves), c, over)

    def _look(self, linearizes: int, moves: int, c: float, over: float) -> Measures:
        if over != self._over:
            self._over = over
            write(self.model.over, np.array([over], dtype=self.model.exchange))
        for force in self._prepared:
            force.prepare(self.operator.rhs_displacement if moves else None)
        self._evaluate(linearizes, moves, c, self._report.rows)
        sums, peaks = self._report.columns()
        energies: dict[str, float] = {}
        dissipation = damped = rate = wind = 0.0
        for force, base in zip(self.forces, self.base):
            after = base + len(force.energies)
            for i, name in enumerate(force.energies):  # both models of bending have one name
                energies[name] = energies.get(name, 0.0) + float(sums[base + i])
            dissipation += float(sums[after])
            if force.energies:
                damped += float(sums[after])
                rate += float(sums[after + 1])
            else:
                wind -= float(sums[after + 1])
        n = self.column
        energies["kinetic"] = float(sums[n])
        finite = bool(np.isfinite(sums).all())
        stretch, stretch_change = (max((float(peaks[k + j]) for k in self.extremes), default=0.0) for j in (0, 1))
        used = max((float(peaks[k]) for k in self.used), default=0.0)
        return Measures(energies, dissipation, float(sums[n + 1]), stretch, stretch_change, finite, damped, rate, wind, used)

    def _evaluate(self, linearizes: int, moves: int, c: float, report) -> None:
        """The model's rows, then each force, into columns of the report."""
        if FUSED:
            self._evaluate_all(linearizes, moves, c, report)
            return
        self._rows.evaluate(linearizes, self.column, report)
        for one, base in zip(self._each, self.base):
            one.evaluate(linearizes, moves, c, base, report)

    @ti.kernel
    def _evaluate_all(self, linearizes: int, moves: int, c: float, report: ti.types.ndarray()):
        for t in range(self.blocks.count * self.blocks.grain):
            if t % self.blocks.grain == 0:
                block = t // self.blocks.grain
                self._rows.evaluate_block(block, linearizes, self.column, report)
                for k in ti.static(range(len(self.forces))):
                    self.forces[k].evaluate(block, linearizes, moves, c, self.operator, self.base[k], report, self.sum_type)


@ti.data_oriented
class Rows:
    """The particles' own part of an evaluation."""

    operator: Operator

    def __init__(self, model: ParticleState, operator: Operator | None, sum_type) -> None:
        self.model, self.blocks, self.sum_type = model, model.blocks, sum_type
        self.operator = operator  # type: ignore[assignment]
        self.linear = operator is not None

    @ti.kernel
    def evaluate(self, linearizes: int, column: int, report: ti.types.ndarray()):
        for t in range(self.blocks.count * self.blocks.grain):
            if t % self.blocks.grain == 0:
                self.evaluate_block(t // self.blocks.grain, linearizes, column, report)

    @ti.func
    def evaluate_block(self, block, linearizes, column, report: ti.template()):
        """Kinetic energy, change, and a sum that is finite if x and v are; the masses' part of the linear system."""
        kinetic, change = ti.cast(0, self.sum_type), ti.cast(0, self.sum_type)
        total = ti.cast(0, self.sum_type)
        for i in range(self.blocks.row[block], self.blocks.row[block + 1]):
            v, m = self.model.v[i], self.model.m[i]
            lag = self.model.v_base[i] - v
            kinetic += 0.5 * m * v.norm_sqr()
            change += 0.5 * m * lag.norm_sqr()
            total += v.sum() + self.model.x[i].sum()
            if ti.static(self.linear):
                if linearizes == 1:
                    self.operator.b[i] = m * lag
                    self.operator.P[i] = ti.Vector([m, 0.0, 0.0, m, 0.0, m])
        report[block, column] = kinetic
        report[block, column + 1] = change
        report[block, column + 2] = total


@ti.data_oriented
class OneForce:
    """One force's part of an evaluation, as a kernel of its own."""

    def __init__(self, force, model: ParticleState, operator: Operator | None, sum_type) -> None:
        self.force, self.operator, self.blocks, self.sum_type = force, operator, model.blocks, sum_type

    @ti.kernel
    def evaluate(self, linearizes: int, moves: int, c: float, base: int, report: ti.types.ndarray()):
        for t in range(self.blocks.count * self.blocks.grain):
            if t % self.blocks.grain == 0:
                self.force.evaluate(t // self.blocks.grain, linearizes, moves, c, self.operator, base, report, self.sum_type)


class HostReport:
    """Rows of a few blocks.

    Args:
        peaks: columns of which the largest numbers are asked for.

    Attributes:
        rows: (blocks, columns), an argument of kernels.
    """

    def __init__(self, blocks: int, columns: int, peaks: list[int], runtime: Runtime) -> None:
        self.rows: np.ndarray = np.zeros((blocks, columns), dtype=runtime.exchange)

    def columns(self) -> tuple[np.ndarray, np.ndarray]:
        """(sums of the columns, largest numbers in them)"""
        return self.rows.sum(axis=0, dtype=np.float64), self.rows.max(axis=0)


@ti.data_oriented
class Report:
    """The same for thousands of blocks: see `HostReport`. The host waits once."""

    def __init__(self, blocks: int, columns: int, peaks: list[int], runtime: Runtime) -> None:
        self.sum_type = ti.f32 if runtime.sums == "f32" else ti.f64
        self.rows = ti.ndarray(self.sum_type, shape=(blocks, columns))
        self._part = ti.ndarray(self.sum_type, shape=(2 * GROUPS, columns))  # sums of groups, then largest numbers
        self._peaks, self._answer = peaks, Answer(columns + len(peaks), runtime)

    def columns(self) -> tuple[np.ndarray, np.ndarray]:
        """See `HostReport`; 0 for the largest numbers that are not asked for."""
        self._join(self.rows, self._part, self._answer.numbers)
        columns = self.rows.shape[1]
        out, peaks = self._answer.read(), np.zeros(columns)
        peaks[self._peaks] = out[columns:]
        return out[:columns], peaks

    @ti.kernel
    def _join(self, rows: ti.types.ndarray(), part: ti.types.ndarray(), out: ti.types.ndarray()):
        for at in range(ti.static(GROUPS) * rows.shape[1]):
            group, column = at // rows.shape[1], at % rows.shape[1]
            total, most = ti.cast(0, self.sum_type), ti.cast(ti.static(LEAST), self.sum_type)
            for row in range(rows.shape[0] * group // GROUPS, rows.shape[0] * (group + 1) // GROUPS):
                total += rows[row, column]
                most = ti.max(most, rows[row, column])
            part[group, column], part[GROUPS + group, column] = total, most
        for column in range(rows.shape[1]):
            total, most = ti.cast(0, self.sum_type), ti.cast(ti.static(LEAST), self.sum_type)
            for group in range(ti.static(GROUPS)):
                total += part[group, column]
                most = ti.max(most, part[GROUPS + group, column])
            out[column] = total
            for k in ti.static(range(len(self._peaks))):
                if column == ti.static(self._peaks[k]):
                    out[rows.shape[1] + k] = most
