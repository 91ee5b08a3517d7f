"""Calibration file of a Universal Robots arm: YAML lists ``dh_theta``, ``dh_a``, ``dh_d``, ``dh_alpha``.

They are standard Denavit-Hartenberg parameters in rad and m; joint angles are added to ``dh_theta``. The calibrated
axes of shoulder and elbow are nearly parallel, so their common perpendicular may lie hundreds of metres away, and
``dh_d`` then has values of that size.
"""

from __future__ import annotations

import math
import re

import numpy as np
import sympy as sp

from rrrgen.base.yamltext.document import FaultList, Node, ScalarNode, describe, parse_document
from rrrgen.base.yamltext.expressions import ExpressionError, parse_expression
from rrrgen.base.yamltext.fields import read_entries, read_list
from rrrgen.robot.file.quantities import held_fault, held_number
from rrrgen.robot.importers.interface import Found, Importer, Source
from rrrgen.robot.spec import JointSpec, RobotSpec

ANGLES = ("dh_theta", "dh_alpha")
TURN = 6.2832  # rad; a turn, rounded up
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
    far = _tip_distance(columns)
    if far > FAR:
        hint = f"lengths are in m, and distances of far-off frames cancel; no arm of the make reaches {FAR} m"
        faults.error(entries["dh_d"][1], f"the tip is {far:.4g} m from the base", hint)
        return None
    what = "gravity and inertial parameters are not in a calibration: an upright arm without links"
    faults.warning(root, what, "change gravity for another mounting; without links base parameters are an input")
    rows = zip(JOINTS, *(columns[key] for key in COLUMNS), strict=True)
    joints = tuple(
        JointSpec(name=name, type="revolute", alpha=alpha, a=a, d=d, theta=theta) for name, theta, a, d, alpha in rows
    )
    return Found(RobotSpec(name=source.name, convention="standard", gravity=UPRIGHT, parameters={}, joints=joints))


def _tip_distance(columns: dict[str, list[sp.Expr]]) -> float:
    """Distance (m) of the tip from the base at the angles ``dh_theta``."""
    T = np.eye(4)
    for theta, a, d, alpha in zip(*(map(float, columns[key]) for key in COLUMNS), strict=True):
        (c, s), (ca, sa) = ((np.cos(angle), np.sin(angle)) for angle in (theta, alpha))
        T = T @ [[c, -s * ca, s * sa, a * c], [s, c * ca, -c * sa, a * s], [0, sa, ca, d], [0, 0, 0, 1]]
    return float(np.linalg.norm(T[:3, 3]))


def _column(node: Node, key: str, faults: FaultList) -> list[sp.Expr]:
    items = read_list(node, key, len(JOINTS), faults)
    return [_value(item, key, faults) for item in items or ()]


def _value(node: Node, key: str, faults: FaultList) -> sp.Expr:
    if not isinstance(node, ScalarNode) or node.is_null:
        faults.error(node, f"an entry of {key} is {describe(node)}, not a number", "rad or m")
        return sp.S.Zero
    try:
        expr = parse_expression(node.text, units=False).expr
    except ExpressionError as error:
        faults.error(node, f"{key}: {error.message}", error.hint, error.offset)
        return sp.S.Zero
    if held_number(expr) is None:
        words, hint = held_fault(expr)
        faults.error(node, f"an entry of {key} {words}", hint)
        return sp.S.Zero
    if key not in ANGLES and not expr.is_rational:
        faults.error(node, f"an entry of {key} is {node.text}, not a decimal number", "lengths are in m")
        return sp.S.Zero
    number = float(expr)
    if key in ANGLES and abs(number) > TURN:
        hint = f"angles are in rad, at most a turn; {number:g} degrees are {math.radians(number):.6g}"
        faults.error(node, f"an entry of {key} is {number:g} rad", hint)
    if key == "dh_a" and abs(number) > FAR:
        hint = f"lengths are in m; {number:g} mm are {number / 1000:g}"
        faults.error(node, f"an entry of dh_a is {number:g} m, the distance of two axes of an arm", hint)
    return expr


IMPORTER = Importer(
    "ur-calibration",
    "Universal Robots calibration: YAML lists dh_theta, dh_a, dh_d, dh_alpha",
    (),
    lambda text: re.search(r"^\s*dh_theta\s*:", text, re.MULTILINE) is not None,
    _read,
)
