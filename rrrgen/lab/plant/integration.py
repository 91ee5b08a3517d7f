"""Integration of the plant over one sample under a constant torque.

A rigid plant is integrated by Runge-Kutta steps that end at the times at which a joint stops, so that sgn(dq) never
changes within a step; a joint at rest stays there as long as friction can hold it. Every other plant is integrated by
LSODA with smoothed friction.
"""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from rrrgen.base.errors import DerivationError
from rrrgen.lab.plant.plant import Plant

Array = NDArray[Any]

MOST_STOPS = 50
"""Largest number of stops of joints that are located within one step; the rest of the step then ignores further
ones."""


class Integrator(Protocol):
    """Interface of an integrator that advances the state of a plant by one sample."""

    def advance(self, state: Array, tau: Array, duration: float) -> Array:
        """The state ``duration`` seconds later under the constant torque ``tau`` (n,)."""
        ...


def make_integrator(plant: Plant, steps: int = 2, tolerance: float = 1e-8) -> Integrator:
    """Choose the integrator for ``plant``: Runge-Kutta for a rigid one, otherwise LSODA.

    ``steps`` are the Runge-Kutta steps per sample, ``tolerance`` is that of LSODA.
    """
    return StiffIntegrator(plant, tolerance) if plant.needs_stiff_solver else RigidIntegrator(plant, steps)


class StiffIntegrator:
    """LSODA over each sample, for friction with a state, coupled motors, flexible joints and a flexible base.

    ``tolerance`` is the relative one; the absolute one is a thousandth of it.
    """

    def __init__(self, plant: Plant, tolerance: float = 1e-8) -> None:
        self._derivative = plant.state_derivative()
        self.tolerance = tolerance

    def advance(self, state: Array, tau: Array, duration: float) -> Array:
        """The state ``duration`` (s) later under the torque ``tau`` (n,); raises DerivationError if LSODA fails."""
        from scipy.integrate import odeint

        result, info = odeint(
            self._derivative,
            state,
            [0.0, duration],
            args=(tau,),
            rtol=self.tolerance,
            atol=self.tolerance * 1e-3,
            mxstep=20_000,
            full_output=True,
            printmessg=False,
        )
        if info["message"] != "Integration successful.":
            raise DerivationError(f"the virtual robot cannot be integrated: {info['message']}")
        return np.asarray(result[1])


def breaks_away(plant: Plant) -> NDArray[np.bool_]:
    """At which joints (n,) friction jumps where the speed changes its sign, so that they may stick."""
    rest, one, model = np.zeros(plant.n), np.ones(plant.n), plant.friction.model
    return np.asarray(model.torque_in_direction(rest, one, one) > model.torque_in_direction(rest, -one, one))


class RigidIntegrator:
    """Fourth-order Runge-Kutta with constant sgn(dq), interrupted where a joint's speed crosses zero."""

    def __init__(self, plant: Plant, steps: int = 2) -> None:
        self.plant, self.n, self.steps = plant, plant.n, steps
        self.direction = np.zeros(plant.n)
        """Per joint +1 or -1 while sliding, 0 while stuck."""
        self.jumps = breaks_away(plant)

    def advance(self, state: Array, tau: Array, duration: float) -> Array:
        """The state ``duration`` (s) later under the torque ``tau`` (n,), in ``steps`` equal steps."""
        for _ in range(self.steps):
            state = self._step(state, tau, duration / self.steps)
        return state

    def _step(self, state: Array, tau: Array, duration: float) -> Array:
        remaining = duration
        for _ in range(MOST_STOPS):
            self._decide(state, tau)
            after = self._runge_kutta(state, tau, remaining)
            stopping = self._reversed_joints(state, after)
            if not stopping.any():
                return after
            fraction = self._first_stop(state, tau, remaining, stopping)
            state = self._runge_kutta(state, tau, fraction * remaining)
            reached = np.abs(state[self.n :]) <= 1e-9 * np.maximum(1.0, np.abs(after[self.n :]))
            state[self.n :][stopping & reached] = 0.0
            remaining *= 1.0 - fraction
            if remaining <= 1e-12 * duration:
                return state
        self._decide(state, tau)
        return self._runge_kutta(state, tau, remaining)

    def _reversed_joints(self, before: Array, after: Array) -> NDArray[np.bool_]:
        """Joints (n,) whose speed changed its sign within the step, so that the friction had the wrong direction."""
        sliding = self.jumps & (self.direction != 0.0) & (before[self.n :] != 0.0)
        return np.asarray(sliding & (after[self.n :] * self.direction < 0.0))

    def _first_stop(self, state: Array, tau: Array, duration: float, stopping: NDArray[np.bool_]) -> float:
        """The fraction of ``duration`` after which the first of the ``stopping`` joints is at rest, by regula falsi."""
        n = self.n
        low, high = 0.0, 1.0
        start = state[n:][stopping] * self.direction[stopping]
        at_low, at_high = float(np.min(start)), float(np.min(self._margins(state, tau, duration, stopping)))
        side = 0
        for _ in range(40):
            middle = (low * at_high - high * at_low) / (at_high - at_low)
            value = float(np.min(self._margins(state, tau, middle * duration, stopping)))
            if abs(value) <= 1e-10 or high - low <= 1e-13:
                return middle
            if value > 0.0:
                low, at_low = middle, value
                at_high = at_high / 2.0 if side == 1 else at_high  # Illinois rule: halve the value of an end that stays
                side = 1
            else:
                high, at_high = middle, value
                at_low = at_low / 2.0 if side == -1 else at_low
                side = -1
        return high

    def _margins(self, state: Array, tau: Array, duration: float, joints: NDArray[np.bool_]) -> Array:
        """Speeds of ``joints`` after ``duration``, positive in the direction in which they slid."""
        return np.asarray((self._runge_kutta(state, tau, duration)[self.n :] * self.direction)[joints])

    def _decide(self, state: Array, tau: Array) -> None:
        """Set the direction of sliding (-1, 0 or 1) of every joint; a joint that sticks has the direction 0.

        Otherwise it is the sign of the speed or, for a joint at rest, of its acceleration. The friction torques f of
        the joints at rest solve ``a = M^-1 (tau - h - f)`` with ``h = c + g``, where f is within its bounds if a = 0
        and at the bound that opposes a otherwise: a box-constrained quadratic program, solved by projected
        Gauss-Seidel.
        """
        q, dq = state[: self.n], state[self.n :]
        self.direction = np.sign(dq)
        if dq.all():
            return
        resting = np.flatnonzero(dq == 0.0)
        rest, one = np.zeros(self.n), np.ones(self.n)
        backward, forward = (self.plant.friction.torque_in_direction(rest, sign * one, tau) for sign in (-1.0, 1.0))
        inverse = np.linalg.inv(self.plant.body.mass(q))
        torque = np.array(self.plant.friction.torque_in_direction(dq, self.direction, tau))
        load = tau - self.plant.body.bias(q, dq)
        for _ in range(200):
            largest = 0.0
            for i in resting:
                moved = torque[i] + inverse[i] @ (load - torque) / inverse[i, i]
                moved = min(max(moved, backward[i]), forward[i])
                largest = max(largest, abs(moved - torque[i]))
                torque[i] = moved
            if largest <= 1e-13 * (1.0 + float(np.abs(load).max())):
                break
        acceleration = inverse @ (load - torque)
        for i in resting:  # without Coulomb friction the direction has no effect, but must not be 0, which means stuck
            held = backward[i] < torque[i] < forward[i]
            self.direction[i] = 0.0 if held else (np.sign(acceleration[i]) or 1.0)

    def _acceleration(self, q: Array, dq: Array, tau: Array) -> Array:
        net = tau - self.plant.friction.torque_in_direction(dq, self.direction, tau)
        free = self.direction != 0.0
        if free.all():
            return self.plant.body.acceleration(q, dq, net)
        ddq = np.zeros(self.n)
        if free.any():
            load = net - self.plant.body.bias(q, dq)
            ddq[free] = np.linalg.solve(self.plant.body.mass(q)[free][:, free], load[free])
        return ddq

    def _runge_kutta(self, state: Array, tau: Array, h: float) -> Array:
        n = self.n
        q, dq = state[:n], state[n:]
        a1 = self._acceleration(q, dq, tau)
        v2 = dq + 0.5 * h * a1
        a2 = self._acceleration(q + 0.5 * h * dq, v2, tau)
        v3 = dq + 0.5 * h * a2
        a3 = self._acceleration(q + 0.5 * h * v2, v3, tau)
        v4 = dq + h * a3
        a4 = self._acceleration(q + h * v3, v4, tau)
        return np.concatenate(
            [q + h / 6.0 * (dq + 2.0 * v2 + 2.0 * v3 + v4), dq + h / 6.0 * (a1 + 2 * a2 + 2 * a3 + a4)]
        )
