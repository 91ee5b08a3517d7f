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
from rrrgen.lab.identify.observations import KnownTorque, Recording, RowMaker, kept_of, reconstruct, windows
from rrrgen.lab.identify.parameters import Column, DriveTerms
from rrrgen.lab.identify.regressor import RigidModel
from rrrgen.runtime.regressor_columns import drive_columns

# ------------------------------------------------------------------------------------------------------------------
# A sample of a few hundred times of a recording, filtered as for the estimation, to which the rules are applied.
# ------------------------------------------------------------------------------------------------------------------

MOST_ROWS = 3000
"""Rows (samples times joints) of a sample: twenty to fifty per parameter, in a few hundredths of a second."""
MOST_READ = 200_000  # samples that are read of a long recording
SHORTEST_STRETCH = 4  # rows, which a cubic spline needs
BESIDE_REVERSAL = 0.1  # difference of the filtered sign of a speed from the sign of the filtered speed
WHOLE = 1e-3
"""Difference from 1 of the sum of the filter's taps over valid samples, from which on it misses samples that matter.

Beside a border the sum overshoots to 1.05. A torque filtered there and read later is not that of the filtered motion.
"""


@dataclass(frozen=True)
class Sample:
    """Motion and torque (N, n) at N times ``t`` (N,), s, passed through the same filter.

    ``use`` (N, n) is False where the equation of a joint is left out; ``stretch`` (N,) is the number of the
    uninterrupted stretch, whose torques the splines ``curves`` hold as functions of time, with more knots than there
    are samples (:meth:`Decimator.dense`).
    """

    q: Array
    dq: Array
    ddq: Array
    tau: Array
    use: NDArray[np.bool_]
    t: Array
    stretch: NDArray[np.int64]
    curves: tuple[Any, ...] = ()

    @property
    def n(self) -> int:
        """Number of joints."""
        return int(self.q.shape[1])

    def transform_motion(self, change: Array, zero: Array) -> Sample:
        """A copy with the positions ``zero + change (q - zero)`` and the speeds and accelerations that follow.

        ``change`` is (n, n), ``zero`` (n,) in rad (m).
        """
        q = zero + (self.q - zero) @ change.T
        return replace(self, q=q, dq=self.dq @ change.T, ddq=self.ddq @ change.T)

    def stretch_time(self, factor: float) -> Sample:
        """A copy with time stretched by ``factor``: speeds are divided by it, accelerations by its square."""
        curves = tuple(_transform_curve(curve, slower=factor) for curve in self.curves)
        return replace(self, dq=self.dq / factor, ddq=self.ddq / factor**2, t=self.t * factor, curves=curves)

    def mix_torques(self, mix: Array) -> Sample:
        """A copy with the torques ``tau @ mix``, (n, n)."""
        return replace(
            self, tau=self.tau @ mix, curves=tuple(_transform_curve(curve, mix=mix) for curve in self.curves)
        )

    def without(self, torque: Array) -> Sample:
        """A copy whose torques are less by ``torque`` (N, n)."""
        curves = []
        for k, curve in enumerate(self.curves):
            less = _spline(self.t[self.stretch == k], torque[self.stretch == k])
            curves.append(_spline(curve.x, curve(curve.x) - less(curve.x)))
        return replace(self, tau=self.tau - torque, curves=tuple(curves))

    def thin(self, count: int) -> Sample:
        """A copy with at most ``count`` samples, spread evenly over those in use."""
        there = np.flatnonzero(self.use.any(axis=1))
        kept = there[np.linspace(0, len(there) - 1, min(len(there), max(1, count))).astype(int)]
        named = {name: getattr(self, name)[kept] for name in ("q", "dq", "ddq", "tau", "use", "t", "stretch")}
        return replace(self, **named)

    def later(self, delays: Array, derivative: int = 0) -> Array:
        """Torques (N, n), or a ``derivative`` by time, recorded ``delays`` (n,), s, after the times.

        At the ends of a stretch the nearest ones.
        """
        torques = np.empty_like(self.tau)
        for k, curve in enumerate(self.curves):
            here = self.stretch == k
            for j, delay in enumerate(delays):
                torques[here, j] = curve(np.clip(self.t[here] + delay, curve.x[0], curve.x[-1]), derivative)[:, j]
        return torques


def _spline(t: Array, tau: Array) -> Any:
    """Cubic spline of the torques (N, n) over time."""
    from scipy.interpolate import CubicSpline

    return CubicSpline(t, tau)


def joined_samples(samples: Sequence[Sample]) -> Sample:
    """Several samples as one, each a second after the one before it."""
    names = ("q", "dq", "ddq", "tau", "use", "t", "stretch")
    signals: dict[str, list[Any]] = {name: [] for name in names}
    curves: list[Any] = []
    later, count = 0.0, 0
    for sample in samples:
        later = float(signals["t"][-1][-1] - sample.t[0]) + 1.0 if count else 0.0
        moved = replace(sample, t=sample.t + later, stretch=sample.stretch + count)
        count = int(moved.stretch[-1]) + 1
        for name in names:
            signals[name].append(getattr(moved, name))
        curves += [_transform_curve(curve, later=later) for curve in sample.curves]
    return Sample(**{name: np.concatenate(parts) for name, parts in signals.items()}, curves=tuple(curves))


def _transform_curve(curve: Any, slower: float = 1.0, mix: Array | None = None, later: float = 0.0) -> Any:
    """A cubic spline of torques in a time stretched by ``slower``, times the matrix ``mix``, and ``later`` (s)."""
    from scipy.interpolate import PPoly

    powers = slower ** -np.arange(3.0, -1.0, -1.0)
    c = curve.c * powers[:, None, None]
    return PPoly(c if mix is None else c @ mix, curve.x * slower + later)


def sample_of(recording: Recording, processing: Processing, torque: KnownTorque | None = None) -> Sample | None:
    """Sample of a recording, filtered as for the estimation; None if it has no torques or no usable sample.

    If ``torque`` is given, it stands in place of the recorded one.
    """
    decimate = Decimator(processing.decimate or 1)
    memory = RowMaker(lambda q, dq, ddq: q, processing, 1).memory(recording.period)
    segments: dict[int, list[tuple[Any, ...]]] = {}
    knots: dict[int, list[tuple[Array, Array]]] = {}
    read = 0
    for window in windows(recording, memory):
        part = window.part.align_torques()
        if part.tau is None:
            return None
        motion = reconstruct(part, processing)
        usable = np.abs(decimate(part.valid.astype(float), part.first) - 1.0) < WHOLE
        tau = part.tau if torque is None else torque(motion)
        parts = [decimate(x, part.first) for x in (motion.q, motion.dq, motion.ddq, tau)]
        use = usable & (np.abs(parts[1]) >= (np.asarray(processing.low_speed) if processing.low_speed else 0.0))
        # the regressor knows the filtered speed alone, whose sign beside a reversal is not the filtered sign
        use &= np.abs(decimate(np.sign(motion.dq), part.first) - np.sign(parts[1])) < BESIDE_REVERSAL
        # windows overlap by the memory of the filters, whose samples would count twice
        kept = kept_of(decimate, part.first, window.start, window.stop, len(part))
        row = (*parts, use, decimate.times(part.t, part.first))
        segments.setdefault(part.segment, []).append(tuple(x[kept] for x in row))
        at, dense = decimate.dense(tau, part.first)
        inside = (at >= window.start) & (at < window.stop)
        knots.setdefault(part.segment, []).append((part.t[at[inside]], dense[inside]))
        read += window.stop - window.start
        if read >= MOST_READ:
            break
    joined = {k: tuple(np.concatenate(x) for x in zip(*pieces, strict=True)) for k, pieces in segments.items()}
    joined = {k: rows for k, rows in joined.items() if len(rows[-1]) >= SHORTEST_STRETCH}
    stretches = list(joined.values())
    if not stretches or not any(rows[4].any() for rows in stretches):
        return None
    number = np.repeat(np.arange(len(stretches)), [len(rows[-1]) for rows in stretches])
    q, dq, ddq, tau, use, t = (np.concatenate(x) for x in zip(*stretches, strict=True))
    curves = tuple(_spline(*(np.concatenate(x) for x in zip(*knots[k], strict=True))) for k in joined)
    return Sample(q, dq, ddq, tau, use.astype(bool), t, number, curves)


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
        estimated_columns = tuple(column for column in self.estimated if column.kind != "rigid")
        every = DriveTerms.everywhere(self.model.n, "inertia", "viscous", "coulomb", "offset").columns(self.model.n)
        names = {column.name for column in estimated_columns}
        return estimated_columns + tuple(column for column in every if column.name not in names)

    @property
    def names(self) -> tuple[str, ...]:
        """Name of the parameter of every column, (p,)."""
        return (*self.model.base_parameter_names, *(column.name for column in self.drives))

    def __call__(self, q: Array, dq: Array, ddq: Array) -> Array:
        """Evaluate the regressor W (N, n, p) at N points in time; ``q``, ``dq``, ``ddq`` are (N, n)."""
        rigid = np.asarray(self.model.regressor(q, dq, ddq))
        return np.concatenate([rigid, drive_columns(self.drives, dq, ddq)], axis=-1)

    def inertia(self, theta: Sequence[float] | Array) -> Array:
        """Contribution (n,) of the drives to the diagonal of M, kg m^2 (kg), for parameters ``theta`` (p,)."""
        values = np.asarray(theta)[len(self.model.base_parameter_names) :]
        inertia = np.zeros(self.model.n)
        for column, value in zip(self.drives, values, strict=True):
            if column.kind == "inertia":
                inertia += value * np.asarray(column.direction) ** 2
        return inertia


def linear_stand_ins(columns: Sequence[Column]) -> tuple[Column, ...]:
    """Replace the columns of other friction laws by those of viscous and Coulomb friction.

    A law with coefficients for each direction is also replaced by an offset, which it contains.
    """
    stand_ins = {column.name: column for column in columns if column.kind != "law"}
    for column in columns:
        if column.kind == "law":
            end = re.search(r"(\d+|_\w+)$", column.name)
            offset = (("offset", "off"),) if column.name.startswith("coulomb_p") else ()
            for kind, symbol in (("viscous", "fv"), ("coulomb", "fc"), *offset):
                name = f"{symbol}{end.group() if end else ''}"
                stand_ins.setdefault(name, Column(name, kind, column.direction))
    return tuple(stand_ins.values())


def beyond_linear(friction: Sample, columns: Sequence[Column]) -> Array:
    """What linear friction cannot stand for in the torques (N, n) of friction laws.

    The torques of ``friction``, in the rows in use, less the nearest combination of the viscous, Coulomb and offset
    terms among ``columns``.
    """
    linear = [column for column in columns if column.kind in ("viscous", "coulomb", "offset")]
    W = drive_columns(linear, friction.dq, friction.ddq)
    x = np.linalg.lstsq(W[friction.use], friction.tau[friction.use], rcond=None)[0]
    return np.asarray(friction.tau - W @ x)


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

        Per sample it is minus twice the log-likelihood, up to a constant.
        """
        return float(np.sum(np.log(self.error**2 + FLOOR**2)))


class Trial:
    """Weighted least squares on one sample by its normal equations.

    They are computed once; fits with exchanged or scaled torques need no new evaluation of the regressor.
    """

    def __init__(self, regressor: Regressor, sample: Sample) -> None:
        self.sample = sample = sample.thin(MOST_ROWS // sample.n)
        W = np.asarray(regressor(sample.q, sample.dq, sample.ddq))
        self.columns = W.shape[-1]
        self.counts = np.maximum(1, np.sum(sample.use, axis=0))
        rows = [np.hstack([W[:, j], sample.tau])[sample.use[:, j]] for j in range(sample.n)]
        self.products = np.stack([A.T @ A for A in rows])  # of the columns and of the torques of all joints

    def fit(self, mix: Array | None = None, columns: Sequence[int] | None = None) -> Fit:
        """Fit the parameters of ``columns`` (all by default) to the torques ``tau @ mix``.

        ``mix`` (n, n), the identity by default, exchanges or scales the torques of the joints.
        """
        n, p = self.sample.n, self.columns
        kept = list(range(p)) if columns is None else list(columns)
        change = np.zeros((n, p + n, len(kept) + 1))
        change[:, kept, range(len(kept))] = 1.0
        change[:, p:, -1] = np.eye(n) if mix is None else mix.T
        G = change.transpose(0, 2, 1) @ self.products @ change
        squared = G[:, -1, -1]
        total = np.where(squared > 0.0, squared, np.inf)  # a joint without torques in the sample has no weight
        x, inverse, squares = fit_products(G, self.counts, np.sqrt(total / self.counts))
        theta, covariance = np.zeros(p), np.zeros((p, p))
        theta[kept] = x
        covariance[np.ix_(kept, kept)] = inverse
        return Fit(np.sqrt(squares / total), theta, covariance)


def fit_products(G: Array, counts: Array, size: Array) -> tuple[Array, Array, Array]:
    """Weighted least squares from the products ``G`` (n, m+1, m+1) of the rows [A_j, tau_j] of every joint.

    Each joint weighs by its residuals, in a few passes that begin with the torques' ``size`` (n,); ``counts`` (n,) are
    the numbers of rows. Returns the parameters (m,), their covariance (m, m), and the squared residuals (n,).
    """
    sigma = size
    for _ in range(PASSES):
        total = np.tensordot(1.0 / sigma**2, G, 1)
        x, inverse = solve_normal_equations(total[:-1, :-1], total[:-1, -1])
        c = np.append(-x, 1.0)
        squares = np.maximum(np.einsum("a,jab,b->j", c, G, c), 0.0)
        sigma = np.maximum(np.sqrt(squares / counts), FLOOR * size)
    return x, inverse, squares


def solve_normal_equations(G: Array, c: Array) -> tuple[Array, Array]:
    """Minimum-norm solution x (p,) of the normal equations ``G x = c``, and the pseudoinverse of G (p, p).

    Columns are scaled to unit length first.
    """
    size = np.sqrt(np.diag(G))
    safe = np.where(size > 0.0, size, 1.0)
    values, V = np.linalg.eigh(G / np.outer(safe, safe))
    V = V[:, values > NULL * values[-1]] / safe[:, None]
    values = values[values > NULL * values[-1]]
    return np.asarray(V @ ((V.T @ c) / values)), np.asarray((V / values) @ V.T)
