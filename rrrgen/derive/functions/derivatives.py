"""Analytical derivatives of inverse and forward dynamics with respect to positions and velocities.

Write ``tau_i = integral of J_i . a dm`` with a the acceleration of a mass point minus gravity and J_i the velocity of
the point for a unit rate of joint i. Since ``dr/dq_j = J_j`` and ``d(r'')/dq_j = J_j''``,

    dtau_i/dq_j = integral of dJ_i/dq_j . a + J_i . J_j'' dm.

Joint j rotates everything beyond it, J_i included: for j <= i the first term is ``-J_i . (z_j x a)``, which cancels the
part of J_j'' that depends on the acceleration of the point. The remainder is the field

    K_j = z_j'' x rho + 2 z_j' x rho' - z_j x a_j,   rho = r - o_j,   a_j that of the origin o_j,

and with the unit wrench F, N of joint i and its vector W, both at joint j (:mod:`rrrgen.derive.recursions.coriolis`),

    dtau_i/dq_j = z_j'' . N + 2 z_j' . W - (z_j x a_j) . F     (j <= i).

For j > i it is the wrench of K_j on the composite body of joint j plus the inertial wrench of that body rotated about
z_j, both transmitted to joint i. For a prismatic joint j, ``K_j = z_j''``, and of the inertial wrench only the moment
of its force changes.

The Coriolis torques are ``c_i = sum of Gamma_ijk dq_j dq_k`` with Christoffel symbols symmetric in j and k, hence
``dtau/d(dq) = 2 C``. For forward dynamics, ``M ddq = tau - c - g`` gives ``d(ddq)/dx = -inv(M) dtau/dx`` at that ddq.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

from rrrgen.derive.functions.recording import FunctionBuilder
from rrrgen.derive.recursions import mass_matrix_and_gravity as composite
from rrrgen.derive.recursions.coriolis import CompositeBody, Composition, compose, joint_force, passed_down, turning
from rrrgen.derive.recursions.linear_algebra import (
    Matrix,
    Vector,
    add,
    cross,
    dot,
    factorize,
    flat,
    rotate_z,
    rows,
    scale,
    status_at,
)
from rrrgen.derive.recursions.link_frames import ChainJoint
from rrrgen.derive.recursions.newton_euler import Wrench, composite_wrenches, link_wrenches
from rrrgen.derive.recursions.pseudo_inertia import PseudoInertia
from rrrgen.derive.recursions.velocities_and_accelerations import LinkMotion, choose_frames, forward
from rrrgen.program import Port, Program, Role
from rrrgen.program.builder import replay
from rrrgen.program.differentiation import jacobian

TWICE = 2
"""Factor by which the velocities of composite bodies are multiplied: the derivatives contain ``2 C`` and
``2 z' x rho'``."""


def inverse_dynamics_derivatives(r: FunctionBuilder) -> Program:
    """Record the joint torques tau and their derivatives dtau/dq, dtau/d(dq) and M, (n, n) each, in SI units."""
    chain = r.chain_in_gravity("dq", "ddq")
    dq, ddq = r.joints("dq"), r.joints("ddq")
    inertias, drives = r.inertias(), r.drive_inertia()
    composition = compose(chain, dq, inertias, TWICE)
    tau, dtau_dq = torques_and_derivatives(composition, dq, ddq, inertias)
    results = [
        drives.added_to_torques(tau, ddq),
        flat(dtau_dq),
        flat(composition.coriolis_matrix()),
        flat(drives.added_to_mass(composition.mass_matrix())),
    ]
    return r.builder.program(
        "inverse_dynamics_derivatives", list(zip(_derivative_ports(r), results, strict=True)), SUMMARY, FORMULA
    )


def _derivative_ports(r: FunctionBuilder) -> tuple[Port, ...]:
    """The outputs of ``inverse_dynamics_derivatives``."""
    return (
        Port("tau", (r.n,), r.torque_unit, "", "joint torques, friction not included", Role.TORQUE),
        _matrix(r, "dtau_dq", "d tau_i / d q_j for given dq and ddq"),
        _matrix(r, "dtau_dv", "d tau_i / d dq_j"),
        _matrix(r, "M", "d tau_i / d ddq_j: the mass matrix, drive inertia included"),
    )


SUMMARY = "Joint torques of the rigid body with drive inertia, and their derivatives."
FORMULA = "tau = M(q) ddq + c(q, dq) + g(q),  d tau = dtau_dq d q + dtau_dv d dq + M d ddq"


def forward_dynamics_derivatives(r: FunctionBuilder) -> Program:
    """Record the joint accelerations ddq and their derivatives by q, dq and tau, (n, n) each, in SI units."""
    b, chain = r.builder, r.chain_in_gravity("dq", "tau")
    dq, tau = r.joints("dq"), r.joints("tau")
    inertias, drives = r.inertias(), r.drive_inertia()
    composition = compose(chain, dq, inertias, TWICE)
    dtau_dv = composition.coriolis_matrix()
    factors = factorize(b, drives.added_to_mass(composition.mass_matrix()), tips_first=r.branches)
    inverse = factors.negative_inverse()
    half = [Fraction(1, 2) * rate for rate in dq]
    missing = [
        g + dot(row, half) - t for g, row, t in zip(composite.gravity(chain, inertias), dtau_dv, tau, strict=True)
    ]
    ddq = [dot(row, missing) for row in inverse]
    _, dtau_dq = torques_and_derivatives(composition, dq, ddq, inertias)
    return forward_program(r, factors.status, ddq, inverse, dtau_dq, dtau_dv)


def forward_program(
    r: FunctionBuilder, status: Any, ddq: list[Any], inverse: Matrix, dtau_dq: Matrix, dtau_dv: Matrix
) -> Program:
    """Finish the program ``forward_dynamics_derivatives``, whose outputs are ddq, its derivatives and the status.

    ``inverse`` is -inv(M), ``dtau_dq`` and ``dtau_dv`` are the derivatives of inverse dynamics at ``ddq``, (n, n) each.
    """
    unit = " | ".join(part + "/s^2" for part in r.position_unit.split(" | "))
    products = [[[dot(row, column) for column in zip(*D, strict=True)] for row in inverse] for D in (dtau_dq, dtau_dv)]
    meaning = "joint accelerations; zero when the status is not ok"
    accelerations = Port("ddq", (r.n,), unit, "", meaning, Role.ACCELERATION)
    ports = [
        (accelerations, ddq),
        (_matrix(r, "dddq_dq", "d ddq_i / d q_j for given dq and tau"), flat(products[0])),
        (_matrix(r, "dddq_dv", "d ddq_i / d dq_j"), flat(products[1])),
        (_matrix(r, "dddq_dtau", "d ddq_i / d tau_j, the inverse of M"), [-value for value in flat(inverse)]),
        (Port("status", (), "1"), [status]),
    ]
    return r.builder.program(
        "forward_dynamics_derivatives",
        ports,
        "Joint accelerations of the rigid body with drive inertia, and their derivatives.",
        "M ddq = tau - c - g,  dddq_dtau = inv(M),  dddq_dq = -inv(M) dtau_dq,  dddq_dv = -inv(M) dtau_dv",
        ["All outputs are zero when M is not positive definite (a singular or unphysical set of parameters)."],
        status_at(len(ports) - 1),
    )


def differentiate_inverse_dynamics(r: FunctionBuilder, inverse_dynamics: Program) -> Program:
    """Derive ``inverse_dynamics_derivatives`` by automatic differentiation of a program of inverse dynamics.

    Cheaper than the recursion if that program is short.
    """
    outputs = _derivative_ports(r)
    if inverse_dynamics.takes(Role.LOOPS):
        return _through_newton(r, jacobian(inverse_dynamics, "tau", ("q", "loop_q", "dq", "ddq")), outputs)
    derivatives = jacobian(inverse_dynamics, "tau", ("q", "dq", "ddq"))
    return derivatives.with_fields(
        name="inverse_dynamics_derivatives", outputs=outputs, summary=SUMMARY, formula=FORMULA, notes=()
    )


def _through_newton(r: FunctionBuilder, derivatives: Program, outputs: Sequence[Port]) -> Program:
    """Add the motion ``loop_q' = W q'`` of the passive joints to derivatives by q that hold them."""
    loops = r.chain_in_gravity("dq", "ddq").loops
    assert loops is not None
    r.joints("dq"), r.joints("ddq")
    if derivatives.takes(Role.BASE_PARAMETERS):
        r.beta()
    tau, by_q, by_loops, by_dq, by_ddq = replay(derivatives, r.builder, r.inputs_of(derivatives))
    columns = list(zip(*loops.W, strict=True))
    passive = len(loops.W)
    dtau_dq = [
        by_q[i * r.n + j] + dot(by_loops[i * passive : (i + 1) * passive], columns[j])
        for i in range(r.n)
        for j in range(r.n)
    ]
    results = list(zip(outputs, (tau, dtau_dq, by_dq, by_ddq), strict=True))
    return r.builder.program("inverse_dynamics_derivatives", results, SUMMARY, FORMULA)


def from_inverse_dynamics(r: FunctionBuilder, derivatives: Program) -> Program:
    """Derive ``forward_dynamics_derivatives`` from a program of ``inverse_dynamics_derivatives``.

    That program is evaluated at ddq = 0, for M and the bias torques, and at the solution ddq, for the derivatives.
    """
    _, _, tau = (r.joints(name) for name in ("q", "dq", "tau"))
    if derivatives.takes(Role.GRAVITY):
        r.gravity()
    if derivatives.takes(Role.BASE_PARAMETERS):
        r.beta()

    def at(ddq: list[Any]) -> list[list[Any]]:
        return replay(derivatives, r.builder, r.inputs_of(derivatives, {Role.ACCELERATION: ddq}))

    bias, _, _, M = at([0] * r.n)
    factors = factorize(r.builder, rows(r.n, M), tips_first=r.branches)
    inverse = factors.negative_inverse()
    missing = [b - t for b, t in zip(bias, tau, strict=True)]
    ddq = [dot(row, missing) for row in inverse]
    _, dtau_dq, dtau_dv, _ = at(ddq)
    return forward_program(r, factors.status, ddq, inverse, rows(r.n, dtau_dq), rows(r.n, dtau_dv))


def torques_and_derivatives(
    composition: Composition, dq: Sequence[Any], ddq: Sequence[Any], inertias: Sequence[PseudoInertia]
) -> tuple[list[Any], Matrix]:
    """The joint torques tau (n,) and dtau/dq (n, n), both without drive inertia.

    ``composition`` must have been composed with the velocities doubled (factor 2).
    """
    chain = composition.chain
    derivatives = over_all_joints(composition, dq, ddq, inertias)
    torques = [joint_force(chain, i, *wrench) for i, wrench in enumerate(derivatives.wrenches)]
    return chain.forces(torques), chain.form(derivatives.dtau_dq)


@dataclass(frozen=True)
class JointDerivatives:
    """The inertial wrench beyond every joint, and the derivatives with respect to the positions of all joints.

    ``wrenches`` are those of the composite bodies, each about the origin of its joint, in the frame in which its link
    is expressed. ``dtau_dq`` (n, n) has a row and a column for every joint; column j of the derivative of the wrench at
    the first joint of the branch, force first, is ``on_base[j]`` (6,), in the frame of the block of that joint.
    """

    wrenches: list[Wrench]
    dtau_dq: Matrix
    on_base: list[Vector]


def over_all_joints(
    composition: Composition, dq: Sequence[Any], ddq: Sequence[Any], inertias: Sequence[PseudoInertia]
) -> JointDerivatives:
    """Wrenches and derivatives over all joints of a chain whose base rests or moves as the chain says.

    ``composition`` must have been composed with the velocities doubled (factor 2).
    """
    chain, n = composition.chain, composition.chain.n
    in_link_frame = choose_frames(chain, range(n))
    motions = forward(chain, dq, ddq, in_link_frame)
    wrenches = composite_wrenches(chain, in_link_frame, link_wrenches(chain, motions, inertias))
    axes = [velocity.block_omega for velocity in composite.velocities(chain, dq, turning(chain))]
    rates = [[y, -x, 0] for x, y, _ in axes]
    lifts = [[-motion.a_block[1], motion.a_block[0], 0] for motion in motions]
    dtau_dq: Matrix = [[0] * n for _ in range(n)]
    on_base = []
    for j, (joint, body) in enumerate(zip(chain.joints, composition.bodies, strict=True)):
        total = _in_block(joint, motions[j], wrenches[j])
        wrench = _derivative_wrench(joint.revolute, body, rates[j], motions[j].axis, lifts[j], total)
        forces, at_base = passed_down(chain, j, *wrench)
        on_base.append(at_base)
        for i, value in forces.items():
            dtau_dq[i][j] = value
        for i, shifted in composition.shifted_wrenches[j].items():
            if i == j:
                continue
            axis = motions[i].axis
            if chain.joints[i].revolute:
                dtau_dq[j][i] = (dot(axis, shifted.N) + dot(rates[i], shifted.W)) - dot(lifts[i], shifted.F)
            else:
                dtau_dq[j][i] = dot(axis, shifted.F)
    return JointDerivatives(wrenches, dtau_dq, on_base)


def _in_block(joint: ChainJoint, motion: LinkMotion, wrench: Wrench) -> Wrench:
    """Convert the wrench of a link from the frame in which its ``motion`` is expressed to the frame of its block."""
    F, N = wrench
    return (rotate_z(joint.c, joint.s, F), rotate_z(joint.c, joint.s, N)) if motion.in_link_frame else wrench


def _derivative_wrench(
    revolute: bool, body: CompositeBody, zdot: Vector, axis: Vector, lift: Vector, total: Wrench
) -> Wrench:
    """Derivative by q_j of the inertial wrench of all bodies beyond joint j, at the origin of joint j.

    It is the wrench of the acceleration field K_j (see the module) acting on the mass of the composite ``body``, plus
    the change of its inertial wrench ``total`` as the joint turns or moves it. ``zdot`` (3,) is z_j', ``axis`` (3,) is
    z_j'', ``lift`` (3,) is z_j x a_j.
    """
    J, A, P = body.J, body.dyad.A, body.dyad.P
    h = [J.hx, J.hy, J.hz]
    F, N = total
    if not revolute:
        return scale(J.m, axis), add([-F[1], F[0], 0], cross(h, axis))
    x, y, _ = zdot
    bending = [
        (J.Jyy + J.Jzz) * axis[0] - J.Jxy * axis[1] - J.Jxz * axis[2],
        (J.Jxx + J.Jzz) * axis[1] - J.Jxy * axis[0] - J.Jyz * axis[2],
        (J.Jxx + J.Jyy) * axis[2] - J.Jxz * axis[0] - J.Jyz * axis[1],
    ]
    moving = [
        (A[1][1] + A[2][2]) * x - A[0][1] * y,
        (A[0][0] + A[2][2]) * y - A[1][0] * x,
        -(A[2][0] * x + A[2][1] * y),
    ]
    force = add(add(cross(axis, h), cross(zdot, P)), scale(-J.m, lift))
    moment = add(add(bending, moving), scale(-1, cross(h, lift)))
    return add([-F[1], F[0], 0], force), add([-N[1], N[0], 0], moment)


def _matrix(r: FunctionBuilder, name: str, meaning: str) -> Port:
    return Port(name, (r.n, r.n), "SI", "", meaning)
