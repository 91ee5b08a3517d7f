"""The interface of importers: what an importer is given, and what it returns."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import sympy as sp

from rrrgen.robotfile.robot_spec import Convention, RobotSpec
from rrrgen.yamltext.document import FaultList

DEFAULT_ANGLE_TOLERANCE = 1e-5
"""rad; 1.5708 and 3.1416 are meant as pi/2 and pi, which they miss by 4e-6 and 7e-6."""


@dataclass(frozen=True)
class ChainChoice:
    """Which serial chain of a tree of bodies is meant, and how it is written.

    ``base`` and ``tip`` are links, empty for the root and for the only leaf. ``held`` are joints that do not move, with
    their values (rad, m). Angles within ``angle_tolerance`` (rad) of a multiple of 15 degrees are taken as exact.
    """

    base: str = ""
    tip: str = ""
    held: Mapping[str, sp.Expr] = field(default_factory=dict)
    convention: Convention = "standard"
    angle_tolerance: float = DEFAULT_ANGLE_TOLERANCE


@dataclass(frozen=True)
class Source:
    """What an importer is given: the text of a file, and the choices of the user."""

    text: str
    values: Mapping[str, sp.Expr]
    name: str
    chain: ChainChoice = field(default_factory=ChainChoice)


@dataclass(frozen=True)
class ImportedChain:
    """What an importer took from a tree of bodies, by the names of the file: ends, moving joints, held joints.

    ``offsets`` are the displacements of the moving joints at q = 0, which those that follow others may have.
    """

    base: str
    tip: str
    joints: tuple[str, ...]
    held: Mapping[str, float]
    offsets: tuple[float, ...] = ()


@dataclass(frozen=True)
class Found:
    """What an importer read; ``chain`` is None where the format describes one chain only."""

    spec: RobotSpec
    chain: ImportedChain | None = None


@dataclass(frozen=True)
class Importer:
    """A format of another program.

    ``recognises`` tells from the text alone whether it is of this format. ``read`` makes a robot of it, or returns None
    after it has put every error, with its place, into the list of faults; what the robot file cannot represent is a
    warning there, or an error where the robot would be another one without it. ``describes_trees`` tells whether it
    obeys ``Source.chain``; otherwise a choice of a chain is refused.
    """

    name: str
    meaning: str
    suffixes: tuple[str, ...]
    recognises: Callable[[str], bool]
    read: Callable[[Source, FaultList], Found | None]
    describes_trees: bool = False
