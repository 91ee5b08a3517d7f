"""Fast fits of a sample by normal equations, to test many hypotheses such as a wrong sign or a wrong unit."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rrrgen.base.arrays import Array
from rrrgen.lab.data.preprocessing import Decimator, Processing
from rrrgen.lab.identify.observations import Recording, RowMaker, reconstruct, windows
from rrrgen.lab.identify.parameters import Column, DriveTerms
from rrrgen.lab.identify.regressor import RigidModel
from rrrgen.runtime.regressor_columns import drive_columns

# ------------------------------------------------------------------------------------------------------------------
# A sample of a few hundred instants of a recording, filtered as for the estimation, to which the rules are applied.
# ------------------------------------------------------------------------------------------------------------------

MOST_ROWS = 3000
"""Rows (instants times joints) of a sample: twenty to fifty per parameter, in a few hundredths of a second."""
MOST_READ = 200_000  # samples that are read of a long recording
WHOLE = 0.999  # gain of the filter below which a sample lies at a border or next to an invalid one


@dataclass(frozen=True)
class Sample:
    """Motion and torque (N, n) at N instants, passed through the same filter.

    ``use`` (N, n) is False where the equation of a joint is left out.
    """

    q: Array
    dq: Array
    ddq: Array
    tau: Array
    use: NDArray[np.bool_]

    @property
    def n(self) -> int:
        """Number of joints."""
        return int(self.q.shape[1])

    def moved(self, change: Array, zero: Array) -> Sample:
        """A copy with the positions ``zero + change (q - zero)`` and the speeds and accelerations that follow.

        ``change`` is (n, n), ``zero`` (n,) in rad (m).
        """
        q = zero + (self.q - zero) @ change.T
        return replace(self, q=q, dq=self.dq @ change.T, ddq=self.ddq @ change.T)

    def slowed(self, factor: float) -> Sample:
        """A copy with time stretched by ``factor``: speeds are divided by it, accelerations by its square."""
        return replace(self, dq=self.dq / factor, ddq=self.ddq / factor**2)


def sample_of(recording: Recording, processing: Processing) -> Sample | None:
    """Sample instants spread evenly over a recording; None if it has no torques or no usable instant."""
    decimate = Decimator(processing.decimate or 1)
    memory = RowMaker(lambda q, dq, ddq: q, processing, 1).memory(recording.period)
    found: list[tuple[Any, ...]] = []
    read = 0
    for window in windows(recording, memory):
        part = window.part.aligned()
        if part.tau is None:
            return None
        motion = reconstruct(part, processing)
        usable = decimate(part.valid.astype(float), part.first) > WHOLE
        parts = [decimate(x, part.first) for x in (motion.q, motion.dq, motion.ddq, part.tau)]
        use = usable & (np.abs(parts[1]) >= (np.asarray(processing.low_speed) if processing.low_speed else 0.0))
        found.append((*parts, use))
        read += window.stop - window.start
        if read >= MOST_READ:
            break
    if not found:
        return None
    q, dq, ddq, tau, use = (np.concatenate(columns) for columns in zip(*found, strict=True))
    there = np.flatnonzero(use.any(axis=1))
    if len(there) == 0:
        return None
    count = min(len(there), max(1, MOST_ROWS // q.shape[1]))
    kept = there[np.linspace(0, len(there) - 1, count).astype(int)]
    return Sample(q[kept], dq[kept], ddq[kept], tau[kept], use[kept].astype(bool))


# ------------------------------------------------------------------------------------------------------------------
# Fast fits of a sample by normal equations, to test many hypotheses such as a wrong sign or a wrong unit
# ------------------------------------------------------------------------------------------------------------------

NULL = 1e-9  # times the largest eigenvalue of W'W with columns of unit length: smaller ones count as zero
FLOOR = 1e-3  # relative error of a joint below which differences do not count
PASSES = 3  # iterations of the weights of the joints

Regressor = Callable[[Array, Array, Array], Array]


@dataclass(frozen=True)
class AllTerms:
    """Regressor ``W(q, dq, ddq)`` (N, n, p) of all terms that a joint may have, in the robot file or not.

    Its columns are those ``estimated`` from the recordings, then all other drive and friction terms of single joints.
    """

    model: RigidModel
    estimated: tuple[Column, ...]

    @property
    def drives(self) -> tuple[Column, ...]:
        """All columns of drive and friction terms, those estimated from the recordings first."""
        own = tuple(column for column in self.estimated if column.kind != "rigid")
        every = DriveTerms.everywhere(self.model.n, "inertia", "viscous", "coulomb", "offset").columns(self.model.n)
        names = {column.name for column in own}
        return own + tuple(column for column in every if column.name not in names)

    @property
    def names(self) -> tuple[str, ...]:
        """Name of the parameter of every column, (p,)."""
        return (*self.model.base_parameter_names, *(column.name for column in self.drives))

    def __call__(self, q: Array, dq: Array, ddq: Array) -> Array:
        """Evaluate the regressor W (N, n, p) at N instants; ``q``, ``dq``, ``ddq`` are (N, n)."""
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
    """Replace the columns of other friction laws by those of viscous and Coulomb friction.

    A law with coefficients for each direction is also replaced by an offset, which it contains. The difference between
    two laws does not matter here: a wrong sign or unit changes the torques far more.
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
    """Result of a fast fit: relative torque ``error`` of every joint (n,), parameters ``theta`` (p,), ``covariance``.

    The covariance (p, p) of the parameters assumes white residuals.
    """

    error: Array
    theta: Array
    covariance: Array

    @property
    def score(self) -> float:
        """Sum over joints of ``log(error^2 + FLOOR^2)``: smaller is better.

        Per instant it is minus twice the log-likelihood, up to a constant.
        """
        return float(np.sum(np.log(self.error**2 + FLOOR**2)))


class Trial:
    """Weighted least squares on one sample by its normal equations.

    They are computed once; fits with exchanged or scaled torques need no new evaluation of the regressor.
    """

    def __init__(self, regressor: Regressor, sample: Sample) -> None:
        self.sample = sample
        W = np.asarray(regressor(sample.q, sample.dq, sample.ddq))
        use = [sample.use[:, j] for j in range(sample.n)]
        self.counts = np.array([max(1, int(np.sum(u))) for u in use])
        self.G = np.stack([W[u, j].T @ W[u, j] for j, u in enumerate(use)])
        self.c = np.stack([W[u, j].T @ sample.tau[u] for j, u in enumerate(use)])
        self.T = np.stack([sample.tau[u].T @ sample.tau[u] for u in use])

    def fit(self, mix: Array | None = None, columns: Sequence[int] | None = None) -> Fit:
        """Fit the parameters of ``columns`` (all by default) to the torques ``tau @ mix``.

        ``mix`` (n, n), the identity by default, exchanges or scales the torques of the joints.
        """
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
    """Minimum-norm solution x (p,) of the normal equations ``G x = c``, and the pseudoinverse of G (p, p).

    Columns are scaled to unit length first.
    """
    size = np.sqrt(np.diag(G))
    safe = np.where(size > 0.0, size, 1.0)
    values, V = np.linalg.eigh(G / np.outer(safe, safe))
    V = V[:, values > NULL * values[-1]] / safe[:, None]
    values = values[values > NULL * values[-1]]
    return np.asarray(V @ ((V.T @ c) / values)), np.asarray((V / values) @ V.T)
