"""Interface of the targets of ``rrrgen export``."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

from rrrgen.emit import Real
from rrrgen.robot.friction.laws import LAWS
from rrrgen.robot.spec import FrictionSpec, RobotSpec

Contents = str | bytes


@dataclass(frozen=True)
class Exported:
    """Files of a target, relative path -> contents, and what the target cannot represent, one sentence each."""

    files: Mapping[str, Contents]
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class UnitCode:
    """The controller of a robot as one unit, for a package that holds it.

    ``files`` are its C files, ``description`` is pure data with modes, status bits, phases and the fields of all
    structs, as in ``<name>_controller.json``. ``python`` is the text of the Python class that calls the C.
    """

    files: Mapping[str, str]
    description: Mapping[str, Any]
    python: str


@dataclass(frozen=True)
class ExportOptions:
    """Options that the user gives to ``rrrgen export``.

    ``real`` is the number type of the C code, ``platforms`` those to build for (empty: this machine), ``further`` what
    the package holds besides the model: words of :data:`rrrgen.robot.file.fields.EMIT`. Where the word "controller" is
    one of them, ``chosen`` are the modes, parts and defaults of the controller, arguments of
    :func:`rrrgen.controller.table.unit_of` by name, and ``unit`` is its code, which
    :func:`rrrgen.exporting.export_robot` adds.
    """

    real: Real = "double"
    platforms: tuple[str, ...] = ()
    further: tuple[str, ...] = ()
    chosen: Mapping[str, Any] = field(default_factory=dict)
    unit: UnitCode | None = None


@dataclass(frozen=True)
class Exporter:
    """Export target: a file format of another program, or a package that other programs load.

    ``write`` makes the files of a robot; it raises :class:`rrrgen.base.errors.DerivationError` if the format cannot
    represent the robot. If ``one_file``, the result is one file, which the user may name; otherwise a folder. If
    ``needs_bodies``, every link must be a rigid body of positive mass; links that are not are replaced by physical ones
    with the same base parameters. ``options`` names the fields of :class:`ExportOptions` that the target uses.
    ``mechanisms`` says whether it supports joints coupled to others and branching chains, ``loops`` whether it supports
    closed loops too. ``further`` are the words of :data:`rrrgen.robot.file.fields.EMIT` that the package can hold.
    """

    name: str
    meaning: str
    write: Callable[[RobotSpec, ExportOptions], Exported]
    one_file: bool = True
    needs_bodies: bool = False
    options: tuple[str, ...] = ()
    mechanisms: bool = False
    loops: bool = False
    further: tuple[str, ...] = ()


def viscous_and_coulomb(friction: FrictionSpec | None) -> tuple[float | None, float | None]:
    """The viscous and the Coulomb coefficient of ``friction``, of its law if it has one; None where there is none."""
    if friction is None:
        return None, None
    if friction.law is None:
        return friction.viscous, friction.coulomb
    names = (parameter.name for parameter in LAWS[friction.law.name].parameters)
    of_law = dict(zip(names, friction.law.values, strict=True))
    return of_law.get("viscous"), of_law.get("coulomb")


def unused_entries(spec: RobotSpec, kept: Collection[str] = (), motors: bool = False) -> Iterator[str]:
    """Yield one sentence for each kind of joint entry that the robot file states and the export format loses.

    ``kept`` are the keys that the format can hold, of acceleration, offset, gear_ratio, torque_constant,
    encoder_resolution, stiffness and damping. ``motors`` says whether it holds the friction of coupled drives.
    """
    owners = {
        "acceleration": ("limits", "limits of the acceleration"),
        "offset": ("friction", "constant torques of friction"),
        "gear_ratio": ("drive", "gear ratios"),
        "torque_constant": ("drive", "torque constants"),
        "encoder_resolution": ("drive", "resolutions of encoders"),
        "stiffness": ("drive", "stiffnesses of joints"),
        "damping": ("drive", "dampings of elastic joints"),
    }
    frictions = [joint.friction for joint in spec.joints]
    if motors and spec.drives is not None:
        frictions += [motor.friction for motor in spec.drives.motors]
    if any(friction is not None and friction.law is not None for friction in frictions):
        yield "friction laws are left out, but for their viscous and Coulomb friction: the format has no such entry"
    for key, (section, words) in owners.items():
        sections = frictions if section == "friction" else [getattr(joint, section) for joint in spec.joints]
        if key not in kept and any(
            joint_section is not None and getattr(joint_section, key) is not None for joint_section in sections
        ):
            yield f"{words} are left out: the format has no such entry"
