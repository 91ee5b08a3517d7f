"""Extreme values: the largest residual of every block of a contact-free recording, and the level they rarely reach.

The maxima of long blocks follow a Gumbel distribution, P(max <= x) = exp(-exp(-(x - mu)/beta)), for all residuals with
tails like those of a normal or an exponential distribution. Neither independent samples nor their distribution are
needed, only maxima, and levels that the recording hardly reached follow by extrapolation. Multiples of a standard
deviation do not tell them: the residuals of a moving arm are neither white nor normal. With exponential tails the
levels are as stated; with normal tails, which fall faster, they are on the safe side.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from rrrgen.arrays import Array

EULER = 0.5772156649015329


@dataclass(frozen=True)
class Gumbel:
    """The distribution of block maxima: location ``mu`` and scale ``beta``, in the unit of the residual."""

    mu: float
    beta: float

    def level(self, probability: float) -> float:
        """The level that a block exceeds with this ``probability``."""
        return self.mu - self.beta * math.log(-math.log1p(-probability))


def fit_gumbel(maxima: Array) -> Gumbel:
    """The Gumbel distribution of ``maxima`` (N,) by probability-weighted moments (Landwehr, Matalas and Wallis 1979).

    With the sorted maxima x_(j), b0 their mean and b1 the mean of (j - 1)/(N - 1) x_(j): beta = (2 b1 - b0)/ln 2,
    mu = b0 - 0.5772 beta. Unbiased, without iteration, and less moved by a single outlier than maximum likelihood.
    """
    x = np.sort(np.asarray(maxima, float))
    b0, b1 = float(np.mean(x)), float(np.mean(np.arange(len(x)) / (len(x) - 1) * x))
    beta = (2.0 * b1 - b0) / math.log(2.0)
    return Gumbel(b0 - EULER * beta, beta)


def block_maxima(residuals: Array, samples: int) -> Array:
    """The largest magnitude of each joint in every whole block of so many ``samples``, (blocks, n), from (N, n)."""
    blocks = len(residuals) // samples
    whole = np.abs(residuals[: blocks * samples]).reshape(blocks, samples, residuals.shape[1])
    return np.asarray(whole.max(axis=1))
