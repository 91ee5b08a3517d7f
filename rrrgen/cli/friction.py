"""The command ``rrrgen experiment friction``: estimate friction, inertia and gravity of one joint from a recording."""

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
    truncated_option,
)
from rrrgen.cli.study_options import click_options
from rrrgen.cli.terminal import say
from rrrgen.lab.studies.estimate_friction import FrictionOptions


@click.command()
@robot_argument
@click.option(
    "--log",
    required=True,
    type=click.Path(path_type=Path),
    help="Recording with rrrgen's own columns, or mapping file of a recording.",
)
@truncated_option
@click.option("--joint", required=True, metavar="NAME", help="The joint that moves; the others stand still.")
@click.option(
    "--presliding",
    multiple=True,
    type=click.Path(path_type=Path),
    help="Recording of the joint below break-away under a periodic multisine; repeat with another amplitude.",
)
@click_options(FrictionOptions)
@output_option
@fresh_option
@json_option
def friction(
    robot: str,
    log: Path,
    skip_truncated_line: bool,
    joint: str,
    presliding: tuple[Path, ...],
    options: FrictionOptions,
    output: Path,
    fresh: bool,
    as_json: bool,
) -> int:
    """Estimate friction, inertia and gravity of one joint, (14.15).

    In the recording this joint moves and all others stand still; design the motion with
    `rrrgen experiment excite --friction`.
    Coulomb-viscous, asymmetric, Stribeck, LuGre and neural laws are estimated by an extended Kalman filter and refined
    by output error. One of them is chosen by its error on windows that were not fitted, and with --controller refined
    in the simulated closed loop. With --presliding, stiffness and damping of the bristles at rest (14.16) are
    estimated too. Writes results/friction.json, the robot file with this law, and a figure of friction against speed
    to DIR.

    \b
    Example:
      rrrgen experiment friction rrr --log runs/joint3/log.yaml --joint q3 -o runs/friction3
    """
    from rrrgen.lab.studies.estimate_friction import estimate_friction

    result = run_study(
        estimate_friction,
        robot_source(robot),
        log,
        options,
        joint=joint,
        presliding=presliding,
        folder=output,
        fresh=fresh,
        findings=FindingsPrinter(as_json),
        skip_truncated_line=skip_truncated_line,
        as_json=as_json,
        last=f"results and figures in {output}",
    )
    say(*([] if as_json else result.loop_lines()))
    return 0
