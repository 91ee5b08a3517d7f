"""The command ``rrrgen experiment validate``: compare the torques of a robot file with recorded ones."""

from __future__ import annotations

from pathlib import Path

import click

from rrrgen.cli.arguments import (
    FindingsPrinter,
    fresh_option,
    json_option,
    log_option,
    output_option,
    print_json,
    robot_argument,
    robot_source,
    truncated_option,
)
from rrrgen.cli.study_options import click_options
from rrrgen.cli.terminal import progress_bar, say, terminal_width, verdict
from rrrgen.lab.studies.validate import ValidateOptions


@click.command()
@robot_argument
@log_option
@truncated_option
@output_option
@click_options(ValidateOptions)
@fresh_option
@json_option
def validate(
    robot: str,
    logs: tuple[Path, ...],
    skip_truncated_line: bool,
    output: Path,
    options: ValidateOptions,
    fresh: bool,
    as_json: bool,
) -> int:
    """Compare the torques of a robot file (rigid body, drives, friction) with recorded ones.

    Prints the RMS error of each joint, relative errors, the share of random poses with an indefinite mass matrix, and a
    verdict; exits with 1 if a threshold is missed. A robot file written by `rrrgen identify` states which samples it
    was fitted to; their share in the recordings is printed. For other robot files, state it with --fitted-on.

    \b
    Example:
      rrrgen experiment validate runs/identified/results/robot.yaml --log runs/writing/results/log.yaml -o validated
    """
    from rrrgen.lab.studies.validate import validate as study

    with progress_bar() as progress:
        result = study(
            robot_source(robot),
            logs,
            options,
            folder=output,
            fresh=fresh,
            progress=progress,
            findings=FindingsPrinter(as_json),
            skip_truncated_line=skip_truncated_line,
        )
    if as_json:
        print_json(result.to_json())
    else:
        say(*result.lines(terminal_width(), verdict))
    return 0 if result.passed else 1
