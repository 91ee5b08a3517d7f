"""The regressor: inverse dynamics is linear in the inertial parameters (14.10).

    tau = Y(q, dq, ddq) beta

Column k of Y is the torque caused by parameter k alone. The wrench of a link is linear in its ten parameters, so the
columns of all its parameters are passed down the chain side by side.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from rrrgen.derive.chain import Chain
from rrrgen.derive.inertia import ENTRIES, PseudoInertia
from rrrgen.derive.motion import LinkMotion, forward
from rrrgen.derive.newton_euler import link_wrench, pass_down

Parameter = tuple[int, str]
"""(link index from 0, entry of its pseudo-inertia in the canonical frame)."""


def all_parameters(n: int) -> list[Parameter]:
    """All 10 n parameters, link by link."""
    return [(i, entry) for i in range(n) for entry in ENTRIES]


def regressor(chain: Chain, dq: Sequence[Any], ddq: Sequence[Any], parameters: Sequence[Parameter]) -> list[list[Any]]:
    """Rows of Y (n x len(parameters)) for parameters in the links' canonical frames."""
    own = [True] * chain.n
    motions = forward(chain, dq, ddq, own)
    columns = [unit_torques(chain, motions, own, i, entry) for i, entry in parameters]
    return [[column[j] for column in columns] for j in range(chain.n)]


def unit_torques(chain: Chain, motions: Sequence[LinkMotion], own: Sequence[bool], i: int, entry: str) -> list[Any]:
    """Torques of all joints when parameter ``entry`` of link i is one and every other parameter is zero."""
    nothing = ([0, 0, 0], [0, 0, 0])
    wrenches = [nothing] * chain.n
    wrenches[i] = link_wrench(motions[i], PseudoInertia(**{entry: 1}))
    return pass_down(chain, own, wrenches)
