"""The command ``rrrgen response matrix``: the frequency response of a whole arm from several experiments."""

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
from rrrgen.lab.studies.matrix_response import MatrixResponseOptions


@click.command(name="matrix")
@robot_argument
@log_option
@truncated_option
@output_option
@click_options(MatrixResponseOptions)
@fresh_option
@json_option
def matrix(
    robot: str, logs: tuple[Path, ...], output: Path, options: MatrixResponseOptions, as_json: bool, **more: Any
) -> int:
    """Estimate the frequency response of a whole arm, from the torques of all joints to all positions.

    The recordings are those of experiments with a periodic excitation, in every posture as many as joints or more, each
    excited in its own way. Writes matrix_response.json to DIR: all elements with 95 % bands, the resonances that they
    share, and, where ROBOT states masses, stiffness and inertia of the drives, those that these lead to. Exits with 1
    if a recording cannot be trusted.

    \b
    Example:
      rrrgen response matrix arm.yaml --log first.yaml --log second.yaml --period 2 -o runs/matrix
    """
    from rrrgen.lab.studies.matrix_response import matrix_response

    result = run_study(
        matrix_response,
        robot_source(robot),
        logs,
        options,
        folder=output,
        findings=FindingsPrinter(as_json),
        as_json=as_json,
        last=f"results in {output}",
        **more,
    )
    return 0 if result.trusted else 1
