"""Local polynomial method: responses from the excitation to input and output, with their covariance, line by line.

In the discrete Fourier transform of a record, what the record's ends leave (transient and leakage T) and the response
itself are smooth over a few lines, and noise is not: a polynomial of order 2 over neighbouring lines takes the former
out, and its residual is the covariance of the noise.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rrrgen.arrays import Array
from rrrgen.errors import DerivationError
from rrrgen.response.controller import Complex
from rrrgen.response.response_file import ResponseRecording

ORDER = 2
LEAST_WINDOW = 6  # unexcited lines at either side of an excited one
MOST_WINDOW = 20  # lines at either side, with noise
EXCITED = 1e-3  # of the largest line
LEAST_SAMPLES = 500
PARABOLA_AT_ITS_CENTRE = 9.0 / 4.0  # variance of its fitted value, over that of the mean of the same lines
LEAST_ROUGHNESS = 0.2  # share of the excitation's power in a window that no polynomial explains
STEP = 4  # lines between two estimates from noise: neighbours share most of their window


@dataclass(frozen=True)
class LineEstimates:
    """Responses from n to [u, q] at ``frequency`` (L,) in Hz.

    ``G`` (L, 2); ``covariance`` (L, 2, 2) of G, complex; ``dof``, complex degrees of freedom of the covariance;
    ``signal`` and ``noise`` (L,): power of q due to n and the rest, for the coherence of one period or line.
    ``line`` (L,): number of the line in units of the lowest one that the period allows. ``independent``: share of the
    lines that share no data with others.
    """

    frequency: Array
    line: NDArray[np.int64]
    G: Complex
    covariance: Complex
    dof: int
    signal: Array
    noise: Array
    independent: float = 1.0
    kernel: Array | None = None


def spectrum(values: Array) -> Complex:
    """DFT along the first axis after the straight line through the values is taken out."""
    t = np.arange(len(values)) - 0.5 * (len(values) - 1)
    centred = values - values.mean(axis=0)
    slope = t @ centred / (t @ t)
    return np.asarray(np.fft.fft(centred - np.multiply.outer(t, slope), axis=0))


def whole_periods(record: ResponseRecording, samples: int) -> tuple[Array, int]:
    """The last whole periods as rows [n, u, q] (M samples, 3) without ramp, and M; refuses fewer than two periods.

    The ramp is what a period adds: the motion at constant speed of (14.36).
    """
    M = len(record.n) // samples
    if M < 2:
        raise DerivationError(
            f"{record.name}: {len(record.n) / samples:.2f} periods of the excitation are recorded, and the noise is "
            "told from the response only where it repeats: record two whole periods at least, better ten"
        )
    rows = np.column_stack([record.n, record.u, record.q])[len(record.n) - M * samples :]
    slope = (rows[samples:] - rows[:-samples]).mean(axis=0) / samples
    return rows - np.multiply.outer(np.arange(len(rows)), slope), M


def periodic_lines(record: ResponseRecording, samples: int) -> LineEstimates:
    """The method for M >= 2 periods of ``samples`` samples: T and noise from the lines between the harmonics.

    At harmonic k the lines ``kM + r`` with r from 1 to max(M - 1, 6) at either side, multiples of M left out, hold T
    and noise alone.
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
        dof=dof,
        signal=np.abs(G[:, 1]) ** 2 * power / M,
        noise=V[:, 1, 1].real,
    )


def between_harmonics(F: Complex, k: NDArray[np.int64], M: int) -> tuple[Complex, Complex, float, int]:
    """Transient (L, c) at the harmonics ``k`` (L,) of spectra F (lines, c) of M periods, from the lines around.

    Also the covariance of the noise (L, c, c), the variance factor that the transient adds, degrees of freedom.
    """
    around, basis, inverse = _around_harmonics(F, k, M)
    smooth = np.einsum("sr,lrc->lsc", inverse, around)
    residual = around - np.einsum("rs,lsc->lrc", basis, smooth)
    dof = len(basis) - ORDER - 1
    V = np.einsum("lra,lrb->lab", residual, residual.conj()) / dof
    return smooth[:, 0], V, float(inverse[0] @ inverse[0]), dof


def remove_smooth(F: Complex, k: NDArray[np.int64], M: int) -> tuple[Complex, int]:
    """What a transient leaves (L, lines, c) of the lines around the harmonics ``k`` (L,), and degrees of freedom."""
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
    """Numbers of the lines (0 left out) at which there is an excitation."""
    largest = float(np.max(magnitude[1:])) if len(magnitude) > 1 else 0.0
    if not largest > 0.0:
        raise DerivationError(f"{name}: the column of the excitation is constant, so there is no response to it")
    lines = np.flatnonzero(magnitude > EXCITED * largest)
    return np.asarray(lines[lines > 0])


def window_of(samples: int) -> int:
    """Lines at either side that a recording of noise can spare."""
    return int(np.clip(samples // 200, 5, MOST_WINDOW))


def noise_lines(record: ResponseRecording) -> LineEstimates:
    """The method for any excitation: ``Y(k+r) = sum g_s r^s N(k+r) + sum t_s r^s`` for Y = U, Q over a window."""
    F = spectrum(np.column_stack([record.n, record.u, record.q]))
    width, half = window_of(len(F)), len(F) // 2
    if len(F) < LEAST_SAMPLES:
        raise DerivationError(
            f"{record.name}: {len(F)} samples are too few for a frequency response from noise: "
            f"{LEAST_SAMPLES} are the least"
        )
    k = np.arange(width, half - width, STEP)
    around = F[k[:, None] + np.arange(-width, width + 1)]
    power = np.mean(np.abs(around[:, :, 0]) ** 2, axis=1)
    if not power.max() > 0.0:
        raise DerivationError(f"{record.name}: the column of the excitation is constant, so there is no response to it")
    use = _rough_power(around[:, :, 0]) > EXCITED**2 * power.max()
    for side in (around[:, :width, 0], around[:, width + 1 :, 0]):  # of a window across the edge of the band too
        use &= _rough_power(side) > LEAST_ROUGHNESS * (1.0 - (ORDER + 1) / width) * np.mean(np.abs(side) ** 2, axis=1)
    k, around, power = k[use], around[use], power[use]
    solution, residual, spread, dof = regress_window(around[:, :, :1], around[:, :, 1:])
    V = np.einsum("lra,lrb->lab", residual, residual.conj()) / dof
    return LineEstimates(
        frequency=k / (len(F) * record.period),
        line=k,
        G=solution,
        covariance=spread[:, None, None] * V,
        dof=dof,
        signal=np.abs(solution[:, 1]) ** 2 * power,
        noise=V[:, 1, 1].real,
        independent=min(1.0, STEP * PARABOLA_AT_ITS_CENTRE / (2 * width + 1)),
        kernel=_overlap(width),
    )


def _rough_power(lines: Complex) -> Array:
    """Mean power (L,) of windows (L, lines) less a polynomial: beside its band, a cut record leaves smooth leakage."""
    r = np.linspace(-1.0, 1.0, lines.shape[1])
    Q = np.linalg.qr(r[:, None] ** np.arange(ORDER + 1))[0]
    return np.asarray(np.mean(np.abs(lines - (lines @ Q) @ Q.T) ** 2, axis=1))


def _overlap(width: int) -> Array:
    """Correlation of estimates that are 0, 1, .. times STEP lines apart: that of the weights in their windows."""
    r = np.arange(-width, width + 1)
    weights = np.linalg.pinv((r[:, None] / width) ** np.arange(ORDER + 1))[0]
    full = np.correlate(weights, weights, "full")[2 * width :]
    return np.asarray(full[::STEP] / full[0])


def regress_window(inputs: Complex, outputs: Complex) -> tuple[Complex, Complex, Array, int]:
    """Least squares over windows (L, lines, ..): response g_0 (L, outputs) to one input, and a transient.

    Returns g_0, the residuals, the variance factor of g_0 and the degrees of freedom.
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
