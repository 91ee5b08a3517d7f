"""Notch filters: cancel the lightly damped poles of vibration modes and replace them by well damped ones.

``H(z) = g prod_i (1 - 2 r_i cos(w_i) z^-1 + r_i^2 z^-2)/(1 - 2 R_i cos(W_i) z^-1 + R_i^2 z^-2)`` with H(1) = 1, whose
zeros are the sampled poles of the mode, so that the sampled peak is gone exactly at the designed posture.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from rrrgen.arrays import Array
from rrrgen.control.state_space import StateSpace, realize
from rrrgen.control.vibration.modes import Vibration, below_sampling, pole
from rrrgen.errors import InputError

LEAST_WIDTH = 0.1  # damping ratio of the poles: narrower filters ring themselves
WIDEST = 1.0
PEAK = 3.0  # amplification that may be left, about 10 dB
FINENESS = 200


@dataclass(frozen=True)
class Notch:
    """Second-order notch filter with the sampling ``period`` (s).

    Numerator ``g [1, c_1, c_2]`` and denominator ``[1, d_1, d_2]`` are in ascending powers of z^-1. ``width`` is the
    damping ratio of the poles, ``peak`` the amplification by the mode that remains at the worst posture.
    """

    numerator: tuple[float, float, float]
    denominator: tuple[float, float, float]
    width: float
    peak: float
    period: float

    def response(self, frequency: Array) -> Any:
        """Complex response at ``frequency`` (L,) in Hz."""
        z = np.exp(-2j * np.pi * np.asarray(frequency) * self.period)
        powers = np.polynomial.polynomial.polyval
        return powers(z, self.numerator) / powers(z, self.denominator)

    def state_space(self) -> StateSpace:
        """The filter as a model in state space, precise in float too."""
        return realize(np.array(self.numerator), np.array(self.denominator))


def design_notches(
    vibrations: Sequence[Vibration], period: float, peak: float = PEAK, width: float | None = None
) -> list[Notch]:
    """A notch per vibration for the sampling ``period`` in s.

    ``width`` is the damping ratio of the poles. Without it each notch is as narrow, and so costs as little phase below
    its frequency, as the postures allow: at none of them more than ``peak`` of the amplification ``1/(2 zeta)`` is
    left, ``|H| <= 2 zeta peak``, if a width up to 1 can do that.
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
    """Phase in degrees that the notches together cost at ``frequency`` in Hz, e.g. at the crossover of a loop."""
    total = np.prod([each.response(np.array([frequency]))[0] for each in notches])
    return float(-np.degrees(np.angle(total)))
