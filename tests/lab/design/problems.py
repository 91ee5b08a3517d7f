"""Problems of excitation for a pendulum and the RRR, and what their solutions are compared with."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from rrrgen.lab.design.design import ExcitationLimits, ExcitationProblem, excitation_problem
from samples.casadi_arms import double_pendulum_regressor

HERE = Path(__file__).parent
SEARCHED = range(5)
BETA = np.array([0.2, 0.05, 0.3, 0.05, 0.8, 0.1])
CHAPTER_LIMITS = ExcitationLimits(speed=(2 * math.pi, 3 * math.pi, 3 * math.pi), acceleration=(60.0, 60.0, 60.0))


def pendulum_problem(**changes) -> ExcitationProblem:
    settings = {
        "harmonics": 4,
        "base_frequency": 0.25,
        "sample_period": 2e-3,
        "design_samples": 40,
        "max_iterations": 60,
        "limits": ExcitationLimits(speed=(6.0, 8.0), acceleration=(30.0, 40.0)),
    } | changes
    return excitation_problem(double_pendulum_regressor(), **settings)


def independent_peaks(trajectory, samples: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """q, dq, ddq on ``samples`` instants of one cycle, straight from (14.24)."""
    t = np.arange(samples) / samples / trajectory.base_frequency
    w = 2 * np.pi * trajectory.base_frequency * np.arange(1, trajectory.harmonics + 1)
    S, C = np.sin(np.outer(t, w)), np.cos(np.outer(t, w))
    a, b = trajectory.a.T, trajectory.b.T
    return trajectory.q0 + (S / w) @ a - (C / w) @ b, C @ a + S @ b, -(S * w) @ a + (C * w) @ b


def same(first, second) -> bool:
    return first.seed == second.seed and np.array_equal(first.trajectory.coefficients, second.trajectory.coefficients)
