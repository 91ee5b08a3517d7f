"""Joints with the opposite positive direction, rewritten as exact Denavit-Hartenberg rows.

``Rz(theta - q) Tz(d) = Rx(pi) Rz(q - theta) Tz(-d) Rx(pi)``, and the same for a prismatic joint: the two rotations by
pi about x become part of the twists before and after the joint, ``alpha + pi``. The link frame on the joint's axis is
rotated by pi about its x axis, and the parameters of its link are converted to it; the robot is the same.
"""

from __future__ import annotations

from dataclasses import replace

import sympy as sp

from rrrgen.robotfile.robot_spec import FixedTransform, JointSpec, LinkSpec, RobotSpec


def with_reversed_joint(spec: RobotSpec, i: int) -> RobotSpec:
    """Rewrite the rows of ``spec`` so that the positive direction of joint ``i`` (from 0) is reversed, q -> -q."""
    joints = list(spec.joints)
    joint = joints[i]
    joints[i] = replace(joint, theta=-joint.theta, d=-joint.d)
    standard = spec.convention == "standard"
    before, behind = (i - 1, i) if standard else (i, i + 1)  # rows that hold the twists around the joint
    base, tool, links = spec.base, spec.tool, spec.links
    if before >= 0:
        joints[before] = _half_turn(joints[before])
    else:
        base = FixedTransform(tuple(v if k % 3 == 0 else -v for k, v in enumerate(base.rotation)), base.translation)
    if behind < len(joints):
        joints[behind] = _half_turn(joints[behind])
    else:
        x, y, z = tool.translation
        tool = FixedTransform(tuple(v if k < 3 else -v for k, v in enumerate(tool.rotation)), (x, -y, -z))
    turned = i - 1 if standard else i
    if links is not None and turned >= 0:
        links = (*links[:turned], _turned(links[turned]), *links[turned + 1 :])
    return replace(spec, joints=tuple(joints), base=base, tool=tool, links=links)


def _half_turn(joint: JointSpec) -> JointSpec:
    alpha = joint.alpha + sp.pi
    if not alpha.free_symbols and bool(alpha > sp.pi):
        alpha -= 2 * sp.pi
    return replace(joint, alpha=alpha)


def _turned(link: LinkSpec) -> LinkSpec:
    x, y, z = link.com
    xx, yy, zz, xy, xz, yz = link.inertia
    return replace(link, com=(x, -y, -z), inertia=(xx, yy, zz, -xy, -xz, yz))
