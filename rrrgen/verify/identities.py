"""Checks of identities of mechanics that the functions of a model must satisfy among themselves."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from rrrgen.verify.comparison import Collector, Tolerances, rate, size
from rrrgen.verify.references.numeric_robot import Array, Chain
from rrrgen.verify.report import Row
from rrrgen.verify.subject import Parameters, States

if TYPE_CHECKING:
    from rrrgen.runtime.model import Model

SELF = "identity"


@dataclass(frozen=True)
class _ModelTerms:
    """The torque (N, n), mass matrix and Coriolis matrix (N, n, n) that the model computes at the states."""

    tau: Array
    M: Array
    C: Array


def check_identities(
    model: Model, chain: Chain, parameters: Parameters, s: States, tolerances: Tolerances, rows: Collector
) -> None:
    """Check identities between the functions of the model at the states ``s``.

    They are ``tau = M ddq + C dq + g = Y beta + Ia ddq``, ``M = M' > 0``, the product C' dq, the skew symmetry of
    ``dM/dt - 2 C``, and the power balance ``dE/dt = tau' dq``.
    """
    beta = parameters.beta
    try:
        own = _ModelTerms(
            np.asarray(model.inverse_dynamics(s.q, s.dq, s.ddq, beta=beta)),
            np.asarray(model.mass_matrix(s.q, beta=beta)),
            np.asarray(model.coriolis_matrix(s.q, s.dq, beta=beta)),
        )
    except Exception as error:  # an identity with a function that fails does not hold
        note = f"the model gave no torque, M or C: {type(error).__name__}: {error}"
        rows.rows.append(Row("identities", SELF, parameters.label, s.count, float("inf"), tolerances.exact, note))
        return
    _check_sums(model, chain, parameters, s, own, tolerances, rows)
    _check_rates(model, parameters, s, own, tolerances, rows)


def _check_sums(
    model: Model,
    chain: Chain,
    parameters: Parameters,
    s: States,
    own: _ModelTerms,
    tolerances: Tolerances,
    rows: Collector,
) -> None:
    """Check the identities that contain no time derivative."""
    beta = parameters.beta
    check = rows.against(SELF, parameters.label, tolerances.exact, s.count)
    inertial = np.einsum("nij,nj->ni", own.M, s.ddq) + np.einsum("nij,nj->ni", own.C, s.dq)

    def from_regressor() -> Array:
        base = np.asarray(model.beta if beta is None else beta)
        return np.asarray(np.asarray(model.regressor(s.q, s.dq, s.ddq)) @ base + s.ddq @ chain.drive_inertia)

    def round_trip() -> Array:
        ddq = model.forward_dynamics(s.q, s.dq, own.tau, beta=beta)
        return np.asarray(np.einsum("nij,nj->ni", own.M, np.asarray(ddq) - s.ddq))

    check("tau = M ddq + C dq + g", lambda: inertial + np.asarray(model.gravity(s.q, beta=beta)), own.tau)
    check("tau = Y beta + Ia ddq", from_regressor, own.tau)
    check("M = M'", lambda: np.swapaxes(own.M, 1, 2), own.M)
    check(
        "coriolis_transpose = C' dq",
        lambda: model.coriolis_transpose(s.q, s.dq, beta=beta),
        np.einsum("nji,nj->ni", own.C, s.dq),
        scale=max(size(own.tau), size(own.C) * size(s.dq)),
    )
    if parameters.physical:
        indefinite = np.mean(np.linalg.eigvalsh(0.5 * (own.M + np.swapaxes(own.M, 1, 2)))[:, 0] <= 0.0)
        check("M > 0 (share of states where not)", lambda: np.asarray(indefinite), np.zeros(()), scale=1.0)
        check("M (forward(inverse) - ddq) = 0", round_trip, np.zeros_like(s.q), scale=size(own.tau))


def _check_rates(
    model: Model, parameters: Parameters, s: States, own: _ModelTerms, tolerances: Tolerances, rows: Collector
) -> None:
    """Check the two identities with a time derivative, taken along q + t dq, dq + t ddq at t = 0."""
    beta = parameters.beta
    check = rows.against(SELF, parameters.label, tolerances.differenced, s.count)

    def skew() -> Array:
        M_dot = rate(lambda t: np.asarray(model.mass_matrix(s.q + t * s.dq, beta=beta)), tolerances.step)
        S = M_dot - 2.0 * own.C
        return S + np.swapaxes(S, 1, 2)

    def total(t: float) -> Array:
        kinetic, potential = model.energy(s.q + t * s.dq, s.dq + t * s.ddq, beta=beta)
        return np.asarray(kinetic + potential)

    check("dM/dt - 2C skew", skew, np.zeros_like(own.C), scale=size(own.M) * size(s.dq))
    power = own.tau * s.dq
    check("d(K + U)/dt = tau.dq", lambda: rate(total, tolerances.step), np.sum(power, axis=1), scale=size(power))
