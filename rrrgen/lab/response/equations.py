"""The difference equation of a linear model, and its least-squares fit (14.41)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rrrgen.base.arrays import Array


@dataclass(frozen=True)
class Equation:
    """Difference equation ``y_k = sum a_i y_{k-i} + sum b_j u_{k-delay-j}``, i from 1, j from 0.

    ``a`` and ``b`` hold the coefficients, ``delay`` is in samples.
    """

    a: Array
    b: Array
    delay: int

    @property
    def past(self) -> int:
        """Number of rows before the first one whose output the equation can compute."""
        return max(len(self.a), self.delay + len(self.b) - 1)


def arx(u: Array, y: Array, start: int, stop: int, order: int, delay: int) -> Equation:
    """Fit a difference equation to the rows [start, stop) by least squares ``theta = F# Q``, (14.41).

    It has ``order`` coefficients a and as many coefficients b; without ``delay`` it has one b more. Row k of F is
    ``[y_{k-1} .. y_{k-n}, u_{k-delay} .. ]``; the last one is that of k = stop - 1, so that the columns of (14.42) end
    at t_{zeta-n} (the book's t_{zeta-n+1} is a misprint).
    """
    size = order + 1 if delay == 0 else order
    past = max(order, delay + size - 1)
    k = np.arange(start + past, stop)
    F = np.column_stack([*(y[k - i] for i in range(1, order + 1)), *(u[k - delay - j] for j in range(size))])
    scale = np.linalg.norm(F, axis=0)
    theta, _, _, _ = np.linalg.lstsq(F / scale, y[k], rcond=1e-13)
    theta = theta / scale
    return Equation(theta[:order], theta[order:], delay)
