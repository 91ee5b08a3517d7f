"""Steady-state Kalman filter and fixed-interval smoother for joint motion, (14.26)-(14.31).

The deviation ``e = q - q_r`` of a joint from its reference is a triple integrator driven by white jerk ``xi`` held
over a sample period Ts, and measured with white noise ``eta``. In the scaled state ``[e, Ts de, Ts^2 nu]``, ``nu`` the
acceleration of the deviation, the model does not depend on Ts, and the gain only on
``lambda = sqrt(var xi) Ts^3 / sqrt(var eta)``.

Equation numbers are those of D. Kostic, B. de Jager, M. Steinbuch, Modeling and Identification for Robot Motion
Control, Robotics and Automation Handbook, CRC Press 2005, chapter 14.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rrrgen.base.arrays import Array
from rrrgen.base.errors import InputError

TRANSITION = np.array([[1.0, 1.0, 0.5], [0.0, 1.0, 1.0], [0.0, 0.0, 1.0]])
INPUT = np.array([1.0 / 6.0, 0.5, 1.0])
MEASURED = np.array([1.0, 0.0, 0.0])


@dataclass(frozen=True)
class KalmanMatrices:
    """Constants of the steady-state Kalman filter of one joint, for the state ``x = [e, de, dde]`` in rad (m) and s.

    The model is ``x(k+1) = E x(k) + g xi(k)`` with ``E`` (3, 3), ``g`` (3,), (14.29). ``k`` (3,) is the filter gain,
    (14.30). ``predicted`` and ``updated`` (3, 3) are the error covariances before and after a measurement, divided by
    the variance of the measurement noise, ``var eta``. ``period`` is Ts in s.
    """

    period: float
    E: Array
    g: Array
    k: Array
    predicted: Array
    updated: Array

    @property
    def innovation(self) -> float:
        """Variance of the innovation divided by ``var eta``: ``c P c' + 1``, c = [1, 0, 0], P = ``predicted``."""
        return float(self.predicted[0, 0]) + 1.0

    @property
    def poles(self) -> NDArray[np.complex128]:
        """Poles of the filter (3,): eigenvalues of its error dynamics ``(I - k c) E`` with c = [1, 0, 0]."""
        return np.asarray(np.linalg.eigvals((np.eye(3) - np.outer(self.k, MEASURED)) @ self.E), complex)


def kalman_matrices(period: float, var_eta: float, var_xi: float) -> KalmanMatrices:
    """Compute the steady-state Kalman filter of one joint: gain ``k = P c' / (c P c' + 1)``, c = [1, 0, 0], (14.30).

    P is the predicted error covariance divided by ``var eta``, the solution of the discrete algebraic Riccati equation.
    ``period`` is Ts in s, ``var_eta`` the variance of the position noise in rad^2 (m^2), ``var_xi`` that of the jerk in
    (rad/s^3)^2 ((m/s^3)^2). Raises :class:`InputError` for a period or variance that is not positive.
    """
    if not (period > 0 and var_eta > 0 and var_xi > 0):
        raise InputError(
            f"the Kalman filter needs a positive period and positive variances, not Ts = {period:g} s, "
            f"var eta = {var_eta:g}, var xi = {var_xi:g}"
        )
    P = _predicted_covariance(math.sqrt(var_xi / var_eta) * period**3)
    k = P[:, 0] / (P[0, 0] + 1.0)
    updated = P - np.outer(k, P[0])
    scale = period ** -np.arange(3.0)  # from [e, Ts de, Ts^2 nu] to [e, de, nu]
    S = np.outer(scale, scale)
    return KalmanMatrices(
        period=period,
        E=TRANSITION * np.outer(scale, 1.0 / scale),
        g=INPUT * scale * period**3,
        k=k * scale,
        predicted=P * S,
        updated=updated * S,
    )


def _predicted_covariance(ratio: float) -> Array:
    """Predicted error covariance (3, 3), divided by ``var eta``, of the scaled model with ``lambda = ratio``.

    The state is scaled further by powers of ``rho = lambda^(1/3)``, the order of the distance of the poles from 1, so
    that the Riccati equation stays well conditioned however small lambda is.
    """
    from scipy import linalg

    rho = min(1.0, ratio ** (1.0 / 3.0))
    scale = rho ** np.arange(3.0)
    E = TRANSITION * np.outer(1.0 / scale, scale)
    g = INPUT * ratio / scale
    c = MEASURED[:, None]
    try:
        P = linalg.solve_discrete_are(E.T, c, np.outer(g, g), np.eye(1))
    except np.linalg.LinAlgError:
        P = _iterated_covariance(E, g)
    for _ in range(2):  # the Riccati map contracts: two steps remove the residual of the solver
        k = P[:, 0] / (P[0, 0] + 1.0)
        P = E @ (P - np.outer(k, P[0])) @ E.T + np.outer(g, g)
        P = 0.5 * (P + P.T)
    return np.asarray(P * np.outer(scale, scale))


def _iterated_covariance(E: Array, g: Array) -> Array:
    """Solve the Riccati equation for the predicted covariance (3, 3) by the structured doubling algorithm.

    The model is ``x(k+1) = E x(k) + g xi(k)``, ``y = [1, 0, 0] x``, with unit variances. The algorithm also converges
    if closed-loop poles are close to the unit circle.
    """
    A: Array = E.T.copy()
    G: Array = np.outer(MEASURED, MEASURED)
    H: Array = np.outer(g, g)
    for _ in range(100):
        W = np.linalg.inv(np.eye(3) + G @ H)
        A, G, step = A @ W @ A, G + A @ W @ G @ A.T, A.T @ H @ W @ A
        H = H + step
        if np.max(np.abs(step)) <= 1e-16 * np.max(np.abs(H)):
            return H
    raise InputError("the Riccati equation of the Kalman filter has no steady state for these variances")


def kalman_step(E: Array, k: Array, predicted: Array, measured: ArrayLike, reference: ArrayLike) -> tuple[Array, Array]:
    """One step of the Kalman filter of any number of joints; returns the next prediction and ``[q, dq, ddq]``.

    The state is the deviation ``[e, de, dde]`` from the reference. Its prediction x_hat is corrected by the measurement
    y, ``x_bar = x_hat + k (y - q_r - e_hat)``; the motion is ``x_bar + [q_r, dq_r, ddq_r]`` and the next prediction is
    ``E x_bar``. ``E`` (..., 3, 3) of (14.29), the gain ``k`` (..., 3) of (14.30); ``predicted`` (..., 3) is x_hat,
    ``measured`` (...) y, ``reference`` (..., 3) ``[q_r, dq_r, ddq_r]``. Source: (14.30), (14.31).
    """
    wanted = np.asarray(reference, dtype=float)
    innovation = np.asarray(measured, dtype=float) - wanted[..., 0] - predicted[..., 0]
    updated = predicted + k * innovation[..., None]
    return np.einsum("...ij,...j->...i", E, updated), updated + wanted


def frequency_response(matrices: KalmanMatrices, frequencies: Array, smoother: bool = False) -> NDArray[np.complex128]:
    """Frequency response from measured to reconstructed deviation: ``H(z) = c [I - (I - k c) E z^-1]^-1 k``.

    E and k are those of ``matrices``, c = [1, 0, 0].
    ``frequencies`` (m,) in Hz; returns (m,) complex. With ``smoother``, the response of the forward pass followed by
    the backward pass, which is real up to round-off: the smoother has no phase lag.
    """
    forward, backward = smoother_recursions(matrices)
    z = np.exp(2j * math.pi * np.asarray(frequencies, float) * matrices.period)
    x = np.linalg.solve(np.eye(3) - forward / z[:, None, None], np.broadcast_to(matrices.k[:, None], (len(z), 3, 1)))
    if smoother:
        x = np.linalg.solve(np.eye(3) - backward * z[:, None, None], (np.eye(3) - backward @ matrices.E) @ x)
    return np.asarray(x[:, 0, 0], complex)


def smoother_recursions(matrices: KalmanMatrices) -> tuple[Array, Array]:
    """The matrices F and C, (3, 3) each, of the forward and backward recursion of the fixed-interval smoother.

    Forward ``x_bar(i) = F x_bar(i-1) + k y(i)`` with ``F = (I - k c) E``; backward (Rauch-Tung-Striebel, steady state)
    ``x_s(i) = C x_s(i+1) + (I - C E) x_bar(i)`` with ``C = P_updated E' P_predicted^-1``; c = [1, 0, 0].
    """
    forward = (np.eye(3) - np.outer(matrices.k, MEASURED)) @ matrices.E
    scale = np.sqrt(np.diag(matrices.predicted))
    P = matrices.predicted / np.outer(scale, scale)
    right = matrices.updated @ matrices.E.T / scale
    return forward, np.asarray(np.linalg.solve(P.T, right.T).T / scale)
