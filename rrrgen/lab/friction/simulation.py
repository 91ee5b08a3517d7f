"""Simulation of one joint over many short windows and many parameter vectors at once.

All quantities are arrays (C, S) over C parameter vectors and S windows. With a friction law that jumps at zero speed, a
joint sticks exactly while the load is below break-away; the instant at which it stops is located within a time step.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rrrgen.base.arrays import Array
from rrrgen.lab.friction.candidate_laws import Candidate

LUGRE_STEPS = (4, 20)
"""Fewest and most steps within a sampling period of about 1 ms: bristles are stiff."""
RESOLVED = 0.16  # angle, in rad, by which the joint on its bristles may oscillate within a step
MEAN_SPEEDS = 3  # iterations for the mean speed of a step
RINGING = 2.0  # times the speed to which bristles bent to break-away accelerate the joint
SMALLEST = 1e-8  # least share of the deflection that is forgotten in a step: a smaller one would lose digits
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
    """Integrator for the LuGre law: at a step's mean speed the deflection and its mean over the step are exact.

    The mean of the deflections at both ends in place of the exact one would spoil stiffness and damping: bristles that
    bend back from break-away to sliding do so in less than a step.
    """

    def __init__(self, candidate: Candidate, theta: list[Array], period: float, friction: Array) -> None:
        self.candidate, self.theta, self.J = candidate, theta, theta[0]
        self.s0, self.s1, self.excess, self.coulomb, self.viscous, self.speed = candidate.law_values(theta)
        self.friction = friction
        self.period = period
        angle = period * float(np.sqrt(np.max(self.s0 / self.J)))
        self.steps = int(np.clip(np.ceil(angle / RESOLVED), *LUGRE_STEPS))
        # at most this speed the joint can come to rest within a period, or ring on its bristles
        level = self.excess + self.coulomb
        self.slow = np.abs(level) * (period / self.J + RINGING / np.sqrt(self.s0 * self.J))

    def start(self, q: Array, v: Array) -> tuple[Array, ...]:
        return q, v, self.friction / self.s0

    def step(self, state: tuple[Array, ...], u: Array) -> tuple[Array, ...]:
        near = (np.abs(state[1]) < self.slow).any(axis=0)  # windows in which steady sliding is not certain
        if self.steps == LUGRE_STEPS[0] or near.all():
            return self._advanced(state, u, self.steps)
        found = np.empty((3, *u.shape))
        for part, steps in ((near, self.steps), (~near, LUGRE_STEPS[0])):
            found[:, :, part] = self._advanced(tuple(each[:, part] for each in state), u[:, part], steps)
        return tuple(found)

    def _advanced(self, state: tuple[Array, ...], u: Array, steps: int) -> tuple[Array, ...]:
        """Solve ``dz/dt = v - x z/h`` with the mean speed, ``x = h sigma0 |v| / g(v)``, and ``J dv = h (u - tau_f)``.

        After a step of length h ``z+ = e^-x z + h p v``, the mean deflection is ``p z + h r v`` with
        ``p = (1 - e^-x)/x`` and ``r = (1 - p)/x``. The mean speed follows from them, and they from it: by iteration.
        """
        q, v, z = state
        h, s0, b = self.period / steps, self.s0, self.viscous
        decay, damping, inertia = -h * s0, self.s1 / h, self.J / h
        for _ in range(steps):
            net = u - self.candidate.gravity_torque(q + 0.5 * h * v, self.theta)
            driving, spring, damper = net + (inertia - 0.5 * b) * v, s0 * z, damping * z
            mean = v
            for _ in range(MEAN_SPEEDS):
                ratio = mean / self.speed
                level = self.excess * np.exp(-ratio * ratio) + self.coulomb
                x = np.minimum(decay * np.abs(mean) / level, -SMALLEST)  # -x of the formulas
                forgotten = np.expm1(x)
                p = forgotten / x
                gain = 0.5 * h * p
                resistance = (0.5 * decay) * ((1.0 - p) / x) + damping * gain
                after = driving - spring * p - resistance * v - damper * forgotten
                after = after / (inertia + 0.5 * b + resistance)
                mean = 0.5 * (v + after)
            z = z + gain * (v + after) + forgotten * z
            q, v = q + h * mean, after
        return q, v, z
