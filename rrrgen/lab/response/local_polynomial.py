"""Local polynomial method: responses from the excitation n to the input u and the output q, with covariance, per line.

In the discrete Fourier transform of a recording, the response and the transient (and leakage) T from the recording's
ends are smooth over a few lines, and noise is not. A polynomial of order 2 in the line number, fitted to neighbouring
lines, describes the smooth parts; its residuals give the covariance of the noise.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rrrgen.base.arrays import Array
from rrrgen.base.errors import DerivationError
from rrrgen.lab.response.controller import Complex
from rrrgen.lab.response.response_file import ResponseRecording

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
            "told from the response only where it repeats: record two whole periods at least, better ten, without gaps"
        )
    rows = np.column_stack([record.n, record.u, record.q])[len(record.n) - M * samples :]
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
    size = np.linalg.norm(K, axis=1, keepdims=True)
    K = K / np.where(size > 0.0, size, 1.0)
    inverse = np.linalg.pinv(K, rcond=1e-10)
    coefficients = inverse @ outputs
    residual = outputs - K @ coefficients
    scale = size[:, 0, 0]
    spread = np.sum(np.abs(inverse[:, 0]) ** 2, axis=1) / scale**2
    return coefficients[:, 0] / scale[:, None], residual, spread, lines - K.shape[2]
