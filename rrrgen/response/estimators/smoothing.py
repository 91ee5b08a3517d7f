"""Smoothing of a response over neighbouring lines, where a line needs it and the data show that it is smooth there.

Times frequency squared, the response of a joint is nearly constant away from its modes. A polynomial of order 2 through
the lines at either side then says more about the line in the middle than its own estimate does. How many lines may
take part is decided line by line: a polynomial of order 4 through the same lines estimates the error that order 2 makes
in the middle. Squared, averaged over the neighbours and less its own noise, this bias must be small against the
variance that is left; what may have escaped is added to the latter. In a window twice as wide the bias is many times as
large and its noise smaller, so that there it shows much earlier: what is found there, scaled back, decides, and in the
window itself only a bias beyond its noise counts. At resonances nothing is smoothed.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rrrgen.arrays import Array
from rrrgen.response.controller import Complex
from rrrgen.response.estimators.uncertainty import radius
from rrrgen.response.frequency_response import FrequencyResponse

HALF_WIDTHS = (3, 4, 6, 8, 12, 16, 24, 32, 48, 64, 96)  # lines at either side that may take part
NARROW_BAND = 0.03  # relative: a line this good is left as it is, and independent of its neighbours
LARGEST_BIAS = 0.15  # squared, of the variance that is left
LIKELY = 1.2  # of the variance of the bias: what its own noise may make of the squared bias
GROWTH = 32.0  # of the squared bias in a window twice as wide, at least; 2^8 where the fourth derivative makes it
ORDER, FINE_ORDER = 2, 4
EVENLY = 1e-6  # relative difference of the spacing of lines that does not count


def smooth(response: FrequencyResponse) -> FrequencyResponse:
    """The response with every line smoothed until its band is narrow, or over the widest window that it allows.

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
    """Per line (L,), over m lines at either side: value, its variance, squared bias less its noise, and that noise.

    Infinite variance, and no bias, where there are not so many lines.
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
    """For windows (L, 2m+1): value in the middle, its variance, the squared bias by order 4, the variance of that."""
    position = (f - f[:, m : m + 1]) / (f[:, -1:] - f[:, :1]) * 2.0
    if float(np.max(np.ptp(position, axis=0))) < EVENLY:
        position = position[:1]  # one set of weights for all windows
    low, high = (np.linalg.pinv(position[:, :, None] ** np.arange(order + 1))[:, 0] for order in (ORDER, FINE_ORDER))
    common = spread.mean(axis=1)  # the variance of a single line is known less well than that of its neighbourhood
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
    """Number of correlated lines that carry as much information as one independent line."""
    inside = kernel[1 : 2 * m + 1]
    return float(1.0 + 2.0 * np.sum(inside**2))
