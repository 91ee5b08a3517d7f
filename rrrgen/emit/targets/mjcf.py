"""Export to MJCF, the format of MuJoCo: a body per joint, the tip as a site, a motor per drive.

A coupled drive, whose motor turns by ``w q`` with a constant row w (n,), becomes a fixed tendon of length ``w q``. The
tendon carries the rotor inertia Ia (armature), damping and dry friction of the motor, so that MuJoCo adds the joint
torques ``w' (Ia w ddq + ...)`` of the robot file.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from xml.sax.saxutils import quoteattr

import numpy as np

from rrrgen.base.arrays import Array
from rrrgen.emit.targets.interface import Exported, Exporter, ExportOptions, unused_entries, viscous_and_coulomb
from rrrgen.emit.targets.rigid_bodies import NumericBody, NumericChain, free_name, number, numbers, numeric_chain
from rrrgen.robot.spec import FrictionSpec, MotorSpec, RobotSpec


def _write(spec: RobotSpec, _: ExportOptions) -> Exported:
    chain = numeric_chain(spec)
    lines = [f"<mujoco model={quoteattr(spec.name)}>", '  <compiler angle="radian" autolimits="true"/>']
    lines += [f'  <option gravity="{numbers(chain.gravity)}"/>', "  <worldbody>"]
    lines += ["    " + line for line in _bodies(chain, -1, spec.floating_base)]
    lines.append("  </worldbody>")
    lines += _tendons(spec, chain)
    lines += _equalities(chain)
    lines += ["  <actuator>", *(f"    {line}" for line in _motors(spec)), "  </actuator>"]
    return Exported({f"{spec.name}.xml": "\n".join([*lines, "</mujoco>", ""])}, tuple(_notes(spec)))


def _bodies(chain: NumericChain, parent: int, free: bool = False) -> Iterator[str]:
    """XML lines of the bodies attached to body ``parent`` (-1: base), with their own children nested inside.

    Bodies that are ``free`` have a free joint.
    """
    for k, body in enumerate(chain.bodies):
        if body.parent == parent:
            yield from _body(f"link{k + 1}", body)
            if free:
                yield "  <freejoint/>"
            inside = list(_bodies(chain, k))
            sites = {"tip": (chain.tip_body, chain.tip)}
            for name, tip_body, place in chain.named_tips:
                sites[free_name(name, sites)] = (tip_body, place)
            inside += [f'<site name="{name}" {_place(T)}/>' for name, (carrier, T) in sites.items() if carrier == k]
            yield from ("  " + line for line in inside)
            yield "</body>"


def _place(T: Array) -> str:
    return f'pos="{numbers(T[:3, 3])}" quat="{numbers(quaternion(T[:3, :3]))}"'


def quaternion(R: Array) -> Array:
    """Unit quaternion (w, x, y, z) of the rotation matrix ``R`` (3, 3), from its largest component for accuracy."""
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
    yield f'<body name="{name}" {_place(body.place)}>'
    if not body.fixed:
        yield f"  <joint {' '.join(_joint(body))}/>"
    if body.mass is not None and (body.mass or not body.fixed):
        J = body.tensor
        entries = np.array([J[0, 0], J[1, 1], J[2, 2], J[0, 1], J[0, 2], J[1, 2]])
        inertia = f'fullinertia="{numbers(entries)}"'
        yield f'  <inertial pos="{numbers(body.com)}" mass="{number(body.mass)}" {inertia}/>'


def _joint(body: NumericBody) -> list[str]:
    joint = body.joint
    texts = [f'name="{joint.name}"', f'type="{"hinge" if joint.is_revolute else "slide"}"', f'axis="{body.axis}"']
    limits = joint.limits
    if limits.lower is not None and limits.upper is not None:
        texts.append(f'range="{number(limits.lower)} {number(limits.upper)}"')
    if joint.drive is not None and joint.drive.inertia:
        texts.append(f'armature="{number(joint.drive.inertia)}"')
    return texts + _friction(joint.friction)


def _friction(friction: FrictionSpec | None) -> list[str]:
    values = zip(("damping", "frictionloss"), viscous_and_coulomb(friction), strict=True)
    return [f'{key}="{number(value)}"' for key, value in values if value]


def _tendons(spec: RobotSpec, chain: NumericChain) -> Iterator[str]:
    sums = [body for body in chain.bodies if len(body.follows) > 1]
    if spec.drives is None and not sums:
        return
    yield "  <tendon>"
    for body in sums:
        yield f'    <fixed name="coupling_{body.joint.name}">'
        for name, weight in ((body.joint.name, -1.0), *body.follows):
            yield f'      <joint joint="{name}" coef="{number(weight)}"/>'
        yield "    </fixed>"
    for k, motor in enumerate(spec.drives.motors if spec.drives is not None else ()):
        texts = [f'name="{_tendon(motor)}"', *_friction(motor.friction)]
        if motor.inertia:
            texts.append(f'armature="{number(motor.inertia)}"')
        yield f"    <fixed {' '.join(texts)}>"
        assert spec.drives is not None
        for joint, weight in zip(spec.joints, spec.drives.motor_from_joint.row(k), strict=True):
            if weight != 0:
                yield f'      <joint joint="{joint.name}" coef="{number(float(weight))}"/>'
        yield "    </fixed>"
    yield "  </tendon>"


def _equalities(chain: NumericChain) -> Iterator[str]:
    """XML lines of equality constraints for joints that follow others.

    A joint that follows one joint is coupled to it directly; one that follows a sum of joints through a tendon.
    """
    followers = [body for body in chain.bodies if body.follows]
    if not followers:
        return
    yield "  <equality>"
    for body in followers:
        if len(body.follows) == 1:
            ((name, factor),) = body.follows
            yield f'    <joint joint1="{body.joint.name}" joint2="{name}" polycoef="0 {number(factor)} 0 0 0"/>'
        else:
            yield f'    <tendon tendon1="coupling_{body.joint.name}"/>'
    yield "  </equality>"


def _tendon(motor: MotorSpec) -> str:
    return f"shaft_{motor.name}"


def _motors(spec: RobotSpec) -> Iterator[str]:
    """XML lines of the motors, one per joint or coupled drive; the control is its torque (force), limited as stated."""
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
    names = {joint.name for joint in spec.joints}
    factors = () if spec.mechanism is None else zip(spec.rows, spec.mechanism.matrix, strict=True)
    if any(row.name not in names and any(coefficients) for row, coefficients in factors):
        yield "joints that follow others are held by equality constraints, which MuJoCo keeps softly"
    yield from unused_entries(spec, motors=True)


EXPORTER = Exporter(
    "mjcf",
    "MJCF of MuJoCo: bodies, limits, friction, rotor inertia, motors, coupled drives",
    _write,
    needs_bodies=True,
    mechanisms=True,
)
