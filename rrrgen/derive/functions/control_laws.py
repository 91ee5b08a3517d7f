"""Recorders of control laws: one call per control period computes the torques, limited, with friction compensated.

With ``e = q_d - q`` and the state z of the integral action, which the caller owns,

    pd_gravity       tau = kp e + kd e' + ki z + g(q) + f(dq_d)
    feedforward      tau = M(q_d) ddq_d + c(q_d, dq_d) + g(q_d) + kp e + kd e' + ki z + f(dq_d)
    computed_torque  tau = M(q) (ddq_d + kp e + kd e' + ki z) + c(q, dq) + g(q) + f(dq_d)    (14.34)
    impedance        tau = J' (stiffness e_x + damping (V_d - J dq)) + g(q)
    slotine_li       tau = M(q) a + C(q, dq) v + g(q) - k s + f(dq_d),  beta' = -gamma Y' s,
                     v = dq_d + lam e,  a = ddq_d + lam e',  s = dq - v

For the tip, e_x (6,) is the error of its pose (position in m, then the rotation error ``sin(angle) axis``) and V_d (6,)
its desired velocity, linear rows first. The gains are inputs: kp, kd, ki, lam and k (n,) at the joints, gamma (b,) for
the adaptation of the base parameters beta, stiffness and damping (6,) along and about the axes of the base frame.

Friction f is taken at the desired speed: at rest the sign of a measured speed is noise. A friction law that depends on
the load takes as load the torque of the control law before friction is added. Torques are limited to ``tau_max``; an
integral does not grow into the limit of its joint, and parameters are not adapted while a joint is at its limit.
(14.34) is from Kostic, de Jager and Steinbuch, chapter 14 of the Robotics and Automation Handbook (CRC Press, 2005).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from fractions import Fraction
from typing import Any

from rrrgen.derive.functions.dynamics import Frames, block_frames_first, inverse_dynamics, link_frames_only, torque_port
from rrrgen.derive.functions.friction import RunTimeFriction
from rrrgen.derive.functions.operational_space import limit_torques, rotation_error
from rrrgen.derive.functions.recording import JOINT_ROLES, FunctionBuilder, Recorder
from rrrgen.derive.functions.regressors import regressor_transpose
from rrrgen.derive.recursions import energy_and_momentum as momentum
from rrrgen.derive.recursions import kinematics, newton_euler
from rrrgen.derive.recursions import mass_matrix_and_gravity as composite
from rrrgen.derive.recursions.linear_algebra import add, elementwise, scale, subtract, times, transpose
from rrrgen.program import Port, Program, Role, Value
from rrrgen.program.differentiation import Tangent, is_zero, record, tangents

# ------------------------------------------------------------------------------------------------------------------
# Recorders of the functions that observers and passivity-based controllers need.
#
# Slotine and Li's law contains the reference velocity v beside the measured one: ``M a + C(q, dq) v + g``. The
# Coriolis torques are quadratic in the velocities, ``C(q, dq) v = c(dq, v)`` with a symmetric bilinear c, and half
# the derivative of ``c(dq, dq)`` along v is just ``c(dq, v)``. So the two-velocity functions are derivatives of the
# usual ones along
#
#     dq -> v/2,   ddq -> a,   gravity -> gravity,
#
# taken at ddq = 0 and gravity = 0: exact, and in one pass, where the usual functions would be called twice.
# ------------------------------------------------------------------------------------------------------------------


def momentum_terms(r: FunctionBuilder) -> Program:
    """Record p = M dq, C' dq and g, (n,) each, the terms of momentum observers: dp/dt = tau + C' dq - g."""
    chain = r.chain_in_gravity("dq")
    dq, inertias = r.joints("dq"), r.inertias()
    p, transposed = momentum.momentum_and_coriolis_transpose(chain, dq, inertias)
    p = r.drive_inertia().added_to_momentum(p, dq)
    unit = " | ".join({"N m": "N m s", "N": "N s"}[part] for part in r.torque_unit.split(" | "))
    ports = [
        Port("p", (r.n,), unit, "", "generalized momentum M dq, drive inertia included"),
        torque_port(r, "ct", "C' dq, the gradient of the kinetic energy with respect to q"),
        torque_port(r, "g", "torques that hold the arm against gravity"),
    ]
    return r.builder.program(
        "momentum_terms",
        list(zip(ports, (p, transposed, composite.gravity(chain, inertias)), strict=True)),
        "Generalized momentum and the terms of its rate of change, for momentum observers.",
        "p = M(q) dq,  dp/dt = tau + C(q, dq)' dq - g(q)",
    )


def reference_torque(frames: Frames) -> Recorder:
    """Make a recorder of tau = M a + C(q, dq) v + g, (n,), the feed-forward of Slotine and Li.

    C is the matrix from the Christoffel symbols. ``frames`` chooses the frame in which each link is computed.
    """

    def record_torque(r: FunctionBuilder) -> Program:
        _declare_joint_vectors(r, "q", "dq")
        (tau,) = along_reference(r, inverse_dynamics(frames), _declare_joint_vectors(r, "v", "a"))
        return r.builder.program(
            "reference_torque",
            [(torque_port(r, "tau", "joint torques, friction not included"), tau)],
            "Joint torques for a reference velocity and acceleration at the measured velocity (Slotine and Li).",
            "tau = M(q) a + C(q, dq) v + g(q),  dM/dt - 2 C skew",
        )

    return record_torque


def reference_regressor_transpose(r: FunctionBuilder) -> Program:
    """Record r = Y(q, dq, v, a)' e (b,) for tau = Y beta = M a + C(q, dq) v + g."""
    _declare_joint_vectors(r, "q", "dq")
    (product,) = along_reference(r, regressor_transpose, _declare_joint_vectors(r, "v", "a", "e"))
    port = r.beta_port("Y' e", Role.OTHER, "r")
    return r.builder.program(
        "reference_regressor_transpose",
        [(port, product)],
        "Transposed regressor of the reference torques times a vector, for adaptive control; Y is never formed.",
        "r = Y(q, dq, v, a)' e,  Y beta = M(q) a + C(q, dq) v + g(q)",
    )


def along_reference(
    r: FunctionBuilder, recorder: Recorder, reference: Mapping[Role, Sequence[Value]]
) -> list[list[Value]]:
    """Evaluate a function of (q, dq, ddq) with ``M a + C(q, dq) v + g`` in place of the torques tau.

    It is the directional derivative of the function of ``recorder`` along dq: v/2, ddq: a and gravity, at ddq = 0 and
    without gravity, since c(q, dq) is quadratic in dq. ``reference`` holds v, a and, if the function takes it, e by
    role.
    """
    program = recorder(r.with_gravity_input())
    gravity = r.gravity() if r.model.spec.gravity_input else [r.constant(g) for g in r.model.spec.gravity]
    given: dict[Role, Sequence[Value]] = {
        Role.POSITION: r.joints("q"),
        Role.VELOCITY: r.joints("dq"),
        Role.ACCELERATION: [0] * r.n,
        Role.GRAVITY: [0, 0, 0],
        **reference,
    }
    if program.takes(Role.BASE_PARAMETERS):
        given[Role.BASE_PARAMETERS] = r.beta()
    half = [Fraction(1, 2) * rate for rate in reference[Role.REFERENCE_VELOCITY]]
    a = reference[Role.REFERENCE_ACCELERATION]
    direction = {Role.VELOCITY: half, Role.ACCELERATION: a, Role.GRAVITY: gravity}
    return _derivative(r, program, given, direction)


def _declare_joint_vectors(r: FunctionBuilder, *names: str) -> dict[Role, Sequence[Value]]:
    """Declare the joint vectors ``names`` as inputs and return them by role."""
    return {JOINT_ROLES[name]: r.joints(name) for name in names}


def _derivative(
    r: FunctionBuilder,
    program: Program,
    given: Mapping[Role, Sequence[Value]],
    direction: Mapping[Role, Sequence[Value]],
) -> list[list[Value]]:
    """The directional derivative of all outputs of ``program`` at ``given`` along ``direction``, both by role."""
    seeds: list[list[Tangent]] = []
    for port in program.inputs:
        along = direction.get(port.role, [0] * port.size)
        seeds.append([{} if is_zero(value) else {0: value} for value in along])
    values = record(program, r.builder, [given[port.role] for port in program.inputs])
    return [[tangent.get(0, 0) for tangent in row] for row in tangents(program, r.builder, values, seeds)]


REFERENCE_TORQUE = (reference_torque(block_frames_first), reference_torque(link_frames_only))


# ------------------------------------------------------------------------------------------------------------------
# Recorders of control laws
# ------------------------------------------------------------------------------------------------------------------

Vector = list[Any]

DESIRED = ("q_d", "dq_d", "ddq_d")


class _TrackingLaw:
    """The common part of the tracking laws: inputs, errors e and e', PID feedback, integral action, torque limits."""

    def __init__(self, r: FunctionBuilder, gains: Sequence[str], further: Sequence[str] = ()) -> None:
        self.r = r
        self.q, self.dq, self.q_d, self.dq_d, self.ddq_d, *_ = (r.joints(n) for n in ("q", "dq", *DESIRED, *further))
        self.gains = {name: r.take(name) for name in gains}
        self.e, self.de = subtract(self.q_d, self.q), subtract(self.dq_d, self.dq)

    def feedback(self) -> Vector:
        """The feedback ``kp e + kd e' + ki z``, (n,), with z the state of the integral action."""
        self.z = self.r.take("z")
        total = add(elementwise(self.gains["kp"], self.e), elementwise(self.gains["kd"], self.de))
        return add(total, elementwise(self.gains["ki"], self.z))

    def add_friction_and_limit(self, tau: Vector) -> tuple[Vector, Vector]:
        """Add friction at the desired speed to ``tau`` (n,) and limit the sum; also returns 1 per limited joint.

        ``tau`` is the load of friction laws that depend on the load.
        """
        friction = RunTimeFriction.declare(self.r, smooth=True)
        tau = add(tau, friction.torques(self.dq_d, tau))
        tau_max = self.r.take("tau_max")
        return limit_torques(self.r.builder, tau, tau_max)

    def program(self, name: str, tau: Vector, summary: str, formula: str) -> Program:
        """Finish the law ``name``, whose torques before friction and limits are ``tau`` (n,), with integral action."""
        r, b = self.r, self.r.builder
        unlimited = add(tau, RunTimeFriction.declare(r, smooth=True).torques(self.dq_d, tau))
        held, at_limit = self.add_friction_and_limit(tau)
        (Ts,) = r.take("Ts")
        grown = add(self.z, scale(Ts, self.e))
        # the integral stays where the joint is at its limit and the error would drive it further into the limit
        into = [b.mul(flag, b.mul(t, e)) for flag, t, e in zip(at_limit, unlimited, self.e, strict=True)]
        following = [b.select(i, z, new) for i, z, new in zip(into, self.z, grown, strict=True)]
        return b.program(
            name,
            [
                (torque_port(r, "tau", "torques to apply, within tau_max"), held),
                (Port("z_next", (r.n,), r.unit("rad s | m s"), "", "state for the next tick", state="z"), following),
            ],
            summary,
            formula,
            [
                "e = q_d - q; friction f at the desired speed, with tanh(s / width) for sgn(s).",
                "The integral stays where a joint is at its limit and the error would drive it further.",
            ],
        )


PID = ("kp", "kd", "ki")


def pd_gravity(r: FunctionBuilder) -> Program:
    """Record one tick of PID control with compensation of gravity and friction.

    ``tau = kp e + kd e' + ki z + g(q) + f(dq_d)``, (n,), limited to ``tau_max``; also returned is the state z (n,) of
    the integral action for the next tick.
    """
    loop = _TrackingLaw(r, PID)
    chain = r.chain_in_gravity("dq", *DESIRED)
    feedback = loop.feedback()
    tau = add(feedback, composite.gravity(chain, r.inertias()))
    return loop.program(
        "pd_gravity", tau, "PD control with gravity and friction compensation.",
        "tau = kp e + kd e' + ki z + g(q) + f(dq_d)",
    )  # fmt: skip


def feedforward(r: FunctionBuilder) -> Program:
    """Record one tick of PID control with the torques of the desired motion as feed-forward.

    ``tau = M(q_d) ddq_d + c(q_d, dq_d) + g(q_d) + kp e + kd e' + ki z + f(dq_d)``, (n,), limited to ``tau_max``; also
    returned is the state z (n,) of the integral action for the next tick.
    """
    loop = _TrackingLaw(r, PID)
    chain = r.chain_at(loop.q_d, "dq", *DESIRED)
    feedback = loop.feedback()
    model = newton_euler.inverse_dynamics(chain, loop.dq_d, loop.ddq_d, r.inertias(), block_frames_first(chain))
    tau = add(r.drive_inertia().added_to_torques(model, loop.ddq_d), feedback)
    return loop.program(
        "feedforward", tau, "Feed-forward of the desired motion with PD control.",
        "tau = M(q_d) ddq_d + c(q_d, dq_d) + g(q_d) + kp e + kd e' + ki z + f(dq_d)",
    )  # fmt: skip


def computed_torque(r: FunctionBuilder) -> Program:
    """Record one tick of computed-torque control (inverse dynamics in the loop). (14.34)

    ``tau = M(q) (ddq_d + kp e + kd e' + ki z) + c(q, dq) + g(q) + f(dq_d)``, (n,), limited to ``tau_max``; also
    returned is the state z (n,) of the integral action for the next tick.
    """
    loop = _TrackingLaw(r, PID)
    chain = r.chain_in_gravity("dq", *DESIRED)
    a = add(loop.ddq_d, loop.feedback())
    model = newton_euler.inverse_dynamics(chain, loop.dq, a, r.inertias(), block_frames_first(chain))
    tau = r.drive_inertia().added_to_torques(model, a)
    return loop.program(
        "computed_torque", tau, "Computed torque control (inverse dynamics in the loop).",
        "tau = M(q) (ddq_d + kp e + kd e' + ki z) + c(q, dq) + g(q) + f(dq_d)   (14.34)",
    )  # fmt: skip


def slotine_li(r: FunctionBuilder) -> Program:
    """Record one tick of the adaptive passivity-based law of Slotine and Li (1987).

    ``tau = M(q) a + C(q, dq) v + g(q) - k s + f(dq_d)`` with ``v = dq_d + lam e``, ``a = ddq_d + lam e'``,
    ``s = dq - v`` and the gains lam and k (n,). Outputs are tau (n,), limited to ``tau_max``, and the base parameters
    (b,) adapted for the next tick.
    """
    loop = _TrackingLaw(r, ("lam", "k"))
    b, lam = r.builder, loop.gains["lam"]
    v, a = add(loop.dq_d, elementwise(lam, loop.e)), add(loop.ddq_d, elementwise(lam, loop.de))
    s = subtract(loop.dq, v)
    reference: dict[Role, Sequence[Value]] = {Role.REFERENCE_VELOCITY: v, Role.REFERENCE_ACCELERATION: a}
    (tau,) = along_reference(r, inverse_dynamics(block_frames_first), reference)
    held, at_limit = loop.add_friction_and_limit(subtract(tau, elementwise(loop.gains["k"], s)))
    (slope,) = along_reference(r, regressor_transpose, {**reference, Role.COVECTOR: s})
    gamma = r.take("gamma")
    lower, upper = (r.take(f"beta_{end}") for end in ("min", "max"))
    (Ts,) = r.take("Ts")
    beta = r.beta()
    any_limit: Any = 0
    for flag in at_limit:
        any_limit = any_limit + flag
    adapted = []
    for value, gain, rate, low, high in zip(beta, gamma, slope, lower, upper, strict=True):
        moved = b.sub(value, b.mul(b.mul(Ts, gain), rate))
        bounded = b.select(b.sub(moved, high), high, b.select(b.sub(low, moved), low, moved))
        adapted.append(b.select(any_limit, value, bounded))
    return b.program(
        "slotine_li",
        [
            (torque_port(r, "tau", "torques to apply, within tau_max"), held),
            (replace(r.beta_port("base parameters for the next tick", name="beta_next"), state="beta"), adapted),
        ],
        "Passivity-based tracking with adaptation of the base parameters (Slotine and Li 1987).",
        "tau = M a + C v + g - k s + f(dq_d),  beta_next = beta - Ts gamma Y' s\n"
        "v = dq_d + lam e,  a = ddq_d + lam e',  s = dq - v",
        [
            "beta stays between its bounds, and as it is while a joint is at its limit.",
            "With gamma = 0 the law is not adaptive.",
        ],
    )


def impedance(r: FunctionBuilder) -> Program:
    """Record impedance control of the tip: the torques (n,) of a spring and a damper towards a desired pose.

    ``tau = J' (stiffness e_x + damping (V_d - J dq)) + g(q)``, limited to ``tau_max``, with e_x (6,) the error of the
    pose (position, then rotation) and V_d (6,) the desired velocity of the tip, both in base axes.
    """
    chain = r.chain_in_gravity("dq")
    dq = r.joints("dq")
    T_d = r.take("T_d")
    V_d = r.take("V_d")
    stiffness = r.take("stiffness")
    damping = r.take("damping")
    T, J = kinematics.forward_kinematics(chain), kinematics.jacobian(chain)
    turn = rotation_error([row[:3] for row in T[:3]], [T_d[4 * i : 4 * i + 3] for i in range(3)])
    error = [*(T_d[4 * i + 3] - T[i][3] for i in range(3)), *turn]
    F = add(elementwise(stiffness, error), elementwise(damping, subtract(V_d, times(J, dq))))
    tau = add(times(transpose(J), F), composite.gravity(chain, r.inertias()))
    b = r.builder
    tau_max = r.take("tau_max")
    held, _ = limit_torques(b, tau, tau_max)
    return b.program(
        "impedance",
        [(torque_port(r, "tau", "torques to apply, within tau_max"), held)],
        "Impedance of the tip: a spring and a damper towards a desired pose, and gravity.",
        "tau = J' (stiffness e_x + damping (V_d - J dq)) + g(q)",
        [
            "e_x: position error, then sin(angle) axis of the rotation error, exact in direction below 90 degrees.",
            "Friction is not compensated: at the measured speed that would take damping away.",
        ],
    )
