"""What a target of ``rrrgen export`` must offer."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from rrrgen.backends import Real
from rrrgen.robotfile.robot_spec import RobotSpec

Contents = str | bytes


@dataclass(frozen=True)
class Exported:
    """Files of a target, relative path -> contents, and what the target cannot represent, one sentence each."""

    files: Mapping[str, Contents]
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class ExportOptions:
    """Choices of the user: the real type of the code, and names of platforms to build for (none: this machine)."""

    real: Real = "double"
    platforms: tuple[str, ...] = ()


@dataclass(frozen=True)
class Exporter:
    """A format of another program, or a package that other programs load.

    ``write`` makes the files of a robot; it raises :class:`rrrgen.errors.DerivationError` where the robot has no
    counterpart in the format. With ``one_file`` there is one, which the user may name; otherwise a folder is written.
    ``needs_bodies`` tells whether every link must be a rigid body of positive mass; standard parameters with the same
    base parameters are found where it is not. ``options`` names the fields of :class:`ExportOptions` that it heeds.
    ``mechanisms`` tells whether joints may follow others or branch off.
    """

    name: str
    meaning: str
    write: Callable[[RobotSpec, ExportOptions], Exported]
    one_file: bool = True
    needs_bodies: bool = False
    options: tuple[str, ...] = ()
    mechanisms: bool = False
