"""The interface of importers: the type of an importer, of its input and of its result."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field

import sympy as sp

from rrrgen.base.yamltext.document import FaultList, Place
from rrrgen.base.yamltext.units import Unit
from rrrgen.robot.spec import Convention, RobotSpec

DEFAULT_ANGLE_TOLERANCE = 1e-5
"""Largest difference (rad) between an angle and a multiple of 15 degrees that it is taken for: 1.5708 and 3.1416 stand
for pi/2 and pi, and differ from them by 4e-6 and 7e-6."""

ROUNDING = 1e-12
"""Change of an angle (rad) up to which nothing is said: rounding errors of programs that compute with doubles."""


@dataclass(frozen=True)
class ChainChoice:
    """The user's choice of a serial chain in a tree of bodies, and the convention in which its rows are written.

    ``base`` and ``tip`` are names of links; empty for the root and for the only leaf. ``further_tips`` are links to
    which the robot branches. ``held`` are joints that are kept at fixed values (rad, m), ``held_units`` the units in
    which values were stated, for those that were stated with one. Angles within ``angle_tolerance`` (rad) of a multiple
    of 15 degrees are taken as exact.
    """

    base: str = ""
    tip: str = ""
    held: Mapping[str, sp.Expr] = field(default_factory=dict)
    convention: Convention = "standard"
    angle_tolerance: float = DEFAULT_ANGLE_TOLERANCE
    further_tips: tuple[str, ...] = ()
    held_units: Mapping[str, Unit] = field(default_factory=dict)


def warn_of_rounded_angles(changes: Iterable[float], tolerance: float, faults: FaultList) -> None:
    """Add a warning if any of the ``changes`` (rad) that made angles exact is more than rounding of doubles."""
    larger = [change for change in changes if change > ROUNDING]
    if larger:
        angles = (
            "1 angle was taken as a multiple" if len(larger) == 1 else f"{len(larger)} angles were taken as multiples"
        )
        hint = f"within {tolerance:g} rad; --angle-tolerance 0 keeps the decimals of the file"
        faults.warning(None, f"{angles} of 15 degrees; the largest change is {max(larger):.1e} rad", hint)


@dataclass(frozen=True)
class Source:
    """The input of an importer: the text of a file, and the choices of the user.

    ``values`` are exact SI values for names that the file leaves open, ``name`` is the name of the robot if the file
    states none, and ``chain`` the choice of a chain for formats that describe trees of bodies.
    """

    text: str
    values: Mapping[str, sp.Expr]
    name: str
    chain: ChainChoice = field(default_factory=ChainChoice)


@dataclass(frozen=True)
class ImportedChain:
    """The serial chain that an importer took from a tree of bodies: ends, moving joints, held joints, by their names.

    ``offsets`` are the displacements (rad, m) of the moving joints at q = 0; they are not zero for some joints that
    follow others. ``rows`` are the numbers (from 0) of the moving joints' rows in the table, which may have fixed rows
    besides. ``tips`` maps the names of all tips to their links where the robot branches. ``rounded`` is the sum of the
    changes (rad) that made angles exact.
    """

    base: str
    tip: str
    joints: tuple[str, ...]
    held: Mapping[str, float]
    offsets: tuple[float, ...] = ()
    rows: tuple[int, ...] = ()
    tips: Mapping[str, str] = field(default_factory=dict)
    rounded: float = 0.0


@dataclass(frozen=True)
class Found:
    """The result of an importer: the robot, and ``chain``, which is None where the format describes one chain only.

    ``place`` is that of the robot's name in the file, if the file states one. ``text`` is the text of the file with
    the names that ``chain`` uses, where the file leaves names out; it is empty otherwise.
    """

    spec: RobotSpec
    chain: ImportedChain | None = None
    place: Place | None = None
    text: str = ""


@dataclass(frozen=True)
class Importer:
    """A format of another program: its ``name``, its ``meaning`` in words and the ``suffixes`` of its files.

    ``recognises`` says whether a text is of this format. ``read`` converts it to a robot, or returns None after adding
    every error, with its place, to the list of faults. What a robot file cannot represent is a warning in that list, or
    an error where leaving it out would change the robot. ``describes_trees`` says whether the importer uses the choice
    ``Source.chain``, ``rounds_angles`` whether of this choice it uses the tolerance of angles alone; for other formats
    such a choice is refused.
    """

    name: str
    meaning: str
    suffixes: tuple[str, ...]
    recognises: Callable[[str], bool]
    read: Callable[[Source, FaultList], Found | None]
    describes_trees: bool = False
    rounds_angles: bool = False
