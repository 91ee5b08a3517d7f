"""Convergence of the estimated parameters with the number of samples, as in Fig. 14.12."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rrrgen.base.arrays import Array
from rrrgen.lab.estimate.regression import RANK_TOLERANCE
from rrrgen.lab.estimate.tsqr import JointFactors, Rows, factor_rows


@dataclass(frozen=True)
class Convergence:
    """Estimates ``x`` (points, p) from the first ``samples`` (points,) instants, with their ``condition`` numbers.

    ``condition`` (points,) is that of the regressor. Estimates are NaN, and the condition number is infinite, as long
    as the samples do not determine all parameters.
    """

    names: tuple[str, ...]
    samples: NDArray[np.int64]
    x: Array
    condition: Array


def convergence(
    blocks: Iterable[Rows],
    names: Sequence[str],
    weights: Array,
    transform: Callable[[JointFactors], JointFactors] | None = None,
    every: int = 1,
) -> Convergence:
    """Estimate the parameters by weighted least squares (14.20) from the first k instants, k = every, 2 every, ...

    ``blocks`` are the rows in order of time, ``names`` those of the p parameters, ``weights`` (n,) those of the joints;
    ``transform`` maps the triangular factors of the rows to those of the identifiable parameters.
    """
    total: JointFactors | None = None
    samples, estimates, conditions, seen = [], [], [], 0
    for rows in blocks:
        for start in range(0, len(rows.t), every):
            piece = _piece(rows, start, start + every)
            used = int(np.sum(np.any(piece.use, axis=1)))
            if used == 0:
                continue  # all rows held out or at rest: no new information, so no new point of the curve
            part = factor_rows(piece)
            total = part if total is None else total.merged(part)
            seen += used
            x, condition = _solved((transform(total) if transform else total).stacked(weights))
            samples.append(seen)
            estimates.append(x)
            conditions.append(condition)
    return Convergence(tuple(names), np.array(samples), np.array(estimates), np.array(conditions))


def _piece(rows: Rows, start: int, stop: int) -> Rows:
    part = slice(start, stop)
    return Rows(rows.t[part], rows.W[part], rows.tau[part], rows.use[part], rows.segment[part])


def _solved(R: Array) -> tuple[Array, float]:
    """Solution (p,) of the triangular system R (p+1, p+1) and its condition number; NaN, inf if rank-deficient."""
    p = R.shape[1] - 1
    size = np.linalg.norm(R[:p, :p], axis=0)
    if np.any(size == 0.0):
        return np.full(p, np.nan), np.inf
    U, s, Vt = np.linalg.svd(R[:p, :p] / size)
    if s[-1] <= RANK_TOLERANCE * s[0]:
        return np.full(p, np.nan), np.inf
    return np.asarray(Vt.T @ ((U.T @ R[:p, p]) / s) / size), float(np.linalg.cond(R[:p, :p]))
