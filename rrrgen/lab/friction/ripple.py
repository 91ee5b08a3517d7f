"""Torque ripple of a joint: torques that repeat with its position, such as cogging of a motor or a harmonic drive.

A ripple is ``amplitude cos(order q - phase)``, the same in both directions of motion. Its order, a real number, is
searched among all that the range and the speeds of the motion tell apart. A ripple counts if it explains a tenth of the
squares in blocks of time that were left out; it is then taken off the recorded torque before friction laws are fitted.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from rrrgen.base.arrays import Array
from rrrgen.lab.estimate.linear import solve
from rrrgen.lab.friction.joint_recording import CUTOFF, JointData
from rrrgen.lab.friction.sliding_model import Evidence, SlidingModel

GAIN, AHEAD, UNLIKELY = 0.1, 2.0, 0.01
"""A ripple must explain 10 % of the held-out squares, with a mean gain of a block of two standard errors and p < 0.01
of the test over blocks."""
MOST = 3  # ripples of a joint
FEWEST_PERIODS = 2.0  # within the range of motion
LOWEST = 2.0  # order of a revolute joint; gravity has order 1
HIGHEST, MOST_ORDERS = 2000.0, 4000
SEARCHED = 6000  # rows at which orders are tried
SLOW = 20.0  # percentile of the speed at which the ripple of the highest order passes the low-pass filter
STEPS = 6  # Gauss-Newton steps of the order


@dataclass(frozen=True)
class Ripple:
    """A ripple ``amplitude cos(order q - phase)``: amplitude in N m (N), ``order`` in 1/rad (1/m), ``phase`` in rad.

    For a revolute joint the order is the number of periods in a revolution. ``amplitude_std`` and ``order_std`` are
    standard deviations over blocks; ``gain``, ``t`` and ``p`` are the evidence.
    """

    amplitude: float
    amplitude_std: float
    order: float
    order_std: float
    phase: float
    gain: float
    t: float
    p: float
    revolute: bool

    @property
    def line(self) -> str:
        """Amplitude and order with their deviations, in words."""
        if self.revolute:
            where = f"order {self.order:.5g} +- {self.order_std:.2g} per revolution"
        else:
            period = 2.0 * np.pi / self.order
            where = f"period {period:.5g} +- {period * self.order_std / self.order:.2g} m"
        return f"{self.amplitude:>12.5g} +- {self.amplitude_std:.2g}, {where}"

    @property
    def sentence(self) -> str:
        """What the ripple explains, in words."""
        return (
            f"the torque ripples with the position: {self.line.strip()}, which explains {100 * self.gain:.0f} % of the "
            "squared torque errors that are left; it is part of the fit, but not of the robot file, whose friction "
            "laws have none"
        )

    def torque(self, q: Array) -> Array:
        """Torque (N,), N m (N), at the positions ``q`` (N,), rad (m)."""
        return np.asarray(self.amplitude * np.cos(self.order * q - self.phase))

    def to_json(self) -> dict[str, Any]:
        """Amplitude, order and phase with their deviations, and what the ripple explains, as plain data."""
        return asdict(self)


def without_ripples(data: JointData, ripples: Sequence[Ripple], delay: float) -> JointData:
    """The recording ``data`` as it would be without ``ripples``; the motion lags the torque by ``delay`` periods."""
    u = data.u.copy()
    for first, last in data.stretches:
        k = np.arange(last - first)
        q = np.interp(k + 0.5 + delay, k, data.motion[0][first:last])  # in the middle of the time a torque is held
        u[first:last] -= sum(ripple.torque(q) for ripple in ripples)
    return replace(data, u=u)


def find_ripples(data: JointData, gravity: int, delay: float, revolute: bool) -> tuple[Ripple, ...]:
    """Find the ripples in ``data``, the one that explains most first; empty if there are none, or too few data.

    ``gravity`` is the number of gravity coefficients; the motion lags the torque by ``delay`` sampling periods.
    """
    model = SlidingModel.of(data, gravity, delay)
    ripples: list[Ripple] = []
    while model is not None and len(ripples) < MOST:
        order = _best_order(model, _orders(model, data, revolute), _cutoff(data))
        if order is None:
            break
        ripple, wider = _fit_ripple(model, order, _cutoff(data), revolute)
        if not (ripple.gain >= GAIN and ripple.t >= AHEAD and ripple.p < UNLIKELY):
            break
        ripples.append(ripple)
        model = wider
    return tuple(ripples)


def _cutoff(data: JointData) -> float:
    """Cut-off (Hz) of the low-pass filter on torque and motion."""
    return min(CUTOFF, 0.2 / data.period)


def _orders(model: SlidingModel, data: JointData, revolute: bool) -> Array:
    """Orders to try, in steps that the range of motion tells apart, up to those that the filter removes."""
    span = float(np.ptp(model.q))
    first = 2.0 * np.pi * FEWEST_PERIODS / span
    slow = float(np.percentile(np.abs(model.dq), SLOW))
    last = min(2.0 * np.pi * _cutoff(data) / slow, np.pi / (2.0 * data.resolution), HIGHEST if revolute else np.inf)
    step = 0.5 * np.pi / span
    return np.arange(max(first, LOWEST) if revolute else first, last, step)[:MOST_ORDERS]


def _waves(q: Array, dq: Array, order: float, cutoff: float) -> Array:
    """Columns (N, 2) of the cosine and sine of a ripple as the low-pass filter passes them at the present speed."""
    waves = np.column_stack([np.cos(order * q), np.sin(order * q)])
    return np.asarray(waves / (1.0 + order**8 * _damping(dq, cutoff))[:, None])


def _damping(dq: Array, cutoff: float) -> Array:
    """What the low-pass filter does to a ripple at the speeds ``dq``: its gain is ``1 / (1 + order^8 damping)``."""
    squared = (dq / (2.0 * np.pi * cutoff)) ** 2
    return np.asarray((squared * squared) ** 2)  # NumPy squares in a tenth of the time of other powers


def _best_order(model: SlidingModel, orders: Array, cutoff: float) -> float | None:
    """The order whose cosine and sine explain most of what ``model`` leaves, on a selection of its rows."""
    if not len(orders):
        return None
    at = np.arange(0, len(model.q), max(1, len(model.q) // SEARCHED))
    q, dq = model.q[at] - np.mean(model.q), model.dq[at]
    Q = np.linalg.qr(model.columns[at] / np.linalg.norm(model.columns[at], axis=0).clip(1e-300))[0]
    left = model.torque[at] - Q @ (Q.T @ model.torque[at])
    damping = _damping(dq, cutoff)
    # the orders are in equal steps: one complex product turns the waves of an order into those of the next
    wave, turn = np.exp(1j * orders[0] * q), np.exp(1j * (orders[-1] - orders[0]) / max(1, len(orders) - 1) * q)
    explained = []
    for order in orders:
        A = wave.view(float).reshape(-1, 2) / (1.0 + order**8 * damping)[:, None]  # as _waves, cosine and sine
        wave *= turn
        A -= Q @ (Q.T @ A)
        b = A.T @ left
        explained.append(float(b @ np.linalg.lstsq(A.T @ A, b, rcond=1e-6)[0]))
    return float(orders[int(np.argmax(explained))])


def _fit_ripple(model: SlidingModel, order: float, cutoff: float, revolute: bool) -> tuple[Ripple, SlidingModel]:
    """The ripple of an order near ``order``, and the model with its cosine and sine."""
    middle = float(np.mean(model.q))
    q = model.q - middle
    step_limit = 0.5 * np.pi / float(np.ptp(q))
    for _ in range(STEPS):
        waves = _waves(q, model.dq, order, cutoff)
        a, b = solve(np.column_stack([model.columns, waves]), model.torque).x[-2:]
        slope = q * (b * waves[:, 0] - a * waves[:, 1])  # derivative by the order
        wider = model.beside(np.column_stack([waves, slope]))
        step = float(np.clip(wider.x[-1], -step_limit, step_limit))
        order += step
    wider = model.beside(_waves(q, model.dq, order, cutoff))
    evidence: Evidence = wider.evidence(2)
    a, b = wider.x[-2:]
    waves = wider.columns[:, -2:]
    covariance = wider.beside(q * (b * waves[:, 0] - a * waves[:, 1])).covariance[-3:, -3:]
    amplitude = float(np.hypot(a, b))
    along = np.array([a, b]) / max(amplitude, np.finfo(float).tiny)
    ripple = Ripple(
        amplitude=amplitude,
        amplitude_std=float(np.sqrt(along @ covariance[:2, :2] @ along)),
        order=order,
        order_std=float(np.sqrt(covariance[2, 2])),
        phase=float((order * middle + np.arctan2(b, a)) % (2.0 * np.pi)),
        gain=evidence.gain,
        t=evidence.t,
        p=evidence.p,
        revolute=revolute,
    )
    return ripple, wider
