"""Result types of model functions with several results: named tuples, and the solutions of the inverse kinematics."""

from __future__ import annotations

from typing import Any, NamedTuple

from numpy.typing import NDArray

MULTIPLE, FREE, OUTSIDE, INEXACT = 1, 2, 4, 8
"""Bits of :attr:`IKResult.flags`: two branches meet, a joint is free, outside its limits, the target is not met."""


class JointLimits(NamedTuple):
    """Limits of all joints, each (n,), in SI units; -inf or inf where the robot file states none.

    ``lower`` and ``upper`` bound q (rad, m); ``velocity``, ``acceleration`` and ``torque`` bound the magnitudes of dq,
    ddq and tau (N m, N).
    """

    lower: NDArray[Any]
    upper: NDArray[Any]
    velocity: NDArray[Any]
    acceleration: NDArray[Any]
    torque: NDArray[Any]


class Kinematics(NamedTuple):
    """Pose of the tip ``T`` (..., 4, 4) and its geometric Jacobian ``J`` (..., 6, n), both in the base frame."""

    T: NDArray[Any]
    J: NDArray[Any]


class ClosedLoops(NamedTuple):
    """Passive joints of closed loops: ``passive`` (..., p, 2) holds cosine and sine of their displacements.

    Of a prismatic joint it holds the displacement (m) and 0.
    ``W`` (..., p, n): their rates are ``W dq``. ``sine`` (..., loops): of the angle between the two bars of each loop.
    """

    passive: NDArray[Any]
    W: NDArray[Any]
    sine: NDArray[Any]


class LoopPositions(NamedTuple):
    """Positions ``loop_q`` (..., p) of the passive joints of closed loops, rad or m, and the largest ``gap`` (...), m.

    The gap is that of a pin, along an axis of the plane of its loop.
    """

    loop_q: NDArray[Any]
    gap: NDArray[Any]


class FloatingForces(NamedTuple):
    """Force (N) and moment (N m) on a floating base, ``wrench`` (..., 6), and joint torques ``tau`` (..., n)."""

    wrench: NDArray[Any]
    tau: NDArray[Any]


class FloatingAccelerations(NamedTuple):
    """Rates of the components of the base twist, ``twist_rate`` (..., 6), and joint accelerations ``ddq`` (..., n)."""

    twist_rate: NDArray[Any]
    ddq: NDArray[Any]


class FloatingDerivatives(NamedTuple):
    """Wrench (..., 6) and torques ``tau`` (..., n), and derivatives of both together, (..., 6 + n, 6 + n), SI units.

    ``d [wrench; tau] = df_dq [d x; d xi; d q] + df_dv d [twist; dq] + M d [twist_rate; ddq]`` for a translation x and a
    rotation xi of the base along and about its own axes.
    """

    wrench: NDArray[Any]
    tau: NDArray[Any]
    df_dq: NDArray[Any]
    df_dv: NDArray[Any]
    M: NDArray[Any]


class DynamicsTerms(NamedTuple):
    """The terms of ``tau = M ddq + c + g``: mass matrix (..., n, n), Coriolis and gravity torques (..., n); SI."""

    M: NDArray[Any]
    c: NDArray[Any]
    g: NDArray[Any]


class Energy(NamedTuple):
    """The energies ``kinetic`` and ``potential`` (defined up to a constant), each (...), in J."""

    kinetic: NDArray[Any]
    potential: NDArray[Any]


class FrictionStep(NamedTuple):
    """States of friction ``z_next`` (..., s) after a period, rad or m, and torques ``tau_f`` (..., n), N m or N."""

    z_next: NDArray[Any]
    tau_f: NDArray[Any]


class MomentumTerms(NamedTuple):
    """Momentum ``p = M dq`` (N m s), ``ct = C' dq`` and gravity torques ``g``, (..., n): ``dp/dt = tau + ct - g``."""

    p: NDArray[Any]
    ct: NDArray[Any]
    g: NDArray[Any]


class ControlStep(NamedTuple):
    """Torques ``tau`` (..., n) to apply, N m or N, and the state ``z_next`` (..., n) of the integral action."""

    tau: NDArray[Any]
    z_next: NDArray[Any]


class OperationalStep(NamedTuple):
    """Torques ``tau`` (..., n), N m or N, and the state ``z_next`` (..., 6), or (..., 3), of the integral action."""

    tau: NDArray[Any]
    z_next: NDArray[Any]


class Contact(NamedTuple):
    """Result of contact detection: ``ratio`` (..., n), ``touches`` (...), 1 or 0, and ``change`` (..., n), N m or N.

    ``ratio`` is that of each external torque, or of its change, to the threshold, the larger of both; ``touches`` is 1
    if any ratio exceeds 1; ``change`` is state for the next tick.
    """

    ratio: NDArray[Any]
    touches: NDArray[Any]
    change: NDArray[Any]


class ExternalLoad(NamedTuple):
    """Wrench or force on the robot: ``F`` (..., k) in N and N m, k = 6 for a wrench, 3 for a force.

    ``P`` (..., k, k) is its covariance and ``condition`` (...) a condition number, large near singular configurations.
    """

    F: NDArray[Any]
    P: NDArray[Any]
    condition: NDArray[Any]


class AdaptiveStep(NamedTuple):
    """Torques ``tau`` (..., n) to apply, N m or N, and the base parameters ``beta_next`` (..., b), SI units."""

    tau: NDArray[Any]
    beta_next: NDArray[Any]


class ObserverState(NamedTuple):
    """State of the momentum observer: momentum ``p = M dq``, torques ``u = C' dq - g - f(dq)``, (..., n), SI units."""

    p: NDArray[Any]
    u: NDArray[Any]


class ObserverStep(NamedTuple):
    """Estimated external torques ``r`` (..., n), N m or N, and the observer's next state ``p``, ``u``, (..., n)."""

    r: NDArray[Any]
    p: NDArray[Any]
    u: NDArray[Any]


class Motion(NamedTuple):
    """Desired positions ``q_d``, velocities ``dq_d`` and accelerations ``ddq_d``, (..., n) each, SI units."""

    q_d: NDArray[Any]
    dq_d: NDArray[Any]
    ddq_d: NDArray[Any]


class RotorMotion(NamedTuple):
    """Torques of the motors ``tau``, positions ``theta`` and velocities ``dtheta`` of the rotors, (..., n) each."""

    tau: NDArray[Any]
    theta: NDArray[Any]
    dtheta: NDArray[Any]


class ElasticAccelerations(NamedTuple):
    """Accelerations ``ddq`` of the links and ``ddtheta`` of the rotors, (..., n) each, rad/s^2 or m/s^2."""

    ddq: NDArray[Any]
    ddtheta: NDArray[Any]


class PathDynamics(NamedTuple):
    """Torques ``a d2s/dt2 + b (ds/dt)^2 + g`` along a path q(s): the factors ``a``, ``b`` and ``g``, (..., n) each."""

    a: NDArray[Any]
    b: NDArray[Any]
    g: NDArray[Any]


class TimedMotion(NamedTuple):
    """Desired positions ``q_d``, speeds ``dq_d``, accelerations ``ddq_d`` (..., n), and the duration ``T`` (...), s."""

    q_d: NDArray[Any]
    dq_d: NDArray[Any]
    ddq_d: NDArray[Any]
    T: NDArray[Any]


class PointMotion(NamedTuple):
    """Velocity ``V_p`` and acceleration ``A_p`` of a point, (..., 6) each, linear part first."""

    V_p: NDArray[Any]
    A_p: NDArray[Any]


class Manipulability(NamedTuple):
    """Manipulability ``w`` (...) and its gradient ``dw_dq`` (..., n)."""

    w: NDArray[Any]
    dw_dq: NDArray[Any]


class InverseDynamicsDerivatives(NamedTuple):
    """Torques ``tau`` (..., n), N m or N, and their derivatives (..., n, n), SI units.

    ``d tau = dtau_dq d(q) + dtau_dv d(dq) + M d(ddq)``.
    """

    tau: NDArray[Any]
    dtau_dq: NDArray[Any]
    dtau_dv: NDArray[Any]
    M: NDArray[Any]


class ForwardDynamicsDerivatives(NamedTuple):
    """Accelerations ``ddq`` (..., n), rad/s^2 or m/s^2, and their derivatives (..., n, n), SI units.

    ``d ddq = dddq_dq d(q) + dddq_dv d(dq) + dddq_dtau d(tau)``; ``dddq_dtau`` is the inverse of M.
    """

    ddq: NDArray[Any]
    dddq_dq: NDArray[Any]
    dddq_dv: NDArray[Any]
    dddq_dtau: NDArray[Any]


class Hessian(NamedTuple):
    """``gradient`` (..., 3 n) and symmetric Hessian ``H`` (..., 3 n, 3 n) of a weighted sum, in SI units.

    On a floating base they have 3 (6 + n) rows.
    """

    gradient: NDArray[Any]
    H: NDArray[Any]


class SecondDerivatives(NamedTuple):
    """Second derivatives of the torques, (..., n, n, n) each, SI units.

    ``d2tau_dqq[..., i, j, k]`` is that of tau_i by q_j and q_k, ``d2tau_dvq`` that by dq_j and q_k, ``d2tau_dvv``
    that by dq_j and dq_k, and ``dM_dq`` that by ddq_j and q_k, the derivative of M_ij by q_k.
    """

    d2tau_dqq: NDArray[Any]
    d2tau_dvq: NDArray[Any]
    d2tau_dvv: NDArray[Any]
    dM_dq: NDArray[Any]
