"""Local polynomial method: responses from the excitation n to the input u and the output q, with covariance, per line.

In the discrete Fourier transform of a recording, the response and the transient (and leakage) T from the recording's
ends are smooth over a few lines, and noise is not. A polynomial of order 2 in the line number, fitted to neighbouring
lines, describes the smooth parts; its residuals give the covariance of the noise (Pintelon, Schoukens, Vandersteen and
Barbe 2010).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rrrgen.base.arrays import Array
from rrrgen.base.errors import DerivationError
from rrrgen.lab.response.response_file import ResponseRecording
from rrrgen.lab.response.response_model import Complex

ORDER = 2
LEAST_WINDOW = 6  # least number of unexcited lines at either side of an excited one
EXCITED = 1e-3  # a line is excited if its magnitude exceeds this share of the largest


@dataclass(frozen=True)
class LineEstimates:
    """Responses from the excitation n to [u, q] at the spectral lines with ``frequency`` (L,) in Hz.

    ``G`` (L, 2) are the responses; ``covariance`` (L, 2, 2) is that of G, complex; ``dof`` (L,) are its complex degrees
    of freedom. ``signal`` and ``noise`` (L,) are the power of q due to n and the rest, for the coherence of one period
    or line. ``line`` (L,) are the numbers of the lines, in units of the lowest frequency (one over the period).
    ``independent`` (L,) is the share of the lines around that share no data with others. ``kernel`` (lags,) is the
    correlation of lines that are 0, 1, .. apart; None if they are independent.
    """

    frequency: Array
    line: NDArray[np.int64]
    G: Complex
    covariance: Complex
    dof: Array
    signal: Array
    noise: Array
    independent: Array | float = 1.0
    kernel: Array | None = None


def spectrum(values: Array) -> Complex:
    """Discrete Fourier transform along the first axis, after subtracting the straight line fitted to the values."""
    t = np.arange(len(values)) - 0.5 * (len(values) - 1)
    centred = values - values.mean(axis=0)
    slope = t @ centred / (t @ t)
    return np.asarray(np.fft.fft(centred - np.multiply.outer(t, slope), axis=0))


def whole_periods(record: ResponseRecording, samples: int) -> tuple[Array, int]:
    """Cut out the last M whole periods: (rows [n, u, q] of shape (M samples, 3) without their ramp, M).

    The ramp is the straight line by which a period ends at another value than it begins: the motion at constant speed
    of (14.36). Fewer than two periods are refused with a DerivationError.
    """
    M = len(record.n) // samples
    if M < 2:
        raise DerivationError(
            f"{record.name}: {len(record.n) / samples:.2f} periods of the excitation are recorded, and the noise is "
            "separated from the response only where it repeats: record at least two whole periods, better ten, no gaps"
        )
    rows = np.column_stack([record.n, record.u, record.q])[len(record.n) - M * samples :]
    # The ramp of a joint at constant speed would leak into all lines. The mean over whole periods is used, since a line
    # fitted to all samples would follow the periodic motion as well.
    slope = (rows[samples:] - rows[:-samples]).mean(axis=0) / samples
    return rows - np.multiply.outer(np.arange(len(rows)), slope), M


def periodic_lines(record: ResponseRecording, samples: int) -> LineEstimates:
    """Estimate the responses from M >= 2 periods of ``samples`` samples, with T and noise from lines between harmonics.

    Around harmonic k the lines ``kM + r`` with ``|r|`` from 1 to max(M - 1, 6), without the multiples of M, contain
    only the transient T and noise.
    """
    rows, M = whole_periods(record, samples)
    F = np.fft.fft(rows - rows.mean(axis=0), axis=0)
    k = excited_lines(np.abs(F[: len(F) // 2 : M, 0]), record.name)
    T, V, leverage, dof = between_harmonics(F[:, 1:], k, M)
    N = F[k * M, 0]
    G = (F[k * M, 1:] - T) / N[:, None]
    power = np.abs(N) ** 2
    return LineEstimates(
        frequency=k / (samples * record.period),
        line=k,
        G=G,
        covariance=(1.0 + leverage) * V / power[:, None, None],
        dof=np.full(len(k), float(dof)),
        signal=np.abs(G[:, 1]) ** 2 * power / M,
        noise=V[:, 1, 1].real,
    )


def between_harmonics(F: Complex, k: NDArray[np.int64], M: int) -> tuple[Complex, Complex, float, int]:
    """Estimate the transient at the harmonics ``k`` (L,) from the lines around, for spectra F (lines, c) of M periods.

    Returns the transient (L, c), the covariance of the noise (L, c, c), the factor by which the estimated transient
    increases the variance, and the degrees of freedom.
    """
    around, basis, inverse = _around_harmonics(F, k, M)
    smooth = np.einsum("sr,lrc->lsc", inverse, around)
    residual = around - np.einsum("rs,lsc->lrc", basis, smooth)
    dof = len(basis) - ORDER - 1
    V = np.einsum("lra,lrb->lab", residual, residual.conj()) / dof
    return smooth[:, 0], V, float(inverse[0] @ inverse[0]), dof


def remove_smooth(F: Complex, k: NDArray[np.int64], M: int) -> tuple[Complex, int]:
    """Subtract the transient, a polynomial, from the lines around the harmonics of numbers ``k`` (L,).

    Returns the residuals (L, lines, c) and their degrees of freedom.
    """
    around, basis, inverse = _around_harmonics(F, k, M)
    return around - np.einsum("rs,st,ltc->lrc", basis, inverse, around), len(basis) - ORDER - 1


def _around_harmonics(F: Complex, k: NDArray[np.int64], M: int) -> tuple[Complex, Array, Array]:
    """The spectral lines (L, lines, c) around each harmonic of number ``k``, without the harmonics themselves.

    Also the polynomials of the offset from the harmonic at these lines (lines, order + 1), and their pseudo-inverse.
    """
    width = max(M - 1, LEAST_WINDOW)
    r = np.array([r for r in range(-width, width + 1) if r % M])
    basis = (r[:, None] / width) ** np.arange(ORDER + 1)
    return F[(k[:, None] * M + r) % len(F)], basis, np.linalg.pinv(basis)


def excited_lines(magnitude: Array, name: str) -> NDArray[np.int64]:
    """Numbers of the excited lines, without line 0; ``magnitude`` is the spectrum, ``name`` is for error messages."""
    largest = float(np.max(magnitude[1:])) if len(magnitude) > 1 else 0.0
    if not largest > 0.0:
        raise DerivationError(f"{name}: the column of the excitation is constant, so there is no response to it")
    lines = np.flatnonzero(magnitude > EXCITED * largest)
    return np.asarray(lines[lines > 0])


def regress_window(inputs: Complex, outputs: Complex) -> tuple[Complex, Complex, Array, int]:
    """Fit in each of L windows the response to one input, and a transient, as polynomials of the line number.

    ``inputs`` (L, lines, 1) and ``outputs`` (L, lines, k) are the spectra. Returns the response g_0 (L, k) in the
    middle of each window, the residuals (L, lines, k), the factor (L,) from the noise variance to that of g_0, and the
    degrees of freedom.
    """
    lines = inputs.shape[1]
    r = (np.arange(lines) - lines // 2)[:, None] / (lines // 2)
    powers = r ** np.arange(ORDER + 1)
    K = np.concatenate([inputs * powers, np.broadcast_to(powers, (len(inputs), *powers.shape))], axis=2)
    # Columns with the spectrum of the input and those of the transient, plain powers, differ by orders of magnitude,
    # which the cut-off of the pseudo-inverse would take for dependence: all are brought to one length first.
    size = np.linalg.norm(K, axis=1, keepdims=True)
    K = K / np.where(size > 0.0, size, 1.0)
    inverse = np.linalg.pinv(K, rcond=1e-10)
    coefficients = inverse @ outputs
    residual = outputs - K @ coefficients
    scale = size[:, 0, 0]
    spread = np.sum(np.abs(inverse[:, 0]) ** 2, axis=1) / scale**2
    return coefficients[:, 0] / scale[:, None], residual, spread, lines - K.shape[2]


# ------------------------------------------------------------------------------------------------------------------
# Confidence circles of complex estimates, limits of the bias by averaging, variances of unknowns of least squares.
# ------------------------------------------------------------------------------------------------------------------

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


# ------------------------------------------------------------------------------------------------------------------
# Local polynomial method for any excitation that is rough over the spectral lines, such as noise.
#
# Near a resonance a response is no polynomial over a wide window, so that the estimate is biased, and the band does
# not show it. So the window of a line is the widest of a few in which the bias is small against the noise.
# ------------------------------------------------------------------------------------------------------------------

LEAST_NOISE_WINDOW, MOST_WINDOW = 5, 20  # numbers of lines at either side of the middle of a window
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
    while fits[-1].width >= 2 * LEAST_NOISE_WINDOW:
        fits.append(_pool_variance(_fit(F, k, fits[-1].width // 2), width))
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
    return int(np.clip(samples // 200, LEAST_NOISE_WINDOW, MOST_WINDOW))


@dataclass(frozen=True)
class _LocalFit:
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


def _fit(F: Complex, k: NDArray[np.int64], width: int) -> _LocalFit:
    """Fit windows of spectra F (lines, 3) of n, u, q about the lines k (L,)."""
    middle = np.clip(k, width, max(len(F) // 2 - width, width))
    around = F[(middle[:, None] + np.arange(-width, width + 1)) % len(F)]
    G, residual, spread, dof = regress_window(around[:, :, :1], around[:, :, 1:])
    V = np.einsum("lra,lrb->lab", residual, residual.conj()) / dof
    Gu = np.where(G[:, 0] == 0.0, np.finfo(float).tiny, G[:, 0])
    P = G[:, 1] / Gu
    a = np.stack([-P / Gu, 1.0 / Gu], axis=1)
    variance = spread * np.einsum("la,lab,lb->l", a, V, a.conj()).real
    return _LocalFit(width, G, V, spread, dof, P, variance, middle == k)


def _pool_variance(fit: _LocalFit, widest: int) -> _LocalFit:
    """The fit with a variance of P, relative to P, that is the mean over as many lines as the widest window has.

    The few lines of a narrow window tell the noise badly, and the response changes faster than the noise in it.
    """
    size = np.abs(fit.P) ** 2 * fit.spread
    relative_variance = np.maximum(fit.variance / np.maximum(size, np.finfo(float).tiny), np.finfo(float).tiny)
    change = running_mean(relative_variance, max(1, round((widest - fit.width) / STEP))) / relative_variance
    dof = round(fit.dof * (2 * widest + 1) / (2 * fit.width + 1))
    return replace(fit, V=change[:, None, None] * fit.V, variance=change * fit.variance, dof=dof)


def _widest_without_bias(
    outer: _LocalFit, fits: list[_LocalFit], k: NDArray[np.int64]
) -> tuple[NDArray[np.int64], Array]:
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
        squared_bias = np.where(wider.inside, np.maximum(square - noise, 0.0) / GROWTH / shape, 0.0)
        biases.append(squared_bias / np.maximum(fit.variance, np.finfo(float).tiny))
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
