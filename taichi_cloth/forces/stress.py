"""Membrane stress of triangles in the material plane."""

import numpy as np

from ..backend.language import ti
from .membrane import Membrane


@ti.data_oriented
class Stress:
    """Stress of the triangles of a `Membrane`, damping included."""

    def __init__(self, membrane: Membrane) -> None:
        self.membrane = membrane
        entries = membrane.elements.entries
        self._primary = np.flatnonzero(entries.primary)
        self._element = entries.element[self._primary]
        self._rows: np.ndarray = np.zeros((membrane.elements.count, 12), dtype=membrane.model.exchange)

    def now(self) -> np.ndarray:
        """(m, 2, 2) [N/m] symmetric T: force over the width that it had, in axes of warp and weft [Biot].

        With F = (w_u, w_v) = R U and P = dE/dF per area, T is the symmetric part of R^T P = U F^+ P.
        """
        self._compute(self._rows)
        rows = np.zeros((len(self._primary), 12))
        rows[self._element] = self._rows[self._primary]
        F, P = rows[:, :6].reshape(-1, 2, 3).transpose(0, 2, 1), rows[:, 6:].reshape(-1, 2, 3).transpose(0, 2, 1)
        C = np.einsum("mia,mib->mab", F, F)
        root = np.sqrt(np.maximum(np.linalg.det(C), 0.0))
        U = (C + root[:, None, None] * np.eye(2)) / np.sqrt(np.maximum(np.trace(C, axis1=1, axis2=2) + 2 * root, 1e-30)
                                                              )[:, None, None]
        T = U @ np.linalg.solve(C + 1e-12 * np.eye(2), np.einsum("mia,mib->mab", F, P))
        return (T + T.transpose(0, 2, 1)) / 2

    @ti.kernel
    def _compute(self, out: ti.types.ndarray()):
        """(w_u, w_v) and the derivatives of the energy per area by them."""
        for e in range(self.membrane.elements.first[self.membrane.model.blocks.count]):
            w_u, w_v = self.membrane.spread(e, self.membrane.model.x)
            v_u, v_v = self.membrane.spread(e, self.membrane.model.v)
            u, v, s = self.membrane.speeds(w_u, w_v, v_u, v_v)
            g_u, g_v = self.membrane.gradient(e, w_u, w_v, u, v, s)
            for c in ti.static(range(3)):
                out[e, c] = w_u[c]
                out[e, 3 + c] = w_v[c]
                out[e, 6 + c] = g_u[c]
                out[e, 9 + c] = g_v[c]
