"""Weighted nonlinear least squares for the minimal set of geometric parameters, robust against outliers on request."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rrrgen.base.arrays import Array
from rrrgen.base.errors import DerivationError
from rrrgen.lab.calibrate.geometry import RIGID, ROW, Geometry, GeometryEntry, rotation_vectors
from rrrgen.lab.calibrate.measurements import Measurements
from rrrgen.lab.calibrate.minimal_set import MinimalSet, minimal_set
from rrrgen.lab.estimate.linear import solve
from rrrgen.lab.estimate.search import Search, search

_Law = Callable[[Array], Array]
STEPS = 50
SMALL_GAIN = 1e-15  # relative decrease of the cost that ends a search: a step of 3e-8 standard deviations of the fit
HUBER = 1.345  # tuning constant of Huber's weights: 95 % efficiency for normal errors
TUKEY = 4.685
REWEIGHTED = 30
HALF = 0.52  # share of the measurements that a trimmed fit holds to be good
SMALL = 0.3  # the same where not even half of them fit together
FEW = {"pose": 3, "point": 4}  # measurements of a random group that determine base and tool
GROUPS = 100  # random groups; where half of the measurements are good, none is with a probability of 2e-6 and 2e-3
FOLLOWED, TRIMMED, GROUP_STEPS = 3, 15, 5
SUSPICIOUS = 3.0  # stated deviations; a larger scale of most residuals may be that of outliers
USED = 0.1  # least weight of a measurement that counts; the others are outliers
STILL = 0.01  # rad or m: the range of a joint that has not moved
ENDS_RANK = 1e-6  # measurements may not determine base and tool: scaled singular values below this are zero
WORST_CONDITION = 1e8  # of the scaled derivative; beyond it some parameter is not determined by these poses


@dataclass(frozen=True)
class Calibration:
    """The result of a calibration: ``geometry``, and the parameters of ``chosen`` with their changes and deviations.

    ``change`` (p,) are estimated minus nominal values, ``covariance`` (p, p) that of their errors for the stated noise,
    in m and rad.
    ``residuals`` and ``before`` (N, components) are measured minus computed values after and before the calibration.
    ``weights`` (N,) are those of robust estimation (1 without it). ``chi2_per_dof`` is near 1 where the stated noise is
    right. ``condition`` is the condition number, and ``observability`` the geometric mean of the singular values over
    sqrt(N), of the derivative of the measurements by the parameters, scaled by the noise. ``steps`` counts the accepted
    ones of the first least squares.
    """

    geometry: Geometry
    chosen: MinimalSet
    change: Array
    covariance: Array
    residuals: Array
    before: Array
    weights: Array
    chi2_per_dof: float
    condition: float
    observability: float
    steps: int

    @property
    def misfit(self) -> float:
        """By how much the residuals exceed the stated noise, at least 1: the factor of all deviations."""
        return float(np.sqrt(max(1.0, self.chi2_per_dof)))

    @property
    def deviation(self) -> Array:
        """The standard deviations of the parameters (p,), in m and rad, raised by the :attr:`misfit`."""
        return np.asarray(self.misfit * np.sqrt(np.diag(self.covariance)))

    def position_deviation(self, q: Array) -> Array:
        """Predicted error (N,) of the tip position at ``q`` (N, joints), root mean square, in m.

        It follows from the covariance of the parameters, and is raised by the :attr:`misfit` like all deviations.
        """
        J = self.geometry.jacobian(q, self.chosen.kept)[:, :3]
        return np.asarray(self.misfit * np.sqrt(np.einsum("nip,pk,nik->n", J, self.covariance, J, optimize=True)))

    @property
    def degrees_of_freedom(self) -> int:
        """Number of measured numbers that were used, less the number of parameters."""
        return int(np.sum(self.weights >= USED)) * int(self.residuals.shape[1]) - len(self.chosen.kept)

    @property
    def outliers(self) -> list[int]:
        """Numbers (from 0) of the measurements to which robust estimation gave hardly any weight."""
        return [int(k) for k in np.flatnonzero(self.weights < USED)]


def calibrate(nominal: Geometry, measured: Measurements, robust: bool = False, steps: int = STEPS) -> Calibration:
    """Estimate the geometry that fits ``measured`` best by weighted least squares, starting from ``nominal``.

    With ``robust``, measurements are reweighted by Huber's function and then, from that solution, by Tukey's, which
    gives outliers no weight. Where most residuals stay larger than the stated noise, a least trimmed squares fit is the
    start instead, if it fits half of the measurements better: nearly half of them may be outliers. At most ``steps``
    steps are made from each set of weights. Raises :class:`DerivationError` if there are fewer measured numbers than
    parameters, or if the poses do not determine the parameters.
    """
    start = measured.with_fixtures(_align(nominal, measured))
    chosen = minimal_set(start, measured)
    count = measured.residuals(start).size
    if count <= len(chosen.kept):
        components = count // len(measured.q)
        needed, better = len(chosen.kept) // components + 1, -(-3 * len(chosen.kept) // components)
        raise DerivationError(
            f"{len(measured.q)} measurements ({measured.kind}) are {count} numbers, for {len(chosen.kept)} parameters: "
            f"at least {needed} measurements are needed, and {better} or more are advisable"
        )
    ones: Array = np.ones(len(measured.q))
    plain = _fit(start, measured, chosen.kept, ones, steps)
    geometry, weights = plain.state, ones
    if robust:
        # Tukey's cost has several local minima, Huber's is convex in a linear problem: Huber's solution is the start of
        # Tukey's. Many outliers pull it off too, hence the trimmed fit where most residuals stay too large.
        geometry, weights = _reweight(geometry, measured, chosen.kept, steps, (_huber, _tukey))
        if measured.kind in FEW and _scale(geometry, measured) > SUSPICIOUS:
            other = trimmed_fit(nominal, measured, chosen.kept, HALF)
            if _trimmed_square(other, measured, HALF) < _trimmed_square(geometry, measured, HALF):
                geometry, weights = _reweight(other, measured, chosen.kept, steps, (_tukey,))
    return _assess(measured.with_fixtures(nominal), geometry, measured, chosen, weights, plain.steps)


_MEDIAN = {1: 1.0, 3: 1.538 * 1.4826, 6: 2.313 * 1.4826}
"""Median length of a vector of 1, 3 or 6 standard normal numbers, by which the median of residuals gives their scale.
For 3 and 6 the value is multiplied by 1.4826, because the code divides by that factor, which is right for one
number."""


def _reweight(
    geometry: Geometry, measured: Measurements, entries: tuple[GeometryEntry, ...], steps: int, laws: Sequence[_Law]
) -> tuple[Geometry, Array]:
    """Least squares with weights by one law after the other, each until nothing moves: geometry and weights (N,)."""
    weights: Array = np.ones(len(measured.q))
    for law in laws:
        for _ in range(REWEIGHTED):
            weights = law(_sizes(geometry, measured) / max(_scale(geometry, measured), 1e-12))
            following = _fit(geometry, measured, entries, weights, steps).state
            moved = np.abs(following.forward(measured.q) - geometry.forward(measured.q)).max()
            geometry = following
            if moved < 1e-9:
                break
    return geometry, weights


def _scale(geometry: Geometry, measured: Measurements) -> float:
    """The noise in stated standard deviations, from the median of the residuals."""
    return 1.4826 * float(np.median(_sizes(geometry, measured))) / _MEDIAN[measured.residuals(geometry).shape[1]]


def trimmed_fit(
    nominal: Geometry, measured: Measurements, entries: tuple[GeometryEntry, ...], share: float
) -> Geometry:
    """Least trimmed squares: the geometry with the least sum of the smallest ``share`` of the squared residuals.

    Base and tool are fitted to random groups of a few measurements. From the best of these fits all parameters
    ``entries`` are fitted to the share that fits best, until it stays the same (Rousseeuw, Van Driessen 2006).
    ``measured`` are poses or points.
    """
    random, fits = np.random.default_rng(0), []
    ends = tuple(entry for entry in nominal.entries() if entry.place in ("base", "tool"))
    few = FEW[measured.kind]
    # A group of few measurements is free of outliers with some probability, so that one of many groups is. Base and
    # tool alone are fitted to a group: few measurements do not determine all parameters, and the largest errors are
    # those of the two.
    for _ in range(GROUPS):
        rows = random.choice(len(measured.q), few, replace=False)
        group = measured.of(rows, measured.q[rows])
        fits.append(_fit(_align(nominal, group), group, ends, np.ones(few), GROUP_STEPS).state)
    fits.sort(key=lambda fit: _trimmed_square(fit, measured, share))
    ended = []
    for geometry in fits[:FOLLOWED]:
        for fitted in (ends, entries):
            kept: Array = np.zeros(len(measured.q))
            for _ in range(TRIMMED):
                sizes = _sizes(geometry, measured)
                nearest = (sizes <= np.sort(sizes)[_count(sizes, share) - 1]).astype(float)
                if np.array_equal(nearest, kept):
                    break
                kept = nearest
                geometry = _fit(geometry, measured, fitted, kept, GROUP_STEPS).state
        ended.append(geometry)
    return min(ended, key=lambda fit: _trimmed_square(fit, measured, share))


def _trimmed_square(geometry: Geometry, measured: Measurements, share: float) -> float:
    sizes = _sizes(geometry, measured)
    return float(np.sum(np.sort(sizes)[: _count(sizes, share)] ** 2))


def _count(sizes: Array, share: float) -> int:
    return max(1, int(np.ceil(share * len(sizes))))


def largest_consensus(nominal: Geometry, measured: Measurements, calibration: Calibration) -> int:
    """The largest number of measurements that fit one geometry within the stated noise, as trimmed fits find it.

    Three in ten of the measurements are fitted; 0 for other measurements than poses and points, or where these are too
    few for all parameters.
    """
    entries = calibration.chosen.kept
    numbers = SMALL * measured.residuals(calibration.geometry).size
    if measured.kind not in FEW or numbers <= len(entries):
        return 0
    geometry = trimmed_fit(nominal, measured, entries, SMALL)
    return int(np.sum(_sizes(geometry, measured) < 2 * TUKEY))


def _sizes(geometry: Geometry, measured: Measurements) -> Array:
    """The length of each residual in standard deviations, (N,)."""
    return np.asarray(np.linalg.norm(measured.residuals(geometry) * measured.weights, axis=1))


def _huber(size: Array) -> Array:
    return np.asarray(np.minimum(1.0, HUBER * 2 / np.maximum(size, 1e-12)))


def _tukey(size: Array) -> Array:
    return np.asarray(np.where(size < TUKEY * 2, (1 - (size / (TUKEY * 2)) ** 2) ** 2, 0.0))


def _align(nominal: Geometry, measured: Measurements) -> Geometry:
    """Move the base of the nominal geometry so that it fits the measured positions best (Kabsch's algorithm).

    Where no positions are measured, the nominal geometry is returned.
    """
    if measured.kind not in ("pose", "point"):
        return nominal
    values = measured.values[:, :3, 3] if measured.kind == "pose" else measured.values
    p = nominal.forward(measured.q)[:, :3, 3]
    U, _, Vt = np.linalg.svd((values - values.mean(0)).T @ (p - p.mean(0)))
    R = U @ np.diag([1, 1, np.linalg.det(U @ Vt)]) @ Vt
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R, values.mean(0) - R @ p.mean(0)
    return nominal if len(p) < 3 else replace(nominal, base=T @ nominal.base)


def fit_ends(nominal: Geometry, measured: Measurements, steps: int) -> tuple[Array, int]:
    """Fit base, tool and fixtures alone: the residuals (N, components) that stay, and the number of parameters.

    Where no positions are measured the base stays. At most ``steps`` damped steps are tried; the measurements
    need not determine base and tool.
    """
    start = measured.with_fixtures(_align(nominal, measured))
    places = ("base", "tool") if measured.kind in ("pose", "point") else ("fixture", "tool")
    entries = tuple(entry for entry in start.entries() if entry.place in places)
    ones: Array = np.ones(len(measured.q))
    end = _fit(start, measured, entries, ones, steps)
    return measured.residuals(end.state), solve(end.J, end.r, ENDS_RANK).rank


def _linearise(
    geometry: Geometry, measured: Measurements, entries: tuple[GeometryEntry, ...], weights: Array
) -> tuple[Array, Array]:
    """Residuals (m,) of all measured numbers and their derivatives (m, p) by the parameters ``entries``, both weighted.

    The weights are those of the measured components times the root of ``weights`` (N,), those of the measurements.
    """
    scale = measured.weights[None, :] * np.sqrt(weights)[:, None]
    J = measured.jacobian(geometry, entries)  # of the computed numbers; residuals are measured minus computed ones
    return (measured.residuals(geometry) * scale).ravel(), -(J * scale[..., None]).reshape(-1, len(entries))


def _fit(
    start: Geometry, measured: Measurements, entries: tuple[GeometryEntry, ...], weights: Array, steps: int
) -> Search[Geometry]:
    """Minimize the weighted squared residuals from ``start`` over the parameters ``entries``, with ``steps`` trials."""
    scale = measured.weights[None, :] * np.sqrt(weights)[:, None]
    return search(
        start,
        lambda geometry: _linearise(geometry, measured, entries, weights),
        moved=lambda geometry, step: geometry.with_step(entries, step),
        cost=lambda geometry: float(np.sum((measured.residuals(geometry) * scale) ** 2)),
        trials=steps,
        small_gain=SMALL_GAIN,
        damping=1e-6,
        less=30.0,
        more=30.0,
    )


def _assess(
    nominal: Geometry, geometry: Geometry, measured: Measurements, chosen: MinimalSet, weights: Array, steps: int
) -> Calibration:
    """The calibration with the fitted ``geometry``: covariance, misfit and how well the poses determine it."""
    r, J = _linearise(geometry, measured, chosen.kept, weights)
    fit = solve(J, r, 1.0 / WORST_CONDITION)
    if len(fit.weak):
        name = chosen.kept[int(np.argmax(np.abs(fit.weak[-1])))].name
        condition = fit.singular[0] / max(float(fit.singular[-1]), 1e-300)
        raise DerivationError(f"these poses do not determine {name}: condition {condition:.0e}; {_why(measured)}")
    residuals = measured.residuals(geometry)
    used = weights >= USED
    squares = float(np.sum((residuals * measured.weights)[used] ** 2))
    dof = int(used.sum()) * residuals.shape[1] - len(chosen.kept)
    return Calibration(
        geometry=geometry,
        chosen=chosen,
        change=_changes(nominal, geometry, chosen.kept),
        covariance=fit.covariance,
        residuals=residuals,
        before=measured.residuals(measured.with_fixtures(_align(nominal, measured))),
        weights=weights,
        chi2_per_dof=squares / max(dof, 1),
        condition=fit.condition,
        observability=float(np.exp(np.mean(np.log(fit.singular)))) / float(np.sqrt(len(measured.q))),
        steps=steps,
    )


def _why(measured: Measurements) -> str:
    """What the joint positions lack."""
    count = len(np.unique(np.round(measured.q, 4), axis=0))
    if count < len(measured.q) / 2:
        return f"there are only {count} different joint positions among the {len(measured.q)}"
    still = [k + 1 for k, span in enumerate(np.ptp(measured.q, axis=0)) if span < STILL]
    if still:
        return f"joint {', '.join(map(str, still))} hardly moves"
    if measured.kind == "pose":
        return "vary all joints, independently of each other"
    return "vary all joints, and put the target off the flange axis where only its position is measured"


def _changes(nominal: Geometry, geometry: Geometry, entries: tuple[GeometryEntry, ...]) -> Array:
    """Estimated minus nominal values of the parameters (p,); for base and tool relative to the nominal pose."""
    moved = {"base": _motion(nominal.base, geometry.base), "tool": _motion(nominal.tool, geometry.tool)}
    touched = [after.change_from(start) for start, after in zip(nominal.fixtures, geometry.fixtures, strict=True)]
    rows, gains = geometry.rows - nominal.rows, None
    if geometry.gains is not None and nominal.gains is not None:
        gains = geometry.gains - nominal.gains

    def change(entry: GeometryEntry) -> float:
        if entry.place == "row":
            return float(rows[entry.row, ROW.index(entry.key)])
        if entry.place == "gain" and gains is not None:
            return float(gains[entry.row])
        if entry.place == "fixture":
            return touched[entry.row][entry.key]
        return float(moved[entry.place][RIGID.index(entry.key)])

    return np.array([change(entry) for entry in entries])


def _motion(before: Array, after: Array) -> Array:
    """Translation and rotation vector (6,) that move the frame ``before`` to ``after``, in axes of ``before``."""
    T = np.linalg.solve(before, after)
    return np.concatenate([T[:3, 3], rotation_vectors(T[None, :3, :3])[0]])
