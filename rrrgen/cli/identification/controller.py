"""``rrrgen controller``."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rrrgen.cli.arguments import json_option, print_json, read_with_warnings, real_option, robot_argument
from rrrgen.cli.experiments.online_estimators import estimator_files_of, estimator_options
from rrrgen.friction.laws import LAWS

if TYPE_CHECKING:
    from rrrgen.program import Program
    from rrrgen.robotfile.robot_spec import RobotSpec


@click.command()
@robot_argument
@click.option("-o", "--output", required=True, type=click.Path(path_type=Path), help="Directory.", metavar="DIR")
@click.option("--trajectory", type=click.Path(path_type=Path, exists=True), help="excitation.json of `rrrgen excite`.")
@click.option("--tuning", type=click.Path(path_type=Path, exists=True), help="tuning.json of `rrrgen reconstruct`.")
@click.option(
    "--rate",
    type=click.FloatRange(min=0.0, min_open=True),
    default=1000.0,
    show_default=True,
    metavar="HZ",
    help="Sampling rate of the controller.",
)
@click.option(
    "--friction", type=click.Choice(list(LAWS)), multiple=True, help="Friction law to emit; repeat for several."
)
@estimator_options
@real_option
@json_option
def controller(robot: str, output: Path, as_json: bool, **options: Any) -> int:
    """Write C99 code for the controller of an experiment: motion, Kalman filter, friction, online estimation.

    --trajectory writes <name>_trajectory.h/.c, which evaluates the exciting motion at any instant; --tuning writes
    <name>_kalman.h/.c, one step of the Kalman filter at the controller's --rate; --friction writes
    <name>_friction.h/.c, the friction torques with their parameters as arguments, and the step of the state if the law
    has one. --estimator writes <name>_rls.h/.c or <name>_gradient.h/.c, which estimate the base parameters sample by
    sample (14.21)-(14.23), and with them the drive inertias and the friction that the robot file states. The robot
    model itself is written by `rrrgen generate`, control laws, momentum observer and point-to-point motions by
    `rrrgen generate --with control,observer,trajectory`.

    \b
    Example:
      rrrgen controller rrr --trajectory runs/excitation/results/excitation.json -o firmware
      rrrgen controller rrr --tuning runs/motion/results/tuning.json --friction lugre --real float -o firmware
      rrrgen controller rrr --estimator rls --fix p4=0 --fix p15=0 --torque-noise 0.2,0.1,0.05 -o firmware
    """
    from rrrgen.backends.c.functions import function_files
    from rrrgen.output import writer as emit

    spec = read_with_warnings(robot)
    parts: list[tuple[str, str, list[Program]]] = []
    if options["trajectory"]:
        parts.append(("trajectory", f"an exciting motion of {spec.name}", [_motion(options["trajectory"], spec.n)]))
    if options["tuning"]:
        step = _kalman(options["tuning"], options["rate"], spec.n)
        parts.append(("kalman", f"reconstruction of the joint motion of {spec.name}", [step]))
    if options["friction"]:
        programs = [program for law in options["friction"] for program in _friction(law, spec)]
        parts.append(("friction", f"friction in the joints of {spec.name}", programs))
    files = estimator_files_of(spec, options)
    if not parts and not files:
        raise click.UsageError("nothing to write: give --trajectory, --tuning, --friction or --estimator")
    for kind, title, programs in parts:
        files |= function_files(f"{spec.name}_{kind}", title, programs, options["real"])
    for name, text in files.items():
        emit.write_file(output / name, text)
    if as_json:
        print_json({"directory": str(output), "files": sorted(files)})
    else:
        click.echo(f"written to {output}: {', '.join(files)}")
    return 0


def _motion(path: Path, joints: int) -> Program:
    """The program that evaluates the trajectory of the excitation result ``path`` for a robot of ``joints`` joints."""
    from rrrgen.cli.identification.workflow import read_trajectory
    from rrrgen.control.trajectory import fixed_fourier_program
    from rrrgen.errors import InputError

    motion = read_trajectory(path)
    if motion.n != joints:
        raise InputError(f"{path} moves {motion.n} joints, the robot has {joints}")
    program = fixed_fourier_program(motion.q0.tolist(), motion.a.tolist(), motion.b.tolist(), motion.base_frequency)
    return program.described(name="evaluate")


def _kalman(path: Path, rate: float, joints: int) -> Program:
    """The Kalman filter step at ``rate`` (Hz), with the variances stored by ``rrrgen reconstruct`` in ``path``."""
    from rrrgen.control.kalman import kalman_program
    from rrrgen.errors import InputError
    from rrrgen.signals.kalman import kalman_matrices

    try:
        tuning = json.loads(path.read_text(encoding="utf-8"))
        pairs = [(float(eta), float(xi)) for eta, xi in zip(tuning["var_eta"], tuning["var_xi"], strict=True)]
    except (ValueError, KeyError, TypeError) as error:
        raise InputError(f"{path} is no tuning of a Kalman filter by `rrrgen reconstruct`: {error!r}") from None
    if not all(math.isfinite(value) and value > 0.0 for pair in pairs for value in pair):
        raise InputError(f"{path} is no tuning of a Kalman filter: variances are positive numbers")
    if len(pairs) != joints:
        raise InputError(f"{path} tunes {len(pairs)} joints, the robot has {joints}")
    matrices = [kalman_matrices(1.0 / rate, eta, xi) for eta, xi in pairs]
    step = kalman_program([m.E.tolist() for m in matrices], [m.k.tolist() for m in matrices], 1.0 / rate)
    return step.described(name="step")


def _friction(law: str, spec: RobotSpec) -> list[Program]:
    """The programs of a friction law: torques, and the state step if it has one; also of coupled motors."""
    from rrrgen.derive.recursions.chain import rational
    from rrrgen.friction.programs import friction_program, friction_step_program
    from rrrgen.model.drive_terms import friction_surfaces

    chosen, found = LAWS[law], friction_surfaces(spec)
    surfaces = None
    if found is not None:
        surfaces = {name: [w if type(w) is int else rational(w) for w in found[name]] for name in found}
    programs = [friction_program(chosen, spec.n, surfaces).described(name=law)]
    if chosen.step is not None:
        programs.append(friction_step_program(chosen, spec.n, surfaces).described(name=f"{law}_step"))
    return programs
