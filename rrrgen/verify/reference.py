"""What a reference library must answer, and which ones are installed."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from rrrgen.verify.chain import Array, Chain


class Reference(Protocol):
    """Another library's model of the same robot, asked one state (n,) at a time."""

    name: str

    def inverse_dynamics(self, q: Array, dq: Array, ddq: Array) -> Array:
        """tau (n,) with drive inertia."""
        ...

    def mass_matrix(self, q: Array) -> Array:
        """M (n, n) with drive inertia."""
        ...

    def forward_kinematics(self, q: Array) -> Array:
        """The tip (4, 4) in the base frame."""
        ...


class ReferenceUnavailableError(Exception):
    """The library is missing, or cannot represent this robot; the text says which."""


def _pinocchio(chain: Chain, phi: Array) -> Reference:
    from rrrgen.verify.pinocchio_reference import PinocchioReference

    return PinocchioReference(chain, phi)


def _mujoco(chain: Chain, phi: Array) -> Reference:
    from rrrgen.verify.mujoco_reference import MujocoReference

    return MujocoReference(chain, phi)


def _toolbox(chain: Chain, phi: Array) -> Reference:
    from rrrgen.verify.toolbox_reference import ToolboxReference

    return ToolboxReference(chain, phi)


LIBRARIES: dict[str, Callable[[Chain, Array], Reference]] = {
    "Pinocchio": _pinocchio,
    "MuJoCo": _mujoco,
    "Robotics Toolbox": _toolbox,
}
"""Name -> constructor; a constructor raises :class:`ReferenceUnavailableError` when it cannot serve."""
