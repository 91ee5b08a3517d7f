"""A chain in joint frames (modified Denavit-Hartenberg rows) with its inertias regrouped, all as plain numbers.

Written for the hand-made rival alone: it shares no code with the compiler that it is compared with.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rrrgen.verify.references.numeric_robot import Array, NumericRobot, inertia_tensor

SNAP = 1e-14
"""Sines and cosines of fixed angles nearer than this to an integer are that integer."""


@dataclass(frozen=True)
class JointRow:
    """Frame j in frame j - 1: ``Rx(alpha) Tx(a) Tz(d) Rz(q + theta)``, with the sine and cosine of alpha."""

    ca: float
    sa: float
    a: float
    d: float
    theta: float

    @property
    def p(self) -> tuple[float, float, float]:
        """Origin of frame j in frame j - 1."""
        return self.a, -self.d * self.sa, self.d * self.ca

    def matrix(self, q: float) -> Array:
        """The 4x4 transform at ``q``."""
        c, s = np.cos(q + self.theta), np.sin(q + self.theta)
        return np.array(
            [
                [c, -s, 0.0, self.p[0]],
                [self.ca * s, self.ca * c, -self.sa, self.p[1]],
                [self.sa * s, self.sa * c, self.ca, self.p[2]],
                [0.0, 0.0, 0.0, 1.0],
            ]
        )


@dataclass(frozen=True)
class JointFrames:
    """Rows, gravity in the axes of the foot, pseudo-inertias (n, 4, 4) in joint frames, foot and tool transforms."""

    rows: tuple[JointRow, ...]
    gravity: Array
    pseudo_inertias: Array
    foot: Array
    tool: Array

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.rows)


def joint_frames(chain: NumericRobot, phi: Array) -> JointFrames:
    """``chain`` in joint frames, with standard parameters ``phi`` (n, 10) of its link frames; revolute joints only."""
    if not all(chain.revolute):
        raise ValueError("the hand-made rival is written for revolute joints")
    n = chain.n
    alpha, a, d = chain.alpha.copy(), chain.a.copy(), chain.d.copy()
    links = [np.eye(4) for _ in range(n)]  # user's link frame in the joint frame
    tool = chain.tool
    if chain.convention == "standard":
        links = [_screw_x(alpha[i], a[i]) for i in range(n)]
        tool = links[-1] @ tool
        alpha, a = np.r_[0.0, alpha[:-1]], np.r_[0.0, a[:-1]]
    for j in reversed(range(1, n)):  # along parallel axes all shifts go into the first of them
        if abs(np.sin(alpha[j])) < SNAP and np.cos(alpha[j]) > 0:
            shift, d[j] = d[j], 0.0
            d[j - 1] += shift
            links[j - 1] = _shift_z(-shift) @ links[j - 1]
    rows = tuple(
        JointRow(
            _snapped(np.cos(alpha[j])), _snapped(np.sin(alpha[j])), float(a[j]), float(d[j]), float(chain.theta[j])
        )
        for j in range(n)
    )
    inertias = np.stack([links[j] @ pseudo_inertia(phi[j]) @ links[j].T for j in range(n)])
    return JointFrames(rows, chain.base[:3, :3].T @ chain.gravity, inertias, chain.base, tool)


def regrouped(frames: JointFrames) -> Array:
    """Pseudo-inertias (n, 4, 4) with the same dynamics and m = hz = Ezz = 0.

    These three entries do not change under a turn about z, so they can be carried into the link before. Of link 1,
    where gravity is along its axis, only the moment about the axis acts; it stands in Exx.
    """
    P = frames.pseudo_inertias.copy()
    for j in reversed(range(frames.n)):
        moved = np.zeros((4, 4))
        for place in ((3, 3), (2, 3), (3, 2), (2, 2)):
            moved[place] = P[j][place]
        P[j] -= moved
        if j:
            T = frames.rows[j].matrix(0.0)
            P[j - 1] += T @ moved @ T.T
    if first_axis_vertical(frames):
        moment = P[0, 0, 0] + P[0, 1, 1]
        P[0] = 0.0
        P[0, 0, 0] = moment
    return P


def first_axis_vertical(frames: JointFrames) -> bool:
    """Whether gravity is along the first axis."""
    axis = frames.rows[0].matrix(0.0)[:3, 2]
    return bool(np.linalg.norm(np.cross(axis, frames.gravity)) < SNAP)


def pseudo_inertia(phi: Array) -> Array:
    """``[[E, h], [h', m]]`` with E the integral of r r' dm, from ten standard parameters."""
    S = inertia_tensor(phi)
    P = np.zeros((4, 4))
    P[:3, :3] = 0.5 * np.trace(S) * np.eye(3) - S
    P[:3, 3] = P[3, :3] = phi[1:4]
    P[3, 3] = phi[0]
    return P


def _screw_x(alpha: float, a: float) -> Array:
    c, s = _snapped(np.cos(alpha)), _snapped(np.sin(alpha))
    return np.array([[1, 0, 0, a], [0, c, -s, 0], [0, s, c, 0], [0, 0, 0, 1.0]])


def _shift_z(d: float) -> Array:
    T = np.eye(4)
    T[2, 3] = d
    return T


def _snapped(value: float) -> float:
    return float(round(value)) if abs(value - round(value)) < SNAP else float(value)
