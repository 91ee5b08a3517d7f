"""Closed-loop output error within ``rrrgen identify`` and ``rrrgen validate``: the options --controller and --test."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rrrgen.cli.identification.workflow import input_files

if TYPE_CHECKING:
    from rrrgen.closed_loop.controller import LoopController
    from rrrgen.closed_loop.estimation import ClosedLoopEstimate
    from rrrgen.closed_loop.validation import ClosedLoopValidation
    from rrrgen.identify.identification import Identification
    from rrrgen.identify.options import Options
    from rrrgen.identify.scoring.split import Split
    from rrrgen.recordings.log_stream import LogStream
    from rrrgen.recordings.mapping import LogMapping
    from rrrgen.robotfile.robot_spec import RobotSpec
    from rrrgen.runs.run_folder import RunFolder
    from rrrgen.runtime.model import Model
    from rrrgen.signals.processing import Processing


def read_loop(
    path: Path | None,
    tests: tuple[Path, ...],
    spec: RobotSpec,
    recorded: Sequence[LogMapping],
    skip_truncated: bool,
) -> tuple[LoopController | None, list[LogStream], dict[str, Path]]:
    """Read the controller file ``path`` and the recordings ``tests``, which are scored but not fitted.

    Returns the controller, the test recordings, and all files read by role. Raises InputError for a controller whose
    joints or inputs are not those of the recordings ``recorded`` and ``tests``.
    """
    if path is None:
        if tests:
            raise click.UsageError("--test scores the simulated loop: give its --controller, too")
        return None, [], {}
    from rrrgen.closed_loop.controller_file import load_controller
    from rrrgen.closed_loop.loop_recording import NEEDED, require_inputs, require_joints
    from rrrgen.recordings.log_stream import LogStream
    from rrrgen.recordings.logs import check_robot, open_log

    controller = load_controller(path)
    mappings = [open_log(each, skip_truncated=skip_truncated) for each in tests]
    for mapping in mappings:
        check_robot(mapping, spec)
    for mapping in (*recorded, *mappings):
        require_joints(controller, mapping.names)
        require_inputs(controller, {name for name in NEEDED if mapping.has(name)})
    files = input_files("", tests, mappings, "test") | {"controller": path}
    return controller, [LogStream(mapping) for mapping in mappings], files


def fit_loop(
    folder: RunFolder,
    found: Identification,
    controller: LoopController,
    recordings: Sequence[LogStream],
    tests: Sequence[LogStream],
    options: Options,
    spec: RobotSpec,
    progress: Any,
) -> ClosedLoopEstimate:
    """Fit the simulated loop, and write its scores and figure to the run folder."""
    from rrrgen.closed_loop.estimation import closed_loop_estimate
    from rrrgen.closed_loop.plots import plot_loop
    from rrrgen.identify.torque_plots import force_units

    loop = closed_loop_estimate(found, recordings, controller, options, progress, tests)
    folder.write_json("closed_loop.json", loop.to_json())
    folder.figure("closed_loop", plot_loop(loop, recordings[0].joints, force_units(spec)))
    return loop


def score_loop(
    model: Model, controller: LoopController, recordings: Sequence[LogStream], processing: Processing, split: Split
) -> ClosedLoopValidation:
    """Score the loop of ``controller`` and the robot file on recordings, or on the part that ``split`` holds out."""
    from rrrgen.closed_loop.validation import validate_loop
    from rrrgen.identify.scoring.bandwidth import tune

    return validate_loop(model, controller, recordings, tune(processing, recordings).processing, split)
