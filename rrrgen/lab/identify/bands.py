"""Uncertainty of predicted torques: a band from the covariance of the parameters and the scatter of the residuals.

The variance of a measured torque about the prediction ``W theta`` is ``w C w' + sigma_j^2``: that of the parameters,
with the covariance C, and that of the residuals of the joint on the fitted rows.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from rrrgen.base.arrays import Array
from rrrgen.lab.estimate.tsqr import Rows

BAND = 1.96
"""Half width of a 95 % band in standard deviations."""


@dataclass(frozen=True)
class Coverage:
    """Share of measured torques inside their 95 % band: ``share`` over all rows, ``joints`` (n,) joint by joint.

    ``parameters`` is the part of the band's width that the parameters cause: the RMS ratio of their standard deviation
    to the total. A joint without rows has NaN.
    """

    share: float
    parameters: float
    joints: tuple[float, ...]


@dataclass(frozen=True, eq=False)
class TorqueBand:
    """Uncertainty of the torques that a model predicts.

    ``theta`` (p,) are the parameters of all columns, ``root root'`` (p, p) is their covariance, ``sigma`` (n,) the
    standard deviation of the residuals of each joint, N m (N).
    """

    theta: Array
    root: Array
    sigma: Array

    @classmethod
    def of(cls, theta: Array, to_columns: Array, covariance: Array, sigma: Array) -> TorqueBand:
        """Build the band from the ``covariance`` (r, r) of the identifiable parameters.

        ``to_columns`` (p, r) maps these to ``theta`` (p,); ``sigma`` (n,) is that of the residuals.
        """
        values, V = np.linalg.eigh(0.5 * (covariance + covariance.T))
        return cls(theta, to_columns @ (V * np.sqrt(np.maximum(values, 0.0))), sigma)

    def parameters(self, W: Array) -> Array:
        """Standard deviation (N, n) of the predicted torque, N m (N), from the parameters alone; W is (N, n, p)."""
        return np.asarray(np.linalg.norm(W @ self.root, axis=-1))

    def total(self, W: Array) -> Array:
        """Standard deviation (N, n) of the measured torque about the prediction, N m (N)."""
        return np.asarray(np.hypot(self.parameters(W), self.sigma))

    def coverage(self, blocks: Iterable[Rows]) -> Coverage | None:
        """Coverage of the rows in use by the 95 % band; None without rows."""
        n = len(self.sigma)
        inside, count = np.zeros(n, np.int64), np.zeros(n, np.int64)
        own = all_ = 0.0
        for rows in blocks:
            total = self.total(rows.W)
            inside += np.sum(rows.use & (np.abs(rows.tau - rows.W @ self.theta) <= BAND * total), axis=0)
            count += np.sum(rows.use, axis=0)
            own += float(np.sum(np.where(rows.use, self.parameters(rows.W), 0.0) ** 2))
            all_ += float(np.sum(np.where(rows.use, total, 0.0) ** 2))
        if not count.any() or all_ == 0.0:
            return None
        pairs = zip(inside.tolist(), count.tolist(), strict=True)
        joints = tuple(a / b if b else float("nan") for a, b in pairs)
        return Coverage(int(np.sum(inside)) / int(np.sum(count)), float(np.sqrt(own / all_)), joints)
