"""Nuisance parameters of a recording: encoder zeros, torque gains, delays, tilt of the base, drift of the friction.

They enter the equation of every joint beside the parameters theta of the model,

    tau_j(t + d_j) = k_j Y_j(q + delta, dq, ddq; g + gamma) theta + s (a_j dq_j + b_j sgn dq_j) + more columns,

with zeros delta, gains k, delays d, the tilt gamma of gravity against the base, and friction that drifts with s, the
time from -1/2 to 1/2. Recorded behind a gear of ratio N, the motion of a joint is N times its own and the torque 1/N of
it. For given zeros, gains and delays all others are linear: the problem is separable, and
variable projection (Golub and Pereyra 1973) leaves a search for these few. Their derivatives at the fit are columns
beside the regressor, which tell the rank and the covariance.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any, Literal, NamedTuple

import numpy as np

from rrrgen.base.arrays import Array
from rrrgen.lab.estimate.regression import correlated_covariance, least_squares
from rrrgen.lab.estimate.search import Linearisation, search
from rrrgen.lab.estimate.statistics import correlation_lags, residual_whiteness
from rrrgen.lab.estimate.tsqr import Rows, factor_rows
from rrrgen.lab.identify.diagnosis.trial_fits import FLOOR, Regressor, Sample, fit_products, solve_normal_equations
from rrrgen.lab.identify.regressor import RigidModel
from rrrgen.robot.spec import standard_parameters

Kind = Literal["zero", "gain", "delay", "tilt", "viscous drift", "Coulomb drift", "column", "ratio"]
ALL = -1  # place of a delay that all joints share
UNIT: dict[Kind, float] = {"delay": 0.01}
"""A common size of a parameter, in SI, where that is not 1."""
STEP = 1e-4  # rad (m) of the central differences
LEAST = 1e-4  # effect of a nuisance parameter on the torques, relative, below which nothing can determine it
LARGEST_STEP: dict[Kind, float] = {"zero": 1.0, "gain": 1.0, "delay": 0.1, "ratio": 1.0}
STEPS, TRIES, SETTLED = 8, 6, 2e-4  # of the search; relative decrease of the squares at which it ends
GRID = 15.0 * np.pi / 180.0  # one of 30 degrees missed the zero of a real arm
BEST_OF_GRID = 3


class Term(NamedTuple):
    """A nuisance parameter: its ``kind``, and the joint, axis or regressor column ``place`` that it belongs to."""

    kind: Kind
    place: int

    @property
    def is_linear(self) -> bool:
        """Whether the torques are linear in the parameter itself."""
        return self.kind not in ("zero", "gain", "delay", "ratio")


class SampledMotion(NamedTuple):
    """Motion ``q``, ``dq``, ``ddq`` (N, n), derivatives of the torques by time ``rate`` (N, n), drift time ``s`` (N,).

    The latter runs from -1/2 at the beginning of the recording to 1/2 at its end.
    """

    q: Array
    dq: Array
    ddq: Array
    rate: Array
    s: Array


@dataclass(frozen=True, eq=False)
class Influence:
    """Derivatives of the joint torques of ``model`` by nuisance parameters."""

    model: RigidModel

    def columns(
        self, terms: Sequence[Term], at: SampledMotion, torque: Array, beta: Array, gains: Array | float = 1.0
    ) -> Array:
        """Derivatives (N, n, len(terms)); those by a regressor column are left zero.

        ``torque`` (N, n) is that of the model with its ``gains`` (n,), of which ``beta`` (b,) are the base parameters.
        """
        derivatives = np.zeros((*at.q.shape, len(terms)))
        for k, (kind, place) in enumerate(terms):
            j: Any = slice(None) if place == ALL else place
            if kind == "zero":
                move = STEP * np.eye(self.model.n)[place]
                ahead, behind = (np.asarray(self.model.regressor(q, at.dq, at.ddq)) for q in (at.q + move, at.q - move))
                derivatives[..., k] = (ahead - behind) @ beta / (2.0 * STEP) * gains
            elif kind == "gain":
                derivatives[:, j, k] = torque[:, j]
            elif kind == "delay":
                derivatives[:, j, k] = -at.rate[:, j]
            elif kind == "tilt":
                derivatives[..., k] = self.gravity(place, at.q, beta) * gains
            elif kind == "viscous drift":
                derivatives[:, j, k] = at.s * at.dq[:, j]
            elif kind == "Coulomb drift":
                derivatives[:, j, k] = at.s * np.sign(at.dq[:, j])
        return derivatives

    def gravity(self, axis: int, q: Array, beta: Array) -> Array:
        """Change (N, n) of the gravity torques where gravity turns by 1 rad towards the axis x (0) or y (1).

        The torques are the derivatives of ``-sum_l (m_l p_l + R_l h_l) . a``, by central differences. Mass and first
        moments are those of standard parameters that have the base parameters ``beta``, nearest to those of the robot
        file: about a vertical first axis, gravity does not tell the moments that a tilt reveals.
        """
        K = np.asarray(self.model.base_projection)
        links = getattr(self.model.spec, "links", None)
        stated = np.zeros(K.shape[1])
        if links is not None:
            stated = np.array([standard_parameters(link) for link in links], float).ravel()
        phi = (stated + np.linalg.pinv(K) @ (beta - K @ stated)).reshape(-1, 10)
        a = self._across(axis)
        changes = np.zeros_like(q)
        for j in range(self.model.n):
            move = STEP * np.eye(self.model.n)[j]
            ahead, behind = (self._energy(x, phi, a) for x in (q + move, q - move))
            changes[:, j] = (ahead - behind) / (2.0 * STEP)
        return changes

    def tilted_gravity(self, angles: Sequence[float]) -> list[float]:
        """Gravity (3,), m/s^2, in the frame of the base, tilted by two ``angles``, rad."""
        g = np.array([float(v) for v in self.model.spec.gravity])
        return [float(v) for v in g + sum(angle * self._across(axis) for axis, angle in enumerate(angles))]

    @property
    def can_tilt(self) -> bool:
        """Whether the model has frames of its links, and gravity."""
        upright = any(float(v) != 0.0 for v in getattr(self.model.spec, "gravity", (0.0,)))
        return getattr(self.model, "link_frames", None) is not None and upright

    def _across(self, axis: int) -> Array:
        """Change of gravity (3,), m/s^2, where it turns by 1 rad towards one of the two axes most across it."""
        g = np.array([float(v) for v in self.model.spec.gravity])
        size = float(np.linalg.norm(g))
        across = np.eye(3)[np.sort(np.argsort(np.abs(g), kind="stable")[:2])[axis]]
        return np.asarray(size * across - (across @ g) * g / size)

    def _energy(self, q: Array, phi: Array, a: Array) -> Array:
        """Potential energy (N,) of links with standard parameters ``phi`` (n, 10) in the gravity ``a`` (3,)."""
        T = np.asarray(self.model.link_frames(q))  # type: ignore[attr-defined]
        moments = T[..., :3, 3] * phi[:, 0, None] + np.einsum("nlab,lb->nla", T[..., :3, :3], phi[:, 1:4])
        return np.asarray(-np.sum(moments, axis=1) @ a)


class NuisanceFit:
    """Fits of a sample with nuisance parameters.

    The columns of ``regressor`` begin with the base parameters of ``model``; its parameters are ``theta = T x + known``
    with x (r,) free.
    """

    def __init__(
        self, model: RigidModel, regressor: Regressor, sample: Sample, T: Array, known: Array | None = None
    ) -> None:
        self.regressor, self.sample, self.T = regressor, sample, T
        self.known = np.zeros(len(T)) if known is None else known
        self.influence = Influence(model)
        duration = float(np.ptp(sample.t)) or 1.0
        self.time = (sample.t - sample.t[0]) / duration - 0.5
        self.counts = np.maximum(1, np.sum(sample.use, axis=0))
        self.size = np.sqrt(np.sum(np.where(sample.use, sample.tau, 0.0) ** 2, axis=0) / self.counts)
        self.size = np.maximum(self.size, 1e-3 * max(float(np.max(self.size)), np.finfo(float).tiny))
        self.n = sample.n
        self.fixed_points = np.zeros(self.n)  # positions that are read alike at either side of a gear

    # -- the least-squares problem at given values of the nuisance parameters --------------------------------------

    def regressor_at(self, values: Mapping[Term, float]) -> tuple[Array, Array]:
        """Regressor (N, n, r) of x and torques (N, n) at ``values`` of zeros, gains and delays."""
        W = np.asarray(self.regressor(*self._motion(values))) * self._gains(values)[:, None]
        return W @ self.T, self._torque(values) - W @ self.known

    def _motion(self, values: Mapping[Term, float]) -> tuple[Array, Array, Array]:
        sample, here = self.sample, self.fixed_points
        zeros = np.array([values.get(Term("zero", j), 0.0) for j in range(self.n)])
        ratio = np.exp([values.get(Term("ratio", j), 0.0) for j in range(self.n)])
        q = sample.q if np.all(ratio == 1.0) else here + (sample.q - here) / ratio
        return q + zeros, sample.dq / ratio, sample.ddq / ratio

    def _gains(self, values: Mapping[Term, float]) -> Array:
        gain = [values.get(Term("gain", j), 0.0) - values.get(Term("ratio", j), 0.0) for j in range(self.n)]
        return np.asarray(np.exp(gain))

    def _delays(self, values: Mapping[Term, float]) -> Array:
        delays = np.array([values.get(Term("delay", j), 0.0) for j in range(self.n)])
        return np.asarray(delays + values.get(Term("delay", ALL), 0.0))

    def _torque(self, values: Mapping[Term, float]) -> Array:
        delays = self._delays(values)
        return self.sample.later(delays) if delays.any() else self.sample.tau

    def columns(self, terms: Sequence[Term], values: Mapping[Term, float], W: Array, x: Array) -> Array:
        """Derivatives (N, n, len(terms)) of the torques by nuisance parameters, at ``values`` and parameters ``x``.

        W (N, n, r) is the regressor at these values.
        """
        theta = self.T @ x + self.known
        motion = self._motion(values)
        # the rate where the torque is read: noise is uncorrelated with its rate there, but not with that of other times
        at = SampledMotion(*motion, self.sample.later(self._delays(values), derivative=1), self.time)
        torque = W @ x
        if np.any(self.known):
            torque = torque + self._gains(values) * (self.regressor(*motion) @ self.known)
        beta = theta[: len(self.influence.model.base_parameter_names)]
        derivatives = self.influence.columns(terms, at, torque, beta, self._gains(values))
        for k, term in enumerate(terms):
            if term.kind == "column":
                derivatives[..., k] = self._everything[..., term.place]
            elif term.kind == "ratio":
                sides = ({**values, term: values.get(term, 0.0) + move} for move in (STEP, -STEP))
                ahead, behind = (self.regressor(*self._motion(v)) @ theta * self._gains(v) for v in sides)
                derivatives[..., k] = (ahead - behind) / (2.0 * STEP)
        return derivatives

    @cached_property
    def _everything(self) -> Array:
        return np.asarray(self.regressor(self.sample.q, self.sample.dq, self.sample.ddq))

    # -- fits ------------------------------------------------------------------------------------------------------

    def products(self, A: Array, tau: Array, edges: Sequence[int] | None = None) -> Array:
        """Products ``[A tau]' [A tau]`` of the rows of every joint: (n, m+1, m+1).

        With ``edges`` (B+1,), those of the times between consecutive ones, (B, n, m+1, m+1).
        """
        rows = np.concatenate([A, tau[..., None]], axis=-1) * self.sample.use[..., None]
        if edges is None:
            return np.stack([rows[:, j].T @ rows[:, j] for j in range(self.n)])
        parts = [np.stack([rows[a:b, j].T @ rows[a:b, j] for j in range(self.n)]) for a, b in pairwise(edges)]
        return np.stack(parts)

    def solve(self, G: Array) -> tuple[Array, Array]:
        """Parameters (m,) and residual deviations (n,) from products ``G`` (n, m+1, m+1); weights are iterated."""
        x, _, squares = fit_products(G, self.counts, self.size)
        return x, np.maximum(np.sqrt(squares / self.counts), FLOOR * self.size)

    def fit_model(self, terms: Sequence[Term], values: Mapping[Term, float]) -> tuple[Array, Array]:
        """Parameters x (r,) and residual deviations (n,) at ``values``, with the linear terms free."""
        W, tau = self.regressor_at(values)
        x, sigma = self.solve(self.products(W, tau))
        linear = [term for term in terms if term.is_linear]
        if linear:
            A = np.concatenate([W, self.columns(linear, values, W, x)], axis=-1)
            x, sigma = self.solve(self.products(A, tau))
        return x[: W.shape[-1]], sigma

    def joint_errors(self, values: Mapping[Term, float]) -> Array:
        """Relative torque errors (n,) of the fit at ``values`` of the nuisance parameters."""
        return np.asarray(self.fit_model(list(values), values)[1] / self.size)

    def objective(self, sigma: Array) -> float:
        """Minus the logarithm of the likelihood, up to a constant: ``sum N_j ln sigma_j``."""
        return float(self.counts @ np.log(sigma))

    def fit_terms(self, terms: Sequence[Term], start: Mapping[Term, float]) -> dict[Term, float]:
        """Values of the nuisance ``terms`` that fit best, from ``start``.

        Zeros, gains and delays are searched, with the parameters of the model and the linear terms projected out and
        the weights of the joints renewed after every step.
        """
        values = {term: start.get(term, 0.0) for term in terms}
        linear = [term for term in terms if term.is_linear]
        free = [term for term in terms if not term.is_linear]
        x, sigma = self.fit_model(terms, values)
        held = {"x": x, "weights": 1.0 / sigma}  # a tilt acts on masses; both are renewed after every step

        def at(state: Array) -> dict[Term, float]:
            return values | dict(zip(free, (float(v) for v in state), strict=True))

        def project_out_model(state: Array, with_derivatives: bool) -> tuple[Array, Array, Array]:
            """Triangle-like factor S of the part of [derivatives, torque] orthogonal to the model, and its fit."""
            W, tau = self.regressor_at(at(state))
            A = np.concatenate([W, self.columns(linear, at(state), W, held["x"])], axis=-1)
            m = A.shape[-1]
            if with_derivatives:
                G = np.tensordot(held["weights"] ** 2, self.products(A, tau), 1)
                parameters = solve_normal_equations(G[:m, :m], G[:m, m])[0][: W.shape[-1]]
                A = np.concatenate([A, self.columns(free, at(state), W, parameters)], axis=-1)
            G = np.tensordot(held["weights"] ** 2, self.products(A, tau), 1)
            c, inverse = solve_normal_equations(G[:m, :m], G[:m, -1])
            S = G[m:, m:] - G[m:, :m] @ inverse @ G[:m, m:]
            values_, V = np.linalg.eigh(0.5 * (S + S.T))
            return np.sqrt(np.maximum(values_, 0.0))[:, None] * V.T, c, W

        def linearise(state: Array) -> Linearisation:
            factor = project_out_model(state, True)[0]
            return factor[:, -1], -factor[:, :-1]

        def cost(state: Array) -> float:
            factor = project_out_model(state, False)[0]
            return float(np.sum(factor**2))

        def renew(state: Array) -> None:
            held["x"], sigma = self.fit_model(terms, at(state))
            held["weights"] = 1.0 / sigma

        state = np.array([values[term] for term in free])
        largest = np.array([LARGEST_STEP[term.kind] for term in free])
        limits: dict[str, Any] = {"largest": largest, "steps": STEPS, "tries": TRIES, "small_gain": SETTLED}
        if free:
            state = search(state, linearise, cost=cost, after=renew, **limits).state
        if linear:
            c = project_out_model(state, False)[1]
            values |= dict(zip(linear, (float(v) for v in c[-len(linear) :]), strict=True))
        return at(state)

    def is_determined(self, G: Array, basis: Sequence[int], units: Sequence[float]) -> list[bool]:
        """Which of the last columns of weighted products ``G`` stand out of the space of the columns ``basis``.

        By more than LEAST of the torques, in ``units`` of their parameters. The torques are the measure, not the column
        itself: the zero of a first joint with a vertical axis is a column of rounding errors, which no other column
        explains.
        """
        torque = max(float(G[-1, -1]), np.finfo(float).tiny)
        basis = list(basis)
        inverse = solve_normal_equations(G[np.ix_(basis, basis)], G[basis, -1])[1] if basis else np.zeros((0, 0))
        flags = []
        for k, unit in enumerate(units, start=len(G) - 1 - len(units)):
            left = G[k, k] - G[k, basis] @ inverse @ G[basis, k]
            flags.append(bool(left * unit**2 > LEAST**2 * torque))
        return flags

    def zeros(self, term: Term, values: Mapping[Term, float], below: float = np.inf) -> list[float]:
        """Find up to three encoder zeros (rad) of the joint of ``term`` from which a fit may start.

        The model is fitted with zeros on a grid around the circle. Those with the smallest objective are returned, as
        far as it is below ``below``; ``values`` are those of the other nuisance parameters.
        """
        grid = np.arange(GRID, 2.0 * np.pi - 0.5 * GRID, GRID)
        levels = []
        for zero in grid:
            W, tau = self.regressor_at({**values, term: float(zero)})
            levels.append(self.objective(self.solve(self.products(W, tau))[1]))
        at = [k for k in np.argsort(levels)[:BEST_OF_GRID] if levels[k] < below]
        return [float((grid[k] + np.pi) % (2.0 * np.pi) - np.pi) for k in at]

    def deviations(self, values: Mapping[Term, float]) -> tuple[Array, Array]:
        """Standard deviations (k,) of the nuisance parameters ``values``, fitted with the model, and theta (p,).

        Residuals are taken as correlated in time, as those of the estimate of the robot.
        """
        terms = list(values)
        W, tau = self.regressor_at(values)
        x, sigma = self.fit_model(terms, values)
        A = np.concatenate([W, self.columns(terms, values, W, x)], axis=-1)
        rows = Rows(self.sample.t, A, tau, self.sample.use, self.sample.stretch)
        names = [str(k) for k in range(A.shape[-1])]
        estimate = least_squares(factor_rows(rows), names, 1.0 / sigma)
        lags = max(correlation_lags(white) for white in residual_whiteness([rows], estimate.x))
        covariance = correlated_covariance([rows], estimate, lags, lambda x: x, np.eye(len(names)))
        std = np.sqrt(np.maximum(np.diag(covariance), 0.0))
        return std[W.shape[-1] :], self.T @ x + self.known
