"""Checks of identities of mechanics that the functions of a model must satisfy among themselves."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rrrgen.verify.references.newton_euler import NewtonEuler
from rrrgen.verify.references.numeric_robot import Array, centre_and_tensor
from rrrgen.verify.report import STENCIL, Check, Collector, Row, Tolerances, curvature, curvature_scale, rate, size
from rrrgen.verify.subject import Case, States, random_parameters

if TYPE_CHECKING:
    from rrrgen.runtime.model import Model


# ------------------------------------------------------------------------------------------------------------------
# Check that forward dynamics reports a mass matrix that is not positive definite.
# ------------------------------------------------------------------------------------------------------------------

ASKED = 5  # states with an indefinite M at which the model is evaluated, one by one
INDEFINITE = 1e-3
"""M counts as indefinite if an eigenvalue is below minus this fraction of the largest. Closer to zero M is nearly
singular, and round-off decides whether an error is raised."""


def is_definite(M: Array, tolerances: Tolerances) -> NDArray[np.bool_]:
    """Mask (N,) of the states where M (N, n, n) is positive definite by more than round-off."""
    eigenvalues = np.linalg.eigvalsh(M)
    return np.asarray(eigenvalues[:, 0] > 0.1 * tolerances.exact * np.abs(eigenvalues[:, -1]), dtype=bool)


Ask = Callable[[Array, Array, Array], Array]


def check_refusal(function: str, check: Check, ask: Ask, s: States, M: Array) -> None:
    """Check that forward dynamics ``ask(q, dq, tau)`` raises an error at states where M (N, n, n) is indefinite.

    Where M is singular within round-off, it may raise the error or return finite accelerations.
    """

    def wrong() -> Array:
        return np.array([_answers_wrongly(ask, s, M, k) for k in range(min(ASKED, s.count))], dtype=np.float64)

    check(f"{function} refuses an indefinite M", wrong, np.zeros(min(ASKED, s.count)), scale=1.0)


def _answers_wrongly(ask: Ask, s: States, M: Array, k: int) -> bool:
    eigenvalues = np.linalg.eigvalsh(M[k])
    try:
        ddq = ask(s.q[k : k + 1], s.dq[k : k + 1], np.ones_like(s.q[k : k + 1]))
    except (np.linalg.LinAlgError, ArithmeticError):
        return False
    indefinite = eigenvalues[0] < -INDEFINITE * np.max(np.abs(eigenvalues))
    return bool(indefinite) or not np.all(np.isfinite(ddq))


# ------------------------------------------------------------------------------------------------------------------
# Checks of the derivatives of inverse and forward dynamics by differences of the built-in Newton-Euler recursion.
# ------------------------------------------------------------------------------------------------------------------


def check_derivatives(case: Case) -> None:
    """Compare the derivatives of tau, and those of ddq multiplied by M.

    The factor M removes the amplification of errors where M is ill-conditioned.
    """
    known = _torques(case.ne, case.s, case.tolerances.step)
    _check_inverse(case, known)
    definite = is_definite(known.M, case.tolerances)
    if np.any(definite):
        _check_forward(case.at(definite), known.at(definite))
    if not np.all(definite):
        check_refusal(
            "forward_dynamics_derivatives",
            case.exact,
            lambda q, dq, tau: case.model.forward_dynamics_derivatives(q, dq, tau, beta=case.beta)[0],
            case.s.at(~definite),
            known.M[~definite],
        )


SECOND_STEP = 0.02
"""Step of second differences along unit vectors: errors of rounding and of truncation are about equal."""


@dataclass(frozen=True)
class _Torques:
    """The torques ``tau`` (N, n), their derivatives ``by_q`` and ``by_dq``, and the mass matrix ``M``, (N, n, n)."""

    tau: Array
    by_q: Array
    by_dq: Array
    M: Array

    @property
    def scale(self) -> float:
        """The largest magnitude of the torques and their derivatives."""
        return max(size(self.by_q), size(self.by_dq), size(self.tau))

    def at(self, chosen: NDArray[np.bool_]) -> _Torques:
        """The values at the states for which the mask ``chosen`` (N,) is true."""
        return _Torques(self.tau[chosen], self.by_q[chosen], self.by_dq[chosen], self.M[chosen])


def _torques(ne: NewtonEuler, s: States, step: float) -> _Torques:
    """Compute the torques, their derivatives by central differences, and the mass matrix."""
    by_q = _derivatives_of(lambda shift: ne.inverse_dynamics(*_batch(s.q + shift, s.dq, s.ddq)), s, step)
    by_dq = _derivatives_of(lambda shift: ne.inverse_dynamics(*_batch(s.q, s.dq + shift, s.ddq)), s, step)
    return _Torques(ne.inverse_dynamics(s.q, s.dq, s.ddq), by_q, by_dq, ne.mass_matrix(s.q))


def _derivatives_of(function: Callable[[Array], Array], s: States, step: float) -> Array:
    """The derivatives (N, n, n) of values (N, n) by what is shifted, by eighth-order central differences.

    ``function`` maps all shifts (m, 1, n) of the states together to their values (m N, n): the recursion spends most of
    its time on the way from one operation to the next, however many states take part.
    """
    count, n = s.q.shape
    places = step * np.array([(k, -k) for k, _ in STENCIL])
    shifts = places[..., None, None] * np.eye(n)
    values = function(shifts.reshape(-1, 1, n)).reshape(*places.shape, n, count, n)
    slopes = sum(w * (ahead - behind) for (_, w), (ahead, behind) in zip(STENCIL, values, strict=True))
    return np.moveaxis(np.asarray(slopes / step), 0, 2)


def _batch(*parts: Array) -> list[Array]:
    """The ``parts``, broadcast to a common shape (..., n), as batches of states (N, n)."""
    return [part.reshape(-1, part.shape[-1]) for part in np.broadcast_arrays(*parts)]


def _check_inverse(case: Case, known: _Torques) -> None:
    s, exact, close = case.s, case.exact, case.close

    @cache
    def answer() -> Any:
        return case.model.inverse_dynamics_derivatives(s.q, s.dq, s.ddq, beta=case.beta)

    exact("inverse_dynamics_derivatives: tau", lambda: answer()[0], known.tau)
    close("inverse_dynamics_derivatives: dtau_dq", lambda: answer()[1], known.by_q, scale=known.scale)
    close("inverse_dynamics_derivatives: dtau_dv", lambda: answer()[2], known.by_dq, scale=known.scale)
    exact("inverse_dynamics_derivatives: M", lambda: answer()[3], known.M)


def _check_forward(case: Case, known: _Torques) -> None:
    s, exact, close, tau, M = case.s, case.exact, case.close, known.tau, known.M

    @cache
    def answer() -> Any:
        return case.model.forward_dynamics_derivatives(s.q, s.dq, tau, beta=case.beta)

    unit = np.broadcast_to(np.eye(s.q.shape[1]), M.shape)
    condition = size(M) * size(np.asarray(np.linalg.inv(M), dtype=float))
    scale = known.scale
    close("forward_dynamics_derivatives: M dddq_dq", lambda: M @ np.asarray(answer()[1]), -known.by_q, scale=scale)
    close("forward_dynamics_derivatives: M dddq_dv", lambda: M @ np.asarray(answer()[2]), -known.by_dq, scale=scale)
    exact("forward_dynamics_derivatives: M dddq_dtau", lambda: M @ np.asarray(answer()[3]), unit, scale=condition)
    exact(
        "forward_dynamics_derivatives: ddq (as torque)",
        lambda: case.ne.inverse_dynamics(s.q, s.dq, np.asarray(answer()[0])),
        tau,
        scale=size(tau) * max(1.0, condition / s.q.shape[1]),
    )


def check_second_derivatives(case: Case) -> None:
    """Compare second derivatives along one random direction of (q, dq, ddq) at each state with second differences.

    The quadratic form of a symmetric matrix with a random vector has all its elements. Forward dynamics is weighted
    with ``M w``, as in :func:`check_derivatives`. Along (q, dq, tau) + t (vq, vv, vt) the accelerations begin to change
    by a = inv(M) (vt - dtau/dt), where the rate of the torques is that for constant ddq, and then
    ``w' M d2(ddq)/dt2 = -w' d2(tau)/dt2`` for ddq + t a.
    """
    model, ne, s, beta, close = case.model, case.ne, case.s, case.beta, case.close
    w, (count, n) = s.e, s.q.shape
    direction = np.random.default_rng(count).normal(size=(count, 3 * n))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    vq, vv, last = np.split(direction, 3, axis=1)

    def torques(t: float, rate_of_ddq: Array) -> Array:
        return ne.inverse_dynamics(s.q + t * vq, s.dq + t * vv, s.ddq + t * rate_of_ddq)

    def dot(x: Array, y: Array) -> Array:
        return np.asarray(np.einsum("ki,ki->k", x, y))

    def quadratic(H: Array) -> Array:
        return np.asarray(np.einsum("ki,kij,kj->k", direction, H, direction))

    @cache
    def answer() -> Any:
        return model.inverse_dynamics_hessian(s.q, s.dq, s.ddq, w, beta=beta)

    def slopes() -> Array:
        return np.asarray(model.mass_matrix_derivatives(s.q, beta=beta))

    def product() -> Array:
        return model.inverse_dynamics_hessian_product(s.q, s.dq, s.ddq, w, direction, beta=beta)

    first = dot(w, rate(lambda t: torques(t, last), SECOND_STEP))
    second = dot(w, curvature(lambda t: torques(t, last), SECOND_STEP))
    turning = rate(lambda t: ne.mass_matrix(s.q + t * vq), SECOND_STEP)
    close("inverse_dynamics_hessian: gradient' v", lambda: dot(answer()[0], direction), first)
    scale = curvature_scale(second, dot(w, torques(0.0, last)))
    close("inverse_dynamics_hessian: v' H v", lambda: quadratic(answer()[1]), second, scale=scale)
    close("inverse_dynamics_hessian_product: v' H v", lambda: dot(product(), direction), second, scale=scale)
    close("mass_matrix_derivatives: dM/dq vq", lambda: slopes() @ vq[:, None, :, None], turning[..., None])
    M = ne.mass_matrix(s.q)
    if not np.all(is_definite(M, case.tolerances)):
        return
    still = rate(lambda t: torques(t, np.zeros_like(last)), SECOND_STEP)
    turned = np.asarray(np.linalg.solve(M, (last - still)[..., None])[..., 0], dtype=float)
    expected = -dot(w, curvature(lambda t: torques(t, turned), SECOND_STEP))
    tau, weights = torques(0.0, last), np.einsum("kij,kj->ki", M, w)
    close(
        "forward_dynamics_hessian: v' H v",
        lambda: quadratic(model.forward_dynamics_hessian(s.q, s.dq, tau, weights, beta=beta)[1]),
        expected,
        scale=curvature_scale(expected, dot(w, tau)),
    )


# ------------------------------------------------------------------------------------------------------------------
# Checks of identities of mechanics that the functions of a model must satisfy among themselves
# ------------------------------------------------------------------------------------------------------------------

SELF = "identity"


@dataclass(frozen=True)
class _ModelTerms:
    """The torque (N, n), mass matrix and Coriolis matrix (N, n, n) that the model computes at the states."""

    tau: Array
    M: Array
    C: Array


def check_identities(case: Case) -> None:
    """Check identities between the functions of the model at the states ``s``.

    They are ``tau = M ddq + C dq + g = Y beta + Ia ddq``, ``M = M' > 0``, the product C' dq, the skew symmetry of
    ``dM/dt - 2 C``, and the power balance ``dE/dt = tau' dq``.
    """
    model, s, beta = case.model, case.s, case.beta
    try:
        terms = _ModelTerms(
            np.asarray(model.inverse_dynamics(s.q, s.dq, s.ddq, beta=beta)),
            np.asarray(model.mass_matrix(s.q, beta=beta)),
            np.asarray(model.coriolis_matrix(s.q, s.dq, beta=beta)),
        )
    except Exception as error:  # an identity with a function that fails does not hold
        note = f"the model gave no torque, M or C: {type(error).__name__}: {error}"
        label, limit = case.parameters.label, case.tolerances.exact
        case.rows.rows.append(Row("identities", SELF, label, s.count, float("inf"), limit, note))
        return
    _check_sums(case, terms)
    _check_rates(case, terms)


def _check_sums(case: Case, terms: _ModelTerms) -> None:
    """Check the identities that contain no time derivative."""
    model, s, beta = case.model, case.s, case.beta
    check = case.against(SELF, case.tolerances.exact)
    inertial = np.einsum("nij,nj->ni", terms.M, s.ddq) + np.einsum("nij,nj->ni", terms.C, s.dq)

    def from_regressor() -> Array:
        base = np.asarray(model.beta if beta is None else beta)
        return np.asarray(np.asarray(model.regressor(s.q, s.dq, s.ddq)) @ base + s.ddq @ case.ne.chain.drive_inertia)

    def round_trip() -> Array:
        ddq = model.forward_dynamics(s.q, s.dq, terms.tau, beta=beta)
        return np.asarray(np.einsum("nij,nj->ni", terms.M, np.asarray(ddq) - s.ddq))

    check("tau = M ddq + C dq + g", lambda: inertial + np.asarray(model.gravity(s.q, beta=beta)), terms.tau)
    check("tau = Y beta + Ia ddq", from_regressor, terms.tau)
    check("M = M'", lambda: np.swapaxes(terms.M, 1, 2), terms.M)
    check(
        "coriolis_transpose = C' dq",
        lambda: model.coriolis_transpose(s.q, s.dq, beta=beta),
        np.einsum("nji,nj->ni", terms.C, s.dq),
        scale=max(size(terms.tau), size(terms.C) * size(s.dq)),
    )
    if case.parameters.physical:
        indefinite = np.mean(np.linalg.eigvalsh(0.5 * (terms.M + np.swapaxes(terms.M, 1, 2)))[:, 0] <= 0.0)
        check("M > 0 (share of states where not)", lambda: np.asarray(indefinite), np.zeros(()), scale=1.0)
        check("M (forward(inverse) - ddq) = 0", round_trip, np.zeros_like(s.q), scale=size(terms.tau))


def _check_rates(case: Case, terms: _ModelTerms) -> None:
    """Check that dM/dt - 2C is skew-symmetric and that the energy changes by the power: d(K + U)/dt = tau . dq.

    Time derivatives are differences along the motion q + t dq, dq + t ddq at t = 0.
    """
    model, s, beta, step = case.model, case.s, case.beta, case.tolerances.step
    check = case.against(SELF, case.tolerances.differenced)

    def skew() -> Array:
        M_dot = rate(lambda t: np.asarray(model.mass_matrix(s.q + t * s.dq, beta=beta)), step)
        S = M_dot - 2.0 * terms.C
        return S + np.swapaxes(S, 1, 2)

    def total(t: float) -> Array:
        kinetic, potential = model.energy(s.q + t * s.dq, s.dq + t * s.ddq, beta=beta)
        return np.asarray(kinetic + potential)

    check("dM/dt - 2C skew", skew, np.zeros_like(terms.C), scale=size(terms.M) * size(s.dq))
    power = terms.tau * s.dq
    check("d(K + U)/dt = tau.dq", lambda: rate(total, step), np.sum(power, axis=1), scale=size(power))


# ------------------------------------------------------------------------------------------------------------------
# Checks of base parameters and payloads: the torques that they cause are compared with those of the reference.
# ------------------------------------------------------------------------------------------------------------------


def check_parameters(
    model: Model, ne: NewtonEuler, s: States, rng: np.random.Generator, tolerances: Tolerances, rows: Collector
) -> None:
    """Compare the torques of random link parameters, and those that random payloads add, at the states ``s``."""
    check = rows.against(ne.name, "-", tolerances.exact, s.count)
    Y, n = ne.standard_regressor(s.q, s.dq, s.ddq), ne.chain.links
    phi = np.stack([random_parameters(n, rng).ravel() for _ in range(s.count)])

    def torques(beta: Array) -> Array:
        return np.asarray(np.einsum("nij,nj->ni", model.regressor(s.q, s.dq, s.ddq), beta))

    check("base_parameters", lambda: torques(model.base_parameters_of(phi)), np.einsum("nij,nj->ni", Y, phi))
    bodies = random_parameters(s.count, rng)
    added = np.einsum("nij,nj->ni", Y[:, :, 10 * ne.chain.tip : 10 * ne.chain.tip + 10], bodies)
    mass = bodies[:, 0]
    centres = [centre_and_tensor(row) for row in bodies]
    com, tensors = (np.stack(part) for part in zip(*centres, strict=True))
    R, p = np.stack([_rotation(rng) for _ in range(s.count)]), rng.uniform(-0.3, 0.3, (s.count, 3))
    frame = np.zeros((s.count, 4, 4))
    frame[:, :3, :3], frame[:, :3, 3], frame[:, 3, 3] = R, p, 1.0
    com_in_frame = np.einsum("nji,nj->ni", R, com - p)
    tensors_in_frame = np.einsum("nki,nkl,nlj->nij", R, tensors, R)

    def bare() -> Array:
        return np.asarray(model.base_parameters_of(np.zeros((s.count, 10 * n)))[0])

    check("add_payload", lambda: torques(model.add_payload(mass, com, tensors, beta=bare())), added)
    check(
        "add_payload_at",
        lambda: torques(model.add_payload_at(mass, com_in_frame, tensors_in_frame, frame, beta=bare())),
        added,
    )


def _rotation(rng: np.random.Generator) -> Array:
    """Draw a random rotation matrix (3, 3)."""
    Q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    return np.asarray(Q * np.sign(np.linalg.det(Q)))
