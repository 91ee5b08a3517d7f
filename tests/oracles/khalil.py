"""OpenSYMORO's parameters evaluated as they are defined: elementary matrices, energies of pseudo-inertias.

``columns`` holds per name of a .par file one number for each frame (``Z`` 16 numbers, ``G`` 3); ``ant`` is the frame
(from 1, 0 the base) that each follows, the one before it if missing.
"""

from __future__ import annotations

import numpy as np

REVOLUTE, PRISMATIC = 0, 1


def turn(axis: int, angle) -> np.ndarray:
    T = np.eye(4, dtype=complex)
    i, j = ((1, 2), (2, 0), (0, 1))[axis]
    T[i, i] = T[j, j] = np.cos(angle)
    T[j, i] = np.sin(angle)
    T[i, j] = -T[j, i]
    return T


def shift(axis: int, length) -> np.ndarray:
    T = np.eye(4, dtype=complex)
    T[axis, 3] = length
    return T


def frames(columns: dict, q) -> np.ndarray:
    """Poses of all frames, before ``Z`` is left out: in the frame that Z refers to; q of the moving joints."""
    base = np.reshape(columns.get("Z", np.eye(4)), (4, 4)).astype(complex)
    count, values, found = len(columns["sigma"]), iter(q), []
    for j in range(count):
        before = int(columns.get("ant", range(count))[j])
        T = found[before - 1] if before else base
        gamma, b, alpha, d, theta, r = (
            columns.get(key, [0.0] * count)[j] for key in ("gamma", "b", "alpha", "d", "theta", "r")
        )
        if columns["sigma"][j] == REVOLUTE:
            theta = theta + next(values)
        elif columns["sigma"][j] == PRISMATIC:
            r = r + next(values)
        T = T @ turn(2, gamma) @ shift(2, b) @ turn(0, alpha) @ shift(0, d) @ turn(2, theta) @ shift(2, r)
        found.append(T)
    return np.array(found)


def energies(columns: dict, q, dq) -> tuple[float, float]:
    """Kinetic and potential energy, without drive inertia; the velocity of every frame by the complex step."""
    step = 1e-30
    T = frames(columns, np.asarray(q) + 1j * step * np.asarray(dq))
    kinetic = potential = 0.0
    R0 = np.reshape(columns.get("Z", np.eye(4)), (4, 4))[:3, :3]
    for j, pose in enumerate(T):
        m, h, xx, yy, zz = (
            columns["M"][j],
            [columns[k][j] for k in ("MX", "MY", "MZ")],
            *(columns[k][j] for k in ("XX", "YY", "ZZ")),
        )
        xy, xz, yz = (columns[k][j] for k in ("XY", "XZ", "YZ"))
        half = (xx + yy + zz) / 2
        second = [[half - xx, -xy, -xz], [-xy, half - yy, -yz], [-xz, -yz, half - zz]]
        J = np.block([[np.array(second), np.reshape(h, (3, 1))], [np.reshape(h, (1, 3)), np.array([[m]])]])
        rate = pose.imag / step
        kinetic += np.trace(rate @ J @ rate.T) / 2
        potential -= (R0 @ columns["G"]) @ (pose.real @ J)[:3, 3]
    return float(kinetic), float(potential)
