"""Recorders of the functions that observers and passivity-based controllers need.

Slotine and Li's law contains the reference velocity v beside the measured one: ``M a + C(q, dq) v + g``. The Coriolis
torques are quadratic in the velocities, ``C(q, dq) v = c(dq, v)`` with a symmetric bilinear c, and half the derivative
of ``c(dq, dq)`` along v is just ``c(dq, v)``. So the two-velocity functions are derivatives of the usual ones along

    dq -> v/2,   ddq -> a,   gravity -> gravity,

taken at ddq = 0 and gravity = 0: exact, and in one pass, where the usual functions would be called twice.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from fractions import Fraction

from rrrgen.derive.functions.dynamic_functions import (
    Frames,
    block_frames_first,
    inverse_dynamics,
    link_frames_only,
    torque_port,
)
from rrrgen.derive.functions.recording import JOINT_ROLES, Recorder, Recording
from rrrgen.derive.functions.regressors import regressor_transpose
from rrrgen.derive.recursions import energy_and_momentum as momentum
from rrrgen.derive.recursions import mass_matrix_and_gravity as composite
from rrrgen.program import Port, Program, Role, Value
from rrrgen.program.differentiation import Tangent, is_zero, record, tangents


def momentum_terms(r: Recording) -> Program:
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

    def record_torque(r: Recording) -> Program:
        _declared(r, "q", "dq")
        (tau,) = along_reference(r, inverse_dynamics(frames), _declared(r, "v", "a"))
        return r.builder.program(
            "reference_torque",
            [(torque_port(r, "tau", "joint torques, friction not included"), tau)],
            "Joint torques for a reference velocity and acceleration at the measured velocity (Slotine and Li).",
            "tau = M(q) a + C(q, dq) v + g(q),  dM/dt - 2 C skew",
        )

    return record_torque


def reference_regressor_transpose(r: Recording) -> Program:
    """Record r = Y(q, dq, v, a)' e (b,) for tau = Y beta = M a + C(q, dq) v + g."""
    _declared(r, "q", "dq")
    (found,) = along_reference(r, regressor_transpose, _declared(r, "v", "a", "e"))
    port = r.beta_port("Y' e", Role.OTHER, "r")
    return r.builder.program(
        "reference_regressor_transpose",
        [(port, found)],
        "Transposed regressor of the reference torques times a vector, for adaptive control; Y is never formed.",
        "r = Y(q, dq, v, a)' e,  Y beta = M(q) a + C(q, dq) v + g(q)",
    )


def along_reference(r: Recording, recorder: Recorder, reference: Mapping[Role, Sequence[Value]]) -> list[list[Value]]:
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


def _declared(r: Recording, *names: str) -> dict[Role, Sequence[Value]]:
    """Declare the joint vectors ``names`` as inputs and return them by role."""
    return {JOINT_ROLES[name]: r.joints(name) for name in names}


def _derivative(
    r: Recording, program: Program, given: Mapping[Role, Sequence[Value]], direction: Mapping[Role, Sequence[Value]]
) -> list[list[Value]]:
    """The directional derivative of all outputs of ``program`` at ``given`` along ``direction``, both by role."""
    seeds: list[list[Tangent]] = []
    for port in program.inputs:
        along = direction.get(port.role, [0] * port.size)
        seeds.append([{} if is_zero(value) else {0: value} for value in along])
    values = record(program, r.builder, [given[port.role] for port in program.inputs])
    return [[found.get(0, 0) for found in row] for row in tangents(program, r.builder, values, seeds)]


REFERENCE_TORQUE = (reference_torque(block_frames_first), reference_torque(link_frames_only))
