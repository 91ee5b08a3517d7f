"""Smoothing of a response over neighbouring spectral lines, where a line is uncertain and the response is smooth.

Times frequency squared, the response of a joint is nearly constant away from its modes. The value in the middle of a
polynomial of order 2, fitted to the lines at either side, is then more accurate than the estimate of the line itself.
But it shares its error with its neighbours, so that wide windows leave few independent values in a recording, and the
share of lines within their bands is left to chance. So a line is smoothed only as far as it needs: over a few lines
where these give a narrow band, over more only until it can be trusted (:data:`GOALS`). Where it cannot, it is left.

The bias by smoothing must stay small against the remaining variance. It is estimated as the difference in the middle
from a polynomial of order 4 fitted to the same lines; its square is averaged over neighbouring lines, and its own noise
is subtracted. A bias of this size that may have been missed is added to the variance. The bias of a window twice as
wide is many times larger and known better; scaled back, it decides, and in the window itself only a bias beyond its
noise counts. Nothing is smoothed at resonances.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rrrgen.base.arrays import Array
from rrrgen.lab.response.controller import Complex
from rrrgen.lab.response.frequency_response import WIDEST_BAND, FrequencyResponse
from rrrgen.lab.response.uncertainty import (
    GROWTH,
    MANY,
    PARABOLA_AT_ITS_CENTRE,
    radius,
    running_mean,
)

HALF_WIDTHS = (2, 3, 4, 5, 6, 8, 12, 16, 24, 32, 48, 64, 96)  # numbers of lines at either side that are tried
GOALS = ((0.03, 4, 0), (0.04, 8, 4), (0.09, 96, 0), (0.999 * WIDEST_BAND, 96, 0))
"""Relative confidence radii, each with the most independent lines at either side over which it is sought.

A line takes the first goal that it reaches, over as few lines as possible. The last is the radius at which a line is
trusted. Between the second and the third there is none: near 5 % a line would be neither independent nor sure to be
within 4 %. The third number is the least of independent values in a response for which a goal is sought: of lines with
a radius of 4 % one in fifty is off by more than 4 % or 2.5 degrees, with all lines that share its data, and of a few
values it would be a large part.
"""
LARGEST_BIAS = 0.15  # largest squared bias, as a share of the remaining variance
MISSED_BIAS = 0.05  # squared bias that may have been missed, alike
UNLIKELY = 1e-3  # probability that noise alone looks like a bias
ORDER, FINE_ORDER = 2, 4
EVENLY = 1e-6  # relative difference below which the spacings of lines are equal


def smooth(response: FrequencyResponse) -> FrequencyResponse:
    """Smooth every line of a response as far as its goal needs (:data:`GOALS`), and where no bias forbids it.

    A line that reaches no goal stays as it is. The given response is kept as ``unsmoothed``.
    """
    f, kernel, line = response.frequency, response.kernel, np.arange(len(response.frequency))
    value, variance, freedom = _windows(response)
    band = radius(variance, freedom) / np.abs(value)
    alike = 1.0 if kernel is None else _length(kernel, len(kernel))
    half = np.array([0, *HALF_WIDTHS])
    chosen = np.zeros(len(f), dtype=np.int64)
    for goal, most, values in reversed(GOALS):
        reached = (band < goal) & (half[:, None] <= most * alike)
        found, least = reached.any(axis=0), reached.argmax(axis=0)
        if np.sum(_independent(half[least[found]], alike)) >= values:
            chosen = np.where(found, least, chosen)
    P, var = value[chosen, line] / f**2, variance[chosen, line] / f**4
    return replace(
        response,
        P=P,
        variance=var,
        band95=band[chosen, line],
        details=response.details | {"smoothed_over": 2 * half[chosen] + 1},
        unsmoothed=response,
    )


def _independent(half: Array, alike: float) -> Array:
    """Number of independent values for which lines count that are smoothed over ``half`` lines at either side."""
    return np.asarray(np.minimum(1.0 / alike, PARABOLA_AT_ITS_CENTRE / (2.0 * half + 1.0)))


def _windows(response: FrequencyResponse) -> tuple[Complex, Array, Array]:
    """The response times frequency squared, smoothed over no lines and each of :data:`HALF_WIDTHS` (first axis).

    Returns values, variances with the bias that may have been missed, and degrees of freedom, (widths, L) each. The
    variance is infinite where smoothing is not allowed.
    """
    from scipy.stats import chi2

    f, dof, kernel = response.frequency, response.dof, response.kernel
    shape, spread = response.P * f**2, response.variance * f**4
    found = {m: _smoothed(f, shape, spread, m, kernel) for m in sorted({*HALF_WIDTHS, *(2 * m for m in HALF_WIDTHS)})}
    values, variances, freedoms = [shape], [spread], [np.broadcast_to(dof, len(f))]
    allowed = np.ones(len(f), dtype=bool)
    for m in HALF_WIDTHS:
        value, left, excess, uncertain = found[m]
        alike = 1.0 if kernel is None else _length(kernel, m)
        number = (2 * m + 1) / alike  # of independent lines in the window
        explained = chi2.isf(UNLIKELY, number) / number - 1.0
        wider = found[2 * m][2] / GROWTH
        bias = np.where(np.isfinite(wider), np.maximum(wider, excess - explained * uncertain), excess)
        allowed &= np.isfinite(left) & (bias < LARGEST_BIAS * left)
        values.append(value)
        variances.append(np.where(allowed, (1.0 + MISSED_BIAS) * left + np.maximum(bias, 0.0), np.inf))
        freedoms.append(np.minimum(freedoms[0] * number, MANY))
    return np.array(values), np.array(variances), np.array(freedoms)


def _smoothed(
    f: Array, shape: Complex, spread: Array, m: int, kernel: Array | None
) -> tuple[Complex, Array, Array, Array]:
    """Smooth over m lines at either side; returns four arrays (L,), one entry per line.

    They are the smoothed value, its variance, an estimate of its squared bias from which the part due to noise is
    subtracted, and that part. Where there are fewer than m lines at a side, the variance is infinite and the estimate
    of the bias NaN.
    """
    lines = len(f)
    value, left, excess, noise = shape.copy(), np.full(lines, np.inf), np.full(lines, np.nan), np.zeros(lines)
    if lines <= 4 * m:
        return value, left, excess, noise
    inner = np.arange(m, lines - m)
    around = inner[:, None] + np.arange(-m, m + 1)
    value[inner], left[inner], bias, uncertain = _window(f[around], shape[around], spread[around], m, kernel)
    noise[inner] = running_mean(uncertain, m)
    excess[inner] = running_mean(bias, m) - noise[inner]
    return value, left, excess, noise


def _window(
    f: Array, shape: Complex, spread: Array, m: int, kernel: Array | None
) -> tuple[Complex, Array, Array, Array]:
    """Fit polynomials in windows of 2m+1 lines; returns four arrays, one entry per window.

    They are the value of the polynomial of order 2 in the middle of the window, its variance, the squared difference
    from the polynomial of order 4 there (the bias), and the variance of that difference.
    """
    position = (f - f[:, m : m + 1]) / (f[:, -1:] - f[:, :1]) * 2.0
    if float(np.max(np.ptp(position, axis=0))) < EVENLY:
        position = position[:1]  # one set of weights for all windows
    low, high = (np.linalg.pinv(position[:, :, None] ** np.arange(order + 1))[:, 0] for order in (ORDER, FINE_ORDER))
    common = spread.mean(axis=1)  # the mean variance of a window is more certain than that of a single line
    C = np.eye(2 * m + 1) if kernel is None else _toeplitz(kernel, 2 * m + 1)
    value = np.sum(low * shape, axis=1)
    difference = high - low
    bias = np.abs(np.sum(difference * shape, axis=1)) ** 2
    left, uncertain = (np.sum((hat @ C) * hat, axis=1) * common for hat in (low, difference))
    return value, left, bias, uncertain


def _toeplitz(kernel: Array, size: int) -> Array:
    padded = np.concatenate([kernel, np.zeros(max(size - len(kernel), 0))])
    return np.asarray(padded[np.abs(np.arange(size)[:, None] - np.arange(size))])


def _length(kernel: Array, m: int) -> float:
    """Number of correlated lines in a window of 2m+1 lines that carry as much information as one independent line.

    ``kernel`` (lags,) is the correlation of lines that are 0, 1, .. apart.
    """
    inside = kernel[1 : 2 * m + 1]
    return float(1.0 + 2.0 * np.sum(inside**2))
