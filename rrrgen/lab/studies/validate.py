"""Validation of a robot against recordings: its options, the study and its result."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rrrgen.base.errors import require, with_names
from rrrgen.lab.studies.options import OptionError, PreprocessingOptions, StudyOptions, group, option, with_changes
from rrrgen.lab.studies.results import FigureMaker, Run, StudyResult

if TYPE_CHECKING:
    from rrrgen.lab.closed_loop.validation import ClosedLoopValidation
    from rrrgen.lab.data.preprocessing import Processing
    from rrrgen.lab.data.run_folder import RunFolder
    from rrrgen.lab.identify.diagnosis.causes import Cause
    from rrrgen.lab.identify.held_out_data import Split
    from rrrgen.lab.identify.observations import Recording
    from rrrgen.lab.identify.scores import Common
    from rrrgen.lab.identify.validation import Validation
    from rrrgen.lab.studies.sources import (
        FindingsCallback,
        LoopInputs,
        ProgressCallback,
        RecordingInputs,
        RecordingSources,
        RobotInput,
        RobotSource,
    )
    from rrrgen.robot.spec import RobotSpec

NO_RECORDING = Path("none")
"""Value of ``fitted_on`` for a model that was not fitted to any recording."""


@dataclass(frozen=True)
class ValidateOptions(StudyOptions):
    """Options of a validation."""

    preprocessing: PreprocessingOptions = group(PreprocessingOptions)
    fitted_on: tuple[Path, ...] = option(
        (),
        "Recording the model was fitted to, if the robot file does not state it; repeat for several; or: none.",
    )
    relative_error: float = option(
        0.1, "Largest torque error that passes, as a share of the RMS torque.", above=0, shown=True
    )
    split: str = option(
        "none",
        "Score only the part that this split of `rrrgen identify` holds out: first:0.6, blocks:0.5, fold:2/5.",
        shown=True,
    )
    guard: float | None = option(
        None,
        "Guard band in seconds on both sides of every border of {split}; default: reach of the filters.",
        unit="s",
        least=0,
    )
    controller: Path | None = option(
        None,
        "Controller of the recorded loop: also score the torques of the loop simulated along the reference.",
        metavar="FILE",
        recorded=False,
    )
    require_held_out: bool = option(False, "Fail unless the recordings are known not to have been fitted.")


def plain_verdict(text: str, passed: bool) -> str:
    """The verdict as it stands."""
    return text


@dataclass(frozen=True, eq=False, repr=False)
class ValidationResult(StudyResult):
    """The result of :func:`rrrgen.validate`: torque errors, and a verdict.

    ``validation`` holds the scores and the torque curves, ``common`` the share of the samples that were fitted,
    ``closed_loop`` the scores of the simulated loop if a controller was given. ``origin_known`` tells that the robot or
    the options say what the robot was fitted to, ``by_loop`` that the limit holds for the simulated loop.
    """

    robot: RobotSpec
    recordings: tuple[Recording, ...]
    validation: Validation
    common: Common
    diagnoses: tuple[Cause, ...]
    closed_loop: ClosedLoopValidation | None
    origin_known: bool
    fingerprints_known: bool
    by_loop: bool

    @property
    def passed(self) -> bool:
        """Whether every threshold is met."""
        return self.validation.passed

    @property
    def failures(self) -> tuple[str, ...]:
        """The thresholds that are missed, in words."""
        return self.validation.failures

    @property
    def relative_error(self) -> float:
        """Torque error as a share of the RMS torque, over all joints."""
        return self.validation.relative_error

    @property
    def _units(self) -> Any:
        from rrrgen.lab.identify.figures import force_units

        return force_units(self.robot)

    def lines(self, width: int | None = None, verdict: Callable[[str, bool], str] = plain_verdict) -> list[str]:
        """The lines of the report: scores, then the verdict as ``verdict(text, passed)`` formats it."""
        from rrrgen.lab.identify.scores import UNKNOWN, score_table
        from rrrgen.lab.identify.validation import joint_scores

        result, common = self.validation, self.common
        lines = [*joint_scores(result, self._units, width)]
        lines += () if result.tuning is None else result.tuning.sentences()
        lines += score_table(result.scores, width)
        if self.closed_loop is not None:
            lines += self.closed_loop.lines(self.recordings[0].joints)
        if self.by_loop:
            lines.append(
                "the recorded torque is not the one that moves the joints: the limit holds for the simulated loop"
            )
        known = common.looked and self.fingerprints_known
        share = f" ({100 * common.share:.0f} % of its windows of samples were fitted)" if known else ""
        text = "passed" if result.passed else "FAILED: " + "; ".join(result.failures)
        lines.append(f"relative error {100 * result.relative_error:.3g} %, of {result.where}")
        if result.split.kind != "none":
            lines.append(f"data: {result.split}")
        lines += (f"note: {note}" for note in result.notes)
        lines.append(f"scored on {result.label}{share}; {verdict(text, result.passed)}")
        if result.label == UNKNOWN and not self.origin_known:
            lines.append(
                with_names("the robot file does not say what it was fitted to: state it with {fitted_on} LOG, or none")
            )
        return lines

    def table(self) -> tuple[tuple[str, ...], list[tuple[Any, ...]]]:
        """Header and rows of the scores of the joints; errors are relative to the RMS torque."""
        header = ("joint", "unit", "RMS torque", "RMS error", "largest error", "relative error")
        rows = [
            (score.joint, unit, score.rms_torque, score.rms_error, score.max_error, score.relative_error)
            for score, unit in zip(self.validation.joints, self._units, strict=True)
        ]
        return header, rows

    def to_json(self) -> dict[str, Any]:
        """The content of ``validation.json``."""
        from rrrgen.lab.data.run_folder import plain_record

        record = self.validation.to_json() | {
            "share_of_own_data": self.common.share if self.common.looked else None,
            "repairs": [recording.repairs.to_json() for recording in self.recordings],
            "diagnoses": [cause.to_json() for cause in self.diagnoses],
        }
        if self.closed_loop is not None:
            record["closed_loop"] = self.closed_loop.to_json()
        return plain_record(record)

    def figures(self) -> dict[str, FigureMaker]:
        """The figure ``torques``: measured and predicted torques of every joint."""
        from rrrgen.lab.identify.validation import plot_torques

        return {"torques": lambda: plot_torques(self.validation, self._units)}

    def write(self, folder: RunFolder) -> None:
        """Write ``validation.json`` and the figure ``torques`` into an open run folder."""
        folder.write_json("validation.json", self.to_json())
        folder.figure("torques", self.plot("torques"))


def validate(
    robot: RobotSource,
    recordings: RecordingSources,
    options: ValidateOptions | None = None,
    *,
    folder: str | os.PathLike[str] | None = None,
    fresh: bool = False,
    progress: ProgressCallback | None = None,
    findings: FindingsCallback | None = None,
    skip_truncated_line: bool = False,
    **changes: Any,
) -> ValidationResult:
    """Compare the torques of a robot (rigid body, drives, friction) with recorded ones.

    A robot that was identified states which samples it was fitted to; the result says whether those of the recordings
    are among them. For other robots, state it with ``fitted_on``.

    Args:
        robot: name of a bundled robot, robot file, ``RobotSpec`` or compiled model.
        recordings: a recording or mapping file, a ``Log``, arrays by name, or a list of these, as for
            :func:`rrrgen.identify`.
        options: a :class:`ValidateOptions`; the default options if None.
        folder: run folder to write to; without, nothing is written.
        fresh: discard the run that the folder holds.
        progress: called as ``progress(done, total, message)``; total is 0 where the end is not known.
        findings: called with warnings of the robot file, repairs of every recording and probable faults.
        skip_truncated_line: leave out the last line of a text file if it is incomplete.
        changes: single options by name, such as ``relative_error=0.05``.

    Raises:
        InputError: robot, recordings or options cannot be used; an OptionError for the options.
    """
    chosen = with_changes(ValidateOptions, options, changes)
    require("rrrgen experiment validate", "scipy", "matplotlib")
    from rrrgen.lab.identify.held_out_data import Split
    from rrrgen.lab.studies.sources import chosen_processing, ignore, read_loop, recording_inputs, robot_input

    findings, progress = findings or ignore, progress or ignore
    split = Split.parse(chosen.split)
    if chosen.guard is not None and split.kind == "none":
        raise OptionError("{guard} keeps away from the borders of {split}: give a {split}, too", "guard")
    named = [path for path in chosen.fitted_on if path != NO_RECORDING]
    if named and NO_RECORDING in chosen.fitted_on:
        raise OptionError("{fitted_on} names recordings, and none: leave one of them away", "fitted_on")
    arm = robot_input(robot, findings)
    logs = recording_inputs(recordings, arm.spec, skip_truncated_line=skip_truncated_line)
    processing = chosen_processing(logs.mappings, chosen.preprocessing)
    progress(0, 0, "compiling the model")
    if arm.model.beta is None:
        name = str(robot) if isinstance(robot, (str, os.PathLike)) else arm.spec.name
        raise OptionError(f"{name} has no links: there are no torques to score")
    fitted = None
    if named:
        fitted = recording_inputs(named, arm.spec, skip_truncated_line=skip_truncated_line, role="fitted", check=False)
    loop = read_loop(chosen.controller, (), arm.spec, logs, skip_truncated_line)
    settings = {**processing.settings(), **chosen.settings(), "skip_truncated_line": skip_truncated_line}
    settings |= arm.settings | logs.settings
    inputs = arm.files | logs.files | ({} if fitted is None else fitted.files) | loop.files
    run = Run("validate", inputs, settings)
    score = partial(_score, run, arm, logs, fitted, loop, processing, chosen, split, progress, findings)
    return run.result(score, folder, fresh)


def _score(
    run: Run,
    arm: RobotInput,
    logs: RecordingInputs,
    fitted: RecordingInputs | None,
    loop: LoopInputs,
    processing: Processing,
    chosen: ValidateOptions,
    split: Split,
    progress: ProgressCallback,
    findings: FindingsCallback,
    _: RunFolder | None,
) -> ValidationResult:
    """Diagnose the recordings, find out whether they were fitted, and score the torques of robot and loop."""
    from rrrgen.lab.closed_loop.validation import validate_loop
    from rrrgen.lab.identify.bandwidth import tune
    from rrrgen.lab.identify.consistency import indefinite_share, pose_limits
    from rrrgen.lab.identify.scores import OWN, Common, Fingerprint, common_share, fingerprint
    from rrrgen.lab.identify.validation import Thresholds, robot_model, validate_recordings
    from rrrgen.lab.studies.sources import tell_causes

    progress(0, 0, "comparing torques")
    spec, model, controller = arm.spec, arm.model, loop.controller
    by_loop = controller is not None and not controller.records_what_acts  # inverse dynamics lack what is not recorded
    recordings = logs.open(findings)
    causes = tell_causes(spec, recordings, findings)
    known = [Fingerprint(fit.hashes, fit.windows) for fit in spec.provenance]
    known += [] if fitted is None else [fingerprint([recording]) for recording in fitted.open()]
    origin_known = bool(known) or NO_RECORDING in chosen.fitted_on
    common = common_share(known, recordings, split) if origin_known else Common(0.0, 0)
    limit = None if by_loop else chosen.relative_error
    result = validate_recordings(
        robot_model(model),
        recordings,
        processing,
        indefinite=indefinite_share(model.mass_matrix, *pose_limits(spec, model.n))[0],
        label=common.label,
        thresholds=Thresholds(relative_error=limit, require_held_out=chosen.require_held_out),
        split=split,
        guard=chosen.guard,
    )
    scores = None
    if controller is not None:
        scores = validate_loop(model, controller, recordings, tune(processing, recordings).processing, result.split)
        if result.label == OWN:
            scores = replace(scores, left=())
        if by_loop:
            result = replace(result, failures=(*result.failures, *scores.failures(chosen.relative_error)))
    return ValidationResult(
        spec, tuple(recordings), result, common, causes, scores, origin_known, bool(known), by_loop, run=run
    )
