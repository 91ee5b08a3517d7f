"""Recorder of the derivatives of inverse dynamics on a floating base.

The joint columns are those of :mod:`rrrgen.derive.functions.derivatives`, whose composite bodies now turn with the base
too, with the wrench of every column passed down to the base. A change of the pose of the base is a translation and a
rotation xi, both in base axes: the orientation R becomes ``R exp([xi]x)``, where the twist in base axes, its rates and
q stay. Only the weight then changes, ``d(R' g) = R' g x d xi``. Write r for a point of the robot from the base origin,
in base axes, rho' for its velocity relative to the origin, and J_i for its velocity at unit rate of joint i. Its
acceleration minus gravity is

    a + alpha x r + ...,   a = dv/dt + omega x v - R' g,

and changes with the coordinates of the base by the fields

    e_k x R' g                                          (xi_k)
    omega x e_k                                         (v_k)
    2 e_k x rho' + (omega x e_k) x r + e_k x v          (omega_k),

the last from the Jacobi identity, with ``2 e_k x rho'`` as in the Coriolis matrix. Over the whole robot these need only
mass m, first moments h, second moments and the dyad A of the composite body of the base; the torque of joint i follows
from its unit wrench F, N and its vector W (:mod:`rrrgen.derive.recursions.coriolis`), moved to the base origin:

    dtau_i/dxi = R' g x F,   dtau_i/dv = F x omega,   dtau_i/domega = 2 W + N x omega + v x F.
"""

from __future__ import annotations

from rrrgen.derive.functions.derivatives import TWICE, over_all_joints
from rrrgen.derive.functions.dynamics import torque_port
from rrrgen.derive.functions.floating_base import (
    EQUATION,
    NO_UNIT,
    STATUS,
    in_base_axes,
    moving_chain,
    status_of,
    wrench_port,
)
from rrrgen.derive.functions.recording import FunctionBuilder
from rrrgen.derive.recursions.coriolis import CompositeBody, Composition, compose, joint_force
from rrrgen.derive.recursions.linear_algebra import Matrix, Vector, add, cross, flat, scale, times, transpose
from rrrgen.program import Port, Program, Status

AXES: Matrix = [[1, 0, 0], [0, 1, 0], [0, 0, 1]]


def inverse_dynamics_derivatives(r: FunctionBuilder) -> Program:
    """Record wrench (6,), tau (n,), and the derivatives of f = [wrench; tau], (6 + n, 6 + n) each.

    They are those by the pose of the base and q, by the twist and dq, and by twist_rate and ddq, which is M.
    """
    chain = moving_chain(r, "dq", "ddq", accelerated=True)
    dq, ddq, twist = r.joints("dq"), r.joints("ddq"), r.on_base("twist")
    inertias, drives = r.inertias(), r.drive_inertia()
    composition = compose(chain, dq, inertias, TWICE)
    derivatives = over_all_joints(composition, dq, ddq, inertias)
    force, moment = derivatives.wrenches[0]
    tau = chain.forces([joint_force(chain, i, *wrench) for i, wrench in enumerate(derivatives.wrenches)])
    rates, of_rates = composition.forces_of_rates()
    base = _BaseColumns(composition, in_base_axes(r.on_base("orientation"), chain.gravity), twist[:3], twist[3:])
    matrices = [
        _assemble_blocks(composition, base.pose(), derivatives.on_base, derivatives.dtau_dq),
        _assemble_blocks(composition, base.twist(), of_rates, rates),
    ]
    M = _assemble_blocks(composition, base.acceleration(), *_unit_accelerations(composition))
    joints = drives.added_to_mass([row[6:] for row in M[6:]])
    matrices.append(M[:6] + [[*row[:6], *joint_row] for row, joint_row in zip(M[6:], joints, strict=True)])
    results = [[*force, *moment], drives.added_to_torques(tau, ddq), *map(flat, matrices), [status_of(r)]]
    ports = _ports(r)
    return r.builder.program(
        "floating_inverse_dynamics_derivatives",
        list(zip(ports, results, strict=True)),
        "Wrench on the floating base and joint torques, and their derivatives.",
        f"f = {EQUATION},  d f = df_dq [d x; d xi; d q] + df_dv d [twist; dq] + M d [twist_rate; ddq]",
        ["d x and d xi move and turn the base along and about its own axes: R becomes R exp([xi]x)."],
        Status(len(ports) - 1, (NO_UNIT,)),
    )


def _ports(r: FunctionBuilder) -> list[Port]:
    shape = (6 + r.n, 6 + r.n)
    return [
        wrench_port(),
        torque_port(r, "tau", "joint torques, friction not included"),
        Port("df_dq", shape, "SI", "", "d [wrench; tau] by translation (zero) and rotation of the base in its axes, q"),
        Port("df_dv", shape, "SI", "", "d [wrench; tau] by twist and dq"),
        Port("M", shape, "SI", "", "d [wrench; tau] by twist_rate and ddq: the mass matrix, drive inertia included"),
        STATUS,
    ]


def _unit_accelerations(composition: Composition) -> tuple[list[Vector], Matrix]:
    """The wrench (6,) of unit acceleration of each joint on the base, and the torques (n, n) over all joints."""
    chain = composition.chain
    forces: Matrix = [[0] * chain.n for _ in range(chain.n)]
    for j, row in enumerate(composition.shifted_wrenches):
        for i, shifted in row.items():
            forces[i][j] = forces[j][i] = joint_force(chain, i, shifted.F, shifted.N)
    return [[*row[0].F, *row[0].N] for row in composition.shifted_wrenches], forces


def _assemble_blocks(
    composition: Composition, base: tuple[Matrix, list[Vector]], on_base: list[Vector], over_joints: Matrix
) -> Matrix:
    """The matrix (6 + n, 6 + n) of its blocks.

    ``base`` holds the columns of the base: their wrenches, as rows (6, 6), and for every joint the six torques that
    they cause. ``on_base`` are the wrenches (6,) of the columns of all joints, ``over_joints`` their torques.
    """
    chain, (wrenches, torques) = composition.chain, base
    across = [chain.forces(row) for row in zip(*on_base, strict=True)]
    below = [chain.forces(column) for column in zip(*torques, strict=True)]
    joints = chain.form(over_joints)
    upper = [[*row, *beside] for row, beside in zip(transpose(wrenches), across, strict=True)]
    return upper + [[*(column[k] for column in below), *row] for k, row in enumerate(joints)]


class _BaseColumns:
    """The columns of the base: the wrenches (6, 6) of its coordinates, one per row, and the torques (6,) per joint."""

    def __init__(self, composition: Composition, weight: Vector, v: Vector, omega: Vector) -> None:
        self._body: CompositeBody = composition.bodies[0]
        self._wrenches = [row[0] for row in composition.shifted_wrenches]
        self._weight, self._v, self._omega = weight, v, omega
        J = self._body.J
        self._h = [J.hx, J.hy, J.hz]
        self._tensor = [
            [J.Jyy + J.Jzz, -J.Jxy, -J.Jxz],
            [-J.Jxy, J.Jxx + J.Jzz, -J.Jyz],
            [-J.Jxz, -J.Jyz, J.Jxx + J.Jyy],
        ]

    def _linear(self, a: Vector) -> Vector:
        """The wrench (6,) of the acceleration ``a`` (3,) of all points."""
        return [*scale(self._body.J.m, a), *cross(self._h, a)]

    def _angular(self, alpha: Vector) -> Vector:
        """The wrench (6,) of the field ``alpha x r``."""
        return [*cross(alpha, self._h), *times(self._tensor, alpha)]

    def _spinning(self, k: int) -> Vector:
        """The wrench (6,) of the field ``2 e_k x rho'``; the dyad has the velocities doubled."""
        A, P = self._body.dyad.A, self._body.dyad.P
        trace = A[0][0] + A[1][1] + A[2][2]
        return [*cross(AXES[k], P), *[(trace if i == k else 0) - A[i][k] for i in range(3)]]

    def pose(self) -> tuple[Matrix, list[Vector]]:
        """Translation and rotation of the base."""
        wrenches = [[0] * 6] * 3 + [self._linear(cross(axis, self._weight)) for axis in AXES]
        return wrenches, [[0, 0, 0, *cross(self._weight, wrench.F)] for wrench in self._wrenches]

    def twist(self) -> tuple[Matrix, list[Vector]]:
        """The linear and the angular velocity."""
        moved = [self._linear(cross(self._omega, axis)) for axis in AXES]
        turned = [
            add(
                add(self._spinning(k), self._angular(cross(self._omega, axis))),
                self._linear(cross(axis, self._v)),
            )
            for k, axis in enumerate(AXES)
        ]
        torques = [
            [
                *cross(wrench.F, self._omega),
                *add(add(wrench.W, cross(wrench.N, self._omega)), cross(self._v, wrench.F)),
            ]
            for wrench in self._wrenches
        ]
        return moved + turned, torques

    def acceleration(self) -> tuple[Matrix, list[Vector]]:
        """The rates of the components of the twist."""
        wrenches = [self._linear(axis) for axis in AXES] + [self._angular(axis) for axis in AXES]
        return wrenches, [[*wrench.F, *wrench.N] for wrench in self._wrenches]
