"""Checks by instrumental variables whether noise in the motion biases the least-squares estimate.

Noise in the positions makes the regressor W noisy, which biases least squares however long the recording is. If the
motion repeats, the regressor Z one period later has the same signal and independent noise, and the estimate
``x_iv = (Z' W)^-1 Z' tau`` has no such bias. With a known controller, Z is the regressor along the simulated loop,
which has no noise at all (Janot, Vandanjon and Gautier 2014). The difference of the two estimates,
``(Z' W)^-1 (Z - W)' r`` with the least-squares residuals r, is compared with its standard deviation.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rrrgen.base.arrays import Array
from rrrgen.base.errors import InputError
from rrrgen.lab.estimate.statistics import rms
from rrrgen.lab.estimate.tsqr import Rows
from rrrgen.lab.identify.identification import Identification
from rrrgen.lab.identify.observations import Recording

LIKE = 0.2
"""Largest RMS difference of the positions of a joint from those of another period, over their spread.

Positions tell whether the motion is the same; the accelerations in the regressor may be noise where there is bias."""
STILL = 0.01  # spread of a joint's positions, relative to that of the others, below which it stands
LAGS = 20  # rows over which scores are taken as correlated (Newey and West)
CLEAR = 4.0  # standard deviations; one of fifty parameters exceeds them by chance in three checks of a thousand
MOST_NAMED = 3
TELLING = 0.1  # difference of the torques, relative, above which estimates that agree only tell that the check is weak


@dataclass(frozen=True, eq=False)
class BiasCheck:
    """Instrumental minus least-squares estimate ``difference`` (r,), with standard deviations ``std`` (r,).

    ``scatter`` (r,) are the standard deviations of the least-squares estimate itself; a smaller bias does not matter.
    ``torque`` is the RMS difference of the torques predicted by the two estimates, relative to the RMS torque.
    """

    names: tuple[str, ...]
    difference: Array
    std: Array
    scatter: Array
    torque: float

    @property
    def significant(self) -> tuple[int, ...]:
        """Numbers (from 0) of the parameters whose two estimates differ by more than CLEAR standard deviations.

        They differ by more than the standard deviation of the estimate, too, and are ordered by the first ratio, the
        largest first.
        """
        ratio = np.abs(self.difference) / np.maximum(self.std, np.finfo(float).tiny)
        matters = np.abs(self.difference) > self.scatter
        return tuple(int(i) for i in np.argsort(-ratio) if ratio[i] > CLEAR and matters[i])

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


def check_bias(identification: Identification, recordings: Sequence[Recording], period: float) -> BiasCheck:
    """Compare the unconstrained estimate of ``identification`` with instrumental variables one ``period`` (s) apart.

    ``recordings`` are those of the estimate. Raises InputError if they are shorter than two periods, or if the motion
    does not repeat.
    """
    pairs = []
    for rows in _stretches(identification.blocks):
        at, other = _pairs(rows, period)
        if len(at):
            use = rows.use[at] & rows.use[other]
            pairs.append(Paired(rows.W[at], rows.W[other], rows.tau[at], use))
    if not pairs:
        raise InputError(f"the recording has no two periods of {period:g} s: the check of bias needs the motion twice")
    difference = max((_later(q, round(period / step)) for q, step in _positions(recordings)), default=0.0)
    if difference > LIKE:
        raise InputError(
            f"the motion does not repeat after {period:g} s: the positions differ by {difference:.0%} of their spread"
        )
    return compare(identification, identification.estimate.x, pairs)


def position_difference(q: Array, other: Array) -> float:
    """Largest RMS difference of the positions ``q`` and ``other`` (N, n) of a joint, over their spread."""
    spread = np.std(q, axis=0)
    least = max(STILL * float(np.max(spread)), np.finfo(float).tiny)
    return float(np.max(rms(q - other, axis=0) / np.maximum(spread, least)))


def _later(q: Array, shift: int) -> float:
    """Difference of the positions ``q`` (N, n) from those ``shift`` samples later; 0 for a shorter stretch."""
    return position_difference(q[:-shift], q[shift:]) if 0 < shift < len(q) else 0.0


def _positions(recordings: Sequence[Recording]) -> Iterator[tuple[Array, float]]:
    """Positions (N, n) of every uninterrupted stretch, with the sampling period (s)."""
    for recording in recordings:
        stretches: dict[int, list[Array]] = {}
        for part in recording.parts():
            stretches.setdefault(part.segment, []).append(part.q)
        for pieces in stretches.values():
            yield np.concatenate(pieces), recording.period


@dataclass(frozen=True, eq=False)
class Paired:
    """Regression rows ``tau = W theta`` of a stretch with their instruments ``Z``.

    ``W`` and ``Z`` are (N, n, p), ``tau`` is (N, n); the mask ``use`` (N, n) marks the rows to fit."""

    W: Array
    Z: Array
    tau: Array
    use: NDArray[np.bool_]


def compare(identification: Identification, x: Array, pairs: Sequence[Paired]) -> BiasCheck:
    """Compare the instrumental-variable estimate from ``pairs`` with the least-squares estimate ``x`` (r,)."""
    estimate = identification.estimate
    assert identification.parametrisation is not None
    transform, known = identification.parametrisation.T, identification.parametrisation.known
    w2 = estimate.weights**2
    r = transform.shape[1]
    A, scores = np.zeros((r, r)), []
    torque, apart = 0.0, np.zeros((r, r))
    for pair in pairs:
        W, Z = pair.W @ transform, pair.Z @ transform
        use = pair.use[..., None] * w2[:, None]
        residual = pair.tau - pair.W @ (transform @ x + known)
        A += np.einsum("kji,kjl->il", Z * use, W)
        apart += np.einsum("kji,kjl->il", W * use, W)
        scores.append(np.einsum("kji,kj->ki", (Z - W) * use, residual))
        torque += float(np.sum(use[..., 0] * pair.tau**2))
    inverse = np.linalg.pinv(A)
    difference = inverse @ np.sum([np.sum(score, axis=0) for score in scores], axis=0)
    covariance = inverse @ np.sum([_long_run(score) for score in scores], axis=0) @ inverse.T
    effect = float(np.sqrt(max(0.0, difference @ apart @ difference) / max(torque, np.finfo(float).tiny)))
    std = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    return BiasCheck(identification.names, difference, std, estimate.std, effect)


def _stretches(blocks: Iterable[Rows]) -> list[Rows]:
    """Concatenate blocks of rows so that each uninterrupted stretch of the recording is one block."""
    stretches: dict[int, list[Rows]] = {}
    for rows in blocks:
        if len(rows.segment):
            stretches.setdefault(int(rows.segment[0]), []).append(rows)
    return [_join_rows(stretch) for stretch in stretches.values()]


def _join_rows(parts: Sequence[Rows]) -> Rows:
    names = ("t", "W", "tau", "use", "segment")
    return Rows(**{name: np.concatenate([getattr(part, name) for part in parts]) for name in names})


def _pairs(rows: Rows, period: float) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Indices of samples, and for each the index of the sample one ``period`` (s) later, or earlier near the end."""
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
