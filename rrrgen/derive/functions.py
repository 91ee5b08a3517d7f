"""The public model functions, each recorded as a program from the general derivations."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from fractions import Fraction
from typing import Any

import sympy as sp

from rrrgen.derive import composite, kinematics, momentum
from rrrgen.derive.chain import Chain, rational_float
from rrrgen.derive.coriolis import compose
from rrrgen.derive.derivatives import forward_dynamics_derivatives, inverse_dynamics_derivatives
from rrrgen.derive.inertia import STANDARD, from_standard
from rrrgen.derive.motion import LinkMotion, choose_frames, forward
from rrrgen.derive.newton_euler import inverse_dynamics
from rrrgen.derive.positive_definite import factorize
from rrrgen.derive.recording import Recording
from rrrgen.derive.regressor import all_parameters, columns_by_axes, columns_passed_down, virtual_power
from rrrgen.derive.vectors import dot
from rrrgen.program import Port, Program, Value
from rrrgen.program.ir import replay

BASE = "base frame"


def _flat(M: list[list[Any]]) -> list[Any]:
    return [value for row in M for value in row]


def _weightless(chain: Chain) -> Chain:
    return replace(chain, gravity=[0, 0, 0])


def forward_kinematics(r: Recording) -> Program:
    """Pose of the tip, from the base outwards."""
    return _pose(r, kinematics.forward_kinematics(r.chain()))


def forward_kinematics_inwards(r: Recording) -> Program:
    """Pose of the tip, axis by axis from the tip inwards."""
    return _pose(r, kinematics.forward_kinematics_inwards(r.chain()))


def _pose(r: Recording, T: list[list[Any]]) -> Program:
    port = Port("T", (4, 4), "-, m", BASE, "homogeneous transform of the tip")
    return r.builder.program(
        "forward_kinematics", [(port, _flat(T))], "Pose of the tip.", "T = T_base A_1(q_1) ... A_n(q_n) T_tool   (14.5)"
    )


def link_frames(r: Recording) -> Program:
    """Poses of all link frames."""
    frames = kinematics.link_frames(r.chain())
    port = Port("T", (r.n, 4, 4), "-, m", BASE, "homogeneous transforms of the link frames 1..n")
    values = [value for frame in frames for value in _flat(frame)]
    return r.builder.program(
        "link_frames", [(port, values)], "Poses of all link frames.", "T_i = T_base A_1(q_1) ... A_i(q_i)"
    )


def jacobian(r: Recording) -> Program:
    """Geometric Jacobian at the tip."""
    J = kinematics.jacobian(r.chain())
    port = Port("J", (6, r.n), "m, -", BASE, "rows 1-3 linear, rows 4-6 angular velocity of the tip")
    return r.builder.program("jacobian", [(port, _flat(J))], "Geometric Jacobian at the tip.", "[v; omega] = J(q) dq")


def jacobian_dot_dq(r: Recording) -> Program:
    """Derivative of the Jacobian times the joint rates."""
    chain = r.chain()
    a = kinematics.jacobian_dot_dq(chain, r.joints("dq"))
    port = Port("a", (6,), "m/s^2, rad/s^2", BASE, "linear, then angular acceleration of the tip for ddq = 0")
    return r.builder.program(
        "jacobian_dot_dq", [(port, a)], "Time derivative of the Jacobian times dq.", "a = (dJ/dt) dq"
    )


def mass_matrix(r: Recording) -> Program:
    """Mass matrix."""
    chain = r.chain()
    M = composite.mass_matrix(chain, r.inertias())
    for i, Ia in enumerate(r.drive_inertia()):
        M[i][i] = M[i][i] + Ia
    port = Port("M", (r.n, r.n), "SI", "", "symmetric mass matrix, drive inertia included")
    return r.builder.program("mass_matrix", [(port, _flat(M))], "Mass matrix.", "tau = M(q) ddq + c(q, dq) + g(q)")


def coriolis_matrix(r: Recording) -> Program:
    """Coriolis matrix."""
    chain = r.chain()
    dq = r.joints("dq")
    C = compose(chain, dq, r.inertias()).coriolis_matrix()
    port = Port("C", (r.n, r.n), "SI", "", "Coriolis matrix of the Christoffel symbols")
    return r.builder.program(
        "coriolis_matrix", [(port, _flat(C))], "Coriolis matrix.", "c = C(q, dq) dq,  dM/dt - 2 C skew, dM/dt = C + C'"
    )


def _torque_port(r: Recording, name: str, meaning: str) -> Port:
    return Port(name, (r.n,), r.torque_unit, "", meaning)


def _own_frames(chain: Chain) -> list[bool]:
    return choose_frames(chain)


def _block_frames(chain: Chain) -> list[bool]:
    return choose_frames(chain, range(chain.n))


Frames = Callable[[Chain], list[bool]]


def coriolis(frames: Frames) -> Callable[[Recording], Program]:
    """Coriolis and centrifugal torques."""

    def record(r: Recording) -> Program:
        chain = _weightless(r.chain())
        dq = r.joints("dq")
        c = inverse_dynamics(chain, dq, [0] * r.n, r.inertias(), frames(chain))
        port = _torque_port(r, "c", "Coriolis and centrifugal torques")
        return r.builder.program("coriolis", [(port, c)], "Coriolis and centrifugal torques.", "c = C(q, dq) dq")

    return record


def bias(frames: Frames) -> Callable[[Recording], Program]:
    """Coriolis, centrifugal and gravity torques together."""

    def record(r: Recording) -> Program:
        chain = r.chain()
        dq = r.joints("dq")
        torques = inverse_dynamics(chain, dq, [0] * r.n, r.inertias(), frames(chain))
        port = _torque_port(r, "h", "torques for ddq = 0, friction not included")
        return r.builder.program(
            "bias", [(port, torques)], "Coriolis, centrifugal and gravity torques together.", "h = c(q, dq) + g(q)"
        )

    return record


def coriolis_transpose(r: Recording) -> Program:
    """Transposed Coriolis matrix times the joint rates."""
    chain = r.chain()
    dq = r.joints("dq")
    value = momentum.coriolis_transpose(chain, dq, r.inertias())
    port = _torque_port(r, "p", "C' dq, the gradient of the kinetic energy with respect to q")
    return r.builder.program(
        "coriolis_transpose",
        [(port, value)],
        "Transposed Coriolis matrix times dq, for momentum observers.",
        "p = C(q, dq)' dq,  d(M dq)/dt = tau + C' dq - g",
    )


def gravity(r: Recording) -> Program:
    """Gravity torques."""
    chain = r.chain()
    g = composite.gravity(chain, r.inertias())
    port = _torque_port(r, "g", "torques that hold the arm against gravity")
    return r.builder.program("gravity", [(port, g)], "Gravity torques.", "g = dU/dq")


def inverse_dynamics_function(frames: Frames) -> Callable[[Recording], Program]:
    """Joint torques of the rigid body."""

    def record(r: Recording) -> Program:
        chain = r.chain()
        dq, ddq = r.joints("dq"), r.joints("ddq")
        tau = inverse_dynamics(chain, dq, ddq, r.inertias(), frames(chain))
        tau = [t + Ia * a for t, Ia, a in zip(tau, r.drive_inertia(), ddq, strict=True)]
        port = _torque_port(r, "tau", "joint torques, friction not included")
        return r.builder.program(
            "inverse_dynamics",
            [(port, tau)],
            "Joint torques of the rigid body with drive inertia.",
            "tau = M(q) ddq + c(q, dq) + g(q)   (14.6)",
        )

    return record


def forward_dynamics(r: Recording, mass: Program, torques: Program, nominal: bool = False) -> Program:
    """Joint accelerations, from the programs of the mass matrix and of the bias torques (``nominal``: without beta)."""
    inputs = {name: r.joints(name) for name in ("q", "dq", "tau")}
    if not nominal:
        inputs |= {"beta": r.beta(), "Ia": r.drive_inertia()}
    flat = replay(mass, r.builder, [inputs[port.name] for port in mass.inputs])[0]
    M = [flat[k * r.n : (k + 1) * r.n] for k in range(r.n)]
    h = replay(torques, r.builder, [inputs[port.name] for port in torques.inputs])[0]
    factors = factorize(r.builder, M)
    status, ddq = factors.status, factors.solve([t - b for t, b in zip(inputs["tau"], h, strict=True)])
    unit = " | ".join(part + "/s^2" for part in r.position_unit.split(" | "))
    ports = [
        (Port("status", ()), [status]),
        (Port("ddq", (r.n,), unit, "", "joint accelerations; zero when the status is not ok"), ddq),
    ]
    return r.builder.program(
        "forward_dynamics",
        ports,
        "Joint accelerations of the rigid body with drive inertia.",
        "M(q) ddq = tau - c(q, dq) - g(q), solved by L D L'",
        ["The status tells when M is not positive definite (a singular or unphysical set of parameters)."],
    )


def _regressor_rows(r: Recording, columns: list[list[Any]]) -> list[list[Any]]:
    """Columns in own base parameters, changed to the user's basis where there is one."""
    inverse = r.parametrization.inverse
    if inverse is None:
        return [list(row) for row in zip(*columns, strict=True)]
    return [_through(r, inverse, [column[j] for column in columns]) for j in range(r.n)]


def _through(r: Recording, inverse: tuple[tuple[sp.Expr, ...], ...], values: list[Any]) -> list[Any]:
    """Row vector times the inverse change of basis."""
    result: list[Any] = [0] * len(inverse[0])
    for row, value in zip(inverse, values, strict=True):
        for m, factor in enumerate(row):
            if factor != 0:
                result[m] = result[m] + r.constant(factor) * value
    return result


def _motions(r: Recording) -> tuple[Chain, list[LinkMotion]]:
    chain = r.chain()
    dq, ddq = r.joints("dq"), r.joints("ddq")
    return chain, forward(chain, dq, ddq, [True] * r.n)


def regressor(columns: Callable[..., list[list[Any]]], frames: Frames) -> Callable[[Recording], Program]:
    """Regressor in the base parameters."""

    def record(r: Recording) -> Program:
        chain = r.chain()
        dq, ddq = r.joints("dq"), r.joints("ddq")
        rows = _regressor_rows(r, columns(chain, dq, ddq, frames(chain), r.parametrization.own.parameters))
        port = Port("Y", (r.n, len(r.parametrization.names)), "SI", "", "columns in the order of the base parameters")
        return r.builder.program(
            "regressor",
            [(port, _flat(rows))],
            "Regressor in the base parameters.",
            "tau = Y(q, dq, ddq) beta   (14.10)",
        )

    return record


def regressor_transpose(r: Recording) -> Program:
    """Transposed base regressor times a vector."""
    chain, motions = _motions(r)
    e = r.joints("e")
    virtual = composite.velocities(chain, e)
    own = [True] * r.n
    values = [virtual_power(chain, motions, own, virtual, p) for p in r.parametrization.own.parameters]
    inverse = r.parametrization.inverse
    if inverse is not None:
        values = _through(r, inverse, values)
    port = Port("r", (len(values),), "SI", "", "Y' e")
    return r.builder.program(
        "regressor_transpose",
        [(port, values)],
        "Transposed base regressor times a vector, for adaptive laws; Y is never formed.",
        "r = Y(q, dq, ddq)' e   (14.23)",
    )


def standard_regressor(r: Recording) -> Program:
    """Regressor in the standard parameters."""
    chain = r.chain()
    dq, ddq = r.joints("dq"), r.joints("ddq")
    canonical = columns_by_axes(chain, dq, ddq, [True] * r.n, all_parameters(r.n))
    columns = []
    for i, X in enumerate(chain.link_frames):
        entries = canonical[len(STANDARD) * i : len(STANDARD) * (i + 1)]
        for k in range(len(STANDARD)):
            factors = from_standard([int(k == m) for m in range(len(STANDARD))]).moved(X).entries()
            columns.append([dot(factors, values) for values in zip(*entries, strict=True)])
    rows = [[column[j] for column in columns] for j in range(r.n)]
    port = Port("Y", (r.n, 10 * r.n), "SI", "", "per link: " + ", ".join(STANDARD))
    return r.builder.program(
        "standard_regressor",
        [(port, _flat(rows))],
        "Regressor in the standard parameters.",
        "tau = Y(q, dq, ddq) phi",
        ["Inertias are tensor entries about the origin of the link frame, off-diagonals -integral of x y dm."],
    )


def energy(r: Recording) -> Program:
    """Kinetic and potential energy."""
    chain = r.chain()
    dq = r.joints("dq")
    inertias = r.inertias()
    kinetic = momentum.kinetic_energy(chain, dq, inertias)
    for Ia, rate in zip(r.drive_inertia(), dq, strict=True):
        kinetic = kinetic + Fraction(1, 2) * Ia * (rate * rate)
    potential = momentum.potential_energy(chain, inertias)
    port = Port("E", (2,), "J", "", "kinetic energy, potential energy (up to a constant)")
    return r.builder.program(
        "energy",
        [(port, [kinetic, potential])],
        "Kinetic and potential energy.",
        "E = [dq' M dq / 2, U(q)],  g = dU/dq",
    )


def friction(r: Recording) -> Program:
    """Joint friction torques from the file's coefficients."""
    dq = r.joints("dq")
    torques: list[Any] = []
    for joint, rate in zip(r.model.spec.joints, dq, strict=True):
        spec = joint.friction
        torque: Value = 0
        if spec is not None:
            viscous, coulomb, offset = (rational_float(v) for v in (spec.viscous, spec.coulomb, spec.offset))
            torque = viscous * rate + coulomb * r.builder.sign(rate) + offset
        torques.append(torque)
    port = _torque_port(r, "tau_f", "friction torques, added to the rigid body's")
    return r.builder.program(
        "friction", [(port, torques)], "Joint friction.", "tau_f = fv dq + fc sgn(dq) + offset   (14.11)"
    )


Recorder = Callable[[Recording], Program]

FUNCTIONS: dict[str, tuple[Recorder, ...]] = {
    "forward_kinematics": (forward_kinematics, forward_kinematics_inwards),
    "link_frames": (link_frames,),
    "jacobian": (jacobian,),
    "jacobian_dot_dq": (jacobian_dot_dq,),
    "mass_matrix": (mass_matrix,),
    "coriolis_matrix": (coriolis_matrix,),
    "coriolis": (coriolis(_block_frames), coriolis(_own_frames)),
    "coriolis_transpose": (coriolis_transpose,),
    "gravity": (gravity,),
    "bias": (bias(_block_frames), bias(_own_frames)),
    "inverse_dynamics": (inverse_dynamics_function(_block_frames), inverse_dynamics_function(_own_frames)),
    "inverse_dynamics_derivatives": (inverse_dynamics_derivatives,),
    "forward_dynamics_derivatives": (forward_dynamics_derivatives,),
    "regressor": tuple(
        regressor(columns, frames)
        for columns in (columns_by_axes, columns_passed_down)
        for frames in (_own_frames, _block_frames)
    ),
    "regressor_transpose": (regressor_transpose,),
    "standard_regressor": (standard_regressor,),
    "energy": (energy,),
}
"""Functions recorded from the derivations, in the order of emission, each in one or more equivalent ways."""
