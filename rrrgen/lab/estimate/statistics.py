"""Statistics of an estimate: errors, confidence intervals, whiteness of the residuals."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rrrgen.base.arrays import Array
from rrrgen.lab.estimate.tsqr import Rows


def rms(x: Array, axis: int | None = None) -> Array:
    """Root mean square of ``x`` over all entries or along ``axis``."""
    return np.asarray(np.sqrt(np.mean(np.square(x), axis=axis)))


def relative_error(measured: Array, predicted: Array) -> float:
    """Relative error ``||measured - predicted|| / ||measured||`` over all entries."""
    return float(np.linalg.norm(measured - predicted) / max(float(np.linalg.norm(measured)), 1e-300))


def confidence_factor(level: float, freedom: float) -> float:
    """Half width, in standard deviations, of the two-sided interval of Student's t at ``level`` (0..1)."""
    from scipy.stats import t as student

    return float(student.ppf(0.5 * (1.0 + level), max(1.0, freedom)))


@dataclass(frozen=True)
class Whiteness:
    """Autocorrelation of a residual at lags 1, 2, ... and tests of its whiteness.

    ``durbin_watson`` is about 2 for a white residual and smaller for positive correlation. ``ljung_box`` is the test
    statistic over all lags, ``p_value`` the probability of at least that value for a white residual. ``inflation`` is
    the number of samples per independent one, ``1 + 2 sum rho``; ``samples`` the number of samples.
    """

    autocorrelation: Array
    durbin_watson: float
    ljung_box: float
    p_value: float
    inflation: float
    samples: int


def whiteness(residual: Array, lags: int = 20) -> Whiteness:
    """Test the whiteness of one ``residual`` (N,), NaN where missing, over ``lags``; its mean is not removed."""
    sums, pairs = lagged_products(np.asarray(residual, float), None, min(lags, max(1, len(residual) - 1)))
    return _whiteness(sums, pairs)


def residual_whiteness(blocks: Iterable[Rows], x: Array, lags: int = 20) -> tuple[Whiteness, ...]:
    """Test the whiteness of the residuals ``tau - W x`` of every joint, over ``blocks`` of rows in order of time."""
    sums = pairs = None
    tail: Array | None = None
    tail_segment: NDArray[np.int64] | None = None
    for rows in blocks:
        residual = np.where(rows.use, rows.tau - rows.W @ x, np.nan)
        segment = rows.segment
        new = len(residual)
        if tail is not None and tail_segment is not None:
            residual, segment = np.vstack([tail, residual]), np.concatenate([tail_segment, segment])
        parts = [lagged_products(column, segment, lags, len(column) - new) for column in residual.T]
        step = np.stack([p[0] for p in parts]), np.stack([p[1] for p in parts])
        sums = step[0] if sums is None else sums + step[0]
        pairs = step[1] if pairs is None else pairs + step[1]
        tail, tail_segment = residual[-lags:], segment[-lags:]
    if sums is None or pairs is None:
        return ()
    return tuple(_whiteness(s, c) for s, c in zip(sums, pairs, strict=True))


def lagged_products(
    residual: Array, segment: NDArray[np.int64] | None, lags: int, old: int = 0, apart: int = 1
) -> tuple[Array, NDArray[np.int64]]:
    """Sums of ``r_k r_{k-l}`` over the samples k of ``residual`` (N,), and the numbers of pairs in each sum.

    The lags l are 0, 1, ..., ``lags`` times ``apart``. Samples k below ``old`` are skipped as the later one of a pair,
    because an earlier call has counted them. Pairs with a missing sample (NaN), or across two stretches (``segment``,
    (N,)), are left out.
    """
    present = np.isfinite(residual)
    r = np.where(present, residual, 0.0)
    sums, pairs = np.zeros(lags + 1), np.zeros(lags + 1, np.int64)
    for step in range(min(lags, (len(r) - 1) // apart) + 1):
        lag = step * apart
        first = max(old, lag)
        both = present[first:] & present[first - lag : len(r) - lag]
        if segment is not None:
            both = both & (segment[first:] == segment[first - lag : len(r) - lag])
        sums[step] = np.sum((r[first:] * r[first - lag : len(r) - lag])[both])
        pairs[step] = np.sum(both)
    return sums, pairs


def _whiteness(sums: Array, pairs: NDArray[np.int64]) -> Whiteness:
    from scipy.stats import chi2

    count = int(pairs[0])
    if count == 0 or sums[0] == 0.0:
        return Whiteness(np.zeros(len(sums) - 1), 2.0, 0.0, 1.0, 1.0, count)
    variance = sums[0] / count
    rho = np.divide(sums[1:], pairs[1:], out=np.zeros(len(sums) - 1), where=pairs[1:] > 0) / variance
    weights = np.maximum(pairs[1:], 1)
    box = float(count * (count + 2) * np.sum(rho**2 / weights))
    # the sum ends at the first lag whose correlation is below the noise of its estimate
    noise = 2.0 / math.sqrt(count)
    below = np.flatnonzero(rho < noise)
    until = int(below[0]) if len(below) else len(rho)
    inflation = max(1.0, 1.0 + 2.0 * float(np.sum(rho[:until])))
    return Whiteness(rho, 2.0 * (1.0 - float(rho[0])), box, float(chi2.sf(box, len(rho))), inflation, count)


def normal_expectation_of_clipped_square(limit: float) -> float:
    """``E[min(u^2, limit^2)]`` for a standard normal u: the consistency factor of Huber's scale estimate."""
    tail = math.erfc(limit / math.sqrt(2.0))
    density = math.exp(-0.5 * limit * limit) / math.sqrt(2.0 * math.pi)
    return (1.0 - tail) - 2.0 * limit * density + limit * limit * tail


MOST_LAGS = 200


def correlation_lags(white: Whiteness) -> int:
    """Number of lags at which residuals are treated as correlated in the covariance of the estimates.

    The larger of two rules: twice the lag at which the autocorrelation falls below the noise of its estimate, and the
    bandwidth of Andrews (1991) for Bartlett's window, ``1.1447 (4 r^2 N / ((1-r)^2 (1+r)^2))^(1/3)`` with the lag-one
    correlation r. The second also applies if the correlation stays above the noise at all computed lags.
    """
    noise = 2.0 / math.sqrt(max(1, white.samples))
    small = np.flatnonzero(white.autocorrelation < noise)
    seen = 2 * int(small[0] if len(small) else len(white.autocorrelation))
    r = min(0.97, max(0.0, float(white.autocorrelation[0]))) if len(white.autocorrelation) else 0.0
    andrews = 1.1447 * (4.0 * r * r * white.samples / ((1.0 - r) ** 2 * (1.0 + r) ** 2)) ** (1.0 / 3.0)
    return int(max(1, min(MOST_LAGS, white.samples // 4, max(seen, math.ceil(andrews)))))
