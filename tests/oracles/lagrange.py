"""Dynamics from the energies alone: M from link Jacobians, its derivatives by the complex step.

A second route that shares only the frames with newton_euler.py: no accelerations and no forces occur in it.
"""

from __future__ import annotations

import numpy as np

from oracles.newton_euler import Robot, cross, frames

STEP = 1e-30  # the complex step has no cancellation, so the step may be far below round-off


def mass_matrix(robot: Robot, q) -> np.ndarray:
    """M = sum of m Jv'Jv + Jw' R I R' Jw over the links, Jacobians at the centres of mass."""
    f = frames(robot, q)
    M = np.zeros((robot.n, robot.n), dtype=f.links.dtype)
    for j, link in enumerate(robot.links):
        R = f.links[j][:3, :3]
        centre = f.links[j][:3, 3] + R @ link.com
        Jv = np.zeros((3, robot.n), dtype=M.dtype)
        Jw = np.zeros((3, robot.n), dtype=M.dtype)
        for i in range(j + 1):
            if robot.rows[i][0] == "revolute":
                Jv[:, i], Jw[:, i] = cross(f.axes[i], centre - f.points[i]), f.axes[i]
            else:
                Jv[:, i] = f.axes[i]
        M = M + link.mass * Jv.T @ Jv + Jw.T @ R @ link.inertia @ R.T @ Jw
    return M


def potential(robot: Robot, q):
    """U = -sum m g.c, counted from the origin of the base frame."""
    f = frames(robot, q)
    centres = [f.links[j][:3, 3] + f.links[j][:3, :3] @ link.com for j, link in enumerate(robot.links)]
    return -sum(link.mass * (robot.gravity @ c) for link, c in zip(robot.links, centres, strict=True))


def gravity(robot: Robot, q) -> np.ndarray:
    """g = dU/dq."""
    return np.array([potential(robot, q + 1j * STEP * e).imag / STEP for e in np.eye(robot.n)])


def mass_matrix_derivatives(robot: Robot, q) -> np.ndarray:
    """dM/dq_k as (k, n, n)."""
    return np.array([mass_matrix(robot, q + 1j * STEP * e).imag / STEP for e in np.eye(robot.n)])


def christoffel_matrix(robot: Robot, q, dq) -> np.ndarray:
    """The Coriolis matrix of Christoffel symbols, C_ij = sum_k (dM_ij/dq_k + dM_ik/dq_j - dM_jk/dq_i) dq_k / 2."""
    D = mass_matrix_derivatives(robot, q)
    along = np.einsum("kij,k->ij", D, dq)
    cross = np.einsum("jik,k->ij", D, dq)
    return 0.5 * (along + cross - cross.T)


def inverse_dynamics(robot: Robot, q, dq, ddq) -> np.ndarray:
    """tau = M ddq + C dq + dU/dq."""
    return mass_matrix(robot, q) @ ddq + christoffel_matrix(robot, q, dq) @ dq + gravity(robot, q)
