"""Numbers that carry their gradient and their Hessian by n variables: exact derivatives of whatever is written with them."""

import math

import numpy as np


class Jet:
    """value, gradient (n,), Hessian (n, n)."""

    def __init__(self, value, gradient, hessian):
        self.value, self.gradient, self.hessian = value, gradient, hessian

    def _as_jet(self, other):
        return other if isinstance(other, Jet) else Jet(other, 0 * self.gradient, 0 * self.hessian)

    def through(self, f, df, ddf):
        """A function of this number, given its value and derivatives here."""
        return Jet(f, df * self.gradient, df * self.hessian + ddf * np.outer(self.gradient, self.gradient))

    def __add__(self, other):
        other = self._as_jet(other)
        return Jet(self.value + other.value, self.gradient + other.gradient, self.hessian + other.hessian)

    def __mul__(self, other):
        other = self._as_jet(other)
        cross = np.outer(self.gradient, other.gradient)
        return Jet(self.value * other.value, self.value * other.gradient + other.value * self.gradient,
                   self.value * other.hessian + other.value * self.hessian + cross + cross.T)

    def __neg__(self):
        return self * -1.0

    def __sub__(self, other):
        return self + -self._as_jet(other)

    def __rsub__(self, other):
        return self._as_jet(other) - self

    __radd__, __rmul__ = __add__, __mul__

    def __truediv__(self, other):
        other = self._as_jet(other)
        return self * other.through(1 / other.value, -1 / other.value**2, 2 / other.value**3)


def variables(values):
    """Jets of all numbers of an array, as an object array of its shape."""
    values = np.asarray(values, dtype=float)
    n = values.size
    out = np.empty(n, dtype=object)
    for k, value in enumerate(values.ravel()):
        out[k] = Jet(float(value), np.eye(n)[k], np.zeros((n, n)))
    return out.reshape(values.shape)


def sqrt(x):
    root = math.sqrt(x.value)
    return x.through(root, 0.5 / root, -0.25 / root**3)


def atan2(y, x):
    """The angle of the point (x, y)."""
    a, b = y.value, x.value
    r2 = a * a + b * b
    dy, dx = b / r2, -a / r2
    cross = np.outer(y.gradient, x.gradient)
    hessian = (dy * y.hessian + dx * x.hessian
               + 2 * a * b / r2**2 * (np.outer(x.gradient, x.gradient) - np.outer(y.gradient, y.gradient))
               + (a * a - b * b) / r2**2 * (cross + cross.T))
    return Jet(math.atan2(a, b), dy * y.gradient + dx * x.gradient, hessian)


def dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross(a, b):
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]], dtype=object)


def norm(a):
    return sqrt(dot(a, a))
