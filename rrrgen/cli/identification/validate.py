"""``rrrgen validate``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from rrrgen.cli.arguments import json_option, print_json, read_with_warnings, robot_argument
from rrrgen.cli.identification.workflow import (
    chosen_processing,
    input_files,
    log_option,
    output_option,
    print_causes,
    print_repairs,
    processing_options,
)
from rrrgen.extras import require


@click.command()
@robot_argument
@log_option
@output_option
@processing_options
@click.option(
    "--fitted-on", multiple=True, type=click.Path(path_type=Path), help="Recording the model was fitted to; repeat."
)
@click.option("--relative-error", type=float, default=0.1, show_default=True, help="Largest share of the RMS torque.")
@click.option("--require-held-out", is_flag=True, help="Fail a model that is scored on data it was fitted to.")
@click.option("--fresh", is_flag=True, help="Start over in a folder of another run.")
@json_option
def validate(robot: str, logs: tuple[Path, ...], output: Path, as_json: bool, **options: Any) -> int:
    """Score a robot file's torques (rigid body, drives, friction) against recordings.

    Prints N m RMS per joint, relative errors, the share of random poses with an indefinite mass matrix, and a verdict;
    exits with 1 if a threshold is missed. Scores on data that the model was fitted to are labelled so.

    \b
    Example:
      rrrgen validate runs/identified/results/robot.yaml --log runs/writing/results/log.yaml -o runs/validated
    """
    require("rrrgen validate", "scipy", "matplotlib")
    from rrrgen import pipeline
    from rrrgen.identify.diagnosis.report import diagnose_recordings
    from rrrgen.identify.estimation.definiteness import indefinite_share, pose_limits
    from rrrgen.identify.scoring.scores import score_table
    from rrrgen.identify.validation import (
        Thresholds,
        data_label,
        plot_torques,
        robot_model,
        summary,
        validate_recordings,
    )
    from rrrgen.recordings.log_stream import LogStream
    from rrrgen.recordings.logs import check_robot, open_log
    from rrrgen.runs.run_folder import RunFolder, hash_of, plain

    spec = read_with_warnings(robot)
    mappings = [open_log(path) for path in logs]
    for mapping in mappings:
        check_robot(mapping, spec)
    processing = chosen_processing(mappings, options["reconstruction"], options["cutoff"], options["decimate"])
    model = pipeline.compile(spec)
    if model.beta is None:
        raise click.UsageError(f"{robot} has no links: there are no torques to score")
    # the data decide, not the mapping files: two recordings may have the same mapping
    fitted = [open_log(path) for path in options["fitted_on"]]
    hashes = [[hash_of(source.path) for mapping in each for source in mapping.files] for each in (fitted, mappings)]
    label = data_label(hashes[0], hashes[1])
    thresholds = Thresholds(relative_error=options["relative_error"], require_held_out=options["require_held_out"])
    settings = {**processing.settings(), **{k: options[k] for k in ("relative_error", "require_held_out")}}
    with RunFolder(output, "validate", input_files(robot, logs, mappings), settings, 0, options["fresh"]) as folder:
        recordings = [LogStream(mapping) for mapping in mappings]
        print_repairs((recording.repairs for recording in recordings), as_json)
        causes = diagnose_recordings(spec, recordings)
        print_causes(causes, as_json)
        result = validate_recordings(
            robot_model(model),
            recordings,
            processing,
            indefinite=indefinite_share(model.mass_matrix, *pose_limits(spec, model.n))[0],
            label=label,
            thresholds=thresholds,
        )
        record = result.to_json() | {
            "repairs": [recording.repairs.to_json() for recording in recordings],
            "diagnoses": [cause.to_json() for cause in causes],
        }
        folder.write_json("validation.json", record)
        folder.figure("torques", plot_torques(result))
    if as_json:
        print_json(plain(record))
    else:
        rows = summary(result)
        for row in rows:
            shown = {key: f"{value:.4g}" if isinstance(value, float) else value for key, value in row.items()}
            click.echo("  ".join(f"{key}: {value}" for key, value in shown.items() if value is not None))
        for sentence in () if result.tuning is None else result.tuning.sentences():
            click.echo(sentence)
        for line in score_table(result.scores):
            click.echo(line)
        click.echo(
            f"scored on {result.label}; {'passed' if result.passed else 'FAILED: ' + '; '.join(result.failures)}"
        )
    return 0 if result.passed else 1
