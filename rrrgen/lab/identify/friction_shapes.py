"""Estimates the shape parameters of friction laws by separable least squares (variable projection).

Shapes are the parameters in which a law is not linear, such as the Stribeck speed. For given shapes the torques y are
linear in all other parameters c, ``y = Phi c``, which are projected out: the residual ``r = P y`` depends on the shapes
alone (Golub and Pereyra 1973), with ``dr = -P dPhi c`` in Kaufman's approximation. A common value of each shape for all
joints is fitted first; then each joint may deviate from it. A deviation by a factor of two counts as one standard
deviation, so that a joint whose data say little keeps the common shape.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from rrrgen.base.arrays import Array
from rrrgen.base.errors import InputError
from rrrgen.lab.data.preprocessing import Decimator
from rrrgen.lab.data.uniform_stream import Part, join_parts
from rrrgen.lab.estimate.linear import project, solve
from rrrgen.lab.estimate.search import search
from rrrgen.lab.identify.friction_columns import FrictionSurface, Sliding, along
from rrrgen.lab.identify.held_out_data import Split
from rrrgen.lab.identify.observations import Recording, Regressor, RowMaker, Window, kept_of, reconstruct, within

# ------------------------------------------------------------------------------------------------------------------
# Rows of a separable least-squares problem: "fixed" columns, and friction columns that depend on shape parameters.
#
# Friction is evaluated at every recorded sample, before the decimation filter: filtering the speed first would smooth
# the changes of sign that determine the shapes.
# ------------------------------------------------------------------------------------------------------------------

MOST_SAMPLES = 200_000
"""Samples from the beginning of the recordings on which shapes are tuned and laws compared."""
LOAD_BLOCK = 4000
"""Samples at which the load is computed at a time."""


@dataclass(frozen=True, eq=False)
class Stretch:
    """One uninterrupted stretch of a recording: N recorded samples, and r rows after decimation.

    ``q``, ``dq``, ``ddq``, ``load`` (N, n) are motion and load torques at the samples, ``valid`` (N, n) marks valid
    torques, ``first`` is the index of the first sample, ``inner`` are the samples of which rows are made. ``W``
    (r, n, p) are the columns that do not depend on friction shapes, ``tau`` (r, n) the torques, ``use`` (r, n) marks
    rows with a valid torque, ``t`` (r,) are their times, s.
    ``start`` and ``duration`` (s) are those of the whole recording.
    """

    q: Array
    dq: Array
    ddq: Array
    valid: NDArray[np.bool_]
    first: int
    inner: slice
    t: Array
    W: Array
    tau: Array
    use: NDArray[np.bool_]
    start: float
    duration: float
    load: Array | None = None

    def columns(self, surface: FrictionSurface, decimate: Decimator) -> Array:
        """Columns (r, n, k) of the linear friction parameters of a joint or motor ``surface``, after decimation."""
        sliding = Sliding.of((surface,))
        s = None if sliding is None else sliding.states(self.q, self.dq, sliding.start())[:, 0]
        factors = surface.factors(self.dq, s, self.load)
        columns = np.zeros((len(self.t), self.dq.shape[1], factors.shape[1]))
        kept = kept_of(decimate, self.first, self.inner.start, self.inner.stop, len(self.q))
        alike = np.array_equal(self.valid, np.broadcast_to(self.valid[:, :1], self.valid.shape))
        every = decimate(factors * self.valid[:, :1], self.first)[kept] if alike else None
        for i in surface.joints:
            filtered = every if every is not None else decimate(factors * self.valid[:, [i]], self.first)[kept]
            columns[:, i] = surface.direction[i] * filtered
        return columns


@dataclass(frozen=True, eq=False)
class Problem:
    """The rows of all stretches of the recordings, with their decimation filter."""

    stretches: tuple[Stretch, ...]
    decimate: Decimator

    @classmethod
    def of(cls, recordings: Sequence[Recording], maker: RowMaker, most: int = MOST_SAMPLES) -> Problem:
        """Build the problem from the first ``most`` samples of ``recordings``.

        ``maker`` evaluates the columns that do not depend on friction shapes.
        """
        stretches: list[Stretch] = []
        decimate = Decimator(maker.processing.decimate or 1)
        left = most
        for recording in recordings:
            start, duration = recording.span
            for part in _stretches(recording, left):
                window = Window(part, 0, len(part))
                inner, rows = maker.inner(window), list(maker.rows(window))
                left -= len(part)
                if not rows:
                    continue
                motion = reconstruct(part, maker.processing)
                stretches.append(
                    Stretch(
                        motion.q,
                        motion.dq,
                        motion.ddq,
                        part.valid & within(inner, len(part)),
                        part.first,
                        inner,
                        np.concatenate([r.t for r in rows]),
                        np.concatenate([r.W for r in rows]),
                        np.concatenate([r.tau for r in rows]),
                        np.concatenate([r.use for r in rows]),
                        start,
                        duration,
                    )
                )
        if not stretches:
            raise InputError("the recordings hold no samples to which friction laws could be fitted")
        return cls(tuple(stretches), decimate)

    def under_load(self, regressor: Regressor, theta: Array) -> Problem:
        """Copy of the problem whose friction depends on the load torques ``regressor(q, dq, ddq) theta``."""
        stretches = []
        for stretch in self.stretches:
            parts = range(0, len(stretch.q), LOAD_BLOCK)
            motions = [[x[k : k + LOAD_BLOCK] for x in (stretch.q, stretch.dq, stretch.ddq)] for k in parts]
            stretches.append(replace(stretch, load=np.concatenate([regressor(*motion) @ theta for motion in motions])))
        return replace(self, stretches=tuple(stretches))

    @property
    def load(self) -> Array:
        """The load (N, n) at all samples, zero if it is not known."""
        return np.concatenate([np.zeros_like(s.q) if s.load is None else s.load for s in self.stretches])

    @property
    def W(self) -> Array:
        """Regressor columns (r, n, p) that do not depend on friction shapes, over all stretches."""
        return np.concatenate([stretch.W for stretch in self.stretches])

    @property
    def tau(self) -> Array:
        """Measured torques (r, n), filtered, over all stretches."""
        return np.concatenate([stretch.tau for stretch in self.stretches])

    def fitted_rows(self, split: Split) -> NDArray[np.bool_]:
        """Mask (r, n) of the rows that are fitted."""
        return self._use([split.is_fitted(s.t, s.start, s.duration) for s in self.stretches])

    def scored_rows(self, split: Split) -> NDArray[np.bool_]:
        """Mask (r, n) of the rows that are held out."""
        return self._use([split.is_scored(s.t, s.start, s.duration) for s in self.stretches])

    def _use(self, masks: Sequence[NDArray[np.bool_]]) -> NDArray[np.bool_]:
        return np.concatenate([s.use & mask[:, None] for s, mask in zip(self.stretches, masks, strict=True)])

    def speed(self, surface: FrictionSurface) -> float:
        """RMS sliding speed of a joint or motor ``surface``, rad/s (m/s)."""
        squares = [np.sum(along(surface.direction, s.dq) ** 2) for s in self.stretches]
        return float(np.sqrt(np.sum(squares) / sum(len(s.dq) for s in self.stretches)))

    def columns(self, surface: FrictionSurface) -> Array:
        """Columns (r, n, k) of the linear friction parameters of a joint or motor ``surface``, for its shapes."""
        return np.concatenate([s.columns(surface, self.decimate) for s in self.stretches])


def _stretches(recording: Recording, most: int) -> list[Part]:
    """The whole stretches of a recording, cut after ``most`` samples in all."""
    stretches: list[list[Part]] = []
    left = most
    for part in recording.parts():
        if left <= 0:
            break
        taken = part.slice_samples(0, min(len(part), left))
        left -= len(taken)
        if stretches and stretches[-1][-1].segment == taken.segment:
            stretches[-1].append(taken)
        else:
            stretches.append([taken])
    return [join_parts(parts) for parts in stretches if sum(map(len, parts)) > 1]


# ------------------------------------------------------------------------------------------------------------------
# Estimates the shape parameters of friction laws by separable least squares (variable projection)
# ------------------------------------------------------------------------------------------------------------------

SCALES = {
    "presliding": (3e-5, 1),
    "decay_speed": (0.05, 1),
    "stribeck_speed": (0.05, 1),
    "stiction_ratio": (1.3, 0),
    "direction_ratio": (1.0, 0),
    "steepness": (30.0, -1),
    "w1": (0.3, -1),
    "w2": (3.0, -1),
    "w3": (30.0, -1),
}
"""Usual values of shapes at an RMS speed of 1 rad/s (m/s), and the power of that speed in proportion to which a shape
grows: speeds and distances grow with it, what multiplies a speed falls."""
STARTS = (1 / 3, 3.0)
"""Multiples of the usual values at which the search of common speeds and distances starts."""
RANGE = 300.0  # largest factor by which a shape may differ from its usual value
PRIOR = math.log(2.0)  # standard deviation of the logarithm of a shape about the common one
COMMON_PRIOR = math.log(3.0)  # standard deviation of the logarithm of the common shape about its usual value
STEP = 1e-3  # step of the logarithm in finite differences
ITERATIONS = 12
SETTLED = 1e-3  # change of the logarithms at which the search ends
RANK = 1e-9  # singular values of the scaled columns below this share of the largest are zero
WEIGHTS = 6  # most passes in which the weights of the joints are renewed
UNCHANGED = 0.01  # change of the logarithms of the shapes in such a pass at which the last one is reached


@dataclass(frozen=True, eq=False)
class Fitted:
    """Joints and motors (``surfaces``) with fitted friction shapes.

    ``residual`` (r, n) are the torque errors of all rows, ``theta`` (p,) the linear parameters of all columns. ``std``
    holds for every surface the standard deviations of the logarithms of its shapes, prior included.
    """

    surfaces: tuple[FrictionSurface, ...]
    residual: Array
    theta: Array
    std: tuple[tuple[float, ...], ...]


class _ShapeSearch:
    """Search for the shape parameters of ``surfaces`` on the rows with ``use`` (r, n) True of a problem.

    ``logs``, in its methods, are the logarithms of all shapes, surface by surface.
    """

    def __init__(self, problem: Problem, surfaces: Sequence[FrictionSurface], use: NDArray[np.bool_]) -> None:
        self.problem, self.use = problem, use
        self.surfaces = tuple(surfaces)
        self.fixed, self.tau = problem.W, problem.tau
        self.owner = [k for k, surface in enumerate(self.surfaces) for _ in surface.definition.shapes]
        self.scale = np.log(_scales(problem, self.surfaces)) if self.owner else np.zeros(0)
        self.known: dict[tuple[int, bytes], Array] = {}
        self.weights = np.ones(self.tau.shape[1])
        self.renew(None)

    def renew(self, logs: Array | None) -> None:
        """Recompute the weights of the joints from their residuals, and a basis of the columns without shapes.

        The residuals are those at the shapes ``logs``, or without friction columns if None.
        """
        residual = self.residual(logs)[0] if logs is not None else self.tau
        count = np.maximum(1, np.sum(self.use, axis=0))
        sigma = np.sqrt(np.sum(np.where(self.use, residual, 0.0) ** 2, axis=0) / count)
        self.weights = 1.0 / np.maximum(sigma, 1e-9 * max(float(np.max(sigma)), np.finfo(float).tiny))
        self.basis = solve(self.stack(self.fixed), np.zeros(np.count_nonzero(self.use)), RANK).U
        self.y = self.orthogonal_part(self.stack(self.tau[..., None])[:, 0])

    def stack(self, columns: Array) -> Array:
        """Stack ``columns`` (r, n, k) of all joints to a matrix (rows, k): rows in use only, times their weights."""
        return np.concatenate([w * columns[self.use[:, j], j] for j, w in enumerate(self.weights)])

    def orthogonal_part(self, columns: Array) -> Array:
        """Part of ``columns`` (rows, k) that is orthogonal to the columns that do not depend on shapes."""
        return np.asarray(columns - self.basis @ (self.basis.T @ columns))

    def surfaces_at(self, logs: Array) -> tuple[FrictionSurface, ...]:
        """The surfaces with the shapes ``exp(logs)``."""
        shapes: list[list[float]] = [[] for _ in self.surfaces]
        for k, value in zip(self.owner, np.exp(logs), strict=True):
            shapes[k].append(float(value))
        return tuple(
            replace(surface, shapes=tuple(surface_shapes))
            for surface, surface_shapes in zip(self.surfaces, shapes, strict=True)
        )

    def columns(self, k: int, surface: FrictionSurface) -> Array:
        key = (k, np.array(surface.shapes).tobytes())
        if key not in self.known:
            if len(self.known) > 8 * len(self.surfaces):
                self.known.clear()
            self.known[key] = self.problem.columns(surface)
        return self.known[key]

    def cost(self, logs: Array) -> float:
        """Sum of squares that the columns leave of the torques at the shapes ``logs``."""
        parts = [self.stack(self.columns(k, surface)) for k, surface in enumerate(self.surfaces_at(logs))]
        left = solve(self.orthogonal_part(np.hstack(parts)), self.y, RANK).residual(self.y)
        return float(left @ left)

    def linearise(self, logs: Array) -> tuple[Array, Array]:
        """Residual that the columns leave of the torques, and its derivative by the logarithms of all shapes."""
        parts = [self.stack(self.columns(k, surface)) for k, surface in enumerate(self.surfaces_at(logs))]
        places = np.cumsum([0, *(part.shape[1] for part in parts)])

        def derivative(c: Array) -> Array:
            changes = np.empty((len(self.y), len(logs)))
            for i, k in enumerate(self.owner):
                moved = logs.copy()
                moved[i] += STEP
                after = self.stack(self.problem.columns(self.surfaces_at(moved)[k]))
                changes[:, i] = (after - parts[k]) @ c[places[k] : places[k + 1]] / STEP
            return self.orthogonal_part(changes)

        r, J, _ = project(self.orthogonal_part(np.hstack(parts)), self.y, derivative, RANK)
        return r, J

    def descend(self, start: Array, to_logs: Array, pull: Array, usual: Array) -> tuple[Array, Array]:
        """Minimise the cost over x; ``usual + to_logs x``, within the range, are the logarithms of all shapes.

        The search begins at the logarithms ``start``; x = 0 stands for ``usual``.
        ``pull`` are the inverse variances of a prior of x about 0. Returns the logarithms, and the covariance of x in
        units of the noise variance.
        """
        weights = np.sqrt(pull)

        def logs(x: Array) -> Array:
            return np.clip(usual + to_logs @ x, self.scale - math.log(RANGE), self.scale + math.log(RANGE))

        def linearise(x: Array) -> tuple[Array, Array]:
            r, J = self.linearise(logs(x))
            return r, J @ to_logs

        minimum = search(
            solve(to_logs, start - usual).x,
            linearise,
            cost=lambda x: self.cost(logs(x)),
            prior=lambda x: (weights * x, np.diag(weights)),
            largest=1.0,
            steps=ITERATIONS,
            tries=6,
            small_step=SETTLED,
            damping=1e-2,
            less=5.0,
            more=5.0,
        )
        return logs(minimum.state), solve(minimum.J, minimum.r).covariance

    def residual(self, logs: Array) -> tuple[Array, Array]:
        """Residuals (r, n) of all rows, and the linear parameters of all columns, fitted to the rows in use."""
        surfaces = self.surfaces_at(logs)
        W = np.concatenate([self.fixed, *(self.columns(k, surface) for k, surface in enumerate(surfaces))], axis=-1)
        A = self.stack(W)
        theta = solve(A, self.stack(self.tau[..., None])[:, 0], RANK).x
        return self.tau - W @ theta, theta


def tune_shapes(problem: Problem, surfaces: Sequence[FrictionSurface], use: NDArray[np.bool_]) -> Fitted:
    """Fit the shapes of ``surfaces`` to the rows with ``use`` (r, n) True.

    Shapes that the surfaces already have are tried as initial values beside the usual ones.
    """
    search = _ShapeSearch(problem, surfaces, use)
    logs: Array = np.zeros(0)
    std: tuple[tuple[float, ...], ...] = tuple(() for _ in surfaces)
    if search.owner:
        usual, logs = _common(search)
        for _ in range(WEIGHTS):
            before = logs
            logs, std = _tune_joints(search, usual, before)
            search.renew(logs)
            if np.max(np.abs(logs - before)) < UNCHANGED:
                break
    else:
        search.renew(logs)
    residual, theta = search.residual(logs)
    return Fitted(search.surfaces_at(logs), residual, theta, std)


def _common(search: _ShapeSearch) -> tuple[Array, Array]:
    """Logarithms of all shapes, common to all joints and fitted from several initial values, and the best known ones.

    The best known are those with which every joint on its own begins, see :func:`_apart`.
    """
    names = [name for surface in search.surfaces for name in surface.definition.shapes]
    laws = [search.surfaces[k].law for k in search.owner]
    groups = list(dict.fromkeys(zip(laws, names, strict=True)))
    common = np.zeros((len(names), len(groups)))
    for i, key in enumerate(zip(laws, names, strict=True)):
        common[i, groups.index(key)] = 1.0
    start = min(_starts(search, groups, common), key=search.cost)
    pull = np.full(len(groups), _variance(search, start) / COMMON_PRIOR**2)
    usual, _ = search.descend(start, common, pull, search.scale)
    return usual, min(_apart(search, usual), start, key=search.cost)


def _tune_joints(search: _ShapeSearch, usual: Array, start: Array) -> tuple[Array, tuple[tuple[float, ...], ...]]:
    """Logarithms of the shapes fitted joint by joint, and their standard deviations for every surface.

    The search begins at the logarithms ``start``; the prior is about the common ones, ``usual``.
    """
    variance = _variance(search, start)
    logs, covariance = search.descend(start, np.eye(len(start)), np.full(len(start), variance / PRIOR**2), usual)
    spread = np.sqrt(np.maximum(np.diag(covariance), 0.0) * variance)
    std: list[list[float]] = [[] for _ in search.surfaces]
    for k, value in zip(search.owner, spread, strict=True):
        std[k].append(float(value))
    return logs, tuple(tuple(deviations) for deviations in std)


def _variance(search: _ShapeSearch, logs: Array) -> float:
    """Variance of the residuals at the shapes ``logs``, by which priors are weighed.

    It is larger where rows are correlated, because these carry less information than their number suggests.
    """
    return search.cost(logs) / max(1, len(search.y)) / _independent_share(search, logs)


def _starts(search: _ShapeSearch, groups: Sequence[tuple[str, str]], common: Array) -> list[Array]:
    """Initial logarithms of all shapes: each combination of initial values, and the shapes the surfaces already have.

    ``groups`` are the pairs (law, shape) that share a value; the matrix ``common`` (shapes, groups) copies the
    logarithm of each group to its shapes.
    """
    choices = product(*(_multiples(name) for _, name in groups))
    starts = [search.scale + common @ np.log(values) for values in choices]
    known = [value for surface in search.surfaces for value in surface.shapes]
    if len(known) == len(search.owner):
        starts.append(np.log(known))
    return starts


def _apart(search: _ShapeSearch, usual: Array) -> Array:
    """Logarithms of all shapes, where a surface may leave the common ones, ``usual``, for initial values of its own.

    Joints unlike each other, such as one with and one without presliding, have no good value in common.
    """
    logs = usual
    for k, surface in enumerate(search.surfaces):
        mask = np.array([owner == k for owner in search.owner])
        for values in product(*(_multiples(name) for name in surface.definition.shapes)):
            tried = logs.copy()
            tried[mask] = search.scale[mask] + np.log(values)
            logs = min(logs, tried, key=search.cost)
    return logs


def _multiples(shape: str) -> tuple[float, ...]:
    """Multiples of the usual value of ``shape`` at which a search starts."""
    return STARTS if SCALES[shape][1] > 0 else (1.0,)


def _scales(problem: Problem, surfaces: Sequence[FrictionSurface]) -> Array:
    """Typical magnitude of every shape parameter, from the RMS sliding speed of all ``surfaces``.

    It is in proportion to a power of that speed, see :data:`SCALES`. The mean is taken of motor speeds divided by the
    gear ratio, so that joints and motors share one scale.
    """
    gears = [float(np.linalg.norm(surface.direction)) for surface in surfaces]
    rms = math.sqrt(
        np.mean([(problem.speed(surface) / gear) ** 2 for surface, gear in zip(surfaces, gears, strict=True)])
    )
    scales = []
    for surface, gear in zip(surfaces, gears, strict=True):
        speed = max(rms, 1e-9) * gear
        scales += [value * speed**power for value, power in (SCALES[name] for name in surface.definition.shapes)]
    return np.array(scales)


def _independent_share(search: _ShapeSearch, logs: Array) -> float:
    """Share of the rows that are independent: ``(1 - a)/(1 + a)`` with the lag-one correlation a of the residuals."""
    residual = np.where(search.use, search.residual(logs)[0], 0.0)
    both = search.use[1:] & search.use[:-1]
    squares = np.sum(np.where(both, residual[1:] ** 2 + residual[:-1] ** 2, 0.0), axis=0) / 2.0
    pairs = np.sum(np.where(both, residual[1:] * residual[:-1], 0.0), axis=0)
    a = np.clip(np.divide(pairs, squares, out=np.zeros(len(squares)), where=squares > 0.0), 0.0, 0.97)
    return float(np.mean((1.0 - a) / (1.0 + a)))
