"""The command ``rrrgen identify``: estimate base parameters, drive inertia and friction from recordings."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rrrgen.cli.arguments import json_option, print_json, read_with_warnings, robot_argument
from rrrgen.cli.experiments.closed_loop import fit_loop, read_loop
from rrrgen.cli.identification.workflow import (
    chosen_processing,
    input_files,
    jobs_options,
    log_option,
    output_option,
    parallel_packages,
    print_causes,
    print_repairs,
    processing_options,
    recording_names,
    seed_option,
    truncated_option,
)
from rrrgen.cli.progress import progress_bar
from rrrgen.cli.terminal import say, terminal_width
from rrrgen.extras import require

if TYPE_CHECKING:
    from rrrgen.identify.cross_validation import CrossValidation
    from rrrgen.identify.identification import Identification


@click.command()
@robot_argument
@log_option
@truncated_option
@output_option
@processing_options
@click.option(
    "--estimator",
    type=click.Choice(["ordinary", "weighted", "robust"]),
    default="weighted",
    show_default=True,
    help="Least squares: ordinary, weighted by the residual of each joint, or robust against outliers (Huber).",
)
@click.option(
    "--split",
    default="none",
    show_default=True,
    help="Part of the data to fit, the rest is held out: first:0.6, blocks:0.5 (every other half second), or none.",
)
@click.option(
    "--guard",
    type=click.FloatRange(min=0),
    metavar="S",
    help="Guard band in seconds, left out on both sides of every border of --split; default: reach of the filters.",
)
@click.option(
    "--cross-validate",
    type=click.IntRange(min=2),
    metavar="K",
    help="Also fit K times, to all but one of K parts of the recordings, and score on that part.",
)
@click.option(
    "--bias-check",
    type=click.FloatRange(min=0, min_open=True),
    metavar="S",
    help="Period of a repeated motion: check by instrumental variables whether noise in it biases the estimate.",
)
@click.option(
    "--friction",
    multiple=True,
    metavar="LAW",
    help="Friction law to fit at all joints, or JOINT=LAW at one; auto chooses by held-out error. "
    "Default: as the robot file states. Repeat for several.",
)
@click.option(
    "--controller",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="Controller of the recorded loop: also fit the simulated loop to the torques (closed-loop output error).",
)
@click.option(
    "--test",
    "tests",
    multiple=True,
    type=click.Path(path_type=Path),
    metavar="LOG",
    help="Recording that is not fitted, on which the loop with --controller is scored; repeat for several.",
)
@click.option(
    "--fix",
    multiple=True,
    metavar="NAME=VALUE",
    help="Known value of a base, friction or standard parameter, such as my2=0; repeat for several.",
)
@click.option(
    "--consistent/--no-consistent", default=True, show_default=True, help="Compute the physically consistent estimate."
)
@click.option("--essential", is_flag=True, help="Reduce the model to its essential parameters, too.")
@jobs_options
@seed_option(default=0)
@click.option("--fresh", is_flag=True, help="Discard a run that DIR already holds, and start over.")
@json_option
def identify(robot: str, logs: tuple[Path, ...], output: Path, as_json: bool, **options: Any) -> int:
    """Estimate base parameters, drive inertia and friction from recordings.

    Every friction and drive parameter that ROBOT states, even as 0, is estimated. Writes to DIR the parameters with
    their standard deviations, figures, and robot.yaml with the physically consistent estimate, for `rrrgen generate`.

    \b
    Examples:
      rrrgen identify rrr --log runs/log.yaml -o runs/identified
      rrrgen identify my_arm.yaml --log log.yaml --split first:0.6 -o runs/identified
      rrrgen identify my_arm.yaml --log log.yaml --friction auto -o runs/identified_friction
    """
    consistency = ("cvxpy", "clarabel") if options["consistent"] else ()
    require("rrrgen identify", "scipy", "matplotlib", *consistency, *parallel_packages(options))
    from dataclasses import replace

    from rrrgen import pipeline
    from rrrgen.identify.bias_check import check_bias
    from rrrgen.identify.cross_validation import cross_validate
    from rrrgen.identify.diagnosis.cause import merged
    from rrrgen.identify.diagnosis.report import diagnose_fit, diagnose_recordings
    from rrrgen.identify.friction_laws.choice import LawChoice
    from rrrgen.identify.identification import identify as estimate
    from rrrgen.identify.options import Options
    from rrrgen.identify.results import as_record, write_identification
    from rrrgen.identify.scoring.split import Split
    from rrrgen.model.estimated_terms import DriveTerms
    from rrrgen.recordings.log_stream import LogStream
    from rrrgen.recordings.logs import check_robot, open_log
    from rrrgen.runs.run_folder import RunFolder

    spec = read_with_warnings(robot)
    skip = options["skip_truncated_line"]
    mappings = [open_log(path, skip_truncated=skip) for path in logs]
    for mapping in mappings:
        check_robot(mapping, spec)
    controller, tests, more_inputs = read_loop(options["controller"], options["tests"], spec, mappings, skip)
    processing = chosen_processing(mappings, options["reconstruction"], options["cutoff"], options["decimate"])
    columns, standard = _parse_fixed(options["fix"])
    chosen = Options(
        method=options["estimator"],
        terms=DriveTerms.of_spec(spec),
        friction=LawChoice.parse(options["friction"], spec),
        fixed=columns,
        fixed_standard=standard,
        split=Split.parse(options["split"]),
        guard=options["guard"],
        consistent=options["consistent"],
        essential=options["essential"],
        seed=options["seed"],
        jobs=options["jobs"],
        cluster=options["cluster"],
    )
    if options["cross_validate"] and options["split"] != "none":
        raise click.UsageError("--cross-validate holds out every part in turn: leave --split away")
    named = (
        "estimator",
        "split",
        "cross_validate",
        "bias_check",
        "guard",
        "friction",
        "fix",
        "consistent",
        "essential",
        "skip_truncated_line",
    )
    settings = {**processing.settings(), **{name: options[name] for name in named}}
    inputs = input_files(robot, logs, mappings) | more_inputs
    with (
        RunFolder(output, "identify", inputs, settings, options["seed"], options["fresh"]) as folder,
        progress_bar() as progress,
    ):
        recordings = [LogStream(mapping) for mapping in mappings]
        print_repairs((recording.repairs for recording in recordings), as_json)
        before = diagnose_recordings(spec, recordings)
        print_causes(before, as_json)
        model = pipeline.compile(spec)
        found = estimate(
            model,
            recordings,
            processing,
            chosen,
            checkpoint=folder.checkpoint("factors"),
            digest=folder.digest,
            progress=progress,
        )
        loop = None
        if controller is not None:
            loop = fit_loop(folder, found, controller, recordings, tests, chosen, spec, progress)
            found = loop.identification
        bias = None if options["bias_check"] is None else check_bias(found, recordings, options["bias_check"])
        validation = None
        if options["cross_validate"]:
            validation = cross_validate(model, recordings, processing, chosen, options["cross_validate"], progress)
            folder.write_json("cross_validation.json", validation.to_json())
        progress(0, 0, "diagnosis")
        found = replace(found, diagnoses=merged([*before, *diagnose_fit(model, recordings, found)]))
        read = ", ".join(recording_names(mappings))
        write_identification(folder, found, spec, recordings=read, model=model, recording=recordings[0])
    if as_json:
        more = {} if validation is None else {"cross_validation": validation.to_json()}
        more |= {} if loop is None else {"closed_loop": loop.to_json()}
        print_json(_json_ready(as_record(found, recordings[0].joints) | more))
    else:
        _report(found, recordings[0].joints, validation, output)
        say(*(() if loop is None else loop.lines(recordings[0].joints)), *(() if bias is None else bias.lines()))
    print_causes([cause for cause in found.diagnoses if cause not in before], as_json)
    return 0


def _parse_fixed(entries: tuple[str, ...]) -> tuple[dict[str, float], dict[str, float]]:
    """Split ``NAME=VALUE`` entries into known columns of the regressor and known standard parameters (m2, mx2, ...)."""
    import re

    columns: dict[str, float] = {}
    standard: dict[str, float] = {}
    for entry in entries:
        match = re.fullmatch(r"\s*(\w+)\s*=\s*([-+0-9.eE]+)\s*", entry)
        try:
            name, value = (match.group(1), float(match.group(2))) if match else ("", 0.0)
        except ValueError:
            name, value = "", 0.0
        if not name:
            raise click.BadParameter(f"'{entry}' is not NAME=VALUE", param_hint="--fix")
        is_standard = re.fullmatch(r"(m|m[xyz]|I[xyz][xyz])\d+", name) is not None
        (standard if is_standard else columns)[name] = value
    return columns, standard


def _json_ready(value: Any) -> Any:
    from rrrgen.runs.run_folder import plain

    return plain(value)


def _report(found: Identification, joints: tuple[str, ...], validation: CrossValidation | None, output: Path) -> None:
    from rrrgen.identify.parameter_report import parameter_lines
    from rrrgen.identify.scoring.held_out import held_out_notes
    from rrrgen.identify.scoring.scores import joint_table, score_table

    width = terminal_width()
    say(*parameter_lines(found, width))
    if found.friction is not None:
        say(*found.friction.lines(width))
    say(*found.tuning.sentences())
    if found.split.kind != "none":
        say(f"data: {found.split}")
    say(*score_table(found.scores, width), *joint_table(found.scores, joints, width))
    covered = None
    for name, blocks in found.parts:
        covered = found.band.coverage(blocks)
        if covered is not None:
            say(
                f"95 % band of the predicted torque: covers {100 * covered.share:.1f} % of the rows {name}; "
                f"{100 * covered.parameters:.0f} % of its width is that of the parameters"
            )
    doubtful = held_out_notes(found.scores, covered, joints)  # the coverage of the held-out rows, which come last
    if validation is not None:
        say(*validation.lines(width))
    for name, share in found.indefinite.items():
        say(f"random poses with an indefinite mass matrix, {name}: {100 * share:.2f} %")
    for note in (*found.structural_notes, *found.motion_notes, *found.hardly_determined, *doubtful):
        say(f"note: {note}")
    say(f"results and figures in {output}")
