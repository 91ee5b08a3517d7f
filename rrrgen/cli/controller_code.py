"""Options of ``rrrgen generate`` for code made from the results of experiments, and the files that they ask for."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

from rrrgen.cli.online_estimators import estimator_files_of, estimator_options
from rrrgen.robot.friction.laws import LAWS

if TYPE_CHECKING:
    from rrrgen.derive.derived_model import DerivedModel
    from rrrgen.emit import Real
    from rrrgen.program import Program
    from rrrgen.robot.robot_spec import RobotSpec

F = TypeVar("F", bound=Callable[..., Any])

RATE = 1000.0
"""Default sampling rate of the controller, Hz."""


def controller_options(function: F) -> F:
    """Add the options of code for one experiment: its motion, Kalman filter, friction laws, online estimators."""
    options = [
        click.option(
            "--trajectory",
            type=click.Path(path_type=Path, exists=True),
            help="Also write <name>_trajectory.h/.c, the motion of this excitation.json of `rrrgen excite`.",
        ),
        click.option(
            "--tuning",
            type=click.Path(path_type=Path, exists=True),
            help="Also write <name>_kalman.h/.c, a Kalman filter with this tuning.json of `rrrgen reconstruct`.",
        ),
        click.option(
            "--rate",
            type=click.FloatRange(min=0.0, min_open=True),
            metavar="HZ",
            help=f"Sampling rate of the controller, for --tuning and the gradient estimator; default {RATE:g}.",
        ),
        click.option(
            "--friction",
            type=click.Choice(list(LAWS)),
            multiple=True,
            help="Also write <name>_friction.h/.c with this law, parameters as arguments; repeat for several.",
        ),
        estimator_options,
    ]
    for option in reversed(options):
        function = option(function)
    return function


def controller_files(model: DerivedModel, real: Real, options: dict[str, Any]) -> dict[str, str]:
    """The C files that the options of :func:`controller_options` ask for, for the robot of ``model``."""
    from rrrgen.emit.c.function_files import function_files

    spec = model.spec
    if options["rate"] is not None and not (options["tuning"] or "gradient" in options["estimators"]):
        raise click.UsageError("--rate belongs to --tuning or --estimator gradient")
    options = options | {"rate": options["rate"] or RATE, "real": real}
    parts: list[tuple[str, str, list[Program]]] = []
    if options["trajectory"]:
        parts.append(("trajectory", f"an exciting motion of {spec.name}", [_motion(options["trajectory"], spec.n)]))
    if options["tuning"]:
        step = _kalman(options["tuning"], options["rate"], spec.n)
        parts.append(("kalman", f"reconstruction of the joint motion of {spec.name}", [step]))
    if options["friction"]:
        programs = [program for law in dict.fromkeys(options["friction"]) for program in _friction(law, spec)]
        parts.append(("friction", f"friction in the joints of {spec.name}", programs))
    files = estimator_files_of(model, options)
    for kind, title, programs in parts:
        files |= function_files(f"{spec.name}_{kind}", title, programs, real)
    return files


def _motion(path: Path, joints: int) -> Program:
    """The program that evaluates the trajectory of the excitation result ``path`` for a robot of ``joints`` joints."""
    from rrrgen.base.errors import InputError
    from rrrgen.emit.controller.trajectory import fixed_fourier_program
    from rrrgen.lab.design.fourier_series import read_trajectory

    motion = read_trajectory(path)
    if motion.n != joints:
        raise InputError(f"{path} moves {motion.n} joints, the robot has {joints}")
    program = fixed_fourier_program(motion.q0.tolist(), motion.a.tolist(), motion.b.tolist(), motion.base_frequency)
    return program.described(name="evaluate")


def _kalman(path: Path, rate: float, joints: int) -> Program:
    """The Kalman filter step at ``rate`` (Hz), with the variances stored by ``rrrgen reconstruct`` in ``path``."""
    from rrrgen.emit.controller.kalman import kalman_program
    from rrrgen.lab.data.kalman import kalman_matrices
    from rrrgen.lab.data.smoother import read_tuning

    matrices = [kalman_matrices(1.0 / rate, eta, xi) for eta, xi in read_tuning(path, joints)]
    step = kalman_program([m.E.tolist() for m in matrices], [m.k.tolist() for m in matrices], 1.0 / rate)
    return step.described(name="step")


def _friction(law: str, spec: RobotSpec) -> list[Program]:
    """The programs of a friction law: torques, and the state step if it has one; also of coupled motors."""
    from rrrgen.derive.recursions.link_frames import rational
    from rrrgen.robot.friction.programs import friction_program, friction_step_program
    from rrrgen.robot.model.drive_terms import friction_surfaces

    chosen, found = LAWS[law], friction_surfaces(spec)
    surfaces = None
    if found is not None:
        surfaces = {name: [w if type(w) is int else rational(w) for w in found[name]] for name in found}
    programs = [friction_program(chosen, spec.n, surfaces).described(name=law)]
    if chosen.step is not None:
        programs.append(friction_step_program(chosen, spec.n, surfaces).described(name=f"{law}_step"))
    return programs
