"""Checks by instrumental variables whether noise in the motion biases the least-squares estimate.

Noise in the positions makes the regressor W noisy, which biases least squares however long the recording is. If the
motion repeats, the regressor Z one period later has the same signal and independent noise, and the estimate
``x_iv = (Z' W)^-1 Z' tau`` has no such bias. With a known controller, Z is the regressor along the simulated loop,
which has no noise at all (Janot, Vandanjon and Gautier 2014). The difference of the two estimates,
``(Z' W)^-1 (Z - W)' r`` with the least-squares residuals r, is compared with its standard deviation.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rrrgen.arrays import Array
from rrrgen.errors import InputError
from rrrgen.identify.estimation.tsqr import Rows
from rrrgen.identify.identification import Identification

LIKE = 0.3
"""Largest difference of the regressor from that of another period, over its size, for the same motion."""
LAGS = 20  # rows over which scores are taken as correlated (Newey and West)
CLEAR = 4.0  # standard deviations; one of fifty parameters exceeds them by chance in three checks of a thousand
MOST_NAMED = 3
TELLING = 0.1  # difference of the torques, relative, above which estimates that agree only tell that the check is weak


@dataclass(frozen=True, eq=False)
class BiasCheck:
    """Instrumental minus least-squares estimate ``difference`` (r,), with standard deviations ``std`` (r,).

    ``torque`` is the RMS difference of the torques predicted by the two estimates, relative to the RMS torque.
    """

    names: tuple[str, ...]
    difference: Array
    std: Array
    torque: float

    @property
    def significant(self) -> tuple[int, ...]:
        """Numbers (from 0) of the parameters whose two estimates differ by more than CLEAR standard deviations.

        They are ordered by that ratio, the largest first.
        """
        ratio = np.abs(self.difference) / np.maximum(self.std, np.finfo(float).tiny)
        return tuple(int(i) for i in np.argsort(-ratio) if ratio[i] > CLEAR)

    def to_json(self) -> dict[str, Any]:
        """Plain data for JSON: differences of the estimates, standard deviations, effect on the torques."""
        return {
            "difference": dict(zip(self.names, self.difference.tolist(), strict=True)),
            "std": dict(zip(self.names, self.std.tolist(), strict=True)),
            "significant": [self.names[i] for i in self.significant],
            "torque": self.torque,
        }

    def lines(self) -> list[str]:
        """Lines of text for the report: whether the estimates differ significantly, and in which parameters."""
        share = f"the torques of the two estimates differ by {100 * self.torque:.2g} %"
        if not self.significant and self.torque > TELLING:
            return [f"instrumental variables: too uncertain here to tell bias from noise in the motion; {share}"]
        if not self.significant:
            return [f"instrumental variables: no sign of bias from noise in the motion; {share}"]
        named = [
            f"{self.names[i]} by {self.difference[i]:.3g} +- {self.std[i]:.2g}" for i in self.significant[:MOST_NAMED]
        ]
        return [
            f"instrumental variables: noise in the motion biases {len(self.significant)} of {len(self.names)} "
            f"parameters, {'; '.join(named)}; {share}. A lower cut-off, or the Kalman smoother, lessens it"
        ]


def check_bias(found: Identification, period: float) -> BiasCheck:
    """Compare the unconstrained estimate of ``found`` with instrumental variables one ``period`` (s) apart.

    Raises InputError if the recording is shorter than two periods, or if the motion does not repeat.
    """
    pairs = []
    for rows in _stretches(found.blocks):
        at, other = _pairs(rows, period)
        if len(at):
            use = rows.use[at] & rows.use[other]
            pairs.append(Paired(rows.W[at], rows.W[other], rows.tau[at], use))
    if not pairs:
        raise InputError(f"the recording has no two periods of {period:g} s: the check of bias needs the motion twice")
    compared, apart_by = compare(found, found.estimate.x, pairs)
    if apart_by > LIKE:
        raise InputError(f"the motion does not repeat after {period:g} s: the regressors differ by {apart_by:.0%}")
    return compared


@dataclass(frozen=True, eq=False)
class Paired:
    """Regression rows ``tau = W theta`` of a stretch with their instruments ``Z``.

    ``W`` and ``Z`` are (N, n, p), ``tau`` is (N, n); the mask ``use`` (N, n) marks the rows to fit."""

    W: Array
    Z: Array
    tau: Array
    use: NDArray[np.bool_]


def compare(found: Identification, x: Array, pairs: Sequence[Paired]) -> tuple[BiasCheck, float]:
    """Compare the instrumental-variable estimate from ``pairs`` with the least-squares estimate ``x`` (r,).

    Returns the check, and the relative difference of the instruments Z from the regressor W.
    """
    estimate = found.estimate
    assert found.parametrisation is not None
    transform, known = found.parametrisation.T, found.parametrisation.known
    w2 = estimate.weights**2
    r = transform.shape[1]
    A, scores, size, change = np.zeros((r, r)), [], 0.0, 0.0
    torque, apart = 0.0, np.zeros((r, r))
    for pair in pairs:
        W, Z = pair.W @ transform, pair.Z @ transform
        use = pair.use[..., None] * w2[:, None]
        residual = pair.tau - pair.W @ (transform @ x + known)
        A += np.einsum("kji,kjl->il", Z * use, W)
        apart += np.einsum("kji,kjl->il", W * use, W)
        scores.append(np.einsum("kji,kj->ki", (Z - W) * use, residual))
        scale = np.abs(x) + estimate.std
        size += float(np.sum(use * (W * scale) ** 2))
        change += float(np.sum(use * ((Z - W) * scale) ** 2))
        torque += float(np.sum(use[..., 0] * pair.tau**2))
    inverse = np.linalg.pinv(A)
    difference = inverse @ np.sum([np.sum(each, axis=0) for each in scores], axis=0)
    covariance = inverse @ np.sum([_long_run(each) for each in scores], axis=0) @ inverse.T
    effect = float(np.sqrt(max(0.0, difference @ apart @ difference) / max(torque, np.finfo(float).tiny)))
    check = BiasCheck(found.names, difference, np.sqrt(np.maximum(np.diag(covariance), 0.0)), effect)
    return check, float(np.sqrt(change / max(size, np.finfo(float).tiny)))


def _stretches(blocks: Iterable[Rows]) -> list[Rows]:
    """Concatenate blocks of rows so that each uninterrupted stretch of the recording is one block."""
    found: dict[int, list[Rows]] = {}
    for rows in blocks:
        if len(rows.segment):
            found.setdefault(int(rows.segment[0]), []).append(rows)
    return [_joined(each) for each in found.values()]


def _joined(parts: Sequence[Rows]) -> Rows:
    names = ("t", "W", "tau", "use", "segment")
    return Rows(**{name: np.concatenate([getattr(part, name) for part in parts]) for name in names})


def _pairs(rows: Rows, period: float) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Indices of instants, and for each the index of the instant one ``period`` (s) later, or earlier near the end."""
    count = len(rows.t)
    shift = round(period / float(np.median(np.diff(rows.t)))) if count > 1 else 0
    if shift < 1 or count <= shift:
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    at = np.arange(count)
    other = np.where(at + shift < count, at + shift, at - shift)
    return at[other >= 0], other[other >= 0]


def _long_run(scores: Array) -> Array:
    """Covariance (r, r) of the sum of correlated scores (N, r), by Bartlett weights (Newey and West 1987)."""
    total = scores.T @ scores
    for lag in range(1, min(LAGS, len(scores) - 1) + 1):
        product = scores[lag:].T @ scores[:-lag]
        total = total + (1.0 - lag / (LAGS + 1)) * (product + product.T)
    return np.asarray(total)
