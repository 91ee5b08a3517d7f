"""What an importer must offer."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import sympy as sp

from rrrgen.robotfile.robot_spec import RobotSpec
from rrrgen.yamltext.document import FaultList


@dataclass(frozen=True)
class Source:
    """The text of a file, and what its user said beside it.

    ``values`` are the exact values, in SI units, of names that the file uses without giving them one. ``name`` is the
    robot's name where the file has none.
    """

    text: str
    values: Mapping[str, sp.Expr]
    name: str


@dataclass(frozen=True)
class Importer:
    """A format of another program.

    ``recognises`` tells from the text alone whether it is of this format. ``read`` makes a robot of it, or returns None
    after it has put every error, with its place, into the list of faults; what the robot file cannot represent is a
    warning there, or an error where the robot would be another one without it.
    """

    name: str
    meaning: str
    suffixes: tuple[str, ...]
    recognises: Callable[[str], bool]
    read: Callable[[Source, FaultList], RobotSpec | None]
