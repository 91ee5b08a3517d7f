"""Base regressors of small arms in CasADi, typed by hand: what the excitation tests excite."""

from __future__ import annotations

import casadi

from oracles.chapter14 import regressor_1447


def _symbols(n: int):
    return casadi.SX.sym("q", n), casadi.SX.sym("dq", n), casadi.SX.sym("ddq", n)


def rrr_regressor() -> casadi.Function:
    """(14.47), 3 x 15."""
    q, dq, ddq = _symbols(3)

    class Trigonometry:
        sin, cos = staticmethod(casadi.sin), staticmethod(casadi.cos)

        @staticmethod
        def Rational(p: int, q: int) -> float:
            return p / q

    split = [casadi.vertsplit(v) for v in (q, dq, ddq)]
    rows = regressor_1447(*split, xp=Trigonometry)
    Y = casadi.vertcat(*[casadi.horzcat(*row) for row in rows])
    return casadi.Function("regressor", [q, dq, ddq], [casadi.densify(Y)])


LENGTH, GRAVITY = 0.4, 9.81


def double_pendulum_regressor() -> casadi.Function:
    """Vertical 2R arm, first link LENGTH: 2 x 6."""
    q, dq, ddq = _symbols(2)
    s2, c2, L, g = casadi.sin(q[1]), casadi.cos(q[1]), LENGTH, GRAVITY
    s12, c12 = casadi.sin(q[0] + q[1]), casadi.cos(q[0] + q[1])
    both, swing = 2 * ddq[0] + ddq[1], 2 * dq[0] * dq[1] + dq[1] ** 2
    first = [
        ddq[0],
        ddq[0] + ddq[1],
        L * (both * c2 - swing * s2) + g * c12,
        -L * (both * s2 + swing * c2) - g * s12,
        g * casadi.cos(q[0]),
        -g * casadi.sin(q[0]),
    ]
    second = [
        0,
        ddq[0] + ddq[1],
        L * (ddq[0] * c2 + dq[0] ** 2 * s2) + g * c12,
        L * (dq[0] ** 2 * c2 - ddq[0] * s2) - g * s12,
        0,
        0,
    ]
    Y = casadi.vertcat(casadi.horzcat(*first), casadi.horzcat(*second))
    return casadi.Function("regressor", [q, dq, ddq], [casadi.densify(Y)])


def double_pendulum_torque(beta) -> casadi.Function:
    q, dq, ddq = _symbols(2)
    return casadi.Function("torque", [q, dq, ddq], [double_pendulum_regressor()(q, dq, ddq) @ casadi.DM(beta)])


def double_pendulum_tip(second: float = 0.3) -> casadi.Function:
    q = casadi.SX.sym("q", 2)
    x = LENGTH * casadi.cos(q[0]) + second * casadi.cos(q[0] + q[1])
    z = LENGTH * casadi.sin(q[0]) + second * casadi.sin(q[0] + q[1])
    return casadi.Function("tip", [q], [casadi.vertcat(x, 0, z)])
