"""The command ``rrrgen experiment drive-gains``: torque constants from a known payload."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from rrrgen.base.errors import DerivationError
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
from rrrgen.lab.studies.estimate_drive_gains import DriveGainsOptions


@click.command()
@robot_argument
@log_option
@click.option(
    "--loaded",
    required=True,
    multiple=True,
    type=click.Path(path_type=Path),
    help="Recording, or its mapping file, with the payload; --log is the one without. Repeat for several.",
)
@click.option("--mass", required=True, type=click.FloatRange(min=0, min_open=True), help="Mass of the payload, kg.")
@click.option(
    "--com",
    nargs=3,
    type=float,
    default=(0.0, 0.0, 0.0),
    help="Centre of mass in the last link frame, m; default: its origin.",
)
@click.option(
    "--inertia",
    nargs=6,
    type=float,
    default=(0.0,) * 6,
    metavar="XX YY ZZ XY XZ YZ",
    help="Inertia tensor about the centre of mass in its axes, kg m^2; default: a point mass.",
)
@truncated_option
@output_option
@click_options(DriveGainsOptions)
@fresh_option
@json_option
def drive_gains(
    robot: str,
    logs: tuple[Path, ...],
    loaded: tuple[Path, ...],
    output: Path,
    options: DriveGainsOptions,
    as_json: bool,
    **more: Any,
) -> int:
    """Estimate unknown drive gains (torque constants) from recordings without and with a known payload.

    The masses of ROBOT are not used: all parameters of the arm are estimated too, in the units of the payload. Writes
    drive_gains.json to DIR. Exits with 4 if no gains explain the torques, or if the payload hardly loads a joint, whose
    gain is then not determined.

    \b
    Example:
      rrrgen experiment drive-gains my_arm.yaml --log empty.yaml --loaded carrying.yaml --mass 1 --com 0 0 0.05 -o gains
    """
    from rrrgen.lab.studies.estimate_drive_gains import estimate_drive_gains

    result = run_study(
        estimate_drive_gains,
        robot_source(robot),
        logs,
        loaded,
        options,
        folder=output,
        findings=FindingsPrinter(as_json),
        as_json=as_json,
        last=f"results in {output}",
        **more,
    )
    return DerivationError.exit_code if result.gains.undetermined else 0
