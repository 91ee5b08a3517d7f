"""Parallel decimation of torque and regressor."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rrrgen.errors import InputError

Array = NDArray[np.floating[Any]]

HALF_LENGTH = 10  # of the filter, in new samples
BETA = 5.0  # of the Kaiser window
PASSED = 0.8  # of the new half rate: where the filter is down to one half (-6 dB)
GROUP = 16  # outputs computed at a time


@dataclass(frozen=True)
class Decimator:
    """Parallel decimation: the same low-pass on the torque and on every regressor column, then every ``factor``-th row.

    Both sides of ``tau = W x`` pass the same linear filter F, so ``F tau = F W x`` holds exactly, at the ends too. F
    is a symmetric finite response (Kaiser window) of ``20*factor + 1`` taps, -6 dB at 0.8 of the new half rate; a
    chunk with its neighbours' samples therefore gives exactly what the whole recording gives.
    """

    factor: int

    def __post_init__(self) -> None:
        if self.factor < 1:
            raise InputError(f"the decimation factor is {self.factor}; it must be 1 or more")

    @property
    def memory(self) -> int:
        """Samples on either side that a decimated sample depends on."""
        return 0 if self.factor == 1 else HALF_LENGTH * self.factor

    def __call__(self, x: Array, first: int = 0) -> Array:
        """Filter along axis 0 and keep the samples whose global index ``first + k`` is a multiple of the factor."""
        if self.factor == 1:
            return x
        h, width = self.memory, int(np.prod(x.shape[1:]))
        skip = -first % self.factor
        count = max(0, -(-(len(x) - skip) // self.factor))
        padded = np.zeros((len(x) + 2 * h + GROUP * self.factor, width))
        padded[h : h + len(x)] = x.reshape(len(x), width)
        band, out = self._band(), np.empty((count, width))
        for start in range(0, count, GROUP):
            at = skip + start * self.factor
            rows = min(GROUP, count - start)
            out[start : start + rows] = (band @ padded[at : at + band.shape[1]])[:rows]
        return out.reshape(count, *x.shape[1:])

    def taps(self) -> Array:
        """The filter's impulse response, ``2*memory + 1`` samples about its middle."""
        from scipy.signal import firwin

        return np.asarray(firwin(2 * self.memory + 1, PASSED / self.factor, window=("kaiser", BETA)))

    def _band(self) -> Array:
        """The filter's rows for GROUP consecutive outputs: one product of matrices instead of many of vectors."""
        taps = self.taps()
        band = np.zeros((GROUP, len(taps) + (GROUP - 1) * self.factor))
        for k in range(GROUP):
            band[k, k * self.factor : k * self.factor + len(taps)] = taps
        return band

    def instants(self, t: Array, first: int = 0) -> Array:
        """The instants that stay."""
        return t[-first % self.factor :: self.factor]
