"""The reference libraries, each imported only when it is used."""

from __future__ import annotations

from collections.abc import Callable

from rrrgen.verify.references.numeric_robot import Array, Chain
from rrrgen.verify.references.reference import Reference


def _pinocchio(chain: Chain, phi: Array) -> Reference:
    from rrrgen.verify.references.pinocchio_reference import PinocchioReference

    return PinocchioReference(chain, phi)


def _mujoco(chain: Chain, phi: Array) -> Reference:
    from rrrgen.verify.references.mujoco_reference import MujocoReference

    return MujocoReference(chain, phi)


def _toolbox(chain: Chain, phi: Array) -> Reference:
    from rrrgen.verify.references.toolbox_reference import ToolboxReference

    return ToolboxReference(chain, phi)


LIBRARIES: dict[str, Callable[[Chain, Array], Reference]] = {
    "Pinocchio": _pinocchio,
    "MuJoCo": _mujoco,
    "Robotics Toolbox": _toolbox,
}
"""Constructors of the references by name of the library; each raises ReferenceUnavailableError if the library is
missing or cannot model the robot."""
