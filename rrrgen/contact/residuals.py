"""The residuals of the momentum observer along a recording, computed as the controller computes them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from rrrgen.arrays import Array
from rrrgen.signals.kalman import KalmanMatrices
from rrrgen.signals.smoother import KalmanSmoother

if TYPE_CHECKING:
    from rrrgen.runtime.model import Model

SETTLED = 1e-3
"""Share of the start of a filter that is left when its residuals count."""


def observer_residuals(
    model: Model, q: Array, tau: Array, period: float, filter: KalmanSmoother, gain: float, width: float
) -> Array:
    """The estimates r (m, n) of ``momentum_observer`` from positions ``q`` (N, n) and torques ``tau`` (N, n).

    The speeds are those of the causal Kalman ``filter``, ``tau`` of a sample is applied until the next one, ``gain``
    is the pole of the observer in 1/s, ``width`` that of smooth friction in rad/s. What is left of the start of the
    filters is cut off.
    """
    motion = filter(period * np.arange(len(q)), q)
    p, ct, g = model.momentum_terms(motion.q, motion.dq)
    u = ct - g - model.smooth_friction(motion.dq, model.friction_parameters, width)
    y = np.diff(p, axis=0) / period - tau[:-1] - 0.5 * (u[1:] + u[:-1])
    start = filter.memory(period) + math.ceil(-math.log(SETTLED) / (gain * period))
    return first_order_lag(y, math.exp(-gain * period))[start:]


def first_order_lag(y: Array, alpha: float) -> Array:
    """r_k = alpha r_(k-1) + (1 - alpha) y_k along the first axis, from r = 0."""
    from scipy.signal import lfilter

    return np.asarray(lfilter([1.0 - alpha], [1.0, -alpha], y, axis=0))


def step_responses(matrices: Sequence[KalmanMatrices], gain: float, seconds: float) -> Array:
    """The residuals (N, n) after a unit step of the external torque of each joint, filter included, from the next tick.

    The step accelerates a joint evenly, which the filter sees as a parabola; the observer sees its change of speed.
    """
    found: list[Any] = []
    for each in matrices:
        count = max(2, round(seconds / each.period))
        x, speed, speeds = np.zeros(3), 0.0, np.empty(count)
        for k in range(count):
            measured = 0.5 * ((k + 1) * each.period) ** 2
            x = x + each.k * (measured - x[0])
            speeds[k], speed = (x[1] - speed) / each.period, x[1]
            x = each.E @ x
        found.append(first_order_lag(speeds, math.exp(-gain * each.period)))
    return np.stack(found, axis=1)
