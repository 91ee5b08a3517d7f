"""A motion of a floating base and its joints in closed form, for recordings whose truth is known."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from rrrgen.base.arrays import Array

FREQUENCIES = 2.0 * np.pi * np.array([0.3, 0.7, 1.1, 1.6])


def _series(rng: np.random.Generator, t: Array, k: int, amplitude: float) -> tuple[Array, Array, Array]:
    """A random Fourier series of ``k`` coordinates at the times ``t`` and its two derivatives."""
    w = FREQUENCIES[:, None, None]
    a, b = 2.0 * rng.uniform(-amplitude, amplitude, (2, len(FREQUENCIES), 1, k)) / w
    c, s = np.cos(w * t[:, None]), np.sin(w * t[:, None])
    q, dq = (a * s + b * c).sum(0), (w * (a * c - b * s)).sum(0)
    return q, dq, (-(w**2) * (a * s + b * c)).sum(0)


def floating_motion(n: int, seed: int, duration: float = 6.0, rate: float = 100.0) -> dict[str, Array]:
    """Arrays ``t``, ``q``, ``dq``, ``ddq`` (N, n), ``orientation``, ``twist`` and ``twist_rate`` of a motion."""
    rng = np.random.default_rng(seed)
    t = np.arange(round(duration * rate)) / rate
    q, dq, ddq = _series(rng, t, n, 0.6)
    (yaw, pitch, roll), (dy, dp, dr), (ddy, ddp, ddr) = (x.T for x in _series(rng, t, 3, 0.4))
    _, velocity, acceleration = _series(rng, t, 3, 0.4)
    turned = Rotation.from_euler("ZYX", np.stack([yaw, pitch, roll], axis=1))
    R = turned.as_matrix()
    cr, sr, cp, sp = np.cos(roll), np.sin(roll), np.cos(pitch), np.sin(pitch)
    omega = np.stack([dr - sp * dy, cr * dp + sr * cp * dy, -sr * dp + cr * cp * dy], axis=1)
    up, across = cp * ddy - sp * dp * dy, cp * dy
    alpha = np.stack(
        [
            ddr - cp * dp * dy - sp * ddy,
            cr * ddp - sr * dr * dp + sr * up + cr * dr * across,
            -sr * ddp - cr * dr * dp + cr * up - sr * dr * across,
        ],
        axis=1,
    )
    v, a = (np.einsum("kji,kj->ki", R, x) for x in (velocity, acceleration))
    return {
        "t": t,
        "q": q,
        "dq": dq,
        "ddq": ddq,
        "orientation": turned.as_quat(),
        "twist": np.hstack([v, omega]),
        "twist_rate": np.hstack([a - np.cross(omega, v), alpha]),
    }


def falling(m: Any, motion: dict[str, Array]) -> dict[str, Array]:
    """A flight with the joint motion of ``motion``: the twist that no wrench gives it, by Runge-Kutta's fourth order.

    The steps are twice those of the recording, and so are those of the returned arrays.
    """
    t, state = motion["t"], [motion[key] for key in ("q", "dq", "ddq")]
    h = 2.0 * (t[1] - t[0])

    def rates(k: int, quaternion: Array, twist: Array) -> tuple[Array, Array]:
        q, dq, ddq = (x[k] for x in state)
        unit = quaternion / np.linalg.norm(quaternion)
        own = m.floating_inverse_dynamics(q, dq, ddq, orientation=unit, twist=twist, twist_rate=np.zeros(6))
        M = m.floating_mass_matrix(q)
        x, y, z, w = quaternion
        wx, wy, wz = twist[3:]
        turned = [w * wx + y * wz - z * wy, w * wy + z * wx - x * wz, w * wz + x * wy - y * wx]
        return 0.5 * np.array([*turned, -x * wx - y * wy - z * wz]), -np.linalg.solve(M[:6, :6], own.wrench)

    quaternion, twist = motion["orientation"][0], motion["twist"][0]
    found: dict[str, list[Array]] = {"orientation": [], "twist": [], "twist_rate": []}
    for k in range(0, len(t) - 2, 2):
        r1, a1 = rates(k, quaternion, twist)
        for key, value in zip(found, (quaternion, twist, a1), strict=True):
            found[key].append(value)
        r2, a2 = rates(k + 1, quaternion + h / 2 * r1, twist + h / 2 * a1)
        r3, a3 = rates(k + 1, quaternion + h / 2 * r2, twist + h / 2 * a2)
        r4, a4 = rates(k + 2, quaternion + h * r3, twist + h * a3)
        quaternion = quaternion + h / 6 * (r1 + 2 * r2 + 2 * r3 + r4)
        quaternion, twist = quaternion / np.linalg.norm(quaternion), twist + h / 6 * (a1 + 2 * a2 + 2 * a3 + a4)
    kept = {key: np.array(values) for key, values in found.items()}
    count = len(kept["twist"])
    return {key: motion[key][: 2 * count : 2] for key in ("t", "q", "dq", "ddq")} | kept
