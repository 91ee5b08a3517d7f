"""The regressor: inverse dynamics is linear in the inertial parameters (14.10).

    tau = Y(q, dq, ddq) beta

Column k of Y is the torque caused by parameter k alone. There are two ways to the same columns: pass the wrenches of
all parameters down the chain side by side, or project them, where they arise, on the velocity that a unit rate of each
joint gives the link (the principle of virtual power). The second turns few axes instead of many wrenches.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from rrrgen.derive.algebra.vectors import dot
from rrrgen.derive.recursions.chain import Chain
from rrrgen.derive.recursions.composite import BlockVelocity, velocities
from rrrgen.derive.recursions.inertia import ENTRIES, PseudoInertia
from rrrgen.derive.recursions.kinematics import turn_into_link
from rrrgen.derive.recursions.motion import LinkMotion, forward
from rrrgen.derive.recursions.newton_euler import Wrench, link_wrench, pass_down

Parameter = tuple[int, str]
"""(link index from 0, entry of its pseudo-inertia in the canonical frame)."""


def all_parameters(n: int) -> list[Parameter]:
    """All 10 n parameters, link by link."""
    return [(i, entry) for i in range(n) for entry in ENTRIES]


def regressor(chain: Chain, dq: Sequence[Any], ddq: Sequence[Any], parameters: Sequence[Parameter]) -> list[list[Any]]:
    """Rows of Y (n x len(parameters)) for parameters in the links' canonical frames."""
    columns = columns_passed_down(chain, dq, ddq, [True] * chain.n, parameters)
    return [[column[j] for column in columns] for j in range(chain.n)]


def columns_passed_down(
    chain: Chain, dq: Sequence[Any], ddq: Sequence[Any], own: Sequence[bool], parameters: Sequence[Parameter]
) -> list[list[Any]]:
    """Columns of Y from the wrench of each parameter, passed down the chain."""
    motions = forward(chain, dq, ddq, own)
    columns = []
    for i, entry in parameters:
        wrenches: list[Wrench] = [([0, 0, 0], [0, 0, 0])] * chain.n
        wrenches[i] = unit_wrench(chain, motions, own, (i, entry))
        columns.append(pass_down(chain, own, wrenches))
    return columns


def columns_by_axes(
    chain: Chain, dq: Sequence[Any], ddq: Sequence[Any], own: Sequence[bool], parameters: Sequence[Parameter]
) -> list[list[Any]]:
    """Columns of Y from the virtual power of each parameter's wrench under a unit rate of each joint."""
    motions = forward(chain, dq, ddq, own)
    rows = []
    for j in range(chain.n):
        virtual = velocities(chain, [int(k == j) for k in range(chain.n)])
        rows.append([virtual_power(chain, motions, own, virtual, p) if p[0] >= j else 0 for p in parameters])
    return [list(column) for column in zip(*rows, strict=True)]


def unit_wrench(chain: Chain, motions: Sequence[LinkMotion], own: Sequence[bool], parameter: Parameter) -> Wrench:
    """Wrench on a link whose only parameter different from zero is ``parameter``, which is one."""
    i, entry = parameter
    J = PseudoInertia(**{entry: 1})
    turned = J if own[i] else J.turned(chain.joints[i].c, chain.joints[i].s)
    return link_wrench(motions[i], turned, J.Jxx + J.Jyy)


def virtual_power(
    chain: Chain,
    motions: Sequence[LinkMotion],
    own: Sequence[bool],
    virtual: Sequence[BlockVelocity],
    parameter: Parameter,
) -> Any:
    """Power of the unit wrench of ``parameter`` under virtual velocities (given in the blocks' frames)."""
    i, _ = parameter
    F, N = unit_wrench(chain, motions, own, parameter)
    v, omega = virtual[i].v, virtual[i].omega
    if own[i]:
        v, omega = turn_into_link(chain.joints[i], v), turn_into_link(chain.joints[i], omega)
    return dot(v, F) + dot(omega, N)
