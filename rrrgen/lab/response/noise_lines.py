"""Local polynomial method for any excitation that is rough over the spectral lines, such as noise.

Near a resonance a response is no polynomial over a wide window, so that the estimate is biased, and the band does not
show it. So the window of a line is the widest of a few in which the bias is small against the noise.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rrrgen.base.arrays import Array
from rrrgen.base.errors import DerivationError
from rrrgen.lab.response.controller import Complex
from rrrgen.lab.response.local_polynomial import EXCITED, ORDER, LineEstimates, regress_window, spectrum
from rrrgen.lab.response.response_file import ResponseRecording
from rrrgen.lab.response.uncertainty import GROWTH, PARABOLA_AT_ITS_CENTRE, running_mean

LEAST_WINDOW, MOST_WINDOW = 5, 20  # numbers of lines at either side of the middle of a window
LARGEST_BIAS = 0.3  # squared bias, as a share of the variance, from which on a window is too wide
LEAST_SAMPLES = 500  # shortest recording
LEAST_ROUGHNESS = 0.2  # least share of the excitation's power in a window that is not smooth over the lines
STEP = 4  # distance in lines of two estimates; nearer ones share most of their windows


def noise_lines(record: ResponseRecording) -> LineEstimates:
    """Estimate the responses for any excitation, by a least-squares fit over windows of neighbouring lines.

    For Y = U, Q the model is ``Y(k+r) = sum g_s r^s N(k+r) + sum t_s r^s``; g_0 is the response, t the transient. Where
    the bias of Q/U is large even in the narrowest window, it enlarges the covariance.
    """
    if len(record.n) < LEAST_SAMPLES:
        raise DerivationError(
            f"{record.name}: {len(record.n)} samples are too few for a frequency response from noise: "
            f"{LEAST_SAMPLES} are the least"
        )
    F = spectrum(np.column_stack([record.n, record.u, record.q]))
    width, half = window_of(len(F)), len(F) // 2
    k = np.arange(width, half - width, STEP)
    around = F[k[:, None] + np.arange(-width, width + 1), 0]
    power = np.mean(np.abs(around) ** 2, axis=1)
    if not power.max() > 0.0:
        raise DerivationError(f"{record.name}: the column of the excitation is constant, so there is no response to it")
    use = rough_power(around) > EXCITED**2 * power.max()
    for side in (around[:, :width], around[:, width + 1 :]):  # both halves, as a window may cross the band's edge
        use &= rough_power(side) > LEAST_ROUGHNESS * (1.0 - (ORDER + 1) / width) * np.mean(np.abs(side) ** 2, axis=1)
    k, power = k[use], power[use]
    fits = [_fit(F, k, width)]
    while fits[-1].width >= 2 * LEAST_WINDOW:
        fits.append(_pooled(_fit(F, k, fits[-1].width // 2), width))
    chosen, bias = _widest_without_bias(_fit(F, k, 2 * width), fits, k)
    at = chosen, np.arange(len(k))
    G, V = np.array([fit.G for fit in fits])[at], np.array([fit.V for fit in fits])[at]
    spread = np.array([fit.spread for fit in fits])[at] * (1.0 + bias)
    in_window = 2.0 * np.array([fit.width for fit in fits])[chosen] + 1.0
    return LineEstimates(
        frequency=k / (len(F) * record.period),
        line=k,
        G=G,
        covariance=spread[:, None, None] * V,
        dof=np.array([float(fit.dof) for fit in fits])[chosen],
        signal=np.abs(G[:, 1]) ** 2 * power,
        noise=V[:, 1, 1].real,
        independent=np.minimum(1.0, STEP * PARABOLA_AT_ITS_CENTRE / in_window),
        kernel=_overlap(width),
    )


def window_of(samples: int) -> int:
    """Greatest number of lines on either side of the middle of a window, for a recording of so many samples."""
    return int(np.clip(samples // 200, LEAST_WINDOW, MOST_WINDOW))


@dataclass(frozen=True)
class _Fit:
    """Estimates from windows with ``width`` lines at either side.

    ``G`` (L, 2) are the responses, ``V`` (L, 2, 2) the covariance of the noise of a line with its ``dof``, ``spread``
    (L,) the factor from V to the covariance of G. ``P`` (L,) is the response from u to q, with its ``variance``.
    ``inside`` (L,) is false where the end of the spectrum has moved the window away from its line.
    """

    width: int
    G: Complex
    V: Complex
    spread: Array
    dof: int
    P: Complex
    variance: Array
    inside: NDArray[np.bool_]


def _fit(F: Complex, k: NDArray[np.int64], width: int) -> _Fit:
    """Fit windows of spectra F (lines, 3) of n, u, q about the lines k (L,)."""
    middle = np.clip(k, width, max(len(F) // 2 - width, width))
    around = F[(middle[:, None] + np.arange(-width, width + 1)) % len(F)]
    G, residual, spread, dof = regress_window(around[:, :, :1], around[:, :, 1:])
    V = np.einsum("lra,lrb->lab", residual, residual.conj()) / dof
    Gu = np.where(G[:, 0] == 0.0, np.finfo(float).tiny, G[:, 0])
    P = G[:, 1] / Gu
    a = np.stack([-P / Gu, 1.0 / Gu], axis=1)
    variance = spread * np.einsum("la,lab,lb->l", a, V, a.conj()).real
    return _Fit(width, G, V, spread, dof, P, variance, middle == k)


def _pooled(fit: _Fit, widest: int) -> _Fit:
    """The fit with a variance of P, relative to P, that is the mean over as many lines as the widest window has.

    The few lines of a narrow window tell the noise badly, and the response changes faster than the noise in it.
    """
    size = np.abs(fit.P) ** 2 * fit.spread
    own = np.maximum(fit.variance / np.maximum(size, np.finfo(float).tiny), np.finfo(float).tiny)
    change = running_mean(own, max(1, round((widest - fit.width) / STEP))) / own
    dof = round(fit.dof * (2 * widest + 1) / (2 * fit.width + 1))
    return replace(fit, V=change[:, None, None] * fit.V, variance=change * fit.variance, dof=dof)


def _widest_without_bias(outer: _Fit, fits: list[_Fit], k: NDArray[np.int64]) -> tuple[NDArray[np.int64], Array]:
    """Index (L,) of the fit that is used at each line, and its squared bias (L,) over its variance where that is large.

    ``fits`` become narrower by half from one to the next, and ``outer`` is twice as wide as the first. The bias of a
    window is much smaller than that of one twice as wide, and so than the difference of the two estimates. Its square,
    without the part due to noise, is averaged over the lines of the window and scaled back by :data:`GROWTH`. The
    narrowest window is taken where even its bias is large.
    """
    shape = k.astype(float) ** 4  # makes the squares of the response of a double integrator alike at all lines
    chosen = np.full(len(k), len(fits) - 1)
    biases = []
    for wider, fit in zip([outer, *fits[:-1]], fits, strict=True):
        m = max(1, round(fit.width / STEP))
        shared = np.minimum(wider.spread / fit.spread, 1.0)  # both estimates have the noise of the wider one
        noise = running_mean(fit.variance * (1.0 - shared) * shape, m)
        square = running_mean(np.abs(wider.P - fit.P) ** 2 * shape, m)
        found = np.where(wider.inside, np.maximum(square - noise, 0.0) / GROWTH / shape, 0.0)
        biases.append(found / np.maximum(fit.variance, np.finfo(float).tiny))
    ratio = np.array(biases)
    allowed = np.ones(len(k), dtype=bool)
    for i in range(len(fits) - 1, -1, -1):
        allowed &= (ratio[i] < LARGEST_BIAS) | (i == len(fits) - 1)
        chosen[allowed] = i
    left = ratio[chosen, np.arange(len(k))]
    return chosen, np.where(left < LARGEST_BIAS, 0.0, left)


def rough_power(lines: Complex) -> Array:
    """Mean power (L,) of the part of windows (L, lines) that is not smooth, after subtracting a polynomial.

    Outside the band of the excitation a window contains only leakage, which is smooth.
    """
    r = np.linspace(-1.0, 1.0, lines.shape[1])
    Q = np.linalg.qr(r[:, None] ** np.arange(ORDER + 1))[0]
    return np.asarray(np.mean(np.abs(lines - (lines @ Q) @ Q.T) ** 2, axis=1))


def _overlap(width: int) -> Array:
    """Correlation of estimates that are 0, 1, .. times STEP lines apart, because their windows overlap."""
    r = np.arange(-width, width + 1)
    weights = np.linalg.pinv((r[:, None] / width) ** np.arange(ORDER + 1))[0]
    full = np.correlate(weights, weights, "full")[2 * width :]
    return np.asarray(full[::STEP] / full[0])
