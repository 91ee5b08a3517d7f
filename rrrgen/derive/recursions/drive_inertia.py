"""Drive inertia in the equation of motion: it adds ``sum over k of Ia_k w_k w_k'`` to the mass matrix.

``w_k`` (n,) is the direction of inertia k in joint space (:mod:`rrrgen.robot.model.drives`): a unit vector for a
drive that moves one joint, a row of ``motor_from_joint`` for a coupled one. The added matrix is constant, so Coriolis
and gravity torques do not change. The drive inertias follow the base parameters in beta, and their columns
``w_k (w_k . ddq)`` those of the base parameters in the regressors.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

from rrrgen.derive.recursions.linear_algebra import Matrix, dot
from rrrgen.derive.recursions.link_frames import rational
from rrrgen.program import Value
from rrrgen.program.builder import Number
from rrrgen.robot.model.drives import inertia_terms
from rrrgen.robot.spec import RobotSpec


@dataclass(frozen=True)
class DriveInertia:
    """The drive inertias Ia_k (``values``, kg m^2 or kg) and their ``directions`` w_k in joint space, (n,) each."""

    values: Sequence[Value]
    directions: Sequence[Sequence[Number]]

    def added_to_mass(self, M: Matrix) -> Matrix:
        """Add the drive inertia to the mass matrix ``M`` (n, n) of the links: ``M + sum of Ia_k w_k w_k'``."""
        result = [list(row) for row in M]
        for Ia, w in zip(self.values, self.directions, strict=True):
            moved = [i for i, weight in enumerate(w) if weight]
            for i in moved:
                for j in moved:
                    result[i][j] = result[i][j] + (w[i] * w[j]) * Ia
        return result

    def added_to_torques(self, tau: Sequence[Any], ddq: Sequence[Any]) -> list[Any]:
        """Add the drive inertia to joint torques ``tau`` (n,): ``tau + sum of w_k Ia_k (w_k . ddq)``."""
        result = list(tau)
        for Ia, w in zip(self.values, self.directions, strict=True):
            force = Ia * dot(w, ddq)
            for i, weight in enumerate(w):
                if weight:
                    result[i] = result[i] + weight * force
        return result

    def added_to_momentum(self, p: Sequence[Any], dq: Sequence[Any]) -> list[Any]:
        """Add the drive inertia to the generalized momentum ``p`` (n,): ``p + sum of w_k Ia_k (w_k . dq)``."""
        return self.added_to_torques(p, dq)

    def added_to_energy(self, kinetic: Any, dq: Sequence[Any]) -> Any:
        """Add the drive inertia to the ``kinetic`` energy (J): ``kinetic + sum of Ia_k (w_k . dq)^2 / 2``."""
        for Ia, w in zip(self.values, self.directions, strict=True):
            rate = dot(w, dq)
            kinetic = kinetic + Fraction(1, 2) * Ia * (rate * rate)
        return kinetic


def directions(spec: RobotSpec) -> list[list[Number]]:
    """The directions w_k (n,) of the drive inertias in joint space; empty if the robot file states none."""
    return [[w if type(w) is int else rational(w) for w in term.direction] for term in inertia_terms(spec)]


def inertia_columns(spec: RobotSpec, ddq: Sequence[Any]) -> list[list[Any]]:
    """The columns (n,) of the drive inertias in a regressor: ``w_k (w_k . ddq)``."""
    columns = []
    for w in directions(spec):
        rate = dot(w, ddq)
        columns.append([weight * rate if weight else 0 for weight in w])
    return columns


def virtual_work(spec: RobotSpec, ddq: Sequence[Any], e: Sequence[Any]) -> list[Any]:
    """The products of these columns and a vector ``e`` (n,): ``(w_k . e) (w_k . ddq)``, one per drive inertia."""
    return [dot(w, e) * dot(w, ddq) for w in directions(spec)]
