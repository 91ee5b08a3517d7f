"""From the variance of a complex estimate to the circle that holds the truth."""

from __future__ import annotations

import numpy as np

from rrrgen.arrays import Array

CONFIDENCE = 0.95
MANY = 1e6  # degrees of freedom: the variance is as good as known


def radius(variance: Array, dof: Array | float) -> Array:
    """Of the 95 % circles of complex numbers whose ``variance`` was estimated with ``dof`` complex degrees of freedom:
    ``radius^2 = variance F.95(2, 2 dof)``.
    """
    from scipy.stats import f as f_distribution

    factor = np.asarray(f_distribution.ppf(CONFIDENCE, 2, 2.0 * np.minimum(dof, MANY)))
    return np.asarray(np.sqrt(factor * variance))
