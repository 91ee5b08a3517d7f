"""Usual mistakes in files of measurements, each with the table that the file should have held."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import combinations, permutations, product

import numpy as np

from rrrgen.base.arrays import Array
from rrrgen.lab.calibrate.geometry import Geometry, rotation
from rrrgen.lab.calibrate.measurement_file import ANGLES, POSITION, QUATERNION, MeasurementTable

INCH = 0.0254


@dataclass(frozen=True)
class Mistake:
    """A mistake: ``text`` continues "the measurements fit with", ``table`` is without it, ``remedy`` may be empty."""

    text: str
    remedy: str
    table: MeasurementTable


def mistakes(table: MeasurementTable, nominal: Geometry) -> Iterator[Mistake]:
    """Mistakes of units, of joint columns, of positions, and of orientations, one at a time."""
    yield from _units(table, nominal)
    yield from _joints(table)
    if set(POSITION) <= set(table.wanted):
        yield from _positions(table)
    if table.kind == "pose":
        yield from _orientations(table)


def _units(table: MeasurementTable, nominal: Geometry) -> Iterator[Mistake]:
    """Units of joint angles, of lengths, and of measured angles, alone and together."""
    names, joints = table.names, table.joints
    turning = [j for j, turns in zip(joints, nominal.turning(), strict=True) if turns]
    lengths = [k for k, name in enumerate(names) if name in (*POSITION, "distance", "height") and k not in joints]
    angles = [k for k, name in enumerate(names) if name in ANGLES and k not in joints and table.kind == "pose"]
    rad = [("deg", np.pi / 180, ""), ("rad", 180 / np.pi, "deg")]
    m = [("mm", 1e-3, ""), ("inches", INCH, ""), ("m", 1e3, "mm")]
    present = [
        [(what, columns, *each) for each in units]
        for what, columns, units in (
            ("joint positions", turning, rad),
            ("lengths", lengths, m),
            ("rotation angles", angles, rad),
        )
        if columns
    ]
    for several in (part for count in range(1, len(present) + 1) for part in combinations(present, count)):
        for some in product(*several):
            text = " and ".join(f"{what} in {unit}" for what, _, unit, _, _ in some)
            if any(false for *_, false in some):
                remedy = "correct the units in the header"
            elif any(unit == "inches" for _, _, unit, _, _ in some):
                remedy = "convert inches to mm or m"
            else:
                remedy = (
                    f"write units in the header, as in {', '.join(f'{names[c[0]]} [{u}]' for _, c, u, _, _ in some)}"
                )
            values = table.values.copy()
            for _, columns, _, factor, _ in some:
                values[:, columns] *= factor
            yield Mistake(text, remedy, replace(table, values=values))


def _joints(table: MeasurementTable) -> Iterator[Mistake]:
    """Joint columns exchanged or in the reverse order; one, two or all joints reversed."""
    joints, names = list(table.joints), table.names
    for i, j in combinations(joints, 2):
        yield Mistake(f"the columns {names[i]} and {names[j]} exchanged", "", _moved(table, (i, j), (j, i)))
    if len(joints) > 3:  # the reverse order of three is an exchange
        yield Mistake("the joint columns in the reverse order", "", _moved(table, joints, joints[::-1]))
    turned = [some for count in {1, 2, len(joints)} for some in combinations(range(len(joints)), count)]
    for some in turned:
        columns = [joints[i] for i in some]
        if len(some) <= len(joints) and table.values[:, columns].any(axis=0).all():
            values = table.values.copy()
            values[:, columns] *= -1.0
            said = "all joints" if len(some) == len(joints) > 1 else " and ".join(names[c] for c in columns)
            remedy = f"'sign: -1' at joint {', '.join(str(i + 1) for i in some)} of the robot file"
            yield Mistake(f"{said} reversed", remedy, replace(table, values=values))


def _positions(table: MeasurementTable) -> Iterator[Mistake]:
    """The columns x, y, z exchanged and reversed; without orientations all mirrored positions are alike."""
    places = [table.names.index(name) for name in POSITION]
    if table.kind == "point":
        text = "mirrored positions (two of the columns x, y, z exchanged, or one reversed: positions do not tell which)"
        yield Mistake(text, "", _moved(table, places[:2], places[1::-1]))
        return
    for order in permutations(range(3)):
        for signs in product((1, -1), repeat=3):
            if order == (0, 1, 2) and signs == (1, 1, 1):
                continue
            values = table.values.copy()
            values[:, places] = table.values[:, [places[k] for k in order]] * np.array(signs)
            yield Mistake(_said(order, signs), "", replace(table, values=values))


def _said(order: tuple[int, ...], signs: tuple[int, ...]) -> str:
    """Describe in words that the columns x, y, z of positions stand in ``order``, with reversed ``signs``."""
    still = [k for k in range(3) if order[k] == k]
    moved = [POSITION[k] for k in range(3) if order[k] != k]
    parts = []
    if len(still) == 1:
        parts.append(f"the columns {' and '.join(moved)} exchanged")
    elif not still:
        parts.append(f"the columns x, y, z in the order {', '.join(POSITION[order.index(k)] for k in range(3))}")
    turned = [POSITION[k] for k in range(3) if signs[k] < 0]
    if turned:
        parts.append(f"{' and '.join(turned)} reversed")
    return " and ".join(parts)


def _orientations(table: MeasurementTable) -> Iterator[Mistake]:
    """Other orders and conventions of quaternions and angles, and transforms in the other direction."""
    if set(QUATERNION) <= set(table.wanted):
        w, x, y, z = (table.names.index(name) for name in QUATERNION)
        remedy = "change the header"
        yield Mistake("the four numbers in the order qx qy qz qw", remedy, _moved(table, (x, y, z, w), (w, x, y, z)))
        values = table.values.copy()
        values[:, [x, y, z]] *= -1.0
        yield Mistake("rotations in the other direction", "reverse qx, qy, qz", replace(table, values=values))
        return
    places = [table.names.index(name) for name in ANGLES]
    angles = table.values[:, places]
    for order in list(permutations(range(3)))[1:]:
        said = ", ".join(ANGLES[order.index(k)] for k in range(3))
        yield Mistake(
            f"the angle columns in the order {said}",
            "change the header",
            _moved(table, places, [places[k] for k in order]),
        )
    for text, matrices in _CONVENTIONS.items():
        values = table.values.copy()
        values[:, places] = [_roll_pitch_yaw(matrices(row)) for row in angles]
        yield Mistake(
            text, "convert them to Rz(yaw) Ry(pitch) Rx(roll), or to quaternions", replace(table, values=values)
        )


def _about(axes: str) -> Callable[[Array], Array]:
    """The rotation by three angles about the coordinate ``axes``, each about the axis as the one before turned it."""

    def product_of(angles: Array) -> Array:
        one, two, three = (rotation(angle * np.eye(3)["xyz".index(a)]) for angle, a in zip(angles, axes, strict=True))
        return np.asarray(one @ two @ three)

    return product_of


_CONVENTIONS: dict[str, Callable[[Array], Array]] = {
    "angles of Rx(roll) Ry(pitch) Rz(yaw)": _about("xyz"),
    "Euler angles of Rz Ry Rz in the columns' order": _about("zyz"),
    "Euler angles of Rz Rx Rz in the columns' order": _about("zxz"),
    "the three numbers of a rotation vector": rotation,
    "rotations in the other direction": lambda angles: _about("zyx")(angles[::-1]).T,
}


def _roll_pitch_yaw(R: Array) -> list[float]:
    """The angles of ``R = Rz(yaw) Ry(pitch) Rx(roll)``."""
    pitch = np.arctan2(-R[2, 0], np.hypot(R[0, 0], R[1, 0]))
    return [float(np.arctan2(R[2, 1], R[2, 2])), float(pitch), float(np.arctan2(R[1, 0], R[0, 0]))]


def _moved(
    table: MeasurementTable, to: list[int] | tuple[int, ...], source: list[int] | tuple[int, ...]
) -> MeasurementTable:
    """Columns ``to`` get the numbers of the columns ``source``."""
    values: Array = table.values.copy()
    values[:, list(to)] = table.values[:, list(source)]
    return replace(table, values=values)
