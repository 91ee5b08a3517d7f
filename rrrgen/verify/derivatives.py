"""Checks of the derivatives of inverse and forward dynamics by differences of the built-in Newton-Euler recursion."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rrrgen.verify.comparison import STENCIL, Collector, Tolerances, size
from rrrgen.verify.definiteness import check_refusal, is_definite
from rrrgen.verify.references.newton_euler import NewtonEuler
from rrrgen.verify.references.numeric_robot import Array
from rrrgen.verify.subject import Parameters, States

if TYPE_CHECKING:
    from rrrgen.runtime.model import Model


def check_derivatives(
    model: Model, ne: NewtonEuler, parameters: Parameters, s: States, tolerances: Tolerances, rows: Collector
) -> None:
    """Compare the derivatives of tau, and those of ddq multiplied by M.

    The factor M removes the amplification of errors where M is ill-conditioned.
    """
    known = _torques(ne, s, tolerances.step)
    _check_inverse(model, ne, parameters, s, known, tolerances, rows)
    definite = is_definite(known.M, tolerances)
    if np.any(definite):
        _check_forward(model, ne, parameters, s.at(definite), known.at(definite), tolerances, rows)
    if not np.all(definite):
        check = rows.against(ne.name, parameters.label, tolerances.exact, s.count)
        check_refusal(
            "forward_dynamics_derivatives",
            check,
            lambda q, dq, tau: model.forward_dynamics_derivatives(q, dq, tau, beta=parameters.beta)[0],
            s.at(~definite),
            known.M[~definite],
        )


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


def _check_inverse(
    model: Model,
    ne: NewtonEuler,
    parameters: Parameters,
    s: States,
    known: _Torques,
    tolerances: Tolerances,
    rows: Collector,
) -> None:
    beta = parameters.beta
    exact = rows.against(ne.name, parameters.label, tolerances.exact, s.count)
    close = rows.against(ne.name, parameters.label, tolerances.differenced, s.count)

    @cache
    def answer() -> Any:
        return model.inverse_dynamics_derivatives(s.q, s.dq, s.ddq, beta=beta)

    exact("inverse_dynamics_derivatives: tau", lambda: answer()[0], known.tau)
    close("inverse_dynamics_derivatives: dtau_dq", lambda: answer()[1], known.by_q, scale=known.scale)
    close("inverse_dynamics_derivatives: dtau_dv", lambda: answer()[2], known.by_dq, scale=known.scale)
    exact("inverse_dynamics_derivatives: M", lambda: answer()[3], known.M)


def _check_forward(
    model: Model,
    ne: NewtonEuler,
    parameters: Parameters,
    s: States,
    known: _Torques,
    tolerances: Tolerances,
    rows: Collector,
) -> None:
    beta, tau, M = parameters.beta, known.tau, known.M
    exact = rows.against(ne.name, parameters.label, tolerances.exact, s.count)
    close = rows.against(ne.name, parameters.label, tolerances.differenced, s.count)

    @cache
    def answer() -> Any:
        return model.forward_dynamics_derivatives(s.q, s.dq, tau, beta=beta)

    unit = np.broadcast_to(np.eye(s.q.shape[1]), M.shape)
    condition = size(M) * size(np.asarray(np.linalg.inv(M), dtype=float))
    scale = known.scale
    close("forward_dynamics_derivatives: M dddq_dq", lambda: M @ np.asarray(answer()[1]), -known.by_q, scale=scale)
    close("forward_dynamics_derivatives: M dddq_dv", lambda: M @ np.asarray(answer()[2]), -known.by_dq, scale=scale)
    exact("forward_dynamics_derivatives: M dddq_dtau", lambda: M @ np.asarray(answer()[3]), unit, scale=condition)
    exact(
        "forward_dynamics_derivatives: ddq (as torque)",
        lambda: ne.inverse_dynamics(s.q, s.dq, np.asarray(answer()[0])),
        tau,
        scale=size(tau) * max(1.0, condition / s.q.shape[1]),
    )
