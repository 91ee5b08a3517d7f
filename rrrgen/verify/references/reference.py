"""The interface of a reference library."""

from __future__ import annotations

from typing import Protocol

from rrrgen.verify.references.numeric_robot import Array


class Reference(Protocol):
    """Interface of a reference: the same robot in another library, evaluated at one state (n,) at a time."""

    name: str

    def inverse_dynamics(self, q: Array, dq: Array, ddq: Array) -> Array:
        """The joint torques tau (n,), with drive inertia and without friction."""
        ...

    def mass_matrix(self, q: Array) -> Array:
        """The mass matrix M (n, n), with drive inertia."""
        ...

    def forward_kinematics(self, q: Array) -> Array:
        """The pose (4, 4) of the tip in the base frame."""
        ...


class ReferenceUnavailableError(Exception):
    """Raised if a reference library is not installed or cannot represent a robot; the text says which."""

    @classmethod
    def at_import(cls, error: ImportError, package: str) -> ReferenceUnavailableError:
        """The error for a failed import of ``package``; its text says whether it is missing or broken."""
        if isinstance(error, ModuleNotFoundError):
            return cls(f"not installed (pip install {package}): {error}")
        return cls(f"installed, but its import fails: {error}")
