"""Diagnosis of measurements that do not belong to the robot: usual mistakes are undone one at a time and compared.

A calibration whose residuals stay above centimetres or degrees has not failed for noise. The table of the file is read
again without each of the usual mistakes (:mod:`rrrgen.lab.calibrate.mistakes`), and base and tool alone are fitted to
it, twelve numbers at most. So a few poses tell the right reading, off by the millimetres of the nominal table, from
wrong ones, off by decimetres; all parameters of a calibration would follow any measurements. A mistake is named only if
its residuals are clearly the smallest; where several fit alike, all of them are.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from rrrgen.base.errors import DerivationError, Fault, InputError
from rrrgen.base.option_names import option_name
from rrrgen.lab.calibrate.estimation import USED, Calibration, calibrate, fitted_ends, largest_consensus
from rrrgen.lab.calibrate.geometry import Geometry, rotation_vectors
from rrrgen.lab.calibrate.measurement_file import MeasurementTable
from rrrgen.lab.calibrate.measurements import Measurements
from rrrgen.lab.calibrate.minimal_set import UnreachableError
from rrrgen.lab.calibrate.mistakes import Mistake, mistakes

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
    found = None
    with suppress(UnreachableError):
        found = calibrate(nominal, measured, robust)
    if found is not None and robust:
        _check_majority(found, nominal, measured, table)
    belongs = found is not None and _belongs(found, nominal, measured)
    if found is not None and belongs and (found.outliers or _reading(nominal, measured).fits):
        return found
    hint = _cause(nominal, measured, table)
    if found is not None:
        if belongs and hint is None:
            return found
        rms = float(np.sqrt(np.mean(np.sum(found.residuals[:, :3] ** 2, axis=1))))
        message = f"the measurements do not fit this robot: errors of {1e3 * rms:.0f} mm (rms) stay after calibration"
        hint = hint or _outliers(found, nominal, measured, robust)
    usual = "compare units, the order of columns and of rotations, signs and zeros of the joints"
    usual += "" if measured.kind in ("pose", "point") else ", the base of the robot file with the measuring device"
    raise InputError([Fault(str(table.path), table.places[0], 1, message, hint=hint or usual)])


def _check_majority(found: Calibration, nominal: Geometry, measured: Measurements, table: MeasurementTable) -> None:
    """Refuse the result of robust estimation if fewer than half of the measurements fit together."""
    if found.chi2_per_dof > CROWDED and (said := _minority(found, nominal, measured)):
        hint = "find what spoils the others; robust estimation needs more than half good ones"
        raise InputError([Fault(str(table.path), table.places[0], 1, said, hint=hint)])


def _minority(found: Calibration, nominal: Geometry, measured: Measurements) -> str | None:
    """How many measurements fit together, in words; None if that is half of them, or too few to be a group."""
    count, every = largest_consensus(nominal, measured, found), len(measured.q)
    if count >= every / 2 or count * found.residuals.shape[1] <= len(found.chosen.kept):
        return None
    return f"only {count} of {every} measurements ({100 * count / every:.0f} %) fit together within the stated noise"


def _belongs(found: Calibration, nominal: Geometry, measured: Measurements) -> bool:
    """Whether residuals, per degree of freedom, and corrected lengths are small against the arm."""
    used = found.residuals[found.weights >= USED]
    squares = np.mean(used**2, axis=0) * used.size / max(1, used.size - len(found.chosen.kept))
    reach = _reach(nominal, measured)
    longer = float(np.max(np.abs(found.geometry.rows - nominal.rows)[:, 1:3]))
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
    residuals, count = fitted_ends(nominal, measured, steps)
    T = nominal.forward(measured.q)
    p, R = T[:, :3, 3], T[:, :3, :3]
    moved = 2 * float(np.sqrt(np.mean(np.sum((p - p.mean(axis=0)) ** 2, axis=1))))
    turned = float(np.sqrt(np.mean(np.sum(rotation_vectors(R @ R[0].T) ** 2, axis=1))))
    scale = np.full(residuals.shape[1], LARGE * min(_reach(nominal, measured), moved))
    scale[3:] = LARGE_ANGLE * min(1.0, turned)
    scale = np.maximum(scale, 1e-12)
    freedom = residuals.size - count
    return Reading(float(np.sum((residuals / scale) ** 2)) * min(3, len(scale)) / max(1, freedom), freedom)


def _outliers(found: Calibration, nominal: Geometry, measured: Measurements, robust: bool) -> str | None:
    """What robust estimation makes of the measurements; None if no group of them fits even then."""
    try:
        trial = found if robust else calibrate(nominal, measured, robust=True, steps=STEPS)
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
    best = min((reading for _, reading in tried), key=lambda each: each.square, default=None)
    if best is None or not best.fits or _reading(nominal, measured).as_good_as(best):
        return None
    alike = [mistake for mistake, reading in tried if reading.as_good_as(best)]
    if len(alike) == 1:
        return f"they fit with {alike[0].text}" + (f": {alike[0].remedy}" if alike[0].remedy else "")
    if len(alike) > NAMED:
        return f"they fit with each of {len(alike)} usual mistakes, and cannot tell which: measure more, farther apart"
    return f"they fit with {', or with '.join(each.text for each in alike)}: these measurements cannot tell which"
