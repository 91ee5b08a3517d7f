"""Conversion of a file of another program to a robot file; all faults are reported, each with its place."""

from __future__ import annotations

import importlib
import os
import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import sympy as sp

from rrrgen.base.errors import Fault, InputError
from rrrgen.base.plugins import ROBOTS, plugins
from rrrgen.base.yamltext.document import MAX_BYTES, FaultList, decode
from rrrgen.base.yamltext.expressions import ExpressionError, parse_expression
from rrrgen.base.yamltext.units import Unit
from rrrgen.robot import importers as importers_room
from rrrgen.robot.file.reader import read_spec
from rrrgen.robot.file.writer import dumps
from rrrgen.robot.importers.interface import ChainChoice, ImportedChain, Importer, Source
from rrrgen.robot.spec import MAX_NAME, RobotSpec, name_fault

FORMATS = ("mjcf", "open_symoro", "ur_calibration", "urdf")
"""Modules of this folder that hold an ``IMPORTER``."""


@dataclass(frozen=True)
class Imported:
    """A robot from a file of another format: its description, its robot file as text, notes on what is left out.

    ``source`` is the text that was read, with names for the bodies and joints that it leaves without one. ``chain``
    says which part was taken, for formats that describe a tree of bodies.
    """

    spec: RobotSpec
    text: str
    format: str
    notes: tuple[Fault, ...]
    source: str = ""
    chain: ImportedChain | None = None


def importers() -> dict[str, Importer]:
    """Every importer by its name: those of the modules of :data:`FORMATS`, then those of other installed packages.

    Raises InputError for an entry point that cannot be loaded or takes the name of another format.
    """
    format_importers = [importlib.import_module(f"{importers_room.__name__}.{name}").IMPORTER for name in FORMATS]
    known = {importer.name: importer for importer in format_importers}
    for plugin in plugins(ROBOTS):
        importer = plugin.load()
        if isinstance(importer, Importer):
            if importer.name in known:
                raise InputError(f"{plugin.where}: there is a format '{importer.name}' already")
            known[importer.name] = importer
    return known


def import_robot(
    path: str | os.PathLike[str],
    form: str | None = None,
    name: str | None = None,
    values: Mapping[str, str] | None = None,
    chain: ChainChoice | None = None,
) -> Imported:
    """Read the file ``path`` of another program.

    ``form`` is the name of an importer; without it the content decides, then the suffix. ``name`` renames the robot.
    ``values`` give names that the file leaves open a value each, as text in SI units or with a unit (``"450 mm"``).
    ``chain`` chooses the serial chain where the format describes trees of bodies (URDF, MJCF).
    Raises :class:`InputError` with every fault.
    """
    file = os.fspath(path)
    try:
        with Path(file).open("rb") as stream:
            data = stream.read(MAX_BYTES + 1)
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
        raise InputError([Fault(file[:200], 0, 0, f"the file cannot be read: {reason}")]) from None
    text = decode(data, file)
    importer = _choose(text, file, form)
    faults = FaultList(file, text)
    given = {key: parse_value(key, entry) for key, entry in (values or {}).items()}
    usual = ChainChoice(angle_tolerance=chain.angle_tolerance) if chain and importer.rounds_angles else ChainChoice()
    if chain not in (None, usual) and not importer.describes_trees:
        hint = "base, tip, held joints, convention and angle tolerance choose a chain of a tree of bodies"
        raise InputError([Fault(file, 0, 0, f"a file of the format {importer.name} is one chain already", hint=hint)])
    source = Source(text, given, _from_stem(Path(file).stem), chain or ChainChoice())
    robot = importer.read(source, faults)
    faults.raise_errors()
    assert robot is not None  # every None comes with an error
    spec = replace(robot.spec, name=name or robot.spec.name)
    if fault := name_fault(spec.name, "robot"):
        faults.error(robot.place, fault[0], f"{fault[1]}; give another with --name")
        faults.raise_errors()
    written = _write_and_read_back(spec, importer.name, file, tuple(sorted(faults.warnings)))
    return replace(written, chain=robot.chain, source=robot.text or text)


def _choose(text: str, file: str, form: str | None) -> Importer:
    known = importers()
    if form is not None:
        if form not in known:
            raise InputError([Fault(file, 0, 0, f"no format '{form}'", hint=f"formats are {', '.join(known)}")])
        return known[form]
    suffix = Path(file).suffix.lower()
    for importer in known.values():
        if importer.recognises(text):
            return importer
    for importer in known.values():
        if suffix in importer.suffixes:
            return importer
    hint = "; ".join(f"{candidate.name}: {candidate.meaning}" for candidate in known.values())
    raise InputError([Fault(file, 0, 0, "the file is of no format that can be imported", hint=f"formats are {hint}")])


def parse_value(name: str, text: str) -> sp.Expr:
    """The exact SI value of ``text``, a number or expression with or without a unit; ``name`` is for messages."""
    return parse_quantity(name, text)[0]


def parse_quantity(name: str, text: str) -> tuple[sp.Expr, Unit | None]:
    """The exact SI value of ``text`` and its unit, None without one; ``name`` is for messages."""
    try:
        value = parse_expression(text)
    except ExpressionError as error:
        raise InputError([Fault(f"value of {name}", 1, error.offset + 1, error.message, text, error.hint)]) from None
    return (value.expr if value.unit is None else value.expr * value.unit.si()), value.unit


def _from_stem(stem: str) -> str:
    return re.sub(r"\W+", "_", stem, flags=re.ASCII).strip("_")[:MAX_NAME]


def _write_and_read_back(spec: RobotSpec, form: str, file: str, notes: tuple[Fault, ...]) -> Imported:
    """Write the text of the robot file and read it back, which makes sure that it is valid."""
    text = dumps(spec)
    try:
        again = read_spec(text, f"{spec.name}.yaml")
    except InputError as error:
        errors = [fault for fault in error.faults if fault.severity == "error"]
        refused = [Fault(file, 0, 0, f"no robot file can say this: {f.message}", hint=f.hint) for f in errors]
        raise InputError(refused) from None
    about = tuple(Fault(file, 0, 0, f.message, hint=f.hint, severity="warning") for f in again.faults)
    return Imported(again, text, form, notes + about)
