"""Interpolation of the samples of a recording on the finer time grid of a controller, without ringing at steps.

A controller that differentiates its reference needs more than the straight line between two recorded samples, whose
slope is that of the middle between them. Polynomials of degree five through the six nearest samples give speeds at the
samples too. Where a signal jumps or has a kink, a polynomial across it would ring: of the six samples around every step
those are taken that lie on the smoother side (essentially non-oscillatory interpolation, Harten and Osher 1987).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rrrgen.base.arrays import Array

DEGREE = 5
CENTRED = 2.0
"""Ratio of the differences on both sides above which samples are taken from the smoother one, not in the middle."""


@dataclass(frozen=True)
class FineGrid:
    """Time grid that is ``stride`` times as fine as the ``count`` samples of a recording, and contains them."""

    count: int
    stride: int

    @property
    def at(self) -> Array:
        """Numbers (N,) of the recorded samples, with fractions, at which the points of the grid lie."""
        return np.arange((self.count - 1) * self.stride + 1) / self.stride

    def linear(self, values: Array) -> Array:
        """Straight lines between the samples ``values`` (count, n), on the grid (N, n)."""
        if self.stride == 1:
            return np.ascontiguousarray(values, float)
        numbers: Any = np.arange(self.count)
        return np.column_stack([np.interp(self.at, numbers, column) for column in values.T])

    def smooth(self, values: Array) -> Array:
        """Polynomials through the samples ``values`` (count, n), on the grid (N, n), that do not ring at steps."""
        values = np.ascontiguousarray(values, float)
        degree = min(DEGREE, self.count - 1)
        if self.stride == 1 or degree < 1:
            return values
        differences = [values]
        for _ in range(degree):
            differences.append(np.diff(differences[-1], axis=0))
        first = _first_samples(differences)
        taken = [np.take_along_axis(level, first, axis=0) for level in differences]
        cells = np.arange(self.count - 1)
        fine = np.empty(((self.count - 1) * self.stride + 1, values.shape[1]))
        fine[:: self.stride] = values
        for k in range(1, self.stride):
            since = cells[:, None] + k / self.stride - first
            total = taken[degree]
            for m in range(degree - 1, -1, -1):  # Newton's form by Horner's scheme
                total = taken[m] + (since - m) / (m + 1) * total
            fine[k :: self.stride] = total
        return fine

    def nearest(self, values: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """The flags ``values`` (count, n) of the last samples, on the grid (N, n)."""
        return np.asarray(values[np.floor(self.at).astype(int)])


def _first_samples(differences: list[Array]) -> NDArray[np.intp]:
    """Number (count - 1, n) of the first sample of the polynomial between every two samples.

    ``differences`` holds the samples (count, n) and their forward differences of rising order. From the two samples on,
    the polynomial grows by one sample at a time: in the middle, or where the next difference is much smaller.
    """
    count, n = differences[0].shape
    cells = np.arange(count - 1)[:, None]
    first = np.repeat(cells, n, axis=1)
    for m, level in enumerate(differences[2:], start=2):
        last = len(level) - 1
        before = np.abs(np.take_along_axis(level, np.maximum(first - 1, 0), axis=0))
        after = np.abs(np.take_along_axis(level, np.minimum(first, last), axis=0))
        is_late = cells - first <= first + m - 2 - cells  # no more samples before the step than behind it
        backwards = np.where(is_late, before <= CENTRED * after, CENTRED * before < after)
        first = first - np.where(first == 0, False, np.where(first > last, True, backwards))
    return first
