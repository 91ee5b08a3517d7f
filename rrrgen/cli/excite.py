"""``rrrgen excite``."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

import click

from rrrgen.cli.arguments import json_option, print_json, read_with_warnings, robot_argument
from rrrgen.cli.progress import progress_bar
from rrrgen.cli.workflow import jobs_options, output_option, seed_option


@click.command()
@robot_argument
@output_option
@click.option("--harmonics", type=click.IntRange(min=1), default=15, show_default=True, help="Of the Fourier series.")
@click.option("--duration", type=float, default=10.0, show_default=True, help="Period of the motion, s.")
@click.option("--rate", type=float, default=1000.0, show_default=True, help="Of the controller, Hz.")
@click.option("--starts", type=click.IntRange(min=1), default=4, show_default=True, help="Starts of the search.")
@jobs_options
@seed_option
@click.option("--fresh", is_flag=True, help="Start over in a folder of another run.")
@json_option
def excite(robot: str, output: Path, as_json: bool, **options: Any) -> int:
    """Design an exciting trajectory within the joint limits of a robot file.

    The condition number of the regressor is minimised from several starts; every limit is checked at the controller's
    rate. DIR gets the coefficients (JSON), samples for the controller (CSV) and figures.

    \b
    Example:
      rrrgen excite rrr -o runs/excitation --jobs 2
    """
    from rrrgen import pipeline
    from rrrgen.identify.excitation import design_excitation
    from rrrgen.identify.excitation_model import limits_of, robot_problem
    from rrrgen.identify.excitation_plots import plot_convergence, plot_motion, plot_singular_values
    from rrrgen.identify.run_folder import RunFolder

    spec = read_with_warnings(robot)
    limits = limits_of(spec)
    names = ("harmonics", "duration", "rate", "starts")
    settings = {**{name: options[name] for name in names}, "limits": asdict(limits)}
    inputs = {"robot": Path(robot)} if Path(robot).is_file() else {}
    with (
        RunFolder(output, "excite", inputs, settings, options["seed"], options["fresh"]) as folder,
        progress_bar() as tell,
    ):
        problem = robot_problem(
            pipeline.compile(spec),
            limits,
            harmonics=options["harmonics"],
            base_frequency=1.0 / options["duration"],
            sample_period=1.0 / options["rate"],
        )
        design = design_excitation(
            problem,
            options["starts"],
            seed=options["seed"],
            jobs=options["jobs"],
            cluster=options["cluster"],
            checkpoints=folder.checkpoint("starts"),
            progress=tell,
        )
        results = folder.path / "results"
        results.mkdir(parents=True, exist_ok=True)
        design.write(results)
        folder.figure("motion", plot_motion(design.trajectory))
        folder.figure("singular_values", plot_singular_values(design))
        folder.figure("convergence", plot_convergence(design))
    if as_json:
        print_json(design.to_json())
    else:
        check = design.best.check
        click.echo(f"condition number {check.condition:.4g} with {problem.columns} columns, all limits met")
        click.echo(f"results and figures in {output}")
    return 0
