"""Confidence circles of complex estimates, limits of the bias by averaging, variances of unknowns of least squares."""

from __future__ import annotations

import numpy as np

from rrrgen.base.arrays import Array

CONFIDENCE = 0.95
LEAST_DEPENDENCE = 1e-12  # least relative dependence of errors on an unknown: that of rounding
MANY = 1e6  # degrees of freedom from which on the variance counts as exactly known
PARABOLA_AT_ITS_CENTRE = 9.0 / 4.0  # variance of a fitted parabola's centre value, over that of the mean of its lines
GROWTH = 32.0  # least factor on the squared bias from a window to one twice as wide; 2^8 for a constant 4th derivative


def radius(variance: Array, dof: Array | float) -> Array:
    """Radius of the 95 % confidence circle of a complex number: ``radius^2 = variance F.95(2, 2 dof)``.

    ``dof`` are the complex degrees of freedom with which its ``variance`` was estimated.
    """
    from scipy.stats import f as f_distribution

    factor = np.asarray(f_distribution.ppf(CONFIDENCE, 2, 2.0 * np.minimum(dof, MANY)))
    return np.asarray(np.sqrt(factor * variance))


def running_mean(values: Array, m: int) -> Array:
    """Means over 2m+1 values, fewer at the ends."""
    window = np.ones(2 * m + 1)
    count = np.convolve(np.ones(len(values)), window)
    return np.asarray((np.convolve(values, window) / count)[m : m + len(values)])


def unknown_variances(J: Array, variance: float) -> Array:
    """Variances (m,) of the unknowns of a least-squares fit with derivatives ``J`` (N, m) and errors of ``variance``.

    An unknown that the errors do not depend on, alone or together with others, has a huge variance, not none as by a
    pseudo-inverse.
    """
    sizes = np.linalg.norm(J, axis=0)
    least = LEAST_DEPENDENCE * float(np.max(sizes, initial=0.0)) + 1e-300
    scaled = J / np.maximum(sizes, least)
    values, vectors = np.linalg.eigh(scaled.T @ scaled)
    inverse = np.einsum("ik,k->i", vectors**2, 1.0 / np.maximum(values, LEAST_DEPENDENCE))
    return np.asarray(variance * inverse / np.maximum(sizes, least) ** 2)
