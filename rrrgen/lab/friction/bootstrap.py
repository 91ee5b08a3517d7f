"""Standard deviations of the estimates by resampling blocks of windows (block bootstrap).

The covariance from the Hessian of a fit assumes independent residuals and an exact friction law. Estimates from blocks
drawn with replacement vary as those from different parts of the recording do, without these assumptions.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rrrgen.base.arrays import Array
from rrrgen.lab.friction.output_error import Fit

RESAMPLES = 400


def resampled(found: Fit, blocks: NDArray[np.int64], seed: int) -> Array:
    """Draw blocks with replacement and estimate the parameters from each draw; returns (k, resamples).

    ``found`` is the fit to all windows, ``blocks`` (S,) the number of the block of each window, ``seed`` that of the
    draws. Each estimate is one Gauss-Newton step from the fit.
    """
    groups = np.unique(blocks, return_inverse=True)[1]
    count, f = int(np.max(groups)) + 1, len(found.free)
    H, g = np.zeros((count, f, f)), np.zeros((count, f))
    np.add.at(H, groups, found.normal)
    np.add.at(g, groups, found.gradient)
    g -= g.mean(axis=0)  # the search ends near the optimum, where the gradient is not quite zero
    rng = np.random.default_rng(seed)
    drawn = rng.multinomial(count, np.full(count, 1.0 / count), size=RESAMPLES).astype(float)
    normal, gradient = np.einsum("bg,gjk->bjk", drawn, H), drawn @ g
    size = np.einsum("bjj->bj", normal)
    normal[:, np.arange(f), np.arange(f)] += 1e-10 * size + 1e-300
    steps = np.linalg.solve(normal, gradient[:, :, None])[:, :, 0]
    free = np.repeat(found.candidate.to_free(found.theta)[:, None], RESAMPLES, axis=1)
    logs = found.candidate.is_logarithmic[found.free]
    free[found.free] -= np.where(logs, np.clip(steps, -3.0, 3.0), steps).T
    return found.candidate.clipped(found.candidate.from_free(free))
