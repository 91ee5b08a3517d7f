"""Reads a whole robot file into a RobotSpec; all faults are reported together."""

from __future__ import annotations

import os
import re
from collections.abc import Sequence as Row
from dataclasses import replace
from functools import lru_cache
from itertools import pairwise
from pathlib import Path
from typing import cast

import sympy as sp

from rrrgen.base.errors import Fault, InputError
from rrrgen.base.yamltext.document import (
    MAX_BYTES,
    FaultList,
    Node,
    ScalarNode,
    decode,
    describe,
    parse_document,
    shorten,
)
from rrrgen.base.yamltext.fields import read_choice, read_choices, read_entries, read_list, read_section, read_text
from rrrgen.base.yamltext.suggestions import did_you_mean
from rrrgen.base.yamltext.units import FileUnits
from rrrgen.robot.file.drives import read_drives
from rrrgen.robot.file.fields import FIT, HASH_DIGITS, MAX_FITS, ROBOT, ROBOT_FILE, UNITS
from rrrgen.robot.file.joints import read_joints, refuse_placements
from rrrgen.robot.file.links import read_floating_base, read_links
from rrrgen.robot.file.mechanism import fixed_rows, on_floating_base, read_loops, read_mechanism
from rrrgen.robot.file.parameter_basis import read_basis
from rrrgen.robot.file.quantities import Scope, read_parameters, read_value, read_vector
from rrrgen.robot.model import build_model
from rrrgen.robot.model.loops import LoopError
from rrrgen.robot.robots import bundled_names, bundled_path, installed_path
from rrrgen.robot.spec import Convention, FitSpec, FixedTransform, JointSpec, LinkSpec, RobotSpec, TipSpec, name_fault

# ------------------------------------------------------------------------------------------------------------------
# The section ``provenance`` of a robot file: which recorded samples its parameters were fitted to.
#
# It is written by ``rrrgen identify`` and used by ``rrrgen experiment validate`` only.
# ------------------------------------------------------------------------------------------------------------------

_KEYS = {key.name: key for key in FIT}


def read_provenance(node: Node, faults: FaultList) -> tuple[FitSpec, ...]:
    """Read the section ``provenance``: one entry per fit; faults are added to ``faults``."""
    items = read_list(node, "provenance", None, faults) or []
    if len(items) > MAX_FITS:
        faults.error(node, f"provenance has {len(items)} fits", f"at most {MAX_FITS}")
        return ()
    fits = [_read_fit(item, f"fit {number} of provenance", faults) for number, item in enumerate(items, start=1)]
    return tuple(fit for fit in fits if fit is not None)


def _read_fit(node: Node, what: str, faults: FaultList) -> FitSpec | None:
    values = read_section(node, "fit", what, faults, ROBOT_FILE)
    if values is None or "fingerprint" not in values or "windows" not in values or "method" not in values:
        return None  # whose fault has been recorded
    method = read_choice(values["method"], _KEYS["method"], faults)
    windows = _whole_number(values["windows"], f"windows of {what}", faults)
    hashes = _read_hashes(values["fingerprint"], f"the fingerprint of {what}", faults)
    texts = {
        name: read_text(values[name], name, faults) for name in ("program", "recordings", "data") if name in values
    }
    if method is None or windows is None or hashes is None:
        return None
    if windows < len(hashes):
        faults.error(values["windows"], f"windows of {what} is {windows}, fewer than its {len(hashes)} hashes")
        return None
    return FitSpec(hashes, windows, **texts)


def _whole_number(node: Node, what: str, faults: FaultList) -> int | None:
    if isinstance(node, ScalarNode) and re.fullmatch(r"\d{1,15}", node.text):
        return int(node.text)
    faults.error(node, f"{what} is {describe(node)}, not a whole number")
    return None


def _read_hashes(node: Node, what: str, faults: FaultList) -> tuple[int, ...] | None:
    """Read a list of lines, each with one or more hexadecimal hashes; all hashes must be in rising order."""
    lines = read_list(node, what, None, faults)
    if lines is None:
        return None
    hashes: list[int] = []
    for line in lines:
        text = line.text if isinstance(line, ScalarNode) else ""
        if not text or len(text) % HASH_DIGITS or not re.fullmatch(r"[0-9a-f]+", text):
            shown = f"'{shorten(text, 20)}'" if text else describe(line)
            faults.error(
                line, f"{what} has the line {shown}", f"hashes of {HASH_DIGITS} hexadecimal digits, side by side"
            )
            return None
        hashes += [int(text[i : i + HASH_DIGITS], 16) for i in range(0, len(text), HASH_DIGITS)]
    if any(a >= b for a, b in pairwise(hashes)):
        faults.error(node, f"the hashes of {what} are not in rising order", "the section is written by rrrgen identify")
        return None
    return tuple(hashes)


# ------------------------------------------------------------------------------------------------------------------
# Reads the fixed transforms ``base`` and ``tool``.
# ------------------------------------------------------------------------------------------------------------------

ROTATION_TOLERANCE = 1e-9  # decimals of a rotation matrix must be orthonormal to this


def read_transform(node: Node, what: str, scope: Scope) -> FixedTransform | None:
    """Read ``{translation: [x, y, z]}`` with one of ``rpy: [r, p, y]`` and ``rotation: [[...], [...], [...]]``.

    ``rpy`` are rotations about the fixed axes x, y, z in this order: ``R = Rz(y) Ry(p) Rx(r)``. A fault and None if the
    rotation is not orthonormal or a reflection.
    """
    if isinstance(node, ScalarNode) and node.is_null:
        return FixedTransform()
    values = read_section(node, "transform", what, scope.faults, ROBOT_FILE)
    if values is None:
        return None
    translation: list[sp.Expr] | None = list(FixedTransform().translation)
    rotation: list[sp.Expr] | None = list(FixedTransform().rotation)
    if "translation" in values:
        translation = read_vector(values["translation"], f"translation of {what}", "length", scope, True)
    if "rpy" in values and "rotation" in values:
        scope.faults.error(values["rotation"], f"{what} has both rpy and rotation", "give one of them")
    elif "rpy" in values:
        angles = read_vector(values["rpy"], f"rpy of {what}", "angle", scope, True)
        rotation = None if angles is None else list(_rpy(*angles))
    elif "rotation" in values:
        rotation = _read_rotation(values["rotation"], f"rotation of {what}", scope)
    if translation is None or rotation is None:
        return None
    x, y, z = translation
    return FixedTransform(tuple(rotation), (x, y, z))


def read_tools(node: Node, scope: Scope) -> dict[str, FixedTransform]:
    """Read ``{name: transform, ...}``, the tools of a robot; one with a fault is left out."""
    tools = {}
    for name, (key, value) in (read_entries(node, "tools", scope.faults) or {}).items():
        if fault := name_fault(name, "tool"):
            scope.faults.error(key, *fault)
        elif (transform := read_transform(value, f"tool {name}", scope)) is not None:
            tools[name] = transform
    return tools


def read_tips(node: Node, robot: str, rows: Row[str], taken: Row[str], scope: Scope) -> dict[str, TipSpec]:
    """Read ``{name: {row: joint, tool: transform}, ...}``, the named tips of a robot; one with a fault is left out.

    ``rows`` are the names of the rows that may carry one, ``taken`` those of the tools, which share ``robot@name``. The
    functions of a tip begin with ``<robot>_<name>``, which must be a name itself.
    """
    tips = {}
    for name, (key, value) in (read_entries(node, "tips", scope.faults) or {}).items():
        if fault := name_fault(name, "tip") or (name_fault(f"{robot}_{name}", "robot") if robot else None):
            scope.faults.error(key, *fault)
            continue
        if name in taken:
            scope.faults.error(key, f"'{name}' names a tool too", f"robot@{name} can be one of them: rename the other")
        values = read_section(value, "tip", f"tip {name}", scope.faults, ROBOT_FILE)
        if values is None or "row" not in values:
            continue
        row = read_text(values["row"], f"row of tip {name}", scope.faults)
        tool = read_transform(values["tool"], f"tool of tip {name}", scope) if "tool" in values else FixedTransform()
        if row not in rows:
            hint = " ".join(part for part in (did_you_mean(row, rows), f"allowed are {', '.join(rows)}") if part)
            scope.faults.error(values["row"], f"row of tip {name} is '{row}'", hint)
        elif tool is not None:
            tips[name] = TipSpec(row, tool)
    return tips


def _rpy(roll: sp.Expr, pitch: sp.Expr, yaw: sp.Expr) -> sp.Matrix:
    (cr, sr), (cp, s_p), (cy, sy) = ((sp.cos(angle), sp.sin(angle)) for angle in (roll, pitch, yaw))
    x = sp.Matrix([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    y = sp.Matrix([[cp, 0, s_p], [0, 1, 0], [-s_p, 0, cp]])
    z = sp.Matrix([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
    return z * y * x


def _read_rotation(node: Node, what: str, scope: Scope) -> list[sp.Expr] | None:
    rows = read_list(node, what, 3, scope.faults)
    if rows is None:
        return None
    entries: list[sp.Expr | None] = []
    for i, row in enumerate(rows):
        items = read_list(row, f"row {i + 1} of {what}", 3, scope.faults)
        if items is None:
            return None
        entries += [
            read_value(item, f"entry {j} of row {i + 1} of {what}", "number", scope) for j, item in enumerate(items, 1)
        ]
    present = [entry for entry in entries if entry is not None]
    if len(present) != 9:
        return None
    R = [[float(scope.substitute(present[3 * i + j])) for j in range(3)] for i in range(3)]
    if fault := rotation_fault(R):
        scope.faults.error(node, f"{what} {fault[0]}", fault[1])
        return None
    return present


def rotation_fault(R: Row[Row[float]]) -> tuple[str, str] | None:
    """What is wrong with a rotation matrix (3, 3), as a predicate, and a hint; None if nothing is."""
    error = max(abs(sum(R[i][k] * R[j][k] for k in range(3)) - (i == j)) for i in range(3) for j in range(3))
    if error > ROTATION_TOLERANCE:
        hint = "write exact values such as sqrt(2)/2, or use rpy"
        return f"is not orthonormal: R R^T misses the unit matrix by {error:.1e}", hint
    determinant = sum(
        R[0][i] * (R[1][(i + 1) % 3] * R[2][(i + 2) % 3] - R[1][(i + 2) % 3] * R[2][(i + 1) % 3]) for i in range(3)
    )
    return ("is a reflection", "its determinant is -1 and must be +1") if determinant < 0 else None


# ------------------------------------------------------------------------------------------------------------------
# Reads a whole robot file into a RobotSpec
# ------------------------------------------------------------------------------------------------------------------

LARGEST_GRAVITY = 50  # m/s^2; twice that of Jupiter
_ROBOT = {key.name: key for key in ROBOT}
_UNITS = {key.name: key for key in UNITS}


def load_spec(robot: str | os.PathLike[str], *, strict: bool = False) -> RobotSpec:
    """Read a robot file, or a bundled robot by its name; with ``strict``, non-physical inertia is an error.

    ``robot@tool`` is the robot with one of its ``tools`` or ``tips``, and ``robot_tool`` its name. Raises
    :class:`InputError` with every fault.
    """
    name = os.fspath(robot)
    robot_name, at, tool = name.rpartition("@")
    if at and tool.isidentifier() and not Path(name).exists():
        return with_tool(load_spec(robot_name, strict=strict), tool)
    path = Path(name)
    if not path.suffix and path.name == name:  # a bare word is a bundled robot; ./word is a file
        added = None if name in bundled_names() else installed_path(name)
        if added is None and name not in bundled_names():
            hint = did_you_mean(name, bundled_names()) or f"bundled robots: {', '.join(bundled_names())}"
            raise InputError([Fault(name[:200], 0, 0, "there is no bundled robot of this name", hint=hint)])
        path = added or bundled_path(name)
    try:
        with path.open("rb") as stream:
            data = stream.read(MAX_BYTES + 1)
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
        raise InputError([Fault(name[:200], 0, 0, f"the file cannot be read: {reason}")]) from None
    return read_spec(decode(data, name), name, strict)


def with_tool(spec: RobotSpec, tool: str) -> RobotSpec:
    """Replace the tool of ``spec``, or its tip, by the one named ``tool``, and its name by ``<robot>_<tool>``.

    Raises :class:`InputError` where it has neither.
    """
    if tool not in spec.tools and tool not in spec.tips:
        known = [*spec.tools, *spec.tips]
        what = "tool or tip" if spec.tips else "tool"
        hint = did_you_mean(tool, known) or f"{what}s are {', '.join(known) or 'none: add them under tools'}"
        raise InputError([Fault(spec.file, 0, 0, f"the robot has no {what} '{tool}'", hint=hint)])
    name = f"{spec.name}_{tool}"
    if fault := name_fault(name, "robot"):
        raise InputError([Fault(spec.file, 0, 0, fault[0], hint=fault[1])])
    if tool in spec.tips:
        return replace(spec.at_tip(tool), name=name)
    return replace(spec, tool=spec.tools[tool], name=name)


def read_spec(text: str, file: str, strict: bool = False) -> RobotSpec:
    """Read a robot from YAML ``text``; ``file`` names it in messages. Raises :class:`InputError` with every fault."""
    spec = _read(text, file, strict)
    return replace(  # who changes a dictionary changes no robot that is read later
        spec,
        parameters=dict(spec.parameters),
        parameter_units=dict(spec.parameter_units),
        tools=dict(spec.tools),
        tips=dict(spec.tips),
    )


@lru_cache(maxsize=64)  # a process asks for the same robots again and again, which takes 20 ms each time
def _read(text: str, file: str, strict: bool) -> RobotSpec:
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
    if convention == "standard" and "joints" in values:
        refuse_placements(values["joints"], scope)
    fixed = fixed_rows(values["joints"], joints) if "joints" in values else []
    links = read_links(values["links"], fixed, strict, scope) if "links" in values else None
    whole_links: list[LinkSpec] | None = None if links is None else [link for link in links if link is not None]
    base = read_transform(values["base"], "base", scope) if "base" in values else FixedTransform()
    tool = read_transform(values["tool"], "tool", scope) if "tool" in values else FixedTransform()
    tools = read_tools(values["tools"], scope) if "tools" in values else {}
    counted: tuple[JointSpec | None, ...] = tuple(joints)
    mechanism = None
    names = [joint.name for joint in joints if joint is not None]
    known = [joint for joint in joints if joint is not None]
    loops = read_loops(values["loops"], known, scope) if "loops" in values and len(known) == len(joints) else {}
    if "joints" in values and all(joint is not None for joint in joints):
        closed = [loop for _, loop in loops.values()]
        counted, mechanism = read_mechanism(values["joints"], values.get("tip"), joints, scope, closed)
    tips = read_tips(values["tips"], name, names, list(tools), scope) if "tips" in values else {}
    if tips and mechanism is None and not faults.errors:
        hint = "tip: NAME; the joint whose link carries the tool while none of the tips is chosen"
        faults.error(values["tips"], "tips need the key 'tip'", hint)
    floating = None
    if "floating_base" in values:
        floating = read_floating_base(values["floating_base"], names, strict, scope)
        _refuse_beside_floating_base(values, scope)
    if floating is not None and not faults.errors and whole_links is not None:
        driven = tuple(joint for joint in counted if joint is not None)
        counted, mechanism = on_floating_base(floating[0], driven, mechanism)
        whole_links = [floating[1], *whole_links]
    drives = read_drives(values["drives"], counted, scope) if "drives" in values else None
    basis = read_basis(values["basis"], len(joints), whole_links, scope) if "basis" in values and joints else None
    emit = read_choices(values["emit"], _ROBOT["emit"], faults) if "emit" in values else ()
    ik = read_choice(values["ik"], _ROBOT["ik"], faults) if "ik" in values else None
    provenance = read_provenance(values["provenance"], faults) if "provenance" in values else ()
    description, source = (read_text(values[k], k, faults) if k in values else "" for k in ("description", "source"))
    if faults.errors or gravity is None or base is None or tool is None:
        return None
    spec = RobotSpec(
        name=name,
        convention=cast(Convention, convention),
        gravity=gravity,
        parameters=dict(scope.nominal),
        joints=tuple(joint for joint in counted if joint is not None),
        links=None if whole_links is None else tuple(whole_links),
        base=base,
        tool=tool,
        tools=tools,
        tips=tips,
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
        floating_base=floating is not None,
    )
    _check_loops(spec, {name: key for name, (key, _) in loops.items()}, faults)
    return spec


def _check_loops(spec: RobotSpec, keys: dict[str, ScalarNode], faults: FaultList) -> None:
    """Report a loop of ``spec`` that cannot be solved, at its key of the section ``loops``."""
    if not spec.loops:
        return
    try:
        build_model(spec)
    except LoopError as error:
        faults.error(keys[error.name], f"loop '{error.name}': {error.message}", error.hint)


def _refuse_beside_floating_base(values: dict[str, Node], scope: Scope) -> None:
    """Report the keys of a file that have no meaning beside ``floating_base``, and missing links."""
    hints = {
        "base": "the frame of the base is that of its body: place the first rows by their parameters",
        "basis": "leave it out: the compiler chooses the base parameters of a floating base",
        "loops": "put the mechanism on a fixed base, or let its rows follow each other: follows",
    }
    for key, hint in hints.items():
        if key in values:
            scope.faults.error(values[key], f"a robot with a floating base has no {key}", hint)
    if "links" not in values:
        hint = "describe every link under links"
        scope.faults.error(values["floating_base"], "floating_base states inertia, and the file has no links", hint)


def _read_name(node: Node | None, scope: Scope) -> str:
    if node is None:
        return ""
    if not isinstance(node, ScalarNode):
        scope.faults.error(node, f"name is {describe(node)}, not a word", "letters, digits and _")
        return ""
    if fault := name_fault(node.text, "robot"):
        scope.faults.error(node, *fault)
    return node.text


def _read_units(node: Node | None, faults: FaultList) -> FileUnits:
    """Read the key ``units``, the units of bare numbers; report once if it does not state one of them."""
    values = read_section(node, "units", "units", faults, ROBOT_FILE) if node is not None else None
    written = {key: read_text(value, key, faults) for key, value in (values or {}).items()}
    if node is not None and _has_swapped_units(written):
        hint = f"write units: {{angle: {written['length']}, length: {written['angle']}}}"
        faults.error(node, "the units of angle and length are swapped", hint)
        return FileUnits(missing=frozenset(_UNITS))
    chosen = {key: read_choice(value, _UNITS[key], faults) for key, value in (values or {}).items()}
    missing = frozenset(key for key in _UNITS if chosen.get(key) is None)
    return FileUnits(chosen.get("angle") or "rad", chosen.get("length") or "m", missing)


def _has_swapped_units(written: dict[str, str]) -> bool:
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
