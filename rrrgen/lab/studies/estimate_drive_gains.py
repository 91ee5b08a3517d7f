"""Estimation of drive gains with a known payload: its options, the study and its result."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

from rrrgen.base.errors import InputError, require
from rrrgen.lab.studies.options import OptionError, PreprocessingOptions, StudyOptions, group, with_changes
from rrrgen.lab.studies.results import FittedResult, Run

if TYPE_CHECKING:
    from rrrgen.base.arrays import Array
    from rrrgen.lab.data.preprocessing import Processing
    from rrrgen.lab.data.run_folder import RunFolder
    from rrrgen.lab.identify.drive_gains import DriveGains
    from rrrgen.lab.studies.sources import (
        FindingsCallback,
        ProgressCallback,
        RecordingInputs,
        RecordingSources,
        RobotInput,
        RobotSource,
    )


@dataclass(frozen=True)
class DriveGainsOptions(StudyOptions):
    """Options of the estimation of drive gains."""

    preprocessing: PreprocessingOptions = group(PreprocessingOptions)


@dataclass(frozen=True, eq=False, repr=False)
class DriveGainsResult(FittedResult):
    """The result of :func:`rrrgen.estimate_drive_gains`: true over recorded torque, by joint.

    ``gains`` also says which gains the payload determines; a value that it does not is NaN.
    """

    gains: DriveGains

    def lines(self, width: int | None = None) -> list[str]:
        """The report: gains with their deviations, torque errors, filters."""
        return [*self.gains.lines(), *self.gains.tuning.sentences()]

    def to_json(self) -> dict[str, Any]:
        """The content of ``drive_gains.json``."""
        from rrrgen.lab.data.run_folder import plain_record

        return plain_record(self.gains.to_json())

    def write(self, folder: RunFolder) -> None:
        """Write ``drive_gains.json`` into an open run folder."""
        folder.write_json("drive_gains.json", self.to_json())


def estimate_drive_gains(
    robot: RobotSource,
    empty: RecordingSources,
    loaded: RecordingSources,
    options: DriveGainsOptions | None = None,
    *,
    mass: float,
    com: Sequence[float] = (0.0, 0.0, 0.0),
    inertia: Sequence[float] = (0.0,) * 6,
    folder: str | os.PathLike[str] | None = None,
    fresh: bool = False,
    progress: ProgressCallback | None = None,
    findings: FindingsCallback | None = None,
    skip_truncated_line: bool = False,
    **changes: Any,
) -> DriveGainsResult:
    """Estimate unknown drive gains (torque constants) from recordings without and with a known payload.

    The masses of the robot are not used: all parameters of the arm are estimated too, in the units of the payload.

    Args:
        robot: name of a bundled robot, robot file, ``RobotSpec`` or compiled model.
        empty: recordings without the payload: a recording or mapping file, a ``Log``, arrays by name, or a list of
            these, as for :func:`rrrgen.identify`.
        loaded: recordings with the payload, alike.
        options: a :class:`DriveGainsOptions`; the default options if None.
        mass: mass of the payload, kg.
        com: its centre of mass (3,) in the frame of the last link, m.
        inertia: its inertia tensor (6,) about the centre of mass in the axes of that frame, xx yy zz xy xz yz, kg m^2;
            by default it is a point mass.
        folder: run folder to write to; without, nothing is written.
        fresh: discard the run that the folder holds.
        progress: called as ``progress(done, total, message)``; total is 0 where the end is not known.
        findings: called with warnings of the robot file and repairs of every recording.
        skip_truncated_line: leave out the last line of a text file if it is incomplete.
        changes: single options by name, such as ``decimate=5``.

    Raises:
        InputError: robot, recordings or options cannot be used; an OptionError for the options.
        DerivationError: no gains explain the torques, or the payload tells none of them.
    """
    chosen = with_changes(DriveGainsOptions, options, changes)
    require("rrrgen experiment drive-gains", "scipy")
    import numpy as np
    import sympy as sp

    from rrrgen.lab.identify.rows import standard_of
    from rrrgen.lab.studies.sources import chosen_processing, ignore, recording_inputs, robot_input, shared_recording
    from rrrgen.robot.file.links import physical_fault
    from rrrgen.robot.spec import LinkSpec

    if not (mass > 0.0 and math.isfinite(mass)):
        raise OptionError(f"{{mass}} is {mass:g} kg, but must be finite and above 0 kg", "mass")
    point, tensor = np.array(com, float), np.array(inertia, float)
    for name, values, size in (("com", point, 3), ("inertia", tensor, 6)):
        if values.shape != (size,):
            raise OptionError(f"{{{name}}} has the shape {values.shape}, not ({size},)", name)
        if not np.isfinite(values).all():
            raise OptionError(f"{{{name}}} is {values.tolist()}, not {size} finite numbers", name)
    x, y, z, *moments = (sp.Rational(repr(float(value))) for value in (*point, *tensor))
    # about the centre of mass as given: moved to the origin, rounding would make a point mass impossible
    if fault := physical_fault(LinkSpec(sp.Rational(repr(float(mass))), (x, y, z), tuple(moments), about="com")):
        raise OptionError(f"no body has this {{inertia}}: {fault}", "inertia")
    findings, progress = findings or ignore, progress or ignore
    arm = robot_input(robot, findings)
    logs, carrying = (
        recording_inputs(recordings, arm.spec, skip_truncated_line=skip_truncated_line, role=role)
        for recordings, role in ((empty, "log"), (loaded, "loaded"))
    )
    if shared := shared_recording(logs, carrying):
        raise InputError(f"{shared} is given twice, without and with the payload: the gains follow from the difference")
    processing = chosen_processing([*logs.mappings, *carrying.mappings], chosen.preprocessing)
    settings = processing.settings() | {"mass": mass, "com": point, "inertia": tensor}
    settings |= {"skip_truncated_line": skip_truncated_line, **arm.settings}
    arrays = logs.settings.get("arrays", {}) | carrying.settings.get("arrays", {})
    run = Run("drive-gains", arm.files | logs.files | carrying.files, settings | ({"arrays": arrays} if arrays else {}))
    body = standard_of(mass, point, tensor)
    return run.result(partial(_estimate, run, arm, logs, carrying, body, processing, progress, findings), folder, fresh)


def _estimate(
    run: Run,
    arm: RobotInput,
    logs: RecordingInputs,
    carrying: RecordingInputs,
    body: Array,
    processing: Processing,
    progress: ProgressCallback,
    findings: FindingsCallback,
    _: RunFolder | None,
) -> DriveGainsResult:
    import numpy as np

    from rrrgen.lab.identify.drive_gains import identify_gains
    from rrrgen.lab.studies.sources import tell_causes

    progress(0, 0, "estimating drive gains")
    empty, loaded = logs.open(findings), carrying.open(findings)
    tell_causes(arm.spec, [*empty, *loaded], findings)
    drive_gains = identify_gains(arm.model, empty, loaded, body, processing)
    gain, std = (np.where(drive_gains.determined, values, np.nan) for values in (drive_gains.gain, drive_gains.std))
    return DriveGainsResult(drive_gains.joints, gain, std, ("",) * len(gain), drive_gains.notes, drive_gains, run=run)
