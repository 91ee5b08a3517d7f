"""A purely numeric rigid-body model of a serial arm: an oracle for the estimation tests, sharing no code with rrrgen.

Batched Newton-Euler in the base frame, linear in the standard parameters ``m, mx, my, mz, Ixx, Ixy, Iyy, Ixz, Iyz,
Izz`` of every link (inertia tensor about the origin of the link frame, in its axes).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

STANDARD_NAMES = ("m", "mx", "my", "mz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")


@dataclass
class Row:
    """One row of the DH table with what the identification needs of its joint."""

    alpha: float
    a: float
    d: float
    theta: float = 0.0
    type: str = "revolute"


@dataclass
class NumericModel:
    """The public face of ``rrrgen.compile`` as far as identification uses it, computed with NumPy."""

    rows: list[Row]
    convention: str = "standard"
    gravity: tuple[float, float, float] = (0.0, 0.0, -9.81)
    spec: Any = None
    seed: int = 7
    base_projection: np.ndarray = field(init=False)
    base_parameter_names: tuple[str, ...] = field(init=False)

    def __post_init__(self) -> None:
        self.n = len(self.rows)
        rng = np.random.default_rng(self.seed)
        q, dq, ddq = (rng.uniform(-3.0, 3.0, (200, self.n)) for _ in range(3))
        W = self.standard_regressor(q, dq, ddq).reshape(-1, 10 * self.n)
        self.kept, self.base_projection = _independent_columns(W)
        names = [f"{name}{i + 1}" for i in range(self.n) for name in STANDARD_NAMES]
        self.base_parameter_names = tuple(_combination(names, row) for row in self.base_projection)
        self.beta = None

    def link_frames(self, q: np.ndarray) -> np.ndarray:
        q = np.asarray(q, float)
        T = np.broadcast_to(np.eye(4), (*q.shape[:-1], 4, 4))
        frames = []
        for i, row in enumerate(self.rows):
            T = T @ _dh(row, q[..., i], self.convention)
            frames.append(T)
        return np.stack(frames, axis=-3)

    def _axes(self, frames: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Direction and a point of every joint axis, in the base frame."""
        if self.convention == "modified":
            return frames[..., :, :3, 2], frames[..., :, :3, 3]
        ground = np.broadcast_to(np.eye(4), (*frames.shape[:-3], 1, 4, 4))
        before = np.concatenate([ground, frames[..., :-1, :, :]], axis=-3)
        return before[..., :, :3, 2], before[..., :, :3, 3]

    def standard_regressor(self, q: np.ndarray, dq: np.ndarray, ddq: np.ndarray) -> np.ndarray:
        q, dq, ddq = (np.asarray(v, float) for v in (q, dq, ddq))
        frames = self.link_frames(q)
        z, p = self._axes(frames)
        w = np.zeros((*q.shape[:-1], 3))
        dw, acc = w.copy(), w - np.asarray(self.gravity)
        at = np.zeros_like(w)
        Y = np.zeros((*q.shape[:-1], self.n, 10 * self.n))
        for j, row in enumerate(self.rows):
            s, ds = dq[..., j, None], ddq[..., j, None]
            zj, origin = z[..., j, :], frames[..., j, :3, 3]
            if row.type == "revolute":
                # move to the axis with the old body's motion, then turn
                r = p[..., j, :] - at
                acc = acc + np.cross(dw, r) + np.cross(w, np.cross(w, r))
                dw = dw + ds * zj + np.cross(w, s * zj)
                w = w + s * zj
                r = origin - p[..., j, :]
                acc = acc + np.cross(dw, r) + np.cross(w, np.cross(w, r))
            else:
                r = origin - at
                acc = acc + np.cross(dw, r) + np.cross(w, np.cross(w, r)) + 2 * np.cross(w, s * zj) + ds * zj
            at = origin
            F, N = _wrench_regressor(frames[..., j, :3, :3], w, dw, acc)
            for i in range(j + 1):
                if self.rows[i].type == "revolute":
                    lever = np.cross(z[..., i, :], origin - p[..., i, :])
                    block = np.einsum("...k,...kp->...p", z[..., i, :], N) + np.einsum("...k,...kp->...p", lever, F)
                else:
                    block = np.einsum("...k,...kp->...p", z[..., i, :], F)
                Y[..., i, 10 * j : 10 * j + 10] = block
        return Y

    def regressor(self, q: np.ndarray, dq: np.ndarray, ddq: np.ndarray) -> np.ndarray:
        return self.standard_regressor(q, dq, ddq)[..., self.kept]

    def inverse_dynamics(self, q: np.ndarray, dq: np.ndarray, ddq: np.ndarray, beta: np.ndarray) -> np.ndarray:
        return self.regressor(q, dq, ddq) @ np.asarray(beta)

    def mass_matrix(self, q: np.ndarray, beta: np.ndarray) -> np.ndarray:
        q = np.asarray(q, float)
        zero = np.zeros_like(q)
        still = self.regressor(q, zero, zero)
        columns = [(self.regressor(q, zero, zero + e) - still) @ beta for e in np.eye(self.n)]
        return np.stack(columns, axis=-1)


def _dh(row: Row, q: np.ndarray, convention: str) -> np.ndarray:
    turn = row.theta + (q if row.type == "revolute" else 0.0 * q)
    slide = row.d + (q if row.type == "prismatic" else 0.0 * q)
    c, s = np.cos(turn), np.sin(turn)
    ca, sa = np.cos(row.alpha), np.sin(row.alpha)
    T = np.zeros((*np.shape(q), 4, 4))
    T[..., 3, 3] = 1.0
    if convention == "standard":
        entries = [
            [c, -ca * s, sa * s, row.a * c],
            [s, ca * c, -sa * c, row.a * s],
            [0 * c, sa + 0 * c, ca + 0 * c, slide],
        ]
    else:
        entries = [
            [c, -s, 0 * c, row.a + 0 * c],
            [s * ca, c * ca, -sa + 0 * c, -slide * sa],
            [s * sa, c * sa, ca + 0 * c, slide * ca],
        ]
    for i, line in enumerate(entries):
        for j, entry in enumerate(line):
            T[..., i, j] = entry
    return T


def _skew(v: np.ndarray) -> np.ndarray:
    S = np.zeros((*v.shape[:-1], 3, 3))
    S[..., 0, 1], S[..., 0, 2], S[..., 1, 2] = -v[..., 2], v[..., 1], -v[..., 0]
    return S - np.swapaxes(S, -1, -2)


def _inertia_times(v: np.ndarray) -> np.ndarray:
    """L(v) with I v = L(v) [Ixx, Ixy, Iyy, Ixz, Iyz, Izz]."""
    x, y, z = v[..., 0], v[..., 1], v[..., 2]
    o = np.zeros_like(x)
    return np.stack([np.stack(line, -1) for line in ([x, y, o, z, o, o], [o, x, y, o, z, o], [o, o, o, x, y, z])], -2)


def _wrench_regressor(R: np.ndarray, w: np.ndarray, dw: np.ndarray, acc: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Force and moment (at the frame origin, base axes) that move one link, linear in its ten parameters."""
    Rt = np.swapaxes(R, -1, -2)
    w, dw, acc = (np.einsum("...ij,...j->...i", Rt, v) for v in (w, dw, acc))
    F = np.zeros((*w.shape[:-1], 3, 10))
    N = np.zeros_like(F)
    F[..., :, 0] = acc
    F[..., :, 1:4] = _skew(dw) + _skew(w) @ _skew(w)
    N[..., :, 1:4] = -_skew(acc)
    N[..., :, 4:] = _inertia_times(dw) + _skew(w) @ _inertia_times(w)
    return R @ F, R @ N


def _independent_columns(W: np.ndarray, tolerance: float = 1e-9) -> tuple[list[int], np.ndarray]:
    """Leftmost independent columns and K with ``W = W[:, kept] @ K``, by Gram-Schmidt done twice."""
    Q = np.zeros((W.shape[0], 0))
    kept: list[int] = []
    largest = np.linalg.norm(W, axis=0).max()
    for j in range(W.shape[1]):
        v = W[:, j].copy()
        size = np.linalg.norm(v)
        for _ in range(2):
            v -= Q @ (Q.T @ v)
        # a column of nothing but round-off (cos(pi/2) = 6e-17) is a zero column
        if size > 1e-12 * largest and np.linalg.norm(v) > tolerance * size:
            kept.append(j)
            Q = np.column_stack([Q, v / np.linalg.norm(v)])
    K = np.linalg.lstsq(W[:, kept], W, rcond=None)[0]
    K[np.abs(K) < 1e-9] = 0.0
    return kept, K


def _combination(names: list[str], row: np.ndarray) -> str:
    chosen = [(name, c) for name, c in zip(names, row, strict=True) if c]
    terms = [f"{c:+.6g}*{n}" if abs(abs(c) - 1) > 1e-9 else f"{'+' if c > 0 else '-'}{n}" for n, c in chosen]
    return " ".join(terms).removeprefix("+")


HALF_PI = np.pi / 2
TX40_ROWS = [
    Row(0.0, 0.0, 0.320),
    Row(-HALF_PI, 0.0, 0.0),
    Row(0.0, 0.225, 0.035),
    Row(HALF_PI, 0.0, 0.225),
    Row(-HALF_PI, 0.0, 0.0),
    Row(HALF_PI, 0.0, 0.0, np.pi),
]
RRR_ROWS = [Row(HALF_PI, 0.0, 0.560), Row(0.0, 0.200, 0.169), Row(0.0, 0.415, 0.090)]
