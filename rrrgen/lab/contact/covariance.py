"""Covariance of the residuals of contact-free motion, with which forces and their covariances are estimated.

The errors of external torques are mostly those of the model: they have a mean, several joints share them, and they
depend on the motion. Their covariance is therefore the second moment about zero, with all its entries, of residuals
without contact, enlarged if the forces that these are taken for are larger than it predicts.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rrrgen.base.arrays import Array
from rrrgen.base.errors import InputError


@dataclass(frozen=True)
class ResidualCovariance:
    """Covariance of external torques: ``matrix`` (n, n), (N m)^2 or N^2, with the factor ``enlarged`` in it."""

    matrix: Array
    enlarged: float

    @property
    def deviations(self) -> Array:
        """Root mean squares (n,) of the residuals, before the matrix was enlarged, N m or N."""
        return np.asarray(np.sqrt(np.diag(self.matrix) / self.enlarged))


def residual_covariance(residuals: Array, jacobians: Array) -> ResidualCovariance:
    """Covariance of the errors of external torques, from ``residuals`` (N, n) without contact, N m or N.

    ``jacobians`` (N, 6, n) are those of the tip. With the moment of one half of the recording, loads are estimated from
    the residuals of the other half: all torques as they are, forces from three joints on and wrenches from six. If
    their covariances P are right, the normalised squares e' inv(P) e are as large on average as e has entries; the
    largest ratio to that is the factor, or one. Raises InputError if the residuals of several joints depend on each
    other linearly.
    """
    n, half = residuals.shape[1], len(residuals) // 2
    halves = [(residuals[:half], jacobians[:half]), (residuals[half:], jacobians[half:])]
    moments = [_moment(r) for r, _ in halves]
    ratios = [
        np.mean([_normalised(S, r, J[:, :rows]) for S, (r, J) in zip(moments[::-1], halves, strict=True)])
        for rows in (0, 3, 6)
        if rows <= n
    ]
    enlarged = max(1.0, *map(float, ratios))
    return ResidualCovariance(enlarged * _moment(residuals), enlarged)


def _moment(residuals: Array) -> Array:
    S = residuals.T @ residuals / len(residuals)
    if np.linalg.matrix_rank(S, hermitian=True) < len(S):
        raise InputError("the residuals of the joints are zero or depend on each other: no covariance can be found")
    return np.asarray(S)


def _normalised(S: Array, residuals: Array, jacobians: Array) -> float:
    """Mean of e' inv(P) e over its expectation, for the loads e of ``jacobians`` (N, k, n) that the residuals give.

    With white residuals, e' inv(P) e is the square of their projection on the torques J'F of all loads; without rows,
    the loads are the torques themselves.
    """
    L = np.linalg.cholesky(S)
    white = np.linalg.solve(L, residuals.T).T
    rows = jacobians.shape[1]
    if not rows:
        return float(np.mean(white**2))
    directions = np.linalg.qr(np.linalg.solve(L, np.swapaxes(jacobians, 1, 2))).Q
    return float(np.mean(np.einsum("kji,kj->ki", directions, white) ** 2))
