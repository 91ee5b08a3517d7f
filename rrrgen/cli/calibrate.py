"""The command ``rrrgen calibrate``: calibrate the geometry of a robot from measurements of its tip."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from rrrgen.base.errors import Fault, InputError, require
from rrrgen.cli.arguments import (
    FindingsPrinter,
    json_option,
    only_beside,
    read_with_warnings,
    refuse,
    robot_argument,
    robot_source,
    run_study,
)
from rrrgen.cli.study_options import click_options
from rrrgen.lab.studies.calibrate import CalibrateOptions

if TYPE_CHECKING:
    from rrrgen.lab.calibrate.measurements import Kind


@click.command()
@robot_argument
@click.option("--poses", type=click.Path(path_type=Path, dir_okay=False), metavar="FILE", help="CSV of measurements.")
@click.option("-o", "--output", type=click.Path(path_type=Path, dir_okay=False), help="Robot file (CSV with --choose).")
@click_options(CalibrateOptions)
@click.option(
    "--figure", type=click.Path(path_type=Path), metavar="STEM", help="Write the errors as STEM.svg and .png."
)
@click.option("--choose", type=click.IntRange(min=1), metavar="N", help="Choose N poses to measure instead.")
@click.option("--kind", type=click.Choice(["pose", "point", "distance", "height"]), default="pose", show_default=True,
              help="What --choose plans to measure.")  # fmt: skip
@click.option("--force", is_flag=True, help="Overwrite files.")
@json_option
def calibrate(
    robot: str,
    poses: Path | None,
    output: Path | None,
    options: CalibrateOptions,
    figure: Path | None,
    choose: int | None,
    kind: Kind,
    force: bool,
    as_json: bool,
) -> None:
    """Calibrate the geometry of a robot from measured poses, points, distances, heights or contacts.

    The CSV file has a column per joint (its name, or q1, q2, ...) and x y z with qw qx qy qz, with roll pitch yaw or
    alone, or distance (to the origin of the world frame), or height (over its plane z = 0, or along nx ny nz), in m and
    rad unless the header says otherwise, as in x [mm]; or the name of an unknown plane that the tip touched (plane), of
    a point (contact), of a draw wire (wire, distance). Of all geometric parameters a minimal set is estimated; which
    ones the measurements cannot tell apart is printed. The world frame is that of the measuring device; base and tool
    are estimated too.

    \b
    Examples:
      rrrgen calibrate ur10e --choose 50 -o poses.csv
      rrrgen calibrate ur10e --poses measured.csv -o calibrated.yaml --figure errors
    """
    from rrrgen.base.files import write_file
    from rrrgen.lab.studies.calibrate import calibrate as study

    if (poses is None) == (choose is None):
        raise click.UsageError("give one of --poses FILE and --choose N")
    if choose is None:
        refuse(["kind"], "goes with --choose")
    else:
        only_beside("--choose", "robot", "output", "choose", "kind", "gains", "seed", "force")
    if output is not None and output.exists() and not force:
        raise InputError([Fault(str(output), 0, 0, "the file exists already", hint="--force overwrites it")])
    if figure is not None:
        require("the figure of errors", "matplotlib")
    if choose is not None:
        _choose(robot, options, kind, choose, output)
        return
    assert poses is not None
    findings = FindingsPrinter(as_json)
    result = run_study(study, robot_source(robot), poses, options, findings=findings, as_json=as_json)
    if figure is not None:
        from rrrgen.lab.data.figure_style import save_figure

        save_figure(result.plot(), figure)
    if output is not None:
        write_file(output, result.robot_file())
        click.echo(f"{output} written", err=as_json)


def _choose(robot: str, options: CalibrateOptions, kind: Kind, count: int, output: Path | None) -> None:
    """Print or write joint positions at which to measure."""
    from rrrgen.base.files import write_file
    from rrrgen.lab.calibrate.geometry import geometry_of
    from rrrgen.lab.calibrate.minimal_set import choose_poses

    spec = read_with_warnings(robot)
    nominal = geometry_of(spec)
    q, gain = choose_poses(spec, nominal.with_gains() if options.gains else nominal, kind, count, options.seed)
    lines = [",".join(joint.name for joint in spec.joints)]
    lines += [",".join(f"{value:.6f}" for value in row) for row in q]
    text = "\n".join(lines) + "\n"
    if output is None:
        click.echo(text, nl=False)
    else:
        write_file(output, text)
    click.echo(f"{count} poses, {100 * (gain - 1):.0f} % more precise than random ones; not checked for collisions",
               err=True)  # fmt: skip
