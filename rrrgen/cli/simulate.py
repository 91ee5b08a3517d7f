"""The command ``rrrgen experiment simulate``: simulate an experiment."""

from __future__ import annotations

from pathlib import Path

import click

from rrrgen.cli.arguments import (
    FindingsPrinter,
    fresh_option,
    json_option,
    output_option,
    print_json,
    robot_argument,
    robot_source,
)
from rrrgen.cli.response_experiment import simulate_response_runs
from rrrgen.cli.study_options import click_options
from rrrgen.cli.terminal import mark_failed, progress_bar, say, terminal_width
from rrrgen.lab.studies.simulate import SimulateOptions


@click.command()
@robot_argument
@click.option(
    "--trajectory",
    type=click.Path(path_type=Path, exists=True),
    help="Motion to follow: excitation.json or friction_motion.json of `rrrgen experiment excite`.",
)
@click.option(
    "--reference",
    type=click.Path(path_type=Path),
    metavar="LOG",
    help="Recording, or its mapping file, whose positions are followed.",
)
@click.option("--writing", is_flag=True, help="Follow the writing task of the experiment file; default: RRR in 10 s.")
@click.option(
    "--response",
    type=click.Path(path_type=Path, exists=True),
    help="Frequency response of a joint: response_excitation.json of `rrrgen experiment excite --response`.",
)
@output_option
@click_options(SimulateOptions)
@fresh_option
@json_option
def simulate(
    robot: str,
    trajectory: Path | None,
    reference: Path | None,
    writing: bool,
    response: Path | None,
    output: Path,
    options: SimulateOptions,
    fresh: bool,
    as_json: bool,
) -> int:
    """Simulate an experiment: the arm of the robot file follows a motion under feedback control.

    The arm has the links, friction, drives, encoders and torque limits of the robot file; an experiment file can add
    other friction laws, flexible joints, a flexible base, noise and the gains of the controller. Gains and observer
    are otherwise designed from the arm, with a modulus margin of 0.5 in all postures along the motion. Writes log.csv,
    the recording, and log.yaml, its mapping file for `rrrgen identify`, to DIR; with --response the recordings under
    feedback linearisation (14.34), (14.36), and response.yaml for `rrrgen response frf`. Exits with 1 if the
    arm does not follow the motion or its loop oscillates.

    \b
    Examples:
      rrrgen experiment simulate rrr --trajectory runs/excitation/results/excitation.json --torque-noise .05 -o runs/log
      rrrgen experiment simulate rrr --writing --experiment experiment.yaml -o runs/writing
      rrrgen experiment simulate runs/identified/results/robot.yaml --reference log.yaml -o runs/replayed
      rrrgen experiment simulate rrr --response runs/plan/results/response_excitation.json --base-mode 28 -o runs/q1
    """
    if [*(file is not None for file in (trajectory, reference, response)), writing].count(True) != 1:
        follow = "--trajectory FILE, --reference LOG, --writing or --response FILE"
        raise click.UsageError(f"say what to follow: {follow}, one of them")
    if response is not None:
        return simulate_response_runs(robot, response, options, output, fresh, as_json)
    from rrrgen.lab.studies.simulate import simulate as study

    with progress_bar() as progress:
        result = study(
            robot_source(robot),
            trajectory,
            options,
            reference=reference,
            folder=output,
            fresh=fresh,
            progress=progress,
            findings=FindingsPrinter(as_json),
        )
    for line in result.failures:
        click.echo(f"{mark_failed('FAIL')} {line}", err=True)
    log = output / "results" / "log.yaml"
    if as_json:
        print_json({"log": str(log), **result.to_json()})
    else:
        say(*result.lines(terminal_width()), f"recording in {log}")
    return 0 if result.ok else 1
