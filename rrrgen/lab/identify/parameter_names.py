"""Units and meaning of the identified parameters, for tables and figures."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from rrrgen.base.arrays import Array
from rrrgen.lab.estimate.structure import combination
from rrrgen.robot.model.inertial_parameters import standard_names

if TYPE_CHECKING:
    from rrrgen.lab.estimate.structure import Structure
    from rrrgen.lab.identify.estimated_terms import Column

NEGLIGIBLE = 1e-9  # weights below this share of the largest are round-off of the projection
DIGITS = 4
UNITS = ("kg", "kg m", "kg m^2")
DRIVE_UNITS = {
    "inertia": ("kg m^2", "kg"),
    "viscous": ("N m s/rad", "N s/m"),
    "coulomb": ("N m", "N"),
    "offset": ("N m", "N"),
}
MEANING = {
    "inertia": "Ia: inertia of the drive, at the joint",
    "viscous": "fv: viscous friction",
    "coulomb": "fc: Coulomb friction",
    "offset": "off: constant torque",
}
STANDARD = (
    "m, mx..mz, Ixx..Izz: mass, first moments and inertia tensor (Ixy = -int xy dm) of a link, "
    "about the origin and in the axes of its frame"
)
WORD = re.compile(r"\w+")


def column_unit(column: Column, weights: Array, revolute: Sequence[bool]) -> str:
    """SI unit of the parameter of one column.

    ``weights`` (10 n,) express a base parameter in standard parameters. Masses and first moments in it are multiplied
    by lengths, so that the unit is that of the term of highest order: kg, kg m or kg m^2. ``revolute`` (n,) gives the
    type of each joint, for drive parameters.
    """
    if column.kind != "rigid":
        turning = all(revolute[i] for i, weight in enumerate(column.direction) if weight)
        if column.kind == "law":
            return column.unit if turning else column.unit.replace("N m", "N").replace("rad", "m")
        return DRIVE_UNITS[column.kind][0 if turning else 1]
    present = np.abs(weights) > NEGLIGIBLE * np.max(np.abs(weights), initial=0.0)
    orders = [_order(name) for name, there in zip(standard_names(len(weights) // 10), present, strict=True) if there]
    return UNITS[max(orders, default=0)]


def _order(name: str) -> int:
    return 2 if name.startswith("I") else 1 if name[1] in "xyz" else 0


def identified_units(
    structure: Structure, columns: Sequence[Column], free: Sequence[int], model: Any
) -> tuple[str, ...]:
    """SI units of the identifiable combinations in ``structure``, whose columns are ``free`` among ``columns``.

    A combination is a sum of parameters times powers of lengths, such as mass times length squared; its unit is that of
    the term with the highest power of length in its own unit: kg m^2 before kg m before kg.
    """
    joints = () if model.spec is None else model.spec.joints  # a model of equations alone has revolute joints
    revolute = [joint.is_revolute for joint in joints] or [True] * model.n
    K = np.asarray(model.base_projection)
    b = len(K)
    each = [column_unit(columns[k], K[k] if k < b else np.zeros(0), revolute) for k in free]
    found = []
    for row in structure.G:
        units = [unit for unit, weight in zip(each, row, strict=True) if weight != 0.0]
        found.append(max(units, key=lambda unit: UNITS.index(unit) if unit in UNITS else 3))
    return tuple(found)


def explained_names(names: Sequence[str], columns: Sequence[Column], model: Any) -> tuple[str, ...]:
    """Lines that explain the parameter ``names``: each kind of parameter once, and base parameters the user named."""
    used = {word for name in names for word in WORD.findall(name)}
    K = np.asarray(model.base_projection)
    standard = standard_names(K.shape[1] // 10)
    lines = []
    for name, weights in zip(model.base_parameter_names, K, strict=False):
        known = np.where(np.abs(weights) > NEGLIGIBLE * np.max(np.abs(weights), initial=0.0), weights, 0.0)
        words = combination(standard, known, DIGITS)
        if name in used and words != name:
            lines.append(f"{name} = {words}")
    own = used & set(standard) or lines
    kinds = [kind for kind in MEANING if any(column.kind == kind and column.name in used for column in columns)]
    told = dict.fromkeys(f"{column.parameter}: {column.meaning}" for column in columns if column.kind == "law")
    return (*([STANDARD] if own else []), *(MEANING[kind] for kind in kinds), *told, *lines)
