"""The paper's conditions C of a triangle and of a hinge [BW98 §4.2], as functions of jets."""

import math

import numpy as np

from .jet import atan2, cross, dot, norm, variables


def deformation(x, uv):
    """(w_u, w_v) (9) of a triangle with corners x (3, 3), uv (3, 2)."""
    (du_1, dv_1), (du_2, dv_2) = uv[1] - uv[0], uv[2] - uv[0]
    d_1, d_2, whole = x[1] - x[0], x[2] - x[0], du_1 * dv_2 - du_2 * dv_1
    return (d_1 * dv_2 - d_2 * dv_1) * (1 / whole), (d_2 * du_1 - d_1 * du_2) * (1 / whole)


def membrane(x, uv, b):
    """The three conditions of a triangle, as jets of w = (w_u, w_v), and dw/dx (6, 9)."""
    w = np.concatenate(deformation(np.asarray(x, float), uv))
    slope = np.zeros((6, 9))
    for k in range(9):
        unit = np.zeros(9)
        unit[k] = 1
        slope[:, k] = np.concatenate(deformation(unit.reshape(3, 3), uv))
    j = variables(w)
    return norm(j[:3]) - b[0], norm(j[3:]) - b[1], dot(j[:3], j[3:]), slope


def theta(x):
    """Angle between the normals of the triangles (i, j, a) and (j, i, b) of a hinge, x (4, 3) their corners in this order."""
    e, a, b = x[1] - x[0], x[2] - x[0], x[3] - x[0]
    n_a, n_b = cross(e, a), cross(b, e)
    return atan2(dot(cross(n_a, n_b), e) / norm(e), dot(n_a, n_b))


def bend(x, theta_0, area):
    """The condition of a hinge, a jet of its 12 coordinates; area: of its smaller triangle at rest.

    theta - theta_0 the short way round, level at +-pi by a parabola in the last .2 rad, times r (2 - r) for each triangle
    that has but a part r < .1 of `area`, r in units of that.
    """
    x = variables(x)
    C = theta(x) - theta_0
    if C.value > math.pi:
        C = C - 2 * math.pi
    elif C.value < -math.pi:
        C = C + 2 * math.pi
    if abs(C.value) > math.pi - 0.2:
        sign = math.copysign(1.0, C.value)
        left = math.pi - sign * C
        C = sign * (math.pi - 0.1 - left * left * 2.5)
    e = x[1] - x[0]
    for arm in (x[2] - x[0], x[3] - x[0]):
        part = norm(cross(e, arm)) * (1 / (2 * 0.1 * area))
        if part.value < 1:
            C = C * part * (2 - part)
    return C
