"""The command ``rrrgen identify``: estimate base parameters, drive inertia and friction from recordings."""

from __future__ import annotations

from pathlib import Path

import click

from rrrgen.cli.arguments import (
    FindingsPrinter,
    fresh_option,
    json_option,
    log_option,
    output_option,
    print_causes,
    robot_argument,
    robot_source,
    run_study,
    truncated_option,
)
from rrrgen.cli.study_options import click_options
from rrrgen.cli.terminal import say
from rrrgen.lab.studies.identify import IdentifyOptions


@click.command()
@robot_argument
@log_option
@truncated_option
@output_option
@click_options(IdentifyOptions)
@fresh_option
@json_option
def identify(
    robot: str,
    logs: tuple[Path, ...],
    skip_truncated_line: bool,
    output: Path,
    options: IdentifyOptions,
    fresh: bool,
    as_json: bool,
) -> int:
    """Estimate base parameters, drive inertia and friction from recordings.

    Every friction and drive parameter that ROBOT states, even as 0, is estimated. Writes to DIR the parameters with
    their standard deviations, figures, and robot.yaml with the physically consistent estimate, for `rrrgen generate`.

    \b
    Examples:
      rrrgen identify rrr --log runs/log.yaml -o runs/identified
      rrrgen identify my_arm.yaml --log log.yaml --split first:0.6 -o runs/identified
      rrrgen identify my_arm.yaml --log log.yaml --friction auto -o runs/identified_friction
    """
    from rrrgen.lab.studies.identify import identify as study

    findings = FindingsPrinter(as_json)
    result = run_study(
        study,
        robot_source(robot),
        logs,
        options,
        folder=output,
        fresh=fresh,
        findings=findings,
        skip_truncated_line=skip_truncated_line,
        as_json=as_json,
        last=f"results and figures in {output}",
    )
    say(*([] if as_json else result.loop_lines()))
    print_causes([cause for cause in result.diagnoses if cause not in findings.causes], as_json)
    return 0
