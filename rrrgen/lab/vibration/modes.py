"""Vibration modes: frequency and damping ratio, and how they vary between postures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rrrgen.base.arrays import Array
from rrrgen.base.errors import InputError

LEAST_DAMPING = 1e-4  # below it a measured damping cannot be told from none


@dataclass(frozen=True)
class Vibration:
    """One vibration mode measured in several postures of the robot.

    ``frequencies`` (k,) in Hz and ``dampings`` (k,), damping ratios, hold one value per posture. Filters are designed
    for ``frequency``, the middle of the range of frequencies, and ``damping``, the geometric mean of the ratios.
    """

    frequencies: tuple[float, ...]
    dampings: tuple[float, ...]

    def __post_init__(self) -> None:
        if not self.frequencies or len(self.frequencies) != len(self.dampings):
            raise InputError("a vibration needs as many dampings as frequencies")
        if min(self.frequencies) <= 0.0 or not all(-1.0 < zeta < 1.0 for zeta in self.dampings):
            raise InputError("a vibration needs positive frequencies (Hz) and damping ratios below 1")

    @property
    def frequency(self) -> float:
        """Frequency for which filters are designed, Hz: ``(min + max)/2`` over the postures."""
        return 0.5 * (min(self.frequencies) + max(self.frequencies))

    @property
    def damping(self) -> float:
        """Damping ratio for which filters are designed: geometric mean over the postures, each at least 1e-4."""
        return float(np.exp(np.mean(np.log(np.maximum(self.dampings, LEAST_DAMPING)))))


def pole(frequency: float, damping: float, period: float) -> complex:
    """Discrete-time pole of a mode: ``exp(s T)`` with ``s = w (-zeta + j sqrt(1 - zeta^2))``.

    ``w = 2 pi frequency`` (Hz), zeta is the ``damping`` ratio, T the sampling ``period`` in s.
    """
    omega = 2.0 * np.pi * frequency
    return complex(np.exp(omega * period * (-damping + 1j * np.sqrt(1.0 - damping**2))))


def below_sampling(vibrations: Sequence[Vibration], period: float) -> None:
    """Raise :class:`InputError` if a vibration has a frequency of half the sampling rate 1/``period`` (s) or more."""
    for each in vibrations:
        if max(each.frequencies) >= 0.5 / period:
            raise InputError(
                f"a vibration of {max(each.frequencies):.4g} Hz lies above half the sampling rate of "
                f"{1.0 / period:.6g} Hz: no sampled filter acts on it"
            )


def grid_around(vibrations: Sequence[Vibration], period: float, points: int = 800) -> Array:
    """Frequencies (points,) in Hz for figures, spaced logarithmically.

    They range from a third of the lowest frequency of the vibrations to twice the highest, at most 0.49/``period`` (s).
    """
    low = min(min(each.frequencies) for each in vibrations) / 3.0
    high = min(2.0 * max(max(each.frequencies) for each in vibrations), 0.49 / period)
    return np.asarray(np.geomspace(low, high, points))
