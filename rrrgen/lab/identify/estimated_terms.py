"""The choice of parameters to estimate: base parameters, and linear drive terms at chosen joints.

The drive terms are those of :mod:`rrrgen.robot.model.drive_terms`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

from rrrgen.base.errors import InputError
from rrrgen.robot.model.drive_terms import KINDS, SYMBOLS, drive_terms, unit
from rrrgen.robot.model.drive_terms import Kind as DriveKind

Kind = Literal["rigid", "law"] | DriveKind


@dataclass(frozen=True)
class Column:
    """One column of the identification regressor: name, kind and, for a drive term, direction ``w`` (n,).

    A ``parameter`` of a friction law, of that name without its joint, also has its ``unit`` at a revolute joint and its
    ``meaning``; it is ``bounded`` if it must not be negative.
    """

    name: str
    kind: Kind
    direction: tuple[float, ...] = ()
    unit: str = ""
    meaning: str = ""
    bounded: bool = False
    parameter: str = ""


@dataclass(frozen=True)
class CoupledDrive:
    """A motor with angle ``s = w . q``; its ``terms`` act along ``w`` and are named ``Ia_<name>``, ``fv_<name>``."""

    name: str
    direction: tuple[float, ...]
    terms: tuple[DriveKind, ...] = ("inertia", "viscous", "coulomb")


@dataclass(frozen=True)
class DriveTerms:
    """The drive terms to estimate: for each kind the joints (from 0) that have one, and the coupled drives."""

    inertia: tuple[int, ...] = ()
    viscous: tuple[int, ...] = ()
    coulomb: tuple[int, ...] = ()
    offset: tuple[int, ...] = ()
    coupled: tuple[CoupledDrive, ...] = ()

    @classmethod
    def everywhere(cls, n: int, *kinds: DriveKind, coupled: Sequence[CoupledDrive] = ()) -> DriveTerms:
        """Choose the terms of ``kinds`` at all ``n`` joints, and those of the ``coupled`` drives."""
        return cls(**{kind: tuple(range(n)) for kind in kinds}, coupled=tuple(coupled))

    @classmethod
    def of_spec(cls, spec: Any) -> DriveTerms:
        """The terms that the robot file states, at joints and at coupled motors."""
        terms = drive_terms(spec)
        parts = {
            kind: tuple(term.joint for term in terms if term.kind == kind and term.joint is not None) for kind in KINDS
        }
        coupled = []
        for k in dict.fromkeys(term.motor for term in terms if term.motor is not None):
            of_motor = [term for term in terms if term.motor == k]
            direction = tuple(float(weight) for weight in of_motor[0].direction)
            coupled.append(CoupledDrive(spec.drives.motors[k].name, direction, tuple(term.kind for term in of_motor)))
        return cls(**parts, coupled=tuple(coupled))

    def without(self, *kinds: DriveKind) -> DriveTerms:
        """A copy without the joint terms of these kinds; coupled drives stay."""
        parts = {kind: () if kind in kinds else getattr(self, kind) for kind in KINDS}
        return DriveTerms(**parts, coupled=self.coupled)

    def columns(self, n: int) -> tuple[Column, ...]:
        """The columns for ``n`` joints: joint terms kind by kind, then coupled drives.

        Raises InputError for a joint that the robot does not have, or a coupled drive whose direction is zero or does
        not have ``n`` entries.
        """
        found = []
        for kind in KINDS:
            for joint in getattr(self, kind):
                if not 0 <= joint < n:
                    raise InputError(f"a drive term at joint {joint + 1} of a robot with {n} joints")
                found.append(Column(f"{SYMBOLS[kind]}{joint + 1}", kind, unit(joint, n)))
        for drive in self.coupled:
            if len(drive.direction) != n or not any(drive.direction):
                raise InputError(f"the coupled drive '{drive.name}' needs a direction of {n} weights, not all zero")
            found += [Column(f"{SYMBOLS[kind]}_{drive.name}", kind, drive.direction) for kind in drive.terms]
        return tuple(found)
