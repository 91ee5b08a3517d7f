"""Diagnosis of measurements that do not belong to the robot: usual mistakes are undone one after the other.

A calibration whose residuals stay above centimetres or degrees has not failed for noise. The table of the file is read
again with other units, columns exchanged, or joints reversed; what then fits is named.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import combinations

import numpy as np

from rrrgen.arrays import Array
from rrrgen.calibrate.estimation import USED, Calibration, calibrate
from rrrgen.calibrate.geometry import Geometry
from rrrgen.calibrate.measurement_file import ANGLES, POSITION, QUATERNION, MeasurementTable
from rrrgen.calibrate.measurements import Measurements
from rrrgen.calibrate.minimal_set import UnreachableError
from rrrgen.errors import DerivationError, Fault, InputError

LARGE = 0.03
"""Share of the distance from base to tip above which the rms residual of lengths cannot be noise or tolerance."""
LARGE_ANGLE = 0.1
"""The same for rms residuals of orientations, rad."""
LONGER = 0.2
"""Share of the distance from base to tip above which the correction of a length is none."""
TELLING = 1e4
"""Condition number above which poses vary too little to tell one mistake from another."""
TRIED = 12
"""Number of steps to see whether measurements fit; five do where they are right."""
CLEAR = 30.0
"""Chi^2 per degree of freedom below which a mistake is taken for the cause, and no other one tried."""
MENDED = 1e3
"""Chi^2 per degree of freedom of what is left without outliers; more is another mistake."""


def estimate_checked(
    nominal: Geometry, measured: Measurements, table: MeasurementTable, robust: bool = False
) -> Calibration:
    """Calibrate, and refuse measurements that do not belong to the robot.

    Raises :class:`InputError`, with the mistake if it is found, and what :func:`calibrate` raises.
    """
    message = "the robot does not reach most of the measured values from where its base stands"
    spoilt = None
    try:
        found = calibrate(nominal, measured, robust)
        if _belongs(found, nominal, measured):
            return found
        rms = float(np.sqrt(np.mean(np.sum(found.residuals[:, :3] ** 2, axis=1))))
        message = f"the measurements do not fit this robot: errors of {1e3 * rms:.0f} mm (rms) stay after calibration"
        spoilt = None if robust else _outliers(nominal, measured)
    except UnreachableError:
        pass
    usual = "compare units, the order of columns and of rotations, signs and zeros of the joints"
    usual += "" if measured.kind in ("pose", "point") else ", the base of the robot file with the measuring device"
    hint = spoilt or _cause(nominal, measured, table) or usual
    raise InputError([Fault(str(table.path), table.places[0], 1, message, hint=hint)])


def _belongs(found: Calibration, nominal: Geometry, measured: Measurements) -> bool:
    """Whether residuals and corrected lengths are small against the arm."""
    squares = np.mean(found.residuals[found.weights >= USED] ** 2, axis=0)
    p = nominal.forward(measured.q)[:, :3, 3] - nominal.base[:3, 3]
    reach = float(np.max(np.linalg.norm(p, axis=1)))
    longer = float(np.max(np.abs(found.geometry.rows - nominal.rows)[:, 1:3]))
    lengths, angles = np.sqrt(np.sum(squares[:3])), np.sqrt(np.sum(squares[3:]))
    return bool(lengths < LARGE * reach and angles < LARGE_ANGLE and longer < LONGER * reach)


def _outliers(nominal: Geometry, measured: Measurements) -> str | None:
    """What robust estimation makes of the measurements; None if most of them do not fit even then."""
    trial = calibrate(nominal, measured, robust=True, steps=TRIED)
    if trial.outliers and _belongs(trial, nominal, measured) and trial.chi2_per_dof < MENDED:
        return f"--robust sets {len(trial.outliers)} of them aside as outliers; the others fit"
    return None


def _cause(nominal: Geometry, measured: Measurements, table: MeasurementTable) -> str | None:
    """The mistake that, undone, leaves the smallest residuals; None if they stay large in all cases."""
    best, cause = np.inf, None
    for text, other in _mistakes(table, nominal):
        try:
            again = other.measurements(measured.sigma, measured.sigma_angle)
            trial = calibrate(nominal, again, steps=TRIED)
        except (DerivationError, InputError, np.linalg.LinAlgError):
            continue
        if trial.chi2_per_dof < best and trial.condition < TELLING and _belongs(trial, nominal, again):
            best, cause = trial.chi2_per_dof, text
            if best < CLEAR:
                break
    return cause


def _mistakes(table: MeasurementTable, nominal: Geometry) -> Iterator[tuple[str, MeasurementTable]]:
    """Usual mistakes in words, with the table that the file should have held."""
    names, joints = table.names, table.joints
    turning = [j for j, turns in zip(joints, nominal.turning(), strict=True) if turns]
    lengths = [k for k, name in enumerate(names) if name in (*POSITION, "distance", "height") and k not in joints]
    angles = [k for k, name in enumerate(names) if name in ANGLES and k not in joints and table.kind == "pose"]
    units = [
        ("joint positions", "deg", "rad", turning, np.pi / 180),
        ("lengths", "mm", "m", lengths, 1e-3),
        ("rotation angles", "deg", "rad", angles, np.pi / 180),
    ]
    present = [each for each in units if each[3]]
    for some in (part for count in range(1, len(present) + 1) for part in combinations(present, count)):
        header = ", ".join(f"{names[columns[0]]} [{unit}]" for _, unit, _, columns, _ in some)
        text = " and ".join(f"{what} in {unit}" for what, unit, _, _, _ in some)
        factors = [(columns, factor) for _, _, _, columns, factor in some]
        yield f"they fit with {text}: write units in the header, as in {header}", _scaled(table, factors)
        text = " and ".join(f"{what} in {si}, not {unit}" for what, unit, si, _, _ in some)
        factors = [(columns, 1 / factor) for columns, factor in factors]
        yield f"they fit with {text}: correct the units in the header", _scaled(table, factors)
    for i, j in combinations(joints, 2):
        yield f"they fit with the columns {names[i]} and {names[j]} exchanged", _exchanged(table, (i, j), (j, i))
    for i, joint in enumerate(joints):
        if table.values[:, joint].any():
            text = f"they fit with {names[joint]} reversed: 'sign: -1' at joint {i + 1} of the robot file"
            yield text, _scaled(table, [([joint], -1.0)])
    places = {name: k for k, name in enumerate(names)}
    for one, two in (("x", "y"), ("y", "z"), ("x", "z"), ("roll", "yaw")):
        if {one, two} <= set(table.wanted):
            i, j = places[one], places[two]
            yield f"they fit with the columns {one} and {two} exchanged", _exchanged(table, (i, j), (j, i))
    if set(QUATERNION) <= set(table.wanted):
        w, x, y, z = (places[name] for name in QUATERNION)
        text = "they fit if the four numbers are in the order qx qy qz qw: change the header"
        yield text, _exchanged(table, (x, y, z, w), (w, x, y, z))


def _scaled(table: MeasurementTable, factors: list[tuple[list[int], float]]) -> MeasurementTable:
    """Multiply columns by factors."""
    values = table.values.copy()
    for columns, factor in factors:
        values[:, columns] *= factor
    return replace(table, values=values)


def _exchanged(table: MeasurementTable, to: tuple[int, ...], source: tuple[int, ...]) -> MeasurementTable:
    """Columns ``to`` get the numbers of the columns ``source``."""
    values: Array = table.values.copy()
    values[:, list(to)] = table.values[:, list(source)]
    return replace(table, values=values)
