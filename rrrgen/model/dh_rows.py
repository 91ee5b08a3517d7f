"""The rows of the Denavit-Hartenberg table in one form for both conventions. The pose of the tip is

    T = base row_1(q_1) .. row_n(q_n) tool
    row = Rx(alpha) Tx(a) Rz(theta) Tz(d) Tx(a') Rx(alpha')

with q added to theta of a revolute joint and to d of a prismatic one. The *twist* (a, alpha) of the table stands
``behind`` the motion in the standard convention and ``before`` it in the modified one; the other twist is zero.
"""

from __future__ import annotations

from typing import NamedTuple

import sympy as sp

from rrrgen.robotfile.robot_spec import RobotSpec


class Twist(NamedTuple):
    """The twist ``Tx(a) Rx(alpha)`` of a row, a in m and alpha in rad; the two transforms commute."""

    a: sp.Expr = sp.S.Zero
    alpha: sp.Expr = sp.S.Zero


NO_TWIST = Twist()


class DHRow(NamedTuple):
    """One row of the table: the twist ``before`` the motion, ``theta`` (rad), ``d`` (m), and the twist ``behind`` it.

    ``revolute`` says whether q is added to theta; otherwise it is added to d.
    """

    before: Twist
    theta: sp.Expr
    d: sp.Expr
    behind: Twist
    revolute: bool


def dh_rows(spec: RobotSpec, *, nominal: bool = False) -> tuple[DHRow, ...]:
    """Convert the rows of ``spec`` to exact :class:`DHRow` values.

    Named parameters remain symbols; with ``nominal`` they are replaced by their nominal values.
    """

    def row(theta: sp.Expr, d: sp.Expr, twist: Twist, revolute: bool) -> DHRow:
        twists = (NO_TWIST, twist) if spec.convention == "standard" else (twist, NO_TWIST)
        return DHRow(twists[0], theta, d, twists[1], revolute)

    found = []
    for joint in spec.rows:
        values = (joint.theta, joint.d, joint.a, joint.alpha)
        theta, d, a, alpha = (spec.nominal(value) for value in values) if nominal else values
        found.append(row(theta, d, Twist(a, alpha), joint.is_revolute))
    return tuple(found)
