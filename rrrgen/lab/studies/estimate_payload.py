"""Estimation of a payload on a known arm: its options, the study and its result."""

from __future__ import annotations

import os
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

from rrrgen.base.errors import require
from rrrgen.lab.studies.options import PreprocessingOptions, StudyOptions, group, option, with_changes
from rrrgen.lab.studies.results import FittedResult, Run

if TYPE_CHECKING:
    from rrrgen.lab.data.preprocessing import Processing
    from rrrgen.lab.data.run_folder import RunFolder
    from rrrgen.lab.identify.payload import Payload
    from rrrgen.lab.studies.sources import (
        FindingsCallback,
        ProgressCallback,
        RecordingInputs,
        RecordingSources,
        RobotInput,
        RobotSource,
    )
    from rrrgen.robot.spec import RobotSpec


@dataclass(frozen=True)
class PayloadOptions(StudyOptions):
    """Options of the estimation of a payload."""

    preprocessing: PreprocessingOptions = group(PreprocessingOptions)
    keep_friction: bool = option(False, "Take friction as the robot file states it instead of correcting it too.")


@dataclass(frozen=True, eq=False, repr=False)
class PayloadResult(FittedResult):
    """The result of :func:`rrrgen.estimate_payload`: mass, centre of mass and inertia in the frame of the last link.

    ``payload`` also holds the torque errors with and without it, and the values that the motion does not determine.
    """

    robot: RobotSpec
    payload: Payload

    @property
    def spec(self) -> RobotSpec:
        """The robot with the payload as a part of its last link, ready for :func:`rrrgen.compile`."""
        return self.payload.carried_by(self.robot)

    def lines(self, width: int | None = None) -> list[str]:
        """The report: the values with their deviations, torque errors, filters."""
        return [*self.payload.lines(), *self.payload.tuning.sentences()]

    def to_json(self) -> dict[str, Any]:
        """The content of ``payload.json``."""
        from rrrgen.lab.data.run_folder import plain_record

        return plain_record(self.payload.to_json())

    def write(self, folder: RunFolder) -> None:
        """Write ``payload.json``, and ``robot.yaml`` with the payload, into an open run folder."""
        from rrrgen.robot.file import dumps

        folder.write_json("payload.json", self.to_json())
        folder.write_text("robot.yaml", dumps(self.spec))


def estimate_payload(
    robot: RobotSource,
    recordings: RecordingSources,
    options: PayloadOptions | None = None,
    *,
    folder: str | os.PathLike[str] | None = None,
    fresh: bool = False,
    progress: ProgressCallback | None = None,
    findings: FindingsCallback | None = None,
    skip_truncated_line: bool = False,
    **changes: Any,
) -> PayloadResult:
    """Estimate mass, centre of mass and inertia of a payload at the last link of a known arm.

    Half a minute of a motion in which the last joints move through many directions of gravity is enough. Samples near
    rest are left out.

    Args:
        robot: name of a bundled robot, robot file, ``RobotSpec`` or compiled model; its links must be known.
        recordings: a recording or mapping file, a ``Log``, arrays by name, or a list of these, as for
            :func:`rrrgen.identify`, with the payload.
        options: a :class:`PayloadOptions`; the default options if None.
        folder: run folder to write to; without, nothing is written.
        fresh: discard the run that the folder holds.
        progress: called as ``progress(done, total, message)``; total is 0 where the end is not known.
        findings: called with warnings of the robot file and repairs of every recording.
        skip_truncated_line: leave out the last line of a text file if it is incomplete.
        changes: single options by name, such as ``keep_friction=True``.

    Raises:
        InputError: robot, recordings or options cannot be used; an OptionError for the options.
        DerivationError: no payload explains the torques, or the motion does not determine its mass.
    """
    chosen = with_changes(PayloadOptions, options, changes)
    require("rrrgen experiment payload", "scipy", "cvxpy", "clarabel")
    from rrrgen.lab.studies.sources import chosen_processing, ignore, recording_inputs, robot_input

    findings, progress = findings or ignore, progress or ignore
    arm = robot_input(robot, findings)
    logs = recording_inputs(recordings, arm.spec, skip_truncated_line=skip_truncated_line)
    processing = chosen_processing(logs.mappings, chosen.preprocessing)
    settings = {**processing.settings(), **chosen.settings(), "skip_truncated_line": skip_truncated_line}
    run = Run("payload", arm.files | logs.files, settings | arm.settings | logs.settings)
    return run.result(partial(_estimate, run, arm, logs, processing, chosen, progress, findings), folder, fresh)


def _estimate(
    run: Run,
    arm: RobotInput,
    logs: RecordingInputs,
    processing: Processing,
    chosen: PayloadOptions,
    progress: ProgressCallback,
    findings: FindingsCallback,
    _: RunFolder | None,
) -> PayloadResult:
    from rrrgen.lab.identify.payload import NAMES, UNITS, identify_payload
    from rrrgen.lab.studies.sources import tell_causes

    progress(0, 0, "estimating the payload")
    recordings = logs.open(findings)
    tell_causes(arm.spec, recordings, findings)
    payload = identify_payload(arm.model, recordings, processing, not chosen.keep_friction)
    return PayloadResult(NAMES, payload.values, payload.std, UNITS, payload.notes, arm.spec, payload, run=run)
