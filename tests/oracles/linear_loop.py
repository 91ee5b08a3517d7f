"""The frequency response of one joint of a sampled arm, from its linearised equations: the truth of experiments."""

from __future__ import annotations

import numpy as np
from scipy.linalg import expm


def linearised(derivative, state, tau):
    """Matrices A, B of ``dx/dt = f(x, tau)`` by central differences."""

    def slope(dx, du, size):
        forward, backward = derivative(state + dx, 0.0, tau + du), derivative(state - dx, 0.0, tau - du)
        return (forward - backward) / (2.0 * size)

    A = [slope(1e-6 * row, 0.0, 1e-6) for row in np.eye(len(state))]
    B = [slope(0.0, 1e-3 * row, 1e-3) for row in np.eye(len(tau))]
    return np.array(A).T, np.array(B).T


def joint_response(plant, state, mass, joint, controllers, period, delay, frequency):
    """``q_i/u_i`` (L,) with the other loops closed: zero-order hold, ``delay`` samples, torques ``mass u + const``.

    ``controllers`` are the coefficients [c_0, c_1] of every joint in powers of z^-1.
    """
    n = len(controllers)
    tau = plant.body.bias(state[plant.layout["q"]], np.zeros(n))
    A, B = linearised(plant.state_derivative(), state, tau)
    m = len(A)
    block = np.zeros((m + n, m + n))
    block[:m, :m], block[:m, m:] = A, B
    step = expm(block * period)
    C = np.array([plant.encoders(row) for row in np.eye(m)]).T
    others = [k for k in range(n) if k != joint]
    found = []
    for f in frequency:
        z = np.exp(2j * np.pi * f * period)
        G = C @ np.linalg.solve(z * np.eye(m) - step[:m, :m], step[:m, m:]) @ mass * z**-delay
        K = np.diag([c0 + c1 / z for c0, c1 in controllers])[np.ix_(others, others)]
        inner = np.linalg.solve(np.eye(n - 1) + K @ G[np.ix_(others, others)], K @ G[others, joint])
        found.append(G[joint, joint] - G[joint, others] @ inner)
    return np.array(found)
