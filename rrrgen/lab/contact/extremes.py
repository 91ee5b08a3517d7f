"""Extreme-value statistics: the level that the block maxima of a signal exceed with a given small probability.

The maxima of long blocks follow a Gumbel distribution, P(max <= x) = exp(-exp(-(x - mu)/beta)), if the tails of the
signal are like those of a normal or an exponential distribution. The samples need not be independent, and their own
distribution need not be known. The fitted distribution extrapolates to levels that the recording hardly reached. A
multiple of the standard deviation would not do: the residuals of a moving arm are neither white nor normal. For
exponential tails the exceedance probability is as stated; for normal tails, which fall faster, it is smaller.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from rrrgen.base.arrays import Array

EULER = 0.5772156649015329


@dataclass(frozen=True)
class Gumbel:
    """Gumbel distribution of the maximum of a residual over a block of samples.

    ``mu`` is its location and ``beta`` its scale, both in the unit of the residual.
    """

    mu: float
    beta: float

    def level(self, probability: float) -> float:
        """Level that the maximum of one block exceeds with the given ``probability``, in the unit of the residual."""
        return self.mu - self.beta * math.log(-math.log1p(-probability))


def fit_gumbel(maxima: Array) -> Gumbel:
    """Fit a Gumbel distribution to ``maxima`` (N,) by probability-weighted moments.

    With the sorted maxima x_(j), j = 1..N, b0 is their mean and b1 the mean of (j - 1)/(N - 1) x_(j); then
    beta = (2 b1 - b0)/ln 2 and mu = b0 - 0.5772 beta. The estimate needs no iteration and is less sensitive to a
    single outlier than maximum likelihood. Source: Landwehr, Matalas and Wallis (1979).
    """
    x = np.sort(np.asarray(maxima, float))
    b0, b1 = float(np.mean(x)), float(np.mean(np.arange(len(x)) / (len(x) - 1) * x))
    beta = (2.0 * b1 - b0) / math.log(2.0)
    return Gumbel(b0 - EULER * beta, beta)


def block_maxima(residuals: Array, samples: int) -> Array:
    """Largest magnitude of ``residuals`` (N, n) in each complete block of ``samples`` samples, (N // samples, n)."""
    blocks = len(residuals) // samples
    whole = np.abs(residuals[: blocks * samples]).reshape(blocks, samples, residuals.shape[1])
    return np.asarray(whole.max(axis=1))
