"""The command ``rrrgen experiment excite``: design an exciting trajectory for identification."""

from __future__ import annotations

from pathlib import Path

import click

from rrrgen.cli.arguments import (
    FindingsPrinter,
    fresh_option,
    json_option,
    output_option,
    robot_argument,
    robot_source,
    run_study,
)
from rrrgen.cli.friction_experiment import excite_friction
from rrrgen.cli.response_experiment import excite_response
from rrrgen.cli.study_options import click_options
from rrrgen.lab.studies.excite import ExciteOptions


@click.command()
@robot_argument
@output_option
@click.option(
    "--response",
    metavar="JOINT",
    help="Excite one joint for its frequency response instead; '-' for the joint that the experiment file names.",
)
@click.option(
    "--friction",
    metavar="JOINT",
    help="Move one joint for `rrrgen experiment friction` instead: a fast multisine, then slow reversals; "
    "40 s unless --duration.",
)
@click_options(ExciteOptions)
@fresh_option
@json_option
def excite(
    robot: str,
    output: Path,
    response: str | None,
    friction: str | None,
    options: ExciteOptions,
    fresh: bool,
    as_json: bool,
) -> int:
    """Design an exciting trajectory within the limits of a robot file, or of an experiment file.

    Minimises the condition number of the regressor from several random starts and checks every limit at the rate of the
    controller. Writes the coefficients (JSON), the samples for the controller (CSV) and figures to DIR.

    With --response the frequency-response experiment of one joint is designed instead: the excitation n (a random-phase
    multisine, noise or a swept sine) of the control u = -Kp e - Kd de + n (14.36), and a speed so high that the joint
    never reverses. The section `response` of the experiment file has its settings.

    \b
    Examples:
      rrrgen experiment excite rrr -o runs/excitation --jobs 2
      rrrgen experiment excite rrr --experiment experiment.yaml -o runs/excitation
      rrrgen experiment excite rrr --response q1 -o runs/plan
      rrrgen experiment excite rrr --friction q3 -o runs/friction-motion
    """
    if friction is not None:
        return excite_friction(robot, friction, response, options, output, fresh, as_json)
    if response is not None:
        return excite_response(robot, response, options, output, fresh, as_json)
    from rrrgen.lab.studies.excite import excite as study

    run_study(
        study,
        robot_source(robot),
        options,
        folder=output,
        fresh=fresh,
        findings=FindingsPrinter(as_json),
        as_json=as_json,
        last=f"results and figures in {output}",
    )
    return 0
