"""Signals that excite a band of frequencies: random-phase multisines, noise, swept sine; all of rms 1 and mean 0."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rrrgen.base.arrays import Array
from rrrgen.base.errors import InputError
from rrrgen.lab.estimate.statistics import rms

SIGNALS = ("multisine", "odd_multisine", "noise", "swept_sine")
TRIALS = 50
"""Draws of random phases, of which the one with the smallest crest factor is kept."""
GROUP = 4
"""Neighbouring odd lines of which one is left out to detect distortion."""
FEWEST_LINES = 8


def excitation_signal(
    kind: str, band: tuple[float, float], samples: int, rate: float, rng: np.random.Generator
) -> Array:
    """Excitation signal of a given ``kind`` with RMS 1 and mean 0, (samples,): one period, or all of a noise signal.

    ``rate`` is the sampling rate in Hz, ``band`` the lowest and highest excited frequency in Hz. The spectral lines of
    a periodic signal are the multiples of ``rate/samples`` in the band. ``rng`` draws the random phases. Raises
    :class:`InputError` for a band that holds too few lines or exceeds half the rate.
    """
    lines = lines_of(band, samples, rate)
    if kind == "noise":
        return band_noise(lines, samples, rng)
    if kind == "swept_sine":
        return swept_sine(int(lines[0]), int(lines[-1]), samples)
    if kind == "odd_multisine":
        lines = odd_lines(lines, rng)
    return multisine(lines, samples, rng)


def lines_of(band: tuple[float, float], samples: int, rate: float) -> NDArray[np.int64]:
    """Numbers k of the spectral lines, frequencies ``k rate/samples`` (Hz), that lie in ``band`` (Hz).

    Raises InputError if there are too few.
    """
    low, high = band
    if not 0.0 < low < high < 0.5 * rate:
        raise InputError(
            f"the band of the excitation must lie between 0 and {0.5 * rate:g} Hz, half the sampling rate, "
            f"lowest first, not {low:g} to {high:g} Hz"
        )
    step = rate / samples
    lines = np.arange(int(np.ceil(low / step - 1e-9)), int(np.floor(high / step + 1e-9)) + 1)
    if len(lines) < FEWEST_LINES:
        raise InputError(
            f"the band of {low:g} to {high:g} Hz holds {len(lines)} lines {step:g} Hz apart, at least {FEWEST_LINES} "
            "are needed: take a longer period or a wider band"
        )
    return lines


def odd_lines(lines: NDArray[np.int64], rng: np.random.Generator) -> NDArray[np.int64]:
    """Keep the odd line numbers of ``lines``, except one, chosen at random, in each group of :data:`GROUP`.

    A response at an even line or at one left out is nonlinear distortion or noise.
    """
    odd = lines[lines % 2 == 1]
    left_out = [start + int(rng.integers(GROUP)) for start in range(0, len(odd) - GROUP + 1, GROUP)]
    return np.asarray(np.delete(odd, left_out))


def multisine(lines: NDArray[np.int64], samples: int, rng: np.random.Generator) -> Array:
    """Random-phase multisine (samples,): cosines of equal amplitude at ``lines``; the draw with the smallest peak."""
    best: Array = np.zeros(samples)
    for _ in range(TRIALS):
        spectrum = np.zeros(samples // 2 + 1, dtype=complex)
        spectrum[lines] = np.exp(2j * np.pi * rng.uniform(size=len(lines)))
        signal = np.fft.irfft(spectrum, samples)
        signal = signal / rms(signal)
        if not best.any() or np.abs(signal).max() < np.abs(best).max():
            best = signal
    return best


def band_noise(lines: NDArray[np.int64], samples: int, rng: np.random.Generator) -> Array:
    """Gaussian noise (samples,) that is white within the band of ``lines`` and zero outside."""
    spectrum = np.zeros(samples // 2 + 1, dtype=complex)
    spectrum[lines] = rng.normal(size=len(lines)) + 1j * rng.normal(size=len(lines))
    signal = np.fft.irfft(spectrum, samples)
    return np.asarray(signal / rms(signal))


def swept_sine(first: int, last: int, samples: int) -> Array:
    """Periodic swept sine (samples,): its frequency rises linearly from line ``first`` to ``last`` in one period."""
    t = np.arange(samples) / samples
    top = last - (first + last) % 2  # a whole number of cycles in a period
    signal = np.sin(2.0 * np.pi * (first * t + 0.5 * (top - first) * t**2))
    signal = signal - np.mean(signal)
    return np.asarray(signal / rms(signal))
