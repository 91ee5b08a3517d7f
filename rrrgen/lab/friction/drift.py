"""Test whether the friction of a joint drifts during a recording, as it does while a gear warms up.

The torques in sliding are fitted with inertia, gravity, Coulomb and viscous friction and a Stribeck term, once alone
and once with viscous and Coulomb friction that change linearly with the time s from -1/2 to 1/2. Friction drifts if the
change explains torques in blocks of time that were left out, clearly and by more than a model error would. It is then
taken off the recorded torques before friction laws are fitted.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rrrgen.base.arrays import Array
from rrrgen.lab.estimate.linear import solve
from rrrgen.lab.friction.initial_values import SPEEDS, sliding_samples
from rrrgen.lab.friction.joint_recording import JointData

SLOWEST = 0.03  # rad/s (m/s): slower rows depend on the bristles
BLOCK, FOLDS = 2.0, 5  # s; interleaved folds of blocks
GAIN, AHEAD, UNLIKELY = 0.05, 2.0, 0.01
"""A drift is reported if it explains 5 % of the held-out squares, the mean gain of a block is two standard errors and
the test over blocks has p < 0.01. The last alone reports drift where there is none, in 10 to 20 % of recordings."""
FEWEST_BLOCKS = 8


@dataclass(frozen=True)
class Drift:
    """Linear change of the friction over a recording, from its beginning to its end.

    ``viscous`` and ``coulomb`` are the changes with standard deviations ``viscous_std`` and ``coulomb_std`` over
    blocks, ``mean_viscous`` and ``mean_coulomb`` the values in the middle, all in SI. ``gain`` is the explained share
    of the held-out squares, ``t`` the mean gain of a block over its standard error, ``p`` the probability of at least
    this change without drift.
    """

    viscous: float
    viscous_std: float
    coulomb: float
    coulomb_std: float
    mean_viscous: float
    mean_coulomb: float
    gain: float
    t: float
    p: float

    @property
    def is_certain(self) -> bool:
        """Whether the friction drifts."""
        return self.gain >= GAIN and self.t >= AHEAD and self.p < UNLIKELY

    @property
    def sentence(self) -> str:
        """The drift in words."""
        share = f" ({100 * self.viscous / self.mean_viscous:+.0f} %)" if self.mean_viscous > 0.0 else ""
        return (
            f"friction drifts: from beginning to end viscous friction changes by {self.viscous:+.3g} +- "
            f"{self.viscous_std:.1g}{share} and Coulomb friction by {self.coulomb:+.3g} +- {self.coulomb_std:.1g}, "
            f"which explains {100 * self.gain:.0f} % of the squared torque errors that are left; it is part of the "
            "fit, and the estimates are those in the middle of the recording: warm the joint up, and record again"
        )

    def removed(self, data: JointData) -> JointData:
        """The recording ``data`` as it would be with the friction of its middle."""
        dq = data.motion[1]
        s = np.arange(len(dq)) / len(dq) - 0.5
        sliding = np.clip(dq / data.slow, -1.0, 1.0)  # the direction of sliding, uncertain in slow motion
        return replace(data, u=data.u - s * (self.viscous * dq + self.coulomb * sliding))

    def added(self, std: Mapping[str, float]) -> dict[str, float]:
        """Deviations ``std`` of the parameters of a law, name -> value, with those of the drift at either end."""
        own = {"viscous": self.viscous_std, "coulomb": self.coulomb_std}
        return {name: float(np.hypot(value, 0.5 * own.get(name[:7], 0.0))) for name, value in std.items()}

    def to_json(self) -> dict[str, float]:
        """Changes from beginning to end with their deviations, and what they explain, as plain data."""
        return asdict(self)


def friction_drift(data: JointData, gravity: int, delay: float) -> Drift | None:
    """Estimate the drift of the friction in ``data``; None if there are too few samples in sliding.

    ``gravity`` is the number of gravity coefficients; the motion lags the torque by ``delay`` sampling periods.
    """
    samples = sliding_samples(data, delay)
    fast = np.abs(samples.dq) > SLOWEST
    s = samples.t[fast] / (len(data.q) * data.period) - 0.5
    block = np.unique((samples.t[fast] / BLOCK).astype(int), return_inverse=True)[1]
    if fast.sum() < 100 or block[-1] + 1 < FEWEST_BLOCKS:
        return None
    dq, tau = samples.dq[fast], samples.tau[fast]
    sign = np.sign(dq)
    # the delay is one of a grid: what is left of it acts through the derivative of the torque
    ahead, behind = (sliding_samples(data, delay + side).tau[fast] for side in (0.5, -0.5))
    others = [*(column[fast] for column in samples.rigid_columns(gravity)), ahead - behind]
    change = np.column_stack([s * dq, s * sign])
    fits = []
    for speed in SPEEDS * data.speed:
        ratio = (dq / speed) ** 2
        stribeck = [sign * np.exp(-ratio), sign * ratio * np.exp(-ratio)]  # with its derivative by the Stribeck speed
        W = np.column_stack([dq, sign, *others, *stribeck])
        A = np.column_stack([W, change])
        fits.append((float(np.sum(solve(A, tau).residual(tau) ** 2)), W))
    W = min(fits, key=lambda fit: fit[0])[1]
    A = np.column_stack([W, change])
    before, after = (_held_out(columns, tau, block) for columns in (W, A))
    decrease = before - after
    spread = float(np.std(decrease, ddof=1)) / np.sqrt(len(decrease))
    x = solve(A, tau).x
    covariance = _jackknife(A, tau, block)[-2:, -2:]
    moved = x[-2:]
    std = np.sqrt(np.diag(covariance))
    return Drift(
        float(moved[0]),
        float(std[0]),
        float(moved[1]),
        float(std[1]),
        float(x[0]),
        float(x[1]),
        float(np.sum(decrease) / max(float(np.sum(before)), np.finfo(float).tiny)),
        float(np.mean(decrease)) / spread if spread > 0.0 else 0.0,
        _probability(float(moved @ np.linalg.pinv(covariance) @ moved), 2, len(decrease)),
    )


def _held_out(A: Array, y: Array, block: NDArray[np.int64]) -> Array:
    """Squared errors of every block, (B,), predicted by a fit to the other folds."""
    errors = np.zeros(int(block[-1]) + 1)
    for fold in range(FOLDS):
        out = block % FOLDS == fold
        if out.any() and not out.all():
            left = y[out] - A[out] @ solve(A[~out], y[~out]).x
            errors += np.bincount(block[out], left**2, minlength=len(errors))
    return errors


def _jackknife(A: Array, y: Array, block: NDArray[np.int64]) -> Array:
    """Covariance of the least-squares estimate from those that leave out one of the G blocks each.

    ``(G - 1)/G sum (x_g - mean)(x_g - mean)'``; the sum of squared scores of the residuals is too small where, as here,
    a few blocks determine a parameter, since the fit follows their errors.
    """
    count = int(block[-1]) + 1
    rows = np.column_stack([A, y])
    products = np.stack([rows[block == k].T @ rows[block == k] for k in range(count)])
    left = np.sum(products, axis=0) - products
    size = np.sqrt(np.einsum("gii->gi", left[:, :-1, :-1])).max(axis=0)
    H = left[:, :-1, :-1] / (size[:, None] * size)
    x = np.stack([np.linalg.pinv(each) @ (row / size) / size for each, row in zip(H, left[:, :-1, -1], strict=True)])
    x -= x.mean(axis=0)
    return np.asarray((count - 1) / count * x.T @ x)


def _probability(statistic: float, parameters: int, blocks: int) -> float:
    """Probability of Hotelling's statistic or more with ``parameters`` q and ``blocks`` G: F(q, G - q)."""
    from scipy.stats import f as fisher

    freedom = max(1, blocks - parameters)
    return float(fisher.sf(statistic * freedom / (parameters * max(1, blocks - 1)), parameters, freedom))
