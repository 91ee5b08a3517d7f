"""MJCF of MuJoCo: a body per joint, the tip as a site, a motor per drive; coupled drives as fixed tendons.

A tendon of length ``w q``, w the row of a coupled motor, carries its rotor inertia (armature), damping and dry
friction: MuJoCo then adds ``w' (Ia w ddq + ...)`` as the robot file does.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from xml.sax.saxutils import quoteattr

import numpy as np

from rrrgen.arrays import Array
from rrrgen.export.interface import Exported, Exporter, ExportOptions
from rrrgen.export.notes import unused_entries
from rrrgen.export.numeric_chain import NumericBody, number, numbers, numeric_chain
from rrrgen.robotfile.robot_spec import FrictionSpec, MotorSpec, RobotSpec


def _write(spec: RobotSpec, _: ExportOptions) -> Exported:
    chain = numeric_chain(spec)
    lines = [f"<mujoco model={quoteattr(spec.name)}>", '  <compiler angle="radian" autolimits="true"/>']
    lines += [f'  <option gravity="{numbers(chain.gravity)}"/>', "  <worldbody>"]
    for k, body in enumerate(chain.bodies, start=1):
        lines += ["    " + "  " * (k - 1) + line for line in _body(f"link{k}", body)]
    inner = "    " + "  " * len(chain.bodies)
    lines.append(f'{inner}<site name="tip" {_place(chain.tip)}/>')
    lines += ["    " + "  " * k + "</body>" for k in reversed(range(len(chain.bodies)))]
    lines.append("  </worldbody>")
    lines += _tendons(spec)
    lines += ["  <actuator>", *(f"    {line}" for line in _motors(spec)), "  </actuator>"]
    return Exported({f"{spec.name}.xml": "\n".join([*lines, "</mujoco>", ""])}, tuple(_notes(spec)))


def _place(T: Array) -> str:
    return f'pos="{numbers(T[:3, 3])}" quat="{numbers(quaternion(T[:3, :3]))}"'


def quaternion(R: Array) -> Array:
    """The unit quaternion (w, x, y, z) of a rotation, by its largest component."""
    squares = [1 + R[0, 0] + R[1, 1] + R[2, 2], *(1 + 2 * R[i, i] - R[0, 0] - R[1, 1] - R[2, 2] for i in range(3))]
    pairs = np.array(
        [
            [0, R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]],
            [0, 0, R[1, 0] + R[0, 1], R[0, 2] + R[2, 0]],
            [0, 0, 0, R[2, 1] + R[1, 2]],
            [0, 0, 0, 0],
        ]
    )
    k = int(np.argmax(squares))
    column = (pairs + pairs.T)[k]
    column[k] = squares[k]
    return np.asarray(column / (2 * math.sqrt(squares[k])))


def _body(name: str, body: NumericBody) -> Iterator[str]:
    joint = body.joint
    yield f'<body name="{name}" {_place(body.place)}>'
    texts = [f'name="{joint.name}"', f'type="{"hinge" if joint.is_revolute else "slide"}"', 'axis="0 0 1"']
    limits = joint.limits
    if limits.lower is not None and limits.upper is not None:
        texts.append(f'range="{number(limits.lower)} {number(limits.upper)}"')
    if joint.drive is not None and joint.drive.inertia:
        texts.append(f'armature="{number(joint.drive.inertia)}"')
    texts += _friction(joint.friction)
    yield f"  <joint {' '.join(texts)}/>"
    if body.mass is not None:
        J = body.tensor
        entries = np.array([J[0, 0], J[1, 1], J[2, 2], J[0, 1], J[0, 2], J[1, 2]])
        inertia = f'fullinertia="{numbers(entries)}"'
        yield f'  <inertial pos="{numbers(body.com)}" mass="{number(body.mass)}" {inertia}/>'


def _friction(friction: FrictionSpec | None) -> list[str]:
    if friction is None:
        return []
    values = {"damping": friction.viscous, "frictionloss": friction.coulomb}
    return [f'{key}="{number(value)}"' for key, value in values.items() if value]


def _tendons(spec: RobotSpec) -> Iterator[str]:
    if spec.drives is None:
        return
    yield "  <tendon>"
    for k, motor in enumerate(spec.drives.motors):
        texts = [f'name="{_tendon(motor)}"', *_friction(motor.friction)]
        if motor.inertia:
            texts.append(f'armature="{number(motor.inertia)}"')
        yield f"    <fixed {' '.join(texts)}>"
        for joint, weight in zip(spec.joints, spec.drives.motor_from_joint.row(k), strict=True):
            if weight != 0:
                yield f'      <joint joint="{joint.name}" coef="{number(float(weight))}"/>'
        yield "    </fixed>"
    yield "  </tendon>"


def _tendon(motor: MotorSpec) -> str:
    return f"shaft_{motor.name}"


def _motors(spec: RobotSpec) -> Iterator[str]:
    """A motor per joint, or per coupled drive, whose control is its torque (force), limited where the file says so."""
    if spec.drives is None:
        for joint in spec.joints:
            yield f'<motor name="{joint.name}_motor" joint="{joint.name}"{_range(joint.limits.torque)}/>'
        return
    for motor in spec.drives.motors:
        yield f'<motor name="{motor.name}" tendon="{_tendon(motor)}"{_range(motor.torque_limit)}/>'


def _range(limit: float | None) -> str:
    return "" if limit is None else f' ctrlrange="-{number(limit)} {number(limit)}"'


def _notes(spec: RobotSpec) -> Iterator[str]:
    if any(joint.limits.velocity is not None for joint in spec.joints):
        yield "limits of the velocity are left out: the format has no such entry"
    half = [j.name for j in spec.joints if (j.limits.lower is None) != (j.limits.upper is None)]
    if half:
        yield f"the limits of {', '.join(half)} are left out: MuJoCo limits a joint on both sides or not at all"
    yield from unused_entries(spec)


EXPORTER = Exporter(
    "mjcf", "MJCF of MuJoCo: bodies, limits, friction, rotor inertia, motors, coupled drives", _write, needs_bodies=True
)
