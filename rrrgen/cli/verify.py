"""The command ``rrrgen verify``: compare every function of a model with independent dynamics at random states."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import click

from rrrgen.cli.arguments import (
    json_option,
    read_with_warnings,
    real_option,
    robot_argument,
)
from rrrgen.cli.html import html_option, write_html
from rrrgen.cli.terminal import progress_bar, terminal_width, verdict, with_failures

if TYPE_CHECKING:
    from rrrgen.emit import Real
    from rrrgen.runtime.engines import EngineName
    from rrrgen.verify.report import Report


@click.command()
@robot_argument
@click.option("--samples", type=click.IntRange(min=1), default=200, show_default=True, help="Number of random states.")
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Seed of the random states.")
@click.option(
    "--backend",
    type=click.Choice(["c", "numpy"]),
    default="c",
    show_default=True,
    help="What to verify: the compiled C code, or the reference evaluation, which needs no compiler.",
)
@real_option
@click.option(
    "--libraries/--no-libraries", default=True, help="Also compare with Pinocchio, MuJoCo and Robotics Toolbox."
)
@click.option("--hessians", is_flag=True, help="Also derive and compare the second derivatives.")
@click.option(
    "--bounds", is_flag=True, help="Also prove bounds of the rounding errors, and sample and search for larger errors."
)
@html_option
@json_option
def verify(
    robot: str,
    samples: int,
    seed: int,
    backend: EngineName,
    real: Real,
    libraries: bool,
    hessians: bool,
    bounds: bool,
    html: Path | None,
    as_json: bool,
) -> int:
    """Compare every function of a model with independent dynamics at random states.

    The reference is a Newton-Euler recursion that shares no code with the compiler and, if they are installed,
    Pinocchio, MuJoCo and the Robotics Toolbox. The inverse kinematics is compared with an independent forward
    kinematics and, for --samples / 20 targets, with a numerical search. Prints the largest relative differences and a
    verdict; exits with 1 on failure.

    \b
    Examples:
      rrrgen verify rrr
      rrrgen verify my_robot.yaml --samples 1000 --real float --json
      rrrgen verify scara --html scara.html
    """
    from rrrgen.derive import derive_once
    from rrrgen.runtime import load
    from rrrgen.verify import verify as compare

    if backend == "numpy" and real == "float":
        raise click.UsageError("--real float belongs to --backend c: the reference evaluation computes in double")
    spec = read_with_warnings(robot)
    with progress_bar() as tell:
        model = load.compile(spec, backend, real)
        report = compare(model, samples, seed, libraries=libraries, hessians=hessians, tell=tell)
        if bounds:
            from rrrgen.evidence.boxes import Ranges
            from rrrgen.evidence.statements import rounding_rows

            rows, skipped = rounding_rows(model, Ranges(), samples, seed, tell)
            report = replace(report, rows=(*report.rows, *rows), skipped=(*report.skipped, *skipped))
    if html is not None:
        write_html(html, derive_once(spec), report)
    click.echo(report.to_json() if as_json else _colour_report(report), nl=False)
    return 0 if report.ok else 1


def _colour_report(report: Report) -> str:
    """Print the report as text, with failures and the verdict in its last line in colour."""
    *table, last = report.to_text(terminal_width()).splitlines()
    return "\n".join([*map(with_failures, table), verdict(last, report.ok)]) + "\n"
