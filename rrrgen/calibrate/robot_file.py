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

from rrrgen.arrays import Array
from rrrgen.calibrate.geometry import Geometry, geometry_of
from rrrgen.robotfile.importers.trees.denavit_hartenberg import DenavitHartenberg, denavit_hartenberg
from rrrgen.robotfile.importers.trees.exact_numbers import (
    Array as Exact,
)
from rrrgen.robotfile.importers.trees.exact_numbers import (
    exact_angle,
    exact_length,
    identity,
    number,
    rotation,
    transform,
    vector,
)
from rrrgen.robotfile.importers.trees.serial_chain import ChainJoint, SerialChain
from rrrgen.robotfile.importers.trees.tree import Inertia, TreeJoint
from rrrgen.robotfile.importers.trees.tree_import import fixed_transform, link_in_frame
from rrrgen.robotfile.robot_spec import FixedTransform, JointSpec, Limits, LinkSpec, MechanismSpec, RobotSpec
from rrrgen.yamltext.document import Place

DIGITS = 12  # decimals of calibrated values (m, rad)


def calibrated_spec(spec: RobotSpec, geometry: Geometry, source: str) -> RobotSpec:
    """Replace the geometry of ``spec`` by ``geometry``; ``source`` is a text on where the numbers come from."""
    has_beta = bool(np.any(geometry.rows[:, 4]))
    found = _new_rows(spec, geometry) if has_beta else _same_rows(spec, geometry)
    found = found if geometry.gains is None else _with_gains(found, geometry.gains)
    return replace(found, parameters={}, parameter_units={}, basis=None, provenance=(), source=source)


def _with_gains(spec: RobotSpec, gains: Array) -> RobotSpec:
    """Multiply the joint positions that the rows follow by ``gains`` (joints,)."""
    exact = [_rounded(gain) for gain in gains]
    if spec.mechanism is not None:
        matrix = tuple(tuple(f * g for f, g in zip(row, exact, strict=True)) for row in spec.mechanism.matrix)
        return replace(spec, mechanism=replace(spec.mechanism, matrix=matrix))
    bare = tuple(replace(joint, limits=Limits(), friction=None, drive=None) for joint in spec.joints)
    matrix = tuple(tuple(g if i == j else sp.S.Zero for j, g in enumerate(exact)) for i in range(spec.n))
    return replace(spec, mechanism=MechanismSpec(bare, tuple(range(-1, spec.n - 1)), spec.n - 1, matrix))


def _rounded(value: float) -> sp.Rational:
    return sp.Rational(round(float(value) * 10**DIGITS), 10**DIGITS)


def _kept(nominal: sp.Expr, spec: RobotSpec, value: float) -> sp.Expr:
    """The exact ``nominal`` expression of a parameter if ``value`` agrees with it up to rounding, else ``value``."""
    exact = spec.nominal(nominal)
    return exact if abs(float(exact) - value) < 10.0**-DIGITS else _rounded(value)


def _same_rows(spec: RobotSpec, geometry: Geometry) -> RobotSpec:
    joints = []
    before = geometry_of(spec)
    standard = spec.convention == "standard"
    for i, joint in enumerate(spec.rows):
        theta, d = geometry.rows[i, :2]
        changed = {"theta": _kept(joint.theta, spec, theta), "d": _kept(joint.d, spec, d)}
        row = i if standard else i - 1
        own_twist = 0 <= row < geometry.n - 1
        for key, column in (("a", 2), ("alpha", 3)):
            nominal = getattr(joint, key)
            changed[key] = _kept(nominal, spec, geometry.rows[row, column]) if own_twist else spec.nominal(nominal)
        joints.append(replace(joint, **changed))
    # the first modified and the last standard twist are part of base and tool there, and rows here
    base = (
        _matrix(spec.base, spec) @ np.linalg.solve(before.base, geometry.base)
        if standard
        else _twisted(geometry.base, spec, before.base, first=True)
    )
    tool = _twisted(geometry.tool, spec, before.tool, first=False) if standard else geometry.tool
    return replace(_with_rows(spec, joints), base=_transform(base), tool=_transform(tool))


def _with_rows(spec: RobotSpec, rows: list[JointSpec]) -> RobotSpec:
    """Replace the rows of the Denavit-Hartenberg table by ``rows``.

    A mechanism stores its rows apart from its driven joints; there both are replaced.
    """
    if spec.mechanism is None:
        return replace(spec, joints=tuple(rows))
    geometry = {row.name: {key: getattr(row, key) for key in ("alpha", "a", "d", "theta")} for row in rows}
    joints = tuple(replace(joint, **geometry[joint.name]) for joint in spec.joints)
    return replace(spec, joints=joints, mechanism=replace(spec.mechanism, rows=tuple(rows)))


def _twisted(T: Array, spec: RobotSpec, nominal: Array, first: bool) -> Array:
    """Remove a nominal twist from the transform ``T`` of the base (``first``) or the tool.

    :func:`geometry_of` counts the first twist of a modified table as part of the base, the last one of a standard table
    as part of the tool; ``nominal`` is that transform before the calibration.
    """
    if first:
        turned = np.linalg.solve(_matrix(spec.base, spec), nominal)
        return np.asarray(T @ np.linalg.inv(turned))
    twist = nominal @ np.linalg.inv(_matrix(spec.tool, spec))
    return np.asarray(np.linalg.solve(twist, T))


def _matrix(fixed: FixedTransform, spec: RobotSpec) -> Array:
    return np.array([[float(spec.nominal(v)) for v in row] for row in fixed.matrix().tolist()])


def _transform(T: Array) -> FixedTransform:
    x, y, z = (_rounded(v) for v in T[:3, 3])
    return FixedTransform(tuple(sp.Rational(repr(float(v))) for v in T[:3, :3].ravel()), (x, y, z))


def _new_rows(spec: RobotSpec, geometry: Geometry) -> RobotSpec:
    frames = _joint_frames(geometry)
    table = denavit_hartenberg(_chain(spec, frames, geometry), spec.convention, 0.0)
    standard = spec.convention == "standard"
    joints: list[JointSpec] = []
    for i, joint in enumerate(spec.rows):
        row, twist = table.rows[i], table.rows[i if standard else i - 1]
        has_twist = standard or i > 0
        alpha, a = (exact_angle(twist.alpha), exact_length(twist.a)) if has_twist else (sp.S.Zero, sp.S.Zero)
        joints.append(replace(joint, alpha=alpha, a=a, d=exact_length(row.d), theta=exact_angle(row.theta)))
    links = None if spec.links is None else tuple(_links(spec, geometry, frames, table))
    base, tool = fixed_transform(table.base), fixed_transform(table.tool)
    return replace(_with_rows(spec, joints), links=links, base=base, tool=tool)


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
    for joint, frame in zip(spec.rows, frames[:-1], strict=True):
        named = TreeJoint(joint.name, joint.type, "", "", identity(), vector((0, 0, 1)), Place())
        joints.append(ChainJoint(named, frame[:3, 3], frame[:3, 2], frame))
    nothing = (None,) * geometry.n
    return SerialChain("base", "tip", tuple(joints), nothing, frames[-1], vector((0, 0, 0)), {})


def _links(spec: RobotSpec, geometry: Geometry, frames: list[Exact], table: DenavitHartenberg) -> list[LinkSpec]:
    """Convert the links to the new link frames; each body is fixed to the frame on the axis of its joint."""
    assert spec.links is not None
    found = []
    for i, link in enumerate(spec.links):
        after = identity()
        if spec.convention == "standard":
            joint = spec.rows[i]
            after = _turn(0, float(spec.nominal(joint.alpha)), float(spec.nominal(joint.a)))
        xx, yy, zz, xy, xz, yz = link.inertia_about_origin()
        m, com = number(link.mass), vector(link.com)
        tensor = np.array(
            [[number(v) for v in row] for row in ((xx, xy, xz), (xy, yy, yz), (xz, yz, zz))], dtype=object
        )
        tensor = tensor - m * (sum(com * com) * identity(3) - np.outer(com, com))
        body = Inertia(m, com, tensor).moved(after).moved(frames[i])
        found.append(link_in_frame(body, table.link_frames[i]))
    return found
