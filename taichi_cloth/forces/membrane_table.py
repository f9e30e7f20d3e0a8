"""Numbers of a membrane's materials and meshes, before any field is made. numpy only."""

import numpy as np

from ..scene.fabric import pair
from ..system.elements import row_sums

K_U, K_V, K_S, D_U, D_V, D_S, B_U, B_V = range(8)  # columns of the table of materials


def row_of(fabric) -> list[float]:
    """A fabric's row of the table: k of warp, weft and shear, k_d of these, b of warp and weft."""
    stretch, shear = fabric.stretch, fabric.shear
    k, k_d, b = (pair(stretch.k), pair(stretch.k_d), pair(stretch.b)) if stretch else ((0, 0), (0, 0), (1, 1))
    return [*k, shear.k if shear else 0, *k_d, shear.k_d if shear else 0, *b]


def materials_of(cloths: list) -> np.ndarray:
    """(m,) number of each triangle's fabric among all of the cloths'."""
    first = np.cumsum([0] + [len(c.fabrics) for c in cloths])
    return np.concatenate([c.fabric_of + k for c, k in zip(cloths, first)])


def limits_of(fabric) -> list[float]:
    """b_u, b_v, L_u, L_v and L of shear; NaN if there is none."""
    stretch, shear = fabric.stretch, fabric.shear
    limit = pair(stretch.limit) if stretch and stretch.limit is not None else (np.nan, np.nan)
    return [*(pair(stretch.b) if stretch else (1.0, 1.0)), *limit, shear.limit if shear and shear.limit else np.nan]


def row_bounds(vertices: np.ndarray, inverse: np.ndarray, mass: np.ndarray, k: np.ndarray) -> np.ndarray:
    """Bounds on the eigenvalues of M^-1 K in the plane of flat cloth. Warp and weft pull at right angles.

    Args:
        k: (m, 3) stiffness of warp, weft and shear times the areas [N m].

    Returns:
        (n,) one a particle; the largest is the bound [1/s^2].
    """
    u, v = (np.column_stack([-inverse[:, a] - inverse[:, a + 2], inverse[:, a], inverse[:, a + 2]]) for a in (0, 1))
    u_rows, v_rows, s_rows = (row_sums(vertices, factor[:, None, None] * np.abs(np.einsum("ei,ej->eij", p, p)), mass)
                              for p, factor in zip((u, v, np.hypot(u, v)), k.T))
    return np.maximum(u_rows, v_rows) + s_rows
