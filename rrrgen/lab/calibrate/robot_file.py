"""Conversion of a calibrated geometry to a robot description.

Without nearly parallel axes the rows and the link frames keep their form. A row with an angle beta is no
Denavit-Hartenberg row; then all rows are computed again from the joint axes in space. Where two of these are nearly
parallel, their common perpendicular lies far away and d is long, as in calibrations of Universal Robots arms. The
inertia of each link is converted to its new link frame. Gains become the coupling of a mechanism, ``follows``.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import sympy as sp

from rrrgen.base.arrays import Array
from rrrgen.base.errors import DerivationError
from rrrgen.base.yamltext.document import Place
from rrrgen.lab.calibrate.geometry import Geometry, geometry_of, geometry_of_table, path_to_tip
from rrrgen.robot.importers.trees.bodies import Inertia, TreeJoint
from rrrgen.robot.importers.trees.denavit_hartenberg import (
    DenavitHartenberg,
    denavit_hartenberg,
    fixed_transform,
    link_in_frame,
)
from rrrgen.robot.importers.trees.exact_numbers import (
    HIGH,
    exact_angle,
    exact_length,
    identity,
    inverse,
    number,
    rotation,
    transform,
    vector,
)
from rrrgen.robot.importers.trees.exact_numbers import (
    Array as Exact,
)
from rrrgen.robot.importers.trees.serial_chain import SerialChain, SerialJoint
from rrrgen.robot.model.canonical_frames import dh_rows
from rrrgen.robot.spec import FixedTransform, JointSpec, Limits, LinkSpec, MechanismSpec, RobotSpec

DIGITS = 12  # decimals of calibrated values (m, rad)


def calibrated_spec(spec: RobotSpec, geometry: Geometry, source: str) -> RobotSpec:
    """Replace the geometry of ``spec`` by ``geometry``; ``source`` is a text on where the numbers come from."""
    has_beta = bool(np.any(geometry.rows[:, 4]))
    robot = _new_rows(spec, geometry) if has_beta else _same_rows(spec, geometry)
    robot = robot if geometry.gains is None else _with_gains(robot, geometry.gains)
    return replace(robot, parameters={}, parameter_units={}, basis=None, provenance=(), source=source)


def _with_gains(spec: RobotSpec, gains: Array) -> RobotSpec:
    """Multiply the joint positions that the rows follow by ``gains`` (joints,)."""
    exact = [_rational(gain) for gain in gains]
    if spec.mechanism is not None:
        matrix = tuple(tuple(f * g for f, g in zip(row, exact, strict=True)) for row in spec.mechanism.matrix)
        return replace(spec, mechanism=replace(spec.mechanism, matrix=matrix))
    plain = tuple(replace(joint, sign=1) for joint in spec.joints)
    bare = tuple(replace(joint, limits=Limits(), friction=None, drive=None) for joint in plain)
    signed = [gain * joint.sign for gain, joint in zip(exact, spec.joints, strict=True)]
    matrix = tuple(tuple(g if i == j else sp.S.Zero for j, g in enumerate(signed)) for i in range(spec.n))
    return replace(spec, joints=plain, mechanism=MechanismSpec(bare, tuple(range(-1, spec.n - 1)), spec.n - 1, matrix))


def _rational(value: float) -> sp.Rational:
    return sp.Rational(round(float(value) * 10**DIGITS), 10**DIGITS)


def _exact_value(nominal: sp.Expr, spec: RobotSpec, value: float) -> sp.Expr:
    """The exact ``nominal`` expression of a parameter if ``value`` agrees with it up to rounding, else ``value``."""
    exact = spec.nominal(nominal)
    return exact if abs(float(exact) - value) < 10.0**-DIGITS else _rational(value)


def _same_rows(spec: RobotSpec, geometry: Geometry) -> RobotSpec:
    joints = []
    before = geometry_of(spec)
    standard = spec.convention == "standard"
    signs = [spec.rows[k].sign for k in path_to_tip(spec)]
    for i, joint in enumerate(spec.rows[k] for k in path_to_tip(spec)):
        theta, d = geometry.rows[i, :2]
        changed = {
            "theta": _exact_value(joint.theta, spec, signs[i] * theta),
            "d": _exact_value(joint.d, spec, signs[i] * d),
        }
        row = i if standard else i - 1
        is_inner = 0 <= row < geometry.n - 1
        for key, column in (("a", 2), ("alpha", 3)):
            nominal = getattr(joint, key)
            value = geometry.rows[row, column] if is_inner else float(spec.nominal(nominal))
            if is_inner and key == "alpha" and -1 in signs[row : row + 2]:  # half turns about x stand in the geometry
                value -= np.pi * signs[row : row + 2].count(-1)
                value += 2 * np.pi * np.round((float(spec.nominal(nominal)) - value) / (2 * np.pi))
            changed[key] = _exact_value(nominal, spec, value) if is_inner else spec.nominal(nominal)
        joints.append(replace(joint, **changed))
    # the twists before the first joint and behind the last are part of base and tool there, and rows here
    base = _remove_twist(geometry.base, spec, before.base, first=True)
    tool = _remove_twist(geometry.tool, spec, before.tool, first=False)
    tools = {name: _transform(_matrix(other, spec)) for name, other in spec.tools.items()}
    return replace(_with_rows(spec, joints), base=_transform(base), tool=_transform(tool), tools=tools)


def _with_rows(spec: RobotSpec, replacements: list[JointSpec]) -> RobotSpec:
    """Replace rows of the Denavit-Hartenberg table by ``replacements`` of the same names; others become numbers.

    A mechanism stores its rows apart from its driven joints; there both are replaced.
    """
    by_name = {row.name: row for row in replacements}

    def replace_row(row: JointSpec) -> JointSpec:
        source = by_name.get(row.name, row)
        values = {key: spec.nominal(getattr(source, key)) for key in ("alpha", "a", "d", "theta")}
        return replace(row, sign=source.sign, **values)

    joints = tuple(replace_row(joint) for joint in spec.joints)
    if spec.mechanism is None:
        return replace(spec, joints=joints)
    rows = tuple(replace_row(row) for row in spec.mechanism.rows)
    return replace(spec, joints=joints, mechanism=replace(spec.mechanism, rows=rows))


def _remove_twist(T: Array, spec: RobotSpec, nominal: Array, first: bool) -> Array:
    """Remove a nominal twist from the transform ``T`` of the base (``first``) or the tool.

    :func:`geometry_of` counts the twist before the first joint as part of the base, the one behind the last joint as
    part of the tool; ``nominal`` is that transform before the calibration.
    """
    if first:
        turned = np.linalg.solve(_matrix(spec.base, spec), nominal)
        return np.asarray(T @ np.linalg.inv(turned))
    twist = nominal @ np.linalg.inv(_matrix(spec.tool, spec))
    return np.asarray(np.linalg.solve(twist, T))


def _matrix(fixed: FixedTransform, spec: RobotSpec) -> Array:
    return np.array([[float(spec.nominal(v)) for v in row] for row in fixed.matrix().tolist()])


def _transform(T: Array) -> FixedTransform:
    x, y, z = (_rational(v) for v in T[:3, 3])
    return FixedTransform(tuple(sp.Rational(repr(float(v))) for v in T[:3, :3].ravel()), (x, y, z))


def _new_rows(spec: RobotSpec, geometry: Geometry) -> RobotSpec:
    frames, path = _joint_frames(geometry), path_to_tip(spec)
    table = denavit_hartenberg(_chain(spec, frames, geometry), spec.convention, 0.0)
    standard = spec.convention == "standard"
    joints: list[JointSpec] = []
    for i, joint in enumerate(spec.rows[k] for k in path):
        row, twist = table.rows[i], table.rows[i if standard else i - 1]
        has_twist = standard or i > 0
        alpha, a = (exact_angle(twist.alpha), exact_length(twist.a)) if has_twist else (sp.S.Zero, sp.S.Zero)
        joints.append(replace(joint, alpha=alpha, a=a, d=exact_length(row.d), theta=exact_angle(row.theta), sign=1))
    joints += _branches(spec, geometry, table)
    bodies = [frame @ after for frame, after in zip(frames, _link_in_joint_frames(spec), strict=False)]
    links = None if spec.links is None else tuple(_links(spec, bodies, table))
    base, tool = fixed_transform(table.base), fixed_transform(table.tool)
    flange = inverse(table.link_frames[-1]) @ bodies[-1]
    tools = {name: fixed_transform(flange @ _exact(_matrix(other, spec))) for name, other in spec.tools.items()}
    return replace(_with_rows(spec, joints), links=links, base=base, tool=tool, tools=tools)


def _link_in_joint_frames(spec: RobotSpec) -> list[Exact]:
    """The link frame (4, 4) of each row to the tip, in the frame after its joint, to which the body is fixed."""
    stated, nominal = _joint_frames(geometry_of_table(spec)), _joint_frames(geometry_of(spec))
    frames, table = [], dh_rows(spec, nominal=True)
    for i, k in enumerate(path_to_tip(spec)):
        a, alpha = table[k].behind
        frames.append(inverse(nominal[i]) @ stated[i] @ _turn(0, float(alpha), float(a)))
    return frames


def _branches(spec: RobotSpec, geometry: Geometry, table: DenavitHartenberg) -> list[JointSpec]:
    """Rows beside the path to the tip whose parent lies on it: they turn about the axis of the next row of the path.

    The link frame of the parent has moved along and about that axis, by which their theta and d change. Raises
    :class:`DerivationError` where a row cannot follow: in the modified convention, and beyond the tip.
    """
    path, branches = path_to_tip(spec), []
    before, after = _axis_frames(geometry_of(spec)), _axis_frames(geometry)
    nominal = _link_frames(spec)
    for i in (i for i in range(len(spec.rows)) if i not in path and spec.parents[i] in (-1, *path)):
        row, parent = spec.rows[i], spec.parents[i]
        following = path.index(parent) + 1 if parent >= 0 else 0
        if spec.convention != "standard" or following == len(path):
            where = "behind the tip" if following == len(path) else "in a table of the modified convention"
            raise DerivationError(f"{spec.name}: {row.name} branches off {where}: its place cannot be kept")
        new = table.link_frames[following - 1] if parent >= 0 else table.base
        old = inverse(before[following]) @ nominal[following]
        change = inverse(inverse(after[following]) @ new) @ old  # a screw along z
        turn = HIGH.atan2(change[1, 0], change[0, 0])
        theta, d = (number(float(spec.nominal(value))) for value in (row.theta, row.d))
        branches.append(replace(row, theta=exact_angle(theta + turn), d=exact_length(d + change[2, 3])))
    return branches


def _axis_frames(geometry: Geometry) -> list[Exact]:
    """The frames (4, 4) before the motion of each joint, at q = 0."""
    moved = _joint_frames(geometry)
    return [T @ inverse(_turn(2, theta, d)) for T, (theta, d, *_) in zip(moved, geometry.rows, strict=False)]


def _link_frames(spec: RobotSpec) -> list[Exact]:
    """The frames (4, 4) of base and links along the path to the tip at q = 0, in the standard convention."""
    T = _exact(_matrix(spec.base, spec))
    frames = [T]
    for joint in (spec.rows[i] for i in path_to_tip(spec)):
        theta, d, a, alpha = (float(spec.nominal(v)) for v in (joint.theta, joint.d, joint.a, joint.alpha))
        T = T @ _turn(2, theta, d) @ _turn(0, alpha, a)
        frames.append(T)
    return frames


def _joint_frames(geometry: Geometry) -> list[Exact]:
    """The frames (4, 4) after the motion of each joint at q = 0, and the tip, in the base frame, with 60 digits."""
    T = _exact(geometry.base)
    frames = []
    for theta, d, a, alpha, beta in geometry.rows:
        T = T @ _turn(2, theta, d)
        frames.append(T)
        T = T @ _turn(0, alpha, a) @ _turn(1, beta, 0.0)
    return [*frames, T @ _exact(geometry.tool)]


def _exact(T: Array) -> Exact:
    """Make the rotation of a transform orthonormal to 60 digits, by Newton's iteration ``R (3 - R'R) / 2``."""
    R = np.array([[number(float(v)) for v in row] for row in T[:3, :3]], dtype=object)
    for _ in range(3):
        R = R @ (3 * identity(3) - R.T @ R) / 2
    return transform(R, [number(float(v)) for v in T[:3, 3]])


def _turn(axis: int, angle: float, length: float) -> Exact:
    unit = [int(k == axis) for k in range(3)]
    return transform(rotation(unit, number(float(angle))), [k * number(float(length)) for k in unit])


def _chain(spec: RobotSpec, frames: list[Exact], geometry: Geometry) -> SerialChain:
    joints = []
    for i, frame in zip(path_to_tip(spec), frames[:-1], strict=True):
        joint = spec.rows[i]
        named = TreeJoint(joint.name, joint.type, "", "", identity(), vector((0, 0, 1)), Place())
        joints.append(SerialJoint(named, frame[:3, 3], frame[:3, 2], frame))
    nothing = (None,) * geometry.n
    return SerialChain("base", "tip", tuple(joints), nothing, frames[-1], vector((0, 0, 0)), {})


def _links(spec: RobotSpec, bodies: list[Exact], table: DenavitHartenberg) -> list[LinkSpec]:
    """Convert the links to the new link frames; ``bodies`` (4, 4) are the frames that the old ones have become.

    Links of rows beside the path to the tip stay as they are.
    """
    assert spec.links is not None
    links = list(spec.links)
    for i, k in enumerate(path_to_tip(spec)):
        link = spec.links[k]
        xx, yy, zz, xy, xz, yz = link.inertia_about_origin()
        m, com = number(link.mass), vector(link.com)
        tensor = np.array(
            [[number(v) for v in row] for row in ((xx, xy, xz), (xy, yy, yz), (xz, yz, zz))], dtype=object
        )
        tensor = tensor - m * (sum(com * com) * identity(3) - np.outer(com, com))
        body = Inertia(m, com, tensor).transform(bodies[i])
        links[k] = link_in_frame(body, table.link_frames[i])
    return links
