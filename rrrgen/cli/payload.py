"""The command ``rrrgen experiment payload``: estimate mass, centre of mass and inertia of a payload."""

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
from rrrgen.lab.studies.estimate_payload import PayloadOptions


@click.command()
@robot_argument
@log_option
@truncated_option
@output_option
@click_options(PayloadOptions)
@fresh_option
@json_option
def payload(
    robot: str,
    logs: tuple[Path, ...],
    skip_truncated_line: bool,
    output: Path,
    options: PayloadOptions,
    fresh: bool,
    as_json: bool,
) -> int:
    """Estimate mass, centre of mass and inertia of a payload at the last link of a known arm.

    Writes payload.json, and robot.yaml with the payload as a part of the last link, to DIR. Half a minute of a motion
    in which the last joints move through many directions of gravity is enough. Samples near rest are left out. Exits
    with 4 if no payload explains the torques, or the motion does not determine the mass; other values that it does not
    determine are marked.

    \b
    Example:
      rrrgen experiment payload runs/identified/results/robot.yaml --log carrying.yaml -o runs/payload
    """
    from rrrgen.lab.studies.estimate_payload import estimate_payload

    run_study(
        estimate_payload,
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
