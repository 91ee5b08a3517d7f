"""The robot in canonical frames: one exact normal form for both Denavit-Hartenberg conventions.

Link i (1..n) carries the canonical frame ``P_i`` with its z axis on joint i. The chain is

    T_0_tip = X_1 J_1(q_1) X_2 J_2(q_2) ... X_n J_n(q_n) X_tip,    X_i = [[R_i, p_i], [0, 1]] constant,

with ``J_i = Rz(q_i + theta_i)`` for a revolute joint and ``J_i = Tz(q_i)`` for a prismatic one. A standard DH row
``Rz(theta) Tz(d) Tx(a) Rx(alpha)`` is cut after ``Tz(d)``, a modified row ends there anyway, so both conventions give
``R_i = Rx(alpha)`` and the frame-fixed offsets; the user's link frame ``D_i`` follows from ``P_i`` by the constant
transform ``link_frames[i]``.

An origin may slide along its own joint axis without changing the form. It does where that removes offsets from the
dynamics: joints with parallel axes in a row (a *block*) are brought into one plane, but for the last one, which slides
to where the next joint's offset has no part along the axis; the last block of the chain is brought to the plane of the
joint before it. ``D`` of the reference robot (d_2 + d_3) arises here.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import sympy as sp

from rrrgen.robotfile.robot_spec import JointSpec, RobotSpec

IDENTITY = sp.eye(3)


@dataclass(frozen=True)
class RigidTransform:
    """A constant homogeneous transform with exact entries."""

    R: sp.ImmutableMatrix
    p: sp.ImmutableMatrix

    def __matmul__(self, other: RigidTransform) -> RigidTransform:
        return RigidTransform(
            sp.ImmutableMatrix((self.R * other.R).applyfunc(normal_form)),
            sp.ImmutableMatrix((self.R * other.p + self.p).applyfunc(normal_form)),
        )

    @staticmethod
    def of(R: sp.MatrixBase = IDENTITY, p: tuple[sp.Expr, ...] = (0, 0, 0)) -> RigidTransform:
        """From a rotation matrix and a translation."""
        return RigidTransform(sp.ImmutableMatrix(R), sp.ImmutableMatrix(3, 1, list(p)))


def normal_form(expression: sp.Expr) -> sp.Expr:
    """Expanded, with even powers of sines written in cosines, so that zeros show."""
    expanded = sp.expand(expression)
    powers = {
        power: (1 - sp.cos(power.base.args[0]) ** 2) ** (power.exp // 2) * power.base ** (power.exp % 2)
        for power in expanded.atoms(sp.Pow)
        if isinstance(power.base, sp.sin) and power.exp.is_Integer and power.exp > 1
    }
    return sp.expand(expanded.xreplace(powers)) if powers else expanded


def cosine_sine(angle: sp.Expr) -> tuple[sp.Expr, sp.Expr]:
    """Exact cosine and sine; only values with at most one square root are written out, others stay functions."""
    c, s = sp.cos(angle), sp.sin(angle)
    if all((value**2).is_Rational or (value**2).base.func in (sp.cos, sp.sin) for value in (c, s)):
        return c, s
    held = sp.UnevaluatedExpr(angle)
    return sp.cos(held), sp.sin(held)


def rotation_x(angle: sp.Expr) -> sp.Matrix:
    """Rx(angle)."""
    c, s = cosine_sine(angle)
    return sp.Matrix([[1, 0, 0], [0, c, -s], [0, s, c]])


def rotation_z(angle: sp.Expr) -> sp.Matrix:
    """Rz(angle)."""
    c, s = cosine_sine(angle)
    return sp.Matrix([[c, -s, 0], [s, c, 0], [0, 0, 1]])


@dataclass(frozen=True)
class JointModel:
    """Joint i: the constant transform X_i before it, its kind, and the constant added to its angle."""

    name: str
    revolute: bool
    before: RigidTransform
    theta: sp.Expr
    parallel: bool
    """The axis is parallel, in the same sense, to the axis of the joint before, and R_i = 1."""


@dataclass(frozen=True)
class RobotModel:
    """A robot in canonical frames; every entry exact, named parameters as symbols."""

    spec: RobotSpec
    joints: tuple[JointModel, ...]
    tip: RigidTransform
    link_frames: tuple[RigidTransform, ...]
    _nominal: dict[sp.Expr, sp.Expr] = field(default_factory=dict, compare=False, repr=False)

    def nominal(self, expression: sp.Expr) -> sp.Expr:
        """``expression`` with every named parameter at its nominal value; remembered, since constants recur."""
        if expression not in self._nominal:
            self._nominal[expression] = self.spec.nominal(expression)
        return self._nominal[expression]

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.joints)

    @property
    def blocks(self) -> tuple[tuple[int, ...], ...]:
        """Joint indices (from 0) of each maximal run of parallel axes."""
        blocks: list[list[int]] = []
        for i, joint in enumerate(self.joints):
            if joint.parallel:
                blocks[-1].append(i)
            else:
                blocks.append([i])
        return tuple(tuple(block) for block in blocks)


def build_model(spec: RobotSpec) -> RobotModel:
    """The canonical form of ``spec``."""
    before, joints, frames = _cut_rows(spec)
    base = RigidTransform(
        sp.ImmutableMatrix(3, 3, list(spec.base.rotation)), sp.ImmutableMatrix(list(spec.base.translation))
    )
    tool = RigidTransform(
        sp.ImmutableMatrix(3, 3, list(spec.tool.rotation)), sp.ImmutableMatrix(list(spec.tool.translation))
    )
    constants, angles = [], []
    for X, joint in zip(before, joints, strict=True):
        along = RigidTransform.of(p=(0, 0, joint.d))
        if joint.is_revolute:
            constants.append(X @ along)
            angles.append(joint.theta)
        else:
            constants.append(X @ along @ RigidTransform.of(rotation_z(joint.theta)))
            angles.append(sp.S.Zero)
    constants[0] = base @ constants[0]
    parallel = [i > 0 and X.R == IDENTITY for i, X in enumerate(constants)]
    slides = _slides(constants, parallel)
    moved = [RigidTransform.of(p=(0, 0, t)) for t in slides]
    back = [RigidTransform.of(p=(0, 0, -t)) for t in slides]
    for i in range(len(constants)):
        constants[i] = (moved[i - 1] @ constants[i] if i else constants[i]) @ back[i]
    link_frames = tuple(forth @ frame for forth, frame in zip(moved, frames, strict=True))
    return RobotModel(
        spec=spec,
        joints=tuple(
            JointModel(joint.name, joint.is_revolute, X, theta, flag)
            for joint, X, theta, flag in zip(joints, constants, angles, parallel, strict=True)
        ),
        tip=link_frames[-1] @ tool,
        link_frames=link_frames,
    )


def _cut_rows(
    spec: RobotSpec,
) -> tuple[list[RigidTransform], tuple[JointSpec, ...], list[RigidTransform]]:
    """Constant transforms before each joint, the joints, and P_i -> D_i, for either convention."""
    twists = [
        RigidTransform(sp.ImmutableMatrix(rotation_x(joint.alpha)), sp.ImmutableMatrix([joint.a, 0, 0]))
        for joint in spec.joints
    ]
    identity = RigidTransform.of()
    if spec.convention == "modified":
        return twists, spec.joints, [identity] * spec.n
    return [identity, *twists[:-1]], spec.joints, twists


def _slides(constants: list[RigidTransform], parallel: list[bool]) -> list[sp.Expr]:
    """How far each origin moves back along its own axis (see the module's text)."""
    slides: list[sp.Expr] = []
    last_block = max((i for i, flag in enumerate(parallel) if not flag), default=0)
    for i, X in enumerate(constants):
        along = normal_form((X.R.T * X.p)[2])  # component of the offset along the joint's own axis
        if parallel[i] and i + 1 < len(parallel) and not parallel[i + 1]:
            slides.append(normal_form(-constants[i + 1].p[2]))
        elif parallel[i]:
            slides.append(normal_form(slides[i - 1] + along))
        elif i == last_block and i > 0:
            slides.append(along)
        else:
            slides.append(sp.S.Zero)
    return slides
