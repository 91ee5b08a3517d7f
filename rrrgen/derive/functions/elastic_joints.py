"""Recorders for elastic joints (Spong 1987): links and rotors with a spring and a damper between them in every joint.

With the positions q of the links and theta of the rotors, both seen at the joints,

    M(q) q'' + c(q, q') + g(q) = K (theta - q) + D (theta' - q')
    J theta'' + K (theta - q) + D (theta' - q') = tau

where M is that of the links alone. Without damping the motion of the links determines everything: theta = q + tau_l/K
with the torques tau_l of the links, and ``tau = J theta'' + tau_l`` contains their second derivative, and with it the
fourth derivative of q. These derivatives come from the program of tau_l, differentiated along time.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Any

from rrrgen.derive.functions.dynamics import Frames, block_frames_first, link_frames_only, torque_port
from rrrgen.derive.functions.friction import RunTimeFriction
from rrrgen.derive.functions.operational_space import limit_torques
from rrrgen.derive.functions.recording import FunctionBuilder, Recorder
from rrrgen.derive.recursions import mass_matrix_and_gravity as composite
from rrrgen.derive.recursions import newton_euler
from rrrgen.derive.recursions.linear_algebra import LDLFactors, Vector, add, elementwise, factorize, status_at, subtract
from rrrgen.program import Builder, Port, Program, Role, Value
from rrrgen.program.differentiation import Tangent, is_zero, record, tangents

MOTION = ("q", "dq", "ddq", "d3q", "d4q")
DESIRED = ("q_d", "dq_d", "ddq_d", "d3q_d", "d4q_d")
NO_DAMPING = "Damping of the joints is left out: with it the motion of the rotors follows from a differential equation."


def _over(x: Sequence[Any], y: Sequence[Any]) -> Vector:
    return [u / v for u, v in zip(x, y, strict=True)]


def _rotors(r: FunctionBuilder) -> tuple[Vector, Vector]:
    """Rotor inertias J and stiffnesses K (n,), declared as inputs."""
    J = r.take("rotor_inertia")
    return list(J), list(r.take("stiffness"))


def _links(r: FunctionBuilder, frames: Frames) -> Program:
    """Record a program of the torques tau_l (n,) that the links alone need, without rotors and springs.

    ``frames`` chooses for each link the frame in which it is computed: its link frame or that of its block.
    """
    alone = FunctionBuilder(r.model, r.parametrization)
    chain = alone.chain_in_gravity("dq", "ddq")
    tau = newton_euler.inverse_dynamics(chain, alone.joints("dq"), alone.joints("ddq"), alone.inertias(), frames(chain))
    return alone.builder.program("links", [(torque_port(alone, "tau", ""), tau)])


def along_time(program: Program, motion: Sequence[str]) -> Program:
    """Extend ``program`` by one output: the time derivative of its last output.

    ``motion`` names ports in the order of differentiation, q, dq, ddq, ...; the last one is not an input of ``program``
    and becomes one.
    """
    builder = Builder()
    given = [builder.input(port) for port in program.inputs]
    values = {port.name: value for port, value in zip(program.inputs, given, strict=True)}
    values[motion[-1]] = builder.input(Port(motion[-1], program.inputs[0].shape))
    following = dict(pairwise(motion))
    seeds: list[list[Tangent]] = []
    for port in program.inputs:
        rates = values[following[port.name]] if port.name in following else [0] * port.size
        seeds.append([{} if is_zero(rate) else {0: rate} for rate in rates])
    recorded = record(program, builder, given)
    output_tangents = tangents(program, builder, recorded, seeds)[-1]
    outputs: list[tuple[Port, list[Value]]] = [
        (port, [recorded[index] for index in elements])
        for port, elements in zip(program.outputs, program.results, strict=True)
    ]
    outputs.append(
        (
            Port(f"d{program.outputs[-1].name}", (len(output_tangents),)),
            [tangent.get(0, 0) for tangent in output_tangents],
        )
    )
    return builder.program(program.name, outputs)


def _link_torques(r: FunctionBuilder, links: Program, motion: Sequence[Vector]) -> list[Vector]:
    """The torques tau_l of the links and their time derivatives along a ``motion`` q, q', q'' and further derivatives.

    ``links`` gives the torques of the links; drive inertia that it takes is left out.
    """
    program = links
    for order in range(4, len(motion) + 1):
        program = along_time(program, MOTION[:order])
    given = dict(zip(MOTION, motion, strict=False))
    inputs = []
    for port in program.inputs:
        if port.role is Role.GRAVITY:
            inputs.append(list(r.gravity()))
        elif port.role is Role.BASE_PARAMETERS:
            inputs.append([*r.beta()[: port.size - r.drives], *[0] * r.drives])
        else:
            inputs.append(given[port.name])
    values = record(program, r.builder, inputs)
    return [[values[index] for index in row] for row in program.results]


def _rotor_motion(r: FunctionBuilder, links: Program, motion: Sequence[Vector]) -> tuple[Vector, Vector, Vector]:
    """Torques tau, positions theta and velocities theta' of the rotors for the ``motion`` q .. d4q of the links."""
    torques = _link_torques(r, links, motion)
    J, K = _rotors(r)
    theta, dtheta, ddtheta = (add(x, _over(t, K)) for x, t in zip(motion, torques, strict=False))
    return add(elementwise(J, ddtheta), torques[0]), theta, dtheta


def elastic_inverse_dynamics(r: FunctionBuilder, links: Program) -> Program:
    """Record the rotor torques tau and motion theta, theta', (n,) each, that produce a given motion of the links.

    ``links`` is a program of the torques tau_l of the links alone; ``tau = J theta'' + tau_l``, ``theta = q +
    tau_l/K``.
    """
    motion = [list(r.joints(name)) for name in MOTION[:3]]
    motion.append(list(r.take("d3q")))
    motion.append(list(r.take("d4q")))
    if r.model.spec.gravity_input:
        r.gravity()
    tau, theta, dtheta = _rotor_motion(r, links, motion)
    return r.builder.program(
        "elastic_inverse_dynamics",
        [
            (torque_port(r, "tau", "torques of the motors at the joints, friction not included"), tau),
            (Port("theta", (r.n,), r.position_unit, "", "positions of the rotors, seen at the joints"), theta),
            (Port("dtheta", (r.n,), r.unit("rad/s | m/s"), "", "velocities of the rotors"), dtheta),
        ],
        "Torques of the motors and motion of the rotors with elastic joints, for a motion of the links.",
        "tau = J theta'' + tau_l,  theta = q + tau_l/K,  tau_l = M ddq + c + g of the links alone",
        [NO_DAMPING],
    )


def _solver(r: FunctionBuilder, links: Program, q: Vector, dq: Vector) -> tuple[LDLFactors, Vector]:
    """The factors of the mass matrix M of the links, and the torques h = c + g (n,) of the links."""
    chain = r.chain_in_gravity("dq")
    factors = factorize(r.builder, composite.mass_matrix(chain, r.inertias()), tips_first=r.branches)
    (h,) = _link_torques(r, links, [q, dq, [0] * r.n])
    return factors, h


def elastic_forward_dynamics(r: FunctionBuilder) -> Program:
    """Record the accelerations of links and rotors (n,) with elastic joints, and the status."""
    q, dq = list(r.joints("q")), list(r.joints("dq"))
    theta = list(r.take("theta"))
    dtheta = list(r.take("dtheta"))
    tau = list(r.joints("tau"))
    factors, h = _solver(r, _links(r, link_frames_only), q, dq)
    J, K = _rotors(r)
    D = list(r.take("damping"))
    load = add(elementwise(K, subtract(theta, q)), elementwise(D, subtract(dtheta, dq)))
    ddq = factors.solve(subtract(load, h))
    unit = r.unit("rad/s^2 | m/s^2")
    meaning = "accelerations of the links; zero when the status is not ok"
    return r.builder.program(
        "elastic_forward_dynamics",
        [
            (Port("ddq", (r.n,), unit, "", meaning, Role.ACCELERATION), ddq),
            (Port("ddtheta", (r.n,), unit, "", "accelerations of the rotors"), _over(subtract(tau, load), J)),
            (Port("status", (), "1"), [factors.status]),
        ],
        "Accelerations of links and rotors with elastic joints.",
        "M ddq + c + g = K (theta - q) + D (dtheta - dq) = tau - J ddtheta,  M of the links alone",
        ["tau are the torques at the rotors, less their friction."],
        status_at(2),
    )


def _declare_desired_motion(r: FunctionBuilder) -> list[Vector]:
    """Declare the desired motion of the links as inputs: q_d and its first four time derivatives, (n,) each."""
    motion = [list(r.joints(name)) for name in DESIRED[:3]]
    motion.append(list(r.take("d3q_d")))
    motion.append(list(r.take("d4q_d")))
    return motion


def _law(
    r: FunctionBuilder, name: str, tau: Vector, summary: str, formula: str, notes: Sequence[str], status: Any
) -> Program:
    """Finish the control law ``name``: add friction at the desired speed to ``tau``, and limit the torques."""
    friction = RunTimeFriction.declare(r, smooth=True)
    tau = add(tau, friction.torques(r.joints("dq_d"), tau))
    tau_max = r.take("tau_max")
    held, _ = limit_torques(r.builder, tau, tau_max)
    outputs: list[tuple[Port, list[Any]]] = [(torque_port(r, "tau", "torques to apply, within tau_max"), held)]
    if status is not None:
        outputs.append((Port("status", (), "1"), [status]))
    code = None if status is None else status_at(1)
    return r.builder.program(name, outputs, summary, formula, [*notes, *friction.laws], code)


def elastic_feedforward(r: FunctionBuilder, links: Program) -> Program:
    """Record feed-forward of a motion of the links, with PD control of the rotors, which the encoders measure.

    ``tau = J theta_d'' + tau_l + kp (theta_d - theta) + kd (theta_d' - theta') + f(dq_d)``, (n,), limited to
    ``tau_max``, with ``theta_d = q_d + tau_l/K``.
    """
    theta = list(r.take("theta"))
    dtheta = list(r.take("dtheta"))
    motion = _declare_desired_motion(r)
    kp, kd = r.take("kp"), r.take("kd")
    if r.model.spec.gravity_input:
        r.gravity()
    tau, theta_d, dtheta_d = _rotor_motion(r, links, motion)
    tau = add(tau, add(elementwise(kp, subtract(theta_d, theta)), elementwise(kd, subtract(dtheta_d, dtheta))))
    return _law(
        r,
        "elastic_feedforward",
        tau,
        "Feed-forward of a motion of the links with elastic joints, and PD control of the rotors.",
        "tau = J theta_d'' + tau_l + kp (theta_d - theta) + kd (theta_d' - theta') + f(dq_d)\ntheta_d = q_d + tau_l/K",
        [NO_DAMPING, "tau_l = M ddq_d + c + g of the links alone, at the desired motion."],
        None,
    )


def elastic_feedback_linearization(r: FunctionBuilder, links: Program) -> Program:
    """Record Spong's feedback linearisation: the error e = q_d - q of every link decays with four poles at -w.

    The input w (n,), rad/s, is the bandwidth of each joint: ``d4e + 4 w d3e + 6 w^2 dde + 4 w^3 de + w^4 e = 0``.
    Outputs are the torques tau (n,) of the rotors, limited to ``tau_max``, and the status.
    """
    q, dq = list(r.joints("q")), list(r.joints("dq"))
    theta = list(r.take("theta"))
    dtheta = list(r.take("dtheta"))
    desired = _declare_desired_motion(r)
    w = list(r.take("w"))
    factors, h = _solver(r, links, q, dq)
    J, K = _rotors(r)
    ddq = factors.solve(subtract(elementwise(K, subtract(theta, q)), h))
    # tau_l' = M q''' + rest, so rest is tau_l' evaluated at q''' = 0
    rest = _link_torques(r, links, [q, dq, ddq, [0] * r.n])[1]
    d3q = factors.solve(subtract(elementwise(K, subtract(dtheta, dq)), rest))
    v = desired[4]
    for factor, power, wanted, motion in zip((1, 4, 6, 4), (4, 3, 2, 1), desired, (q, dq, ddq, d3q), strict=False):
        gain: Vector = [factor] * r.n
        for _ in range(power):
            gain = elementwise(gain, w)
        v = add(v, elementwise(gain, subtract(wanted, motion)))
    torques = _link_torques(r, links, [q, dq, ddq, d3q, v])
    tau = add(elementwise(J, add(ddq, _over(torques[2], K))), elementwise(K, subtract(theta, q)))
    return _law(
        r,
        "elastic_feedback_linearization",
        tau,
        "Feedback linearisation with elastic joints (Spong): linear, decoupled errors of the links.",
        "d4q = d4q_d + 4 w d3e + 6 w^2 dde + 4 w^3 de + w^4 e,  e = q_d - q",
        [NO_DAMPING, "Accelerations and jerks of the links follow from the measured state and the model."],
        factors.status,
    )


def _recorders(function: Callable[[FunctionBuilder, Program], Program]) -> tuple[Recorder, ...]:
    """Two recorders of ``function``, one for each choice of frames in :func:`_links`; the cheaper program is kept."""

    def recorder(frames: Frames) -> Recorder:
        return lambda r: function(r, _links(r, frames))

    return recorder(block_frames_first), recorder(link_frames_only)


ELASTIC_INVERSE_DYNAMICS = _recorders(elastic_inverse_dynamics)
ELASTIC_FEEDFORWARD = _recorders(elastic_feedforward)
ELASTIC_FEEDBACK_LINEARIZATION = _recorders(elastic_feedback_linearization)
