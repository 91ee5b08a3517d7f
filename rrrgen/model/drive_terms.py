"""The linear terms of a robot's drives: what the file states of inertia and friction, and along which direction.

A term acts along a direction ``w`` (n,) of joint space: with the speed ``s' = w dq`` it adds the generalised force
``w f`` to the joint torques, where f is ``Ia s''`` (inertia), ``fv s'`` (viscous), ``fc sgn(s')`` (Coulomb) or ``off``
(offset). A term of one joint has the unit vector as direction.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Literal

from rrrgen.robotfile.robot_spec import RobotSpec

Kind = Literal["inertia", "viscous", "coulomb", "offset"]
KINDS: tuple[Kind, ...] = ("inertia", "viscous", "coulomb", "offset")
SYMBOLS: dict[Kind, str] = {"inertia": "Ia", "viscous": "fv", "coulomb": "fc", "offset": "off"}


@dataclass(frozen=True)
class DriveTerm:
    """One term: its parameter's name and nominal value, its kind, and its direction ``w`` (n,), exact.

    ``joint`` is the joint (from 0) that the term belongs to.
    """

    name: str
    kind: Kind
    value: float
    direction: tuple[Any, ...]
    joint: int


def drive_terms(spec: RobotSpec) -> tuple[DriveTerm, ...]:
    """The terms of ``spec`` in the order of the identification regressor: kind by kind, joint by joint.

    A field that the file states, 0 included, is a term.
    """
    return tuple(_joint_terms(spec))


def _joint_terms(spec: RobotSpec) -> Iterator[DriveTerm]:
    for kind in KINDS:
        for i, joint in enumerate(spec.joints):
            owner = joint.drive if kind == "inertia" else joint.friction
            value = None if owner is None else getattr(owner, kind)
            if value is not None:
                yield DriveTerm(f"{SYMBOLS[kind]}{i + 1}", kind, float(value), unit_direction(i, spec.n), i)


def unit_direction(joint: int, n: int) -> tuple[int, ...]:
    """The direction of one joint (from 0) of ``n``."""
    return tuple(int(i == joint) for i in range(n))
