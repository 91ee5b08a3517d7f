"""Least squares in constant memory: triangular QR factors, one per joint, merged as rows arrive (TSQR).

The rows ``[W_j | tau_j]`` of joint j enter only through their triangular factor ``R_j`` of p+1 columns. It suffices for
every quadratic estimator: weights per joint, fixed or removed parameters, residual norms. The memory does not depend
on the length of the recording, and ``W' W``, whose condition number is squared, is never formed.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rrrgen.base.arrays import Array
from rrrgen.base.errors import InputError

NO_COLUMN = 1e-12  # a column smaller than this share of the largest is round-off, for example of cos(pi/2)


@dataclass(frozen=True)
class Rows:
    """Rows of the estimation problem at N times: ``tau = W theta``.

    ``t`` (N,) s, ``W`` (N, n, p), ``tau`` (N, n) N m (N); ``use`` (N, n) is False for rows that are left out.
    ``segment`` (N,) is the number of the uninterrupted stretch of each sample, for statistics over time. ``valid``
    (N, n) is False only where the torque is invalid, and True for rows left out because of a low speed; None means that
    it equals ``use``.
    """

    t: Array
    W: Array
    tau: Array
    use: NDArray[np.bool_]
    segment: NDArray[np.int64]
    valid: NDArray[np.bool_] | None = None

    @property
    def sound(self) -> NDArray[np.bool_]:
        """Mask (N, n) of the rows with a valid torque, including those left out because of a low speed."""
        return self.use if self.valid is None else self.valid

    def use_only(self, mask: NDArray[np.bool_]) -> Rows:
        """A copy with only the times of ``mask`` (N,) in use; the others are kept, so that time remains uniform."""
        return replace(self, use=self.use & mask[:, None])


@dataclass(frozen=True)
class JointFactors:
    """Triangular QR factors ``R`` (n, p+1, p+1) of the rows ``[W_j | tau_j]`` of every joint j.

    ``counts`` (n,) are the numbers of rows.
    """

    R: Array
    counts: NDArray[np.int64]

    @property
    def parameters(self) -> int:
        """Number p of parameters."""
        return int(self.R.shape[2]) - 1

    @property
    def torque_squares(self) -> Array:
        """Sum of squared torques ``|tau_j|^2`` of every joint (n,)."""
        return np.asarray(np.sum(self.R[:, :, -1] ** 2, axis=1))

    def residual_squares(self, x: Array) -> Array:
        """Sum of squared residuals ``|tau_j - W_j x|^2`` of every joint (n,), for parameters ``x`` (p,)."""
        return np.asarray(np.sum((self.R[:, :, -1] - self.R[:, :, :-1] @ x) ** 2, axis=1))

    def stack(self, weights: Array | None = None) -> Array:
        """Triangular factor (p+1, p+1) of the rows of all joints together, those of joint j times ``weights[j]``."""
        w = np.ones(len(self.R)) if weights is None else np.asarray(weights, float)
        return triangular((self.R * w[:, None, None]).reshape(-1, self.R.shape[2]))

    def substitute(self, T: Array, known: Array | None = None) -> JointFactors:
        """Factors of the same rows for the parameters x (r,), where ``theta = T x + known``.

        ``T`` is (p, r); ``known`` (p,) is 0 by default.
        """
        p = self.parameters
        known = np.zeros(p) if known is None else np.asarray(known, float)
        change = np.zeros((p + 1, T.shape[1] + 1))
        change[:p, :-1], change[:p, -1], change[p, -1] = T, -known, 1.0
        return JointFactors(np.stack([triangular(R @ change) for R in self.R]), self.counts)

    def select_columns(self, kept: Sequence[int], fixed: Mapping[int, float] | None = None) -> JointFactors:
        """Factors of the same rows for the parameters of the columns ``kept``.

        ``fixed`` (column -> value) are known parameters; all others are zero.
        """
        T = np.eye(self.parameters)[:, list(kept)]
        known = np.zeros(self.parameters)
        for column, value in (fixed or {}).items():
            known[column] = value
        return self.substitute(T, known)

    def without_round_off(self) -> JointFactors:
        """A copy in which parameters whose columns are round-off, such as a power of cos(pi/2), have columns of zeros.

        Such a column is shorter than a share :data:`NO_COLUMN` of the longest; scaled to unit length it would look like
        one of the motion.
        """
        size = np.sqrt(np.sum(self.R[:, :, :-1] ** 2, axis=(0, 1)))
        R = self.R.copy()
        R[:, :, :-1] *= size > NO_COLUMN * np.max(size, initial=0.0)
        return replace(self, R=R)

    def merge(self, other: JointFactors) -> JointFactors:
        """Factors of the rows of this object and of ``other`` together."""
        if self.R.shape != other.R.shape:
            raise InputError("factors of different problems cannot be merged")
        pairs = zip(self.R, other.R, strict=True)
        return JointFactors(np.stack([triangular(np.vstack(pair)) for pair in pairs]), self.counts + other.counts)


def triangular(A: Array) -> Array:
    """Upper triangular QR factor R (p, p) of A (rows, p), with a non-negative diagonal; padded with rows of zeros."""
    p = A.shape[1]
    R: Array = np.asarray(np.linalg.qr(A, mode="r"))
    if len(R) < p:
        R = np.vstack([R, np.zeros((p - len(R), p))])
    signs = np.where(np.diag(R) < 0, -1.0, 1.0)
    return np.asarray(R * signs[:, None])


def factor_rows(rows: Rows, weights: Array | None = None) -> JointFactors:
    """Triangular factors of one block of rows; ``weights`` (N, n) multiply the rows, 1 by default.

    Raises :class:`InputError` if a row is not finite.
    """
    _, n, p = rows.W.shape
    R = np.zeros((n, p + 1, p + 1))
    for joint in range(n):
        use = rows.use[:, joint]
        if use.any():
            A = np.column_stack([rows.W[use, joint], rows.tau[use, joint]])
            R[joint] = triangular(A if weights is None else A * weights[use, joint, None])
    if not np.all(np.isfinite(R)):
        raise InputError("the rows of the regressor are not finite: check the recording for missing samples")
    return JointFactors(R, np.sum(rows.use, axis=0).astype(np.int64))


def factor_blocks(blocks: Sequence[Rows]) -> JointFactors:
    """Triangular factors of all rows of ``blocks``, which must not be empty."""
    factors = factor_rows(blocks[0])
    for rows in blocks[1:]:
        factors = factors.merge(factor_rows(rows))
    return factors
