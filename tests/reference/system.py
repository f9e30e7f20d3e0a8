"""Eq. (18) of [BW98] in dense matrices, and its solution with held directions."""

import numpy as np


def matrix(sheet, h):
    """(3n, 3n) A = M - h D - h^2 K."""
    return np.diag(np.repeat(sheet.mass, 3)) - h * sheet.D - h**2 * sheet.K


def right_hand_side(sheet, h, y=None):
    """(3n,) b = h (f_0 + h K v_0 + K y)."""
    moved = h * sheet.v if y is None else h * sheet.v + y
    return h * (sheet.force.ravel() + sheet.K @ moved.ravel())


def solve(sheet, h, held=()):
    """(dv (n, 3), impulse of the constraints A dv - b (n, 3)).

    Args:
        held: (vertex, orthonormal rows of its held directions (d, 3), z (3,), y (3,)) each.
    """
    n = len(sheet.x)
    z, y, rows = np.zeros((n, 3)), np.zeros((n, 3)), [np.zeros((0, 3 * n))]
    for vertex, directions, z_i, y_i in held:
        row = np.zeros((len(directions), 3 * n))
        row[:, 3 * vertex:3 * vertex + 3] = directions
        rows.append(row)
        z[vertex], y[vertex] = directions.T @ directions @ z_i, y_i
    G = np.concatenate(rows)
    A, b = matrix(sheet, h), right_hand_side(sheet, h, y)
    whole = np.block([[A, G.T], [G, np.zeros((len(G), len(G)))]])  # Lagrange multipliers for G dv = G z
    answer = np.linalg.solve(whole, np.concatenate([b, G @ z.ravel()]))
    dv = answer[:3 * n]
    return dv.reshape(n, 3), (A @ dv - b).reshape(n, 3)


def backward_euler(sheet, h, held=()):
    """(x, v) after the paper's step: v + dv, x + h (v + dv) + y."""
    dv, _ = solve(sheet, h, held)
    v, x = sheet.v + dv, sheet.x + h * (sheet.v + dv)
    for vertex, _, _, y in held:
        x[vertex] = x[vertex] + y
    return x, v
