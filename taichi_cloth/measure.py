"""One pass over the state: energies by term, the incremental potential, largest stretch, finiteness."""

from dataclasses import dataclass

import numpy as np
import taichi as ti

from .model import Model
from .runtime import Runtime


@dataclass(frozen=True)
class Measures:
    """What a state amounts to.

    Attributes:
        energies: J by term, kinetic included.
        dissipation: half the dissipated power [W] (the Rayleigh function).
        change: 1/2 (v - v_base)^T M (v - v_base) [J].
        stretch: largest |w|/b; 1 is the pattern's size, 0 where no cloth has stretch or shear.
        stretch_change: its largest change in any triangle since the saved state.
        finite: no NaN and no infinity in x or v.
    """

    energies: dict[str, float]
    dissipation: float
    change: float
    stretch: float
    stretch_change: float
    finite: bool

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
        """Sum of the terms' absolute values [J], what rounding is relative to."""
        return sum(abs(e) for e in self.energies.values()) + self.change


@ti.data_oriented
class Meter:
    """Measures a model under its forces."""

    def __init__(self, model: Model, forces: list, runtime: Runtime) -> None:
        self.model, self.forces, self.blocks = model, forces, model.blocks
        self.sum_type = ti.f32 if runtime.sums == "f32" else ti.f64
        self.base, column = [], 0
        for force in forces:
            self.base.append(column)
            column += len(force.energies) + 1
        self.column = column  # of kinetic energy; then change, stretch, its change, a sum over x and v
        self.stretched = [f for f in forces if hasattr(f, "largest_stretch")]
        self._report: np.ndarray = np.zeros((self.blocks.count, column + 5), dtype=runtime.exchange)

    def measure(self) -> Measures:
        """The model's current state, against its saved one."""
        self._measure(self._report)
        sums, peaks = self._report.sum(axis=0, dtype=np.float64), self._report.max(axis=0)
        energies: dict[str, float] = {}
        dissipation = 0.0
        for force, base in zip(self.forces, self.base):
            energies.update({name: float(sums[base + i]) for i, name in enumerate(force.energies)})
            dissipation += float(sums[base + len(force.energies)])
        c = self.column
        energies["kinetic"] = float(sums[c])
        finite = bool(np.isfinite(sums).all())
        return Measures(energies, dissipation, float(sums[c + 1]), float(peaks[c + 2]), float(peaks[c + 3]), finite)

    @ti.kernel
    def _measure(self, report: ti.types.ndarray()):
        for t in range(self.blocks.count * self.blocks.grain):
            if t % self.blocks.grain == 0:
                block = t // self.blocks.grain
                for k in ti.static(range(len(self.forces))):
                    self.forces[k].measure(block, self.base[k], report, self.sum_type)
                self.measure_rows(block, report)
                report[block, self.column + 2] = 0
                report[block, self.column + 3] = 0
                for k in ti.static(range(len(self.stretched))):
                    largest, change = self.stretched[k].largest_stretch(block)
                    report[block, self.column + 2] = largest
                    report[block, self.column + 3] = change

    @ti.func
    def measure_rows(self, block, report: ti.template()):
        """Kinetic energy, change, and a sum that is finite if x and v are."""
        kinetic, change = ti.cast(0, self.sum_type), ti.cast(0, self.sum_type)
        total = ti.cast(0, self.sum_type)
        for i in range(self.blocks.row[block], self.blocks.row[block + 1]):
            v, m = self.model.v[i], self.model.m[i]
            kinetic += 0.5 * m * v.norm_sqr()
            change += 0.5 * m * (v - self.model.v_base[i]).norm_sqr()
            total += v.sum() + self.model.x[i].sum()
        report[block, self.column] = kinetic
        report[block, self.column + 1] = change
        report[block, self.column + 4] = total
