"""The named tuples that functions with several results return."""

from __future__ import annotations

from typing import Any, NamedTuple

from numpy.typing import NDArray


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
    """Pose of the tip (..., 4, 4) and geometric Jacobian (..., 6, n)."""

    T: NDArray[Any]
    J: NDArray[Any]


class DynamicsTerms(NamedTuple):
    """Mass matrix (..., n, n), Coriolis torques (..., n), gravity torques (..., n): tau = M ddq + c + g."""

    M: NDArray[Any]
    c: NDArray[Any]
    g: NDArray[Any]


class InverseDynamicsDerivatives(NamedTuple):
    """Torques (..., n) and their derivatives (..., n, n): d tau = dtau_dq dq + dtau_dv d(dq) + M d(ddq)."""

    tau: NDArray[Any]
    dtau_dq: NDArray[Any]
    dtau_dv: NDArray[Any]
    M: NDArray[Any]


class ForwardDynamicsDerivatives(NamedTuple):
    """Accelerations (..., n) and their derivatives (..., n, n) with respect to q, dq and tau; dddq_dtau is inv(M)."""

    ddq: NDArray[Any]
    dddq_dq: NDArray[Any]
    dddq_dv: NDArray[Any]
    dddq_dtau: NDArray[Any]
