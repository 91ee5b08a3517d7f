"""The command ``rrrgen experiment excite``: design an exciting trajectory, or the motion of one joint for friction."""

from __future__ import annotations

from pathlib import Path

import click

from rrrgen.base.errors import option_name, require
from rrrgen.cli.arguments import (
    FindingsPrinter,
    described_files,
    fresh_option,
    json_option,
    output_option,
    print_json,
    read_with_warnings,
    robot_argument,
    robot_source,
    run_study,
)
from rrrgen.cli.response_experiment import excite_response
from rrrgen.cli.study_options import click_options
from rrrgen.cli.terminal import say
from rrrgen.lab.studies.excite import ExciteOptions

DURATION = 40.0
OTHERS = ("harmonics", "starts", "cluster")


def excite_friction(
    robot: str, joint: str, response: str | None, options: ExciteOptions, output: Path, fresh: bool, as_json: bool
) -> int:
    """Design the friction experiment of the ``joint`` and write it to ``output``."""
    require("rrrgen experiment excite", "matplotlib")
    spec = read_with_warnings(robot)
    experiment = options.of_file(spec.n)
    others = [name for name in OTHERS if getattr(options, name) is not None]
    for name in others if response is None else (*others, "response"):
        raise click.UsageError(f"{option_name(name)} does not belong to a friction experiment")
    import numpy as np

    from rrrgen.lab.data.run_folder import RunFolder
    from rrrgen.lab.design.friction_motion import design_friction_motion
    from rrrgen.lab.design.plots import plot_joint
    from rrrgen.lab.experiment.setup import limited_spec
    from rrrgen.verify.references.newton_euler import NewtonEuler
    from rrrgen.verify.references.numeric_robot import chain_of, nominal_parameters

    phi = nominal_parameters(spec)
    links = None if phi is None else NewtonEuler(chain_of(spec), phi)
    torque = None if links is None else lambda *motion: links.inverse_dynamics(*motion)
    duration = options.duration or DURATION
    motion = design_friction_motion(limited_spec(experiment, spec), joint, duration, experiment.seed, torque)
    settings = {"friction": joint, "duration": duration, "rate": options.rate}
    inputs = described_files(robot=Path(robot), experiment=options.experiment)
    with RunFolder(output, "excite", inputs, settings, experiment.seed, fresh) as folder:
        place = folder.write_json("friction_motion.json", motion.to_json())
        t = np.arange(round(motion.period / experiment.period)) * experiment.period
        trajectory = motion.evaluate(t)
        n = len(motion.centre)
        header = ("t", *(f"{name}{i + 1}" for name in ("q", "dq", "ddq") for i in range(n)))
        folder.write_csv("friction_motion.csv", header, np.column_stack([t, *trajectory]).tolist())
        joint_motion = [part[:, motion.joint] for part in trajectory]
        folder.figure("friction_motion", plot_joint(t, joint_motion, f"joint {joint}"))
    speeds = [float(np.sqrt(np.mean(joint_motion[1][half] ** 2))) for half in (t < 0.5 * duration, t >= 0.5 * duration)]
    if as_json:
        print_json({"motion": str(place), "joint": joint, "seconds": motion.period, "rms_speeds": speeds})
    else:
        say(
            f"{motion.period:g} s of joint {joint}: multisine of {speeds[0]:.3g} rms, then slow reversals of "
            f"{speeds[1]:.3g} rms; the other joints stand still"
        )
        say(f"motion in {place}")
    return 0


@click.command()
@robot_argument
@output_option
@click.option(
    "--response",
    metavar="JOINT",
    help="Excite one joint for its frequency response instead; '-' for the joint that the experiment file names.",
)
@click.option(
    "--friction",
    metavar="JOINT",
    help="Move one joint for `rrrgen experiment friction` instead: a fast multisine, then slow reversals; "
    "40 s unless --duration.",
)
@click_options(ExciteOptions)
@fresh_option
@json_option
def excite(
    robot: str,
    output: Path,
    response: str | None,
    friction: str | None,
    options: ExciteOptions,
    fresh: bool,
    as_json: bool,
) -> int:
    """Design an exciting trajectory within the limits of a robot file, or of an experiment file.

    Minimises the condition number of the regressor from several random starts and checks every limit at the rate of the
    controller. Writes the coefficients (JSON), the samples for the controller (CSV) and figures to DIR.

    With --response the frequency-response experiment of one joint is designed instead: the excitation n (a random-phase
    multisine, noise or a swept sine) of the control u = -Kp e - Kd de + n (14.36), and a speed so high that the joint
    never reverses. The section `response` of the experiment file has its settings.

    \b
    Examples:
      rrrgen experiment excite rrr -o runs/excitation --jobs 2
      rrrgen experiment excite rrr --experiment experiment.yaml -o runs/excitation
      rrrgen experiment excite rrr --response q1 -o runs/plan
      rrrgen experiment excite rrr --friction q3 -o runs/friction-motion
    """
    if friction is not None:
        return excite_friction(robot, friction, response, options, output, fresh, as_json)
    if response is not None:
        return excite_response(robot, response, options, output, fresh, as_json)
    from rrrgen.lab.studies.excite import excite as study

    run_study(
        study,
        robot_source(robot),
        options,
        folder=output,
        fresh=fresh,
        findings=FindingsPrinter(as_json),
        as_json=as_json,
        last=f"results and figures in {output}",
    )
    return 0
