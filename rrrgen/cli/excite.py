"""The command ``rrrgen excite``: design an exciting trajectory for identification."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

import click

from rrrgen.base.extras import require
from rrrgen.cli.arguments import json_option, print_json, read_with_warnings, robot_argument
from rrrgen.cli.friction_experiment import excite_friction
from rrrgen.cli.progress import progress_bar
from rrrgen.cli.response_experiment import excite_response
from rrrgen.cli.terminal import say
from rrrgen.cli.workflow import (
    chosen_experiment,
    described_files,
    experiment_option,
    jobs_options,
    output_option,
    parallel_packages,
    seed_option,
)


@click.command()
@robot_argument
@output_option
@experiment_option
@click.option(
    "--response",
    metavar="JOINT",
    help="Excite one joint for its frequency response instead; '-' for the joint that the experiment file names.",
)
@click.option(
    "--friction",
    metavar="JOINT",
    help="Move one joint for `rrrgen friction` instead: a fast multisine, then slow reversals; 40 s unless --duration.",
)
@click.option("--harmonics", type=click.IntRange(min=1), help="Number of harmonics of the Fourier series; default 15.")
@click.option("--duration", "cycle", type=float, metavar="S", help="Period of the motion in seconds; default 10.")
@click.option("--rate", type=float, metavar="HZ", help="Sampling rate of the controller; default 1000.")
@click.option("--starts", type=click.IntRange(min=1), help="Number of random starts of the search; default 4.")
@jobs_options
@seed_option(default=None)
@click.option("--fresh", is_flag=True, help="Discard a run that DIR already holds, and start over.")
@json_option
def excite(robot: str, output: Path, as_json: bool, **options: Any) -> int:
    """Design an exciting trajectory within the limits of a robot file, or of an experiment file.

    Minimises the condition number of the regressor from several random starts and checks every limit at the rate of the
    controller. Writes the coefficients (JSON), the samples for the controller (CSV) and figures to DIR.

    With --response the frequency-response experiment of one joint is designed instead: the excitation n (a random-phase
    multisine, noise or a swept sine) of the control u = -Kp e - Kd de + n (14.36), and a speed so high that the joint
    never reverses. The section `response` of the experiment file has its settings.

    \b
    Examples:
      rrrgen excite rrr -o runs/excitation --jobs 2
      rrrgen excite rrr --experiment experiment.yaml -o runs/excitation
      rrrgen excite rrr --response q1 -o runs/response-excitation
      rrrgen excite rrr --friction q3 -o runs/friction-motion
    """
    if options["friction"] is not None:
        require("rrrgen excite", "matplotlib")
        spec = read_with_warnings(robot)
        chosen = chosen_experiment(options["experiment"], spec.n, {**options, "cycle": None, "harmonics": None})
        return excite_friction(robot, spec, chosen, output, options, as_json)
    if options["response"] is not None:
        require("rrrgen excite", "matplotlib")
        spec = read_with_warnings(robot)
        chosen = chosen_experiment(options["experiment"], spec.n, options)
        return excite_response(robot, spec, chosen, output, options, as_json)
    require("rrrgen excite", "casadi", "matplotlib", *parallel_packages(options))
    from rrrgen.lab.data.run_folder import RunFolder
    from rrrgen.lab.design.design import design_excitation
    from rrrgen.lab.design.plots import plot_convergence, plot_motion, plot_singular_values
    from rrrgen.lab.design.robot import limits_of
    from rrrgen.lab.experiment.setup import problem_of
    from rrrgen.runtime import load

    spec = read_with_warnings(robot)
    experiment = chosen_experiment(options["experiment"], spec.n, options)
    settings = {name: options[name] for name in ("harmonics", "cycle", "rate", "starts")}
    settings["limits"] = asdict(limits_of(spec))
    inputs = described_files(robot=Path(robot), experiment=options["experiment"])
    with (
        RunFolder(output, "excite", inputs, settings, experiment.seed, options["fresh"]) as folder,
        progress_bar() as progress,
    ):
        problem = problem_of(experiment, load.compile(spec))
        design = design_excitation(
            problem,
            experiment.starts,
            seed=experiment.seed,
            jobs=options["jobs"],
            cluster=options["cluster"],
            checkpoints=folder.checkpoint("starts"),
            progress=progress,
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
        say(f"condition number {check.condition:.4g} with {problem.columns} columns, all limits met")
        say(f"results and figures in {output}")
    return 0
