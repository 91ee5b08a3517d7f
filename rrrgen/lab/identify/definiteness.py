"""Tests whether an estimated mass matrix is positive definite, as simulation and computed torque require."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rrrgen.base.arrays import Array
from rrrgen.lab.identify.estimated_terms import Column
from rrrgen.lab.identify.full_regressor import RigidModel
from rrrgen.runtime.regressor_columns import drive_columns

POSES = 10_000


def mass_matrix(model: RigidModel, columns: Sequence[Column], theta: Array, q: Array) -> Array:
    """Mass matrix M(q) (N, n, n), kg m^2 (kg), from the parameters ``theta`` (p,) of all ``columns``, at ``q`` (N, n).

    Column k is the torque at rest for unit acceleration of joint k alone, minus that for ddq = 0; drive inertia is
    included.
    """
    n, b = model.n, len(model.base_parameter_names)
    M = np.empty((*q.shape, n))
    inertia = [column for column in columns if column.kind == "inertia"]
    values = np.array([theta[i] for i, column in enumerate(columns) if column.kind == "inertia"])
    for start in range(0, len(q), 1000):
        part = q[start : start + 1000]
        rest = np.zeros_like(part)
        still = np.asarray(model.regressor(part, rest, rest)) @ theta[:b]
        for k in range(n):
            ddq = rest + np.eye(n)[k]
            torque = np.asarray(model.regressor(part, rest, ddq)) @ theta[:b] - still
            if inertia:
                torque = torque + drive_columns(inertia, rest, ddq) @ values
            M[start : start + 1000, :, k] = torque
    return M


def pose_limits(spec: Any, n: int) -> Array:
    """Lowest and highest joint positions (2, n), rad (m): limits of the robot file, +-pi (+-1 m) where it has none."""
    bounds = []
    for joint in spec.joints if spec is not None else [None] * n:
        limits = getattr(joint, "limits", None)
        reach = np.pi if joint is None or joint.is_revolute else 1.0
        lower = reach * -1.0 if limits is None or limits.lower is None else limits.lower
        upper = reach if limits is None or limits.upper is None else limits.upper
        bounds.append((lower, upper))
    return np.array(bounds).T


def indefinite_share(
    mass: Callable[[Array], Array], lower: Array, upper: Array, poses: int = POSES, seed: int = 0
) -> tuple[float, float]:
    """Share of random poses at which M(q) is not positive definite, and the smallest ratio of extreme eigenvalues.

    ``mass(q)`` maps poses (N, n) to matrices (N, n, n); the ``poses`` are uniform between ``lower`` and ``upper`` (n,).
    """
    rng = np.random.default_rng(seed)
    M = np.asarray(mass(rng.uniform(lower, upper, (poses, len(lower)))))
    values = np.linalg.eigvalsh(0.5 * (M + np.swapaxes(M, -1, -2)))
    bad: NDArray[np.bool_] = values[:, 0] <= 0.0
    return float(np.mean(bad)), float(np.min(values[:, 0] / np.maximum(values[:, -1], 1e-300)))
