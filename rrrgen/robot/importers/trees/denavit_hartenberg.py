"""Computation of Denavit-Hartenberg rows from joint axes in space.

The chain is ``base Rz(theta_1) Tz(d_1) . Tx(a_1) Rx(alpha_1) . Rz(theta_2) Tz(d_2) ... tool`` with z along the axis of
joint i in the i-th factor Rz Tz: the common perpendicular of axes i and i+1 is the x axis between them. Where axes
intersect, it has the direction of their vector product; where they are parallel, it starts at the last origin; where
they coincide, the last x axis is kept. Of its two directions the one with theta in (-90, 90] degrees is taken, so that
a may be negative.

The common perpendicular of nearly parallel axes may lie kilometres away, where doubles lose the digits of positions and
inertia. There a *fixed row* stands between the rows of the two joints: a row without motion, whose axis leads from one
joint axis to the other at a right angle. It holds the small tilt, and all frames stay at the arm.

Every row starts from the frame that the rows before it give. Where an angle was replaced by an exact one, the following
rows are computed from the changed frame, so that errors do not add up from row to row; only the change of the last row
moves the tip.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from rrrgen.robot.importers.trees.exact_numbers import (
    EQUAL,
    HIGH,
    NOISE,
    Array,
    cross,
    exact_multiple,
    identity,
    inverse,
    norm,
    number,
    rotation,
    transform,
    vector,
)
from rrrgen.robot.importers.trees.serial_chain import SerialChain
from rrrgen.robot.robot_spec import Convention

PARALLEL = 1e-8  # rad; nearer directions are one: doubles lose as much at a perpendicular 10^8 times as far away
NO_TILT = 1e-11  # rad; the same where fixed rows are allowed: the pose changes by 3e-11 of the reach
FAR = 1e3  # m; with frames farther away doubles lose more than 1e-10 of the torques of an arm of 1 m, as (d/m)^2 eps
_Z = vector((0, 0, 1))


@dataclass
class Row:
    """One row of the table at q = 0: ``theta`` about and ``d`` along z, then ``a`` along and ``alpha`` about the new x.

    Angles are in rad, lengths in m. ``joint`` is the number (from 0) of its joint in the chain; None for a fixed row.
    """

    theta: Any = 0
    d: Any = 0
    a: Any = 0
    alpha: Any = 0
    joint: int | None = None


@dataclass
class DenavitHartenberg:
    """Rows (theta, d, a, alpha) at q = 0 with ``base`` and ``tool`` (4, 4), and the link frames (4, 4) in the base.

    ``rounded`` lists by how much (rad) each angle was changed to make it exact.
    """

    base: Array
    rows: list[Row]
    tool: Array
    link_frames: list[Array]
    rounded: list[Any] = field(default_factory=list)


def denavit_hartenberg(
    chain: SerialChain, convention: Convention, tolerance: float, fixed_rows: bool = False
) -> DenavitHartenberg:
    """The rows of ``chain``; an angle within ``tolerance`` (rad) of a multiple of 15 degrees becomes that multiple.

    With ``fixed_rows``, fixed rows hold the tilt of nearly parallel axes; otherwise there is a row for every joint.
    """
    return _Walk(chain, convention, number(tolerance), fixed_rows).result


class _Walk:
    def __init__(self, chain: SerialChain, convention: Convention, tolerance: Any, fixed_rows: bool) -> None:
        self.chain, self.tolerance = chain, tolerance
        self.parallel = max(tolerance, number(NO_TILT if fixed_rows else PARALLEL))
        self.frame, d = _first_frame(chain)
        self.rows = [Row(d=d, joint=0)]
        self.result = DenavitHartenberg(self.frame, self.rows, identity(), [])
        self._move(transform(identity(3), (0, 0, d)))
        for k, joint in enumerate(chain.joints[1:], 1):
            across = self._tilted_axis(joint.point, joint.direction) if fixed_rows else None
            if across is not None:
                self._to_axis(*across, convention, None)
            self._to_axis(joint.point, joint.direction, convention, k)
        self._to_tip(convention)

    def _tilted_axis(self, point: Array, direction: Array) -> tuple[Array, Array] | None:
        """The axis (point, direction) of a fixed row towards the next axis; None where no fixed row is needed.

        It starts at the last origin and meets the next axis where that crosses the plane normal to z.
        """
        p, u = self._seen(point, direction)
        _, height = self._perpendicular(p, u)
        if abs(height) <= FAR:
            return None
        met = p - p[2] / u[2] * u
        return self.frame[:3, 3], self.frame[:3, :3] @ (met / norm(met))

    def _seen(self, point: Array, direction: Array) -> tuple[Array, Array]:
        """An axis in the last frame."""
        to_frame = inverse(self.frame)
        return to_frame[:3, :3] @ point + to_frame[:3, 3], to_frame[:3, :3] @ direction

    def _move(self, step: Array) -> None:
        self.frame = self.frame @ step

    def _exact(self, angle: Any) -> Any:
        exact = exact_multiple(angle, self.tolerance)
        if abs(exact - angle) > EQUAL:
            self.result.rounded.append(abs(exact - angle))
        return exact

    def _to_axis(self, point: Array, direction: Array, convention: Convention, joint: int | None) -> None:
        """Complete the last row so that it leads to the next axis (``point``, ``direction``), and begin its row."""
        p, u = self._seen(point, direction)
        x, height = self._perpendicular(p, u)
        theta = self._exact(HIGH.atan2(x[1], x[0]))
        x = vector((HIGH.cos(theta), HIGH.sin(theta), 0))
        side = cross(_Z, x)
        alpha = self._exact(HIGH.atan2(-sum(u * side), u[2]))
        a = _no_noise(sum(p * x))
        row = self.rows[-1]
        row.theta, row.d, row.a, row.alpha = row.theta + theta, row.d + height, a, alpha
        self._move(transform(rotation((0, 0, 1), theta), (0, 0, height)))
        self._link_frame(convention, "modified")
        self._move(transform(rotation((1, 0, 0), alpha), (a, 0, 0)))
        self._link_frame(convention, "standard")
        self.rows.append(Row(joint=joint))

    def _link_frame(self, convention: Convention, ends_here: Convention) -> None:
        if convention == ends_here:
            self.result.link_frames.append(self.frame)

    def _perpendicular(self, p: Array, u: Array) -> tuple[Array, Any]:
        """The common perpendicular of z and the axis (p, u): its direction (3,), and the height where it meets z."""
        across = HIGH.sqrt(u[0] ** 2 + u[1] ** 2)
        offset = HIGH.sqrt(p[0] ** 2 + p[1] ** 2)
        height = number(0)
        if across > self.parallel:
            x = vector((-u[1] / across, u[0] / across, 0))
            y = cross(_Z, x)
            height = _no_noise(p[2] - sum(p * y) / sum(u * y) * u[2])
        elif offset > NOISE:
            x = vector((p[0] / offset, p[1] / offset, 0))
        else:
            x = vector((1, 0, 0))
        backwards = x[0] < -EQUAL or (abs(x[0]) <= EQUAL and x[1] < 0)
        return (-x if backwards else x), height

    def _to_tip(self, convention: Convention) -> None:
        """Complete the last row so that the rotation about and shift along the last axis lead to the tip; set the tool.

        The tool is the transform that then remains between the last link frame and the tip.
        """
        rest = inverse(self.frame) @ self.chain.tip_pose
        row = self.rows[-1]
        theta, height = number(0), _no_noise(rest[2, 3])
        if abs(rest[2, 2] - 1) <= EQUAL:
            theta = self._exact(HIGH.atan2(rest[1, 0], rest[0, 0]))
        row.theta, row.d = row.theta + theta, row.d + height
        self._move(transform(rotation((0, 0, 1), theta), (0, 0, height)))
        self.result.link_frames.append(self.frame)
        tool = inverse(self.frame) @ self.chain.tip_pose
        tool[:3, 3] = [_no_noise(x) for x in tool[:3, 3]]
        self.result.tool = tool


def _no_noise(length: Any) -> Any:
    return length if abs(length) > NOISE else number(0)


def _first_frame(chain: SerialChain) -> tuple[Array, Any]:
    """Choose a frame with z on the first joint axis, if possible the base frame: (frame, height of the joint)."""
    first = chain.joints[0]
    z, p = first.direction, first.point
    if abs(abs(z[2]) - 1) <= EQUAL:
        turned = HIGH.pi if z[2] < 0 else number(0)
        return transform(rotation((1, 0, 0), turned), (_no_noise(p[0]), _no_noise(p[1]), 0)), _no_noise(p[2] * z[2])
    x = _across(z, [*identity(3), *first.frame[:3, :3].T])
    R = identity(3)
    R[:, 0], R[:, 1], R[:, 2] = x, cross(z, x), z
    return transform(R, [_no_noise(value) for value in p]), number(0)


def _across(z: Array, candidates: Sequence[Array]) -> Array:
    """Choose a unit vector perpendicular to ``z``.

    It is the first perpendicular one of the ``candidates``; if there is none, the candidate nearest to perpendicular is
    projected on the plane normal to ``z``.
    """
    for x in candidates:
        if abs(sum(x * z)) <= EQUAL:
            return x
    x = min(candidates, key=lambda each: abs(sum(each * z)))
    x = x - sum(x * z) * z
    return np.asarray(x / norm(x))
