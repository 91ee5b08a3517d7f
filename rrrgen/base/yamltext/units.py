"""The units of a robot file and the quantities they measure.

A unit is an exact factor to SI and radians, ``factor * pi**pi_power``, with a dimension: the exponents of length, mass,
time, angle and current. Angle is a dimension of its own, so that a length is never accepted as an angle.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from fractions import Fraction
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import sympy as sp

Dimension = tuple[Fraction, ...]  # exponents of (length, mass, time, angle, current)


def _dimension(length: int = 0, mass: int = 0, time: int = 0, angle: int = 0, current: int = 0) -> Dimension:
    return tuple(Fraction(exponent) for exponent in (length, mass, time, angle, current))


NUMBER = _dimension()
ANGLE = _dimension(angle=1)
LENGTH = _dimension(length=1)
_ANGLE_RATE = _dimension(angle=1, time=-1)
_ANGLE_ACCELERATION = _dimension(angle=1, time=-2)
_LENGTH_RATE = _dimension(length=1, time=-1)
_LENGTH_ACCELERATION = _dimension(length=1, time=-2)
_LENGTHS = (LENGTH, _LENGTH_RATE, _LENGTH_ACCELERATION)
_MASS = _dimension(mass=1)
_INERTIA = _dimension(length=2, mass=1)
_FORCE = _dimension(length=1, mass=1, time=-2)
_TORQUE = _dimension(length=2, mass=1, time=-2)


@dataclass(frozen=True)
class Unit:
    """A unit by its usual spelling ``name``: ``value in SI = value * factor * pi**pi_power``.

    ``dimension`` holds the exponents of length, mass, time, angle and current.
    """

    name: str
    factor: Fraction
    dimension: Dimension
    pi_power: int = 0

    def si(self) -> sp.Expr:
        """The exact factor to SI and radians."""
        import sympy as sp

        return sp.Rational(self.factor.numerator, self.factor.denominator) * sp.pi**self.pi_power


_TABLE: tuple[tuple[str, Fraction, Dimension, int], ...] = (
    ("one", Fraction(1), NUMBER, 0),
    ("rad", Fraction(1), ANGLE, 0),
    ("mrad", Fraction(1, 1000), ANGLE, 0),
    ("deg", Fraction(1, 180), ANGLE, 1),
    ("m", Fraction(1), LENGTH, 0),
    ("cm", Fraction(1, 100), LENGTH, 0),
    ("mm", Fraction(1, 1000), LENGTH, 0),
    ("um", Fraction(1, 10**6), LENGTH, 0),
    ("in", Fraction(254, 10**4), LENGTH, 0),
    ("rad/s", Fraction(1), _ANGLE_RATE, 0),
    ("deg/s", Fraction(1, 180), _ANGLE_RATE, 1),
    ("rpm", Fraction(1, 30), _ANGLE_RATE, 1),
    ("rad/s^2", Fraction(1), _ANGLE_ACCELERATION, 0),
    ("deg/s^2", Fraction(1, 180), _ANGLE_ACCELERATION, 1),
    ("m/s", Fraction(1), _LENGTH_RATE, 0),
    ("mm/s", Fraction(1, 1000), _LENGTH_RATE, 0),
    ("m/s^2", Fraction(1), _LENGTH_ACCELERATION, 0),
    ("mm/s^2", Fraction(1, 1000), _LENGTH_ACCELERATION, 0),
    ("kg", Fraction(1), _MASS, 0),
    ("g", Fraction(1, 1000), _MASS, 0),
    ("kg*m^2", Fraction(1), _INERTIA, 0),
    ("kg*cm^2", Fraction(1, 10**4), _INERTIA, 0),
    ("kg*mm^2", Fraction(1, 10**6), _INERTIA, 0),
    ("g*cm^2", Fraction(1, 10**7), _INERTIA, 0),
    ("N", Fraction(1), _FORCE, 0),
    ("N*m", Fraction(1), _TORQUE, 0),
    ("N*mm", Fraction(1, 1000), _TORQUE, 0),
    ("N*m*s", Fraction(1), _dimension(length=2, mass=1, time=-1), 0),
    ("N*m*s/rad", Fraction(1), _dimension(length=2, mass=1, time=-1), 0),
    ("N*s/m", Fraction(1), _dimension(mass=1, time=-1), 0),
    ("N*m/rad", Fraction(1), _dimension(length=2, mass=1, time=-2, angle=-1), 0),
    ("N/m", Fraction(1), _dimension(mass=1, time=-2), 0),
    ("N*m/A", Fraction(1), _dimension(length=2, mass=1, time=-2, current=-1), 0),
    ("N/A", Fraction(1), _dimension(length=1, mass=1, time=-2, current=-1), 0),
)
UNITS: dict[str, Unit] = {name: Unit(name, factor, dim, pi) for name, factor, dim, pi in _TABLE}


def _key(spelling: str) -> str:
    """Normalise a spelling for lookup: ``N m``, ``N·m`` and ``N*m`` become equal, as do ``kg m2`` and ``kg*m**2``."""
    text = spelling.strip().replace("°", "deg").replace("µ", "u").replace("μ", "u").replace("·", "*").replace("²", "^2")
    return re.sub(r"[\s*]+|\^", "", text.replace("**", "^"))


_BY_KEY: dict[str, Unit] = {_key(name): unit for name, unit in UNITS.items()}
_BY_KEY |= {"radian": UNITS["rad"], "radians": UNITS["rad"], "degree": UNITS["deg"], "degrees": UNITS["deg"]}


def find_unit(spelling: str) -> Unit | None:
    """The unit that ``spelling`` names, or None."""
    return _BY_KEY.get(_key(spelling))


@dataclass(frozen=True)
class Quantity:
    """A physical quantity: its name with an article, its dimension, and the SI unit assumed for bare numbers."""

    name: str
    dimension: Dimension
    si_unit: str

    @property
    def units(self) -> tuple[str, ...]:
        """Names of all units that measure this quantity."""
        return tuple(unit.name for unit in UNITS.values() if unit.dimension == self.dimension)


QUANTITIES: dict[str, Quantity] = {
    "number": Quantity("a plain number", NUMBER, "one"),
    "angle": Quantity("an angle", ANGLE, "rad"),
    "joint angle": Quantity("a joint angle", ANGLE, "rad"),
    "length": Quantity("a length", LENGTH, "m"),
    "angular speed": Quantity("an angular speed", _ANGLE_RATE, "rad/s"),
    "angular acceleration": Quantity("an angular acceleration", _ANGLE_ACCELERATION, "rad/s^2"),
    "speed": Quantity("a speed", _LENGTH_RATE, "m/s"),
    "acceleration": Quantity("an acceleration", _LENGTH_ACCELERATION, "m/s^2"),
    "mass": Quantity("a mass", _MASS, "kg"),
    "inertia": Quantity("a moment of inertia", _INERTIA, "kg*m^2"),
    "force": Quantity("a force", _FORCE, "N"),
    "torque": Quantity("a torque", _TORQUE, "N*m"),
    "angular damping": Quantity("a viscous friction coefficient", UNITS["N*m*s"].dimension, "N*m*s"),
    "damping": Quantity("a viscous friction coefficient", UNITS["N*s/m"].dimension, "N*s/m"),
    "angular stiffness": Quantity("a stiffness", UNITS["N*m/rad"].dimension, "N*m/rad"),
    "stiffness": Quantity("a stiffness", UNITS["N/m"].dimension, "N/m"),
    "torque constant": Quantity("a torque constant", UNITS["N*m/A"].dimension, "N*m/A"),
    "force constant": Quantity("a force constant", UNITS["N/A"].dimension, "N/A"),
}


def quantity_name(dimension: Dimension) -> str:
    """The quantity of a dimension for messages: ``a length``, ``an angle``, or ``a value in m^2 s^-1`` if unnamed."""
    for quantity in QUANTITIES.values():
        if quantity.dimension == dimension:
            return quantity.name
    powers = [f"{base}^{e}" for base, e in zip(("m", "kg", "s", "rad", "A"), dimension, strict=True) if e]
    return "a value in " + " ".join(powers)


@dataclass(frozen=True)
class FileUnits:
    """Units of numbers without a unit in one robot file, from its key ``units: {angle: ..., length: ...}``.

    ``missing`` holds "angle" or "length" where the file fails to say which unit it uses: nothing can then be said about
    the size of such numbers.
    """

    angle: str = "rad"
    length: str = "m"
    missing: frozenset[str] = frozenset()

    def covers(self, quantity: Quantity) -> bool:
        """Whether the file says in which unit a bare number of this ``quantity`` is."""
        measured = "angle" if quantity.dimension[3] > 0 else "length" if quantity.dimension in _LENGTHS else ""
        return measured not in self.missing

    def of(self, quantity: Quantity) -> Unit:
        """The unit of a bare number of this ``quantity`` in the joints, base and tool of the file.

        Angles, lengths and their rates have the units that the file declares; torques, and quantities per angle such as
        viscous friction, have SI units.
        """
        name = quantity.si_unit
        if quantity.dimension[3] > 0:
            name = re.sub(r"\brad\b", self.angle, name)
        elif quantity.dimension in _LENGTHS:
            name = re.sub(r"^m\b", self.length, name)
        return UNITS[name]
