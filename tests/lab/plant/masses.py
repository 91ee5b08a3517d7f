"""Masses on a line, with friction, and their integration."""

from __future__ import annotations

import numpy as np

STEP = 1e-3


class Masses:
    """n uncoupled inertias in a constant field: ddq = (tau - weight)/J, joint by joint."""

    def __init__(self, inertia: list[float], weight: list[float] | None = None) -> None:
        self.J = np.array(inertia)
        self.weight = np.zeros(len(inertia)) if weight is None else np.array(weight)
        self.n = len(inertia)

    def mass_matrix(self, q, beta=None):
        return np.diag(self.J)

    def inverse_dynamics(self, q, dq, ddq, beta=None):
        return self.J * ddq + self.weight


def advance(integrator, state, tau, duration: float, step: float = STEP):
    for _ in range(round(duration / step)):
        state = integrator.advance(state, np.asarray(tau, dtype=float), step)
    return state
