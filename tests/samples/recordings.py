"""Recordings made for the tests: an exact arm on Fourier motions, written in many formats."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from samples.stand_in import NumericModel, Row

SHARED = Path(__file__).resolve().parents[3] / "shared" / "data"


def fourier_motion(t, joints, seed, base=0.2, harmonics=5, size=0.8):
    """Position, speed, acceleration (N, joints), exact derivatives of one another."""
    rng = np.random.default_rng(seed)
    q, dq, ddq = (np.zeros((len(t), joints)) for _ in range(3))
    for j in range(joints):
        q[:, j] += rng.uniform(-1, 1)
        for h in range(1, harmonics + 1):
            w = 2 * np.pi * base * h
            a, b = rng.normal(size=2) * size
            q[:, j] += (a * np.sin(w * t) - b * np.cos(w * t)) / w
            dq[:, j] += a * np.cos(w * t) + b * np.sin(w * t)
            ddq[:, j] += w * (b * np.cos(w * t) - a * np.sin(w * t))
    return q, dq, ddq


def point_masses(links, seed, points=8):
    """Standard parameters (10 links,) of links made of point masses: physically possible by construction."""
    rng = np.random.default_rng(seed)
    phi = []
    for _ in range(links):
        m = rng.uniform(0.2, 1.0, points)
        r = rng.normal(size=(points, 3)) * 0.15
        S = sum(mk * ((rk @ rk) * np.eye(3) - np.outer(rk, rk)) for mk, rk in zip(m, r, strict=True))
        phi += [m.sum(), *(m @ r), S[0, 0], S[0, 1], S[1, 1], S[0, 2], S[1, 2], S[2, 2]]
    return np.array(phi)


def planar_arm(gravity=9.81):
    return NumericModel([Row(0.0, 0.4, 0.0), Row(0.0, 0.3, 0.0)], gravity=(0.0, -gravity, 0.0))


def write_log(path, log):
    """Write a recording as CSV in rrrgen's own columns, with 17 digits: what is read back is equal."""
    columns, names = [log.t], ["t"]
    for key, values in (("q", log.q), ("dq", log.dq), ("ddq", log.ddq), ("tau", log.tau)):
        if values is not None:
            columns += list(values.T)
            names += [f"{key}_{joint}" for joint in log.joints]
    with open(path, "w", encoding="utf-8", newline="\n") as stream:
        stream.write(",".join(names) + "\n")
        np.savetxt(stream, np.column_stack(columns), fmt="%.17g", delimiter=",")
