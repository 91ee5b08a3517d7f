"""Commands that estimate from recordings of a robot: ``rrrgen identify`` and those of ``rrrgen experiment``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from rrrgen.base.errors import DerivationError
from rrrgen.cli.arguments import (
    FindingsPrinter,
    Number,
    fresh_option,
    json_option,
    output_option,
    print_causes,
    print_json,
    robot_argument,
    robot_source,
    run_on_recordings,
    run_study,
    truncated_option,
)
from rrrgen.cli.study_options import click_options, recording_options
from rrrgen.cli.terminal import progress_bar, say, terminal_width, verdict
from rrrgen.lab.studies.contact_thresholds import ContactOptions
from rrrgen.lab.studies.estimate_drive_gains import DriveGainsOptions
from rrrgen.lab.studies.estimate_elastic_joints import ElasticJointsOptions
from rrrgen.lab.studies.estimate_friction import FrictionOptions
from rrrgen.lab.studies.estimate_payload import PayloadOptions
from rrrgen.lab.studies.identify import IdentifyOptions
from rrrgen.lab.studies.options import MotionOptions
from rrrgen.lab.studies.validate import ValidateOptions


@click.command()
@recording_options(IdentifyOptions)
def identify(
    robot: str, logs: tuple[Path, ...], output: Path, options: IdentifyOptions, as_json: bool, **more: Any
) -> int:
    """Estimate base parameters, drive inertia and friction from recordings.

    Every friction and drive parameter that ROBOT states, even as 0, is estimated. Writes to DIR the parameters with
    their standard deviations, figures, and robot.yaml with the physically consistent estimate, for `rrrgen generate`.

    \b
    Examples:
      rrrgen identify rrr --log runs/log.yaml -o runs/identified
      rrrgen identify my_arm.yaml --log log.yaml --split first:0.6 -o runs/identified
      rrrgen identify my_arm.yaml --log log.yaml --friction auto -o runs/identified_friction
    """
    from rrrgen.lab.studies.identify import identify as study

    findings = FindingsPrinter(as_json)
    result = run_on_recordings(
        study, robot, logs, options, output, as_json, findings=findings, written="results and figures", **more
    )
    say(*([] if as_json else result.loop_lines()))
    print_causes([cause for cause in result.diagnoses if cause not in findings.causes], as_json)
    return 0


@click.command()
@recording_options(ValidateOptions)
def validate(
    robot: str,
    logs: tuple[Path, ...],
    skip_truncated_line: bool,
    output: Path,
    options: ValidateOptions,
    fresh: bool,
    as_json: bool,
) -> int:
    """Compare the torques of a robot file (rigid body, drives, friction) with recorded ones.

    Prints the RMS error of each joint, relative errors, the share of random poses with an indefinite mass matrix, and a
    verdict; exits with 1 if a threshold is missed. A robot file written by `rrrgen identify` states which samples it
    was fitted to; their share in the recordings is printed. For other robot files, state it with --fitted-on.

    \b
    Example:
      rrrgen experiment validate runs/identified/results/robot.yaml --log runs/writing/results/log.yaml -o validated
    """
    from rrrgen.lab.studies.validate import validate as study

    with progress_bar() as progress:
        result = study(
            robot_source(robot),
            logs,
            options,
            folder=output,
            fresh=fresh,
            progress=progress,
            findings=FindingsPrinter(as_json),
            skip_truncated_line=skip_truncated_line,
        )
    if as_json:
        print_json(result.to_json())
    else:
        say(*result.lines(terminal_width(), verdict))
    return 0 if result.passed else 1


@click.command()
@click.argument("log", type=click.Path(path_type=Path))
@output_option
@click_options(MotionOptions)
@truncated_option
@fresh_option
@json_option
def reconstruct(
    log: Path, output: Path, options: MotionOptions, skip_truncated_line: bool, fresh: bool, as_json: bool
) -> int:
    """Reconstruct joint positions, speeds and accelerations from the recording LOG (or its mapping file).

    Unless an option or the mapping file sets them, the noise variances of the Kalman smoother are tuned by its
    innovations, and the cut-off of a Butterworth filter is 5 times the bandwidth of the motion; the choice is printed.
    Writes motion.csv, the tuning, and for a Kalman filter its Bode plot to DIR.

    \b
    Example:
      rrrgen experiment reconstruct runs/experiment/results/log.yaml --method kalman -o runs/motion
    """
    from rrrgen.lab.studies.reconstruct import reconstruct as study

    with progress_bar() as progress:
        result = study(
            log,
            options,
            folder=output,
            fresh=fresh,
            progress=progress,
            findings=FindingsPrinter(as_json),
            skip_truncated_line=skip_truncated_line,
        )
    if as_json:
        print_json(result.to_json())
    else:
        tuned, samples = result.lines()
        say(tuned, f"{samples}; motion in {output / 'results' / 'motion.csv'}")
    return 0


@click.command()
@recording_options(PayloadOptions)
def payload(
    robot: str, logs: tuple[Path, ...], output: Path, options: PayloadOptions, as_json: bool, **more: Any
) -> int:
    """Estimate mass, centre of mass and inertia of a payload at the last link of a known arm.

    Writes payload.json, and robot.yaml with the payload as a part of the last link, to DIR. Half a minute of a motion
    in which the last joints move through many directions of gravity is enough. Samples near rest are left out. Exits
    with 4 if no payload explains the torques, or the motion does not determine the mass; other values that it does not
    determine are marked.

    \b
    Example:
      rrrgen experiment payload runs/identified/results/robot.yaml --log carrying.yaml -o runs/payload
    """
    from rrrgen.lab.studies.estimate_payload import estimate_payload

    run_on_recordings(estimate_payload, robot, logs, options, output, as_json, **more)
    return 0


@click.command()
@recording_options(
    DriveGainsOptions,
    click.option(
        "--loaded",
        required=True,
        multiple=True,
        type=click.Path(path_type=Path),
        help="Recording, or its mapping file, with the payload; --log is the one without. Repeat for several.",
    ),
    click.option("--mass", required=True, type=Number(min=0, min_open=True), help="Mass of the payload, kg."),
    click.option(
        "--com",
        nargs=3,
        type=Number(),
        default=(0.0, 0.0, 0.0),
        help="Centre of mass in the last link frame, m; default: its origin.",
    ),
    click.option(
        "--inertia",
        nargs=6,
        type=Number(),
        default=(0.0,) * 6,
        metavar="XX YY ZZ XY XZ YZ",
        help="Inertia tensor about the centre of mass in its axes, kg m^2; default: a point mass.",
    ),
)
def drive_gains(
    robot: str,
    logs: tuple[Path, ...],
    loaded: tuple[Path, ...],
    output: Path,
    options: DriveGainsOptions,
    as_json: bool,
    **more: Any,
) -> int:
    """Estimate unknown drive gains (torque constants) from recordings without and with a known payload.

    The masses of ROBOT are not used: all parameters of the arm are estimated too, in the units of the payload. Writes
    drive_gains.json to DIR. Exits with 4 if no gains explain the torques, or if the payload hardly loads a joint, whose
    gain is then not determined.

    \b
    Example:
      rrrgen experiment drive-gains my_arm.yaml --log empty.yaml --loaded carrying.yaml --mass 1 --com 0 0 0.05 -o gains
    """
    from rrrgen.lab.studies.estimate_drive_gains import estimate_drive_gains

    result = run_on_recordings(estimate_drive_gains, robot, logs, options, output, as_json, loaded=loaded, **more)
    return DerivationError.exit_code if result.gains.undetermined else 0


@click.command()
@recording_options(
    ElasticJointsOptions,
    click.option(
        "--link",
        "links",
        multiple=True,
        type=click.Path(path_type=Path),
        help="Recording, or its mapping file, of the link positions at the same times; one for each --log.",
    ),
)
def elastic_joints(
    robot: str,
    logs: tuple[Path, ...],
    links: tuple[Path, ...],
    output: Path,
    options: ElasticJointsOptions,
    as_json: bool,
    **more: Any,
) -> int:
    """Estimate stiffness, damping and rotor inertia of elastic joints, with the parameters of the links.

    The recordings hold the positions of the motors, seen at the joints, and the torques. The motion must be excited up
    to the resonances. The masses of ROBOT are not used. Writes elastic_joints.json to DIR. Exits with 1 if the
    torques of a joint are not explained, and with 4 if no joint shows that it is elastic.

    \b
    Example:
      rrrgen experiment elastic-joints arm.yaml --log motors.yaml -o runs/elastic
    """
    from rrrgen.lab.studies.estimate_elastic_joints import estimate_elastic_joints

    result = run_on_recordings(
        estimate_elastic_joints, robot, logs, options, output, as_json, links=list(links) or None, **more
    )
    return 0 if result.trusted else 1


@click.command()
@recording_options(ContactOptions)
def contact_thresholds(
    robot: str, logs: tuple[Path, ...], output: Path, options: ContactOptions, as_json: bool, **more: Any
) -> int:
    """Find thresholds of contact detection from recordings without contact.

    The momentum observer runs along the recordings as it does in the controller, and an extreme-value distribution is
    fitted to the largest residual in every second, and to its fastest change. From them follow the thresholds for a
    given mean time between false alarms, and the delay with which a force at the tip will be detected. Writes
    contact.json, and <name>_contact.h with the thresholds for the C function `contact` and the covariance for
    `external_force` and `external_wrench`, to DIR. Record motions like those of normal work, with the torques that were
    applied.

    \b
    Example:
      rrrgen experiment contact-thresholds runs/identified/results/robot.yaml --log work.yaml -o runs/contact
    """
    from rrrgen.lab.studies.contact_thresholds import contact_thresholds as study

    run_on_recordings(study, robot, logs, options, output, as_json, **more)
    return 0


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
@click_options(FrictionOptions)
@output_option
@fresh_option
@json_option
def friction(
    robot: str,
    log: Path,
    skip_truncated_line: bool,
    joint: str,
    presliding: tuple[Path, ...],
    options: FrictionOptions,
    output: Path,
    fresh: bool,
    as_json: bool,
) -> int:
    """Estimate friction, inertia and gravity of one joint, (14.15).

    In the recording this joint moves and all others stand still; design the motion with
    `rrrgen experiment excite --friction`.
    Coulomb-viscous, asymmetric, Stribeck, LuGre and neural laws are estimated by an extended Kalman filter and refined
    by output error. One of them is chosen by its error on windows that were not fitted, and with --controller refined
    in the simulated closed loop. With --presliding, stiffness and damping of the bristles at rest (14.16) are
    estimated too. Writes results/friction.json, the robot file with this law, and a figure of friction against speed
    to DIR.

    \b
    Example:
      rrrgen experiment friction rrr --log runs/joint3/log.yaml --joint q3 -o runs/friction3
    """
    from rrrgen.lab.studies.estimate_friction import estimate_friction

    result = run_study(
        estimate_friction,
        robot_source(robot),
        log,
        options,
        joint=joint,
        presliding=presliding,
        folder=output,
        fresh=fresh,
        findings=FindingsPrinter(as_json),
        skip_truncated_line=skip_truncated_line,
        as_json=as_json,
        last=f"results and figures in {output}",
    )
    say(*([] if as_json else result.loop_lines()))
    return 0
