"""Calibration file of a Universal Robots arm: YAML lists ``dh_theta``, ``dh_a``, ``dh_d``, ``dh_alpha``.

They are standard Denavit-Hartenberg parameters in rad and m; joint angles are added to ``dh_theta``. The calibrated
axes of shoulder and elbow are nearly parallel, so their common perpendicular may lie hundreds of metres away, and
``dh_d`` then has values of that size.
"""

from __future__ import annotations

import re

import sympy as sp

from rrrgen.robotfile.importers.interface import Found, Importer, Source
from rrrgen.robotfile.quantities import held_number
from rrrgen.robotfile.robot_spec import JointSpec, RobotSpec
from rrrgen.yamltext.document import FaultList, Node, Scalar, parse_document
from rrrgen.yamltext.expressions import ExpressionError, parse_expression
from rrrgen.yamltext.sections import describe, read_entries, read_list

COLUMNS = ("dh_theta", "dh_a", "dh_d", "dh_alpha")
JOINTS = ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")
FAR = 5  # m; beyond the reach of every arm of the make
UPRIGHT = (sp.S.Zero, sp.S.Zero, sp.Rational(-981, 100))


def _read(source: Source, faults: FaultList) -> Found | None:
    root = parse_document(source.text, faults)
    entries = read_entries(root, "the calibration", faults)
    if entries is None:
        return None
    for name in source.values:
        faults.error(None, f"--set {name}: a calibration has no names")
    for key, (place, _) in entries.items():
        if key not in COLUMNS:
            faults.warning(place, f"'{key}' is left out", "only the Denavit-Hartenberg lists are read")
    columns = {key: _column(entries[key][1], key, faults) for key in COLUMNS if key in entries}
    for key in COLUMNS:
        if key not in entries:
            faults.error(root, f"there is no list '{key}'", f"{key}: [...] with six values")
    if faults.errors:
        return None
    for name, node, d in zip(JOINTS, getattr(entries["dh_d"][1], "items", ()), columns["dh_d"], strict=True):
        if abs(d) > FAR:
            hint = "nearly parallel axes put frames far away; positions lose about 1e-16 of that distance"
            faults.warning(node, f"d of {name} is {float(d):g} m", hint)
    what = "gravity and inertial parameters are not in a calibration: an upright arm without links"
    faults.warning(root, what, "change gravity for another mounting; without links base parameters are an input")
    rows = zip(JOINTS, *(columns[key] for key in COLUMNS), strict=True)
    joints = tuple(
        JointSpec(name=name, type="revolute", alpha=alpha, a=a, d=d, theta=theta) for name, theta, a, d, alpha in rows
    )
    return Found(RobotSpec(name=source.name, convention="standard", gravity=UPRIGHT, parameters={}, joints=joints))


def _column(node: Node, key: str, faults: FaultList) -> list[sp.Expr]:
    items = read_list(node, key, len(JOINTS), faults)
    return [_value(item, key, faults) for item in items or ()]


def _value(node: Node, key: str, faults: FaultList) -> sp.Expr:
    if not isinstance(node, Scalar) or node.is_null:
        faults.error(node, f"an entry of {key} is {describe(node)}, not a number", "rad or m")
        return sp.S.Zero
    try:
        expr = parse_expression(node.text, units=False).expr
    except ExpressionError as error:
        faults.error(node, f"{key}: {error.message}", error.hint, error.offset)
        return sp.S.Zero
    if held_number(expr) is None:
        faults.error(node, f"an entry of {key} is no finite number", "division by zero, or too large?")
        return sp.S.Zero
    return expr


IMPORTER = Importer(
    "ur-calibration",
    "Universal Robots calibration: YAML lists dh_theta, dh_a, dh_d, dh_alpha",
    (),
    lambda text: re.search(r"^\s*dh_theta\s*:", text, re.MULTILINE) is not None,
    _read,
)
