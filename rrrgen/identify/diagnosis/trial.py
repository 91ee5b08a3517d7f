"""Fast fits of a sample by normal equations, to test many hypotheses such as a wrong sign or a wrong unit."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from rrrgen.arrays import Array
from rrrgen.identify.diagnosis.sample import Sample
from rrrgen.identify.estimation.full_regressor import RigidModel
from rrrgen.model.drive_columns import drive_columns
from rrrgen.model.estimated_terms import Column, DriveTerms

NULL = 1e-9  # of the largest eigenvalue of W'W with columns of unit length: below are what the motion cannot tell
FLOOR = 1e-3  # relative error of a joint below which differences do not count
PASSES = 3  # of the weights

Regressor = Callable[[Array, Array, Array], Array]


@dataclass(frozen=True)
class AllTerms:
    """``W(q, dq, ddq)`` (N, n, p) with the columns ``estimated`` and the drive terms of single joints not in them."""

    model: RigidModel
    estimated: tuple[Column, ...]

    @property
    def drives(self) -> tuple[Column, ...]:
        """The drive columns, those of the estimate first."""
        own = tuple(column for column in self.estimated if column.kind != "rigid")
        every = DriveTerms.everywhere(self.model.n, "inertia", "viscous", "coulomb", "offset").columns(self.model.n)
        names = {column.name for column in own}
        return own + tuple(column for column in every if column.name not in names)

    @property
    def names(self) -> tuple[str, ...]:
        """The parameter of every column."""
        return (*self.model.base_parameter_names, *(column.name for column in self.drives))

    def __call__(self, q: Array, dq: Array, ddq: Array) -> Array:
        """Evaluate at N instants; ``q``, ``dq``, ``ddq`` are (N, n)."""
        rigid = np.asarray(self.model.regressor(q, dq, ddq))
        return np.concatenate([rigid, drive_columns(self.drives, dq, ddq)], axis=-1)

    def inertia(self, theta: Sequence[float] | Array) -> Array:
        """Contribution (n,) of the drives to the diagonal of M, kg m^2 (kg), for parameters ``theta`` (p,)."""
        values = np.asarray(theta)[len(self.model.base_parameter_names) :]
        found = np.zeros(self.model.n)
        for column, value in zip(self.drives, values, strict=True):
            if column.kind == "inertia":
                found += value * np.asarray(column.direction) ** 2
        return found


def linear_stand_ins(columns: Sequence[Column]) -> tuple[Column, ...]:
    """``columns`` with viscous and Coulomb friction in the place of other friction laws.

    A law with coefficients for either direction has an offset in them.

    A wrong sign or unit is many times larger than the difference between two laws.
    """
    found = {column.name: column for column in columns if column.kind != "law"}
    for column in columns:
        if column.kind == "law":
            end = re.search(r"(\d+|_\w+)$", column.name)
            offset = (("offset", "off"),) if column.name.startswith("coulomb_p") else ()
            for kind, symbol in (("viscous", "fv"), ("coulomb", "fc"), *offset):
                name = f"{symbol}{end.group() if end else ''}"
                found.setdefault(name, Column(name, kind, column.direction))
    return tuple(found.values())


@dataclass(frozen=True)
class Fit:
    """Relative error of every joint (n,), parameters ``theta`` (p,) and their covariance for white residuals (p, p)."""

    error: Array
    theta: Array
    covariance: Array

    @property
    def score(self) -> float:
        """Sum of log squared errors: twice the log-likelihood of a row of every joint, up to sign and a constant."""
        return float(np.sum(np.log(self.error**2 + FLOOR**2)))


class Trial:
    """Weighted least squares of one sample by its normal equations; torques may be recombined without new rows."""

    def __init__(self, regressor: Regressor, sample: Sample) -> None:
        self.sample = sample
        W = np.asarray(regressor(sample.q, sample.dq, sample.ddq))
        use = [sample.use[:, j] for j in range(sample.n)]
        self.counts = np.array([max(1, int(np.sum(u))) for u in use])
        self.G = np.stack([W[u, j].T @ W[u, j] for j, u in enumerate(use)])
        self.c = np.stack([W[u, j].T @ sample.tau[u] for j, u in enumerate(use)])
        self.T = np.stack([sample.tau[u].T @ sample.tau[u] for u in use])

    def fit(self, mix: Array | None = None, columns: Sequence[int] | None = None) -> Fit:
        """Fit the torques ``tau @ mix``, with ``mix`` (n, n) the identity by default, by ``columns`` (or all)."""
        n = self.sample.n
        A = np.eye(n) if mix is None else mix
        kept = list(range(self.G.shape[1])) if columns is None else list(columns)
        G = self.G[:, kept][:, :, kept]
        c = np.stack([self.c[j][kept] @ A[:, j] for j in range(n)])
        total = np.maximum([A[:, j] @ self.T[j] @ A[:, j] for j in range(n)], np.finfo(float).tiny)
        size = np.sqrt(total / self.counts)
        sigma = size
        for _ in range(PASSES):
            w2 = 1.0 / sigma**2
            x, inverse = _solved(np.tensordot(w2, G, 1), w2 @ c)
            left = np.array([total[j] - 2.0 * x @ c[j] + x @ G[j] @ x for j in range(n)])
            sigma = np.sqrt(np.maximum(left, 0.0) / self.counts)
            sigma = np.maximum(sigma, FLOOR * size)
        theta, covariance = np.zeros(self.G.shape[1]), np.zeros(self.G.shape[1:])
        theta[kept] = x
        covariance[np.ix_(kept, kept)] = inverse
        return Fit(np.sqrt(np.maximum(left, 0.0) / total), theta, covariance)


def _solved(G: Array, c: Array) -> tuple[Array, Array]:
    """Minimum-norm solution of ``G x = c`` in columns scaled to unit length, and the pseudoinverse of G."""
    size = np.sqrt(np.diag(G))
    safe = np.where(size > 0.0, size, 1.0)
    values, V = np.linalg.eigh(G / np.outer(safe, safe))
    V = V[:, values > NULL * values[-1]] / safe[:, None]
    values = values[values > NULL * values[-1]]
    return np.asarray(V @ ((V.T @ c) / values)), np.asarray((V / values) @ V.T)
