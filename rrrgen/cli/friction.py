"""The command ``rrrgen friction``: estimate friction, inertia and gravity of one joint from a recording."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rrrgen.base.extras import require
from rrrgen.cli.arguments import json_option, print_json, read_with_warnings, robot_argument
from rrrgen.cli.progress import progress_bar
from rrrgen.cli.terminal import say
from rrrgen.cli.workflow import (
    described_files,
    input_files,
    output_option,
    print_repairs,
    seed_option,
    truncated_option,
)

if TYPE_CHECKING:
    from rrrgen.lab.data.mapping import LogMapping
    from rrrgen.lab.friction.estimation import FrictionEstimate
    from rrrgen.lab.friction.joint_recording import RecordedJoint
    from rrrgen.lab.friction.presliding import Presliding

LAWS = ("coulomb_viscous", "asymmetric", "stribeck", "lugre", "neural")


@click.command()
@robot_argument
@click.option(
    "--log",
    required=True,
    type=click.Path(path_type=Path),
    help="Recording with rrrgen's own columns, or mapping file of a recording.",
)
@truncated_option
@click.option("--joint", required=True, metavar="NAME", help="The joint that moves; the others stand still.")
@click.option(
    "--presliding",
    multiple=True,
    type=click.Path(path_type=Path),
    help="Recording of the joint below break-away under a periodic multisine; repeat with another amplitude.",
)
@click.option(
    "--law", "laws", type=click.Choice(LAWS), multiple=True, help="Law to try; repeat for several; default all."
)
@click.option(
    "--controller",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="Controller of the recorded loop: refine the chosen law by closed-loop output error.",
)
@output_option
@seed_option(default=0)
@click.option("--fresh", is_flag=True, help="Discard a run that DIR already holds, and start over.")
@json_option
def friction(robot: str, log: Path, joint: str, output: Path, as_json: bool, **options: Any) -> int:
    """Estimate friction, inertia and gravity of one joint, (14.15).

    In the recording this joint moves and all others stand still; design the motion with `rrrgen excite --friction`.
    Coulomb-viscous, asymmetric, Stribeck, LuGre and neural laws are estimated by an extended Kalman filter and refined
    by output error. One of them is chosen by its error on windows that were not fitted, and with --controller refined
    in the simulated closed loop. With --presliding, stiffness and damping of the bristles at rest (14.16) are
    estimated too. Writes results/friction.json, the robot file with this law, and a figure of friction against speed
    to DIR.

    \b
    Example:
      rrrgen friction rrr --log runs/joint3/log.yaml --joint q3 -o runs/friction3
    """
    require("rrrgen friction", "scipy", "matplotlib")
    from rrrgen.lab.closed_loop.controller_file import load_controller
    from rrrgen.lab.closed_loop.joint_friction import refine
    from rrrgen.lab.data.log_stream import LogStream
    from rrrgen.lab.data.recordings import load_stream, open_log
    from rrrgen.lab.data.run_folder import RunFolder, plain
    from rrrgen.lab.friction.estimation import estimate_friction
    from rrrgen.lab.friction.joint_recording import joint_data, recorded_joint
    from rrrgen.lab.friction.plots import plot_friction
    from rrrgen.lab.friction.robot_file import with_friction
    from rrrgen.robot.file import dumps

    spec = read_with_warnings(robot)
    controller = None if options["controller"] is None else load_controller(options["controller"])
    mapping = open_log(log, skip_truncated=options["skip_truncated_line"])
    moving = recorded_joint(spec, mapping, joint)
    logs = (log, *options["presliding"])
    mappings = [mapping, *(open_log(each) for each in options["presliding"])]
    inputs = input_files(robot, logs, mappings) | described_files(controller=options["controller"])
    settings = {"joint": joint, "laws": options["laws"], "skip_truncated_line": options["skip_truncated_line"]}
    with (
        RunFolder(output, "friction", inputs, settings, options["seed"], options["fresh"]) as folder,
        progress_bar() as progress,
    ):
        recording = LogStream(mapping)
        log_read = load_stream(recording)
        data = joint_data(log_read, moving.name, moving.resolution)
        print_repairs([recording.repairs], as_json)
        found = estimate_friction(data, moving.gravity, options["laws"], options["seed"], progress)
        loop = None if controller is None else refine(found, log_read, controller, progress)
        found = found if loop is None else loop.estimate
        rest = _presliding(found, mappings[1:], moving) if options["presliding"] else None
        record = plain(
            found.to_json()
            | ({} if rest is None else {"presliding": rest.to_json()})
            | ({} if loop is None else {"closed_loop": loop.to_json()})
        )
        folder.write_json("friction.json", record)
        folder.write_text("robot.yaml", dumps(with_friction(spec, joint, found.chosen, rest)))
        folder.figure("friction", plot_friction(found, moving.units))
    if as_json:
        print_json(record)
    else:
        _print(found, output, rest)
        say(*(() if loop is None else loop.lines()))
    return 0


def _presliding(found: FrictionEstimate, mappings: list[LogMapping], moving: RecordedJoint) -> Presliding:
    """Estimate stiffness and damping of the bristles from recordings whose torques stay below break-away."""
    from rrrgen.lab.data.log_stream import LogStream
    from rrrgen.lab.data.recordings import load_stream
    from rrrgen.lab.friction.joint_recording import resting_record
    from rrrgen.lab.friction.presliding import presliding

    records = [resting_record(load_stream(LogStream(mapping)), moving.name) for mapping in mappings]
    law = found.chosen
    theta = dict(zip(law.candidate.names, law.theta.tolist(), strict=True))
    return presliding(
        records,
        found.data.resolution,
        law.break_away,
        law.values.get("viscous", 0.0),
        (theta.get("gravity_cos", 0.0), theta.get("gravity_sin", 0.0)) if moving.gravity == 2 else (0.0, 0.0),
        law.values["delay"],
    )


def _print(found: FrictionEstimate, output: Path, rest: Presliding | None) -> None:
    """Print the table of laws, the parameters of the chosen law, and notes."""
    say(f"joint {found.data.name}: {found.windows} windows, encoder steps of {found.data.resolution:.3g}")
    say(f"  {'law':<16} {'parameters':>10} {'held-out error':>15} {'BIC':>10} {'torque error':>13}")
    for law in found.laws:
        mark = "*" if law is found.chosen else " "
        say(
            f"{mark} {law.name:<16} {len(law.theta):>10} {law.score.held_out:>15.3f} {law.score.bic:>10.0f} "
            f"{100 * law.torque_error:>11.2f} %"
        )
    say("  held-out error in standard deviations of the noise; * chosen")
    for name, value in found.chosen.values.items():
        say(f"  {name:<16} {value:>12.5g} +- {found.chosen.std[name]:.2g}")
    if rest is not None:
        say(f"presliding, resonance at {rest.resonance:.4g} Hz:")
        for name, pair in (("sigma0", rest.sigma0), ("sigma1", rest.sigma1), ("inertia", rest.inertia)):
            say(f"  {name:<16} " + ("not told" if pair is None else f"{pair[0]:>12.5g} +- {pair[1]:.2g}"))
    for note in (*found.notes, *(() if rest is None else rest.notes)):
        say(f"note: {note}")
    say(f"results and figures in {output}")
