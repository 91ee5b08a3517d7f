"""Numeric kinematic chain for simulator formats: one body per joint, in a frame whose z axis is the joint axis."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import Any

import numpy as np

from rrrgen.base.arrays import Array
from rrrgen.base.errors import DerivationError
from rrrgen.robot.model.canonical_frames import dh_rows
from rrrgen.robot.model.mechanism import refuse_loops
from rrrgen.robot.spec import FixedTransform, JointSpec, RobotSpec, standard_parameters

_ROUND_OFF = 1e-15  # of entries of rotation matrices of right angles


@dataclass(frozen=True)
class NumericBody:
    """A joint and the body that it moves.

    ``parent`` is the number (from 0) of the body that carries the joint, -1 for the base. ``place`` (4, 4) is the pose
    of the joint's frame in the frame of that body, at q = 0. ``mass`` (kg), ``com`` (3,) and ``tensor`` (3, 3) about it
    are in the joint's frame; None where the robot file has no links. ``follows`` are the joints that this one follows,
    with their factors; empty for one with a drive. ``direction`` is -1 for a joint of a mechanism that is stated with
    ``sign: -1``. ``fixed`` marks a row of a mechanism that does not move.
    """

    joint: JointSpec
    parent: int
    place: Array
    mass: float | None
    com: Array
    tensor: Array
    follows: tuple[tuple[str, float], ...] = ()
    direction: int = 1
    fixed: bool = False

    @property
    def axis(self) -> str:
        """The axis of the joint in the frame of the body, along which its position counts, as text."""
        return f"0 0 {self.direction}"


@dataclass(frozen=True)
class NumericChain:
    """Numeric kinematic chain: ``bodies``, parents first, and ``gravity`` (3,) in the base frame, m/s^2.

    ``tip`` (4, 4) is the pose of the tip in the frame of the body number ``tip_body``. ``named_tips`` are the tips with
    a name: the name, the number of the body and the pose (4, 4) in its frame.
    """

    bodies: tuple[NumericBody, ...]
    tip: Array
    tip_body: int
    gravity: Array
    named_tips: tuple[tuple[str, int, Array], ...] = ()


def numeric_chain(spec: RobotSpec) -> NumericChain:
    """Numeric kinematic chain of ``spec`` at its nominal parameter values.

    Raises DerivationError for a joint that has a drive and moves otherwise than with it: its position is no coordinate.
    """
    refuse_loops(spec, "a tree of rigid bodies with couplings")
    base = homogeneous(spec, spec.base)
    bodies: list[NumericBody] = []
    behind: list[Array] = []
    for i, (row, parent) in enumerate(zip(dh_rows(spec, nominal=True), spec.parents, strict=True)):
        twist, after = (_screw(float(t.alpha), float(t.a), 0) for t in (row.before, row.behind))
        before = _screw(float(row.gamma), float(row.b), 2) @ twist @ _screw(float(row.theta), float(row.d), 2)
        # a standard row turns by theta + q and shifts by d first: the constant part commutes with the motion
        inertia = _inertia(spec, i, after)
        joint, follows, direction = _motion(spec, i)
        place = (base if parent < 0 else behind[parent]) @ before
        fixed = spec.mechanism is not None and not any(spec.mechanism.matrix[i])
        bodies.append(NumericBody(joint, parent, _zero_round_off(place), *inertia, follows, direction, fixed))
        behind.append(after)
    gravity = np.array([float(spec.nominal(g)) for g in spec.gravity])

    def tip_pose(row: int, tool: FixedTransform) -> Array:
        return _zero_round_off(behind[row] @ homogeneous(spec, tool))

    rows = [row.name for row in spec.rows]
    named_tips = ((name, rows.index(tip.row), tip.tool) for name, tip in spec.tips.items())
    return NumericChain(
        tuple(bodies),
        tip_pose(spec.tip_row, spec.tool),
        spec.tip_row,
        gravity,
        tuple((name, row, tip_pose(row, tool)) for name, row, tool in named_tips),
    )


def _motion(spec: RobotSpec, i: int) -> tuple[JointSpec, tuple[tuple[str, float], ...], int]:
    """Joint of DH row ``i`` with its limits and drive, the joints that it follows with their factors, and its sign."""
    if spec.mechanism is None:
        return spec.joints[i], (), 1
    row = spec.rows[i]
    names = [joint.name for joint in spec.joints]
    factors = [(name, float(f)) for name, f in zip(names, spec.mechanism.matrix[i], strict=True) if f != 0]
    if row.name not in names:
        return row, tuple(factors), 1
    if factors not in ([(row.name, 1.0)], [(row.name, -1.0)]):
        raise DerivationError(
            f"{spec.name}: the joint '{row.name}' has a drive and a coupling, which has no counterpart"
        )
    return spec.joints[names.index(row.name)], (), int(factors[0][1])


def _inertia(spec: RobotSpec, i: int, after: Array) -> tuple[float | None, Array, Array]:
    if spec.links is None:
        return None, np.zeros(3), np.zeros((3, 3))
    m, mx, my, mz, xx, xy, yy, xz, yz, zz = (float(v) for v in standard_parameters(spec.links[i]))
    c = np.array([mx, my, mz]) / m if m else np.zeros(3)
    tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) - m * (c @ c * np.eye(3) - np.outer(c, c))
    R = after[:3, :3]
    return m, R @ c + after[:3, 3], R @ tensor @ R.T


def _screw(angle: float, length: float, axis: int) -> Array:
    """Screw motion (4, 4): rotation by ``angle`` (rad) about, shift by ``length`` (m) along the axis x (0) or z (2)."""
    T = np.eye(4)
    c, s = np.cos(angle), np.sin(angle)
    i, k = (axis + 1) % 3, (axis + 2) % 3
    T[i, i], T[i, k], T[k, i], T[k, k], T[axis, 3] = c, -s, s, c, length
    return T


def homogeneous(spec: RobotSpec, transform: FixedTransform) -> Array:
    """The homogeneous matrix (4, 4) of a fixed transform at the nominal values of named lengths, m."""
    T = np.eye(4)
    T[:3, :3] = np.reshape([float(spec.nominal(v)) for v in transform.rotation], (3, 3))
    T[:3, 3] = [float(spec.nominal(v)) for v in transform.translation]
    return T


def _zero_round_off(T: Array) -> Array:
    T[np.abs(T) < _ROUND_OFF] = 0.0
    return T


def free_name(wanted: str, taken: Collection[str]) -> str:
    """``wanted``, with as many ``_`` behind it as make it none of the names ``taken``."""
    while wanted in taken:
        wanted += "_"
    return wanted


def numbers(values: Array) -> str:
    """Format ``values`` for an XML attribute, separated by blanks; reading them gives the same doubles."""
    return " ".join(number(value) for value in np.ravel(values))


def number(value: Any) -> str:
    """Shortest decimal text that reads back as the double ``value``; a negative zero becomes 0."""
    return repr(float(value) + 0.0).removesuffix(".0")
