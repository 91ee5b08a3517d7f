"""Derivatives of inverse and forward dynamics against differences of the built-in Newton-Euler."""

# ruff: noqa: D102 -- the methods of the protocol are documented where they are implemented
from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol, runtime_checkable

import numpy as np

from rrrgen.verify.comparison import Collector, Tolerances, rate, size
from rrrgen.verify.references.chain import Array
from rrrgen.verify.references.newton_euler import NewtonEuler
from rrrgen.verify.subject import Parameters, States


@runtime_checkable
class Differentiable(Protocol):
    """A model with derivatives: (tau, dtau_dq, dtau_dv, M) and (ddq, dddq_dq, dddq_dv, dddq_dtau)."""

    def inverse_dynamics_derivatives(self, q: Array, dq: Array, ddq: Array, *, beta: Array | None = None) -> Any: ...
    def forward_dynamics_derivatives(self, q: Array, dq: Array, tau: Array, *, beta: Array | None = None) -> Any: ...


def check_derivatives(
    model: object, ne: NewtonEuler, parameters: Parameters, s: States, tolerances: Tolerances, rows: Collector
) -> None:
    """d tau by q, dq and ddq; the derivatives of ddq multiplied by M, so that the conditioning of M does not count."""
    if not isinstance(model, Differentiable):
        rows.skipped.append(("derivatives", "the model has no functions for them"))
        return
    beta = parameters.beta
    exact = rows.against(ne.name, parameters.label, tolerances.exact, s.count)
    close = rows.against(ne.name, parameters.label, tolerances.differenced, s.count)
    tau, M = ne.inverse_dynamics(s.q, s.dq, s.ddq), ne.mass_matrix(s.q)
    by_q = _slopes(lambda step: ne.inverse_dynamics(s.q + step, s.dq, s.ddq), s.q, tolerances.step)
    by_dq = _slopes(lambda step: ne.inverse_dynamics(s.q, s.dq + step, s.ddq), s.q, tolerances.step)
    scale = max(size(by_q), size(by_dq), size(tau))

    def inverse(k: int) -> Array:
        return np.asarray(model.inverse_dynamics_derivatives(s.q, s.dq, s.ddq, beta=beta)[k])

    exact("inverse_dynamics_derivatives: tau", lambda: inverse(0), tau)
    close("inverse_dynamics_derivatives: dtau_dq", lambda: inverse(1), by_q, scale=scale)
    close("inverse_dynamics_derivatives: dtau_dv", lambda: inverse(2), by_dq, scale=scale)
    exact("inverse_dynamics_derivatives: M", lambda: inverse(3), M)
    if np.any(np.linalg.eigvalsh(M)[:, 0] <= 0.0):
        reason = f"M(q) of the {parameters.label} parameters is not positive definite"
        rows.skipped.append(("forward_dynamics_derivatives", reason))
        return

    def forward(k: int) -> Array:
        return np.asarray(model.forward_dynamics_derivatives(s.q, s.dq, tau, beta=beta)[k])

    unit = np.broadcast_to(np.eye(s.q.shape[1]), M.shape)
    condition = size(M) * size(np.asarray(np.linalg.inv(M), dtype=float))
    close("forward_dynamics_derivatives: M dddq_dq", lambda: M @ forward(1), -by_q, scale=scale)
    close("forward_dynamics_derivatives: M dddq_dv", lambda: M @ forward(2), -by_dq, scale=scale)
    exact("forward_dynamics_derivatives: M dddq_dtau", lambda: M @ forward(3), unit, scale=condition)
    exact(
        "forward_dynamics_derivatives: ddq (as torque)",
        lambda: ne.inverse_dynamics(s.q, s.dq, forward(0)),
        tau,
        scale=size(tau) * max(1.0, condition / s.q.shape[1]),
    )


def _slopes(function: Callable[[Array], Array], like: Array, step: float) -> Array:
    """Derivatives (N, n, n) of a function (N, n) of a shift of all states."""

    def along(unit: Array) -> Array:
        return rate(lambda t: function(t * unit), step)

    return np.stack([along(unit) for unit in np.eye(like.shape[1])], axis=2)
