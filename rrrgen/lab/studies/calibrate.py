"""Geometric calibration of a robot from measurements of its tip: its options, the study and its result."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rrrgen.lab.studies.options import StudyOptions, option, with_changes
from rrrgen.lab.studies.results import FigureMaker, FittedResult, Run

if TYPE_CHECKING:
    from rrrgen.base.arrays import Array
    from rrrgen.lab.calibrate.estimation import Calibration
    from rrrgen.lab.calibrate.measurements import Measurements
    from rrrgen.lab.data.run_folder import RunFolder
    from rrrgen.lab.studies.sources import FindingsCallback, ProgressCallback, RobotSource
    from rrrgen.robot.spec import RobotSpec

POSTURES = 1000
"""Number of random postures at which the error of the tip is predicted."""


@dataclass(frozen=True)
class CalibrateOptions(StudyOptions):
    """Options of a calibration."""

    sigma: float = option(5e-5, "Standard deviation of a measured length.", unit="m", above=0, shown=True)
    sigma_angle: float = option(1e-4, "Standard deviation of a measured angle.", unit="rad", above=0, shown=True)
    gains: bool = option(False, "Estimate a gain of each joint too: errors of gear ratios and scales.")
    robust: bool = option(False, "Set outliers aside: Huber's weights, then Tukey's.")
    seed: int = option(
        0,
        "Seed of the random postures, at which the error of the tip is predicted, or among which poses are chosen.",
        least=0,
        shown=True,
        recorded=False,
    )


@dataclass(frozen=True, eq=False, repr=False)
class CalibrationResult(FittedResult):
    """The result of :func:`rrrgen.calibrate`: changes of the geometric parameters, and the errors that stay.

    ``names``, ``values``, ``std`` and ``units`` are those of the changes of the parameters that the measurements tell
    apart; ``notes`` says why the others were left as they are. ``calibration`` holds geometry, covariance and
    residuals, ``measured`` the measurements, ``postures`` (N, n) the joint positions at which the error of the tip is
    predicted, ``source`` where the numbers come from.
    """

    robot: RobotSpec
    calibration: Calibration
    measured: Measurements
    postures: Array
    source: str

    @property
    def spec(self) -> RobotSpec:
        """The calibrated robot, ready for :func:`rrrgen.compile`."""
        from rrrgen.lab.calibrate.robot_file import calibrated_spec

        return calibrated_spec(self.robot, self.calibration.geometry, self.source)

    def lines(self, width: int | None = None) -> list[str]:
        """The report: errors before and after, whether to trust them, and the parameters."""
        from rrrgen.lab.calibrate.report import to_text

        return to_text(self.calibration, self.measured, self.postures).splitlines()

    def to_json(self) -> dict[str, Any]:
        """Parameters, errors and outliers as plain data, in m and rad."""
        from rrrgen.lab.calibrate.report import to_data

        return to_data(self.calibration, self.measured, self.postures)

    def figures(self) -> dict[str, FigureMaker]:
        """The figure ``errors``: every measurement before and after, and every parameter with its deviation."""
        from rrrgen.lab.calibrate.report import plot_residuals

        return {"errors": lambda: plot_residuals(self.calibration, self.measured)}

    def robot_file(self) -> str:
        """The text of the calibrated robot file."""
        from rrrgen.robot.file import dumps

        return dumps(self.spec)

    def write(self, folder: RunFolder) -> None:
        """Write ``calibration.json``, ``robot.yaml`` and the figure ``errors`` into an open run folder."""
        folder.write_json("calibration.json", self.to_json())
        folder.write_text("robot.yaml", self.robot_file())
        folder.figure("errors", self.plot())


def calibrate(
    robot: RobotSource,
    measurements: str | os.PathLike[str] | Mapping[str, Any],
    options: CalibrateOptions | None = None,
    *,
    folder: str | os.PathLike[str] | None = None,
    fresh: bool = False,
    progress: ProgressCallback | None = None,
    findings: FindingsCallback | None = None,
    **changes: Any,
) -> CalibrationResult:
    """Calibrate the geometry of a robot from measured poses, points, distances, heights or contacts.

    Of all geometric parameters a minimal set is estimated. The world frame is that of the measuring device; base and
    tool are estimated too.

    Args:
        robot: name of a bundled robot, robot file, ``RobotSpec`` or compiled model.
        measurements: a CSV file with a column for every joint and columns of what was measured, or arrays by name:
            joint positions ``q`` (N, n) and ``poses`` (N, 4, 4), or ``q`` and those columns, such as ``x``, ``y``,
            ``z`` (N,), in m and rad.
        options: a :class:`CalibrateOptions`; the default options if None.
        folder: run folder to write to; without, nothing is written.
        fresh: discard the run that the folder holds.
        progress: called as ``progress(done, total, message)``; total is 0 where the end is not known.
        findings: called with warnings of the robot file.
        changes: single options by name, such as ``robust=True``.

    Raises:
        InputError: robot, measurements or options cannot be used, or the measurements are not of this robot; an
            OptionError for the options.
        DerivationError: the measurements do not determine the geometry.
    """
    chosen = with_changes(CalibrateOptions, options, changes)
    from rrrgen.lab.calibrate.diagnosis import estimate_checked
    from rrrgen.lab.calibrate.geometry import geometry_of
    from rrrgen.lab.calibrate.measurements import read_table, table_of_arrays
    from rrrgen.lab.calibrate.minimal_set import random_positions
    from rrrgen.lab.studies.sources import hash_of_arrays, ignore, robot_input

    arm = robot_input(robot, findings or ignore)
    joints = [joint.name for joint in arm.spec.joints]
    nominal = geometry_of(arm.spec)
    if chosen.gains:
        nominal = nominal.with_gains()
    files, settings = dict(arm.files), {**chosen.settings(), **arm.settings}
    if isinstance(measurements, Mapping):
        table = table_of_arrays(measurements, joints)
        settings["arrays"] = [*table.labels, hash_of_arrays({",".join(table.names): table.values})]
    else:
        table = read_table(Path(measurements), joints)
        files["measurements"] = Path(measurements)
    measured = table.measurements(chosen.sigma, chosen.sigma_angle)
    (progress or ignore)(0, 0, "estimating the geometry")
    calibration = estimate_checked(nominal, measured, table, chosen.robust)
    result = CalibrationResult(
        tuple(entry.name for entry in calibration.chosen.kept),
        calibration.change,
        calibration.deviation,
        tuple(entry.unit for entry in calibration.chosen.kept),
        tuple(f"{name}: {reason}" for name, reason in calibration.chosen.left_out.items()),
        arm.spec,
        calibration,
        measured,
        random_positions(arm.spec, POSTURES, chosen.seed),
        f"calibrated from {len(measured.q)} measurements ({measured.kind}) of {table.path.name}",
        run=Run("calibrate", files, settings, chosen.seed),
    )
    return result.run.result(lambda _: result, folder, fresh)
