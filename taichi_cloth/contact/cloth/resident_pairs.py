"""Kernels of pairs as layers call them: with arrays of numpy, or on a device with copies that stay in its memory.

There a pair's ids, weights and normals are where they were found, and numbers that one kernel writes and another reads stay
besides going to the host. Those that the host alone knows cross over.
"""

import numpy as np

from ...backend.device_arrays import Copies, Mirror, array
from ...backend.language import ti
from ...backend.runtime import for_device
from ..device_points import Resident
from .contact_pairs import ContactPairs
from .pair_kernels import LED, TAKEN, WEIGHED, PairKernels


class PairCalls:
    """Calls of `PairKernels` for pairs.

    Attributes:
        resident: whether it is told of pairs that are found, by `took`.
    """

    resident = False

    def __init__(self, kernels: PairKernels, exchange: type) -> None:
        self.kernels, self.exchange = kernels, exchange

    def evaluate(self, p: ContactPairs, boost: np.ndarray, h: float) -> tuple[np.ndarray, np.ndarray]:
        """See `PairKernels`: (numbers (., k), `rotation_coupling` (k, 4, 3))."""
        k = len(p.end)
        out, coupling = np.empty((WEIGHED, k)), np.empty((k, 4, 3))
        if k:
            self._evaluate(p, boost, h, out, coupling)
        return out, coupling

    def linearize(self, p: ContactPairs, weighed: np.ndarray, coupling: np.ndarray, *others) -> tuple[np.ndarray, ...]:
        """See `PairKernels`: (as a solve takes them (., k), blocks (k, 6), right-hand sides (k, 3)).

        Args:
            weighed, coupling: as `evaluate` gives them.
            others: further arguments in the kernel's order, up to `before`.
        """
        k = len(p.end)
        out = np.empty((TAKEN, k)), np.empty((k, 6)), np.empty((k, 3))
        if k:
            self._linearize(p, weighed, coupling, others, out)
        return out

    def measure(self, p: ContactPairs, coupling: np.ndarray, taken: np.ndarray, h: float) -> np.ndarray:
        """See `PairKernels`: (., k) of pairs that a solve took."""
        out = np.empty((LED, len(p.end)))
        if len(p.end):
            self._measure(p, coupling, taken, h, out)
        return out

    def points(self, p: ContactPairs, block: np.ndarray, rhs: np.ndarray, coupling: np.ndarray) -> Resident | None:
        """Pairs that were linearized as points of contact, where a device has them; else None."""
        return None

    def _evaluate(self, p: ContactPairs, boost: np.ndarray, h: float, *out: np.ndarray) -> None:
        self.kernels.evaluate(*_columns(p), boost, h, *out)

    def _linearize(self, p: ContactPairs, weighed: np.ndarray, coupling: np.ndarray, others: tuple,
                   out: tuple[np.ndarray, ...]) -> None:
        self.kernels.linearize(*_columns(p)[1:], weighed, coupling, *others, *out)

    def _measure(self, p: ContactPairs, coupling: np.ndarray, taken: np.ndarray, h: float, out: np.ndarray) -> None:
        self.kernels.measure(*_columns(p)[1:4], coupling, taken, h, out)


def _columns(p: ContactPairs) -> tuple[np.ndarray, ...]:
    """Pairs as kernels take them."""
    return p.pair, p.vertices, p.weights, p.normal, p.end, p.radius, p.factor


@ti.data_oriented
class DevicePairCalls(PairCalls):
    """The same on a device."""

    resident = True

    def __init__(self, kernels: PairKernels, exchange: type) -> None:
        super().__init__(kernels, exchange)
        self.copies, self._boost = Copies(), Mirror()

    def took(self, p: ContactPairs, columns: list) -> None:
        """Pairs that were found are on the device as the columns of `LayerDetector.reached`."""
        if columns:
            ends = [array(self.exchange, len(p.end)) for _ in range(3)]
            self._split(columns[4], *ends)
            self.copies.keep(p, (*columns[:4], *ends))

    def _there(self, p: ContactPairs) -> tuple:
        copy = self.copies.of(p)
        return _columns(p) if copy is p else copy

    def _evaluate(self, p: ContactPairs, boost: np.ndarray, h: float, *out: np.ndarray) -> None:
        made = [array(self.exchange, *host.shape) for host in out]
        self.kernels.evaluate(*self._there(p), self._boost.of(boost), h, *made)
        self._give_evaluated(*made, *out)
        for host, copy in zip(out, made):
            self.copies.keep(host, copy)

    def _linearize(self, p: ContactPairs, weighed: np.ndarray, coupling: np.ndarray, others: tuple,
                   out: tuple[np.ndarray, ...]) -> None:
        of, made = self.copies.of, [array(self.exchange, *host.shape) for host in out]
        self.kernels.linearize(*self._there(p)[1:], of(weighed), of(coupling), *others[:-1], of(others[-1]), *made)
        self._give_linearized(*made, *out)
        for host, copy in zip(out, made):
            self.copies.keep(host, copy)

    def points(self, p: ContactPairs, block: np.ndarray, rhs: np.ndarray, coupling: np.ndarray) -> Resident | None:
        """See `PairCalls`."""
        copies, there = [self.copies.of(host) for host in (block, rhs, coupling)], self._there(p)
        if there[1] is p.vertices or any(copy is host for copy, host in zip(copies, (block, rhs, coupling))):
            return None
        return Resident((there[1], there[2], *copies[:2], there[3], copies[2]), len(rhs))

    def _measure(self, p: ContactPairs, coupling: np.ndarray, taken: np.ndarray, h: float, out: np.ndarray) -> None:
        self.kernels.measure(*self._there(p)[1:4], self.copies.of(coupling), self.copies.of(taken), h, out)

    @ti.kernel
    def _split(self, numbers: ti.types.ndarray(), end: ti.types.ndarray(), radius: ti.types.ndarray(),
               factor: ti.types.ndarray()):
        for k in range(end.shape[0]):
            end[k], factor[k], radius[k] = numbers[k, 1], numbers[k, 2], numbers[k, 3]

    @ti.kernel
    def _give_evaluated(self, numbers: ti.types.ndarray(), coupling: ti.types.ndarray(), to_numbers: ti.types.ndarray(),
                        to_coupling: ti.types.ndarray()):
        for k in range(coupling.shape[0]):
            for row in range(numbers.shape[0]):
                to_numbers[row, k] = numbers[row, k]
            for a, c in ti.static(ti.ndrange(4, 3)):
                to_coupling[k, a, c] = coupling[k, a, c]

    @ti.kernel
    def _give_linearized(self, taken: ti.types.ndarray(), block: ti.types.ndarray(), rhs: ti.types.ndarray(),
                         to_taken: ti.types.ndarray(), to_block: ti.types.ndarray(), to_rhs: ti.types.ndarray()):
        for k in range(rhs.shape[0]):
            for row in range(taken.shape[0]):
                to_taken[row, k] = taken[row, k]
            for c in ti.static(range(6)):
                to_block[k, c] = block[k, c]
            for c in ti.static(range(3)):
                to_rhs[k, c] = rhs[k, c]


def pair_calls(kernels: PairKernels, exchange: type) -> PairCalls:
    """Those that suit the layout."""
    return (DevicePairCalls if for_device() else PairCalls)(kernels, exchange)
