"""Units and meaning of the identified parameters, for tables and figures."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from rrrgen.base.arrays import Array
from rrrgen.base.errors import InputError
from rrrgen.lab.estimate.identifiability import combination
from rrrgen.robot.friction.laws import LAWS
from rrrgen.robot.model.drives import KINDS, SYMBOLS, drive_terms, unit
from rrrgen.robot.model.drives import Kind as DriveKind
from rrrgen.robot.spec import standard_names

if TYPE_CHECKING:
    from rrrgen.lab.estimate.identifiability import Structure

NEGLIGIBLE = 1e-9  # weights below this share of the largest are round-off of the projection
DIGITS = 4
UNITS = ("kg", "kg m", "kg m^2")
DRIVE_UNITS = {
    "inertia": ("kg m^2", "kg"),
    "viscous": ("N m s/rad", "N s/m"),
    "coulomb": ("N m", "N"),
    "offset": ("N m", "N"),
}
NON_NEGATIVE = ("inertia", "viscous", "coulomb")
MEANING = {
    "inertia": "Ia: inertia of the drive, at the joint",
    "viscous": "fv: viscous friction",
    "coulomb": "fc: Coulomb friction",
    "offset": "off: constant torque",
}
STANDARD = (
    "m, mx..mz, Ixx..Izz: mass, first moments and inertia tensor (Ixy = -int xy dm) of a link, "
    "about the origin and in the axes of its frame"
)
WORD = re.compile(r"\w+")


def column_unit(column: Column, weights: Array, revolute: Sequence[bool]) -> str:
    """SI unit of the parameter of one column.

    ``weights`` (10 n,) express a base parameter in standard parameters. Masses and first moments in it are multiplied
    by lengths, so that the unit is that of the term of highest order: kg, kg m or kg m^2. ``revolute`` (n,) gives the
    type of each joint, for drive parameters.
    """
    if column.kind != "rigid":
        turning = all(revolute[i] for i, weight in enumerate(column.direction) if weight)
        if column.kind == "law":
            return column.unit if turning else column.unit.replace("N m", "N").replace("rad", "m")
        return DRIVE_UNITS[column.kind][0 if turning else 1]
    present = np.abs(weights) > NEGLIGIBLE * np.max(np.abs(weights), initial=0.0)
    orders = [_order(name) for name, there in zip(standard_names(len(weights) // 10), present, strict=True) if there]
    return UNITS[max(orders, default=0)]


def _order(name: str) -> int:
    return 2 if name.startswith("I") else 1 if name[1] in "xyz" else 0


def identified_units(
    structure: Structure, columns: Sequence[Column], free: Sequence[int], model: Any
) -> tuple[str, ...]:
    """SI units of the identifiable combinations in ``structure``, whose columns are ``free`` among ``columns``.

    A combination is a sum of parameters times powers of lengths, such as mass times length squared; its unit is that of
    the term with the highest power of length in its own unit: kg m^2 before kg m before kg.
    """
    joints = () if model.spec is None else model.spec.joints  # a model of equations alone has revolute joints
    revolute = [joint.is_revolute for joint in joints] or [True] * model.n
    K = np.asarray(model.base_projection)
    b = len(K)
    column_units = [column_unit(columns[k], K[k] if k < b else np.zeros(0), revolute) for k in free]
    combination_units = []
    for row in structure.G:
        units = [unit for unit, weight in zip(column_units, row, strict=True) if weight != 0.0]
        combination_units.append(max(units, key=lambda unit: UNITS.index(unit) if unit in UNITS else 3))
    return tuple(combination_units)


def explained_names(names: Sequence[str], columns: Sequence[Column], model: Any) -> tuple[str, ...]:
    """Lines that explain the parameter ``names``: each kind of parameter once, and base parameters the user named."""
    used = {word for name in names for word in WORD.findall(name)}
    K = np.asarray(model.base_projection)
    standard = standard_names(K.shape[1] // 10)
    lines = []
    for name, weights in zip(model.base_parameter_names, K, strict=False):
        known = np.where(np.abs(weights) > NEGLIGIBLE * np.max(np.abs(weights), initial=0.0), weights, 0.0)
        words = combination(standard, known, DIGITS)
        if name in used and words != name:
            lines.append(f"{name} = {words}")
    mentions = used & set(standard) or lines
    kinds = [kind for kind in MEANING if any(column.kind == kind and column.name in used for column in columns)]
    laws = dict.fromkeys(f"{column.parameter}: {column.meaning}" for column in columns if column.kind == "law")
    return (*([STANDARD] if mentions else []), *(MEANING[kind] for kind in kinds), *laws, *lines)


# ------------------------------------------------------------------------------------------------------------------
# The choice of parameters to estimate: base parameters, and linear drive terms at chosen joints.
#
# The drive terms are those of :mod:`rrrgen.robot.model.drives`.
# ------------------------------------------------------------------------------------------------------------------

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

    @property
    def is_non_negative(self) -> bool:
        """Whether the parameter must not be negative: inertia, viscous and Coulomb friction, and those ``bounded``."""
        return self.kind in NON_NEGATIVE or self.bounded


@dataclass(frozen=True)
class CoupledDrive:
    """A motor with angle ``s = w . q``; its ``terms`` act along ``w`` and are named ``Ia_<name>``, ``fv_<name>``."""

    name: str
    direction: tuple[float, ...]
    terms: tuple[DriveKind, ...] = ("inertia", "viscous", "coulomb")


@dataclass(frozen=True)
class DriveTerms:
    """The drive terms to estimate: for each kind the joints (from 0) that have one, and the coupled drives.

    ``before`` is the number of coordinates before the joints, 6 on a floating base.
    """

    inertia: tuple[int, ...] = ()
    viscous: tuple[int, ...] = ()
    coulomb: tuple[int, ...] = ()
    offset: tuple[int, ...] = ()
    coupled: tuple[CoupledDrive, ...] = ()
    before: int = 0

    @classmethod
    def everywhere(cls, n: int, *kinds: DriveKind, coupled: Sequence[CoupledDrive] = ()) -> DriveTerms:
        """Choose the terms of ``kinds`` at all ``n`` joints, and those of the ``coupled`` drives."""
        parts: dict[str, Any] = {kind: tuple(range(n)) for kind in kinds}
        return cls(**parts, coupled=tuple(coupled))

    @classmethod
    def of_spec(cls, spec: Any) -> DriveTerms:
        """The terms that the robot file states, at joints and at coupled motors."""
        terms = drive_terms(spec)
        parts: dict[str, Any] = {
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
        left: dict[str, Any] = dict.fromkeys(kinds, ())
        return replace(self, **left)

    def columns(self, n: int) -> tuple[Column, ...]:
        """The columns for ``n`` coordinates: joint terms kind by kind, then coupled drives.

        Raises InputError for a joint that the robot does not have, or a coupled drive whose direction is zero or does
        not have ``n`` entries.
        """
        columns = []
        still, n = (0.0,) * self.before, n - self.before
        for kind in KINDS:
            for joint in getattr(self, kind):
                if not 0 <= joint < n:
                    raise InputError(f"a drive term at joint {joint + 1} of a robot with {n} joints")
                columns.append(Column(f"{SYMBOLS[kind]}{joint + 1}", kind, still + unit(joint, n)))
        for drive in self.coupled:
            if len(drive.direction) != n or not any(drive.direction):
                raise InputError(f"the coupled drive '{drive.name}' needs a direction of {n} weights, not all zero")
            columns += [Column(f"{SYMBOLS[kind]}_{drive.name}", kind, still + drive.direction) for kind in drive.terms]
        return tuple(columns)


def nominal_drives(spec: Any) -> dict[str, float]:
    """The drive and friction parameters (SI) that the robot file ``spec`` states, by the names of their columns.

    Of a friction law these are the parameters in which it is linear.
    """
    values = {term.name: term.value for term in drive_terms(spec)}
    owners = [(f"{i}", joint.friction) for i, joint in enumerate(spec.joints, start=1)]
    if spec.drives is not None:
        owners += [(f"_{motor.name}", motor.friction) for motor in spec.drives.motors]
    for owner, friction in owners:
        if friction is not None and friction.law is not None:
            law = LAWS[friction.law.name]
            linear, _ = law.split(friction.law.values)
            values |= {f"{p.name}{owner}": value for p, value in zip(law.linear, linear, strict=True)}
    return {name: float(value) for name, value in values.items()}
