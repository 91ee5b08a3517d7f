"""``rrrgen simulate``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rrrgen.cli.arguments import json_option, print_json, read_with_warnings, robot_argument
from rrrgen.cli.progress import progress_bar
from rrrgen.cli.workflow import output_option, read_trajectory, seed_option

if TYPE_CHECKING:
    from rrrgen.runtime.model import Model


@click.command()
@robot_argument
@click.option(
    "--trajectory",
    required=True,
    type=click.Path(path_type=Path, exists=True),
    help="excitation.json of `rrrgen excite`: the motion to follow.",
)
@output_option
@click.option("--duration", type=float, help="Of the experiment, s; one period of the motion by default.")
@click.option("--rate", type=float, default=1000.0, show_default=True, help="Of the controller, Hz.")
@click.option("--bandwidth", type=float, default=4.0, show_default=True, help="Of the PD control, Hz.")
@click.option(
    "--control",
    type=click.Choice(["pd", "computed-torque"]),
    default="pd",
    show_default=True,
    help="PD (14.25), or computed torque with the robot file's own model (14.34).",
)
@click.option("--torque-noise", type=float, default=0.0, show_default=True, help="Standard deviation, N m.")
@click.option("--base-mode", type=float, metavar="HZ", help="A damped mode of the base, as 28 in the case study.")
@seed_option
@click.option("--fresh", is_flag=True, help="Start over in a folder of another run.")
@json_option
def simulate(robot: str, trajectory: Path, output: Path, as_json: bool, **options: Any) -> int:
    """Run an experiment on the virtual robot of a robot file: its links, friction, drives, encoders and torque limits.

    DIR gets log.csv and log.yaml, the recording and its mapping file, as `rrrgen identify` takes them.

    \b
    Example:
      rrrgen simulate rrr --trajectory runs/excitation/results/excitation.json --torque-noise 0.05 -o runs/experiment
    """
    from rrrgen import pipeline
    from rrrgen.identify.run_folder import RunFolder
    from rrrgen.simulate.recording import write_recording

    spec = read_with_warnings(robot)
    model = pipeline.compile(spec)
    if model.beta is None:
        raise click.UsageError(f"{robot} has no links: there is nothing to simulate")
    motion = read_trajectory(trajectory)
    names = ("duration", "rate", "bandwidth", "control", "torque_noise", "base_mode")
    inputs = {"trajectory": trajectory, **({"robot": Path(robot)} if Path(robot).is_file() else {})}
    settings = {name: options[name] for name in names}
    with (
        RunFolder(output, "simulate", inputs, settings, options["seed"], options["fresh"]) as folder,
        progress_bar() as tell,
    ):
        virtual, instruments = _virtual_robot(model, options)
        controller, observer = _control(model, options)
        recording = virtual.run(
            motion.evaluate,
            options["duration"] or motion.period,
            controller,
            observer,
            seed=options["seed"],
            progress=tell,
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


def _virtual_robot(model: Model, options: dict[str, Any]) -> tuple[Any, Any]:
    """The plant and the instruments that the robot file describes."""
    import numpy as np

    from rrrgen.identify.friction_models import robot_friction
    from rrrgen.simulate.experiment import Instruments, VirtualRobot
    from rrrgen.simulate.friction import Friction
    from rrrgen.simulate.plant import FlexibleBase, make_plant

    spec, n = model.spec, model.n
    law = robot_friction(spec)
    base = None
    if options["base_mode"] is not None:  # a base ten times as heavy as the arm in its zero pose
        inertia = 10.0 * float(model.mass_matrix(np.zeros(n))[0, 0])
        base = FlexibleBase(inertia=inertia, frequency=options["base_mode"])
    # the model's own functions hold the drive inertia of the robot file
    plant = make_plant(model, friction=None if law is None else Friction(law), base=base)
    resolutions = [joint.drive.encoder_resolution if joint.drive else None for joint in spec.joints]
    limits = [joint.limits.torque for joint in spec.joints]
    instruments = Instruments(
        encoder_resolution=tuple(value or 0.0 for value in resolutions) if any(resolutions) else None,
        torque_limit=tuple(limits) if all(value is not None for value in limits) else None,  # type: ignore[arg-type]
        torque_noise=(options["torque_noise"],) * n if options["torque_noise"] else None,
    )
    return VirtualRobot(plant, instruments, 1.0 / options["rate"]), instruments


def _control(model: Model, options: dict[str, Any]) -> tuple[Any, Any]:
    """The controller, and the Kalman observer with the chapter's tuning for encoders of 1e-5 rad."""
    import numpy as np

    from rrrgen.identify.friction_models import robot_friction
    from rrrgen.identify.kalman import kalman_matrices
    from rrrgen.identify.smoother import quantisation_variance
    from rrrgen.simulate.control import ComputedTorque, DeviationFilter, pd_gains
    from rrrgen.simulate.plant import RigidBody

    poses = np.random.default_rng(options["seed"]).uniform(-np.pi, np.pi, (500, model.n))
    inertia = np.mean(np.diagonal(model.mass_matrix(poses), axis1=1, axis2=2), axis=0)
    resolutions = [joint.drive.encoder_resolution if joint.drive else None for joint in model.spec.joints]
    matrices = [
        kalman_matrices(1.0 / options["rate"], quantisation_variance(value or 1e-5), 30.0**2) for value in resolutions
    ]
    observer = DeviationFilter([m.E for m in matrices], [m.k for m in matrices])
    if options["control"] == "pd":
        return pd_gains(inertia, options["bandwidth"]), observer
    gains = pd_gains(np.ones(model.n), options["bandwidth"])
    law = robot_friction(model.spec)
    return ComputedTorque(RigidBody(model), gains.kp, gains.kd, law), observer
