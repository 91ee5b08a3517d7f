"""The command ``rrrgen experiment elastic-joints``: stiffness, damping and rotor inertia of the joints."""

from __future__ import annotations

from pathlib import Path
from typing import Any

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
from rrrgen.lab.studies.estimate_elastic_joints import ElasticJointsOptions


@click.command()
@robot_argument
@log_option
@click.option(
    "--link",
    "links",
    multiple=True,
    type=click.Path(path_type=Path),
    help="Recording, or its mapping file, of the link positions at the same times; one for each --log.",
)
@truncated_option
@output_option
@click_options(ElasticJointsOptions)
@fresh_option
@json_option
def elastic_joints(
    robot: str,
    logs: tuple[Path, ...],
    links: tuple[Path, ...],
    output: Path,
    options: ElasticJointsOptions,
    as_json: bool,
    **more: Any,
) -> int:
    """Estimate stiffness, damping and rotor inertia of elastic joints, with the parameters of the links.

    The recordings hold the positions of the motors, seen at the joints, and the torques. The motion must be excited up
    to the resonances. The masses of ROBOT are not used. Writes elastic_joints.json to DIR. Exits with 1 if the
    torques of a joint are not explained, and with 4 if no joint shows that it is elastic.

    \b
    Example:
      rrrgen experiment elastic-joints arm.yaml --log motors.yaml -o runs/elastic
    """
    from rrrgen.lab.studies.estimate_elastic_joints import estimate_elastic_joints

    result = run_study(
        estimate_elastic_joints,
        robot_source(robot),
        logs,
        options,
        links=list(links) or None,
        folder=output,
        findings=FindingsPrinter(as_json),
        as_json=as_json,
        last=f"results in {output}",
        **more,
    )
    return 0 if result.trusted else 1
