"""The command ``rrrgen experiment contact-thresholds``: thresholds of contact detection."""

from __future__ import annotations

from pathlib import Path

import click

from rrrgen.cli.arguments import (
    FindingsPrinter,
    fresh_option,
    json_option,
    log_option,
    output_option,
    robot_argument,
    robot_source,
    run_study,
    truncated_option,
)
from rrrgen.cli.study_options import click_options
from rrrgen.lab.studies.contact_thresholds import ContactOptions


@click.command()
@robot_argument
@log_option
@truncated_option
@output_option
@click_options(ContactOptions)
@fresh_option
@json_option
def contact_thresholds(
    robot: str,
    logs: tuple[Path, ...],
    skip_truncated_line: bool,
    output: Path,
    options: ContactOptions,
    fresh: bool,
    as_json: bool,
) -> int:
    """Find thresholds of contact detection from recordings without contact.

    The momentum observer runs along the recordings as it does in the controller, and an extreme-value distribution is
    fitted to the largest residual in every second, and to its fastest change. From them follow the thresholds for a
    given mean time between false alarms, and the delay with which a force at the tip will be detected. Writes
    contact.json, and <name>_contact.h with the thresholds for the C function `contact` and the covariance for
    `external_force` and `external_wrench`, to DIR. Record motions like those of normal work, with the torques that were
    applied.

    \b
    Example:
      rrrgen experiment contact-thresholds runs/identified/results/robot.yaml --log work.yaml -o runs/contact
    """
    from rrrgen.lab.studies.contact_thresholds import contact_thresholds as study

    run_study(
        study,
        robot_source(robot),
        logs,
        options,
        folder=output,
        fresh=fresh,
        findings=FindingsPrinter(as_json),
        skip_truncated_line=skip_truncated_line,
        as_json=as_json,
        last=f"results in {output}",
    )
    return 0
