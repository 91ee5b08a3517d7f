"""Reads the fixed transforms ``base`` and ``tool``."""

from __future__ import annotations

import sympy as sp

from rrrgen.base.yamltext.document import Node, Scalar
from rrrgen.base.yamltext.sections import read_entries, read_list, read_section
from rrrgen.robot.file.fields import ROBOT_FILE
from rrrgen.robot.file.quantities import Scope, read_value, read_vector
from rrrgen.robot.names import name_fault
from rrrgen.robot.robot_spec import FixedTransform

ROTATION_TOLERANCE = 1e-9  # decimals of a rotation matrix must be orthonormal to this


def read_transform(node: Node, what: str, scope: Scope) -> FixedTransform | None:
    """Read ``{translation: [x, y, z]}`` with one of ``rpy: [r, p, y]`` and ``rotation: [[...], [...], [...]]``.

    ``rpy`` are rotations about the fixed axes x, y, z in this order: ``R = Rz(y) Ry(p) Rx(r)``. A fault and None if the
    rotation is not orthonormal or a reflection.
    """
    if isinstance(node, Scalar) and node.is_null:
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
    error = max(abs(sum(R[i][k] * R[j][k] for k in range(3)) - (i == j)) for i in range(3) for j in range(3))
    if error > ROTATION_TOLERANCE:
        hint = "write exact values such as sqrt(2)/2, or use rpy"
        scope.faults.error(node, f"{what} is not orthonormal: R R^T misses the unit matrix by {error:.1e}", hint)
        return None
    determinant = sum(
        R[0][i] * (R[1][(i + 1) % 3] * R[2][(i + 2) % 3] - R[1][(i + 2) % 3] * R[2][(i + 1) % 3]) for i in range(3)
    )
    if determinant < 0:
        scope.faults.error(node, f"{what} is a reflection", "its determinant is -1 and must be +1")
        return None
    return present
