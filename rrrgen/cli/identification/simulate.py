"""``rrrgen simulate``."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rrrgen.cli.arguments import json_option, print_json, read_with_warnings, robot_argument
from rrrgen.cli.identification.workflow import (
    chosen_experiment,
    described_files,
    experiment_option,
    output_option,
    read_trajectory,
    seed_option,
)
from rrrgen.cli.progress import progress_bar

if TYPE_CHECKING:
    from rrrgen.experiments.experiment_file import Experiment
    from rrrgen.runtime.model import Model
from rrrgen.extras import require


@click.command()
@robot_argument
@click.option(
    "--trajectory",
    type=click.Path(path_type=Path, exists=True),
    help="excitation.json of `rrrgen excite`: the motion to follow.",
)
@click.option("--writing", is_flag=True, help="Follow the writing task of the experiment file, by default RRR in 10 s.")
@output_option
@experiment_option
@click.option("--duration", type=float, help="Of the experiment, s; one period of the motion by default.")
@click.option("--rate", type=float, help="Of the controller, Hz; 1000 by default.")
@click.option("--bandwidth", type=float, help="Of the control, Hz; 4 by default.")
@click.option(
    "--control",
    type=click.Choice(["pd", "computed-torque"]),
    help="PD (14.25), the default, or computed torque with the robot file's own model (14.34).",
)
@click.option("--torque-noise", type=float, help="Standard deviation, N m; none by default.")
@click.option("--base-mode", type=float, metavar="HZ", help="A damped mode of the base, as 28 in the case study.")
@seed_option(default=None)
@click.option("--fresh", is_flag=True, help="Start over in a folder of another run.")
@json_option
def simulate(robot: str, output: Path, as_json: bool, **options: Any) -> int:
    """Run an experiment on the virtual robot of a robot file: its links, friction, drives, encoders and torque limits.

    An experiment file adds any friction law, flexible joints, a flexible base, noise, gains. DIR gets log.csv and
    log.yaml, the recording and its mapping file, as `rrrgen identify` takes them.

    \b
    Examples:
      rrrgen simulate rrr --trajectory runs/excitation/results/excitation.json --torque-noise 0.05 -o runs/experiment
      rrrgen simulate rrr --writing --experiment experiment.yaml -o runs/writing
    """
    require("rrrgen simulate", "scipy")
    from rrrgen import pipeline
    from rrrgen.experiments.experiment_setup import simulate_motion
    from rrrgen.runs.run_folder import RunFolder
    from rrrgen.simulate.recording import write_recording

    if (options["trajectory"] is None) is not options["writing"]:
        raise click.UsageError("say what to follow: --trajectory FILE or --writing, one of them")
    spec = read_with_warnings(robot)
    experiment = chosen_experiment(options["experiment"], spec.n, options)
    model = pipeline.compile(spec)
    if model.beta is None:
        raise click.UsageError(f"{robot} has no links: there is nothing to simulate")
    motion, period = _motion(model, experiment, options["trajectory"])
    names = ("writing", "duration", "rate", "bandwidth", "control", "torque_noise", "base_mode")
    inputs = described_files(robot=Path(robot), trajectory=options["trajectory"], experiment=options["experiment"])
    settings = {name: options[name] for name in names}
    with (
        RunFolder(output, "simulate", inputs, settings, experiment.seed, options["fresh"]) as folder,
        progress_bar() as tell,
    ):
        recording, instruments = simulate_motion(
            experiment, model, motion, options["duration"] or period, progress=tell
        )
        results = folder.path / "results"
        joints = [joint.name for joint in spec.joints]
        prismatic = [not joint.is_revolute for joint in spec.joints]
        write_recording(results, "log", recording, joints=joints, prismatic=prismatic, instruments=instruments)
    clipped = int(recording.saturated.sum())
    if as_json:
        print_json({"log": str(results / "log.yaml"), "samples": len(recording.t), "clipped_torques": clipped})
    else:
        click.echo(f"{len(recording.t)} samples, {clipped} clipped torques; recording in {results / 'log.yaml'}")
    return 0


def _motion(model: Model, experiment: Experiment, trajectory: Path | None) -> tuple[Callable[[Any], Any], float]:
    """What the virtual robot follows, and for how long, s."""
    from rrrgen.experiments.experiment_setup import writing_path

    if trajectory is not None:
        series = read_trajectory(trajectory)
        return series.evaluate, series.period
    path = writing_path(experiment, model)
    return path.evaluate, path.task.duration
