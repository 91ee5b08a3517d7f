"""The regressor Y of inverse dynamics, which is linear in the inertial parameters (14.10).

    tau = Y(q, dq, ddq) beta

Column k of Y is the torque caused by parameter k alone. Two methods give the same columns: move the wrench of every
parameter down the chain, or apply the principle of virtual power, where the wrench is multiplied by the velocity that a
unit rate of each joint gives the link. The second method rotates few axes instead of many wrenches.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import sympy as sp

from rrrgen.derive.recursions.kinematics import to_link_frame
from rrrgen.derive.recursions.linear_algebra import dot, is_number
from rrrgen.derive.recursions.link_frames import Chain
from rrrgen.derive.recursions.mass_matrix_and_gravity import BlockVelocity, velocities
from rrrgen.derive.recursions.newton_euler import NO_WRENCH, Wrench, link_wrench, pass_down
from rrrgen.derive.recursions.pseudo_inertia import ENTRIES, PseudoInertia
from rrrgen.derive.recursions.velocities_and_accelerations import LinkMotion, forward

Parameter = tuple[int, str]
"""An inertial parameter: (link index from 0, entry of the link's pseudo-inertia in its canonical frame)."""


@dataclass(frozen=True)
class Dependency:
    """A linear relation: the regressor column of ``parameter`` is a combination of other columns.

    ``combination`` maps the other parameters to their factors; it is empty if the column is zero.
    """

    parameter: Parameter
    combination: dict[Parameter, sp.Expr]


def all_parameters(n: int) -> list[Parameter]:
    """All 10 n inertial parameters in canonical frames, link by link."""
    return [(i, entry) for i in range(n) for entry in ENTRIES]


def regressor(chain: Chain, dq: Sequence[Any], ddq: Sequence[Any], parameters: Sequence[Parameter]) -> list[list[Any]]:
    """The rows of the regressor Y (n, len(parameters)) for parameters in the canonical link frames.

    On a floating base six rows of its wrench stand before those of the joints, as in every function below.
    """
    columns = columns_passed_down(chain, dq, ddq, [True] * chain.n, parameters)
    return [list(row) for row in zip(*columns, strict=True)]


def columns_passed_down(
    chain: Chain, dq: Sequence[Any], ddq: Sequence[Any], in_link_frame: Sequence[bool], parameters: Sequence[Parameter]
) -> list[list[Any]]:
    """The columns of Y, (n,) each: torques of each parameter's inertial wrench, moved joint by joint to the base."""
    motions = forward(chain, dq, ddq, in_link_frame)
    columns = []
    for i, entry in parameters:
        wrenches = [NO_WRENCH] * chain.n
        wrenches[i] = unit_wrench(chain, motions, in_link_frame, (i, entry))
        columns.append(pass_down(chain, in_link_frame, wrenches))
    return columns


def columns_by_axes(
    chain: Chain, dq: Sequence[Any], ddq: Sequence[Any], in_link_frame: Sequence[bool], parameters: Sequence[Parameter]
) -> list[list[Any]]:
    """The columns of Y, (n,) each: entry j is the power of the parameter's wrench at unit rate of joint j alone."""
    motions = forward(chain, dq, ddq, in_link_frame)
    rows = []
    for j in range(6 if chain.base is not None else 0):
        unit = [int(k == j) for k in range(6)]
        virtual = velocities(chain, [0] * len(dq), (unit[:3], unit[3:]))
        rows.append([virtual_power(chain, motions, in_link_frame, virtual, p) for p in parameters])
    for j in range(len(dq)):
        unit = [int(k == j) for k in range(len(dq))]
        virtual, moving = velocities(chain, unit), chain.joint_rates(unit)
        moved = [any(not is_number(moving[i], 0) for i in path) for path in chain.paths]
        rows.append(
            [virtual_power(chain, motions, in_link_frame, virtual, p) if moved[p[0]] else 0 for p in parameters]
        )
    return [list(column) for column in zip(*rows, strict=True)]


def unit_wrench(
    chain: Chain, motions: Sequence[LinkMotion], in_link_frame: Sequence[bool], parameter: Parameter
) -> Wrench:
    """The inertial wrench of a link whose only non-zero inertial parameter is ``parameter`` = 1.

    ``motions`` are those of all links; the wrench is in the frame in which its link is expressed (``in_link_frame``).
    """
    i, entry = parameter
    J = PseudoInertia(**{entry: 1})
    turned = J if in_link_frame[i] else J.rotated_z(chain.joints[i].c, chain.joints[i].s)
    return link_wrench(motions[i], turned, J.Jxx + J.Jyy)


def virtual_power(
    chain: Chain,
    motions: Sequence[LinkMotion],
    in_link_frame: Sequence[bool],
    virtual: Sequence[BlockVelocity],
    parameter: Parameter,
) -> Any:
    """Power of the unit wrench of ``parameter`` under the link velocities ``virtual``, given in block frames."""
    i, _ = parameter
    F, N = unit_wrench(chain, motions, in_link_frame, parameter)
    v, omega = virtual[i].v, virtual[i].omega
    if in_link_frame[i]:
        v, omega = to_link_frame(chain.joints[i], v), to_link_frame(chain.joints[i], omega)
    return dot(v, F) + dot(omega, N)
