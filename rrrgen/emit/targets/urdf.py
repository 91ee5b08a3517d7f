"""Export to URDF: one link per joint, with its frame on the joint, and links ``base`` and ``tip`` for those frames."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from xml.sax.saxutils import escape, quoteattr

import numpy as np

from rrrgen.base.arrays import Array
from rrrgen.base.errors import DerivationError
from rrrgen.emit.targets.interface import Exported, Exporter, ExportOptions, unused_entries, viscous_and_coulomb
from rrrgen.emit.targets.rigid_bodies import NumericBody, NumericChain, free_name, number, numbers, numeric_chain
from rrrgen.robot.spec import JointSpec, RobotSpec

NO_LIMIT = "1e9"  # for limits that URDF demands and the robot file does not state; read back as none


def _write(spec: RobotSpec, _: ExportOptions) -> Exported:
    chain = numeric_chain(spec)
    g = numbers(chain.gravity)
    lines = ['<?xml version="1.0"?>', f"<robot name={quoteattr(spec.name)}>"]
    if spec.description:
        lines.append(f"  <!-- {re.sub('--+', '-', escape(spec.description))} -->")
    lines += [f"  <!-- gravity in the frame of base: {g} m/s^2 -->", '  <link name="base"/>']
    kinds = {body.joint.name: _kind(body.joint) for body in chain.bodies}
    for k, body in enumerate(chain.bodies, start=1):
        lines += _link(f"link{k}", body)
        lines += _joint(body, f"link{body.parent + 1}" if body.parent >= 0 else "base", f"link{k}", kinds)
    lines += _tips(chain)
    lines += _transmissions(spec)
    notes = list(_notes(spec, chain.gravity))
    return Exported({f"{spec.name}.urdf": "\n".join([*lines, "</robot>", ""])}, tuple(notes))


def _tips(chain: NumericChain) -> Iterator[str]:
    """XML lines of a massless link for the tip and for each tip with a name, fixed to the link that carries it."""
    links = {"base", *(f"link{k}" for k in range(1, len(chain.bodies) + 1))}
    joints = {body.joint.name for body in chain.bodies}
    for name, body, place in (("tip", chain.tip_body, chain.tip), *chain.named_tips):
        link = free_name(name, links)
        joint = free_name(f"{link}_fixed", joints)
        links.add(link)
        joints.add(joint)
        yield f'  <link name="{link}"/>'
        yield f'  <joint name="{joint}" type="fixed">'
        yield f"    {_origin(place)}"
        yield f'    <parent link="link{body + 1}"/>'
        yield f'    <child link="{link}"/>'
        yield "  </joint>"


def _origin(T: Array) -> str:
    return f'<origin xyz="{numbers(T[:3, 3])}" rpy="{numbers(roll_pitch_yaw(T[:3, :3]))}"/>'


def roll_pitch_yaw(R: Array) -> Array:
    """Roll, pitch and yaw (3,), rad, of the rotation matrix ``R = Rz(yaw) Ry(pitch) Rx(roll)`` (3, 3).

    At pitch = +-90 degrees, where only yaw and roll together are determined, yaw is 0.
    """
    across = math.hypot(R[0, 0], R[1, 0])
    pitch = math.atan2(-R[2, 0], across)
    if across < 1e-12:
        return np.array([math.atan2(-R[1, 2], R[1, 1]), pitch, 0.0])
    return np.array([math.atan2(R[2, 1], R[2, 2]), pitch, math.atan2(R[1, 0], R[0, 0])])


def _link(name: str, body: NumericBody) -> list[str]:
    if body.mass is None:
        return [f'  <link name="{name}"/>']
    J = body.tensor
    keys = (("ixx", 0, 0), ("ixy", 0, 1), ("ixz", 0, 2), ("iyy", 1, 1), ("iyz", 1, 2), ("izz", 2, 2))
    entries = " ".join(f'{key}="{number(J[i, k])}"' for key, i, k in keys)
    return [
        f'  <link name="{name}">',
        "    <inertial>",
        f'      <origin xyz="{numbers(body.com)}" rpy="0 0 0"/>',
        f'      <mass value="{number(body.mass)}"/>',
        f"      <inertia {entries}/>",
        "    </inertial>",
        "  </link>",
    ]


def _joint(body: NumericBody, parent: str, child: str, kinds: Mapping[str, str]) -> list[str]:
    """XML lines of the joint of ``body``; ``kinds`` are the types of all joints.

    A joint without limits that follows one with limits has the type of that one, as Pinocchio needs it.
    """
    joint, kind = body.joint, kinds[body.joint.name]
    ends = [f'    <parent link="{parent}"/>', f'    <child link="{child}"/>']
    if body.fixed:
        return [f'  <joint name="{joint.name}" type="fixed">', f"    {_origin(body.place)}", *ends, "  </joint>"]
    if kind == "continuous" and any(kinds[leader] == "revolute" for leader, _ in body.follows):
        kind = "revolute"
    lines = [f'  <joint name="{joint.name}" type="{kind}">', f"    {_origin(body.place)}"]
    lines += [*ends, f'    <axis xyz="{body.axis}"/>']
    limits = joint.limits
    attributes = {"effort": limits.torque, "velocity": limits.velocity}
    if kind != "continuous":
        attributes = {"lower": limits.lower, "upper": limits.upper, **attributes}
    defaults = {"lower": f"-{NO_LIMIT}", **dict.fromkeys(("upper", "effort", "velocity"), NO_LIMIT)}
    if kind != "continuous" or any(value is not None for value in attributes.values()):
        texts = [f'{key}="{defaults[key] if value is None else number(value)}"' for key, value in attributes.items()]
        lines.append(f"    <limit {' '.join(texts)}/>")
    if len(body.follows) > 1:
        leaders = " and ".join(name for name, _ in body.follows)
        wrong = f"joint '{joint.name}' follows {leaders}"
        raise DerivationError(f"{wrong}; in a URDF it may follow one joint (mjcf has sums)")
    for name, factor in body.follows:
        lines.append(f'    <mimic joint="{name}" multiplier="{number(factor)}" offset="0"/>')
    viscous, coulomb = viscous_and_coulomb(joint.friction)
    if viscous is not None or coulomb is not None:
        lines.append(f'    <dynamics damping="{number(viscous or 0.0)}" friction="{number(coulomb or 0.0)}"/>')
    return [*lines, "  </joint>"]


def _kind(joint: JointSpec) -> str:
    if not joint.is_revolute:
        return "prismatic"
    return "continuous" if joint.limits.lower is None and joint.limits.upper is None else "revolute"


def _transmissions(spec: RobotSpec) -> Iterator[str]:
    for joint in spec.joints:
        ratio = joint.drive.gear_ratio if joint.drive is not None else None
        if ratio is not None:
            yield f'  <transmission name="{joint.name}_transmission">'
            yield "    <type>transmission_interface/SimpleTransmission</type>"
            yield f'    <joint name="{joint.name}"/>'
            yield f'    <actuator name="{joint.name}_motor">'
            yield f"      <mechanicalReduction>{number(ratio)}</mechanicalReduction>"
            yield "    </actuator>"
            yield "  </transmission>"


def _notes(spec: RobotSpec, gravity: Array) -> Iterator[str]:
    if spec.floating_base:
        yield "the free base is left out: in a URDF the program that reads it decides whether the link base is free"
    if not np.allclose(gravity, (0, 0, -9.81)):
        yield f"a URDF has no gravity; the robot's is {numbers(gravity)} m/s^2 in the frame of base"
    yield from unused_entries(spec, ("gear_ratio",))
    if any(joint.drive is not None and joint.drive.inertia is not None for joint in spec.joints):
        yield "drive inertia is left out: a URDF has no such entry, and torques differ by Ia ddq"
    if spec.drives is not None:
        yield "coupled drives are left out: a URDF has joints only, and torques differ by what the motors add"


EXPORTER = Exporter(
    "urdf", "URDF: links, joints, limits, friction; for Pinocchio, ROS, Drake and others", _write, mechanisms=True
)
