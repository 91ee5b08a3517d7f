"""The command ``rrrgen calibrate``: calibrate the geometry of a robot from measurements of its tip."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from rrrgen.base.errors import Fault, InputError
from rrrgen.cli.arguments import print_json, read_with_warnings, robot_argument
from rrrgen.cli.progress import working

if TYPE_CHECKING:
    from rrrgen.lab.calibrate.geometry import Geometry
    from rrrgen.lab.calibrate.measurements import Kind
    from rrrgen.robot.robot_spec import RobotSpec


@click.command()
@robot_argument
@click.option("--poses", type=click.Path(path_type=Path, dir_okay=False), metavar="FILE", help="CSV of measurements.")
@click.option("-o", "--output", type=click.Path(path_type=Path, dir_okay=False), help="Robot file (CSV with --choose).")
@click.option("--sigma", type=click.FloatRange(0, min_open=True), default=5e-5, show_default=True, metavar="M",
              help="Standard deviation of a measured length.")  # fmt: skip
@click.option("--sigma-angle", type=click.FloatRange(0, min_open=True), default=1e-4, show_default=True, metavar="RAD",
              help="Standard deviation of a measured angle.")  # fmt: skip
@click.option("--gains", is_flag=True, help="Estimate a gain of each joint too: errors of gear ratios and scales.")
@click.option("--robust", is_flag=True, help="Set outliers aside: Huber's weights, then Tukey's.")
@click.option(
    "--figure", type=click.Path(path_type=Path), metavar="STEM", help="Write the errors as STEM.svg and .png."
)
@click.option("--choose", type=click.IntRange(min=1), metavar="N", help="Choose N poses to measure instead.")
@click.option("--kind", type=click.Choice(["pose", "point", "distance", "height"]), default="pose", show_default=True,
              help="What --choose plans to measure.")  # fmt: skip
@click.option("--seed", type=int, default=0, show_default=True, help="Seed of the candidates of --choose.")
@click.option("--force", is_flag=True, help="Overwrite files.")
@click.option("--json", "as_json", is_flag=True, help="Print JSON on stdout.")
def calibrate(
    robot: str,
    poses: Path | None,
    output: Path | None,
    sigma: float,
    sigma_angle: float,
    gains: bool,
    robust: bool,
    figure: Path | None,
    choose: int | None,
    kind: Kind,
    seed: int,
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
    from rrrgen.base.extras import require
    from rrrgen.base.files import write_file
    from rrrgen.lab.calibrate.diagnosis import estimate_checked
    from rrrgen.lab.calibrate.geometry import geometry_of
    from rrrgen.lab.calibrate.measurement_file import read_table
    from rrrgen.lab.calibrate.pose_choice import random_positions
    from rrrgen.lab.calibrate.report import plot_residuals, to_data, to_text
    from rrrgen.lab.calibrate.robot_file import calibrated_spec
    from rrrgen.robot.file import dumps

    if (poses is None) == (choose is None):
        raise click.UsageError("give one of --poses FILE and --choose N")
    if output is not None and output.exists() and not force:
        raise InputError([Fault(str(output), 0, 0, "the file exists already", hint="--force overwrites it")])
    if figure is not None:
        require("the figure of errors", "matplotlib")
    spec = read_with_warnings(robot)
    nominal = geometry_of(spec)
    if gains:
        nominal = nominal.with_gains()
    if choose is not None:
        _choose(spec, nominal, kind, choose, seed, output)
        return
    assert poses is not None
    table = read_table(poses, [joint.name for joint in spec.joints])
    measured = table.measurements(sigma, sigma_angle)
    with working("estimating the geometry"):
        found = estimate_checked(nominal, measured, table, robust)
    inside = random_positions(spec, 1000, seed)
    if as_json:
        print_json(to_data(found, measured, inside))
    else:
        click.echo(to_text(found, measured, inside), nl=False)
    if figure is not None:
        plot_residuals(found, measured, figure)
    if output is not None:
        source = f"calibrated from {len(measured.q)} measurements ({measured.kind}) of {poses.name}"
        write_file(output, dumps(calibrated_spec(spec, found.geometry, source)))
        click.echo(f"{output} written", err=as_json)


def _choose(spec: RobotSpec, nominal: Geometry, kind: Kind, count: int, seed: int, output: Path | None) -> None:
    from rrrgen.base.files import write_file
    from rrrgen.lab.calibrate.pose_choice import choose_poses

    q, gain = choose_poses(spec, nominal, kind, count, seed)
    lines = [",".join(joint.name for joint in spec.joints)]
    lines += [",".join(f"{value:.6f}" for value in row) for row in q]
    text = "\n".join(lines) + "\n"
    if output is None:
        click.echo(text, nl=False)
    else:
        write_file(output, text)
    click.echo(f"{count} poses, {100 * (gain - 1):.0f} % more precise than random ones; not checked for collisions",
               err=True)  # fmt: skip
