"""How many base parameters a structure has, by singular values of its stacked standard regressor."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from oracles.newton_euler import Robot, standard_regressor

# Singular values of exact zeros come out near 1e-16 of the largest; the smallest genuine one of arms with lengths
# between 0.05 m and 1 m stays above 1e-5 at a few hundred states, so the middle of the gap decides safely.
RELATIVE_THRESHOLD = 1e-10


@dataclass(frozen=True)
class Rank:
    """The rank, the ratio of the singular values on both sides of it, and all of them."""

    rank: int
    gap: float
    singular_values: np.ndarray


def matrix_rank(matrix: np.ndarray) -> Rank:
    """Rank by SVD with the gap; the gap is infinite when nothing is left behind the rank."""
    s = np.linalg.svd(matrix, compute_uv=False)
    if s.size == 0 or s[0] == 0.0:
        return Rank(0, np.inf, s)
    r = int(np.sum(s > RELATIVE_THRESHOLD * s[0]))
    gap = np.inf if r == len(s) or s[r] == 0.0 else s[r - 1] / s[r]
    return Rank(r, gap, s)


def stacked_regressor(robot: Robot, samples: int = 60, seed: int = 0, at_rest: bool = False) -> np.ndarray:
    """The regressors of random states on top of each other (samples n, 10 n)."""
    rng = np.random.default_rng(seed)
    blocks = []
    for _ in range(samples):
        q = rng.uniform(-np.pi, np.pi, robot.n)
        dq, ddq = rng.uniform(-2, 2, (2, robot.n)) * (not at_rest)
        blocks.append(standard_regressor(robot, q, dq, ddq))
    return np.vstack(blocks)


def base_parameter_count(robot: Robot, samples: int = 40, seed: int = 0) -> Rank:
    """Number of rigid-body base parameters; 40 states give four rows per standard parameter."""
    return matrix_rank(stacked_regressor(robot, samples, seed))
