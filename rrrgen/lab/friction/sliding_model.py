"""A linear model of the torque of one joint in sliding, to which effects are added to see whether they explain more.

Inertia, gravity, Coulomb and viscous friction and a Stribeck term describe the torque. Another effect is there if its
columns explain torques in blocks of time that were left out, clearly and by more than a model error would.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rrrgen.base.arrays import Array
from rrrgen.lab.estimate.linear import solve
from rrrgen.lab.friction.initial_values import SPEEDS, sliding_samples
from rrrgen.lab.friction.joint_recording import JointData

SLOWEST = 0.03  # rad/s (m/s): slower rows depend on the bristles
BLOCK, FOLDS = 2.0, 5  # s; interleaved folds of blocks
FEWEST_BLOCKS, FEWEST_ROWS = 8, 100


@dataclass(frozen=True)
class Evidence:
    """What added columns explain: ``gain``, the share of the held-out squares, and ``t`` and ``p`` of it.

    ``t`` is the mean gain of a block over its standard error, ``p`` the probability of at least these coefficients
    without the effect.
    """

    gain: float
    t: float
    p: float


@dataclass(frozen=True, eq=False)
class SlidingModel:
    """N rows ``torque = columns x`` in sliding: ``columns`` (N, k), of which the first two are dq and sgn dq.

    ``q``, ``dq``, ``torque`` and ``time`` (N,) are in SI units; ``block`` (N,) is the number of the block of time.
    """

    q: Array
    dq: Array
    torque: Array
    time: Array
    block: NDArray[np.int64]
    columns: Array

    @classmethod
    def of(cls, data: JointData, gravity: int, delay: float) -> SlidingModel | None:
        """The model of ``data`` with the Stribeck speed that fits best; None if there are too few rows.

        ``gravity`` is the number of gravity coefficients; the motion lags the torque by ``delay`` sampling periods.
        """
        samples = sliding_samples(data, delay)
        fast = np.abs(samples.dq) > SLOWEST
        block = np.unique((samples.t[fast] / BLOCK).astype(int), return_inverse=True)[1]
        if fast.sum() < FEWEST_ROWS or block[-1] + 1 < FEWEST_BLOCKS:
            return None
        dq, tau = samples.dq[fast], samples.tau[fast]
        sign = np.sign(dq)
        # the delay is one of a grid: what is left of it acts through the derivative of the torque
        ahead, behind = (sliding_samples(data, delay + side).tau[fast] for side in (0.5, -0.5))
        others = [*(column[fast] for column in samples.rigid_columns(gravity)), ahead - behind]
        fits = []
        for speed in SPEEDS * data.speed:
            ratio = (dq / speed) ** 2
            stribeck = [sign * np.exp(-ratio), sign * ratio * np.exp(-ratio)]  # with its derivative by that speed
            W = np.column_stack([dq, sign, *others, *stribeck])
            fits.append((float(np.sum(solve(W, tau).residual(tau) ** 2)), W))
        W = min(fits, key=lambda fit: fit[0])[1]
        return cls(samples.q[fast], dq, tau, samples.t[fast], block, W)

    def beside(self, columns: Array) -> SlidingModel:
        """The model with ``columns`` (N, c) added at its end."""
        return replace(self, columns=np.column_stack([self.columns, columns]))

    @property
    def x(self) -> Array:
        """Least-squares coefficients (k,) of the columns."""
        return np.asarray(solve(self.columns, self.torque).x)

    def evidence(self, count: int) -> Evidence:
        """What the last ``count`` columns explain."""
        before, after = replace(self, columns=self.columns[:, :-count]).held_out(), self.held_out()
        decrease = before - after
        spread = float(np.std(decrease, ddof=1)) / np.sqrt(len(decrease))
        moved, covariance = self.x[-count:], self.covariance[-count:, -count:]
        gain = float(np.sum(decrease) / max(float(np.sum(before)), np.finfo(float).tiny))
        t = float(np.mean(decrease)) / spread if spread > 0.0 else 0.0
        return Evidence(gain, t, _probability(float(moved @ np.linalg.pinv(covariance) @ moved), count, len(decrease)))

    def held_out(self) -> Array:
        """Squared errors of every block, (B,), predicted by a fit to the other folds."""
        A, y, block = self.columns, self.torque, self.block
        errors = np.zeros(int(block[-1]) + 1)
        for fold in range(FOLDS):
            out = block % FOLDS == fold
            if out.any() and not out.all():
                left = y[out] - A[out] @ solve(A[~out], y[~out]).x
                errors += np.bincount(block[out], left**2, minlength=len(errors))
        return errors

    @property
    def covariance(self) -> Array:
        """Covariance (k, k) of the coefficients from the estimates that leave out one of the G blocks each.

        ``(G - 1)/G sum (x_g - mean)(x_g - mean)'``; the sum of squared scores of the residuals is too small where, as
        here, a few blocks determine a parameter, since the fit follows their errors.
        """
        count = int(self.block[-1]) + 1
        rows = np.column_stack([self.columns, self.torque])
        products = np.stack([rows[self.block == k].T @ rows[self.block == k] for k in range(count)])
        left = np.sum(products, axis=0) - products
        size = np.sqrt(np.einsum("gii->gi", left[:, :-1, :-1])).max(axis=0)
        H = left[:, :-1, :-1] / (size[:, None] * size)
        x = np.stack(
            [np.linalg.pinv(matrix) @ (row / size) / size for matrix, row in zip(H, left[:, :-1, -1], strict=True)]
        )
        x -= x.mean(axis=0)
        return np.asarray((count - 1) / count * x.T @ x)


def _probability(statistic: float, parameters: int, blocks: int) -> float:
    """Probability of Hotelling's statistic or more with ``parameters`` q and ``blocks`` G: F(q, G - q)."""
    from scipy.stats import f as fisher

    freedom = max(1, blocks - parameters)
    return float(fisher.sf(statistic * freedom / (parameters * max(1, blocks - 1)), parameters, freedom))
