"""The paper's condition functions and their second derivatives, as functions of w_u and w_v; of hinges see `hinge`.

Per unit area, with the energy psi = k/2 C^2, a block H is d2 psi / d(w_u, w_v)2. The terms that each mode of K keeps:

| mode | stretch | shear | bend |
|---|---|---|---|
| gauss_newton | k dC dC^T | k dC dC^T | k dC dC^T |
| projected | + k (1 - b/|w|) (I - n n^T) where positive | positive eigenvalues of the exact block | k dC dC^T |
| paper | exact, k (dC dC^T + C ddC) | exact | exact |

In further solves of backward Euler "projected" is exact in stretch and shear where all of the matrix is positive definite.
A collapsed direction (w = 0) has n = 0: no force, no stiffness. Eigenvalues of shear: [Kim 2020].
"""

from ..backend.language import ti

TINY = 1e-30


@ti.func
def unit(w):
    """w/|w|, or 0 if w is 0."""
    return w * (1 / ti.max(w.norm(), TINY))  # one division, not three


@ti.func
def sym(m):
    """The 6 numbers xx, xy, xz, yy, yz, zz of a symmetric 3x3 matrix."""
    return ti.Vector([m[0, 0], m[0, 1], m[0, 2], m[1, 1], m[1, 2], m[2, 2]])


@ti.func
def sym_outer(a):
    """a a^T as 6 numbers."""
    return ti.Vector([a[0] * a[0], a[0] * a[1], a[0] * a[2], a[1] * a[1], a[1] * a[2], a[2] * a[2]])


@ti.func
def sym_both(a, b):
    """a b^T + b a^T as 6 numbers."""
    return ti.Vector([2 * a[0] * b[0], a[0] * b[1] + a[1] * b[0], a[0] * b[2] + a[2] * b[0],
                      2 * a[1] * b[1], a[1] * b[2] + a[2] * b[1], 2 * a[2] * b[2]])


@ti.func
def sym_scaled_identity(s):
    """s I as 6 numbers."""
    return ti.Vector([s, 0.0, 0.0, s, 0.0, s])


@ti.func
def sym_times(m, x):
    """Product of a symmetric 3x3 matrix, given by its 6 numbers, with a vector."""
    return ti.Vector([m[0] * x[0] + m[1] * x[1] + m[2] * x[2],
                      m[1] * x[0] + m[3] * x[1] + m[4] * x[2],
                      m[2] * x[0] + m[4] * x[1] + m[5] * x[2]])


@ti.func
def sym_unpack(s):
    """The symmetric 3x3 matrix of 6 numbers."""
    return ti.Matrix([[s[0], s[1], s[2]], [s[1], s[3], s[4]], [s[2], s[4], s[5]]])


@ti.func
def stretch_stiffness(w, k, b, force, slope, mode: ti.template(), whole):
    """d2/dw2 of k/2 (|w| - b)^2 and of an energy with that further force and slope in |w|, 6 numbers; projected but where
    `whole` is 1."""
    length = w.norm()
    transverse = k * 0
    if ti.static(mode != "gauss_newton"):
        if length > TINY:
            transverse = k * (1 - b / length) + force / length
        if ti.static(mode == "projected"):
            transverse = ti.select(whole == 1, transverse, ti.max(transverse, 0))
    return (k + slope - transverse) * sym_outer(unit(w)) + sym_scaled_identity(transverse)


@ti.func
def shear_stiffness(w_u, w_v, k, C, mode: ti.template(), whole):
    """d2/d(w_u, w_v)2 of an energy of w_u . w_v as uu (6 numbers), uv (3x3), vv (6 numbers).

    Its slope is k C and its second derivative k: of k/2 (w_u . w_v)^2, C is w_u . w_v. Projected but where `whole` is 1.
    """
    uu, uv, vv = k * sym_outer(w_v), k * w_v.outer_product(w_u), k * sym_outer(w_u)
    if ti.static(mode == "paper"):
        uv += k * C * ti.Matrix.identity(float, 3)
    if ti.static(mode == "projected"):
        if whole == 1:
            uv += k * C * ti.Matrix.identity(float, 3)
        else:
            # in the basis (n_p, n_p)/sqrt 2, (n_m, -n_m)/sqrt 2 the exact block is 2x2 with one positive eigenvalue
            n_p, n_m = unit(w_u + w_v), unit(w_v - w_u)
            s_p, s_m = (w_u + w_v).norm() * ti.sqrt(0.5), (w_v - w_u).norm() * ti.sqrt(0.5)
            total = w_u.norm_sqr() + w_v.norm_sqr()
            top = 0.5 * (total + ti.sqrt(total * total + 4 * C * (C + 2 * w_u.dot(w_v))))
            along, against = top + C - s_m * s_m, s_p * s_m
            # the eigenvalues left: C twice on (t, t), -C twice on (t, -t), t normal to n_p or n_m
            t, sign = n_p, 1.0
            if C < 0:
                along, against = s_p * s_m, top - C - s_p * s_p
                t, sign = n_m, -1.0
            size = ti.max(ti.sqrt(along * along + against * against), TINY)
            e_u, e_v = (along * n_p + against * n_m) / size, (along * n_p - against * n_m) / size
            rest = 0.5 * k * ti.abs(C) * (sym_scaled_identity(1.0) - sym_outer(t))
            top *= 0.5 * k
            uu = top * sym_outer(e_u) + rest
            uv = top * e_u.outer_product(e_v) + sign * sym_unpack(rest)
            vv = top * sym_outer(e_v) + rest
    return uu, uv, vv
