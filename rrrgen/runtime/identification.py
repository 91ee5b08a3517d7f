"""The columns that drives and friction add to the base regressor."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rrrgen.spec.robot_spec import JointSpec, RobotSpec

Array = NDArray[Any]


@dataclass(frozen=True)
class IdentificationColumns:
    """Which joints (from 0) have which term: tau_i = ... + Ia ddq_i + fv dq_i + fc sgn(dq_i) + off."""

    terms: tuple[tuple[str, int, float], ...]  # kind, joint, nominal value

    @classmethod
    def of(cls, spec: RobotSpec) -> IdentificationColumns:
        """What the robot file asks for: a field that is given, 0 included, adds its column."""
        rows = [(kind, joint, _value(kind, each)) for kind in _KINDS for joint, each in enumerate(spec.joints)]
        return cls(tuple((kind, joint, value) for kind, joint, value in rows if value is not None))

    @property
    def names(self) -> tuple[str, ...]:
        """Ia1, fv2, ...: kind and joint number from 1."""
        return tuple(f"{kind}{joint + 1}" for kind, joint, _ in self.terms)

    @property
    def nominal(self) -> Array:
        """The values of the robot file."""
        return np.array([value for _, _, value in self.terms], dtype=float)

    def appended(self, Y: Array, dq: Array, ddq: Array) -> Array:
        """``Y`` (..., n, b) with the columns at its right, (..., n, b + extra)."""
        b = Y.shape[-1]
        wide = np.zeros((*Y.shape[:-1], b + len(self.terms)), dtype=Y.dtype)
        wide[..., :b] = Y
        for column, (kind, joint, _) in enumerate(self.terms, start=b):
            wide[..., joint, column] = _column(kind, dq[..., joint], ddq[..., joint])
        return wide


_KINDS = ("Ia", "fv", "fc", "off")


def _value(kind: str, joint: JointSpec) -> float | None:
    if kind == "Ia":
        return joint.drive.inertia if joint.drive else None
    field = {"fv": "viscous", "fc": "coulomb", "off": "offset"}[kind]
    return getattr(joint.friction, field) if joint.friction else None


def _column(kind: str, dq: Array, ddq: Array) -> Any:
    match kind:
        case "Ia":
            return ddq
        case "fv":
            return dq
        case "fc":
            return np.sign(dq)
        case _:
            return 1.0
