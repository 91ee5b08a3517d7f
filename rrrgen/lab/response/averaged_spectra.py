"""Estimates of a frequency response from averaged spectra: instrumental ``Phi_nq/Phi_nu``, direct ``Phi_uq/Phi_uu``.

n is the excitation, u the input of the plant, q its output.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rrrgen.base.arrays import Array
from rrrgen.base.errors import DerivationError
from rrrgen.lab.response.local_polynomial import excited_lines, whole_periods
from rrrgen.lab.response.response_file import ResponseRecording
from rrrgen.lab.response.response_model import Complex

SEGMENTS = 10  # number of window lengths in a recording whose excitation is noise; the windows overlap by half
LEAST_SEGMENT = 32  # shortest window, samples
LEAST_PERIODS = 4
LEAST_STEADY = 0.2  # least ratio of the squared mean power of n at a line to the mean of its square; 1/2 for noise
HANN_EFFICIENCY = 0.947  # independent averages per half-overlapping Hann segment
HANN_OVERLAP = 1.0 / 6.0  # correlation of the noise of two such segments
SHAPE = 64  # samples of a Hann window of which the correlation of lines is computed


@dataclass(frozen=True)
class AveragedSpectra:
    """Auto and cross spectra of n, u and q at ``frequency`` (L,) in Hz: ``Phi[:, a, b] = E conj(A) B``, (L, 3, 3).

    A and B are the spectra of the signals number a and b, E is the mean over the windows. ``averages`` is the number of
    independent averages, ``dof`` the degrees of freedom of the noise. ``independent`` is the share of the lines that
    share no data with others, ``kernel`` (lags,) the correlation of lines that are 0, 1, .. apart (None: independent),
    as a Hann window spreads a line over its neighbours.
    """

    frequency: Array
    Phi: Complex
    averages: float
    dof: float
    independent: float
    kernel: Array | None

    def instrumental(self) -> tuple[Complex, Array]:
        """The instrumental response ``Phi_nq/Phi_nu`` and its variance: unbiased in closed loop."""
        Phi = self.Phi
        P = Phi[:, 0, 2] / Phi[:, 0, 1]
        rest = Phi[:, 2, 2] - 2.0 * (P.conj() * Phi[:, 1, 2]) + np.abs(P) ** 2 * Phi[:, 1, 1]
        variance = rest.real * Phi[:, 0, 0].real / np.abs(Phi[:, 0, 1]) ** 2 / (self.averages - 1.0)
        return P, np.maximum(variance, 0.0)

    def direct(self) -> tuple[Complex, Array]:
        """Direct response ``Phi_uq/Phi_uu`` and its variance; in closed loop it is biased.

        Disturbances draw it towards -1/C, with the transfer function C of the controller.
        """
        Phi = self.Phi
        P = Phi[:, 1, 2] / Phi[:, 1, 1]
        rest = Phi[:, 2, 2].real - np.abs(Phi[:, 1, 2]) ** 2 / Phi[:, 1, 1].real
        return P, np.maximum(rest, 0.0) / Phi[:, 1, 1].real / (self.averages - 1.0)

    def coherence(self) -> Array:
        """Coherence (L,) of excitation and output, ``|Phi_nq|^2/(Phi_nn Phi_qq)`` (14.37), between 0 and 1."""
        Phi = self.Phi
        return np.asarray(np.abs(Phi[:, 0, 2]) ** 2 / (Phi[:, 0, 0] * Phi[:, 2, 2]).real)


def averaged_spectra(record: ResponseRecording, samples: int | None) -> AveragedSpectra:
    """Average the spectra of a recording over Hann windows that overlap by half.

    A window is two periods long (``samples`` per period) where the excitation repeats; otherwise (None) a tenth of the
    recording.
    """
    if samples is not None:
        rows, M = whole_periods(record, samples)
        if M < LEAST_PERIODS:
            raise DerivationError(
                f"{record.name}: {M} periods are too few for averages, {LEAST_PERIODS} are the least; the local "
                "polynomial method makes do with two"
            )
        length = 2 * samples
    else:
        rows = np.column_stack([record.n, record.u, record.q])
        length = 2 * (len(rows) // (2 * SEGMENTS))
        if length < LEAST_SEGMENT:
            raise DerivationError(
                f"{record.name}: {len(rows)} samples are too few for {SEGMENTS} segments of at least {LEAST_SEGMENT}"
            )
    F = _windows(rows, length, trends=samples is None)
    segments, Phi = len(F), np.einsum("sla,slb->lab", F.conj(), F) / len(F)
    magnitude = np.sqrt(Phi[: length // 2, 0, 0].real)
    if samples is not None:
        k = 2 * excited_lines(magnitude[::2], record.name)
    else:
        magnitude[:2] = 0.0  # the window spreads the remaining mean value over the first two lines
        k = excited_lines(magnitude, record.name)
    frequency, dof = k / (length * record.period), HANN_EFFICIENCY * segments - 1.0
    if samples is None:
        power = np.abs(F[:, k, 0]) ** 2
        steady = float(np.median(power.mean(axis=0) ** 2 / np.mean(power**2, axis=0)))
        if steady < LEAST_STEADY:
            raise DerivationError(
                f"{record.name}: the excitation moves through its band, as a sweep that is not repeated does, so that "
                "few windows excite a line and the response rings on in others; the local polynomial method can be used"
            )
        return AveragedSpectra(frequency, Phi[k], dof + 1.0, dof, 0.5, _overlap())
    # the excitation is the same in all windows, so that their noise is averaged, and not its products with n
    averages = segments / (1.0 + 2.0 * HANN_OVERLAP * (segments - 1) / segments)
    return AveragedSpectra(frequency, Phi[k], averages, dof, 1.0, None)


def _overlap() -> Array:
    """Correlation of estimates 0, 1, .. lines apart where the excitation is noise, since Hann windows share lines."""
    window = np.hanning(SHAPE + 1)[:-1]
    t = np.arange(SHAPE)
    shared = np.zeros(3)
    for shift in (-SHAPE // 2, 0, SHAPE // 2):
        part = np.roll(window, shift) * (t >= shift) * (t < SHAPE + shift) * window
        shared += [abs(part @ np.exp(2j * np.pi * lag * t / SHAPE)) ** 2 for lag in range(3)]
    return np.asarray(shared / shared[0])


def _windows(rows: Array, length: int, trends: bool) -> Complex:
    """Spectra (windows, length/2 + 1, 3) of Hann windows that overlap by half, without means and perhaps ``trends``.

    The linear trend of a periodic excitation in a window is a part of it.
    """
    window = np.hanning(length + 1)[:-1, None]
    t = np.arange(length) - 0.5 * (length - 1)
    spectra = []
    for start in range(0, len(rows) - length + 1, length // 2):
        part = rows[start : start + length] - rows[start : start + length].mean(axis=0)
        slope = t @ part / (t @ t) if trends else np.zeros(rows.shape[1])
        spectra.append(np.fft.rfft(window * (part - np.multiply.outer(t, slope)), axis=0))
    return np.array(spectra)
