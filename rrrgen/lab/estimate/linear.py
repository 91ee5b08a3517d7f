"""Linear least squares with scaled columns and a stated rank, and variable projection for separable problems."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from rrrgen.base.arrays import Array

RANK = 1e-10
"""Singular values of scaled columns below this share of the largest are zero; round-off is 1e-14 of it."""


def scale_columns(A: Array) -> tuple[Array, Array]:
    """The columns of A (m, p) divided by their lengths, and the lengths (p,); a column of zeros has length 1.

    Equal lengths make singular values and ranks independent of the units of the parameters. They minimize the condition
    number of A, up to a factor sqrt(p), among all scalings of its columns (van der Sluis 1969).
    """
    size = np.linalg.norm(A, axis=0)
    size = np.where(size > np.finfo(float).tiny, size, 1.0)
    return np.asarray(A / size), np.asarray(size)


@dataclass(frozen=True, eq=False)
class Linear:
    """Least-squares solution ``x`` (p,) of ``A x = y`` with the singular value decomposition it comes from.

    ``U`` (m, rank) is an orthonormal basis of the columns of A; ``inverse`` (p, rank) maps coordinates in it to x, so
    that the pseudo-inverse of A is ``inverse U'``. ``singular`` are the singular values of the scaled columns, largest
    first. The rows of ``weak`` (p - rank, p) are combinations of scaled columns that vanish: A does not tell these
    directions, and x has no component in them.
    """

    x: Array
    U: Array
    inverse: Array
    singular: Array
    weak: Array

    @property
    def rank(self) -> int:
        """Number of singular values above the tolerance."""
        return int(self.U.shape[1])

    @property
    def covariance(self) -> Array:
        """Covariance (p, p) of x for errors of y that are independent with variance 1: the inverse of ``A' A``."""
        return np.asarray(self.inverse @ self.inverse.T)

    @property
    def condition(self) -> float:
        """Condition number of the scaled columns; infinite if they depend on each other."""
        full = self.rank == len(self.singular) > 0
        return float(self.singular[0] / self.singular[-1]) if full else np.inf

    def residual(self, Z: Array) -> Array:
        """The part of ``Z`` (m,) or (m, k) that is orthogonal to the columns of A; of y, what the fit leaves."""
        return np.asarray(Z - self.U @ (self.U.T @ Z))


def solve(A: Array, y: Array, rank: float = RANK) -> Linear:
    """Least squares ``min |y - A x|`` for A (m, p) and y (m,), by the singular value decomposition of scaled columns.

    Singular values below ``rank`` times the largest count as zero; of all solutions the one that is shortest in scaled
    columns is returned.
    """
    B, size = scale_columns(A)
    U, s, Vt = np.linalg.svd(B, full_matrices=False)
    count = int(np.sum(s > rank * np.max(s, initial=0.0)))
    U = U[:, :count]
    inverse = Vt[:count].T / s[:count] / size[:, None]
    weak = Vt[count:]
    if len(A) < A.shape[1]:  # fewer rows than columns: the thin decomposition lacks the rest of the null space
        weak = np.linalg.svd(B)[2][count:]
    return Linear(inverse @ (U.T @ y), U, inverse, s, weak)


def project(
    A: Array, y: Array, derivative: Callable[[Array], Array], rank: float = RANK
) -> tuple[Array, Array, Linear]:
    """Residual (m,) of ``y = A(z) c`` with the linear parameters c projected out, its derivative (m, k) by z, the fit.

    With P the projection onto the orthogonal complement of the columns of A (m, p), the residual ``r = P y`` depends on
    z (k,) alone: variable projection (Golub and Pereyra 1973). ``derivative(c)`` returns the columns ``dA/dz_i c`` for
    the fitted c (p,); the derivative of r is then ``-P dA/dz_i c``. This is Kaufman's approximation (1975). What it
    leaves out of the full derivative lies in the span of A and hence is orthogonal to r: the gradient of ``|r|^2`` is
    exact, and the missing second-order part vanishes with r.
    """
    fit = solve(A, y, rank)
    return fit.residual(y), -fit.residual(derivative(fit.x)), fit
