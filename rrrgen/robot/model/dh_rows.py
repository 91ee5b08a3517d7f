"""The rows of the Denavit-Hartenberg table in one form for both conventions. The pose of the tip is

    T = base row_1(q_1) .. row_n(q_n) tool
    row = Rx(alpha) Tx(a) Rz(theta) Tz(d) Tx(a') Rx(alpha')

with q added to theta of a revolute joint and to d of a prismatic one. The *twist* (a, alpha) of the table stands
``behind`` the motion in the standard convention and ``before`` it in the modified one; the other twist is zero, except
for a joint with ``sign: -1``: half a turn about x on both sides reverses its motion,

    Rz(theta - q) Tz(d) = Rx(pi) Rz(q - theta) Tz(-d) Rx(pi),

and leaves the link frames, which lie behind the second one, where the robot file has them.
"""

from __future__ import annotations

from typing import NamedTuple

import sympy as sp

from rrrgen.robot.robot_spec import RobotSpec


class Twist(NamedTuple):
    """The twist ``Tx(a) Rx(alpha)`` of a row, a in m and alpha in rad; the two transforms commute."""

    a: sp.Expr = sp.S.Zero
    alpha: sp.Expr = sp.S.Zero

    def joined(self, following: Twist) -> Twist:
        """The product of both transforms; where both turn, alpha loses whole turns."""
        if NO_TWIST in (self, following):
            return self if following == NO_TWIST else following
        alpha = self.alpha + following.alpha
        turns = sp.ceiling((alpha / sp.pi - 1) / 2) if alpha.is_number else 0  # to within -pi < alpha <= pi
        return Twist(self.a + following.a, alpha - 2 * sp.pi * turns)


NO_TWIST = Twist()
_HALF_TURN = Twist(alpha=sp.pi)


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

    found = []
    for joint in spec.rows:
        values = (joint.theta, joint.d, joint.a, joint.alpha)
        theta, d, a, alpha = (spec.nominal(value) for value in values) if nominal else values
        twists = (NO_TWIST, Twist(a, alpha)) if spec.convention == "standard" else (Twist(a, alpha), NO_TWIST)
        if joint.sign < 0:
            theta, d, twists = -theta, -d, (twists[0].joined(_HALF_TURN), twists[1].joined(_HALF_TURN))
        found.append(DHRow(twists[0], theta, d, twists[1], joint.is_revolute))
    return tuple(found)
