"""Radius of the confidence circle of a complex estimate, from its variance."""

from __future__ import annotations

import numpy as np

from rrrgen.arrays import Array

CONFIDENCE = 0.95
MANY = 1e6  # degrees of freedom from which on the variance counts as exactly known


def radius(variance: Array, dof: Array | float) -> Array:
    """Radius of the 95 % confidence circle of a complex number: ``radius^2 = variance F.95(2, 2 dof)``.

    ``dof`` are the complex degrees of freedom with which its ``variance`` was estimated.
    """
    from scipy.stats import f as f_distribution

    factor = np.asarray(f_distribution.ppf(CONFIDENCE, 2, 2.0 * np.minimum(dof, MANY)))
    return np.asarray(np.sqrt(factor * variance))
