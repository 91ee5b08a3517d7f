"""The discrete-time controller of a recorded control loop, as a transfer function."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rrrgen.base.arrays import Array

Complex = NDArray[np.complexfloating[Any, Any]]


@dataclass(frozen=True)
class Controller:
    """The controller ``C(z) = (c_0 + c_1 z^-1 + ..)/(d_0 + d_1 z^-1 + ..)`` of the loop ``u = n - C(z) (q - q_r)``.

    ``numerator`` holds the c_i, ``denominator`` the d_i. A PD controller with the gains kp and kd, the sampling period
    T and the backward difference of the position has ``c = [kp + kd/T, -kd/T]``, ``d = [1]``.
    """

    numerator: tuple[float, ...]
    denominator: tuple[float, ...] = (1.0,)

    def response(self, frequency: Array, period: float) -> Complex:
        """The frequency response of C, complex (L,), at ``frequency`` (L,) in Hz for the sampling ``period`` in s."""
        z = np.exp(-2j * np.pi * np.asarray(frequency) * period)
        powers = np.polynomial.polynomial.polyval
        return np.asarray(powers(z, self.numerator) / powers(z, self.denominator))
