"""Reads a whole robot file into a RobotSpec; all faults are reported together."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path
from typing import cast

import sympy as sp

from rrrgen.base.errors import Fault, InputError
from rrrgen.base.yamltext.document import MAX_BYTES, FaultList, Node, Scalar, decode, parse_document
from rrrgen.base.yamltext.sections import describe, read_choice, read_choices, read_entries, read_section, read_text
from rrrgen.base.yamltext.suggest import did_you_mean
from rrrgen.base.yamltext.units import FileUnits
from rrrgen.robot.file.drives import read_drives
from rrrgen.robot.file.fields import ROBOT, ROBOT_FILE, UNITS
from rrrgen.robot.file.joints import read_joints
from rrrgen.robot.file.links import read_links
from rrrgen.robot.file.mechanism import fixed_rows, read_mechanism
from rrrgen.robot.file.parameter_basis import read_basis
from rrrgen.robot.file.provenance import read_provenance
from rrrgen.robot.file.quantities import Scope, read_parameters, read_vector
from rrrgen.robot.file.transforms import read_tools, read_transform
from rrrgen.robot.names import name_fault
from rrrgen.robot.robot_spec import Convention, FixedTransform, JointSpec, LinkSpec, RobotSpec
from rrrgen.robot.robots import bundled_names, bundled_path

LARGEST_GRAVITY = 50  # m/s^2; twice that of Jupiter
_ROBOT = {key.name: key for key in ROBOT}
_UNITS = {key.name: key for key in UNITS}


def load_spec(robot: str | os.PathLike[str], *, strict: bool = False) -> RobotSpec:
    """Read a robot file, or a bundled robot by its name; with ``strict``, non-physical inertia is an error.

    ``robot@tool`` is the robot with one of its ``tools``, and ``robot_tool`` its name. Raises :class:`InputError` with
    every fault.
    """
    name = os.fspath(robot)
    robot_name, at, tool = name.rpartition("@")
    if at and tool.isidentifier() and not Path(name).exists():
        return with_tool(load_spec(robot_name, strict=strict), tool)
    path = Path(name)
    if not path.suffix and path.name == name:  # a bare word is a bundled robot; ./word is a file
        if name not in bundled_names():
            hint = did_you_mean(name, bundled_names()) or f"bundled robots: {', '.join(bundled_names())}"
            raise InputError([Fault(name[:200], 0, 0, "there is no bundled robot of this name", hint=hint)])
        path = bundled_path(name)
    try:
        with path.open("rb") as stream:
            data = stream.read(MAX_BYTES + 1)
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
        raise InputError([Fault(name[:200], 0, 0, f"the file cannot be read: {reason}")]) from None
    return read_spec(decode(data, name), name, strict)


def with_tool(spec: RobotSpec, tool: str) -> RobotSpec:
    """Replace the tool of ``spec`` by the one named ``tool``, and its name by ``<robot>_<tool>``.

    Raises :class:`InputError` for an unknown tool.
    """
    if tool not in spec.tools:
        hint = did_you_mean(tool, spec.tools) or f"tools are {', '.join(spec.tools) or 'none: add them under tools'}"
        raise InputError([Fault(spec.file, 0, 0, f"the robot has no tool '{tool}'", hint=hint)])
    name = f"{spec.name}_{tool}"
    if fault := name_fault(name, "robot"):
        raise InputError([Fault(spec.file, 0, 0, fault[0], hint=fault[1])])
    return replace(spec, tool=spec.tools[tool], name=name)


def read_spec(text: str, file: str, strict: bool = False) -> RobotSpec:
    """Read a robot from YAML ``text``; ``file`` names it in messages. Raises :class:`InputError` with every fault."""
    faults = FaultList(file, text)
    root = parse_document(text, faults)
    values = read_section(root, "robot", "the robot", faults, ROBOT_FILE)
    if values is None:
        faults.raise_errors()
        values = {}
    spec = _assemble(values, strict, Scope(faults), file)
    faults.raise_errors()
    assert spec is not None  # every None comes with an error
    return spec


def _assemble(values: dict[str, Node], strict: bool, scope: Scope, file: str) -> RobotSpec | None:
    faults = scope.faults
    if "schema" in values:
        read_choice(values["schema"], _ROBOT["schema"], faults)
    name = _read_name(values.get("name"), scope)
    convention = read_choice(values["convention"], _ROBOT["convention"], faults) if "convention" in values else None
    scope.units = _read_units(values.get("units"), faults)
    if "parameters" in values:
        _read_parameters(values["parameters"], scope)
    gravity = _read_gravity(values.get("gravity"), scope)
    joints = read_joints(values["joints"], scope) if "joints" in values else []
    fixed = fixed_rows(values["joints"], joints) if "joints" in values else []
    links = read_links(values["links"], fixed, strict, scope) if "links" in values else None
    whole_links: list[LinkSpec] | None = None if links is None else [link for link in links if link is not None]
    base = read_transform(values["base"], "base", scope) if "base" in values else FixedTransform()
    tool = read_transform(values["tool"], "tool", scope) if "tool" in values else FixedTransform()
    tools = read_tools(values["tools"], scope) if "tools" in values else {}
    counted: tuple[JointSpec | None, ...] = tuple(joints)
    mechanism = None
    if "joints" in values and all(joint is not None for joint in joints):
        counted, mechanism = read_mechanism(values["joints"], values.get("tip"), joints, scope)
    drives = read_drives(values["drives"], counted, scope) if "drives" in values else None
    basis = read_basis(values["basis"], len(joints), whole_links, scope) if "basis" in values and joints else None
    emit = read_choices(values["emit"], _ROBOT["emit"], faults) if "emit" in values else ()
    ik = read_choice(values["ik"], _ROBOT["ik"], faults) if "ik" in values else None
    provenance = read_provenance(values["provenance"], faults) if "provenance" in values else ()
    description, source = (read_text(values[k], k, faults) if k in values else "" for k in ("description", "source"))
    if faults.errors or gravity is None or base is None or tool is None:
        return None
    return RobotSpec(
        name=name,
        convention=cast(Convention, convention),
        gravity=gravity,
        parameters=dict(scope.nominal),
        joints=tuple(joint for joint in counted if joint is not None),
        links=None if whole_links is None else tuple(whole_links),
        base=base,
        tool=tool,
        tools=tools,
        basis=basis,
        drives=drives,
        angle_unit=scope.units.angle,
        length_unit=scope.units.length,
        description=description,
        source=source,
        file=file,
        faults=tuple(sorted(faults.warnings)),
        parameter_units=dict(scope.parameter_units),
        provenance=provenance,
        emit=emit,
        ik=ik or "general",
        mechanism=mechanism,
    )


def _read_name(node: Node | None, scope: Scope) -> str:
    if node is None:
        return ""
    if not isinstance(node, Scalar):
        scope.faults.error(node, f"name is {describe(node)}, not a word", "letters, digits and _")
        return ""
    if fault := name_fault(node.text, "robot"):
        scope.faults.error(node, *fault)
    return node.text


def _read_units(node: Node | None, faults: FaultList) -> FileUnits:
    """Read the key ``units``, the units of bare numbers; report once if it does not state one of them."""
    values = read_section(node, "units", "units", faults, ROBOT_FILE) if node is not None else None
    written = {key: read_text(value, key, faults) for key, value in (values or {}).items()}
    if node is not None and _swapped(written):
        hint = f"write units: {{angle: {written['length']}, length: {written['angle']}}}"
        faults.error(node, "the units of angle and length are swapped", hint)
        return FileUnits(missing=frozenset(_UNITS))
    chosen = {key: read_choice(value, _UNITS[key], faults) for key, value in (values or {}).items()}
    missing = frozenset(key for key in _UNITS if chosen.get(key) is None)
    return FileUnits(chosen.get("angle") or "rad", chosen.get("length") or "m", missing)


def _swapped(written: dict[str, str]) -> bool:
    angle, length = (_UNITS[key].choices for key in ("angle", "length"))
    return written.get("angle") in length and written.get("length") in angle


def _read_parameters(node: Node, scope: Scope) -> None:
    entries = read_entries(node, "parameters", scope.faults)
    for name, (key, _) in list((entries or {}).items()):
        if fault := name_fault(name, "parameter"):
            scope.faults.error(key, *fault)
    read_parameters(entries or {}, scope)


def _read_gravity(node: Node | None, scope: Scope) -> tuple[sp.Expr, sp.Expr, sp.Expr] | None:
    vector = read_vector(node, "gravity", "acceleration", scope) if node is not None else None
    if vector is None or node is None:
        return None
    x, y, z = (scope.substitute(value) for value in vector)
    size = float(sp.sqrt(x * x + y * y + z * z))
    if size > LARGEST_GRAVITY:
        meant = ", ".join(f"{float(v) / 1000:g}" for v in (x, y, z))
        hint = f"gravity is in m/s^2; if mm/s^2 were meant, write [{meant}]"
        scope.faults.error(node, f"gravity is {size:g} m/s^2", hint)
    if x == 0 and y == 0 and 9.7 < float(z) < 9.9:
        hint = "gravity is the acceleration of a falling body, not its reaction"
        hint += f": [0, 0, {-float(z):g}] for an upright robot"
        scope.faults.warning(node, "gravity points along +z of the base", hint)
    return x, y, z
