"""Thresholds of contact detection from recordings without contact: their options, the study and its result."""

from __future__ import annotations

import os
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rrrgen.base.errors import InputError, require
from rrrgen.lab.studies.options import StudyOptions, option, with_changes
from rrrgen.lab.studies.results import Run, StudyResult

if TYPE_CHECKING:
    from rrrgen.lab.contact import ContactFindings
    from rrrgen.lab.data.run_folder import RunFolder
    from rrrgen.lab.studies.sources import (
        FindingsCallback,
        ProgressCallback,
        RecordingInputs,
        RecordingSources,
        RobotInput,
        RobotSource,
    )


@dataclass(frozen=True)
class ContactOptions(StudyOptions):
    """Options of the search for thresholds of contact detection."""

    tuning: Path | None = option(
        None,
        "tuning.json of `rrrgen experiment reconstruct`, for the Kalman filter of the speeds; "
        "default: tuned by the recordings.",
        recorded=False,
    )
    gain: float = option(50.0, "Pole of the momentum observer, 1/s.", above=0, shown=True)
    width: float = option(0.05, "Width of smooth friction, rad/s or m/s.", above=0, shown=True)
    seconds_per_alarm: float = option(
        3600.0, "Mean time between false alarms of all joints together.", unit="s", above=0, shown=True
    )
    block: float = option(1.0, "Length of a block of residuals.", unit="s", above=0, shown=True)
    force: float = option(10.0, "Force at the tip to report on.", unit="N", above=0, shown=True)


@dataclass(frozen=True, eq=False, repr=False)
class ContactResult(StudyResult):
    """The result of :func:`rrrgen.contact_thresholds` for a robot called ``name`` with ``joints``.

    ``findings`` holds thresholds, covariance of the residuals, and how fast a force at the tip is detected.
    """

    name: str
    joints: tuple[str, ...]
    findings: ContactFindings

    @property
    def levels(self) -> tuple[float, ...]:
        """Thresholds, one a joint, of the residuals, N m (N)."""
        return self.findings.thresholds.levels

    @property
    def change_levels(self) -> tuple[float, ...]:
        """Thresholds, one a joint, of the changes of the residuals, N m (N)."""
        return self.findings.thresholds.change_levels

    def lines(self, width: int | None = None) -> list[str]:
        """The report: thresholds of every joint, and how fast they detect a force at the tip."""
        limits = self.findings.thresholds
        (_, *columns), rows = self.table()
        return [
            "thresholds of residuals and of their changes, and the residuals' root mean square, N m or N:",
            " ".join([" " * 10, *(f"{column:>10}" for column in columns)]),
            *(" ".join([f"  {name:8}", *(f"{value:10.4g}" for value in values)]) for name, *values in rows),
            f"from {limits.blocks} blocks of {limits.block:g} s, for one false alarm in {limits.seconds_per_alarm:g} s",
            self.findings.detection.sentence(),
            *(f"note: {note}" for note in self.findings.notes(self.joints)),
        ]

    def table(self) -> tuple[tuple[str, ...], list[tuple[Any, ...]]]:
        """Header and rows of the joints: thresholds, and the root mean square of the residuals, N m (N)."""
        columns = (self.levels, self.change_levels, self.findings.covariance.deviations)
        return ("joint", "residual", "change", "rms"), list(zip(self.joints, *columns, strict=True))

    def to_json(self) -> dict[str, Any]:
        """The content of ``contact.json``."""
        from rrrgen.lab.data.run_folder import plain_record

        return plain_record(self.findings.to_json())

    def write(self, folder: RunFolder) -> None:
        """Write ``contact.json`` and the C header ``<name>_contact.h`` into an open run folder."""
        from rrrgen.lab.contact import contact_header

        folder.write_json("contact.json", self.to_json())
        folder.write_text(f"{self.name}_contact.h", contact_header(self.name, self.findings))


def contact_thresholds(
    robot: RobotSource,
    recordings: RecordingSources,
    options: ContactOptions | None = None,
    *,
    folder: str | os.PathLike[str] | None = None,
    fresh: bool = False,
    progress: ProgressCallback | None = None,
    findings: FindingsCallback | None = None,
    skip_truncated_line: bool = False,
    **changes: Any,
) -> ContactResult:
    """Find thresholds of contact detection from recordings without contact.

    The momentum observer runs along the recordings as it does in the controller, and an extreme-value distribution is
    fitted to the largest residual in every block, and to its fastest change. From them follow the thresholds for a
    given mean time between false alarms, and the delay with which a force at the tip will be detected.

    Args:
        robot: name of a bundled robot, robot file, ``RobotSpec`` or compiled model.
        recordings: a recording or mapping file, a ``Log``, arrays by name, or a list of these, as for
            :func:`rrrgen.identify`: motions like those of normal work, with the torques that were applied.
        options: a :class:`ContactOptions`; the default options if None.
        folder: run folder to write to; without, nothing is written.
        fresh: discard the run that the folder holds.
        progress: called as ``progress(done, total, message)``; total is 0 where the end is not known.
        findings: called with warnings of the robot file and repairs of every recording.
        skip_truncated_line: leave out the last line of a text file if it is incomplete.
        changes: single options by name, such as ``seconds_per_alarm=600``.

    Raises:
        InputError: robot, recordings or options cannot be used; an OptionError for the options.
    """
    chosen = with_changes(ContactOptions, options, changes)
    require("rrrgen experiment contact-thresholds", "scipy")
    from rrrgen.lab.studies.sources import ignore, recording_inputs, robot_input

    findings, progress = findings or ignore, progress or ignore
    arm = robot_input(robot, findings)
    if arm.spec.links is None:
        raise InputError("the robot file has no links: the momentum observer needs a known arm")
    logs = recording_inputs(recordings, arm.spec, skip_truncated_line=skip_truncated_line)
    settings = {**chosen.settings(), "skip_truncated_line": skip_truncated_line, **arm.settings, **logs.settings}
    tuning = {} if chosen.tuning is None else {"tuning": chosen.tuning}
    run = Run("contact-thresholds", arm.files | logs.files | tuning, settings)
    return run.result(partial(_find, run, arm, logs, chosen, progress, findings), folder, fresh)


def _find(
    run: Run,
    arm: RobotInput,
    logs: RecordingInputs,
    chosen: ContactOptions,
    progress: ProgressCallback,
    findings: FindingsCallback,
    _: RunFolder | None,
) -> ContactResult:
    """Run the observer along the recordings, and fit the distributions."""
    from rrrgen.lab.contact import findings_of_recordings
    from rrrgen.lab.data.kalman import read_tuning
    from rrrgen.lab.studies.sources import tell_causes

    progress(0, 0, "finding thresholds")
    recordings = logs.load(findings)
    tell_causes(arm.spec, recordings, findings)
    tuning = None if chosen.tuning is None else read_tuning(chosen.tuning, arm.spec.n)
    contact_findings = findings_of_recordings(arm.model, recordings, tuning, **chosen.settings())
    return ContactResult(arm.spec.name, tuple(joint.name for joint in arm.spec.joints), contact_findings, run=run)
