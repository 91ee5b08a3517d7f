"""Steady-state Kalman filter and fixed-interval smoother for joint motion, (14.26)-(14.31).

The deviation ``e = q - q_r`` of a joint from its reference is a triple integrator driven by white jerk ``xi`` held
over a sample period Ts, and measured with white noise ``eta``. In the scaled state ``[e, Ts de, Ts^2 nu]``, ``nu`` the
acceleration of the deviation, the model does not depend on Ts, and the gain only on
``lambda = sqrt(var xi) Ts^3 / sqrt(var eta)``.

Equation numbers are those of D. Kostic, B. de Jager, M. Steinbuch, Modeling and Identification for Robot Motion
Control, Robotics and Automation Handbook, CRC Press 2005, chapter 14.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rrrgen.base.arrays import Array
from rrrgen.base.errors import InputError
from rrrgen.lab.data.reconstruction import DECAY_TOLERANCE, Reconstruction, sampling_period

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


def smoothed_covariance(matrices: KalmanMatrices) -> Array:
    """Error covariance (3, 3) of the smoothed state ``[e, de, dde]``, divided by ``var eta``.

    The steady state of Rauch, Tung and Striebel: ``P_s = P_updated + C (P_s - P_predicted) C'`` with C of
    :func:`smoother_recursions`.
    """
    from scipy.linalg import solve_discrete_lyapunov

    _, C = smoother_recursions(matrices)
    scale = np.sqrt(np.diag(matrices.predicted))
    C, S = C * scale / scale[:, None], np.outer(scale, scale)
    constant_term = matrices.updated / S - C @ (matrices.predicted / S) @ C.T
    return np.asarray(solve_discrete_lyapunov(C, constant_term) * S)


# ------------------------------------------------------------------------------------------------------------------
# Kalman filter and fixed-interval smoother over a whole recording, (14.26)-(14.31), and their tuning by innovations.
#
# Equation numbers are those of D. Kostic, B. de Jager, M. Steinbuch, Modeling and Identification for Robot Motion
# Control, Robotics and Automation Handbook, CRC Press 2005, chapter 14.
# ------------------------------------------------------------------------------------------------------------------

JITTER = 0.3
"""Size of the steps from sample to sample over the spread of the positions, above which they are noise, not motion."""
LOWEST_RATIO, HIGHEST_RATIO = -10.0, 1.0  # log10 of lambda: range searched for the largest innovation likelihood


@dataclass(frozen=True)
class KalmanSmoother:
    """Reconstruction of joint motion by the steady-state Kalman filter (14.30)-(14.31), by default also smoothed.

    The smoother is the fixed-interval one. ``var_eta`` is the variance of the position noise (rad^2), ``var_xi`` that
    of the jerk of the deviation ((rad/s^3)^2); one value for all joints, or one per joint. ``smooth=False`` gives the
    causal filter, as it runs in real time. The recording is extended at both ends by point reflection at its end
    samples.
    """

    var_eta: float | tuple[float, ...]
    var_xi: float | tuple[float, ...]
    smooth: bool = True

    def __call__(self, t: Array, q: Array, reference: Reconstruction | None = None) -> Reconstruction:
        """Reconstruct the motion from positions ``q`` (N, n) in rad (m) at the uniform times ``t`` (N,) in s.

        With a ``reference`` motion, the filter works on the deviation ``e = q - q_r``, (14.27).
        """
        t, q = np.asarray(t, float), np.asarray(q, float)
        period = sampling_period(t)
        e = q if reference is None else q - reference.q
        states = np.empty((len(q), q.shape[1], 3))
        for joint, matrices in enumerate(self.matrices(period, q.shape[1])):
            states[:, joint] = _states(matrices, e[:, joint], self.smooth)
        parts = [states[..., i] for i in range(3)]
        if reference is not None:
            parts = [
                part + known for part, known in zip(parts, (reference.q, reference.dq, reference.ddq), strict=True)
            ]
        method = "Kalman smoother" if self.smooth else "Kalman filter"
        facts = {"var_eta": self.var_eta, "var_xi": self.var_xi}
        return Reconstruction(t, parts[0], parts[1], parts[2], method, facts)

    def matrices(self, period: float, joints: int) -> list[KalmanMatrices]:
        """The filter matrices of each of ``joints`` joints, for a sampling ``period`` in s."""
        pairs = zip(_per_joint(self.var_eta, joints), _per_joint(self.var_xi, joints), strict=True)
        return [kalman_matrices(period, eta, xi) for eta, xi in pairs]

    def speed_deviations(self, period: float) -> Array:
        """Standard deviations (n,) of the reconstructed speeds, rad/s (m/s), for a sampling ``period`` in s.

        They are those of the model: what the noise of the positions leaves open, and what is smoothed away.
        """
        joints = int(max(np.size(self.var_eta), np.size(self.var_xi)))
        matrices = self.matrices(period, joints)
        covariances = [smoothed_covariance(m) if self.smooth else m.updated for m in matrices]
        return np.sqrt([P[1, 1] * eta for P, eta in zip(covariances, _per_joint(self.var_eta, joints), strict=True)])

    def memory(self, period: float) -> int:
        """Number of samples in which the slowest pole of any joint decays to round-off, for a ``period`` in s."""
        joints = max(np.size(self.var_eta), np.size(self.var_xi))
        slowest = max(float(np.max(np.abs(m.poles))) for m in self.matrices(period, int(joints)))
        return 2 + math.ceil(math.log(DECAY_TOLERANCE) / math.log(slowest))


def quantisation_variance(resolution: float) -> float:
    """Noise variance of an encoder from its resolution (rad or m): ``var eta = resolution^2 / 12``, in rad^2 (m^2).

    This is the variance of a rounding error that is uniform over one step.
    """
    return resolution * resolution / 12.0


def innovations(matrices: KalmanMatrices, e: Array) -> Array:
    """Innovations ``e(k) - e_hat(k)`` (N - 1,) of one joint: measured minus predicted, from the second sample on.

    ``e`` (N,) is the measured position or deviation, rad (m). If the noise model is right, the innovations are white
    with variance ``matrices.innovation * var eta``.
    """
    pad = _padding(matrices, len(e))
    _, innovation = _forward(matrices, _extend_ends(e, pad))
    return innovation[pad + 1 : pad + len(e)]


def tune_by_innovations(t: Array, q: Array, reference: Reconstruction | None = None) -> KalmanSmoother:
    """Tune the smoother by maximum likelihood of its innovations, joint by joint.

    For a given ratio of the variances the likelihood is largest at ``var eta = mean(innovation^2) / (c P c' + 1)``; the
    ratio then minimises ``log mean(innovation^2)``, the one-step prediction error. ``t`` (N,) in s, ``q`` (N, n) in
    rad (m); with a ``reference`` motion, the deviation from it is modelled. Raises :class:`InputError` for a joint
    that does not move.
    """
    e = np.asarray(q, float) if reference is None else np.asarray(q, float) - reference.q
    return tune_stretches([e], sampling_period(t))


def tune_stretches(stretches: Sequence[Array], period: float) -> KalmanSmoother:
    """Tune the smoother by maximum likelihood of its innovations over several uninterrupted stretches of a recording.

    ``stretches`` holds positions (N_i, n) in rad (m), sampled at a common ``period`` (s). Each is filtered on its own;
    the innovations of all are pooled. A joint whose positions are noise alone is smoothed as the slowest of those that
    move, and not over the whole recording. Raises :class:`InputError` for a joint that does not move in any of them.
    """
    from scipy.optimize import minimize_scalar

    if resting := resting_joints(stretches):
        names = " and ".join(str(k + 1) for k in resting)
        raise InputError(f"joint {names} does not move at all: its noise cannot be separated from its motion")
    ratios, squares = [], []
    for joint in range(stretches[0].shape[1]):
        columns = [np.asarray(stretch[:, joint], float) for stretch in stretches]

        def square(matrices: KalmanMatrices, columns: list[Array] = columns) -> float:
            return float(np.mean(np.concatenate([innovations(matrices, column) for column in columns]) ** 2))

        def cost(log_ratio: float, square: Callable[[KalmanMatrices], float] = square) -> float:
            return math.log(square(_unit_noise(period, log_ratio)))

        grid = np.linspace(LOWEST_RATIO, HIGHEST_RATIO, 23)
        best = int(np.argmin([cost(value) for value in grid]))
        bracket = (grid[max(0, best - 1)], grid[min(len(grid) - 1, best + 1)])
        minimum = minimize_scalar(cost, bounds=bracket, method="bounded", options={"xatol": 1e-3})
        ratios.append(float(minimum.x))
        squares.append(square)
    noise = jittering_joints(stretches)
    slowest = min((ratio for joint, ratio in enumerate(ratios) if joint not in noise), default=LOWEST_RATIO)
    etas, xis = [], []
    for joint, (ratio, square) in enumerate(zip(ratios, squares, strict=True)):
        ratio = max(ratio, slowest) if joint in noise else ratio
        matrices = _unit_noise(period, ratio)
        eta = square(matrices) / matrices.innovation
        etas.append(eta)
        xis.append(eta * 10.0 ** (2.0 * ratio) / period**6)
    return KalmanSmoother(tuple(etas), tuple(xis))


def jittering_joints(stretches: Sequence[Array]) -> list[int]:
    """Indices of the joints whose positions are constant but for noise in all ``stretches``, (N_i, n) each."""
    steps, spread = (
        np.max([np.std(part, axis=0) for part in parts], axis=0)
        for parts in ([np.diff(stretch, axis=0) for stretch in stretches], stretches)
    )
    return [int(joint) for joint in np.flatnonzero(steps >= JITTER * spread)]


def resting_joints(stretches: Sequence[Array]) -> list[int]:
    """Indices of the joints whose positions stay the same in each of the ``stretches``, (N_i, n) each."""
    moved = np.any([np.ptp(stretch, axis=0) > 0.0 for stretch in stretches], axis=0)
    return [int(joint) for joint in np.flatnonzero(~moved)]


def _unit_noise(period: float, log_ratio: float) -> KalmanMatrices:
    """The Kalman filter of one joint with ``var eta = 1`` and ``var xi = 10^(2 log_ratio) / period^6``."""
    return kalman_matrices(period, 1.0, 10.0 ** (2.0 * log_ratio) / period**6)


def _per_joint(value: float | Sequence[float], joints: int) -> list[float]:
    values = [float(value)] * joints if isinstance(value, (int, float)) else [float(v) for v in value]
    if len(values) != joints:
        raise InputError(f"{len(values)} variances were given for {joints} joints")
    return values


def _padding(matrices: KalmanMatrices, samples: int) -> int:
    slowest = float(np.max(np.abs(matrices.poles)))
    return min(samples - 1, 2 + math.ceil(math.log(DECAY_TOLERANCE) / math.log(slowest)))


def _extend_ends(e: Array, pad: int) -> Array:
    """``e`` extended at both ends by ``pad`` samples, by point reflection at its end samples."""
    if pad == 0:
        return e
    return np.concatenate([2 * e[0] - e[pad:0:-1], e, 2 * e[-1] - e[-2 : -pad - 2 : -1]])


def _states(matrices: KalmanMatrices, e: Array, smooth: bool) -> Array:
    """Filtered, or with ``smooth`` smoothed, states (N, 3) of one joint."""
    pad = _padding(matrices, len(e))
    extended = _extend_ends(e, pad)
    states, innovation = _forward(matrices, extended)
    if smooth:
        # x_s(k) - x_bar(k) = C (x_s(k+1) - E x_bar(k)) = C (x_s(k+1) - x_bar(k+1)) + C k innovation(k+1)
        _, C = smoother_recursions(matrices)
        drive = np.zeros_like(states)
        drive[:-1] = innovation[1:, None] * (C @ matrices.k)
        states = states + _recursion(C, drive[::-1], np.zeros(3))[::-1]
    return states[pad : pad + len(e)]


def _forward(matrices: KalmanMatrices, y: Array) -> tuple[Array, Array]:
    """Run the Kalman filter over ``y`` (N,); returns the states (N, 3) and the innovations (N,).

    The filter starts on the straight line through the first two samples. The recursion runs on the difference s between
    the states and ``[y(k), (y(k) - y(k-1))/Ts, 0]``, which obeys ``s(k) = F s(k-1) + (k - [1, 1/Ts, 0]) a(k)`` with a
    the second difference of y. Differences of measured values are exact, so that round-off is relative to the noise and
    not to the position.
    """
    F, _ = smoother_recursions(matrices)
    slope = np.diff(y, prepend=2 * y[:1] - y[1:2]) / matrices.period
    second = np.zeros(len(y))
    second[2:] = np.diff(y, 2)
    b = np.array([1.0, 1.0 / matrices.period, 0.0])
    s = _recursion(F, second[:, None] * (matrices.k - b), np.zeros(3))
    innovation = second.copy()
    innovation[1:] -= s[:-1] @ matrices.E[0]
    return s + np.column_stack([y, slope, np.zeros(len(y))]), innovation


def _recursion(A: Array, drive: Array, first: Array) -> Array:
    """Solve ``x(k) = A x(k-1) + drive(k)``, ``x(0) = first``, in modal coordinates (the three eigenvalues differ)."""
    from scipy.signal import lfilter

    scale = np.max(np.abs(drive), axis=0)
    scale[scale == 0.0] = 1.0
    values, vectors = np.linalg.eig(A / scale[:, None] * scale)
    modal = np.linalg.solve(vectors, (drive / scale).T.astype(complex))
    modal[:, 0] = np.linalg.solve(vectors, first / scale)
    filtered = np.stack([lfilter([1.0], [1.0, -value], row) for value, row in zip(values, modal, strict=True)])
    return np.asarray(np.real(vectors @ filtered).T * scale)


def read_tuning(path: Path, joints: int) -> list[tuple[float, float]]:
    """Variances of position noise and jerk of every joint, from the tuning.json at ``path``."""
    try:
        tuning = json.loads(path.read_text(encoding="utf-8"))
        pairs = [(float(eta), float(xi)) for eta, xi in zip(tuning["var_eta"], tuning["var_xi"], strict=True)]
    except (ValueError, KeyError, TypeError) as error:
        raise InputError(
            f"{path} is no tuning of a Kalman filter by `rrrgen experiment reconstruct`: {error!r}"
        ) from None
    if not all(math.isfinite(value) and value > 0.0 for pair in pairs for value in pair):
        raise InputError(f"{path} is no tuning of a Kalman filter: variances are positive numbers")
    if len(pairs) != joints:
        raise InputError(f"{path} tunes {len(pairs)} joints, the robot has {joints}")
    return pairs
