"""Residuals of the momentum observer along a recording, by the same discrete-time steps as on the controller.

The residual r (n,) estimates the external torques at the joints; without contact it is noise and model error.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from rrrgen.base.arrays import Array
from rrrgen.lab.data.kalman import KalmanMatrices
from rrrgen.lab.data.smoother import KalmanSmoother

if TYPE_CHECKING:
    from rrrgen.runtime.model import Model

SETTLED = 1e-3
"""Residuals are used once the transients of the filters have decayed to this share of their initial size."""


def observer_residuals(
    model: Model, q: Array, tau: Array, period: float, filter: KalmanSmoother, gain: float, width: float
) -> Array:
    """External joint torques r (m, n), N m or N, estimated by the momentum observer from a recording.

    ``q`` (N, n) are the positions, rad or m, sampled with ``period`` (s); ``tau`` (N, n) the torques, N m or N, each
    held until the next sample. The causal Kalman ``filter`` computes the speeds. ``gain`` is the pole of the observer
    (1/s), ``width`` the speed below which friction is smoothed (rad/s or m/s). The initial samples, in which the
    filters settle, are left out, so m < N.
    """
    motion = filter(period * np.arange(len(q)), q)
    p, ct, g = model.momentum_terms(motion.q, motion.dq)
    u = ct - g - model.smooth_friction(motion.dq, model.friction_parameters, width)
    y = np.diff(p, axis=0) / period - tau[:-1] - 0.5 * (u[1:] + u[:-1])
    start = filter.memory(period) + math.ceil(-math.log(SETTLED) / (gain * period))
    return first_order_lag(y, math.exp(-gain * period))[start:]


def first_order_lag(y: Array, alpha: float) -> Array:
    """First-order low-pass filter ``r_k = alpha r_(k-1) + (1 - alpha) y_k`` along the first axis, starting at r = 0."""
    from scipy.signal import lfilter

    return np.asarray(lfilter([1.0 - alpha], [1.0, -alpha], y, axis=0))


def changes(r: Array, period: float, gain: float) -> Array:
    """Changes h (N, n) of residuals ``r`` (N, n) for contact detection, starting at zero; N m or N.

    ``h_k = alpha^2 h_(k-1) + alpha (r_k - r_(k-1))`` with alpha = exp(-gain period), as in the emitted function
    ``contact``: the residual of an observer with twice the pole ``gain`` (1/s), minus r.
    """
    from scipy.signal import lfilter

    alpha = math.exp(-gain * period)
    return np.asarray(lfilter([alpha], [1.0, -alpha * alpha], np.diff(r, axis=0, prepend=r[:1]), axis=0))


def step_responses(matrices: Sequence[KalmanMatrices], gain: float, seconds: float) -> Array:
    """Step responses (N, n) of the residuals to a unit external torque at each joint, from the next sample on.

    ``matrices`` are those of the Kalman filter of each joint, ``gain`` is the pole of the observer (1/s), ``seconds``
    the length of the responses. A constant torque gives a constant acceleration: the Kalman filter measures a
    parabola, and the observer low-pass filters the change of the estimated speed.
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
