"""Simulation of one joint over many short windows and many parameter vectors at once.

All quantities are arrays (C, S) over C parameter vectors and S windows. With a friction law that jumps at zero speed, a
joint sticks exactly while the load is below break-away; the instant at which it stops is located within a time step.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rrrgen.arrays import Array
from rrrgen.friction_estimation.candidates import Candidate

LUGRE_STEPS = (4, 8)
"""Fewest and most steps within a sampling period of about 1 ms: bristles are stiff."""
RESOLVED = 0.15  # angle, in rad, by which the joint on its bristles may oscillate within a step
NEURAL_STEPS = 4


@dataclass(frozen=True)
class Torque:
    """Recorded torque over S windows of ``length`` sampling periods.

    ``samples`` (N,) is the torque of the whole recording, ``starts`` (S,) the first sample of each window.
    """

    samples: Array
    starts: NDArray[np.int64]
    length: int

    def held(self, step: int, delay: Array) -> Array:
        """Torque (C, S) during sampling period number ``step`` of each window, delayed by ``delay`` (C, 1) periods.

        A fractional delay interpolates between two periods.
        """
        at = self.starts + step - delay
        low = np.floor(at).astype(np.int64)
        weight = at - low
        last = len(self.samples) - 1
        first, second = np.clip(low, 0, last), np.clip(low + 1, 0, last)
        return np.asarray((1.0 - weight) * self.samples[first] + weight * self.samples[second])

    def centred(self, delay: Array) -> Array:
        """Torque (C, S) at the start of each window: the mean of the values held before and after that instant."""
        return 0.5 * (self.held(0, delay) + self.held(-1, delay))


def simulate(
    candidate: Candidate,
    theta: Array,
    torque: Torque,
    q: Array,
    v: Array,
    period: float,
    stride: int,
    direction: Array | None = None,
    friction: Array | None = None,
) -> Array:
    """Simulate one joint over S windows for C parameter vectors.

    Returns the positions after every ``stride`` sampling periods, (length // stride + 1, C, S), rad or m. ``q`` and
    ``v`` (C, S) are the positions and speeds at the start of the windows, ``theta`` (k, C) the parameters of
    ``candidate``, ``torque`` the recorded torque, ``period`` is the sampling period (s). With a ``direction`` (S,), +1
    or -1, the joint is taken to slide that way all the time, even where a simulation with wrong parameters would stop:
    then positions are smooth functions of the parameters. ``friction`` (C, S) is the force of the bristles at the
    start, for a law with a state.
    """
    columns = [row[:, None] for row in theta]
    advance: Any
    if direction is not None and candidate.jumps:
        advance = _Sliding(candidate, columns, period, direction)
    elif friction is not None:
        advance = _Bristles(candidate, columns, period, friction)
    else:
        advance = (_Smooth if candidate.name == "neural" else _Sticking)(candidate, columns, period)
    delay = columns[-1]
    positions = np.empty((torque.length // stride + 1, *q.shape))
    positions[0] = q
    state = advance.start(q, v)
    for k in range(torque.length):
        state = advance.step(state, torque.held(k, delay))
        if (k + 1) % stride == 0:
            positions[(k + 1) // stride] = state[0]
    return positions


class _Sliding:
    """Integrator for laws that jump at zero speed, where the direction of sliding is given: midpoint rule."""

    def __init__(self, candidate: Candidate, theta: list[Array], period: float, direction: Array) -> None:
        self.candidate, self.theta, self.h, self.direction = candidate, theta, period, direction

    def start(self, q: Array, v: Array) -> tuple[Array, ...]:
        return q, v

    def step(self, state: tuple[Array, ...], u: Array) -> tuple[Array, ...]:
        q, v = state
        h, J = self.h, self.theta[0]
        net = u - self.candidate.gravity_torque(q + 0.5 * h * v, self.theta)
        a = (net - self.candidate.torque(v, self.theta, self.direction)) / J
        a = (net - self.candidate.torque(v + 0.5 * h * a, self.theta, self.direction)) / J
        return q + h * (v + 0.5 * h * a), v + h * a


class _Sticking:
    """Integrator for laws that jump at zero speed, with sticking.

    A step is the midpoint rule with a constant direction of sliding; it is cut at the instant at which the joint stops.
    """

    def __init__(self, candidate: Candidate, theta: list[Array], period: float) -> None:
        self.candidate, self.theta, self.h, self.J = candidate, theta, period, theta[0]
        zero = np.zeros_like(theta[0])
        self.forward = candidate.torque(zero, theta, 1.0)
        self.backward = candidate.torque(zero, theta, -1.0)

    def start(self, q: Array, v: Array) -> tuple[Array, ...]:
        return q, v

    def step(self, state: tuple[Array, ...], u: Array) -> tuple[Array, ...]:
        q, v = state
        h = self.h
        net = u - self.candidate.gravity_torque(q + 0.5 * h * v, self.theta)
        starting = (net > self.forward).astype(float) - (net < self.backward)
        direction = np.where(v == 0.0, starting, np.sign(v))
        sliding = np.abs(direction)
        a = (net - self.candidate.torque(v, self.theta, direction)) * sliding / self.J
        a = (net - self.candidate.torque(v + 0.5 * h * a, self.theta, direction)) * sliding / self.J
        after = v + h * a
        stops = after * direction < 0.0
        if not stops.any():
            return q + 0.5 * h * (v + after), after
        share = np.where(stops, v / np.where(stops, v - after, 1.0), 1.0)
        rest = (1.0 - share) * h
        level = np.where(starting > 0.0, self.forward, self.backward)
        again = np.where(stops & (starting != 0.0), (net - level) / self.J * rest, 0.0)
        q = q + 0.5 * share * h * (v + np.where(stops, 0.0, after)) + 0.5 * again * rest
        return q, np.where(stops, again, after)


class _Smooth:
    """Integrator for continuous laws: linearly implicit steps, stable for friction that is steep at low speed."""

    def __init__(self, candidate: Candidate, theta: list[Array], period: float) -> None:
        self.candidate, self.theta, self.J = candidate, theta, theta[0]
        self.h = period / NEURAL_STEPS
        values = candidate.law_values(theta)
        units = (len(values) - 1) // 2
        self.f, self.w, self.viscous = values[:units], values[units:-1], values[-1]

    def start(self, q: Array, v: Array) -> tuple[Array, ...]:
        return q, v

    def step(self, state: tuple[Array, ...], u: Array) -> tuple[Array, ...]:
        q, v = state
        for _ in range(NEURAL_STEPS):
            h = self.h
            net = u - self.candidate.gravity_torque(q + 0.5 * h * v, self.theta)
            friction, slope = self.viscous * v, self.viscous
            for f, w in zip(self.f, self.w, strict=True):
                bent = np.tanh(w * v)
                friction = friction + f * bent
                slope = slope + f * w * (1.0 - bent * bent)
            # 2 J dv/h + slope dv = 2 (net - friction): the trapezoidal rule, linearised
            dv = (net - friction) / (self.J / h + 0.5 * np.maximum(slope, -self.J / h))
            q, v = q + h * (v + 0.5 * dv), v + dv
        return q, v


class _Bristles:
    """Integrator for the LuGre law: trapezoidal rule for the speed, exact bristle deflection at a step's mean speed."""

    def __init__(self, candidate: Candidate, theta: list[Array], period: float, friction: Array) -> None:
        self.candidate, self.theta, self.J = candidate, theta, theta[0]
        self.s0, self.s1, self.excess, self.coulomb, self.viscous, self.speed = candidate.law_values(theta)
        self.friction = friction
        angle = period * float(np.sqrt(np.max(self.s0 / self.J)))
        self.steps = int(np.clip(np.ceil(angle / RESOLVED), *LUGRE_STEPS))
        self.h = period / self.steps

    def level(self, v: Array) -> Array:
        ratio = v / self.speed
        return np.asarray(self.excess * np.exp(-ratio * ratio) + self.coulomb)

    def start(self, q: Array, v: Array) -> tuple[Array, ...]:
        return q, v, self.friction / self.s0

    def step(self, state: tuple[Array, ...], u: Array) -> tuple[Array, ...]:
        q, v, z = state
        h, s0, s1, b = self.h, self.s0, self.s1, self.viscous
        per_step = self.J / h
        for _ in range(self.steps):
            net = u - self.candidate.gravity_torque(q + 0.5 * h * v, self.theta)
            mean = v
            for _ in range(2):
                x = np.maximum(h * s0 * np.abs(mean) / self.level(mean), 1e-12)
                forgotten = -np.expm1(-x)
                gain = 0.5 * h * forgotten / x
                kept = (1.0 - forgotten) * z + gain * v
                load = net - 0.5 * s0 * (z + kept) - s1 * (kept - z) / h - 0.5 * b * v
                after = (per_step * v + load) / (per_step + 0.5 * s0 * gain + s1 * gain / h + 0.5 * b)
                mean = 0.5 * (v + after)
            q, v, z = q + 0.5 * h * (v + after), after, kept + gain * after
        return q, v, z
