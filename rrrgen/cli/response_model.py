"""The command ``rrrgen response model``: fit a linear model with resonances to a recording or frequency response."""

from __future__ import annotations

from pathlib import Path

import click

from rrrgen.cli.arguments import FindingsPrinter, fresh_option, json_option, output_option, robot_source, run_study
from rrrgen.cli.study_options import click_options
from rrrgen.lab.studies.fit_response import FitResponseOptions


@click.command(name="response-model")
@click.argument("log", type=click.Path(path_type=Path), metavar="LOG_OR_FRF")
@output_option
@click_options(FitResponseOptions)
@click.option("--robot", metavar="ROBOT", help="With --experiment: also compute the resonances.")
@click.option("--experiment", type=click.Path(path_type=Path), help="Experiment file with elastic parts and postures.")
@click.option("--joint", metavar="NAME", help="Joint of the response, if the experiment file does not state it.")
@fresh_option
@json_option
def response_model(
    log: Path,
    output: Path,
    options: FitResponseOptions,
    robot: str | None,
    experiment: Path | None,
    joint: str | None,
    fresh: bool,
    as_json: bool,
) -> int:
    """Fit a linear model with its resonances to a recording (response file) or to a frf.json of `rrrgen response frf`.

    auto fits modes to the frequency response where the recording has an excitation beside the input (a closed loop),
    and otherwise a difference equation: ARX, ARMAX or output error. Orders are chosen within the rows to fit. Several
    postures get a model each. Writes results/response_model.json, C of one step of the model in state space, and
    figures. Exits with 1 where the response of a posture cannot be trusted.

    --robot and --experiment, the file that `rrrgen experiment simulate --response` reads, print the resonances that the
    mass matrix of the robot and the elastic joints and base of the experiment lead to beside the measured ones.

    \b
    Example:
      rrrgen response model runs/response/results/frf.json -o runs/model
      rrrgen response model arm.yaml --fit-rows 1:512 -o runs/model
    """
    from rrrgen.lab.studies.fit_response import fit_response

    result = run_study(
        fit_response,
        log,
        options,
        robot=None if robot is None else robot_source(robot),
        experiment=experiment,
        joint=joint,
        folder=output,
        fresh=fresh,
        findings=FindingsPrinter(as_json),
        as_json=as_json,
    )
    return 1 if result.refused else 0
