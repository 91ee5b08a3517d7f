"""Parallel decimation: torques and regressor pass the same low-pass filter and are then downsampled."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rrrgen.base.errors import InputError

Array = NDArray[np.floating[Any]]

HALF_LENGTH = 10  # half the length of the filter, in decimated samples
KAISER_BETA = 5.0  # shape parameter of the Kaiser window
CUTOFF_RATIO = 0.8  # -6 dB frequency over the Nyquist frequency of the decimated signal
BLOCK = 16  # outputs computed by one matrix product


@dataclass(frozen=True)
class Decimator:
    """Parallel decimation: the same low-pass on the torque and on every regressor column, then every ``factor``-th row.

    Both sides of ``tau = W x`` pass the same linear filter F, so ``F tau = F W x`` holds exactly, at the ends too. F
    is a symmetric (zero-phase) FIR filter with a Kaiser window, ``20*factor + 1`` taps, -6 dB at 0.8 of the new Nyquist
    frequency. A recording may be filtered in chunks that overlap by :attr:`memory` samples: the result is exactly
    that of the whole. Raises :class:`InputError` for a factor below 1.
    """

    factor: int

    def __post_init__(self) -> None:
        if self.factor < 1:
            raise InputError(f"the decimation factor is {self.factor}; it must be 1 or more")

    @property
    def memory(self) -> int:
        """Number of recorded samples on either side that a decimated sample depends on."""
        return 0 if self.factor == 1 else HALF_LENGTH * self.factor

    def __call__(self, x: Array, first: int = 0) -> Array:
        """Filter ``x`` (N, ...) along axis 0 and keep the samples whose index in the recording is a multiple of factor.

        ``first`` is the index in the recording of ``x[0]``; samples outside ``x`` count as zero.
        """
        if self.factor == 1:
            return x
        h, width = self.memory, int(np.prod(x.shape[1:]))
        skip = -first % self.factor
        count = max(0, -(-(len(x) - skip) // self.factor))
        padded = np.zeros((len(x) + 2 * h + BLOCK * self.factor, width))
        padded[h : h + len(x)] = x.reshape(len(x), width)
        band, out = _band(self.factor), np.empty((count, width))
        for start in range(0, count, BLOCK):
            at = skip + start * self.factor
            rows = min(BLOCK, count - start)
            out[start : start + rows] = (band @ padded[at : at + band.shape[1]])[:rows]
        return out.reshape(count, *x.shape[1:])

    def taps(self) -> Array:
        """Impulse response of the filter, ``2*memory + 1`` samples, symmetric about the middle one."""
        return _taps(self.factor).copy()

    def instants(self, t: Array, first: int = 0) -> Array:
        """The instants (s) of ``t`` (N,) that decimation keeps; ``first`` is the index of ``t[0]`` in the recording."""
        return t[-first % self.factor :: self.factor]


@lru_cache(maxsize=4)
def _taps(factor: int) -> Array:
    from scipy.signal import firwin

    length = 2 * HALF_LENGTH * factor + 1
    return np.asarray(firwin(length, CUTOFF_RATIO / factor, window=("kaiser", KAISER_BETA)))


@lru_cache(maxsize=4)
def _band(factor: int) -> Array:
    """Banded matrix that maps an input window to BLOCK consecutive filter outputs, for decimation by ``factor``.

    Filtering becomes one matrix product. The matrix is cached, because computing it takes longer than filtering one of
    the many chunks of a long recording.
    """
    taps = _taps(factor)
    band = np.zeros((BLOCK, len(taps) + (BLOCK - 1) * factor))
    for k in range(BLOCK):
        band[k, k * factor : k * factor + len(taps)] = taps
    return band
