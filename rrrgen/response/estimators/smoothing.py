"""Smoothing of a response over neighbouring spectral lines, where a line is uncertain and the response is smooth.

Times frequency squared, the response of a joint is nearly constant away from its modes. The value in the middle of a
polynomial of order 2, fitted to the lines at either side, is then more accurate than the estimate of the line itself.
The number of lines in the window is chosen line by line, so that the bias by smoothing stays small against the
remaining variance. The bias is estimated as the difference in the middle from a polynomial of order 4 fitted to the
same lines; its square is averaged over neighbouring lines, and its own noise is subtracted. A bias of this size that
may have been missed is added to the variance. The bias of a window twice as wide is many times larger and known better;
scaled back, it decides, and in the window itself only a bias beyond its noise counts. Nothing is smoothed at
resonances.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rrrgen.arrays import Array
from rrrgen.response.controller import Complex
from rrrgen.response.estimators.uncertainty import radius
from rrrgen.response.frequency_response import FrequencyResponse

HALF_WIDTHS = (3, 4, 6, 8, 12, 16, 24, 32, 48, 64, 96)  # numbers of lines at either side that are tried
NARROW_BAND = 0.03  # relative confidence radius below which a line is not smoothed, to keep it independent
LARGEST_BIAS = 0.15  # largest squared bias, as a share of the remaining variance
LIKELY = 1.2  # squared bias that noise alone explains, in units of the variance of the bias
GROWTH = 32.0  # least factor on the squared bias from a window to one twice as wide; 2^8 for a constant 4th derivative
ORDER, FINE_ORDER = 2, 4
EVENLY = 1e-6  # relative difference below which the spacings of lines are equal


def smooth(response: FrequencyResponse) -> FrequencyResponse:
    """Smooth every line of a response until its confidence band is narrow, or over the widest window without bias.

    The given response is kept as ``unsmoothed``.
    """
    dof, kernel = response.dof, response.kernel
    f, lines = response.frequency, len(response.frequency)
    enough = (NARROW_BAND * np.abs(response.P) * f**2 / radius(np.ones(1), np.inf)) ** 2
    shape, spread = response.P * f**2, response.variance * f**4
    chosen, variance = shape.copy(), spread.copy()
    freedom = np.full(lines, float(dof))
    width = np.zeros(lines, dtype=int)
    allowed = np.ones(lines, dtype=bool)
    found = {m: _smoothed(f, shape, spread, m, kernel) for m in sorted({*HALF_WIDTHS, *(2 * m for m in HALF_WIDTHS)})}
    for m in HALF_WIDTHS:
        value, left, excess, uncertain = found[m]
        wider = found[2 * m][2] / GROWTH
        small = np.where(np.isfinite(wider), np.maximum(wider, excess - LIKELY * uncertain), excess)
        allowed &= small < LARGEST_BIAS * left
        left = left + np.maximum(small, 0.0) + LARGEST_BIAS * left
        use = allowed & (variance > enough) & (left < variance)
        chosen[use], variance[use], width[use] = value[use], left[use], m
        freedom[use] = dof * (2 * m + 1) * (1.0 if kernel is None else 1.0 / _length(kernel, m))
    P, var = chosen / f**2, variance / f**4
    return replace(
        response,
        P=P,
        variance=var,
        band95=radius(var, freedom) / np.abs(P),
        details=response.details | {"smoothed_over": 2 * width + 1},
        unsmoothed=response,
    )


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
    noise[inner] = _averaged(uncertain, m)
    excess[inner] = _averaged(bias, m) - noise[inner]
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


def _averaged(values: Array, m: int) -> Array:
    """Running means over 2m+1 lines, fewer at the ends."""
    window = np.ones(2 * m + 1)
    return np.asarray(np.convolve(values, window, "same") / np.convolve(np.ones(len(values)), window, "same"))


def _toeplitz(kernel: Array, size: int) -> Array:
    padded = np.concatenate([kernel, np.zeros(max(size - len(kernel), 0))])
    return np.asarray(padded[np.abs(np.arange(size)[:, None] - np.arange(size))])


def _length(kernel: Array, m: int) -> float:
    """Number of correlated lines in a window of 2m+1 lines that carry as much information as one independent line.

    ``kernel`` (lags,) is the correlation of lines that are 0, 1, .. apart.
    """
    inside = kernel[1 : 2 * m + 1]
    return float(1.0 + 2.0 * np.sum(inside**2))
