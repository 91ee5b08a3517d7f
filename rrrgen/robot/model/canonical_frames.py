"""The robot in canonical frames: an exact normal form for both Denavit-Hartenberg conventions.

Link i (1..n) carries the canonical frame ``P_i`` with its z axis on joint i. The chain is

    T_0_tip = X_1 J_1(q_1) X_2 J_2(q_2) ... X_n J_n(q_n) X_tip,    X_i = [[R_i, p_i], [0, 1]] constant,

with ``J_i = Rz(q_i + theta_i)`` for a revolute joint and ``J_i = Tz(q_i)`` for a prismatic one. A standard DH row
``Rz(theta) Tz(d) Tx(a) Rx(alpha)`` is split after ``Tz(d)``, where a modified row ends; so both conventions give
``R_i = Rx(alpha)``. The user's link frame ``D_i`` follows from ``P_i`` by the constant transform ``link_frames[i]``.

The origin of ``P_i`` may be moved along its joint axis without changing this form, and is moved so that offsets vanish
from the dynamics. Consecutive joints with parallel axes form a *block*. The origins of a block are moved into one
plane, except the last, which is moved to the point at which the offset of the next joint has no component along the
axis. The last block of every branch is moved into the plane of the joint before it. This produces the length ``D = d_2
+ d_3`` of the reference robot.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import NamedTuple

import sympy as sp

from rrrgen.robot.model.exact_transforms import (
    IDENTITY,
    JointModel,
    RigidTransform,
    normal_form,
    rotation_x,
    rotation_z,
)
from rrrgen.robot.model.loops import Closure, LoopGeometry
from rrrgen.robot.spec import FixedTransform, RobotSpec

# ------------------------------------------------------------------------------------------------------------------
# The rows of the Denavit-Hartenberg table in one form for both conventions. The pose of the tip is
#
# T = base row_1(q_1) .. row_n(q_n) tool
# row = Rz(gamma) Tz(b) Rx(alpha) Tx(a) Rz(theta) Tz(d) Tx(a') Rx(alpha')
#
# with q added to theta of a revolute joint and to d of a prismatic one. The *twist* (a, alpha) of the table stands
# ``behind`` the motion in the standard convention and ``before`` it in the modified one; the other twist is zero,
# except for a joint with ``sign: -1``: half a turn about x on both sides reverses its motion,
#
#     Rz(theta - q) Tz(d) = Rx(pi) Rz(q - theta) Tz(-d) Rx(pi),
#
# and leaves the link frames, which lie behind the second one, where the robot file has them.
# ------------------------------------------------------------------------------------------------------------------


class Twist(NamedTuple):
    """The twist ``Tx(a) Rx(alpha)`` of a row, a in m and alpha in rad; the two transforms commute."""

    a: sp.Expr = sp.S.Zero
    alpha: sp.Expr = sp.S.Zero

    def compose(self, following: Twist) -> Twist:
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

    ``revolute`` says whether q is added to theta; otherwise it is added to d. ``gamma`` (rad) and ``b`` (m) stand
    first; only rows of the modified convention have them.
    """

    before: Twist
    theta: sp.Expr
    d: sp.Expr
    behind: Twist
    revolute: bool
    gamma: sp.Expr = sp.S.Zero
    b: sp.Expr = sp.S.Zero


def dh_rows(spec: RobotSpec, *, nominal: bool = False) -> tuple[DHRow, ...]:
    """Convert the rows of ``spec`` to exact :class:`DHRow` values.

    Named parameters remain symbols; with ``nominal`` they are replaced by their nominal values.
    """

    rows = []
    for joint in spec.rows:
        values = (joint.theta, joint.d, joint.a, joint.alpha, joint.gamma, joint.b)
        theta, d, a, alpha, gamma, b = (spec.nominal(value) for value in values) if nominal else values
        twists = (NO_TWIST, Twist(a, alpha)) if spec.convention == "standard" else (Twist(a, alpha), NO_TWIST)
        if joint.sign < 0:
            theta, d, twists = -theta, -d, (twists[0].compose(_HALF_TURN), twists[1].compose(_HALF_TURN))
        rows.append(DHRow(twists[0], theta, d, twists[1], joint.is_revolute, gamma, b))
    return tuple(rows)


# ------------------------------------------------------------------------------------------------------------------
# The robot in canonical frames
# ------------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class RobotModel:
    """A robot in canonical frames, with exact entries; named parameters are symbols.

    ``tip`` is X_tip, ``link_frames[i]`` the constant transform from ``P_i`` to the user's link frame ``D_i``.
    ``tip_link`` is the link that carries the tool. ``coupling`` (links, n) gives the displacements of the joints,
    ``y = coupling q``; None where they are q. With closed loops, ``closures``, it has further columns, for the
    coordinates of the loops (:mod:`rrrgen.robot.model.loops`): ``y = coupling x``.
    """

    spec: RobotSpec
    joints: tuple[JointModel, ...]
    tip: RigidTransform
    link_frames: tuple[RigidTransform, ...]
    tip_link: int
    coupling: tuple[tuple[sp.Expr, ...], ...] | None = None
    closures: tuple[Closure, ...] = ()
    _nominal: dict[sp.Expr, sp.Expr] = field(default_factory=dict, compare=False, repr=False)

    def nominal(self, expression: sp.Expr) -> sp.Expr:
        """Replace named parameters in ``expression`` by their nominal values; cached, since constants recur."""
        if expression not in self._nominal:
            self._nominal[expression] = self.spec.nominal(expression)
        return self._nominal[expression]

    def at_tip(self, name: str) -> RobotModel:
        """The same model with the named tip in place of the unnamed one."""
        one = self.spec.at_tip(name)
        return replace(self, tip=self.link_frames[one.tip_row] @ _rigid_transform(one.tool), tip_link=one.tip_row)

    @property
    def n(self) -> int:
        """Length of q: the number of joints, without those that follow others."""
        return self.spec.n

    @property
    def coordinates(self) -> int:
        """Number of coordinates x: the joints, and two for every closed loop."""
        return self.n + 2 * len(self.closures)

    @property
    def links(self) -> int:
        """Number of links, one beyond every joint."""
        return len(self.joints)

    @property
    def blocks(self) -> tuple[tuple[int, ...], ...]:
        """The joint indices (from 0) of each block: joints next to each other, also on branches, with parallel axes."""
        blocks: dict[int, list[int]] = {}
        first: list[int] = []
        for i, joint in enumerate(self.joints):
            first.append(first[joint.parent] if joint.parallel else i)
            blocks.setdefault(first[i], []).append(i)
        return tuple(tuple(block) for block in blocks.values())

    def path(self, link: int) -> tuple[int, ...]:
        """The joints that move ``link``, from the base to it."""
        links: list[int] = []
        while link >= 0:
            links.append(link)
            link = self.joints[link].parent
        return tuple(reversed(links))


def build_model(spec: RobotSpec) -> RobotModel:
    """The canonical form of the robot described by ``spec``."""
    rows = dh_rows(spec)
    frames = [_twist_transform(row.behind) for row in rows]
    base = _rigid_transform(spec.base)
    constants, angles = [], []
    for parent, row in zip(spec.parents, rows, strict=True):
        behind = rows[parent].behind if parent >= 0 else NO_TWIST
        X, gamma = _before_motion(behind, row)
        along = RigidTransform.of(p=(0, 0, row.d))
        if row.revolute:
            constants.append(X @ along)
            angles.append(row.theta + gamma)
        else:
            constants.append(X @ along @ RigidTransform.of(rotation_z(row.theta)))
            angles.append(sp.S.Zero)
    for i, parent in enumerate(spec.parents):
        if parent < 0:
            constants[i] = base @ constants[i]
    parallel = [parent >= 0 and X.R == IDENTITY for parent, X in zip(spec.parents, constants, strict=True)]
    slides = _origin_shifts(constants, parallel, spec.parents)
    moved = [RigidTransform.of(p=(0, 0, t)) for t in slides]
    back = [RigidTransform.of(p=(0, 0, -t)) for t in slides]
    for i in range(len(constants)):
        parent = spec.parents[i]
        constants[i] = (moved[parent] @ constants[i] if parent >= 0 else constants[i]) @ back[i]
    tip_link = spec.tip_row
    link_frames = tuple(forth @ frame for forth, frame in zip(moved, frames, strict=True))
    joints = tuple(
        JointModel(joint.name, joint.is_revolute, X, theta, flag, parent)
        for joint, X, theta, flag, parent in zip(spec.rows, constants, angles, parallel, spec.parents, strict=True)
    )
    coupling = _coupling(spec)
    closures: tuple[Closure, ...] = ()
    if spec.loops:
        loops = LoopGeometry(spec, joints, link_frames)
        coupling, closures = loops.coupling, loops.closures
    return RobotModel(
        spec=spec,
        joints=joints,
        tip=link_frames[tip_link] @ _rigid_transform(spec.tool),
        link_frames=link_frames,
        tip_link=tip_link,
        coupling=coupling,
        closures=closures,
    )


def _rigid_transform(T: FixedTransform) -> RigidTransform:
    return RigidTransform(sp.ImmutableMatrix(3, 3, list(T.rotation)), sp.ImmutableMatrix(list(T.translation)))


def _before_motion(behind: Twist, row: DHRow) -> tuple[RigidTransform, sp.Expr]:
    """The constant transform between the motions of two rows, and an angle that belongs to the second motion.

    ``behind`` is the twist behind the first. Where the axes are parallel, the turn gamma of a revolute row commutes
    with the twist and becomes that angle: the joints then belong to one block.
    """
    if row.gamma == 0 and row.b == 0:
        return _twist_transform(behind.compose(row.before)), sp.S.Zero
    placed = RigidTransform.of(rotation_z(row.gamma), (0, 0, row.b)) @ _twist_transform(row.before)
    if row.revolute and row.before.alpha == 0:
        return _twist_transform(behind) @ RigidTransform.of(p=tuple(placed.p)), row.gamma
    return _twist_transform(behind) @ placed, sp.S.Zero


def _coupling(spec: RobotSpec) -> tuple[tuple[sp.Expr, ...], ...] | None:
    """The matrix S from q to the displacements of all rows of a mechanism; None where it is the unit matrix."""
    if spec.mechanism is None or sp.Matrix(spec.mechanism.matrix) == sp.eye(spec.n):
        return None
    return spec.mechanism.matrix


def _twist_transform(twist: Twist) -> RigidTransform:
    return RigidTransform(sp.ImmutableMatrix(rotation_x(twist.alpha)), sp.ImmutableMatrix([twist.a, 0, 0]))


def _origin_shifts(constants: list[RigidTransform], parallel: list[bool], parents: tuple[int, ...]) -> list[sp.Expr]:
    """Distances (m) by which origins are moved back along their joint axes, by the rules of the module's docstring.

    ``constants`` are the X_i before the move; ``parallel`` says of each axis whether it is parallel to the one before.
    Where several joints of other directions stand on the last link of a block, the first of them decides.
    """
    children = [[k for k, parent in enumerate(parents) if parent == i] for i in range(len(parents))]
    ends = [True] * len(parents)  # whether all axes beyond are parallel to that of the joint
    for i in reversed(range(len(parents))):
        ends[i] = all(parallel[k] and ends[k] for k in children[i])
    slides: list[sp.Expr] = []
    for i, (X, parent) in enumerate(zip(constants, parents, strict=True)):
        along = normal_form((X.R.T * X.p)[2])  # component of the offset along the joint's own axis
        if parallel[i] and children[i] and not any(parallel[k] for k in children[i]):
            slides.append(normal_form(-constants[children[i][0]].p[2]))
        elif parallel[i]:
            slides.append(normal_form(slides[parent] + along))
        elif ends[i] and parent >= 0:
            slides.append(along)
        else:
            slides.append(sp.S.Zero)
    return slides
