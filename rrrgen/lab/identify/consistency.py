"""Physically consistent estimation: standard parameters whose pseudo-inertias (14.9) are positive definite.

``min |R [beta; theta] - z|^2 / s^2 + lambda sum_j D(P_j)``, ``beta = K phi``, subject to ``P_j(phi) > 0`` for every
link (a linear matrix inequality), and drive inertia, viscous and Coulomb friction not negative. The data enter by the
triangular factor [R z] of the weighted rows and the standard deviation s of their noise; theta are the drive
parameters. D is the entropic divergence from a prior P0, ``tr(P0^-1 P) - log det P``; it determines the parameters that
the torques do not (Wensing, Kim and Slotine 2018; Lee, Wensing and Park 2020).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rrrgen.base.arrays import Array
from rrrgen.base.errors import DerivationError, MissingExtraError
from rrrgen.derive.parameters.physical_links import Prior, pseudo_inertia
from rrrgen.lab.estimate.linear import scale_columns
from rrrgen.lab.estimate.regression import Estimate
from rrrgen.lab.estimate.tsqr import JointFactors
from rrrgen.lab.identify.parameters import Column
from rrrgen.lab.identify.regressor import RigidModel
from rrrgen.robot.spec import STANDARD, standard_names
from rrrgen.runtime.regressor_columns import drive_columns

ATTEMPTS = 3  # repetitions with a tenfold prior if the solver fails
AT_BOUND = 1e-3  # a drive parameter below this many (conditional) standard deviations lies on its bound of 0
TINY = 1e-9


class InconsistentEstimateError(DerivationError):
    """No physically consistent estimate was found: the least-squares estimate is too far from any."""


@dataclass(frozen=True)
class KnownParameters:
    """Known values of base and standard parameters: ``rows phi = values``, phi (10n,) the standard parameters.

    ``names`` (k,) are those of the parameters, ``rows`` (k, 10n) their linear combinations, ``values`` (k,) SI.
    """

    names: tuple[str, ...]
    rows: Array
    values: Array

    @classmethod
    def of(cls, model: RigidModel, base: Mapping[str, float], standard: Mapping[str, float]) -> KnownParameters:
        """Known ``base`` and ``standard`` parameters of ``model`` by name; names of neither are left out."""
        K = np.asarray(model.base_projection)
        unit = dict(zip(standard_names(K.shape[1] // len(STANDARD)), np.eye(K.shape[1]), strict=True))
        known = [(name, K[i], base[name]) for i, name in enumerate(model.base_parameter_names) if name in base]
        known += [(name, unit[name], value) for name, value in standard.items() if name in unit]
        rows = np.array([row for _, row, _ in known]).reshape(len(known), K.shape[1])
        return cls(tuple(name for name, _, _ in known), rows, np.array([value for _, _, value in known], float))

    def in_words(self) -> str:
        """The names with their values, such as ``m4 = 2.5, hx2R = 4.05``."""
        return ", ".join(f"{name} = {value:g}" for name, value in zip(self.names, self.values, strict=True))


@dataclass(frozen=True)
class Neighbourhood:
    """Second-order model of the objective about the estimate, in r free coordinates, for the covariance.

    Parameters that lie at a bound or have a known value are not among these coordinates.
    ``directions`` (p, r) maps these coordinates to the parameters of the columns; ``curvature`` (r, r) is the Hessian
    of half the objective, ``pull`` (r, r) the contribution of the prior to it.
    """

    directions: Array
    curvature: Array
    pull: Array

    def covariance(self, directions: Array, scores: Array, noise: float = 1.0) -> Array:
        """Covariance (k, k) by the delta method: ``D H^-1 (D' S D + v P) H^-1 D'``.

        D is ``directions`` (k, r), the derivative of k parameters with respect to the free coordinates; H is the
        curvature. ``scores`` S (k, k) is the covariance of the gradient of the data term, correlated residuals
        included. The prior P counts as an observation with the variance ``noise`` v of a weighted row, and so
        determines the covariance of parameters on which the data carry no information.
        """
        step = np.linalg.solve(self.curvature, directions.T)
        return np.asarray(step.T @ (directions.T @ scores @ directions + noise * self.pull) @ step)


@dataclass(frozen=True)
class ConsistentEstimate:
    """A physically consistent estimate.

    - ``phi`` (10n,): standard parameters; ``beta = K phi`` (b,): base parameters; ``drives``: drive parameters by name.
    - ``theta`` (p,), ``names``: values and names of the parameters of all regressor columns: base parameters, drives.
    - ``eigenvalues`` (n,): smallest eigenvalue of each pseudo-inertia, scaled by the prior.
    - ``relative_error``, ``joint_rms`` (n,): torque errors on the scored rows.
    - ``loss``: relative rise of the weighted residual sum of squares over the unconstrained estimate.
    - ``facts``: solver, status and final weight of the prior; ``near``: second-order model of the objective.
    """

    phi: Array
    beta: Array
    theta: Array
    names: tuple[str, ...]
    drives: dict[str, float]
    eigenvalues: Array
    relative_error: float
    joint_rms: Array
    loss: float
    facts: dict[str, Any] = field(default_factory=dict)
    near: Neighbourhood | None = field(default=None, repr=False, compare=False)


def parameters_of(J: Array) -> Array:
    """Standard parameters (..., 10) of pseudo-inertias (..., 4, 4), the inverse of :func:`pseudo_inertia`."""
    xx, yy, zz = J[..., 0, 0], J[..., 1, 1], J[..., 2, 2]
    entries = [
        J[..., 3, 3],
        J[..., 0, 3],
        J[..., 1, 3],
        J[..., 2, 3],
        yy + zz,
        -J[..., 0, 1],
        xx + zz,
        -J[..., 0, 2],
        -J[..., 1, 2],
        xx + yy,
    ]
    return np.stack(entries, axis=-1)


def consistent_estimate(
    model: RigidModel,
    factors: JointFactors,
    columns: Sequence[Column],
    weights: Array,
    prior: Prior,
    reference: Estimate | None = None,
    known: KnownParameters | None = None,
    scored: JointFactors | None = None,
) -> ConsistentEstimate:
    """Estimate physically consistent parameters: least squares with positive definite pseudo-inertias of all links.

    ``factors`` are the triangular factors of the rows, whose columns are ``columns``; ``prior`` is that of the
    pseudo-inertias.
    ``weights`` (n,) are those of the joints, ``1 / sigma_j``, which make the noise of all rows equal; ``reference`` is
    the unconstrained estimate to which the residual is compared; ``known`` are base and standard parameters to keep at
    known values; ``scored`` are the rows on which errors are reported if they differ from the fitted ones, as in robust
    estimation. Raises :class:`InconsistentEstimateError` if the solver fails, or no body has the known values.
    """
    b, n = model.base_projection.shape[0], len(prior.P0)
    R = factors.stack(weights)
    program = _Program(R, np.asarray(model.base_projection), columns, prior, known or KnownParameters.of(model, {}, {}))
    phi, drives, facts, near = program.solve()
    beta = np.asarray(model.base_projection) @ phi
    theta = np.concatenate([beta, drives])
    rows = scored or factors
    squares = rows.residual_squares(theta)
    chi = float(np.sum(factors.residual_squares(theta) * weights**2))
    scale = np.stack([np.linalg.inv(np.linalg.cholesky(P)) for P in prior.P0])
    J = pseudo_inertia(phi.reshape(n, 10))
    loss = 0.0
    if reference is not None:
        best = chi if scored else float(np.sum(factors.counts * reference.joint_rms**2 * weights**2))
        loss = chi / best - 1.0 if best > 0 else 0.0
    return ConsistentEstimate(
        phi=phi,
        beta=beta,
        theta=theta,
        names=tuple(column.name for column in columns),
        drives={column.name: float(value) for column, value in zip(columns[b:], drives, strict=True)},
        eigenvalues=np.linalg.eigvalsh(scale @ J @ np.swapaxes(scale, -1, -2))[:, 0],
        relative_error=float(np.sqrt(np.sum(squares) / np.sum(rows.torque_squares))),
        joint_rms=np.sqrt(squares / np.maximum(1, rows.counts)),
        loss=loss,
        facts=facts,
        near=near,
    )


class _Program:
    """The semidefinite program of the physically consistent estimate.

    Its variables are the pseudo-inertias X scaled by the prior, ``P = L X L'`` with ``P0 = L L'``, and the drive
    parameters. ``known`` are equalities of the standard parameters.
    """

    def __init__(self, R: Array, K: Array, columns: Sequence[Column], prior: Prior, known: KnownParameters) -> None:
        self.L = np.linalg.cholesky(prior.P0)
        b, n = K.shape[0], len(prior.P0)
        self.K = K
        # x holds the ten upper entries of every scaled pseudo-inertia X
        upper = np.triu_indices(4)
        basis = np.zeros((10, 4, 4))
        basis[np.arange(10), upper[0], upper[1]] = basis[np.arange(10), upper[1], upper[0]] = 1.0
        self.to_phi = np.zeros((10 * n, 10 * n))
        for j, L in enumerate(self.L):
            J = L @ basis @ L.T
            self.to_phi[10 * j : 10 * j + 10, 10 * j : 10 * j + 10] = parameters_of(J).T
        drives = columns[b:]
        drive_columns, size = scale_columns(R[:, b:-1])
        self.drive_size = 1.0 / size
        A = np.column_stack([R[:, :b] @ K @ self.to_phi, drive_columns])
        # only the triangular factor of the (possibly rank-deficient) problem enters the solver
        self.A, self.z = _reduce_rows(A, R[:, -1])
        self.known = known
        rows = known.rows @ self.to_phi
        size = np.linalg.norm(rows, axis=1)
        self.held, self.held_at = rows / size[:, None], known.values / size
        self.bounded = [10 * n + i for i, column in enumerate(drives) if column.is_non_negative]
        self.free = [10 * n + i for i, column in enumerate(drives) if not column.is_non_negative]
        self.n, self.basis, self.strength = n, basis, prior.strength

    def solve(self) -> tuple[Array, Array, dict[str, Any], Neighbourhood]:
        """Solve the program; returns phi (10n,), the drive parameters, facts on the solution, its second-order model.

        If the least-squares estimate is far from physical, a very weak prior makes the problem too ill-conditioned for
        the solver; the prior is then strengthened tenfold and the problem solved again. The facts state the weight
        used.
        """
        strength = self.strength
        for _ in range(1 + ATTEMPTS):
            x, status = self._attempt(strength)
            if x is not None:
                drives = x[10 * self.n :] * self.drive_size
                facts = {"solver": "CLARABEL", "strength": strength, "status": status}
                return self.to_phi @ x[: 10 * self.n], drives, facts, self._near(x, strength)
            strength *= 10.0
        if self.known.names and self._largest_margin() < TINY**0.5:
            raise InconsistentEstimateError(f"no arm that can be built has {self.known.in_words()}")
        reported = status.partition(". ")[0]
        given = f" with {self.known.in_words()}" if self.known.names else ""
        raise InconsistentEstimateError(
            f"no arm that can be built{given} is near the least-squares estimate: the solver reports '{reported}'"
        )

    def _near(self, x: Array, strength: float) -> Neighbourhood:
        """Second-order model of the objective at the solution ``x``, for the covariance.

        The Hessian of ``-log det X`` has the entries ``tr(X^-1 E_k X^-1 E_l)``, with E_k the derivative of X by x_k.
        """
        m = len(x)
        pull = np.zeros((m, m))
        for j in range(self.n):
            part = slice(10 * j, 10 * j + 10)
            inverse = np.linalg.inv(np.tensordot(x[part], self.basis, 1))
            moved = inverse @ self.basis
            pull[part, part] = 0.5 * strength * np.einsum("kab,lba->kl", moved, moved)
        held = [i for i in self.bounded if x[i] < AT_BOUND]
        rows = np.concatenate([self.held @ np.eye(10 * self.n, m), np.eye(m)[held]])
        Z = _null_space(rows) if len(rows) else np.eye(m)
        back = np.zeros((m, m))
        back[: 10 * self.n, : 10 * self.n] = self.to_phi
        back[10 * self.n :, 10 * self.n :] = np.diag(self.drive_size)
        to_columns = np.zeros((self.K.shape[0] + m - 10 * self.n, m))
        to_columns[: self.K.shape[0]] = self.K @ back[: 10 * self.n]
        to_columns[self.K.shape[0] :] = back[10 * self.n :]
        # unbounded drive parameters have no prior except the small term that makes the solution unique
        curvature = self.A.T @ self.A + pull
        return Neighbourhood(to_columns @ Z, Z.T @ curvature @ Z + TINY * np.eye(Z.shape[1]), Z.T @ pull @ Z)

    def _attempt(self, strength: float) -> tuple[Array | None, str]:
        cp = _cvxpy()
        x = cp.Variable(self.A.shape[1])
        penalty: Any = 0.0
        constraints: list[Any] = []
        upper = list(zip(*np.triu_indices(4), strict=True))
        for j in range(self.n):
            X = cp.Variable((4, 4), symmetric=True)
            constraints.append(x[10 * j : 10 * j + 10] == cp.hstack([X[i, k] for i, k in upper]))
            penalty = penalty + cp.trace(X) - cp.log_det(X)
        if self.bounded:
            constraints.append(x[self.bounded] >= 0)
        if len(self.held):
            constraints.append(self.held @ x[: 10 * self.n] == self.held_at)
        # a small quadratic term makes unbounded parameters unique that the data do not determine
        if self.free:
            penalty = penalty + 1e-9 * cp.sum_squares(x[self.free])
        problem = cp.Problem(cp.Minimize(cp.sum_squares(self.A @ x - self.z) + strength * penalty), constraints)
        try:
            problem.solve(solver=cp.CLARABEL)
        except cp.SolverError as error:
            return None, str(error)
        if x.value is None or problem.status not in (cp.OPTIMAL, cp.OPTIMAL_INACCURATE):
            return None, str(problem.status)
        values = np.asarray(x.value, float)
        values[self.bounded] = np.maximum(values[self.bounded], 0.0)
        return self._hold(values), str(problem.status)

    def _largest_margin(self) -> float:
        """Largest possible smallest eigenvalue, up to 1, of the scaled pseudo-inertias with the known values.

        It is negative or zero exactly if no bodies have them, whatever the torques. The status of the solver does not
        tell: it also calls ill-conditioned problems infeasible.
        """
        cp = _cvxpy()
        x, margin = cp.Variable(10 * self.n), cp.Variable()
        upper = list(zip(*np.triu_indices(4), strict=True))
        constraints: list[Any] = [margin <= 1.0, self.held @ x == self.held_at]
        for j in range(self.n):
            X = cp.Variable((4, 4), symmetric=True)
            constraints.append(x[10 * j : 10 * j + 10] == cp.hstack([X[i, k] for i, k in upper]))
            constraints.append(X - margin * np.eye(4) >> 0)
        try:
            cp.Problem(cp.Maximize(margin), constraints).solve(solver=cp.CLARABEL)
        except cp.SolverError:
            return 1.0
        return 1.0 if margin.value is None else float(margin.value)

    def _hold(self, x: Array) -> Array:
        """The nearest ``x`` that has the known values to rounding, which the solver keeps to its tolerance only.

        ``x`` itself where this small step would leave the cone of possible bodies.
        """
        bodies = slice(10 * self.n)
        moved = x.copy()
        moved[bodies] += np.linalg.pinv(self.held) @ (self.held_at - self.held @ x[bodies])
        X = np.tensordot(moved[bodies].reshape(self.n, 10), self.basis, 1)
        return moved if np.all(np.linalg.eigvalsh(X)[:, 0] > 0.0) else x


def _null_space(rows: Array) -> Array:
    """Orthonormal basis of the null space of ``rows`` (m, k), as columns."""
    _, s, Vt = np.linalg.svd(rows)
    return np.asarray(Vt[int(np.sum(s > TINY * s[0])) :].T)


def _cvxpy() -> Any:
    try:
        return import_module("cvxpy")
    except ImportError:
        raise MissingExtraError("a physically consistent estimate", "cvxpy", "identify") from None


def _reduce_rows(A: Array, z: Array) -> tuple[Array, Array]:
    """An equivalent least-squares problem (same normal equations) with at most as many rows as columns."""
    U, s, Vt = np.linalg.svd(A, full_matrices=False)
    kept = s > 1e-13 * s[0]
    return s[kept, None] * Vt[kept], np.asarray(U[:, kept].T @ z)


# ------------------------------------------------------------------------------------------------------------------
# Tests whether an estimated mass matrix is positive definite, as simulation and computed torque require.
# ------------------------------------------------------------------------------------------------------------------

POSES = 10_000


def mass_matrix(model: RigidModel, columns: Sequence[Column], theta: Array, q: Array) -> Array:
    """Mass matrix M(q) (N, n, n), kg m^2 (kg), from the parameters ``theta`` (p,) of all ``columns``, at ``q`` (N, n).

    Column k is the torque at rest for unit acceleration of joint k alone, minus that for ddq = 0; drive inertia is
    included.
    """
    n, b = model.n, len(model.base_parameter_names)
    M = np.empty((*q.shape, n))
    inertia = [column for column in columns if column.kind == "inertia"]
    values = np.array([theta[i] for i, column in enumerate(columns) if column.kind == "inertia"])
    for start in range(0, len(q), 1000):
        part = q[start : start + 1000]
        rest = np.zeros_like(part)
        still = np.asarray(model.regressor(part, rest, rest)) @ theta[:b]
        for k in range(n):
            ddq = rest + np.eye(n)[k]
            torque = np.asarray(model.regressor(part, rest, ddq)) @ theta[:b] - still
            if inertia:
                torque = torque + drive_columns(inertia, rest, ddq) @ values
            M[start : start + 1000, :, k] = torque
    return M


def pose_limits(spec: Any, n: int) -> Array:
    """Lowest and highest joint positions (2, n), rad (m): limits of the robot file, +-pi (+-1 m) where it has none."""
    bounds = []
    for joint in spec.joints if spec is not None else [None] * n:
        limits = getattr(joint, "limits", None)
        reach = np.pi if joint is None or joint.is_revolute else 1.0
        lower = reach * -1.0 if limits is None or limits.lower is None else limits.lower
        upper = reach if limits is None or limits.upper is None else limits.upper
        bounds.append((lower, upper))
    return np.array(bounds).T


def indefinite_share(
    mass: Callable[[Array], Array],
    lower: Array,
    upper: Array,
    poses: int = POSES,
    seed: int = 0,
    possible: Callable[[Array], NDArray[np.bool_]] | None = None,
) -> tuple[float, float]:
    """Share of random poses at which M(q) is not positive definite, and the smallest ratio of extreme eigenvalues.

    ``mass(q)`` maps poses (N, n) to matrices (N, n, n); the ``poses`` are uniform between ``lower`` and ``upper`` (n,).
    Those that closed loops cannot take, by the mask (N,) ``possible(q)``, do not count; NaN if there are no others.
    """
    q = np.random.default_rng(seed).uniform(lower, upper, (poses, len(lower)))
    q = q if possible is None else q[possible(q)]
    if not len(q):
        return float("nan"), float("nan")
    M = np.asarray(mass(q))
    values = np.linalg.eigvalsh(0.5 * (M + np.swapaxes(M, -1, -2)))
    bad: NDArray[np.bool_] = values[:, 0] <= 0.0
    return float(np.mean(bad)), float(np.min(values[:, 0] / np.maximum(values[:, -1], 1e-300)))
