"""Vibration modes of a robot with elastic joints and base, from its mass matrix and stiffness at a posture.

Links q (n,), rotors r (n,) and base angle b, all absolute: ``M(q) q'' = K (r - q) + D (r' - q')``, ``J r'' = tau - K (r
- q) - D (r' - q')``, ``J_b b'' = -k_b b - d_b b' - tau_1`` with the torque tau_1 of joint 1; the encoder of joint 1
reads ``r_1 - b``, the others read r. Gravity and friction are left out: their stiffness is small against K.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rrrgen.base.arrays import Array
from rrrgen.base.errors import InputError
from rrrgen.lab.plant.plant import FlexibleBase, FlexibleJoints

VISIBLE = 0.02  # least peak of a visible mode, relative to the response of a rigid robot
MOST_DAMPING = 0.999
SAME = 1e-9  # relative difference of the frequencies of one mode, computed for one joint and for another


@dataclass(frozen=True)
class ElasticMode:
    """Vibration mode with its ``frequency`` (Hz) and ``damping`` ratio.

    ``peak`` is the magnitude of its contribution at resonance to the response ``q_i/u_i`` of the excited joint i,
    relative to that of a rigid robot, ``1/s^2``.
    """

    frequency: float
    damping: float
    peak: float


def elastic_modes(
    mass: Array, joint: int, joints: FlexibleJoints | None, base: FlexibleBase | None, loops: Sequence[float] = ()
) -> list[ElasticMode]:
    """Vibration modes visible in the response of ``joint`` (from 0) to the commanded acceleration u of (14.34).

    They are sorted by frequency. ``mass`` is M(q) of the links (n, n), kg m^2. ``loops`` (n,) are the bandwidths in Hz
    of the critically damped loops that hold the other joints; without them their drives are free. Raises
    :class:`InputError` if neither joints nor base are elastic.
    """
    if joints is None and base is None:
        raise InputError("neither the joints nor the base are flexible: there is no vibration to compute")
    M = np.asarray(mass, float)
    A, B, C = linear_model(M, joints, base)
    B = B @ (M if joints is None else M + np.diag(joints.rotor_inertia))  # tau = M u of the robot without springs
    for j, frequency in enumerate(loops):
        if j != joint:
            omega = 2.0 * np.pi * frequency
            x_and_v = omega**2 * C[j] + 2.0 * omega * (C[j] @ A)  # C A is the output matrix of the speeds
            A = A - np.outer(B[:, j], x_and_v)
    values, right = np.linalg.eig(A)
    left = np.linalg.pinv(right)
    modes = []
    for k in np.flatnonzero(values.imag > 1.0):
        s = values[k]
        residue = (C[joint] @ right[:, k]) * (left[k] @ B[:, joint])
        peak = float(abs(residue) / max(-s.real, 1e-9 * abs(s)) * abs(s) ** 2)
        if peak > VISIBLE and -s.real < MOST_DAMPING * abs(s):
            modes.append(ElasticMode(float(abs(s) / (2.0 * np.pi)), float(-s.real / abs(s)), peak))
    return sorted(modes, key=lambda mode: mode.frequency)


def modes_of_arm(mass: Array, joints: FlexibleJoints) -> list[ElasticMode]:
    """The vibration modes of an arm with free drives that show at some joint, sorted by frequency.

    ``mass`` is M(q) of the links (n, n), kg m^2. The peak of a mode is that at the joint where it is largest.
    """
    modes: list[ElasticMode] = []
    for mode in (mode for joint in range(len(mass)) for mode in elastic_modes(mass, joint, joints, None)):
        same = [k for k, candidate in enumerate(modes) if abs(candidate.frequency / mode.frequency - 1.0) < SAME]
        if not same:
            modes.append(mode)
        elif mode.peak > modes[same[0]].peak:
            modes[same[0]] = mode
    return sorted(modes, key=lambda mode: mode.frequency)


def linear_model(mass: Array, joints: FlexibleJoints | None, base: FlexibleBase | None) -> tuple[Array, Array, Array]:
    """State-space matrices A, B, C of the arm at rest, with the state [positions; speeds] of links, rotors and base.

    The inputs are the joint torques (n,), the outputs the encoder readings (n,). ``mass`` is M(q) (n, n) of the links,
    kg m^2, or with rigid joints of links and drives.
    """
    n = len(mass)
    parts = n if joints is None else 2 * n
    size = parts + (base is not None)
    inertia, stiffness, damping = (np.zeros((size, size)) for _ in range(3))
    inertia[:n, :n] = mass
    if joints is not None:
        inertia[n:parts, n:parts] = np.diag(joints.rotor_inertia)
        for matrix, values in ((stiffness, joints.stiffness), (damping, joints.damping)):
            matrix[:parts, :parts] = np.kron(np.array([[1.0, -1.0], [-1.0, 1.0]]), np.diag(values))
    force, read = np.zeros((size, n)), np.zeros((n, size))
    force[parts - n : parts], read[:, parts - n : parts] = np.eye(n), np.eye(n)
    if base is not None:
        inertia[-1, -1], stiffness[-1, -1], damping[-1, -1] = base.inertia, base.stiffness, base.damping
        force[-1, 0], read[0, -1] = -1.0, -1.0
    inverse: Any = np.linalg.inv(inertia)
    A = np.block([[np.zeros((size, size)), np.eye(size)], [-inverse @ stiffness, -inverse @ damping]])
    B = np.vstack([np.zeros((size, n)), inverse @ force])
    return A, B, np.hstack([read, np.zeros((n, size))])
