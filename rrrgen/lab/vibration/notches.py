"""Notch filters: cancel the lightly damped poles of vibration modes and replace them by well damped ones.

``H(z) = g prod_i (1 - 2 r_i cos(w_i) z^-1 + r_i^2 z^-2)/(1 - 2 R_i cos(W_i) z^-1 + R_i^2 z^-2)`` with H(1) = 1, whose
zeros r_i e^(+-j w_i) are the sampled poles of mode i, so that they cancel exactly in a posture whose mode has the
frequency and damping of the design. The poles R_i e^(+-j W_i) have the same frequency and the damping ratio ``width``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from rrrgen.base.arrays import Array
from rrrgen.base.errors import InputError
from rrrgen.emit.controller.state_space import StateSpace, realize
from rrrgen.lab.vibration.modes import Vibration, below_sampling, pole

LEAST_WIDTH = 0.1  # damping ratio of the poles: a narrower filter would ring itself
WIDEST = 1.0
PEAK = 3.0  # largest amplification by a mode that may remain after the filter, about 10 dB
FINENESS = 200


@dataclass(frozen=True)
class Notch:
    """Second-order notch filter with the sampling ``period`` (s).

    ``numerator`` ``g [1, c_1, c_2]`` and ``denominator`` ``[1, d_1, d_2]`` are in ascending powers of z^-1. ``width``
    is the damping ratio of the filter's poles. ``peak`` is the amplification by the vibration mode that remains after
    the filter, ``|H| / (2 zeta)`` at the mode's frequency, in the worst posture.
    """

    numerator: tuple[float, float, float]
    denominator: tuple[float, float, float]
    width: float
    peak: float
    period: float

    def response(self, frequency: Array) -> Any:
        """Complex frequency response H (L,) at ``frequency`` (L,) in Hz."""
        z = np.exp(-2j * np.pi * np.asarray(frequency) * self.period)
        powers = np.polynomial.polynomial.polyval
        return powers(z, self.numerator) / powers(z, self.denominator)

    def state_space(self) -> StateSpace:
        """The filter in the modal state-space form, which keeps its precision in single-precision C."""
        return realize(np.array(self.numerator), np.array(self.denominator))


def design_notches(
    vibrations: Sequence[Vibration], period: float, peak: float = PEAK, width: float | None = None
) -> list[Notch]:
    """Design one notch filter for each of the ``vibrations``, for the sampling ``period`` in s.

    ``width`` is the damping ratio of the filters' poles. If it is None, each filter gets the smallest width with which
    the amplification that remains, ``|H| / (2 zeta)``, is at most ``peak`` in every posture, or 1 if no width achieves
    that: a narrow notch costs least phase below its frequency. Raises :class:`InputError` for a vibration above half
    the sampling rate or a width outside (0, 1].
    """
    below_sampling(vibrations, period)
    if width is not None and not 0.0 < width <= WIDEST:
        raise InputError(f"the width of a notch is the damping ratio of its poles, above 0 and at most {WIDEST:g}")
    if width is not None:
        return [_notch(each, period, width) for each in vibrations]
    return [_narrowest(each, period, peak) for each in vibrations]


def _narrowest(vibration: Vibration, period: float, peak: float) -> Notch:
    widths = np.geomspace(min(max(LEAST_WIDTH, 2.0 * vibration.damping), WIDEST), WIDEST, FINENESS)
    trials = (_notch(vibration, period, float(width)) for width in widths)
    return next((found for found in trials if found.peak <= peak), _notch(vibration, period, WIDEST))


def _notch(vibration: Vibration, period: float, width: float) -> Notch:
    zeros = _factor(pole(vibration.frequency, vibration.damping, period))
    poles = _factor(pole(vibration.frequency, min(width, 1.0 - 1e-12), period))
    gain = sum(poles) / sum(zeros)
    numerator = (gain, gain * zeros[1], gain * zeros[2])
    found = Notch(numerator, poles, width, 0.0, period)
    left = np.abs(found.response(np.array(vibration.frequencies)))
    peak = float(np.max(left / (2.0 * np.maximum(vibration.dampings, 1e-4))))
    return replace(found, peak=peak)


def _factor(root: complex) -> tuple[float, float, float]:
    return 1.0, -2.0 * root.real, abs(root) ** 2


def phase_lag(notches: Sequence[Notch], frequency: float) -> float:
    """Phase lag in degrees of all notches in series at ``frequency`` in Hz, such as the crossover of a control loop."""
    total = np.prod([each.response(np.array([frequency]))[0] for each in notches])
    return float(-np.degrees(np.angle(total)))
