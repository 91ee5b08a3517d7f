"""The command ``rrrgen validate``: compare the torques of a robot file with recorded ones."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from rrrgen.cli.arguments import json_option, print_json, read_with_warnings, robot_argument
from rrrgen.cli.colour import verdict
from rrrgen.cli.experiments.closed_loop import read_loop, score_loop
from rrrgen.cli.identification.workflow import (
    chosen_processing,
    input_files,
    log_option,
    output_option,
    print_causes,
    print_repairs,
    processing_options,
    truncated_option,
)
from rrrgen.cli.progress import working
from rrrgen.cli.terminal import say, terminal_width
from rrrgen.extras import require

NO_RECORDING = Path("none")
"""Value of ``--fitted-on`` for a model that was not fitted to any recording."""


@click.command()
@robot_argument
@log_option
@truncated_option
@output_option
@processing_options
@click.option(
    "--fitted-on",
    multiple=True,
    type=click.Path(path_type=Path),
    help="Recording the model was fitted to, if the robot file does not state it; repeat for several; or: none.",
)
@click.option(
    "--relative-error",
    type=float,
    default=0.1,
    show_default=True,
    help="Largest torque error that passes, as a share of the RMS torque.",
)
@click.option(
    "--split",
    default="none",
    show_default=True,
    help="Score only the part that this split of `rrrgen identify` holds out: first:0.6, blocks:0.5, fold:2/5.",
)
@click.option(
    "--guard",
    type=click.FloatRange(min=0),
    metavar="S",
    help="Guard band in seconds on both sides of every border of --split; default: reach of the filters.",
)
@click.option(
    "--controller",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="Controller of the recorded loop: also score the torques of the loop simulated along the reference.",
)
@click.option("--require-held-out", is_flag=True, help="Fail unless the recordings are known not to have been fitted.")
@click.option("--fresh", is_flag=True, help="Discard a run that DIR already holds, and start over.")
@json_option
def validate(robot: str, logs: tuple[Path, ...], output: Path, as_json: bool, **options: Any) -> int:
    """Compare the torques of a robot file (rigid body, drives, friction) with recorded ones.

    Prints the RMS error of each joint, relative errors, the share of random poses with an indefinite mass matrix, and a
    verdict; exits with 1 if a threshold is missed. A robot file written by `rrrgen identify` states which samples it
    was fitted to; their share in the recordings is printed. For other robot files, state it with --fitted-on.

    \b
    Example:
      rrrgen validate runs/identified/results/robot.yaml --log runs/writing/results/log.yaml -o runs/validated
    """
    require("rrrgen validate", "scipy", "matplotlib")
    from dataclasses import replace

    from rrrgen import pipeline
    from rrrgen.identify.diagnosis.report import diagnose_recordings
    from rrrgen.identify.estimation.definiteness import indefinite_share, pose_limits
    from rrrgen.identify.scoring.fingerprint import UNKNOWN, Common, Fingerprint, common_share, fingerprint
    from rrrgen.identify.scoring.scores import score_table
    from rrrgen.identify.scoring.split import Split
    from rrrgen.identify.torque_plots import force_units
    from rrrgen.identify.validation import (
        Thresholds,
        joint_scores,
        plot_torques,
        robot_model,
        validate_recordings,
    )
    from rrrgen.recordings.log_stream import LogStream
    from rrrgen.recordings.logs import check_robot, open_log
    from rrrgen.runs.run_folder import RunFolder, plain

    spec = read_with_warnings(robot)
    skip = options["skip_truncated_line"]
    mappings = [open_log(path, skip_truncated=skip) for path in logs]
    for mapping in mappings:
        check_robot(mapping, spec)
    processing = chosen_processing(mappings, options["reconstruction"], options["cutoff"], options["decimate"])
    with working("compiling the model"):
        model = pipeline.compile(spec)
    if model.beta is None:
        raise click.UsageError(f"{robot} has no links: there are no torques to score")
    named = [path for path in options["fitted_on"] if path != NO_RECORDING]
    fitted = [open_log(path, skip_truncated=skip) for path in named]
    split = Split.parse(options["split"])
    controller, _, more_inputs = read_loop(options["controller"], (), spec, mappings, skip)
    by_loop = controller is not None and not controller.records_what_acts  # inverse dynamics lack what is not recorded
    limit = None if by_loop else options["relative_error"]
    thresholds = Thresholds(relative_error=limit, require_held_out=options["require_held_out"])
    settings = {
        **processing.settings(),
        **{k: options[k] for k in ("relative_error", "require_held_out", "split", "guard")},
    }
    settings["skip_truncated_line"] = skip
    settings["fitted_on"] = [str(path) for path in options["fitted_on"]]
    inputs = input_files(robot, logs, mappings) | input_files("", tuple(named), fitted, "fitted") | more_inputs
    with RunFolder(output, "validate", inputs, settings, 0, options["fresh"]) as folder, working("comparing torques"):
        recordings = [LogStream(mapping) for mapping in mappings]
        print_repairs((recording.repairs for recording in recordings), as_json)
        causes = diagnose_recordings(spec, recordings)
        print_causes(causes, as_json)
        known = [Fingerprint(fit.hashes, fit.windows) for fit in spec.provenance]
        known += [fingerprint([LogStream(mapping)]) for mapping in fitted]
        told = bool(known) or NO_RECORDING in options["fitted_on"]
        common = common_share(known, recordings, split) if told else Common(0.0, 0)
        result = validate_recordings(
            robot_model(model),
            recordings,
            processing,
            indefinite=indefinite_share(model.mass_matrix, *pose_limits(spec, model.n))[0],
            label=common.label,
            thresholds=thresholds,
            split=split,
            guard=options["guard"],
        )
        loop = None if controller is None else score_loop(model, controller, recordings, processing, split)
        if loop is not None and by_loop:
            result = replace(result, failures=(*result.failures, *loop.failures(options["relative_error"])))
        record = result.to_json() | {
            "share_of_own_data": common.share if common.looked else None,
            "repairs": [recording.repairs.to_json() for recording in recordings],
            "diagnoses": [cause.to_json() for cause in causes],
        }
        if loop is not None:
            record["closed_loop"] = loop.to_json()
        folder.write_json("validation.json", record)
        folder.figure("torques", plot_torques(result, force_units(spec)))
    if as_json:
        print_json(plain(record))
    else:
        width = terminal_width()
        say(*joint_scores(result, force_units(spec), width))
        say(*(() if result.tuning is None else result.tuning.sentences()), *score_table(result.scores, width))
        say(*(() if loop is None else loop.lines(recordings[0].joints)))
        if by_loop:
            say("the recorded torque is not the one that moves the joints: the limit holds for the simulated loop")
        own = f" ({100 * common.share:.0f} % of its windows of samples were fitted)" if common.looked and known else ""
        said = "passed" if result.passed else "FAILED: " + "; ".join(result.failures)
        if split.kind != "none":
            say(f"data: {result.split}")
        say(f"scored on {result.label}{own}; {verdict(said, result.passed)}")
        if result.label == UNKNOWN and not told:
            say("the robot file does not tell what it was fitted to: say it with --fitted-on LOG, or none")
    return 0 if result.passed else 1
