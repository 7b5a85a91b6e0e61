"""A logistic curve through outcomes that are yes or no, with its band, and where it reaches a share."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...controllers.errors import InvalidValueError

Array = NDArray[np.float64]
Z = 1.959963984540054  # of a 95 % interval of the normal distribution
TOLERANCE = 1e-8  # of the gradient, with inputs of mean 0 and variance 1


@dataclass(frozen=True)
class LogisticFit:
    """Maximum-likelihood fit of P(yes) = 1 / (1 + exp(-(a + b x)))."""

    intercept: float  # a
    slope: float  # b, by unit of x
    covariance: Array  # (2, 2) of (a, b): inverse of the information at the fit

    def probability(self, x: ArrayLike) -> Array:
        """P(yes) at each x."""
        from scipy.special import expit

        return expit(self.intercept + self.slope * np.asarray(x, dtype=np.float64))

    def band(self, x: ArrayLike) -> tuple[Array, Array]:
        """95 % band of P(yes) at each x, low and high: that of a + b x by its normal distribution (Wald)."""
        from scipy.special import expit

        x = np.asarray(x, dtype=np.float64)
        (aa, ab), (_, bb) = self.covariance
        half = Z * np.sqrt(aa + 2.0 * ab * x + bb * x**2)
        middle = self.intercept + self.slope * x
        return expit(middle - half), expit(middle + half)

    def input_at(self, share: float) -> float:
        """The x at which P(yes) = share, (log(share / (1 - share)) - a) / b."""
        return (_logit(share) - self.intercept) / self.slope

    def input_interval(self, share: float) -> tuple[float, float] | None:
        """95 % interval of `input_at`: all x whose band holds the share (Fieller 1954).

        The roots of (a + b x - l)^2 = z^2 (v_aa + 2 v_ab x + v_bb x^2), l the logit of the share. None where
        the slope may be 0, b^2 <= z^2 v_bb: the interval has no end then.
        """
        (aa, ab), (_, bb) = Z**2 * self.covariance
        off = self.intercept - _logit(share)
        square, linear, constant = self.slope**2 - bb, off * self.slope - ab, off**2 - aa
        if square <= 0.0:
            return None
        root = math.sqrt(max(linear**2 - square * constant, 0.0))
        return float((-linear - root) / square), float((-linear + root) / square)


def fit_logistic(x: ArrayLike, yes: ArrayLike) -> LogisticFit | None:
    """Fit the curve by maximum likelihood; None where it has no finite maximum.

    There is one exactly where the outcomes overlap: some yes above some no, and some yes below some no
    (Albert and Anderson 1984, Biometrika 71, 1-10).

    Args:
        x: inputs (n,).
        yes: outcomes (n,).

    Raises:
        InvalidValueError: lists of different length, or an input that is not finite.
    """
    x, yes = np.asarray(x, dtype=np.float64), np.asarray(yes, dtype=np.bool_)
    if x.shape != yes.shape or x.ndim != 1 or not np.isfinite(x).all():
        raise InvalidValueError(
            f"inputs must be finite, one an outcome, got shapes {x.shape} and {yes.shape}"
        )
    if not (yes.any() and (~yes).any() and x[yes].min() < x[~yes].max() and x[~yes].min() < x[yes].max()):
        return None
    from scipy.optimize import minimize
    from scipy.special import expit

    middle, spread = float(x.mean()), float(x.std())
    design = np.column_stack([np.ones_like(x), (x - middle) / spread])

    def loss(at: Array) -> float:
        return float(np.logaddexp(0.0, np.where(yes, -1.0, 1.0) * (design @ at)).sum())

    def gradient(at: Array) -> Array:
        return design.T @ (expit(design @ at) - yes)

    def information(at: Array) -> Array:
        share = expit(design @ at)
        return (design * (share * (1.0 - share))[:, None]).T @ design

    found = minimize(
        loss, np.zeros(2), jac=gradient, hess=information, method="trust-exact", options={"gtol": TOLERANCE}
    )
    back = np.array([[1.0, -middle / spread], [0.0, 1.0 / spread]])  # to the unit of x
    intercept, slope = back @ found.x
    covariance = back @ np.linalg.inv(information(found.x)) @ back.T
    return LogisticFit(float(intercept), float(slope), np.asarray(covariance, dtype=np.float64))


def _logit(share: float) -> float:
    return math.log(share / (1.0 - share))
