"""Signals that excite a band of frequencies: random-phase multisines, noise, swept sine; all of rms 1 and mean 0."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rrrgen.arrays import Array
from rrrgen.errors import InputError

SIGNALS = ("multisine", "odd_multisine", "noise", "swept_sine")
TRIALS = 50
"""Draws of random phases, of which the one with the smallest crest factor is kept."""
GROUP = 4
"""Neighbouring odd lines of which one is left out to detect distortion."""
FEWEST_LINES = 8


def excitation_signal(
    kind: str, band: tuple[float, float], samples: int, rate: float, rng: np.random.Generator
) -> Array:
    """``samples`` (N,) of the signal ``kind`` at ``rate`` (Hz): one period, or for noise the whole of it.

    ``band`` (Hz) are its lowest and highest frequency; the lines are the multiples of ``rate/samples`` in it.
    Raises :class:`InputError` for a band that holds too few lines or exceeds half the rate.
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
    """Numbers of the lines of a period of ``samples`` in ``band`` (Hz); raises InputError where they are too few."""
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
    """The odd ``lines`` less one at random of every :data:`GROUP`: what appears there is distortion or noise."""
    odd = lines[lines % 2 == 1]
    left_out = [start + int(rng.integers(GROUP)) for start in range(0, len(odd) - GROUP + 1, GROUP)]
    return np.asarray(np.delete(odd, left_out))


def multisine(lines: NDArray[np.int64], samples: int, rng: np.random.Generator) -> Array:
    """Cosines of equal amplitude at ``lines`` with random phases, the draw with the smallest peak of several."""
    best: Array = np.zeros(samples)
    for _ in range(TRIALS):
        spectrum = np.zeros(samples // 2 + 1, dtype=complex)
        spectrum[lines] = np.exp(2j * np.pi * rng.uniform(size=len(lines)))
        signal = np.fft.irfft(spectrum, samples)
        signal = signal / np.sqrt(np.mean(signal**2))
        if not best.any() or np.abs(signal).max() < np.abs(best).max():
            best = signal
    return best


def band_noise(lines: NDArray[np.int64], samples: int, rng: np.random.Generator) -> Array:
    """Gaussian noise, white within the band and nothing outside."""
    spectrum = np.zeros(samples // 2 + 1, dtype=complex)
    spectrum[lines] = rng.normal(size=len(lines)) + 1j * rng.normal(size=len(lines))
    signal = np.fft.irfft(spectrum, samples)
    return np.asarray(signal / np.sqrt(np.mean(signal**2)))


def swept_sine(first: int, last: int, samples: int) -> Array:
    """A sine whose frequency rises linearly from line ``first`` to ``last`` within the period, closing on itself."""
    t = np.arange(samples) / samples
    top = last - (first + last) % 2  # a whole number of cycles in a period
    signal = np.sin(2.0 * np.pi * (first * t + 0.5 * (top - first) * t**2))
    signal = signal - np.mean(signal)
    return np.asarray(signal / np.sqrt(np.mean(signal**2)))
