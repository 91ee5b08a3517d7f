"""The serial chain in the form that inverse kinematics uses, the same for both Denavit-Hartenberg conventions.

The pose of the tip is a product of joint transforms J and constant transforms K and L:

    T = K_0 J_1(x_1) L_1 J_2(x_2) L_2 ... L_{n-1} J_n(x_n) K_n
    J = Rz(x) or Tz(x),   L_i = Rz(theta) Tz(d) Tx(a) Rx(alpha)

``x_i = sign_i q_i + offset_i`` is the *raw* joint variable. It contains the offset of the DH table, so the link after a
revolute joint has theta = 0 and the link after a prismatic joint d = 0. ``K_0`` is the base transform together with the
constants of the first row of the table that come before joint 1; ``K_n`` holds the constants after joint n and the
tool. The numbers come from exact SymPy values of the nominal geometry, so a right angle gives cos = 0 and not 6e-17.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction
from functools import cached_property
from math import atan2, cos, hypot, sin
from typing import TYPE_CHECKING, Any

import sympy as sp

from rrrgen.derive.recursions.linear_algebra import cross
from rrrgen.robot.model.canonical_frames import NO_TWIST, Twist, dh_rows

if TYPE_CHECKING:
    from rrrgen.robot.spec import RobotSpec

Number = Any
"""A float for computation, or an exact SymPy expression for formulas that people read."""

Matrix = tuple[tuple[Number, ...], ...]
"""A homogeneous transform, 3 rows of 4; the last row (0, 0, 0, 1) is not stored."""

IDENTITY: Matrix = ((1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0))


@dataclass(frozen=True)
class Link:
    """The constant transform ``Rz(theta) Tz(d) Tx(a) Rx(alpha)`` between two joint axes.

    ``d`` and ``a`` are in m; ``ct``, ``st`` are the cosine and sine of theta, ``ca``, ``sa`` those of alpha.
    """

    d: Number = 0
    a: Number = 0
    ca: Number = 1
    sa: Number = 0
    ct: Number = 1
    st: Number = 0

    def matrix(self) -> Matrix:
        """The transform as a 3x4 matrix: rotation matrix, and translation (m) in the last column."""
        ct, st, ca, sa = self.ct, self.st, self.ca, self.sa
        return (
            (ct, -st * ca, st * sa, self.a * ct),
            (st, ct * ca, -ct * sa, self.a * st),
            (0, sa, ca, self.d),
        )


@dataclass(frozen=True)
class Joint:
    """A joint of the chain: ``index`` is its number (from 0) in the user's robot.

    ``lower`` and ``upper`` are its position limits (rad or m), None where the robot file states none. Its raw variable
    is ``sign q + offset``. An index >= n marks a virtual joint, added to complete the equations: only solutions where
    its value is zero are solutions of the robot.
    """

    index: int
    revolute: bool
    offset: Number = 0.0
    sign: int = 1
    lower: float | None = None
    upper: float | None = None
    name: str = ""


def backwards(joint: Joint) -> Joint:
    """The same joint passed in the opposite direction: its transform is the inverse, so its raw variable is -x."""
    return replace(joint, sign=-joint.sign, offset=-joint.offset)


def joint_types(joints: Sequence[Joint]) -> str:
    """The types of ``joints`` in order, for example ``"RRP"``."""
    return "".join("R" if joint.revolute else "P" for joint in joints)


@dataclass(frozen=True)
class KinematicChain:
    """A serial chain in the form of this module: ``base``, the ``joints`` with ``links`` between them, and ``tip``.

    ``links[i]`` is the constant transform between ``joints[i]`` and ``joints[i+1]``; ``base`` (K_0) comes before the
    first joint and ``tip`` (K_n) after the last one. ``slides``, if any, are displacements (m) of the frames of the
    joints along their axes, which bring frames that lie far away to the arm: :attr:`transforms` and :attr:`reach` are
    those of the displaced frames. ``between``, if any, are the true transforms between the joints where the ``links``
    hold them only nearly (:mod:`rrrgen.ik.geometry.mechanism`).
    """

    name: str
    base: Matrix
    joints: tuple[Joint, ...]
    links: tuple[Link, ...]
    tip: Matrix
    slides: tuple[float, ...] = field(default=(), repr=False)
    between: tuple[Matrix, ...] = field(default=(), repr=False)

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.joints)

    @property
    def types(self) -> str:
        """The joint types in order, e.g. ``"RRP"``."""
        return joint_types(self.joints)

    @property
    def reach(self) -> float:
        """Length (m) that tolerances are relative to: the sum of |a| and |d| over the links and the tool.

        A chain without any length (all axes through the tip) has reach 1.
        """
        if self.slides:
            between = self.transforms[1:-1]
            total = sum(sum(float(row[3]) ** 2 for row in matrix) ** 0.5 for matrix in between)
        else:
            total = sum(abs(float(link.a)) + abs(float(link.d)) for link in self.links)
        total += sum(float(self.tip[i][3]) ** 2 for i in range(3)) ** 0.5
        return total if total > 0.0 else 1.0

    @property
    def scale(self) -> float:
        """Bound (m) on the tip's coordinates in the base frame: the reach, plus how far joint 1 is from the origin."""
        return self.reach + float(sum(float(self.base[i][3]) ** 2 for i in range(3)) ** 0.5)

    @cached_property
    def transforms(self) -> tuple[Matrix, ...]:
        """The constant 3x4 transforms before joint 1, between the joints and behind the last one."""
        if self.between:
            return (self.base, *self.between, self.tip)
        plain = (self.base, *(link.matrix() for link in self.links), self.tip)
        if not self.slides:
            return plain
        before, behind = (0.0, *self.slides), (*self.slides, 0.0)
        return tuple(_slid(matrix, *ends) for matrix, *ends in zip(plain, before, behind, strict=True))

    def tip_pose(self, q: Sequence[float]) -> Matrix:
        """Forward kinematics: the 3x4 pose of the tip in the base frame at the joint values ``q`` (n,), rad or m."""
        return self.frames(q)[-1]

    def tip_motion(self, q: Sequence[float]) -> list[list[float]]:
        """The columns of the geometric Jacobian of the tip at ``q``: velocity and angular velocity, in the base frame.

        One list of six numbers for each joint of the chain: m/s and rad/s for 1 rad/s (1 m/s) of the joint.
        """
        *frames, tip = self.frames(q)
        columns = []
        for joint, frame in zip(self.joints, frames, strict=True):
            z = [joint.sign * row[2] for row in frame]
            if joint.revolute:
                x, y, w = (end[3] - row[3] for end, row in zip(tip, frame, strict=True))
                columns.append([z[1] * w - z[2] * y, z[2] * x - z[0] * w, z[0] * y - z[1] * x, *z])
            else:
                columns.append([*z, 0.0, 0.0, 0.0])
        return columns

    def forward(self, q: Any) -> Any:
        """:meth:`tip_pose` as an array (4, 4)."""
        import numpy as np

        return np.array([*self.tip_pose(q), (0.0, 0.0, 0.0, 1.0)])

    def jacobian(self, q: Any) -> Any:
        """:meth:`tip_motion` as an array (6, n)."""
        import numpy as np

        return np.array(self.tip_motion(q)).T.reshape(6, self.n)

    def frames(self, q: Sequence[float]) -> list[Matrix]:
        """The frames of the joints in the base frame at ``q``, each before its displacement, and that of the tip."""
        base, *after_joints = self._rounded
        frames = [base]
        for joint, behind in zip(self.joints, after_joints, strict=True):
            x = joint.sign * float(q[joint.index]) + float(joint.offset)
            moved = turn_about_z(frames[-1], cos(x), sin(x)) if joint.revolute else shift_along_z(frames[-1], x)
            frames.append(multiply(moved, behind))
        return frames

    @cached_property
    def _rounded(self) -> tuple[Matrix, ...]:
        """The constant transforms in floats."""
        return tuple(tuple(tuple(float(x) for x in row) for row in matrix) for matrix in self.transforms)


def _slid(matrix: Matrix, before: float, behind: float) -> Matrix:
    """The product ``Tz(-before) matrix Tz(behind)``, computed exactly and rounded once.

    Its terms may be a thousand times as large as their sum, so that their rounding errors would be as well.
    """
    rows = []
    for i, row in enumerate(matrix):
        exact = Fraction(row[3]) + Fraction(row[2]) * Fraction(behind) - (Fraction(before) if i == 2 else 0)
        rows.append((*row[:3], float(exact)))
    return tuple(rows)


def translation(t: tuple[Number, Number, Number]) -> Matrix:
    """The 3x4 transform that moves by ``t`` (m)."""
    return tuple((*row[:3], x) for row, x in zip(IDENTITY, t, strict=True))


def multiply(A: Matrix, B: Matrix) -> Matrix:
    """The product of two 3x4 transforms whose entries are plain numbers."""
    rows = []
    for i in range(3):
        row = [sum(A[i][k] * B[k][j] for k in range(3)) for j in range(4)]
        row[3] += A[i][3]
        rows.append(tuple(row))
    return tuple(rows)


def turn_about_z(A: Matrix, c: Number, s: Number) -> Matrix:
    """The product ``A Rz(x)`` for the cosine ``c`` and the sine ``s`` of x."""
    return tuple((row[0] * c + row[1] * s, row[1] * c - row[0] * s, row[2], row[3]) for row in A)


def shift_along_z(A: Matrix, x: Number) -> Matrix:
    """The product ``A Tz(x)``."""
    return tuple((*row[:3], row[3] + row[2] * x) for row in A)


def _trig(angle: sp.Expr) -> tuple[sp.Expr, sp.Expr]:
    """Cosine and sine of an exact angle; multiples of 15 degrees come out as radicals or integers."""
    return sp.cos(angle), sp.sin(angle)


def _rows(matrix: sp.Matrix) -> Matrix:
    return tuple(tuple(matrix[i, j] for j in range(4)) for i in range(3))


def _with_twist(link: Link, twist: Twist) -> Link:
    ca, sa = _trig(twist.alpha)
    return replace(link, a=twist.a, ca=ca, sa=sa)


def exact_chain(spec: RobotSpec, *, nominal: bool = True) -> KinematicChain:
    """Convert a robot description to a chain of exact SymPy numbers.

    The geometric parameters take their nominal values or, with ``nominal=False``, remain symbols. A link ends with the
    Tx(a) Rx(alpha) of its own row of the DH table or, in the modified convention, with that of the next row. Joints
    with ``sign: -1`` are turned round (:mod:`rrrgen.robot.model.canonical_frames`).
    """

    def value(expression: sp.Expr) -> sp.Expr:
        return spec.nominal(expression) if nominal else expression

    rows = dh_rows(spec, nominal=nominal)
    joints, links = [], []
    base, tip = _rows(spec.base.matrix().applyfunc(value)), _rows(spec.tool.matrix().applyfunc(value))
    if rows[0].before != NO_TWIST:
        base = multiply(base, _with_twist(Link(), rows[0].before).matrix())
    for i, (row, joint) in enumerate(zip(rows, spec.joints, strict=True)):
        offset = row.theta if row.revolute else row.d
        joints.append(Joint(i, row.revolute, offset, 1, joint.limits.lower, joint.limits.upper, joint.name))
        ct, st = (sp.S.One, sp.S.Zero) if row.revolute else _trig(row.theta)
        link = Link(row.d if row.revolute else sp.S.Zero, ct=ct, st=st)
        following = rows[i + 1].before if i + 1 < len(rows) else NO_TWIST
        links.append(_with_twist(link, row.behind.compose(following)))
    return KinematicChain(spec.name, base, tuple(joints), tuple(links[:-1]), multiply(links[-1].matrix(), tip))


def numeric_chain(spec: RobotSpec) -> KinematicChain:
    """Convert a robot description at its nominal geometry to a chain of floats, rounded once from exact numbers."""
    return in_floats(exact_chain(spec))


def in_floats(chain: KinematicChain) -> KinematicChain:
    """Convert every number of ``chain`` to a float."""

    def number(x: Number) -> float:
        return float(sp.N(x, 30)) if isinstance(x, sp.Basic) else float(x)

    def matrix(M: Matrix) -> Matrix:
        return tuple(tuple(number(x) for x in row) for row in M)

    links = tuple(Link(*(number(getattr(link, f)) for f in ("d", "a", "ca", "sa", "ct", "st"))) for link in chain.links)
    joints = tuple(replace(joint, offset=number(joint.offset)) for joint in chain.joints)
    return KinematicChain(chain.name, matrix(chain.base), joints, links, matrix(chain.tip))


# ------------------------------------------------------------------------------------------------------------------
# The arm angle of a configuration: the redundancy parameter of arms with spherical shoulder and wrist.
# ------------------------------------------------------------------------------------------------------------------


def arm_angle(chain: KinematicChain, q: Any) -> float:
    """Arm angle psi (rad) of a seven-joint configuration ``q``: rotation of the elbow about the line shoulder-wrist.

    psi is zero where the elbow lies on the side of a reference direction, the stereographic one that
    :mod:`rrrgen.ik.solutions.spherical_triples` defines. The result is 0 where psi is undefined: where the arm is
    straight, or where the line from shoulder to wrist has the single direction for which there is no reference
    direction.
    """
    frames: list[Matrix] = [IDENTITY]
    for i, joint in enumerate(chain.joints):
        x = joint.sign * float(q[joint.index]) + float(joint.offset)
        after = chain.links[i].matrix() if i < chain.n - 1 else chain.tip
        frames.append(multiply(turn_about_z(frames[-1], cos(x), sin(x)), after))
    shoulder = (0.0, 0.0, float(chain.links[0].d))
    away, across = ([float(row[3]) - x for row, x in zip(frames[k], shoulder, strict=True)] for k in (5, 3))
    size = hypot(*away)
    if size == 0.0:
        return 0.0
    e = [x / size for x in away]
    # n = ((e + z) x x_axis) x e, the direction from which psi is counted; y its unit vector, w = e x y
    n = cross(cross([e[0], e[1], e[2] + 1.0], [1.0, 0.0, 0.0]), e)
    length = hypot(*n)
    if length == 0.0:
        return 0.0
    y = [x / length for x in n]
    w = cross(e, y)
    return atan2(*(sum(a * b for a, b in zip(across, v, strict=True)) for v in (w, y)))


# ------------------------------------------------------------------------------------------------------------------
# Virtual joints: joints that are added to an arm with too few, so that the equations for six (or three) joints apply.
#
# Only solutions in which every virtual joint has the value zero are solutions of the arm itself.
# ------------------------------------------------------------------------------------------------------------------


def extend_chain(chain: KinematicChain, count: int, *, at_base: bool, shift: float, turn: int) -> KinematicChain:
    """Extend ``chain`` by ``count`` virtual revolute joints after its last joint (or before its first, ``at_base``).

    Each axis meets its neighbour at a right angle and two of them meet in one point, so that together with a revolute
    neighbour they form an orthogonal wrist, which is regular at zero. ``shift`` (m) places that point on the
    neighbour's axis, ``turn`` (quarter turns) chooses the direction about it.
    """
    quarter = {"ct": float(turn == 0), "st": float(turn == 1)}
    upright = [Link(ca=0.0, sa=1.0, ct=0.0, st=1.0) for _ in range(count - 1)]
    n = max(joint.index for joint in chain.joints) + 1
    joints = tuple(Joint(n + i, True, name=f"virtual {i + 1}") for i in range(count))
    if at_base:
        links = [Link(ca=0.0, sa=1.0, **quarter), *upright]
        base = chain.base
        for link in reversed(links):
            base = multiply(base, inverse(link.matrix()))
        return replace(chain, joints=joints + chain.joints, links=(*links, *chain.links), base=base)
    links = [Link(d=shift, ca=0.0, sa=1.0, **quarter), *upright]
    tip = chain.tip
    for link in links:
        tip = multiply(inverse(link.matrix()), tip)
    return replace(chain, joints=chain.joints + joints, links=(*chain.links, *links), tip=tip)


def inverse(M: Matrix) -> Matrix:
    """The inverse of a rigid 3x4 transform."""
    R = [[M[j][i] for j in range(3)] for i in range(3)]
    t = [-sum(R[i][j] * M[j][3] for j in range(3)) for i in range(3)]
    return tuple((*R[i], t[i]) for i in range(3))
