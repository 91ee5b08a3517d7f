"""Ordinary, weighted and robust least squares from the stacked rows, (14.17)-(14.20).

All estimators work on the triangular factors of :mod:`rrrgen.lab.estimate.tsqr`. Columns are scaled to unit
length before the rank is determined, so that it does not depend on units.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from rrrgen.base.arrays import Array
from rrrgen.base.errors import DerivationError, InputError
from rrrgen.lab.estimate.linear import RANK, solve
from rrrgen.lab.estimate.statistics import confidence_factor, normal_expectation_of_clipped_square
from rrrgen.lab.estimate.tsqr import JointFactors, Rows, factor_rows

RANK_TOLERANCE = RANK
NOISE_FLOOR = 1e-11  # residuals below this share of the torque are round-off and not used as a weight
HUBER = 1.345  # 95 % efficiency for normal noise
SETTLED = 1e-8  # relative change of the weights at which their iteration stops
SMALLEST_SHARE = 0.05  # of its noise left in the residual of a row; a row that alone decides a parameter leaves none
MOST_PREWHITENED = 0.7
"""Largest lag-one correlation a removed by prewhitening; the window over the measured lags takes the rest. Nearer to 1,
the factor ``1/(1 - a)^2`` magnifies what the window truncates: errors that change within half a second, at 20 rows a
second, had 99 % of the true values in intervals of 95 %."""
LEVEL = 0.95  # at which deviations from few rows are widened to hold their share with the normal distribution's factor
ROBUST_SETTLED = 1e-5  # change in standard deviations at which the slower, robust iteration stops


@dataclass(frozen=True)
class Estimate:
    """Estimated parameters ``x`` (p,) with their covariance (p, p) and the quality of the fit.

    ``joint_sigma`` (n,) is the standard deviation of the residual of every joint, N m (N), ``joint_rms`` (n,) its RMS
    and ``counts`` (n,) the number of rows; ``relative_error`` is ``|tau - W x| / |tau|``. ``condition`` is
    ``sigma_max / sigma_min`` of W (it depends on units), ``scaled_condition`` that with columns of unit length.
    ``singular`` are the scaled singular values, largest first, of which ``rank`` exceed the tolerance. ``variance`` is
    that of a weighted row, so that ``covariance / variance`` is ``(Phi' Phi)^-1`` with the weighted regressor Phi;
    ``weights`` (n,) are those of the joints.
    """

    names: tuple[str, ...]
    x: Array
    covariance: Array
    method: str
    joint_sigma: Array
    joint_rms: Array
    counts: NDArray[np.int64]
    relative_error: float
    condition: float
    scaled_condition: float
    singular: Array
    rank: int
    variance: float
    weights: Array = field(default_factory=lambda: np.ones(0))
    iterations: int = 1

    @property
    def std(self) -> Array:
        """Standard deviations (p,) of ``x``."""
        return np.asarray(np.sqrt(np.maximum(0.0, np.diag(self.covariance))))

    @property
    def relative_std(self) -> Array:
        """Standard deviations divided by the absolute values of the estimates (p,); infinite for an estimate of 0."""
        size = np.abs(self.x)
        return np.asarray(np.divide(self.std, size, out=np.full(len(size), np.inf), where=size > 0))

    @property
    def freedom(self) -> float:
        """Degrees of freedom: number of rows minus rank."""
        return float(np.sum(self.counts)) - self.rank

    @property
    def rms(self) -> float:
        """Root mean square of all residuals, N m."""
        return float(np.sqrt(np.sum(self.joint_rms**2 * self.counts) / np.sum(self.counts)))

    def confidence(self, level: float = 0.95) -> Array:
        """Confidence intervals (p, 2) at the confidence ``level`` (0..1), by Student's t distribution."""
        half = confidence_factor(level, self.freedom) * self.std
        return np.column_stack([self.x - half, self.x + half])


def least_squares(
    factors: JointFactors,
    names: Sequence[str],
    weights: Array | None = None,
    tolerance: float = RANK_TOLERANCE,
    method: str = "least squares",
) -> Estimate:
    """Weighted least squares ``x = Phi^# y``, (14.20): Phi is the regressor and y the torques, rows times weights.

    It is solved by the SVD of the triangular factor of [Phi | y], ``factors``, with columns scaled to unit length.
    ``names`` are those of the p parameters; ``weights`` (n,) multiply the rows of each joint, 1 by default. Singular
    values below ``tolerance`` times the largest are taken as zero, which gives the minimum-norm solution in scaled
    columns. ``method`` is the name stored in the estimate. Raises :class:`DerivationError` if no parameter is excited
    or there are no more rows than parameters.
    """
    p = factors.parameters
    if len(names) != p:
        raise InputError(f"{len(names)} names for {p} parameters")
    R = factors.stack(weights)
    fit = solve(R[:p, :p], R[:p, p], tolerance)
    x, rank = fit.x, fit.rank
    if rank == 0:
        raise DerivationError("the motion excites no parameter at all: every column of the regressor is zero")
    total = float(np.sum(factors.counts))
    freedom = total - rank
    if freedom <= 0:
        raise DerivationError(f"{total:.0f} rows cannot determine {rank} parameters and their noise")
    squares = factors.residual_squares(x)
    joint_freedom = np.maximum(1.0, factors.counts * freedom / total)
    sigma = np.sqrt(squares / joint_freedom)
    weighted = squares if weights is None else squares * np.asarray(weights) ** 2
    variance = float(np.sum(weighted)) / freedom
    plain = np.linalg.svd(R[:p, :p], compute_uv=False)
    return Estimate(
        names=tuple(names),
        x=x,
        covariance=variance * fit.covariance,
        method=method,
        joint_sigma=sigma,
        joint_rms=np.sqrt(squares / np.maximum(1, factors.counts)),
        counts=factors.counts,
        relative_error=float(np.sqrt(np.sum(squares) / np.sum(factors.torque_squares))),
        condition=float(plain[0] / plain[-1]) if rank == p and plain[-1] > 0 else np.inf,
        scaled_condition=fit.condition,
        singular=fit.singular,
        rank=rank,
        variance=variance,
        weights=np.ones(len(squares)) if weights is None else np.asarray(weights, float),
    )


def residual_weights(estimate: Estimate, factors: JointFactors) -> Array:
    """Weights ``1 / sigma_j`` (n,) from the residuals of an estimate; sigma is bounded below by the noise floor."""
    scale = np.sqrt(factors.torque_squares / np.maximum(1, factors.counts))
    floor = NOISE_FLOOR * float(np.max(scale))
    return np.asarray(1.0 / np.maximum(estimate.joint_sigma, max(floor, np.finfo(float).tiny)))


def weighted_least_squares(
    factors: JointFactors, names: Sequence[str], passes: int = 50, tolerance: float = RANK_TOLERANCE
) -> Estimate:
    """Least squares weighted by the residual of every joint, ``w_j = 1 / sigma_j``, iterated to convergence of w.

    ``names`` are those of the p parameters; ``passes`` is the largest number of iterations (three are customary),
    ``tolerance`` that of the rank. The first estimate is unweighted. Rows whose torque is zero, those of a flight,
    keep the weights that follow from it: their residuals vanish with x, and so would the estimate. Raises
    :class:`DerivationError` if no parameter is excited.
    """
    estimate = least_squares(factors, names, None, tolerance)
    weights = residual_weights(estimate, factors)
    homogeneous = (factors.torque_squares == 0.0) & (factors.counts > 0)
    done = 0
    while done < passes:
        done += 1
        estimate = least_squares(factors, names, weights, tolerance, "weighted least squares")
        updated = np.where(homogeneous, weights, residual_weights(estimate, factors))
        if np.max(np.abs(updated / weights - 1.0)) < SETTLED:
            break
        weights = updated
    return replace(estimate, iterations=done)


def robust_least_squares(
    blocks: Callable[[], Iterable[Rows]],
    names: Sequence[str],
    start: Estimate,
    limit: float = HUBER,
    passes: int = 50,
    tolerance: float = RANK_TOLERANCE,
    transform: Callable[[JointFactors], JointFactors] | None = None,
    expand: Callable[[Array], Array] | None = None,
) -> Estimate:
    """Huber's M-estimate by iteratively reweighted least squares: residuals beyond ``limit`` scales lose weight.

    ``blocks()`` returns an iterable of the rows for every pass; ``transform`` maps their factors to the parameters x
    and ``expand`` maps x to the columns of the rows (both the identity by default). ``start`` is the first estimate,
    ``passes`` the largest number of iterations. The scale of every joint is Huber's proposal 2, re-estimated in each
    pass.
    """
    expand = expand or (lambda x: x)
    sigma = np.maximum(start.joint_sigma, np.finfo(float).tiny)
    consistency = normal_expectation_of_clipped_square(limit)
    estimate = start
    done = 0
    while done < passes:
        done += 1
        factors, clipped = _huber_factors(blocks(), expand(estimate.x), sigma, limit)
        factors = transform(factors) if transform else factors
        updated = least_squares(factors, names, None, tolerance, "robust least squares (Huber)")
        share = max(1.0 / (1 + start.rank), 1.0 - start.rank / float(np.sum(start.counts)))
        new_sigma = sigma * np.sqrt(clipped / np.maximum(1, start.counts) / share / consistency)
        step = np.max(np.abs(updated.x - estimate.x) / np.maximum(updated.std, np.finfo(float).tiny))
        estimate, moved = updated, np.max(np.abs(new_sigma / sigma - 1.0))
        sigma = np.maximum(new_sigma, np.finfo(float).tiny)
        if step < ROBUST_SETTLED and moved < ROBUST_SETTLED:
            break
    return replace(
        _with_unweighted_errors(blocks(), expand, estimate), joint_sigma=sigma, weights=1.0 / sigma, iterations=done
    )


def _huber_factors(blocks: Iterable[Rows], theta: Array, sigma: Array, limit: float) -> tuple[JointFactors, Array]:
    """Factor the rows with the square roots of Huber's weights, ``sqrt(min(1, limit/|u|)) / sigma``.

    Returns the factors, and the sum of ``min(u^2, limit^2)`` of each joint (n,). ``u = r / sigma`` are the
    residuals r of ``theta`` scaled by ``sigma`` (n,).
    """
    total: JointFactors | None = None
    clipped = np.zeros(len(sigma))
    for rows in blocks:
        u = np.abs(rows.tau - rows.W @ theta) / sigma
        clipped += np.sum(np.where(rows.use, np.minimum(u, limit) ** 2, 0.0), axis=0)
        part = factor_rows(rows, np.sqrt(limit / np.maximum(u, limit)) / sigma)
        total = part if total is None else total.merge(part)
    if total is None:
        raise InputError("the recording holds no samples")
    return total, clipped


def _with_unweighted_errors(blocks: Iterable[Rows], expand: Callable[[Array], Array], estimate: Estimate) -> Estimate:
    """Copy of ``estimate`` whose torque errors are those on the rows without weights.

    ``expand`` maps the estimated parameters to those of the columns.
    """
    theta = expand(estimate.x)
    squares, torque = np.zeros(len(estimate.counts)), 0.0
    for rows in blocks:
        residual = np.where(rows.use, rows.tau - rows.W @ theta, 0.0)
        squares += np.sum(residual**2, axis=0)
        torque = torque + float(np.sum(np.where(rows.use, rows.tau, 0.0) ** 2))
    return replace(
        estimate,
        joint_rms=np.sqrt(squares / np.maximum(1, estimate.counts)),
        relative_error=float(np.sqrt(np.sum(squares) / torque)),
    )


def correlated_covariance(
    blocks: Iterable[Rows],
    estimate: Estimate,
    lags: int,
    expand: Callable[[Array], Array],
    project: Array,
    limit: float | None = None,
) -> Array:
    """Covariance (p, p) of an estimate with residuals correlated over up to ``lags`` samples and between joints.

    ``(Phi' Phi)^-1 S (Phi' Phi)^-1`` with S the long-run covariance of the scores ``s_k = sum_j w_j^2 W_jk' r_jk``
    with Bartlett weights after prewhitening (Newey and West 1987, Andrews and Monahan 1992). Each residual is divided
    by ``1 - h`` with the leverage ``h`` of its row, the share of its own noise that the fit absorbs: an estimate
    without that row would leave this residual (the jackknife of MacKinnon and White 1985, HC3). On a short recording S
    rests on few independent products, so that the deviations scatter: they are widened to hold as many estimates within
    1.96 of them as Student's t does with the degrees of freedom of :func:`_degrees_of_freedom`. ``blocks`` are the rows
    in order of time; ``project`` (columns of the rows, p) is the linear part of ``expand``, which maps x to theta.

    For a robust estimate, residuals are clipped at ``limit`` standard deviations, and the outer matrices count only
    the rows that are not clipped: ``(sum psi' W W')^-1 S (sum psi' W W')^-1`` (Huber and Ronchetti 2009, ch. 7).
    """
    w2 = estimate.weights**2
    theta = expand(estimate.x)
    p = project.shape[1]
    products, slope = np.zeros((lags + 2, p, p)), np.zeros((p, p))
    inverse = estimate.covariance / estimate.variance if estimate.variance > 0 else estimate.covariance
    root = project @ _square_root(inverse)
    fourth, count = np.zeros(p), 0
    tail, tail_segment = np.zeros((0, p)), np.zeros(0, np.int64)
    for rows in blocks:
        residual = np.where(rows.use, rows.tau - rows.W @ theta, 0.0)
        if limit is not None:
            most = limit / estimate.weights
            slope += _unclipped_information(rows, np.abs(residual) < most, estimate.weights, project)
            residual = np.clip(residual, -most, most)
        leverage = w2 * np.sum((rows.W @ root) ** 2, axis=-1)
        residual = residual / np.maximum(1.0 - leverage, SMALLEST_SHARE)
        scores = np.vstack([tail, np.einsum("kj,kjp->kp", residual * w2, rows.W) @ project])
        segment = np.concatenate([tail_segment, rows.segment])
        old = len(tail)
        fourth += np.sum((scores[old:] @ inverse) ** 4, axis=0)
        count += int(np.sum(np.any(rows.use, axis=1)))
        for lag in range(min(lags + 1, len(scores) - 1) + 1):
            first = max(old, lag)
            same = segment[first:] == segment[first - lag : len(segment) - lag]
            products[lag] += (scores[first:] * same[:, None]).T @ scores[first - lag : len(scores) - lag]
        keep = max(0, len(scores) - lags - 1)
        tail, tail_segment = scores[keep:], segment[keep:]
    S = _long_run_covariance(products)
    squares, next_to = (np.einsum("ji,jk,ki->i", inverse, product, inverse) for product in products[:2])
    freedom = _degrees_of_freedom(squares, next_to, fourth, count, lags)
    wider = np.array([confidence_factor(LEVEL, degrees) for degrees in freedom]) / confidence_factor(LEVEL, np.inf)
    if limit is not None:
        inverse = np.asarray(np.linalg.pinv(slope, hermitian=True), dtype=np.float64)
    return np.asarray(inverse @ S @ inverse * np.outer(wider, wider))


def _degrees_of_freedom(squares: Array, next_to: Array, fourth: Array, count: int, lags: int) -> Array:
    """Degrees of freedom (p,) of the long-run variances of p scores z over ``count`` rows, 2 over the squared scatter.

    Bartlett's window of ``lags`` lags gives a variance the relative scatter ``4/3 (lags + 1)/N`` (Andrews 1991),
    and the lag-one correlation a, removed by prewhitening, one of ``(1 - a^2)/N``, which the factor ``1/(1 - a)^2``
    magnifies to ``4 (1 + a)/((1 - a) N)``. N counts rows alike: a motion that excites a parameter for a part of the
    time reduces it by the kurtosis of z over that of normal noise, 3. ``squares``, ``next_to`` and ``fourth`` (p,) are
    the sums of ``z_k^2``, ``z_k z_{k-1}`` and ``z_k^4``.
    """
    present = squares > 0.0
    a = np.clip(np.divide(next_to, squares, out=np.zeros(len(squares)), where=present), 0.0, MOST_PREWHITENED)
    kurtosis = np.divide(count * fourth, squares**2, out=np.full(len(squares), 3.0), where=present)
    scatter = kurtosis / 3.0 * (4.0 / 3.0 * (lags + 1) + 4.0 * (1.0 + a) / (1.0 - a)) / max(1, count)
    return np.asarray(2.0 / scatter)


def _square_root(A: Array) -> Array:
    """Matrix B with ``B B' = A`` for a positive semidefinite A; rounding errors below zero are dropped."""
    values, V = np.linalg.eigh(0.5 * (A + A.T))
    return np.asarray(V * np.sqrt(np.maximum(values, 0.0)))


def _long_run_covariance(products: Array) -> Array:
    """Long-run covariance (p, p) from the sums ``products[l] = sum s_k s_{k-l}'`` of scores, l = 0 .. lags + 1.

    Each score is prewhitened by its lag-one correlation a (Andrews and Monahan 1992): ``u_k = s_k - a s_{k-1}`` is less
    correlated than s, so that the window truncates less of it; the factor ``1/(1 - a)`` restores the variance of s.
    """
    squares = np.diag(products[0])
    a = np.divide(np.diag(products[1]), squares, out=np.zeros(len(squares)), where=squares > 0.0)
    a = np.clip(a, 0.0, MOST_PREWHITENED)
    lags = len(products) - 2
    S = np.zeros(products.shape[1:])
    for lag in range(lags + 1):
        earlier = products[lag - 1] if lag else products[1].T
        G = products[lag] - products[lag + 1] * a - a[:, None] * earlier + a[:, None] * products[lag] * a
        S += G if lag == 0 else (1.0 - lag / (lags + 1)) * (G + G.T)
    whole = S / np.outer(1.0 - a, 1.0 - a)
    # sums over stretches differ in their end terms, which may leave a slightly negative eigenvalue
    values, V = np.linalg.eigh(0.5 * (whole + whole.T))
    return np.asarray((V * np.maximum(values, 0.0)) @ V.T)


def _unclipped_information(rows: Rows, inside: NDArray[np.bool_], weights: Array, project: Array) -> Array:
    """Sum ``sum_jk w_j^2 W_jk' W_jk`` (p, p) over the rows in use whose residuals are ``inside`` (N, n) the limit.

    ``weights`` w (n,) are those of the joints; ``project`` maps the columns of the rows to the p parameters.
    """
    A = (rows.W * (weights * (rows.use & inside))[..., None]).reshape(-1, rows.W.shape[-1]) @ project
    return np.asarray(A.T @ A)


def robust_rows(blocks: Iterable[Rows], theta: Array, estimate: Estimate, limit: float = HUBER) -> JointFactors:
    """Factors of the rows with the weights of the last pass of a robust estimate; ``theta`` are all parameters (p,)."""
    return _huber_factors(blocks, theta, 1.0 / estimate.weights, limit)[0]
