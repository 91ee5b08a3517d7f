"""Checks of the derivatives of inverse and forward dynamics by differences of the built-in Newton-Euler recursion."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np

from rrrgen.verify.comparison import Collector, Tolerances, rate, size
from rrrgen.verify.definiteness import check_refusal, is_definite
from rrrgen.verify.references.chain import Array
from rrrgen.verify.references.newton_euler import NewtonEuler
from rrrgen.verify.subject import Parameters, States

if TYPE_CHECKING:
    from rrrgen.runtime.model import Model


def check_derivatives(
    model: Model, ne: NewtonEuler, parameters: Parameters, s: States, tolerances: Tolerances, rows: Collector
) -> None:
    """Compare the derivatives of tau, and those of ddq multiplied by M.

    The factor M removes the amplification of errors where M is ill-conditioned.
    """
    _check_inverse(model, ne, parameters, s, tolerances, rows)
    M = ne.mass_matrix(s.q)
    definite = is_definite(M, tolerances)
    if np.any(definite):
        _check_forward(model, ne, parameters, s.at(definite), tolerances, rows)
    if not np.all(definite):
        check = rows.against(ne.name, parameters.label, tolerances.exact, s.count)
        check_refusal(
            "forward_dynamics_derivatives",
            check,
            lambda q, dq, tau: model.forward_dynamics_derivatives(q, dq, tau, beta=parameters.beta)[0],
            s.at(~definite),
            M[~definite],
        )


def _check_inverse(
    model: Model, ne: NewtonEuler, parameters: Parameters, s: States, tolerances: Tolerances, rows: Collector
) -> None:
    beta = parameters.beta
    exact = rows.against(ne.name, parameters.label, tolerances.exact, s.count)
    close = rows.against(ne.name, parameters.label, tolerances.differenced, s.count)
    tau, M, by_q, by_dq = _torques_and_derivatives(ne, s, tolerances.step)
    scale = max(size(by_q), size(by_dq), size(tau))

    @cache
    def answer() -> Any:
        return model.inverse_dynamics_derivatives(s.q, s.dq, s.ddq, beta=beta)

    exact("inverse_dynamics_derivatives: tau", lambda: answer()[0], tau)
    close("inverse_dynamics_derivatives: dtau_dq", lambda: answer()[1], by_q, scale=scale)
    close("inverse_dynamics_derivatives: dtau_dv", lambda: answer()[2], by_dq, scale=scale)
    exact("inverse_dynamics_derivatives: M", lambda: answer()[3], M)


def _check_forward(
    model: Model, ne: NewtonEuler, parameters: Parameters, s: States, tolerances: Tolerances, rows: Collector
) -> None:
    beta = parameters.beta
    exact = rows.against(ne.name, parameters.label, tolerances.exact, s.count)
    close = rows.against(ne.name, parameters.label, tolerances.differenced, s.count)
    tau, M, by_q, by_dq = _torques_and_derivatives(ne, s, tolerances.step)
    scale = max(size(by_q), size(by_dq), size(tau))

    @cache
    def answer() -> Any:
        return model.forward_dynamics_derivatives(s.q, s.dq, tau, beta=beta)

    unit = np.broadcast_to(np.eye(s.q.shape[1]), M.shape)
    condition = size(M) * size(np.asarray(np.linalg.inv(M), dtype=float))
    close("forward_dynamics_derivatives: M dddq_dq", lambda: M @ np.asarray(answer()[1]), -by_q, scale=scale)
    close("forward_dynamics_derivatives: M dddq_dv", lambda: M @ np.asarray(answer()[2]), -by_dq, scale=scale)
    exact("forward_dynamics_derivatives: M dddq_dtau", lambda: M @ np.asarray(answer()[3]), unit, scale=condition)
    exact(
        "forward_dynamics_derivatives: ddq (as torque)",
        lambda: ne.inverse_dynamics(s.q, s.dq, np.asarray(answer()[0])),
        tau,
        scale=size(tau) * max(1.0, condition / s.q.shape[1]),
    )


def _torques_and_derivatives(ne: NewtonEuler, s: States, step: float) -> tuple[Array, Array, Array, Array]:
    """The torques (N, n), the mass matrix, and the derivatives of the torques by q and dq, (N, n, n) each."""
    by_q = _derivatives_of(lambda shift: ne.inverse_dynamics(s.q + shift, s.dq, s.ddq), s.q, step)
    by_dq = _derivatives_of(lambda shift: ne.inverse_dynamics(s.q, s.dq + shift, s.ddq), s.q, step)
    return ne.inverse_dynamics(s.q, s.dq, s.ddq), ne.mass_matrix(s.q), by_q, by_dq


def _derivatives_of(function: Callable[[Array], Array], like: Array, step: float) -> Array:
    """The derivatives (N, n, n) of ``function``, which maps a shift of all states to values (N, n)."""

    def along(unit: Array) -> Array:
        return rate(lambda t: function(t * unit), step)

    return np.stack([along(unit) for unit in np.eye(like.shape[1])], axis=2)
