"""The strongest code a user can write by hand: Newton-Euler and composite bodies in CasADi with all numbers folded in.

It works in joint frames, with the pseudo-inertia form ``N = vex(U E - (U E)')``, ``U = [dw]x + [w]x [w]x``, and with
regrouped inertias (m, hz and Ezz of every link are zero). CasADi generates the C code.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass
from typing import Any

import numpy as np

from bench.contenders.joint_frames import JointFrames, JointRow, regrouped
from rrrgen.verify.references.numeric_robot import Array

Vector = tuple[Any, Any, Any]
Tensor = tuple[Any, Any, Any, Any, Any, Any]  # 00, 01, 11, 02, 12, 22

ZERO: Vector = (0.0, 0.0, 0.0)
BASE_COLUMNS = 7
"""Columns per link: hx, hy, E00, E01, E11, E02, E12."""


@dataclass(frozen=True)
class HandFunctions:
    """CasADi functions by name, and for regressors, by name, the parameters that they multiply."""

    functions: dict[str, Any]
    parameters: dict[str, Array]


def hand_functions(frames: JointFrames, names: Collection[str] | None = None) -> HandFunctions:
    """The functions for one robot with its numbers folded in: those in ``names``, or all."""
    import casadi as ca

    arm = HandArm(frames, regrouped(frames))
    q, dq, ddq, e = (ca.SX.sym(name, frames.n) for name in ("q", "dq", "ddq", "e"))
    tau = ddq  # the third input of forward dynamics
    ways: dict[str, tuple[list[Any], Callable[[], list[Any]]]] = {
        "inverse_dynamics": ([q, dq, ddq], lambda: arm.inverse_dynamics(q, dq, ddq)),
        "mass_matrix": ([q], lambda: _flat(arm.mass_matrix(q))),
        "bias": ([q, dq], lambda: arm.inverse_dynamics(q, dq, None)),
        "gravity": ([q], lambda: arm.gravity(q)),
        "forward_dynamics": (
            [q, dq, tau],
            lambda: _solve(arm.mass_matrix(q), arm.inverse_dynamics(q, dq, None), tau),
        ),
        "inverse_dynamics_derivatives": (
            [q, dq, ddq],
            lambda: _with_derivatives(arm.inverse_dynamics(q, dq, ddq), (q, dq, ddq)),
        ),
        "forward_dynamics_derivatives": (
            [q, dq, tau],
            lambda: _with_derivatives(_solve(arm.mass_matrix(q), arm.inverse_dynamics(q, dq, None), tau), (q, dq, tau)),
        ),
        "kinematics": ([q], lambda: arm.kinematics(q)),
        "regressor": ([q, dq, ddq], lambda: _flat(arm.regressor(q, dq, ddq, standard=False))),
        "standard_regressor": ([q, dq, ddq], lambda: _flat(arm.regressor(q, dq, ddq, standard=True))),
        "regressor_transpose": ([q, dq, ddq, e], lambda: arm.regressor_transpose(q, dq, ddq, e)),
    }
    functions = {
        name: ca.Function(f"hand_{name}", inputs, [ca.cse(ca.densify(ca.vertcat(*way())))])
        for name, (inputs, way) in ways.items()
        if names is None or name in names
    }
    base, standard = arm.base_parameters(), arm.standard_parameters()
    parameters = {"regressor": base, "regressor_transpose": base, "standard_regressor": standard}
    return HandFunctions(functions, parameters)


def _with_derivatives(values: list[Any], inputs: tuple[Any, ...]) -> list[Any]:
    """``values`` followed by their derivatives with respect to each input, each matrix row-major."""
    import casadi as ca

    column = ca.vertcat(*values)
    return [column, *(ca.vec(ca.jacobian(column, x).T) for x in inputs)]


class HandArm:
    """The recursions for one arm with CasADi's scalars."""

    def __init__(self, frames: JointFrames, inertias: Array) -> None:
        self.frames = frames
        self.rows = frames.rows
        self.E: list[Tensor] = [tuple(float(P[r, c]) for r, c in _PLACES) for P in inertias]  # type: ignore[misc]
        self.h: list[tuple[float, float]] = [(float(P[0, 3]), float(P[1, 3])) for P in inertias]
        self._used = [np.r_[P[0, 3], P[1, 3], [P[r, c] for r, c in _PLACES[:5]]] for P in inertias]

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.rows)

    def _outward(self, q: Any, dq: Any, ddq: Any) -> tuple[list[Turn], list[list[Vector]], list[Vector]]:
        """For every link the joint transform, U, and the acceleration of the origin (gravity included)."""
        g = self.frames.gravity
        w, dw, a = ZERO, ZERO, (-float(g[0]), -float(g[1]), -float(g[2]))
        U: list[Vector] = [ZERO, ZERO, ZERO]
        turns, us, accelerations = turns_of(self.rows, q), [], []
        for j, turn in enumerate(turns):
            a = turn.down(_add(a, _times(U, turn.row.p)))
            w, dw = turn.down(w), turn.down(dw)
            rate = dq[j]
            dw = (dw[0] + w[1] * rate, dw[1] - w[0] * rate, dw[2] + (0.0 if ddq is None else ddq[j]))
            w = (w[0], w[1], w[2] + rate)
            U = _velocity_matrix(w, dw)
            us.append(U)
            accelerations.append(a)
        return turns, us, accelerations

    def inverse_dynamics(self, q: Any, dq: Any, ddq: Any) -> list[Any]:
        """The joint torques (n,); with ``ddq=None`` the bias torques."""
        turns, us, accelerations = self._outward(q, dq, ddq)
        f, moment = ZERO, ZERO
        tau: list[Any] = [0.0] * self.n
        for j in reversed(range(self.n)):
            U, a, E, (hx, hy) = us[j], accelerations[j], self.E[j], self.h[j]
            own = (
                _moment(U, E)[0] + hy * a[2],
                _moment(U, E)[1] - hx * a[2],
                _moment(U, E)[2] + (hx * a[1] - hy * a[0]),
            )
            moment = _add(moment, own)
            f = _add(f, (U[0][0] * hx + U[0][1] * hy, U[1][0] * hx + U[1][1] * hy, U[2][0] * hx + U[2][1] * hy))
            tau[j] = moment[2]
            f, moment = turns[j].wrench_up(f, moment)
        return tau

    def gravity(self, q: Any) -> list[Any]:
        """The gravity torques (n,) from the first moments of composite bodies, whose regrouped mass is zero."""
        turns = turns_of(self.rows, q)
        a = (-float(self.frames.gravity[0]), -float(self.frames.gravity[1]), -float(self.frames.gravity[2]))
        accelerations = []
        for turn in turns:
            a = turn.down(a)
            accelerations.append(a)
        h, tau = ZERO, [0.0] * self.n
        for j in reversed(range(self.n)):
            h = (h[0] + self.h[j][0], h[1] + self.h[j][1], h[2])
            tau[j] = h[0] * accelerations[j][1] - h[1] * accelerations[j][0]
            h = turns[j].up(h)
        return tau

    def mass_matrix(self, q: Any) -> list[list[Any]]:
        """M (n, n) from composite bodies; only the lower triangle is computed."""
        turns = turns_of(self.rows, q)
        M: list[list[Any]] = [[0.0] * self.n for _ in range(self.n)]
        E, h = (0.0,) * 6, ZERO
        for j in reversed(range(self.n)):
            E = tuple(x + y for x, y in zip(E, self.E[j], strict=True))
            h = (h[0] + self.h[j][0], h[1] + self.h[j][1], h[2])
            M[j][j] = E[0] + E[2]
            E, h, f, moment = turns[j].body_up(E, h)
            for i in reversed(range(j)):
                M[j][i] = M[i][j] = moment[2]
                f, moment = turns[i].wrench_up(f, moment)
        return M

    def kinematics(self, q: Any) -> list[Any]:
        """Tip pose (16, row-major), then Jacobian (6 n, row-major, linear rows first)."""
        R = _constant_rows(self.frames.foot[:3, :3])
        p: Vector = tuple(_snap(x) for x in self.frames.foot[:3, 3])  # type: ignore[assignment]
        axes, origins = [], []
        for turn in turns_of(self.rows, q):
            p = _add(p, _times(R, turn.row.p))
            R = [turn.down(row) for row in R]
            axes.append((R[0][2], R[1][2], R[2][2]))
            origins.append(p)
        tool = self.frames.tool
        p = _add(p, _times(R, tuple(_snap(x) for x in tool[:3, 3])))  # type: ignore[arg-type]
        columns = _constant_rows(tool[:3, :3].T)
        R = [tuple(_dot(row, column) for column in columns) for row in R]
        linear = [_cross(z, _add(p, tuple(-x for x in o))) for z, o in zip(axes, origins, strict=True)]
        pose = [x for k in range(3) for x in (*R[k], p[k])] + [0.0, 0.0, 0.0, 1.0]
        return pose + [v[k] for k in range(3) for v in linear] + [z[k] for k in range(3) for z in axes]

    def regressor(self, q: Any, dq: Any, ddq: Any, standard: bool) -> list[list[Any]]:
        """The rows of Y: power of the wrench of every parameter of link j for a unit rate of joint i <= j."""
        turns, us, accelerations = self._outward(q, dq, ddq)
        columns = [
            (_standard_columns if standard else _base_columns)(U, a) for U, a in zip(us, accelerations, strict=True)
        ]
        width = len(columns[0])
        Y: list[list[Any]] = [[0.0] * (width * self.n) for _ in range(self.n)]
        for i in range(self.n):
            axis, lever = (0.0, 0.0, 1.0), ZERO
            for j in range(i, self.n):
                if j > i:
                    axis, lever = turns[j].twist_down(axis, lever)
                for k, (f, moment) in enumerate(columns[j]):
                    Y[i][j * width + k] = _dot(axis, moment) + _dot(lever, f)
        return self._drop(Y, width)

    def regressor_transpose(self, q: Any, dq: Any, ddq: Any, e: Any) -> list[Any]:
        """Y' e in one pass, with the joint axes weighted by e and summed."""
        turns, us, accelerations = self._outward(q, dq, ddq)
        axis, lever, r = ZERO, ZERO, []
        for j, turn in enumerate(turns):
            axis, lever = turn.twist_down(axis, lever)
            axis = (axis[0], axis[1], axis[2] + e[j])
            r += [_dot(axis, moment) + _dot(lever, f) for f, moment in _base_columns(us[j], accelerations[j])]
        return self._drop([r], BASE_COLUMNS)[0]

    def _drop(self, Y: list[list[Any]], width: int) -> list[list[Any]]:
        """``Y`` without the columns of link 1 that have no effect; only its moment about the axis stays."""
        if width != BASE_COLUMNS or not self._first_is_reduced():
            return Y
        return [[row[2], *row[BASE_COLUMNS:]] for row in Y]

    def _first_is_reduced(self) -> bool:
        return not np.any(np.delete(self._used[0], 2))

    def base_parameters(self) -> Array:
        """The base parameters, which :meth:`regressor` multiplies to give torques."""
        first = self._used[0][2:3] if self._first_is_reduced() else self._used[0]
        return np.concatenate([first, *self._used[1:]])

    def standard_parameters(self) -> Array:
        """The parameters that the standard regressor multiplies: m, h, E of every link in joint frames."""
        return np.concatenate(
            [np.r_[P[3, 3], P[:3, 3], [P[r, c] for r, c in _PLACES]] for P in self.frames.pseudo_inertias]
        )


_PLACES = ((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2))


@dataclass(frozen=True)
class Turn:
    """The transform from one joint frame to the next, with the sine and cosine of the joint."""

    row: JointRow
    c: Any
    s: Any

    def down(self, v: Vector) -> Vector:
        """The vector ``v``, expressed in the next frame."""
        ca, sa = self.row.ca, self.row.sa
        x, y, z = v[0], ca * v[1] + sa * v[2], ca * v[2] - sa * v[1]
        return self.c * x + self.s * y, self.c * y - self.s * x, z

    def up(self, v: Vector) -> Vector:
        """The vector ``v``, expressed in the previous frame."""
        x, y = self.c * v[0] - self.s * v[1], self.s * v[0] + self.c * v[1]
        ca, sa = self.row.ca, self.row.sa
        return x, ca * y - sa * v[2], sa * y + ca * v[2]

    def wrench_up(self, f: Vector, moment: Vector) -> tuple[Vector, Vector]:
        """Force and moment, moved to the previous origin and frame."""
        f = self.up(f)
        return f, _add(self.up(moment), _cross(self.row.p, f))

    def twist_down(self, axis: Vector, lever: Vector) -> tuple[Vector, Vector]:
        """Angular and linear velocity, moved to the next origin and frame."""
        return self.down(axis), self.down(_add(lever, _cross(axis, self.row.p)))

    def body_up(self, E: Tensor, h: Vector) -> tuple[Tensor, Vector, Vector, Vector]:
        """Second and first moments of a body of mass zero about the origin before, and its wrench.

        The wrench (force, moment) is that of a unit acceleration of this joint. Taken after the turn it costs nothing
        at right angles, because the axis has constant components there.
        """
        c, s, ca, sa, p = self.c, self.s, self.row.ca, self.row.sa, self.row.p
        x = s * (E[2] - E[0]) - c * (E[1] + E[1])
        sx, cx = s * x, c * x
        e00, e01, e11 = E[0] + sx, -cx - E[1], E[2] - sx
        e02, e12, e22 = c * E[3] - s * E[4], s * E[3] + c * E[4], E[5]
        f01, f02 = ca * e01 - sa * e02, sa * e01 + ca * e02
        f11 = ca * ca * e11 - 2 * ca * sa * e12 + sa * sa * e22
        f22 = sa * sa * e11 + 2 * ca * sa * e12 + ca * ca * e22
        f12 = ca * sa * (e11 - e22) + (ca * ca - sa * sa) * e12
        h = self.up(h)
        force = (-sa * h[2] - ca * h[1], ca * h[0], sa * h[0])
        moment = (sa * f01 - ca * f02, -sa * (e00 + f22) - ca * f12, ca * (e00 + f11) + sa * f12)
        moved = (
            e00 + 2 * p[0] * h[0],
            f01 + p[0] * h[1] + p[1] * h[0],
            f11 + 2 * p[1] * h[1],
            f02 + p[0] * h[2] + p[2] * h[0],
            f12 + p[1] * h[2] + p[2] * h[1],
            f22 + 2 * p[2] * h[2],
        )
        return moved, h, force, _add(moment, _cross(p, force))


def turns_of(rows: tuple[JointRow, ...], q: Any) -> list[Turn]:
    """The joint transforms at ``q``."""
    import casadi as ca

    angles = [q[j] + row.theta if row.theta else q[j] for j, row in enumerate(rows)]
    return [Turn(row, ca.cos(angle), ca.sin(angle)) for row, angle in zip(rows, angles, strict=True)]


def _velocity_matrix(w: Vector, dw: Vector) -> list[Vector]:
    x, y, z = w
    xx, yy, zz, xy, xz, yz = x * x, y * y, z * z, x * y, x * z, y * z
    return [
        (-(yy + zz), xy - dw[2], xz + dw[1]),
        (xy + dw[2], -(xx + zz), yz - dw[0]),
        (xz - dw[1], yz + dw[0], -(xx + yy)),
    ]


def _moment(U: list[Vector], E: Tensor) -> Vector:
    """vex(U E - (U E)') with E22 = 0."""
    e00, e01, e11, e02, e12, _ = E
    return (
        U[2][0] * e01 + U[2][1] * e11 + (U[2][2] - U[1][1]) * e12 - U[1][0] * e02,
        (U[0][0] - U[2][2]) * e02 + U[0][1] * e12 - U[2][0] * e00 - U[2][1] * e01,
        U[1][0] * e00 + (U[1][1] - U[0][0]) * e01 + U[1][2] * e02 - U[0][1] * e11 - U[0][2] * e12,
    )


def _base_columns(U: list[Vector], a: Vector) -> list[tuple[Vector, Vector]]:
    """Force and moment for unit values of hx, hy, E00, E01, E11, E02, E12."""
    return [
        ((U[0][0], U[1][0], U[2][0]), (0.0, -a[2], a[1])),
        ((U[0][1], U[1][1], U[2][1]), (a[2], 0.0, -a[0])),
        (ZERO, (0.0, -U[2][0], U[1][0])),
        (ZERO, (U[2][0], -U[2][1], U[1][1] - U[0][0])),
        (ZERO, (U[2][1], 0.0, -U[0][1])),
        (ZERO, (-U[1][0], U[0][0] - U[2][2], U[1][2])),
        (ZERO, (U[2][2] - U[1][1], U[0][1], -U[0][2])),
    ]


def _standard_columns(U: list[Vector], a: Vector) -> list[tuple[Vector, Vector]]:
    """Force and moment for unit values of m, hx, hy, hz, E00, E01, E11, E02, E12, E22."""
    hx, hy, *tensor = _base_columns(U, a)
    hz = ((U[0][2], U[1][2], U[2][2]), (-a[1], a[0], 0.0))
    return [(a, ZERO), hx, hy, hz, *tensor, (ZERO, (-U[1][2], U[0][2], 0.0))]


def _solve(M: list[list[Any]], bias: list[Any], tau: Any) -> list[Any]:
    """ddq = M^-1 (tau - bias) by L D L'."""
    n = len(M)
    L: list[list[Any]] = [[0.0] * n for _ in range(n)]
    D: list[Any] = [0.0] * n
    for j in range(n):
        scaled = [L[j][k] * D[k] for k in range(j)]
        D[j] = M[j][j] - sum((L[j][k] * scaled[k] for k in range(j)), 0.0)
        for i in range(j + 1, n):
            L[i][j] = (M[i][j] - sum((L[i][k] * scaled[k] for k in range(j)), 0.0)) * (1.0 / D[j])
    x = [tau[i] - bias[i] for i in range(n)]
    for i in range(n):
        x[i] = x[i] - sum((L[i][k] * x[k] for k in range(i)), 0.0)
    x = [x[i] * (1.0 / D[i]) for i in range(n)]
    for i in reversed(range(n)):
        x[i] = x[i] - sum((L[k][i] * x[k] for k in range(i + 1, n)), 0.0)
    return x


def _flat(rows: list[list[Any]]) -> list[Any]:
    """The entries of a matrix, row-major."""
    return [entry for row in rows for entry in row]


def _constant_rows(R: Array) -> list[Vector]:
    return [tuple(_snap(x) for x in row) for row in R]  # type: ignore[misc]


def _snap(x: float) -> float:
    return float(round(x)) if abs(x - round(x)) < 1e-14 else float(x)


def _add(u: Vector, v: Vector) -> Vector:
    return u[0] + v[0], u[1] + v[1], u[2] + v[2]


def _dot(u: Vector, v: Vector) -> Any:
    return u[0] * v[0] + u[1] * v[1] + u[2] * v[2]


def _cross(u: Vector, v: Vector) -> Vector:
    return u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]


def _times(A: list[Vector], v: Vector) -> Vector:
    return _dot(A[0], v), _dot(A[1], v), _dot(A[2], v)
