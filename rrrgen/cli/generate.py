"""The command ``rrrgen generate``: derive a robot's kinematics and dynamics and write them as C and CasADi."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

from rrrgen.base.parallel import usual_jobs, without_collection
from rrrgen.cli.arguments import (
    Number,
    complete_words,
    export_targets,
    ik_option,
    json_option,
    print_json,
    read_with_warnings,
    real_option,
    robot_argument,
    unit_options,
    words,
)
from rrrgen.cli.terminal import LongHelpCommand, progress_bar, say
from rrrgen.controller.table import GROUPS as UNIT_GROUPS
from rrrgen.derive import derive_once
from rrrgen.robot.file.fields import EMIT, LANGUAGES
from rrrgen.robot.friction.laws import LAWS

if TYPE_CHECKING:
    from rrrgen.base.files import Contents
    from rrrgen.base.parallel import Tell
    from rrrgen.controller.table import ControllerUnit
    from rrrgen.derive.derived_model import DerivedModel
    from rrrgen.emit import Real
    from rrrgen.emit.c.language import Trig
    from rrrgen.emit.controller.online_estimators import Regression
    from rrrgen.emit.interface import Rounding
    from rrrgen.lab.data.kalman import KalmanMatrices
    from rrrgen.program import Program
    from rrrgen.robot.spec import RobotSpec


# ------------------------------------------------------------------------------------------------------------------
# Options and files of the online estimators that ``rrrgen generate`` writes beside the model.
# ------------------------------------------------------------------------------------------------------------------

F = TypeVar("F", bound=Callable[..., Any])

KINDS = ("rls", "gradient")


def estimator_options(function: F) -> F:
    """Add the options of the online estimators."""
    positive = Number(min=0.0, min_open=True)
    options = [
        click.option(
            "--estimator",
            "estimators",
            type=click.Choice(KINDS),
            multiple=True,
            help="Also write <name>_rls.h/.c or <name>_gradient.h/.c, which estimate the parameters sample by sample.",
        ),
        click.option(
            "--fix",
            metavar="NAME=VALUE",
            multiple=True,
            help="A parameter that the estimators take as known; repeat for several.",
        ),
        click.option(
            "--torque-noise",
            metavar="NM[,NM..]",
            help="Standard deviation of the torque noise in N m (N), one for all joints or one each; default 0.1.",
        ),
        click.option(
            "--spread",
            type=positive,
            metavar="STD",
            help="Standard deviation of all parameters at the start, SI; default ten times the largest nominal one.",
        ),
        click.option(
            "--forgetting",
            type=Number(0.0, 1.0, min_open=True),
            help="Forgetting factor of the least squares, 1 to forget nothing; default 0.999.",
        ),
        click.option(
            "--gain",
            type=positive,
            metavar="ALPHA",
            help="Gain alpha of the gradient (14.23), 1/s; default: a tenth of its bound along --trajectory.",
        ),
        click.option(
            "--rest-speed",
            type=Number(min=0.0),
            metavar="SPEED",
            help="Joints slower than this, rad/s (m/s), are left out of the estimation; default 0.01.",
        ),
    ]
    for option in reversed(options):
        function = option(function)
    return function


def estimator_files_of(model: DerivedModel, options: dict[str, Any]) -> dict[str, str]:
    """The C files of the chosen estimators; raises UsageError for options without an estimator that uses them."""
    kinds = tuple(dict.fromkeys(options["estimators"]))
    _refuse_unused(kinds, options)
    if not kinds:
        return {}
    from dataclasses import replace

    from rrrgen.emit.controller.online_estimators import EstimatorSettings, estimator_files, regression

    setting = regression(model, _parse_fixed_values(options["fix"]))
    given = {"forgetting": options["forgetting"], "rest": options["rest_speed"]}
    settings = EstimatorSettings(**{name: value for name, value in given.items() if value is not None})
    if options["torque_noise"] is not None:
        settings = replace(settings, noise=_covariance(options["torque_noise"], model.spec.n))
    if options["spread"] is not None:
        settings = replace(settings, spread=(options["spread"],) * len(setting.names))
    if "gradient" in kinds:
        settings = replace(settings, gain=_gain(setting, options))
    files: dict[str, str] = {}
    for kind in kinds:
        files |= estimator_files(setting, kind, settings, options["real"])
    return files


def _refuse_unused(kinds: tuple[str, ...], options: dict[str, Any]) -> None:
    """Raise UsageError for an option that no chosen estimator has."""
    users = {
        "fix": KINDS,
        "rest_speed": KINDS,
        "torque_noise": ("rls",),
        "spread": ("rls",),
        "forgetting": ("rls",),
        "gain": ("gradient",),
    }
    for name, having in users.items():
        if options[name] not in (None, ()) and not set(having) & set(kinds):
            option = f"--{name.replace('_', '-')}"
            raise click.UsageError(f"{option} belongs to --estimator {' or '.join(having)}")


def _gain(setting: Regression, options: dict[str, Any]) -> float:
    """The gain alpha Ts of the gradient estimator; along a given motion it must be below the bound of stability."""
    from rrrgen.base.errors import InputError
    from rrrgen.emit.controller.online_estimators import chosen_gain, gain_bound
    from rrrgen.lab.design.fourier_series import read_trajectory

    bound = None
    if options["trajectory"] is not None:
        motion = read_trajectory(options["trajectory"])
        if motion.n != setting.joints:
            raise InputError(f"{options['trajectory']} moves {motion.n} joints, the robot has {setting.joints}")
        bound = gain_bound(setting, *motion.evaluate(motion.times(1.0 / options["rate"])))
    stated = None if options["gain"] is None else options["gain"] / options["rate"]
    if stated is None and bound is None:
        raise click.UsageError("--estimator gradient needs --gain, or the --trajectory along which it is chosen")
    return chosen_gain(stated, bound)


def _parse_fixed_values(entries: tuple[str, ...]) -> dict[str, float]:
    fixed = {}
    for entry in entries:
        name, _, value = entry.partition("=")
        try:
            fixed[name.strip()] = Number().convert(value, None, None)
        except click.BadParameter:
            raise click.BadParameter(f"'{entry}' is not NAME=VALUE", param_hint="--fix") from None
    return fixed


def _covariance(text: str, joints: int) -> tuple[tuple[float, ...], ...]:
    """Make the diagonal covariance matrix from the standard deviations listed in ``text``, one per joint."""
    try:
        values = [float(part) for part in text.split(",")]
    except ValueError:
        values = []
    if len(values) == 1:
        values = values * joints
    if len(values) != joints or not all(math.isfinite(value) and value > 0.0 for value in values):
        message = f"'{text}' is neither one positive number nor {joints}, as in 0.2,0.1,.."
        raise click.BadParameter(message, param_hint="--torque-noise")
    return tuple(tuple(values[i] ** 2 * (i == j) for j in range(joints)) for i in range(joints))


# ------------------------------------------------------------------------------------------------------------------
# Options of ``rrrgen generate`` for code made from the results of experiments, and the files that they ask for.
# ------------------------------------------------------------------------------------------------------------------


RATE = 1000.0
"""Default sampling rate of the controller, Hz."""


def controller_options(function: F) -> F:
    """Add the options of code for one experiment: its motion, Kalman filter, friction laws, online estimators."""
    options = [
        click.option(
            "--trajectory",
            type=click.Path(path_type=Path, exists=True),
            help="Also write <name>_trajectory.h/.c, the motion of this excitation.json of `rrrgen experiment excite`.",
        ),
        click.option(
            "--tuning",
            type=click.Path(path_type=Path, exists=True),
            help="Also write <name>_kalman.h/.c, a Kalman filter with this tuning.json of "
            "`rrrgen experiment reconstruct`; its gains are also those of the part kalman of --with controller.",
        ),
        click.option(
            "--rate",
            type=Number(min=0.0, min_open=True),
            metavar="HZ",
            help=f"Sampling rate of the controller; default {RATE:g}.",
        ),
        click.option(
            "--friction",
            type=click.Choice(list(LAWS)),
            multiple=True,
            help="Also write <name>_friction.h/.c with this law, parameters as arguments; repeat for several.",
        ),
        unit_options,
        estimator_options,
    ]
    for option in reversed(options):
        function = option(function)
    return function


def controller_files(model: DerivedModel, real: Real, options: dict[str, Any]) -> dict[str, str]:
    """The C files that the options of :func:`controller_options` ask for, for the robot of ``model``."""
    spec = model.spec
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
        from rrrgen.emit.c.function_files import function_files

        files |= function_files(f"{spec.name}_{kind}", title, programs, real)
    return files


def _controller_choices(options: dict[str, Any], joints: int) -> dict[str, Any]:
    """What the options choose of the controller: arguments of :func:`rrrgen.controller.table.unit_of` by name."""
    rate, given = options["rate"] or RATE, dict[str, tuple[float, ...]]()
    if options["tuning"] and "kalman" in (options["parts"] or ()):
        matrices = _kalman_matrices(options["tuning"], rate, joints)
        given["kalman_gain"] = tuple(float(value) for joint_matrices in matrices for value in joint_matrices.k)
    return {"modes": options["modes"], "parts": options["parts"], "period": 1.0 / rate, "given": given}


def _unit(model: DerivedModel, any_gravity: DerivedModel | None, chosen: dict[str, Any]) -> ControllerUnit:
    """The controller with what is ``chosen``; it calls ``model`` or that with gravity as an input."""
    from rrrgen.controller.table import unit_of

    if "any_gravity" not in (chosen["parts"] or ()):
        return unit_of(model, **chosen)
    if any_gravity is None:
        raise click.UsageError("the part any_gravity calls the model with gravity as an input: add --with gravity")
    return unit_of(any_gravity, **chosen)


def chosen_unit(model: DerivedModel, experiment: dict[str, Any]) -> ControllerUnit | None:
    """The controller that the options of :func:`controller_options` choose; None if it calls another model, that with
    gravity as an input."""
    chosen = _controller_choices(experiment, model.spec.n)
    return None if "any_gravity" in (chosen["parts"] or ()) else _unit(model, None, chosen)


def _motion(path: Path, joints: int) -> Program:
    """The program that evaluates the trajectory of the excitation result ``path`` for a robot of ``joints`` joints."""
    from rrrgen.base.errors import InputError
    from rrrgen.emit.controller.fourier_series import fixed_fourier_program
    from rrrgen.lab.design.fourier_series import read_trajectory

    motion = read_trajectory(path)
    if motion.n != joints:
        raise InputError(f"{path} moves {motion.n} joints, the robot has {joints}")
    program = fixed_fourier_program(motion.q0.tolist(), motion.a.tolist(), motion.b.tolist(), motion.base_frequency)
    return program.with_fields(name="evaluate")


def _kalman(path: Path, rate: float, joints: int) -> Program:
    """The Kalman filter step at ``rate`` (Hz), with the variances of a tuning.json at ``path``."""
    from rrrgen.emit.controller.filters import kalman_program

    matrices = _kalman_matrices(path, rate, joints)
    step = kalman_program([m.E.tolist() for m in matrices], [m.k.tolist() for m in matrices], 1.0 / rate)
    return step.with_fields(name="step")


def _kalman_matrices(path: Path, rate: float, joints: int) -> list[KalmanMatrices]:
    """The filters of all joints at ``rate`` (Hz), with the variances of a tuning.json at ``path``."""
    from rrrgen.lab.data.kalman import kalman_matrices, read_tuning

    return [kalman_matrices(1.0 / rate, eta, xi) for eta, xi in read_tuning(path, joints)]


def _friction(law: str, spec: RobotSpec) -> list[Program]:
    """The programs of a friction law: torques, and the state step if it has one; also of coupled motors."""
    from rrrgen.derive.recursions.link_frames import rational
    from rrrgen.robot.friction.programs import friction_program, friction_step_program
    from rrrgen.robot.model.drives import friction_surfaces

    chosen, directions = LAWS[law], friction_surfaces(spec)
    surfaces = None
    if directions is not None:
        surfaces = {name: [w if type(w) is int else rational(w) for w in directions[name]] for name in directions}
    programs = [friction_program(chosen, spec.n, surfaces).with_fields(name=law)]
    if chosen.step is not None:
        programs.append(friction_step_program(chosen, spec.n, surfaces).with_fields(name=f"{law}_step"))
    return programs


# ------------------------------------------------------------------------------------------------------------------
# The command ``rrrgen generate``
# ------------------------------------------------------------------------------------------------------------------

GROUPS = ("control", "elastic", "hessian", "observer", "points", "tensors", "timing", "trajectory")
"""The words after ``--with`` that name groups of functions; the others name languages and further files."""


def code_options(function: F) -> F:
    """Add the options that decide what the emitted files are; :func:`emit_files` takes them."""
    options = [
        real_option,
        click.option(
            "--trig",
            type=click.Choice(["inline", "libm"]),
            default="inline",
            show_default=True,
            help="Source of sines and cosines: a kernel in the emitted code, or the C library.",
        ),
        click.option(
            "--with",
            "further",
            callback=words(EMIT, export_targets),
            multiple=True,
            metavar="WORD,...",
            shell_complete=complete_words(EMIT, export_targets),
            help="Also write what the words below name; a target of `rrrgen export` gets a folder of its name.",
        ),
    ]
    for option in reversed(options):
        function = option(function)
    return function


def work_options(function: F) -> F:
    """Add the remaining options that :func:`emit_files` takes: serialized CasADi files, processes, experiments."""
    options = [
        click.option(
            "--casadi-files/--no-casadi-files",
            default=None,
            help="Also write serialized .casadi files, whose bytes depend on CasADi's version; by default if it is "
            "installed.",
        ),
        click.option(
            "-j",
            "--jobs",
            type=click.IntRange(min=1),
            default=usual_jobs,
            help="Number of processes; does not change the files.  [default: number of cores, up to 6]",
        ),
        ik_option,
        controller_options,
    ]
    for option in reversed(options):
        function = option(function)
    return function


output_option = click.option(
    "-o", "--output", required=True, type=click.Path(path_type=Path), help="Directory to write.", metavar="DIR"
)


USUAL = ("output", "real", "further", "only_check", "as_json")
"""Parameters whose options ``rrrgen generate --help`` describes."""


@click.command(cls=LongHelpCommand, usual=USUAL, words=("Words of --with", EMIT))
@robot_argument
@output_option
@code_options
@click.option(
    "--check", "only_check", is_flag=True, help="Write nothing; print a diff and exit with 1 if DIR would change."
)
@click.option(
    "--bounds", is_flag=True, help="Prove bounds of the rounding errors, and state them in the header and the manifest."
)
@work_options
@json_option
@click.option("-v", "--verbose", is_flag=True, help="Report what each step did, on stderr.")
@without_collection()
def generate(
    robot: str,
    output: Path,
    real: Real,
    trig: Trig,
    further: tuple[str, ...],
    only_check: bool,
    bounds: bool,
    casadi_files: bool | None,
    jobs: int,
    method: str | None,
    as_json: bool,
    verbose: bool,
    **experiment: Any,
) -> int:
    """Derive a robot's kinematics and dynamics and write them as C and CasADi.

    DIR receives C with a self-test, inverse kinematics, CasADi functions, and a README.md on how to build and use them.

    \b
    Examples:
      rrrgen generate rrr -o generated/rrr
      rrrgen generate my_robot.yaml -o firmware/model --real float
      rrrgen generate rrr -o generated/rrr --check    # in continuous integration
      rrrgen generate rrr -o firmware --with controller --parts observer,kalman
    """
    from rrrgen.base.files import differences, write

    start = time.perf_counter()
    with_casadi = serialized_casadi(casadi_files)
    spec = with_solver(read_with_warnings(robot), method)

    def proven(model: DerivedModel) -> Rounding:
        if not bounds:
            return {}
        from rrrgen.evidence.boxes import Ranges
        from rrrgen.evidence.certificate import rounding_entries
        from rrrgen.evidence.statements import statements

        return statements(model.programs, rounding_entries(model, trig, Ranges(), tell=tell), real)

    with progress_bar() as tell:
        model, files = emit_files(
            spec, real, trig, further, with_casadi and not only_check, jobs, experiment, tell, proven
        )
    if verbose:
        _report_passes(model)
    leftovers = _leftovers(files, output, casadi_files, with_casadi, only_check)
    if only_check:
        diff = differences(files, output, leftovers)
        if as_json:
            print_json({"directory": str(output), "up_to_date": not diff, "diff": diff})
        else:
            click.echo(diff or f"{output} is up to date\n", nl=False)
        return 1 if diff else 0
    write(files, output, leftovers)
    if verbose:
        click.echo(f"{len(files)} files in {time.perf_counter() - start:.1f} s", err=True)
    if as_json:
        print_json(_summary(model, output, files))
    else:
        _print_summary(model, output, files)
    return 0


def _leftovers(
    files: dict[str, Contents], output: Path, wanted: bool | None, with_casadi: bool, only_check: bool
) -> list[str]:
    """The ``.casadi`` files of an earlier run to remove: those that are ``wanted`` no more, or beside other code.

    Where nobody has said what is ``wanted`` and CasADi is missing, they stay beside the code that they came with.
    """
    from rrrgen.base.files import differences
    from rrrgen.emit.casadi.files import leftover_files

    if with_casadi and only_check:  # they are written anew, which a check does not compare
        return []
    unknown = wanted is None and not with_casadi
    return [] if unknown and not differences(files, output) else leftover_files(files, output)


def with_solver(spec: RobotSpec, method: str | None) -> RobotSpec:
    """The robot with the ``method`` of its inverse kinematics that the option ``--ik`` states, if it does."""
    return spec if method is None else replace(spec, ik=method)


def emit_files(
    spec: RobotSpec,
    real: Real,
    trig: Trig,
    further: tuple[str, ...],
    casadi: bool,
    jobs: int,
    experiment: dict[str, Any],
    tell: Tell,
    proven: Callable[[DerivedModel], Rounding],
) -> tuple[DerivedModel, dict[str, Contents]]:
    """Derive a robot and print all files that the options of ``rrrgen generate`` ask for: relative path -> contents.

    ``casadi`` adds serialized CasADi functions; ``experiment`` holds the options of :func:`controller_options`;
    ``tell(done, total, message)`` is called as the work proceeds. ``proven`` returns what header and manifest
    state about the rounding errors of a model.
    """
    from rrrgen.emit.controller.template_files import checks_beside, files_beside
    from rrrgen.emit.package import emit

    wanted = {*spec.emit, *further}
    named = any(experiment[option] is not None for option in ("modes", "parts"))
    if named and "controller" not in wanted:
        raise click.UsageError("--modes and --parts belong to --with controller")
    users = experiment["tuning"] or "gradient" in experiment["estimators"] or "controller" in wanted
    if experiment["rate"] is not None and not users:
        raise click.UsageError("--rate belongs to --tuning, --estimator gradient or --with controller")
    needed = wanted | (set(UNIT_GROUPS) if "controller" in wanted else set())
    groups = ("model", *sorted(needed & set(GROUPS)))
    languages = tuple(language for language in LANGUAGES if language in wanted)
    tell(0, 0, "deriving")
    model = derive_once(spec, groups, jobs=jobs, tell=tell)
    code = controller_files(model, real, experiment)
    code |= files_beside(spec, real, groups, trig)
    any_gravity = derive_once(spec.in_any_gravity(), groups, jobs=jobs, tell=tell) if "gravity" in wanted else None
    checks = checks_beside(spec, groups)
    chosen = _controller_choices(experiment, spec.n) if "controller" in wanted else {}
    if chosen:
        from rrrgen.controller.files import unit_check, unit_files

        unit = _unit(model, any_gravity, chosen)
        code |= unit_files(unit, real, trig)
        checks = (*checks, unit_check(unit))
    beside: dict[str, Contents] = {}
    if {"controller", "rust"} <= wanted:
        from rrrgen.controller.files import rust_files

        beside |= rust_files(unit, real)
    beside |= _export_targets(spec, real, further, chosen)
    return model, emit(
        model, real, casadi, trig, jobs, languages, any_gravity, tell, code, beside, checks, proven(model)
    )


def _export_targets(
    spec: RobotSpec, real: Real, further: tuple[str, ...], chosen: dict[str, Any]
) -> dict[str, Contents]:
    """The files of those words ``further`` that are targets of ``rrrgen export``, each in a folder of its name.

    Those that hold the controller have it with the same modes, parts and defaults, ``chosen``.
    """
    files: dict[str, Contents] = {}
    for target in (word for word in further if word not in EMIT):
        from rrrgen.emit.targets.interface import ExportOptions
        from rrrgen.exporting import export_robot, exporter_of

        exporter = exporter_of(target)
        held = tuple(word for word in exporter.further if word in further)
        choices = chosen if "controller" in exporter.further else {}
        options = ExportOptions(real=real if "real" in exporter.options else "double", further=held, chosen=choices)
        exported = export_robot(spec, target, options=options)
        files |= {f"{target}/{path}": contents for path, contents in exported.files.items()}
        for note in exported.notes:
            click.echo(f"{target}: {note}", err=True)
    return files


def serialized_casadi(wanted: bool | None) -> bool:
    """Whether .casadi files are written: as requested, by default if CasADi is installed.

    Raises MissingExtraError if they are requested and CasADi is missing.
    """
    from rrrgen.base.errors import MissingExtraError, is_installed

    if wanted is False or is_installed("casadi"):
        return wanted is not False
    if wanted:
        raise MissingExtraError("--casadi-files", "casadi", "casadi")
    return False


def _report_passes(model: DerivedModel) -> None:
    for report in model.passes:
        if report.before != report.after:
            click.echo(f"{report.name}: {report.function}: {report.before} -> {report.after}", err=True)


def _summary(model: DerivedModel, output: Path, files: dict[str, Any]) -> dict[str, Any]:
    from rrrgen.program import count_operations
    from rrrgen.robot.identity import identify

    return {
        "robot": model.spec.name,
        "model_hash": identify(model.spec).model_hash,
        "directory": str(output),
        "files": sorted(files),
        "base_parameters": [parameter.name for parameter in model.base_parameters],
        "operations": {name: count_operations(program).as_dict() for name, program in model.programs.items()},
    }


def _print_summary(model: DerivedModel, output: Path, files: Iterable[str]) -> None:
    from rrrgen.program import count_operations

    name = model.spec.name
    say(f"{name}: {model.spec.n} joints, {len(model.base_parameters)} base parameters")
    for function in ("forward_kinematics", "mass_matrix", "inverse_dynamics", "forward_dynamics", "regressor"):
        if function in model.programs:
            say(f"  {function:20} {count_operations(model.programs[function])}")
    if model.spec.ik != "general":
        from rrrgen.ik.classify import plan

        say(plan(model.spec).approach)
    written = dict.fromkeys(file.partition("/")[0] + "/" * ("/" in file) for file in files)
    say(f"written to {output}: {', '.join(written)}")
