"""The command ``rrrgen simulate``: simulate an experiment."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rrrgen.cli.arguments import json_option, print_json, read_with_warnings, robot_argument
from rrrgen.cli.colour import failed, fault_text
from rrrgen.cli.progress import progress_bar
from rrrgen.cli.response_experiment import simulate_response_runs
from rrrgen.cli.terminal import say
from rrrgen.cli.workflow import (
    chosen_experiment,
    described_files,
    experiment_option,
    input_files,
    output_option,
    read_trajectory,
    seed_option,
)

if TYPE_CHECKING:
    from rrrgen.lab.experiment.experiment_file import Experiment
    from rrrgen.lab.experiment.loop_design import LoopDesign
    from rrrgen.lab.plant.tracking import Tracking
    from rrrgen.robot.robot_spec import RobotSpec
    from rrrgen.runtime.model import Model
from rrrgen.base.extras import require


@click.command()
@robot_argument
@click.option(
    "--trajectory",
    type=click.Path(path_type=Path, exists=True),
    help="Motion to follow: excitation.json or friction_motion.json of `rrrgen excite`.",
)
@click.option(
    "--reference",
    type=click.Path(path_type=Path),
    metavar="LOG",
    help="Recording, or its mapping file, whose positions are followed.",
)
@click.option("--writing", is_flag=True, help="Follow the writing task of the experiment file; default: RRR in 10 s.")
@click.option(
    "--response",
    type=click.Path(path_type=Path, exists=True),
    help="Frequency response of a joint: response_excitation.json of `rrrgen excite --response`.",
)
@output_option
@experiment_option
@click.option("--duration", type=float, metavar="S", help="Duration in seconds; default: one period of the motion.")
@click.option("--rate", type=float, metavar="HZ", help="Sampling rate of the controller; default 1000.")
@click.option(
    "--bandwidth",
    type=click.FloatRange(min=0, min_open=True),
    metavar="HZ",
    help="Bandwidth of the loops of all joints; default: 4 or what its load needs, as far as the loop is robust.",
)
@click.option(
    "--control",
    type=click.Choice(["pd", "computed-torque"]),
    help="Control law: PD (the default), or computed torque with the exact model of the robot file.",
)
@click.option(
    "--torque-noise", type=float, metavar="NM", help="Standard deviation of the torque noise, N m; default: no noise."
)
@click.option(
    "--base-mode", type=float, metavar="HZ", help="Natural frequency of a flexible base, such as 28; default: rigid."
)
@seed_option(default=None)
@click.option("--fresh", is_flag=True, help="Discard a run that DIR already holds, and start over.")
@json_option
def simulate(robot: str, output: Path, as_json: bool, **options: Any) -> int:
    """Simulate an experiment: the arm of the robot file follows a motion under feedback control.

    The arm has the links, friction, drives, encoders and torque limits of the robot file; an experiment file can add
    other friction laws, flexible joints, a flexible base, noise and the gains of the controller. Gains and observer
    are otherwise designed from the arm, with a modulus margin of 0.5 in all postures along the motion. Writes log.csv,
    the recording, and log.yaml, its mapping file for `rrrgen identify`, to DIR; with --response the recordings under
    feedback linearisation (14.34), (14.36), and response.yaml for `rrrgen frf`. Exits with 1 if the arm does not follow
    the motion or its loop oscillates.

    \b
    Examples:
      rrrgen simulate rrr --trajectory runs/excitation/results/excitation.json --torque-noise 0.05 -o runs/experiment
      rrrgen simulate rrr --writing --experiment experiment.yaml -o runs/writing
      rrrgen simulate runs/identified/results/robot.yaml --reference log.yaml -o runs/replayed
      rrrgen simulate rrr --response runs/response-excitation/results/response_excitation.json --base-mode 28 -o runs/q1
    """
    require("rrrgen simulate", "scipy")
    from rrrgen.lab.data.run_folder import RunFolder
    from rrrgen.lab.experiment.loop_design import checked, design_loop
    from rrrgen.lab.experiment.setup import arm_of, simulate_motion
    from rrrgen.lab.plant.recording import write_recording
    from rrrgen.runtime import load

    files = [options[name] is not None for name in ("trajectory", "reference", "response")]
    if [*files, options["writing"]].count(True) != 1:
        follow = "--trajectory FILE, --reference LOG, --writing or --response FILE"
        raise click.UsageError(f"say what to follow: {follow}, one of them")
    spec = read_with_warnings(robot)
    experiment = chosen_experiment(options["experiment"], spec.n, options)
    if options["response"] is not None:
        return simulate_response_runs(robot, spec, experiment, output, options, as_json)
    model = load.compile(spec)
    if model.beta is None:
        raise click.UsageError(f"{robot} has no links: there is nothing to simulate")
    inputs = described_files(robot=Path(robot), trajectory=options["trajectory"], experiment=options["experiment"])
    if options["reference"] is None:
        motion, period = _motion(model, experiment, options["trajectory"])
    else:
        motion, period, read = _recorded(options["reference"], spec)
        inputs |= read
    names = ("writing", "duration", "rate", "bandwidth", "control", "torque_noise", "base_mode")
    settings = {name: options[name] for name in names}
    duration = options["duration"] or period
    arm = arm_of(experiment, model, motion, duration)
    loop = design_loop(arm, experiment.control)
    for fault in loop.warnings:
        click.echo(fault_text(fault), err=True)
    with (
        RunFolder(output, "simulate", inputs, settings, experiment.seed, options["fresh"]) as folder,
        progress_bar() as progress,
    ):
        recording, instruments = simulate_motion(experiment, model, motion, duration, loop=loop, progress=progress)
        results = folder.path / "results"
        joints = [joint.name for joint in spec.joints]
        prismatic = [not joint.is_revolute for joint in spec.joints]
        write_recording(results, "log", recording, joints=joints, prismatic=prismatic, instruments=instruments)
    tracking = checked(recording, arm, loop)
    clipped = int(recording.saturated.sum())
    for line in _failures(tracking, joints, prismatic, clipped, loop):
        click.echo(f"{failed('FAIL')} {line}", err=True)
    if as_json:
        print_json(
            {
                "log": str(results / "log.yaml"),
                "samples": len(recording.t),
                "clipped_torques": clipped,
                "loop": loop.to_json(),
                "tracking": {"ok": tracking.ok, **asdict(tracking)},
            }
        )
    else:
        for line in loop.lines():
            say(line)
        worst = ", ".join(
            f"{name} {value:.3g} {'m' if slides else 'rad'}"
            for name, value, slides in zip(joints, tracking.deviation, prismatic, strict=True)
        )
        say(f"{len(recording.t)} samples, {clipped} clipped torques; largest deviations from the motion: {worst}")
        say(f"recording in {results / 'log.yaml'}")
    return 0 if tracking.ok else 1


def _failures(
    tracking: Tracking, joints: list[str], prismatic: list[bool], clipped: int, loop: LoopDesign
) -> Iterator[str]:
    """What failed in a simulated experiment, with what can be done about it."""
    for swing in tracking.oscillations:
        unit = "N" if prismatic[swing.joint] else "N m"
        why = ": the loop is unstable" if loop.margin.unstable else ""
        yield (
            f"{joints[swing.joint]} oscillates at {swing.frequency:.3g} Hz with {swing.amplitude:.3g} {unit} "
            f"from t = {swing.start:.2f} s to {swing.stop:.2f} s{why}"
        )
    for i in tracking.lost:
        unit = "m" if prismatic[i] else "rad"
        yield (
            f"{joints[i]} does not follow the motion: it is up to {tracking.deviation[i]:.3g} {unit} away "
            f"from a motion over {tracking.span[i]:.3g} {unit}"
        )
    if tracking.ok:
        return
    if clipped:
        yield f"{clipped} torques are clipped at the limits of the drives: ask for a slower motion or stronger drives"
    elif tracking.oscillations:
        yield "a lower bandwidth or a higher rate calms the loop; without stated gains and observer it is designed"
    else:
        yield "a higher --rate allows stiffer PD control; --control computed-torque follows with the model of the arm"


def _motion(model: Model, experiment: Experiment, trajectory: Path | None) -> tuple[Callable[[Any], Any], float]:
    """The reference motion as a function of time, and its duration (s)."""
    from rrrgen.lab.experiment.setup import writing_path

    if trajectory is not None:
        from rrrgen.lab.design.friction_motion import read_friction_motion

        series = read_friction_motion(trajectory) or read_trajectory(trajectory)
        return series.evaluate, series.period
    path = writing_path(experiment, model)
    return path.evaluate, path.task.duration


def _recorded(log: Path, spec: RobotSpec) -> tuple[Callable[[Any], Any], float, dict[str, Path]]:
    """The motion of a recording as a function of time, its duration (s), and the files read, by role."""
    from rrrgen.lab.data.log_stream import LogStream
    from rrrgen.lab.data.recordings import check_robot, open_log
    from rrrgen.lab.experiment.recorded_motion import RecordedMotion
    from rrrgen.lab.studies.preprocessing import MotionOptions
    from rrrgen.lab.studies.sources import chosen_processing

    mapping = open_log(log)
    check_robot(mapping, spec)
    motion = RecordedMotion.of(LogStream(mapping), chosen_processing([mapping], MotionOptions()))
    return motion.evaluate, motion.duration, input_files("", (log,), [mapping], "reference")
