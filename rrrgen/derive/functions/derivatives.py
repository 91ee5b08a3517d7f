"""Analytical derivatives of inverse and forward dynamics with respect to positions and velocities.

With ``tau_i = integral of J_i . a dm``, where a is the acceleration of a mass point minus gravity and J_i the velocity
that a unit rate of joint i gives it, ``dr/dq_j = J_j`` and ``d(r'')/dq_j = J_j''``, so that

    dtau_i/dq_j = integral of dJ_i/dq_j . a + J_i . J_j'' dm.

Joint j turns everything beyond it, J_i included: for j <= i the first term is ``-J_i . (z_j x a)``, which cancels all
of J_j'' that depends on the acceleration of the point. What is left is the field

    K_j = z_j'' x rho + 2 z_j' x rho' - z_j x a_j,   rho = r - o_j,   a_j that of the origin o_j,

and with the unit wrench F, N of joint i and its W at joint j (see :mod:`rrrgen.derive.recursions.coriolis`)

    dtau_i/dq_j = z_j'' . N + 2 z_j' . W - (z_j x a_j) . F     (j <= i).

For j > i it is the wrench of K_j on the composite body of joint j, together with that body's inertial wrench turned
about z_j, passed down to joint i. For a prismatic joint j, ``K_j = z_j''`` and only the inertial force's moment turns.

The velocity torques are ``c_i = sum of Gamma_ijk dq_j dq_k`` with Christoffel symbols symmetric in j and k, so
``dtau/d(dq) = 2 C``. For forward dynamics, ``M ddq = tau - c - g`` gives ``d(ddq)/dx = -inv(M) dtau/dx`` at that ddq.
"""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from typing import Any

from rrrgen.derive.algebra.positive_definite import STATUS, factorize
from rrrgen.derive.algebra.vectors import Matrix, Vector, add, cross, dot, flat, rows, scale, turn
from rrrgen.derive.functions.recording import Recorder, Recording
from rrrgen.derive.recursions import composite
from rrrgen.derive.recursions.chain import ChainJoint
from rrrgen.derive.recursions.coriolis import Body, Composition, along_axis, compose, passed_down
from rrrgen.derive.recursions.inertia import PseudoInertia
from rrrgen.derive.recursions.motion import LinkMotion, choose_frames, forward
from rrrgen.derive.recursions.newton_euler import Wrench, composite_wrenches, link_wrenches
from rrrgen.program import Port, Program, Role
from rrrgen.program.builder import replay
from rrrgen.program.differentiate import jacobian

TWICE = 2
"""Velocities of the composite bodies enter doubled: ``2 C`` and ``2 z' x rho'`` are what is asked for."""


def inverse_dynamics_derivatives(r: Recording) -> Program:
    """Joint torques with their derivatives."""
    chain = r.chain()
    dq, ddq = r.joints("dq"), r.joints("ddq")
    inertias, drives = r.inertias(), r.drive_inertia()
    composition = compose(chain, dq, inertias, TWICE)
    tau, dtau_dq = torques_and_slopes(composition, dq, ddq, inertias)
    tau = drives.added_to_torques(tau, ddq)
    ports = [
        (Port("tau", (r.n,), r.torque_unit, "", "joint torques, friction not included", Role.TORQUE), tau),
        (_matrix(r, "dtau_dq", "d tau_i / d q_j for given dq and ddq"), flat(dtau_dq)),
        (_matrix(r, "dtau_dv", "d tau_i / d dq_j"), flat(composition.coriolis_matrix())),
        (
            _matrix(r, "M", "d tau_i / d ddq_j: the mass matrix, drive inertia included"),
            flat(drives.added_to_mass(composition.mass_matrix())),
        ),
    ]
    return r.builder.program(
        "inverse_dynamics_derivatives",
        ports,
        "Joint torques of the rigid body with drive inertia, and their derivatives.",
        "tau = M(q) ddq + c(q, dq) + g(q),  d tau = dtau_dq d q + dtau_dv d dq + M d ddq",
    )


def forward_dynamics_derivatives(r: Recording) -> Program:
    """Joint accelerations with their derivatives."""
    b, chain = r.builder, r.chain()
    dq, tau = r.joints("dq"), r.joints("tau")
    inertias, drives = r.inertias(), r.drive_inertia()
    composition = compose(chain, dq, inertias, TWICE)
    dtau_dv = composition.coriolis_matrix()
    factors = factorize(b, drives.added_to_mass(composition.mass_matrix()))
    inverse = factors.negative_inverse()
    half = [Fraction(1, 2) * rate for rate in dq]
    missing = [
        g + dot(row, half) - t for g, row, t in zip(composite.gravity(chain, inertias), dtau_dv, tau, strict=True)
    ]
    ddq = [dot(row, missing) for row in inverse]
    _, dtau_dq = torques_and_slopes(composition, dq, ddq, inertias)
    return forward_program(r, factors.status, ddq, inverse, dtau_dq, dtau_dv)


def forward_program(
    r: Recording, status: Any, ddq: list[Any], inverse: Matrix, dtau_dq: Matrix, dtau_dv: Matrix
) -> Program:
    """The program of forward dynamics from ``inverse = -inv(M)`` and the derivatives of the torques."""
    unit = " | ".join(part + "/s^2" for part in r.position_unit.split(" | "))
    products = [[[dot(row, column) for column in zip(*D, strict=True)] for row in inverse] for D in (dtau_dq, dtau_dv)]
    meaning = "joint accelerations; zero when the status is not ok"
    accelerations = Port("ddq", (r.n,), unit, "", meaning, Role.ACCELERATION)
    ports = [
        (Port("status", ()), [status]),
        (accelerations, ddq),
        (_matrix(r, "dddq_dq", "d ddq_i / d q_j for given dq and tau"), flat(products[0])),
        (_matrix(r, "dddq_dv", "d ddq_i / d dq_j"), flat(products[1])),
        (_matrix(r, "dddq_dtau", "d ddq_i / d tau_j, the inverse of M"), [-value for value in flat(inverse)]),
    ]
    return r.builder.program(
        "forward_dynamics_derivatives",
        ports,
        "Joint accelerations of the rigid body with drive inertia, and their derivatives.",
        "M ddq = tau - c - g,  dddq_dtau = inv(M),  dddq_dq = -inv(M) dtau_dq,  dddq_dv = -inv(M) dtau_dv",
        ["All outputs are zero when M is not positive definite (a singular or unphysical set of parameters)."],
        STATUS,
    )


def differentiated(inverse_dynamics: Program, like: Program) -> Program:
    """The derivatives by the chain rule on a program of inverse dynamics; best where that is a short closed form."""
    found = jacobian(inverse_dynamics, "tau", ("q", "dq", "ddq"))
    return found.described(
        name=like.name, outputs=like.outputs, summary=like.summary, formula=like.formula, notes=like.notes
    )


def from_inverse_dynamics(r: Recording, derivatives: Program) -> Program:
    """Forward dynamics from a program of the derivatives of inverse dynamics, at ``ddq = 0`` and at the solution."""
    _, _, tau = (r.joints(name) for name in ("q", "dq", "tau"))
    r.beta()
    r.drive_inertia()

    def at(ddq: list[Any]) -> list[list[Any]]:
        return replay(derivatives, r.builder, r.inputs_of(derivatives, {Role.ACCELERATION: ddq}))

    bias, _, _, M = at([0] * r.n)
    factors = factorize(r.builder, rows(r.n, M))
    inverse = factors.negative_inverse()
    missing = [b - t for b, t in zip(bias, tau, strict=True)]
    ddq = [dot(row, missing) for row in inverse]
    _, dtau_dq, dtau_dv, _ = at(ddq)
    return forward_program(r, factors.status, ddq, inverse, rows(r.n, dtau_dq), rows(r.n, dtau_dv))


def torques_and_slopes(
    composition: Composition, dq: Sequence[Any], ddq: Sequence[Any], inertias: Sequence[PseudoInertia]
) -> tuple[list[Any], Matrix]:
    """tau without drive inertia, and dtau/dq (n x n); the composition's velocities are doubled."""
    chain, n = composition.chain, composition.chain.n
    own = choose_frames(chain, range(n))
    motions = forward(chain, dq, ddq, own)
    wrenches = composite_wrenches(chain, own, link_wrenches(chain, motions, inertias))
    axes = [velocity.carrier for velocity in composite.velocities(chain, dq)]
    rates = [[y, -x, 0] for x, y, _ in axes]
    lifts = [[-motion.a_block[1], motion.a_block[0], 0] for motion in motions]
    slopes: Matrix = [[0] * n for _ in range(n)]
    for j, (joint, body) in enumerate(zip(chain.joints, composition.bodies, strict=True)):
        total = _in_block(joint, motions[j], wrenches[j])
        wrench = _slope_wrench(joint.revolute, body, rates[j], motions[j].axis, lifts[j], total)
        for i, value in enumerate(passed_down(chain, j, *wrench)):
            slopes[i][j] = value
        for i, reach in enumerate(composition.reaches[j][:-1]):
            axis = motions[i].axis
            if chain.joints[i].revolute:
                slopes[j][i] = (dot(axis, reach.N) + dot(rates[i], reach.W)) - dot(lifts[i], reach.F)
            else:
                slopes[j][i] = dot(axis, reach.F)
    return [along_axis(chain, i, *wrench) for i, wrench in enumerate(wrenches)], slopes


def _in_block(joint: ChainJoint, motion: LinkMotion, wrench: Wrench) -> Wrench:
    """A wrench in the link's frame of expression, in the block's frame."""
    F, N = wrench
    return (turn(joint.c, joint.s, F), turn(joint.c, joint.s, N)) if motion.own else wrench


def _slope_wrench(revolute: bool, body: Body, zdot: Vector, axis: Vector, lift: Vector, total: Wrench) -> Wrench:
    """Wrench of K_j on the composite body and the turning of its inertial wrench ``total`` about z_j."""
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


def _matrix(r: Recording, name: str, meaning: str) -> Port:
    return Port(name, (r.n, r.n), "SI", "", meaning)


FUNCTIONS: dict[str, tuple[Recorder, ...]] = {
    "inverse_dynamics_derivatives": (inverse_dynamics_derivatives,),
    "forward_dynamics_derivatives": (forward_dynamics_derivatives,),
}
