"""Reading and writing of robot files: YAML text to a :class:`RobotSpec`, exact and validated.

All faults of a file are reported together, each with its line and column.

SymPy and the YAML reader are imported on first use, so that the command line starts fast.
"""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any, TypeAlias

from rrrgen.base.parallel import without_collection
from rrrgen.robot.robots import bundled_names, bundled_path

if TYPE_CHECKING:
    from rrrgen.robot.spec import (
        BasisSpec,
        DriveSpec,
        DrivesSpec,
        FixedTransform,
        FrictionSpec,
        JointSpec,
        Limits,
        LinkSpec,
        MotorSpec,
        RobotSpec,
    )

    Robot: TypeAlias = str | os.PathLike[str] | RobotSpec

_TYPES = (
    "BasisSpec",
    "DriveSpec",
    "DrivesSpec",
    "FixedTransform",
    "FrictionSpec",
    "JointSpec",
    "Limits",
    "LinkSpec",
    "MotorSpec",
    "RobotSpec",
)

__all__ = [
    "BasisSpec",
    "DriveSpec",
    "DrivesSpec",
    "FixedTransform",
    "FrictionSpec",
    "JointSpec",
    "Limits",
    "LinkSpec",
    "MotorSpec",
    "RobotSpec",
    "bundled_names",
    "bundled_path",
    "dumps",
    "json_schema",
    "load_spec",
    "loads_spec",
]


def load_spec(robot: str | os.PathLike[str], *, strict: bool = False) -> RobotSpec:
    """Read a robot file, or a bundled robot by its name.

    Args:
        robot: path of a robot file, or the name of a bundled robot such as "rrr" (a bare word without suffix).
        strict: reject inertia that no rigid body can have; otherwise it causes a warning in ``RobotSpec.faults``.

    Returns:
        The robot with exact values in m, rad, kg, s.

    Raises:
        InputError: the file is faulty; the error lists every fault with its line and column.
    """
    from rrrgen.robot.file.reader import load_spec as load

    return load(robot, strict=strict)


def loads_spec(text: str, file: str = "robot.yaml", *, strict: bool = False) -> RobotSpec:
    """Read a robot from YAML text.

    Args:
        text: the contents of a robot file.
        file: the name that messages give to it.
        strict: reject inertia that no rigid body can have; otherwise it causes a warning in ``RobotSpec.faults``.

    Returns:
        The robot with exact values in m, rad, kg, s.

    Raises:
        InputError: the text is faulty; the error lists every fault with its line and column.
    """
    from rrrgen.robot.file.reader import read_spec

    return read_spec(text, file, strict)


def dumps(spec: RobotSpec) -> str:
    """Write ``spec`` as YAML text, exactly: loading the text gives an equal spec."""
    from rrrgen.robot.file.writer import dumps as write

    return write(spec)


def json_schema() -> dict[str, Any]:
    """JSON Schema (draft 7) of the robot file, for editors that complete and check YAML."""
    from rrrgen.robot.file.schema import json_schema as make_schema

    return make_schema()


@without_collection()
def read(robot: Robot) -> RobotSpec:
    """Read the description of a robot.

    Args:
        robot: path of a robot file, name of a bundled robot such as "rrr", or a RobotSpec, which is returned as is.

    Raises:
        InputError: the file is faulty; the error lists every fault.
    """
    from rrrgen.robot.file import load_spec
    from rrrgen.robot.spec import RobotSpec

    return robot if isinstance(robot, RobotSpec) else load_spec(robot)


def __getattr__(name: str) -> Any:
    if name in _TYPES:
        from rrrgen.robot import spec

        return getattr(spec, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
