"""Estimation of elastic joints: its options, the study and its result."""

from __future__ import annotations

import os
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, Literal

from rrrgen.base.errors import InputError, require
from rrrgen.lab.studies.options import StudyOptions, option, with_changes
from rrrgen.lab.studies.results import FittedResult, Run

if TYPE_CHECKING:
    from rrrgen.lab.data.run_folder import RunFolder
    from rrrgen.lab.identify.elastic_joints import ElasticJoints
    from rrrgen.lab.studies.sources import (
        FindingsCallback,
        ProgressCallback,
        RecordingInputs,
        RecordingSources,
        RobotInput,
        RobotSource,
    )


@dataclass(frozen=True)
class ElasticJointsOptions(StudyOptions):
    """Options of the estimation of elastic joints."""

    bandwidth: float | None = option(
        None,
        "Bandwidth of the filters; by default the one at which the stiffnesses have the smallest relative deviations.",
        unit="Hz",
        above=0.0,
    )
    torques: Literal["held", "smooth"] = option(
        "held",
        "Whether the drives hold their torques between two samples of the recording, as those of a sampled controller "
        "do, or the recorded torques change smoothly.",
        shown=True,
    )


@dataclass(frozen=True, eq=False, repr=False)
class ElasticJointsResult(FittedResult):
    """The result of :func:`rrrgen.estimate_elastic_joints`: stiffness, damping, rotor inertia and friction by joint.

    ``elastic`` also holds the base parameters of the links, the torque errors with and without elasticity, and lower
    bounds for joints in whose torques none shows; their values are NaN.
    """

    elastic: ElasticJoints

    @property
    def trusted(self) -> bool:
        """Whether the model explains the torques of all joints."""
        return not self.elastic.unexplained.any()

    def lines(self, width: int | None = None) -> list[str]:
        """The report: values with their deviations, torque errors, what to write into the robot file."""
        return self.elastic.lines()

    def to_json(self) -> dict[str, Any]:
        """The content of ``elastic_joints.json``."""
        from rrrgen.lab.data.run_folder import plain_record

        return plain_record(self.elastic.to_json())

    def write(self, folder: RunFolder) -> None:
        """Write ``elastic_joints.json`` into an open run folder."""
        folder.write_json("elastic_joints.json", self.to_json())


def estimate_elastic_joints(
    robot: RobotSource,
    recordings: RecordingSources,
    options: ElasticJointsOptions | None = None,
    *,
    links: RecordingSources | None = None,
    folder: str | os.PathLike[str] | None = None,
    fresh: bool = False,
    progress: ProgressCallback | None = None,
    findings: FindingsCallback | None = None,
    skip_truncated_line: bool = False,
    **changes: Any,
) -> ElasticJointsResult:
    """Estimate stiffness, damping and rotor inertia of the joints, with the parameters of the links, from recordings.

    The masses of the robot are not used. The motion must go through many postures and be excited up to the resonances,
    for example by a multisine that is added to the torques; ten seconds are enough if the noise is small.

    Args:
        robot: name of a bundled robot, robot file, ``RobotSpec`` or compiled model.
        recordings: positions at the motors, seen at the joints, and torques: a recording or mapping file, a ``Log``,
            arrays by name, or a list of these, as for :func:`rrrgen.identify`.
        options: an :class:`ElasticJointsOptions`; the default options if None.
        links: recordings of the positions of the links at the same times, where there are encoders at the links.
        folder: run folder to write to; without, nothing is written.
        fresh: discard the run that the folder holds.
        progress: called as ``progress(done, total, message)``; total is 0 where the end is not known.
        findings: called with warnings of the robot file and repairs of every recording.
        skip_truncated_line: leave out the last line of a text file if it is incomplete.
        changes: single options by name, such as ``bandwidth=60``.

    Raises:
        InputError: robot, recordings or options cannot be used; an OptionError for the options.
        DerivationError: no joint shows that it is elastic.
    """
    chosen = with_changes(ElasticJointsOptions, options, changes)
    require("rrrgen experiment elastic-joints", "scipy")
    from rrrgen.lab.studies.sources import ignore, recording_inputs, robot_input, shared_recording

    findings, progress = findings or ignore, progress or ignore
    arm = robot_input(robot, findings)
    logs = recording_inputs(recordings, arm.spec, skip_truncated_line=skip_truncated_line)
    beside = None
    if links is not None:
        beside = recording_inputs(links, arm.spec, skip_truncated_line=skip_truncated_line, role="link")
        if shared := shared_recording(logs, beside):
            raise InputError(f"{shared} is given twice, as the positions at the motors and at the links: these differ")
    both = [logs] if beside is None else [logs, beside]
    settings = {**chosen.settings(), "skip_truncated_line": skip_truncated_line, **arm.settings}
    arrays = {key: value for inputs in both for key, value in inputs.settings.get("arrays", {}).items()}
    files = arm.files | {role: path for inputs in both for role, path in inputs.files.items()}
    run = Run("elastic-joints", files, settings | ({"arrays": arrays} if arrays else {}))
    return run.result(partial(_estimate, run, arm, logs, beside, chosen, progress, findings), folder, fresh)


def _estimate(
    run: Run,
    arm: RobotInput,
    logs: RecordingInputs,
    beside: RecordingInputs | None,
    chosen: ElasticJointsOptions,
    progress: ProgressCallback,
    findings: FindingsCallback,
    _: RunFolder | None,
) -> ElasticJointsResult:
    from rrrgen.lab.identify.elastic_joints import identify_elastic_joints
    from rrrgen.lab.studies.sources import tell_causes

    positions = () if beside is None else beside.load(findings)
    held, recordings = chosen.torques == "held", logs.load(findings)
    tell_causes(arm.spec, recordings, findings)
    elastic_joints = identify_elastic_joints(arm.model, recordings, positions, chosen.bandwidth, progress, held)
    names, units = elastic_joints.parameters(arm.spec)
    return ElasticJointsResult(
        names,
        elastic_joints.values.ravel(),
        elastic_joints.std.ravel(),
        units,
        elastic_joints.notes,
        elastic_joints,
        run=run,
    )
