"""The frames of a robot in its zero pose, computed from the numbers of its Denavit-Hartenberg table."""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, sin

import sympy as sp

from rrrgen.robot.model.dh_rows import dh_rows
from rrrgen.robot.model.drive_text import weighted_sum
from rrrgen.robot.robot_spec import FixedTransform, RobotSpec

Point = tuple[float, float, float]
Transform = tuple[tuple[float, float, float, float], ...]


@dataclass(frozen=True)
class Stage:
    """Frame i in the zero pose, the joint that moves it, and the path along the link to its origin.

    ``axis`` is a point on the joint axis and its direction; ``path`` the corner points of the DH displacements from the
    frame before.
    """

    frame: Transform
    revolute: bool
    axis: tuple[Point, Point]
    path: tuple[Point, ...]


def zero_pose(spec: RobotSpec) -> tuple[Transform, list[Stage], Transform]:
    """Compute the zero pose (q = 0, nominal parameters): base frame, one :class:`Stage` per DH row, tip frame.

    All are given in the base frame of the robot file.
    """
    base = _numbers(spec, spec.base)
    stages: list[Stage] = []
    for row, parent in zip(dh_rows(spec, nominal=True), spec.parents, strict=True):
        T = base if parent < 0 else stages[parent].frame
        turn, slide = _rotation_z(float(row.theta)), _shift(0.0, 0.0, float(row.d))
        (reach, lean), (far, twist) = (
            (_shift(float(t.a), 0.0, 0.0), _rotation_x(float(t.alpha))) for t in (row.before, row.behind)
        )
        start, steps = _times(_times(T, lean), reach), (lean, reach, turn, slide, far, twist)
        corners = [origin(T)]
        for step in steps:
            T = _times(T, step)
            corners.append(origin(T))
        path = tuple(p for k, p in enumerate(corners) if k == 0 or p != corners[k - 1])
        stages.append(Stage(T, row.revolute, (origin(start), column(start, 2)), path))
    return base, stages, _times(stages[spec.tip_row].frame, _numbers(spec, spec.tool))


def variables(spec: RobotSpec) -> list[str]:
    """Text for the displacement of every DH row: ``q1``, ``−q1`` for a sign of -1, in a mechanism also ``q2 − q3``."""
    names = [f"q{k}" for k in range(1, spec.n + 1)]
    if spec.mechanism is None:
        return [f"−{name}" if joint.sign < 0 else name for name, joint in zip(names, spec.joints, strict=True)]
    return [weighted_sum(names, list(map(str, row))).replace("-", "−") for row in spec.mechanism.matrix]


def origin(T: Transform) -> Point:
    """The origin (3,) of a frame, m."""
    return T[0][3], T[1][3], T[2][3]


def column(T: Transform, k: int) -> Point:
    """The unit vector (3,) of axis k of a frame."""
    return T[0][k], T[1][k], T[2][k]


def _numbers(spec: RobotSpec, fixed: FixedTransform) -> Transform:
    rotation = [_value(spec, v) for v in fixed.rotation]
    shift = [_value(spec, v) for v in fixed.translation]
    rows = tuple((rotation[3 * r], rotation[3 * r + 1], rotation[3 * r + 2], shift[r]) for r in range(3))
    return (*rows, (0.0, 0.0, 0.0, 1.0))


def _value(spec: RobotSpec, expression: sp.Expr) -> float:
    return float(spec.nominal(expression))


def _rotation_z(angle: float) -> Transform:
    c, s = cos(angle), sin(angle)
    return ((c, -s, 0.0, 0.0), (s, c, 0.0, 0.0), (0.0, 0.0, 1.0, 0.0), (0.0, 0.0, 0.0, 1.0))


def _rotation_x(angle: float) -> Transform:
    c, s = cos(angle), sin(angle)
    return ((1.0, 0.0, 0.0, 0.0), (0.0, c, -s, 0.0), (0.0, s, c, 0.0), (0.0, 0.0, 0.0, 1.0))


def _shift(x: float, y: float, z: float) -> Transform:
    return ((1.0, 0.0, 0.0, x), (0.0, 1.0, 0.0, y), (0.0, 0.0, 1.0, z), (0.0, 0.0, 0.0, 1.0))


def _times(A: Transform, B: Transform) -> Transform:
    return tuple(
        (
            sum(A[r][k] * B[k][0] for k in range(4)),
            sum(A[r][k] * B[k][1] for k in range(4)),
            sum(A[r][k] * B[k][2] for k in range(4)),
            sum(A[r][k] * B[k][3] for k in range(4)),
        )
        for r in range(4)
    )
