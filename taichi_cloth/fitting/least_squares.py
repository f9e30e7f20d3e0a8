"""Least squares for positive parameters, with the uncertainty of each.

Parameters p are fitted as q = log p: r(q) = (model - measured) / sigma. Near the optimum, cov(q) = s^2 (J^T J)^-1 with
J = dr/dq, s^2 = |r|^2 / (m - n), or 1 where the measurements' sigma is known. Intervals are exp(q -+ t sqrt(cov)) with
Student's t, so that they are positive too. The band of the curve is that of its mean: -+ t sqrt(g cov g^T), g = d model / d q.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..errors import SceneError

STEP = 1e-5  # of q, for differences
Model = Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True)
class Estimate:
    """Estimate of n parameters.

    Attributes:
        values: (n,); low, high: (n,) ends of their intervals, NaN if there are no more measurements than parameters.
        covariance: (n, n) of the parameters; NaN likewise.
        scatter: standard deviation of the residuals, in the measurements' unit (in sigmas where these are given).
    """

    values: np.ndarray
    low: np.ndarray
    high: np.ndarray
    covariance: np.ndarray
    scatter: float
    log_covariance: np.ndarray
    t: float

    def band(self, model: Model) -> tuple[np.ndarray, np.ndarray]:
        """(model at the values, half the width of its band)."""
        q = np.log(self.values)
        g = _slope(lambda z: model(np.exp(z)), q)
        return model(self.values), self.t * np.sqrt(np.maximum(np.einsum("ik,kl,il->i", g, self.log_covariance, g), 0.0))


def estimate(model: Model, measured: np.ndarray, start: np.ndarray, bounds: tuple[np.ndarray, np.ndarray],
             sigma: np.ndarray | None, confidence: float, names: tuple[str, ...]) -> Estimate:
    """Fits a model of parameters (n,) to measurements (m,).

    Raises:
        SceneError: fewer measurements than parameters, or an optimum at a bound, or one that the data do not determine.
    """
    from scipy import optimize, stats

    m, n = len(measured), len(start)
    if m < n:
        raise SceneError(f"fit: {m} measurements do not determine {n} parameters ({', '.join(names)})")
    scale = np.ones(m) if sigma is None else sigma

    def residuals(q: np.ndarray) -> np.ndarray:
        return (model(np.exp(q)) - measured) / scale

    low, high = np.log(bounds[0]), np.log(bounds[1])
    found = optimize.least_squares(residuals, np.log(start), bounds=(low, high), x_scale="jac", xtol=1e-12, ftol=1e-14,
                                   gtol=1e-14)
    q = found.x
    for k in range(n):
        if min(q[k] - low[k], high[k] - q[k]) < 1e-3 * (high[k] - low[k]):
            raise SceneError(f"fit: {names[k]} runs to {np.exp(q[k]):.3g}, the end of the range that was tried "
                             f"({bounds[0][k]:.3g} to {bounds[1][k]:.3g}): the data do not determine it there, or --range "
                             "must reach further")
    J, free = _slope(residuals, q), m - n
    scatter = float(np.sqrt(np.sum(residuals(q) ** 2) / max(free, 1)))
    if np.linalg.matrix_rank(J, tol=1e-10 * max(float(np.linalg.norm(J)), 1e-300)) < n:
        raise SceneError(f"fit: the data do not tell {' and '.join(names)} apart")
    known = sigma is not None
    if not free and not known:
        covariance, t = np.full((n, n), np.nan), np.nan
    else:
        covariance = np.linalg.inv(J.T @ J) * (1.0 if known else scatter**2)
        t = float(stats.norm.ppf(0.5 + confidence / 2) if known else stats.t.ppf(0.5 + confidence / 2, free))
    p, wide = np.exp(q), t * np.sqrt(np.diag(covariance))
    return Estimate(p, p * np.exp(-wide), p * np.exp(wide), covariance * np.outer(p, p), scatter, covariance, t)


def _slope(f: Callable[[np.ndarray], np.ndarray], q: np.ndarray) -> np.ndarray:
    """(m, n) central differences."""
    return np.column_stack([(f(q + d) - f(q - d)) / (2 * STEP) for d in STEP * np.eye(len(q))])
