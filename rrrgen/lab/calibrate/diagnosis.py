"""Diagnosis of measurements that do not belong to the robot: usual mistakes are undone one at a time and compared.

A calibration whose residuals stay above centimetres or degrees has not failed for noise. The table of the file is read
again without each of the usual mistakes (:mod:`rrrgen.lab.calibrate.diagnosis`), and base and tool alone are fitted to
it, twelve numbers at most. So a few poses tell the right reading, off by the millimetres of the nominal table, from
wrong ones, off by decimetres; all parameters of a calibration would follow any measurements. A mistake is named only if
its residuals are clearly the smallest; where several fit alike, all of them are.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import combinations, permutations, product

import numpy as np

from rrrgen.base.arrays import Array
from rrrgen.base.errors import DerivationError, Fault, InputError, option_name
from rrrgen.lab.calibrate.estimation import USED, Calibration, calibrate, fit_ends, largest_consensus
from rrrgen.lab.calibrate.geometry import Geometry, rotation, rotation_vectors
from rrrgen.lab.calibrate.measurements import ANGLES, POSITION, QUATERNION, Measurements, MeasurementTable
from rrrgen.lab.calibrate.minimal_set import UnreachableError

# ------------------------------------------------------------------------------------------------------------------
# Usual mistakes in files of measurements, each with the table that the file should have held.
# ------------------------------------------------------------------------------------------------------------------

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
    """Units of joint angles, of sliding joints, of lengths, and of measured angles, alone and together."""
    names, joints = table.names, table.joints
    turning = [j for j, turns in zip(joints, nominal.turning(), strict=True) if turns]
    sliding = [j for j in joints if j not in turning]
    lengths = [k for k, name in enumerate(names) if name in (*POSITION, "distance", "height") and k not in joints]
    angles = [k for k, name in enumerate(names) if name in ANGLES and k not in joints and table.kind == "pose"]
    rad = [("deg", np.pi / 180, ""), ("rad", 180 / np.pi, "deg")]
    m = [("mm", 1e-3, ""), ("inches", INCH, ""), ("m", 1e3, "mm")]
    present = [
        [(what, columns, *conversion) for conversion in units]
        for what, columns, units in (
            ("joint positions", turning, rad),
            ("sliding joints", sliding, m),
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
        yield Mistake(f"the columns {names[i]} and {names[j]} exchanged", "", _move_columns(table, (i, j), (j, i)))
    if len(joints) > 3:  # the reverse order of three is an exchange
        yield Mistake("the joint columns in the reverse order", "", _move_columns(table, joints, joints[::-1]))
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
        yield Mistake(text, "", _move_columns(table, places[:2], places[1::-1]))
        return
    for order in permutations(range(3)):
        for signs in product((1, -1), repeat=3):
            if order == (0, 1, 2) and signs == (1, 1, 1):
                continue
            values = table.values.copy()
            values[:, places] = table.values[:, [places[k] for k in order]] * np.array(signs)
            yield Mistake(_describe_order(order, signs), "", replace(table, values=values))


def _describe_order(order: tuple[int, ...], signs: tuple[int, ...]) -> str:
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
        yield Mistake(
            "the four numbers in the order qx qy qz qw", remedy, _move_columns(table, (x, y, z, w), (w, x, y, z))
        )
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
            _move_columns(table, places, [places[k] for k in order]),
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


def _move_columns(
    table: MeasurementTable, to: list[int] | tuple[int, ...], source: list[int] | tuple[int, ...]
) -> MeasurementTable:
    """Columns ``to`` get the numbers of the columns ``source``."""
    values: Array = table.values.copy()
    values[:, list(to)] = table.values[:, list(source)]
    return replace(table, values=values)


# ------------------------------------------------------------------------------------------------------------------
# Diagnosis of measurements that do not belong to the robot
# ------------------------------------------------------------------------------------------------------------------

LARGE = 0.03
"""Share of the distance from base to tip above which the rms residual of lengths cannot be noise or tolerance."""
LARGE_ANGLE = 0.1
"""The same for rms residuals of orientations, rad."""
LONGER = 0.2
"""Share of the distance from base to tip above which the correction of a length is none."""
MENDED = 1e3
"""Chi^2 per degree of freedom of what is left without outliers; more is another mistake."""
CROWDED = 100.0
"""Chi^2 per degree of freedom after robust estimation, above which a minority of good measurements is looked for: the
stated noise would be ten times too small."""
CLEARLY = 9.0
"""Ratio of the mean squares of two readings above which the smaller one is right, for many degrees of freedom. With f
of them the ratio is ``CLEARLY (1 + 10 / f)``, which normal errors exceed with a probability below 1e-3 from f = 6."""
STEPS = 12
"""Steps in which a fit of base and tool comes to the millimetres of the table."""
FIRST_STEPS, HOPELESS = 3, 400.0
"""Readings whose mean square is this many times the least one after the first steps are not followed further."""
NAMED = 4
"""Largest number of mistakes that fit alike and are all named."""


@dataclass(frozen=True)
class Reading:
    """How well measurements fit a robot by its base and tool alone.

    ``square`` is the mean square of residuals per degree of freedom, lengths over ``LARGE`` reaches, angles over
    ``LARGE_ANGLE``; ``freedom`` is the number of these degrees.
    """

    square: float
    freedom: int

    @property
    def fits(self) -> bool:
        """Whether the residuals can be noise and the tolerance of the table."""
        return self.freedom > 0 and self.square < 1.0

    def as_good_as(self, other: Reading) -> bool:
        """Whether these residuals do not exceed ``other`` by more than chance."""
        least = max(1, min(self.freedom, other.freedom))
        return self.square <= CLEARLY * (1 + 10 / least) * other.square


def estimate_checked(
    nominal: Geometry, measured: Measurements, table: MeasurementTable, robust: bool = False
) -> Calibration:
    """Calibrate, and refuse measurements that do not belong to the robot.

    Raises :class:`InputError`, with the mistake if it is found, and what :func:`calibrate` raises.
    """
    message = "the robot does not reach most of the measured values from where its base stands"
    calibration = None
    with suppress(UnreachableError):
        calibration = calibrate(nominal, measured, robust)
    if calibration is not None and robust:
        _check_majority(calibration, nominal, measured, table)
    belongs = calibration is not None and _belongs(calibration, nominal, measured)
    if calibration is not None and belongs and (calibration.outliers or _reading(nominal, measured).fits):
        return calibration
    hint = _cause(nominal, measured, table)
    if calibration is not None:
        if belongs and hint is None:
            return calibration
        rms = float(np.sqrt(np.mean(np.sum(calibration.residuals[:, :3] ** 2, axis=1))))
        message = f"the measurements do not fit this robot: errors of {1e3 * rms:.0f} mm (rms) stay after calibration"
        hint = hint or _outliers(calibration, nominal, measured, robust)
    usual = "compare units, the order of columns and of rotations, signs and zeros of the joints"
    usual += "" if measured.kind in ("pose", "point") else ", the base of the robot file with the measuring device"
    raise InputError([Fault(str(table.path), table.places[0], 1, message, hint=hint or usual)])


def _check_majority(
    calibration: Calibration, nominal: Geometry, measured: Measurements, table: MeasurementTable
) -> None:
    """Refuse the result of robust estimation if fewer than half of the measurements fit together."""
    if calibration.chi2_per_dof > CROWDED and (said := _minority(calibration, nominal, measured)):
        hint = "find what spoils the others; robust estimation needs more than half good ones"
        raise InputError([Fault(str(table.path), table.places[0], 1, said, hint=hint)])


def _minority(calibration: Calibration, nominal: Geometry, measured: Measurements) -> str | None:
    """How many measurements fit together, in words; None if that is half of them, or too few to be a group."""
    count, every = largest_consensus(nominal, measured, calibration), len(measured.q)
    if count >= every / 2 or count * calibration.residuals.shape[1] <= len(calibration.chosen.kept):
        return None
    return f"only {count} of {every} measurements ({100 * count / every:.0f} %) fit together within the stated noise"


def _belongs(calibration: Calibration, nominal: Geometry, measured: Measurements) -> bool:
    """Whether residuals, per degree of freedom, and corrected lengths are small against the arm."""
    used = calibration.residuals[calibration.weights >= USED]
    squares = np.mean(used**2, axis=0) * used.size / max(1, used.size - len(calibration.chosen.kept))
    reach = _reach(nominal, measured)
    longer = float(np.max(np.abs(calibration.geometry.rows - nominal.rows)[:, 1:3]))
    lengths, angles = np.sqrt(np.sum(squares[:3])), np.sqrt(np.sum(squares[3:]))
    return bool(lengths < LARGE * reach and angles < LARGE_ANGLE and longer < LONGER * reach)


def _reach(nominal: Geometry, measured: Measurements) -> float:
    p = nominal.forward(measured.q)[:, :3, 3] - nominal.base[:3, 3]
    return float(np.max(np.linalg.norm(p, axis=1)))


def _reading(nominal: Geometry, measured: Measurements, steps: int = STEPS) -> Reading:
    """Fit base, tool and fixtures to the measurements; raises what the fit raises.

    Residuals count relative to how far the tip moves, too: where units are mistaken such that nothing moves, base and
    tool fit anything.
    """
    residuals, count = fit_ends(nominal, measured, steps)
    T = nominal.forward(measured.q)
    p, R = T[:, :3, 3], T[:, :3, :3]
    moved = 2 * float(np.sqrt(np.mean(np.sum((p - p.mean(axis=0)) ** 2, axis=1))))
    turned = float(np.sqrt(np.mean(np.sum(rotation_vectors(R @ R[0].T) ** 2, axis=1))))
    scale = np.full(residuals.shape[1], LARGE * min(_reach(nominal, measured), moved))
    scale[3:] = LARGE_ANGLE * min(1.0, turned)
    scale = np.maximum(scale, 1e-12)
    freedom = residuals.size - count
    return Reading(float(np.sum((residuals / scale) ** 2)) * min(3, len(scale)) / max(1, freedom), freedom)


def _outliers(calibration: Calibration, nominal: Geometry, measured: Measurements, robust: bool) -> str | None:
    """What robust estimation makes of the measurements; None if no group of them fits even then."""
    try:
        trial = calibration if robust else calibrate(nominal, measured, robust=True, steps=STEPS)
    except DerivationError:
        return None
    if trial.outliers and _belongs(trial, nominal, measured) and trial.chi2_per_dof < MENDED:
        return f"{option_name('robust')} sets {len(trial.outliers)} of them aside as outliers; the others fit"
    return _minority(trial, nominal, measured)


def _cause(nominal: Geometry, measured: Measurements, table: MeasurementTable) -> str | None:
    """The mistakes that, undone, leave the smallest residuals; None if none of them explains the measurements."""
    rough: list[tuple[Mistake, Measurements, Reading]] = []
    for mistake in mistakes(table, nominal):
        try:
            again = mistake.table.measurements(measured.sigma, measured.sigma_angle)
            rough.append((mistake, again, _reading(nominal, again, FIRST_STEPS)))
        except (DerivationError, InputError, np.linalg.LinAlgError):
            continue
    least = min((reading.square for *_, reading in rough), default=0.0)
    likely = [(mistake, again) for mistake, again, reading in rough if reading.square <= HOPELESS * least]
    tried = [(mistake, _reading(nominal, again)) for mistake, again in likely]
    best = min((reading for _, reading in tried), key=lambda reading: reading.square, default=None)
    if best is None or not best.fits or _reading(nominal, measured).as_good_as(best):
        return None
    alike = [mistake for mistake, reading in tried if reading.as_good_as(best)]
    if len(alike) == 1:
        return f"they fit with {alike[0].text}" + (f": {alike[0].remedy}" if alike[0].remedy else "")
    if len(alike) > NAMED:
        return f"they fit with each of {len(alike)} usual mistakes, and cannot tell which: measure more, farther apart"
    return f"they fit with {', or with '.join(mistake.text for mistake in alike)}: these measurements cannot tell which"
