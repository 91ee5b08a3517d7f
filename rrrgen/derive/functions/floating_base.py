"""Recorders of the dynamics on a floating base, whose body is the first link of the robot.

The motion of the base has six coordinates without a position: its twist [v; omega], the linear velocity of its origin
and the angular velocity, both in base axes. The rates of these *components* are the inputs ``twist_rate``; the
acceleration of the moving origin is ``dv/dt + omega x v``. Position and velocity of the base do not enter the
equations of motion otherwise, its orientation R only through gravity in base axes, ``R' g``:

    [wrench; tau] = M(q) [twist_rate; ddq] + h(q, dq, orientation, twist),

with the force and moment on the base about its origin, in base axes. The recursions are those of a base at rest,
started from a moving one. Source: Featherstone, Rigid Body Dynamics Algorithms (2008), chapter 9.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from fractions import Fraction
from typing import Any

from rrrgen.derive.functions.dynamics import (
    Frames,
    block_frames_but_last,
    block_frames_first,
    link_frames_only,
    torque_port,
)
from rrrgen.derive.functions.recording import FunctionBuilder
from rrrgen.derive.functions.regressors import regressor_rows
from rrrgen.derive.recursions import energy_and_momentum as momentum
from rrrgen.derive.recursions import kinematics, newton_euler
from rrrgen.derive.recursions import mass_matrix_and_gravity as composite
from rrrgen.derive.recursions.drive_inertia import inertia_columns
from rrrgen.derive.recursions.linear_algebra import (
    Vector,
    add,
    cross,
    dot,
    factorize,
    flat,
    is_number,
    rows,
    scale,
    status_at,
    subtract,
)
from rrrgen.derive.recursions.link_frames import BaseMotion, Chain
from rrrgen.derive.recursions.regressor import columns_by_axes, columns_passed_down
from rrrgen.program import Failure, Port, Program, Role, Status, Value
from rrrgen.program.builder import replay

EQUATION = "[wrench; tau] = M(q) [twist_rate; ddq] + h(q, dq, orientation, twist)"

OF_SENSORS = "accelerometer = dv/dt + omega x v - R' g,  gyro = omega,  gyro_rate = d(omega)/dt"
Y_BETA = "[wrench; tau] = Y beta"


def in_base_axes(orientation: Sequence[Any], vector: Vector) -> Vector:
    """``R' vector``: a vector (3,) in world axes, expressed in those of the base.

    ``orientation`` (4,) is the unit quaternion x, y, z, w of the base in the world. A vector along an axis of the
    world, such as gravity, needs one row of the rotation matrix only.
    """
    *axis, w = orientation
    along = [k for k in range(3) if not is_number(vector[k], 0)]
    if len(along) == 1:
        (k,) = along
        i, j = (k + 1) % 3, (k + 2) % 3
        twice, result = 2 * vector[k], [0, 0, 0]
        result[k] = vector[k] - twice * (axis[i] * axis[i] + axis[j] * axis[j])
        result[i] = twice * (axis[k] * axis[i] - w * axis[j])
        result[j] = twice * (axis[k] * axis[j] + w * axis[i])
        return result
    across = cross(axis, vector)
    return add(vector, cross([2 * x for x in axis], subtract(across, scale(w, vector))))


NO_UNIT = Failure(
    2,
    "no unit quaternion",
    "the orientation is no unit quaternion",
    "the squared norm of the orientation differs from 1 by more than 2e-6",
)
"""The failure of an orientation that is no rotation; the results are then those of the formulas for it."""


def status_of(r: FunctionBuilder) -> Value:
    """The status of the input ``orientation``: 0, or 2 if it is no unit quaternion or not a number."""
    b, orientation = r.builder, r.on_base("orientation")
    excess = b.sub(dot(orientation, orientation), 1)
    return b.select(b.sub(Fraction(2, 10**6), b.abs(excess)), 0, NO_UNIT.code)


STATUS = Port("status", (), "1")


def moving_chain(r: FunctionBuilder, *rates: str, accelerated: bool) -> Chain:
    """The chain at q on the moving base; the twist rates are zero unless the base is ``accelerated``."""
    chain = r.chain_in_gravity(*rates)
    orientation, twist = r.on_base("orientation"), r.on_base("twist")
    twist_rate = r.on_base("twist_rate") if accelerated else [0] * 6
    v, omega = twist[:3], twist[3:]
    classical = add(twist_rate[:3], cross(omega, v))
    base = BaseMotion(omega, twist_rate[3:], subtract(classical, in_base_axes(orientation, chain.gravity)))
    return replace(chain, base=base)


def wrench_port() -> Port:
    """The output port wrench (6,) on the base."""
    meaning = "force and moment on the base about its origin, in base axes"
    return Port("wrench", (6,), "N, N m", "base", meaning, Role.WRENCH)


def _chain_of_sensors(r: FunctionBuilder) -> Chain:
    """The chain at q on a base whose motion an inertial measurement unit measures."""
    chain = r.chain()
    r.joints("dq")
    r.joints("ddq")
    gyro, gyro_rate, accelerometer = (r.take(name) for name in ("gyro", "gyro_rate", "accelerometer"))
    return replace(chain, base=BaseMotion(gyro, gyro_rate, accelerometer))


def _forces(r: FunctionBuilder, chain: Chain, frames: Frames) -> list[tuple[Port, list[Any]]]:
    """The outputs wrench (6,) and tau (n,) of inverse dynamics, without friction."""
    dq, ddq = r.joints("dq"), r.joints("ddq")
    forces = newton_euler.inverse_dynamics(chain, dq, ddq, r.inertias(), frames(chain))
    tau = r.drive_inertia().added_to_torques(forces[6:], ddq)
    return [
        (wrench_port(), forces[:6]),
        (torque_port(r, "tau", "joint torques, friction not included"), tau),
    ]


def inverse_dynamics(frames: Frames) -> Callable[[FunctionBuilder], Program]:
    """Make a recorder of the wrench (6,) on the base and the joint torques tau (n,), without friction.

    ``frames`` chooses for each link the frame in which it is computed: its link frame or that of its block.
    """

    def record(r: FunctionBuilder) -> Program:
        chain = moving_chain(r, "dq", "ddq", accelerated=True)
        ports = [*_forces(r, chain, frames), (STATUS, [status_of(r)])]
        summary = "Wrench on the floating base and joint torques."
        return r.builder.program(
            "floating_inverse_dynamics", ports, summary, EQUATION, status=Status(len(ports) - 1, (NO_UNIT,))
        )

    return record


def inverse_dynamics_from_imu(frames: Frames) -> Callable[[FunctionBuilder], Program]:
    """Make a recorder of the wrench (6,) and tau (n,), without friction, from the sensors of the base.

    ``frames`` chooses for each link the frame in which it is computed: its link frame or that of its block.
    """

    def record(r: FunctionBuilder) -> Program:
        return r.builder.program(
            "floating_inverse_dynamics_from_imu",
            _forces(r, _chain_of_sensors(r), frames),
            "Wrench on the floating base and joint torques, from gyroscope and accelerometer of the base.",
            OF_SENSORS,
        )

    return record


def bias(frames: Frames) -> Callable[[FunctionBuilder], Program]:
    """Make a recorder of h (6 + n,): wrench and torques where neither the twist nor dq changes.

    ``frames`` chooses for each link the frame in which it is computed: its link frame or that of its block.
    """

    def record(r: FunctionBuilder) -> Program:
        chain = moving_chain(r, "dq", accelerated=False)
        h = newton_euler.inverse_dynamics(chain, r.joints("dq"), [0] * r.n, r.inertias(), frames(chain))
        meaning = "force and moment on the base, then joint torques, for twist_rate = 0 and ddq = 0"
        port = Port("h", (6 + r.n,), "SI", "", meaning)
        ports = [(port, h), (STATUS, [status_of(r)])]
        summary = "Wrench and torques of velocities and gravity on a floating base."
        return r.builder.program("floating_bias", ports, summary, EQUATION, status=Status(1, (NO_UNIT,)))

    return record


def mass_matrix(r: FunctionBuilder) -> Program:
    """Record M (6 + n, 6 + n) over the twist of the base and dq; its first six rows give the momentum."""
    M = composite.floating_mass_matrix(r.chain(), r.inertias())
    joints = r.drive_inertia().added_to_mass([row[6:] for row in M[6:]])
    M = M[:6] + [[*row[:6], *joint_row] for row, joint_row in zip(M[6:], joints, strict=True)]
    port = Port("M", (6 + r.n, 6 + r.n), "SI", "", "symmetric mass matrix over [twist; dq], drive inertia included")
    formula = "[p; L] = M(q)[0:6] [twist; dq], linear and angular momentum about the base origin, in base axes"
    return r.builder.program("floating_mass_matrix", [(port, flat(M))], "Mass matrix on a floating base.", formula)


def regressor(columns: Callable[..., list[list[Any]]], frames: Frames) -> Callable[[FunctionBuilder], Program]:
    """Make a recorder of Y (6 + n, b + drives), rows of the wrench first.

    ``columns`` is the method that computes the columns of Y for canonical parameters; ``frames`` chooses the frame in
    which each link is computed.
    """

    def record(r: FunctionBuilder) -> Program:
        chain = moving_chain(r, "dq", "ddq", accelerated=True)
        ports = [_regressor(r, chain, columns, frames), (STATUS, [status_of(r)])]
        return r.builder.program(
            "floating_regressor", ports, "Regressor on a floating base.", Y_BETA, status=Status(1, (NO_UNIT,))
        )

    return record


def regressor_from_imu(columns: Callable[..., list[list[Any]]], frames: Frames) -> Callable[[FunctionBuilder], Program]:
    """Make a recorder of Y (6 + n, b + drives), rows of the wrench first, from the sensors of the base.

    ``columns`` and ``frames`` are those of :func:`regressor`.
    """

    def record(r: FunctionBuilder) -> Program:
        ports = [_regressor(r, _chain_of_sensors(r), columns, frames)]
        summary = "Regressor on a floating base, from gyroscope and accelerometer of the base."
        return r.builder.program("floating_regressor_from_imu", ports, summary, f"{Y_BETA},  {OF_SENSORS}")

    return record


def _regressor(
    r: FunctionBuilder, chain: Chain, columns: Callable[..., list[list[Any]]], frames: Frames
) -> tuple[Port, list[Any]]:
    """The output Y (6 + n, b + drives) of the regressor."""
    dq, ddq = r.joints("dq"), r.joints("ddq")
    canonical = columns(chain, dq, ddq, frames(chain), r.parametrization.basis.parameters)
    drives = [[0] * 6 + list(column) for column in inertia_columns(r.model.spec, ddq)]
    Y = regressor_rows(r, canonical, drives)
    then = ", then of the drive inertias" if r.drives else ""
    port = Port("Y", (6 + r.n, len(Y[0])), "SI", "", f"columns in the order of the base parameters{then}")
    return port, flat(Y)


MOMENTUM_IS = "[p; L] = A(q) [twist; dq], A = M(q)[0:6]"
"""The momentum of the whole robot about the base origin, in base axes; the matrix A has the first six rows of M."""


def momentum_matrix(r: FunctionBuilder) -> Program:
    """Record A (6, 6 + n), the first six rows of M, which give the momentum about the base origin in base axes."""
    A = composite.floating_mass_matrix(r.chain(), r.inertias())[:6]
    meaning = "rows 1-3 linear, rows 4-6 angular momentum, over [twist; dq]"
    port = Port("A", (6, 6 + r.n), "SI", "base", meaning)
    return r.builder.program(
        "floating_momentum_matrix",
        [(port, flat(A))],
        "Momentum matrix of a floating base.",
        MOMENTUM_IS,
        ["The momentum is that of the whole robot about the base origin, in base axes."],
    )


def _momentum_program(r: FunctionBuilder, values: list[Any]) -> Program:
    meaning = "linear, then angular momentum about the base origin, in base axes"
    port = Port("momentum", (6,), "N s, N m s", "base", meaning)
    return r.builder.program("floating_momentum", [(port, values)], "Momentum on a floating base.", MOMENTUM_IS)


def momentum_by_links(r: FunctionBuilder) -> Program:
    """Record the momentum (6,) of the whole robot about the base origin as the sum of that of its links."""
    chain, dq, twist = r.chain(), r.joints("dq"), r.on_base("twist")
    return _momentum_program(r, momentum.floating_momentum(chain, dq, (twist[:3], twist[3:]), r.inertias()))


def momentum_by_matrix(r: FunctionBuilder) -> Program:
    """Record the momentum (6,) of the whole robot about the base origin by the first six rows of M."""
    chain, dq, twist = r.chain(), r.joints("dq"), r.on_base("twist")
    A = composite.floating_mass_matrix(chain, r.inertias())[:6]
    return _momentum_program(r, [dot(row, [*twist, *dq]) for row in A])


def jacobian(r: FunctionBuilder) -> Program:
    """Record J (6, 6 + n) of the tip over the twist of the base and dq, in base axes."""
    J = kinematics.floating_jacobian(r.chain())
    meaning = "of the tip, rows 1-3 linear, rows 4-6 angular velocity; columns of the twist, then of dq"
    port = Port("J", (6, 6 + r.n), "m, 1", "base", meaning)
    return r.builder.program(
        "floating_jacobian",
        [(port, flat(J))],
        "Geometric Jacobian of the tip on a floating base.",
        "[v_tip; omega_tip] = J(q) [twist; dq],  [wrench; tau] = J' F of a wrench F at the tip",
    )


def jacobian_dot_dq(r: FunctionBuilder) -> Program:
    """Record the acceleration (6,) of the tip where neither the twist nor dq changes, in base axes."""
    chain, dq, twist = r.chain(), r.joints("dq"), r.on_base("twist")
    a = kinematics.floating_jacobian_dot_dq(chain, dq, twist[:3], twist[3:])
    meaning = "linear, then angular acceleration of the tip for twist_rate = 0 and ddq = 0"
    port = Port("a", (6,), "m/s^2, rad/s^2", "base", meaning)
    return r.builder.program(
        "floating_jacobian_dot_dq",
        [(port, a)],
        "Acceleration of the tip on a floating base where neither twist nor dq changes.",
        "d[v_tip; omega_tip]/dt = J(q) [twist_rate; ddq] + a, the time derivative in world axes, written in base axes",
    )


def forward_dynamics(r: FunctionBuilder, mass: Program, forces: Program) -> Program:
    """Record twist_rate (6,) and ddq (n,) by M = L D L', from the programs of the mass matrix and of h.

    The status is 1 if M is not positive definite; the accelerations then are 0. It is 2 for an orientation that is no
    unit quaternion.
    """
    tau = [r.joints(name) for name in ("q", "dq", "tau")][2]
    wrench = [r.on_base(name) for name in ("orientation", "twist", "wrench")][2]
    if forces.takes(Role.GRAVITY):
        r.gravity()
    if mass.takes(Role.BASE_PARAMETERS):
        r.beta()
    M = rows(6 + r.n, replay(mass, r.builder, r.inputs_of(mass))[0])
    h, (unit_status,) = replay(forces, r.builder, r.inputs_of(forces))
    factors = factorize(r.builder, M, tips_first=True)
    status, solution = factors.status, factors.solve(subtract([*wrench, *tau], h))
    unit = " | ".join(part + "/s^2" for part in r.position_unit.split(" | "))
    zero = "; zero when M is not positive definite"
    meaning = f"rates of the components of the twist, linear part first, in base axes{zero}"
    ports = [
        (Port("twist_rate", (6,), "m/s^2, rad/s^2", "base", meaning, Role.TWIST_RATE), solution[:6]),
        (Port("ddq", (r.n,), unit, "", f"joint accelerations{zero}", Role.ACCELERATION), solution[6:]),
        (STATUS, [r.builder.select(status, status, unit_status)]),
    ]
    definite = status_at(len(ports) - 1)
    return r.builder.program(
        "floating_forward_dynamics",
        ports,
        "Accelerations of a floating base and of the joints.",
        "M(q) [twist_rate; ddq] = [wrench; tau] - h, solved by L D L'",
        ["The status tells when M is not positive definite (a singular or unphysical set of parameters)."],
        replace(definite, failures=(*definite.failures, NO_UNIT)),
    )


INVERSE_DYNAMICS = (inverse_dynamics(block_frames_first), inverse_dynamics(link_frames_only))
BIAS = (bias(block_frames_first), bias(link_frames_only))
MOMENTUM = (momentum_by_links, momentum_by_matrix)
INVERSE_DYNAMICS_FROM_IMU = (inverse_dynamics_from_imu(block_frames_first), inverse_dynamics_from_imu(link_frames_only))
_WAYS = (
    *((columns_by_axes, frames) for frames in (link_frames_only, block_frames_first)),
    *((columns_passed_down, frames) for frames in (link_frames_only, block_frames_first, block_frames_but_last)),
)
REGRESSOR = tuple(regressor(*way) for way in _WAYS)
REGRESSOR_FROM_IMU = tuple(regressor_from_imu(*way) for way in _WAYS)
