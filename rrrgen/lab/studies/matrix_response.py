"""Frequency response of a whole arm from several experiments: its options, the study and its result."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, Literal

from rrrgen.base.errors import InputError, require
from rrrgen.lab.studies.options import OptionError, StudyOptions, option, with_changes
from rrrgen.lab.studies.results import FigureMaker, Run, StudyResult

if TYPE_CHECKING:
    from rrrgen.lab.data.run_folder import RunFolder
    from rrrgen.lab.plant.elastic_modes import ElasticMode
    from rrrgen.lab.response.matrix_response import MatrixResponse
    from rrrgen.lab.studies.sources import (
        FindingsCallback,
        ProgressCallback,
        RecordingInputs,
        RecordingSources,
        RobotInput,
        RobotSource,
    )


@dataclass(frozen=True)
class MatrixResponseOptions(StudyOptions):
    """Options of the estimation of the frequency response of a whole arm."""

    period: float | None = option(None, "Period of the excitation; needed.", unit="s", above=0.0)
    torques: Literal["held", "smooth"] = option(
        "held",
        "Whether the drives hold their torques between two samples of the recording, as those of a sampled controller "
        "do, or the recorded torques change smoothly.",
        shown=True,
    )


@dataclass(frozen=True, eq=False, repr=False)
class MatrixResponseResult(StudyResult):
    """The result of :func:`rrrgen.matrix_response`: a sequence of responses, one for every posture.

    ``responses`` are :class:`~rrrgen.lab.response.matrix_response.MatrixResponse`. ``elastic`` pairs the modes that the
    mass matrix and the elastic joints of the robot file lead to with measured resonances, None if the file states none.
    """

    responses: tuple[MatrixResponse, ...]
    elastic: list[dict[str, Any]] | None

    def __len__(self) -> int:
        return len(self.responses)

    def __getitem__(self, number: int) -> MatrixResponse:
        return self.responses[number]

    def __iter__(self) -> Iterator[MatrixResponse]:
        return iter(self.responses)

    @property
    def trusted(self) -> bool:
        """Whether nothing speaks against any of the recordings as a whole."""
        return not any(response.findings for response in self.responses)

    def lines(self, width: int | None = None) -> list[str]:
        """The report: verdict and resonances of every posture, and the resonances of the robot file beside them."""
        from rrrgen.lab.studies.fit_response import elastic_line

        lines = [line for response in self.responses for line in response.lines()]
        return [*lines, *(elastic_line(row) for row in self.elastic or ())]

    def table(self) -> tuple[tuple[str, ...], list[tuple[Any, ...]]]:
        """Header and rows of the resonances of all postures, with their standard deviations."""
        header = ("posture", "frequency [Hz]", "std [Hz]", "damping", "std")
        rows = [
            (response.name, *("" if number is None else number for number in numbers))
            for response in self.responses
            for mode in response.resonances
            for numbers in [(mode.frequency, mode.frequency_std, mode.damping, mode.damping_std)]
        ]
        return header, rows

    def to_json(self) -> dict[str, Any]:
        """The content of ``matrix_response.json``."""
        from rrrgen.lab.data.run_folder import plain_record
        from rrrgen.lab.response.resonances import modes_over_postures

        record: dict[str, Any] = {"postures": [response.to_json() for response in self.responses]}
        record["resonances_over_postures"] = [mode.to_json() for mode in modes_over_postures(self.responses)]
        return plain_record(record | ({} if self.elastic is None else {"elastic_model": self.elastic}))

    def figures(self) -> dict[str, FigureMaker]:
        """The figures: matrix_response, and resonances if there are several postures."""
        from rrrgen.lab.response.figures import plot_matrix, plot_resonances

        makers: dict[str, FigureMaker] = {"matrix_response": lambda: plot_matrix(self.responses)}
        if len(self.responses) > 1 and any(response.resonances for response in self.responses):
            makers["resonances"] = lambda: plot_resonances(self.responses)
        return makers

    def write(self, folder: RunFolder) -> None:
        """Write ``matrix_response.json`` and the figures into an open run folder."""
        folder.write_json("matrix_response.json", self.to_json())
        for name in self.figures():
            folder.figure(name, self.plot(name))


def matrix_response(
    robot: RobotSource,
    recordings: RecordingSources,
    options: MatrixResponseOptions | None = None,
    *,
    folder: str | os.PathLike[str] | None = None,
    fresh: bool = False,
    progress: ProgressCallback | None = None,
    findings: FindingsCallback | None = None,
    skip_truncated_line: bool = False,
    **changes: Any,
) -> MatrixResponseResult:
    """Estimate the frequency response of an arm, from the torques of all joints to all positions, with its resonances.

    In every posture the arm has as many experiments as joints or more, each with a periodic excitation of its own that
    is added in the control loop. Recordings whose mean positions agree within 0.05 rad (m) are one posture.

    Args:
        robot: name of a bundled robot, robot file, ``RobotSpec`` or compiled model. If its drives state ``inertia`` and
            ``stiffness`` and its links masses, the resonances that these lead to stand beside the measured ones.
        recordings: the experiments: files, or arrays by name, ``t`` (N,) in s, ``q`` and ``tau`` (N, n).
        options: a :class:`MatrixResponseOptions`, of which the period is needed.
        folder: run folder to write to; without, nothing is written.
        fresh: discard the run that the folder holds.
        progress: called as ``progress(done, total, message)``; total is 0 where the end is not known.
        findings: called with warnings of the robot file and repairs of the recordings.
        skip_truncated_line: leave out the last line of a text file if it is incomplete.
        changes: single options by name, such as ``period=2.0``.

    Raises:
        InputError: robot, recordings or options cannot be used; an OptionError for the options.
        DerivationError: the recordings determine no response.
    """
    chosen = with_changes(MatrixResponseOptions, options, changes)
    if chosen.period is None:
        raise OptionError("{period} is needed: after how many seconds does the excitation repeat?", "period")
    require("rrrgen response matrix", "scipy", "matplotlib")
    from rrrgen.lab.studies.sources import ignore, recording_inputs, robot_input

    findings = findings or ignore
    arm = robot_input(robot, findings)
    if arm.spec.loops or arm.spec.floating_base:
        kind = "closed loops" if arm.spec.loops else "a floating base"
        raise InputError(f"{arm.spec.name} has {kind}: the response is that of an arm whose joints are all driven")
    logs = recording_inputs(recordings, arm.spec, skip_truncated_line=skip_truncated_line)
    settings = chosen.settings() | {"skip_truncated_line": skip_truncated_line} | arm.settings | logs.settings
    run = Run("matrix-response", arm.files | logs.files, settings)
    compute = partial(_estimate, run, arm, logs, chosen.period, chosen.torques == "held", progress or ignore, findings)
    return run.result(compute, folder, fresh)


def _estimate(
    run: Run,
    arm: RobotInput,
    logs: RecordingInputs,
    period: float,
    held: bool,
    progress: ProgressCallback,
    findings: FindingsCallback,
    _: RunFolder | None,
) -> MatrixResponseResult:
    from rrrgen.lab.experiment.response import beside
    from rrrgen.lab.response.matrix_response import matrix_responses
    from rrrgen.lab.studies.sources import tell_causes

    progress(0, 0, "estimating the frequency response")
    recordings = logs.load(findings)
    tell_causes(arm.spec, recordings, findings)
    responses = matrix_responses(recordings, period, held)
    computed = [_modes_in_posture(arm, response) for response in responses]
    modes = {
        response.name: elastic_modes
        for response, elastic_modes in zip(responses, computed, strict=True)
        if elastic_modes is not None
    }
    elastic = beside(responses, modes) if len(modes) == len(responses) else None
    return MatrixResponseResult(tuple(responses), elastic, run=run)


def _modes_in_posture(arm: RobotInput, response: MatrixResponse) -> list[ElasticMode] | None:
    """The modes of the robot in the posture of the ``response``; None where its file states no elastic joints."""
    from rrrgen.lab.plant.elastic_modes import modes_of_arm
    from rrrgen.lab.plant.plant import FlexibleJoints, make_plant
    from rrrgen.robot.model.drives import stated_at_joints

    keys: tuple[tuple[str, float | None], ...] = (("inertia", None), ("stiffness", None), ("damping", 0.0))
    stated = [stated_at_joints(arm.spec, key, missing) for key, missing in keys]
    if arm.spec.drives is not None or any(absent for _, absent in stated) or arm.model.beta is None:
        return None
    joints = FlexibleJoints(*(tuple(values) for values, _ in stated))
    return modes_of_arm(make_plant(arm.model, joints=joints).body.mass(response.posture), joints)
