"""The command ``rrrgen generate``: derive a robot's kinematics and dynamics and write them as C and CasADi."""

from __future__ import annotations

import time
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rrrgen.base.parallel import usual_jobs, without_collection
from rrrgen.cli.arguments import (
    ik_option,
    json_option,
    print_json,
    read_with_warnings,
    real_option,
    robot_argument,
    words,
)
from rrrgen.cli.controller_code import controller_files, controller_options
from rrrgen.cli.progress import progress_bar
from rrrgen.cli.terminal import say
from rrrgen.derive import derive
from rrrgen.robot.file.fields import EMIT, LANGUAGES

if TYPE_CHECKING:
    from rrrgen.derive.derived_model import DerivedModel
    from rrrgen.emit import Real
    from rrrgen.emit.c.trigonometry import Trig
    from rrrgen.emit.targets.interface import Contents
    from rrrgen.robot.robot_spec import RobotSpec

GROUPS = ("control", "elastic", "observer", "points", "timing", "trajectory")
"""The words after ``--with`` that name groups of functions; the others name languages and further files."""


def _targets() -> Iterable[str]:
    """Names of the targets of ``rrrgen export``, which ``--with`` takes too; unusable ones are named when asked for."""
    from rrrgen.emit.exporting import exporters, unusable

    return [*exporters(), *unusable()]


@click.command()
@robot_argument
@click.option(
    "-o", "--output", required=True, type=click.Path(path_type=Path), help="Directory to write.", metavar="DIR"
)
@real_option
@click.option(
    "--trig",
    type=click.Choice(["inline", "libm"]),
    default="inline",
    show_default=True,
    help="Source of sines and cosines: a kernel in the emitted code, or the C library.",
)
@click.option(
    "--with",
    "further",
    callback=words(EMIT, _targets),
    multiple=True,
    metavar="WORD,...",
    help="Also write, besides what the robot file asks for: "
    + "; ".join(map(": ".join, EMIT.items()))
    + ". A target of `rrrgen export` gets a folder of its name.",
)
@click.option(
    "--check", "only_check", is_flag=True, help="Write nothing; print a diff and exit with 1 if DIR would change."
)
@click.option(
    "--casadi-files/--no-casadi-files",
    default=None,
    help="Also write serialized .casadi files, whose bytes depend on CasADi's version; by default if it is installed.",
)
@click.option(
    "-j",
    "--jobs",
    type=click.IntRange(min=1),
    default=usual_jobs,
    help="Number of processes; does not change the files.  [default: number of cores, up to 6]",
)
@ik_option
@controller_options
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
    casadi_files: bool | None,
    jobs: int,
    method: str | None,
    as_json: bool,
    verbose: bool,
    **experiment: Any,
) -> int:
    """Derive a robot's kinematics and dynamics and write them as C and CasADi.

    DIR receives <name>.h with its sources (<name>.c; <name>_nominal.c with the numbers of the robot file folded in;
    <name>_derivatives.c), inverse kinematics, a self-test that runs on the target, CMakeLists.txt, a pkg-config file,
    README.md on how to build and use them, CasADi functions and manifest.json. The same robot gives the same bytes
    everywhere.

    Code for a controller comes in groups, --with control,observer,trajectory, and from the results of an experiment:
    its motion with --trajectory, a Kalman filter with --tuning, friction laws whose parameters are arguments with
    --friction, and with --estimator online estimators of the base parameters (14.21)-(14.23) and of the drive inertias
    and the friction that the robot file states.

    \b
    Examples:
      rrrgen generate rrr -o generated/rrr
      rrrgen generate my_robot.yaml -o firmware/model --real float
      rrrgen generate rrr -o generated/rrr --check    # in continuous integration
      rrrgen generate rrr -o generated/rrr --with rust,cpp
      rrrgen generate rrr -o generated/rrr --with gravity,control
      rrrgen generate rrr -o firmware --with control,observer --tuning runs/motion/results/tuning.json
      rrrgen generate rrr -o firmware --estimator rls --fix p4=0 --fix p15=0 --torque-noise 0.2,0.1,0.05
    """
    from rrrgen.base.files import differences, write
    from rrrgen.emit.controller.template_files import checks_beside, files_beside
    from rrrgen.emit.package import emit

    start = time.perf_counter()
    with_casadi = _with_casadi(casadi_files)
    spec = read_with_warnings(robot)
    spec = spec if method is None else replace(spec, ik=method)
    wanted = {*spec.emit, *further}
    groups = ("model", *sorted(wanted & set(GROUPS)))
    languages = tuple(each for each in LANGUAGES if each in wanted)
    with progress_bar(in_processes=True) as tell:
        tell(0, 0, "deriving")
        model = derive(spec, jobs, groups, tell)
        code = controller_files(model, real, experiment)
        code |= files_beside(spec, real, groups, trig)
        any_gravity = derive(spec.in_any_gravity(), jobs, groups, tell) if "gravity" in wanted else None
        casadi = with_casadi and not only_check
        checks = checks_beside(spec, groups)
        files = emit(model, real, casadi, trig, jobs, languages, any_gravity, tell, code, checks)
    files |= _exported(spec, real, further)
    if verbose:
        _report_passes(model)
    if only_check:
        diff = differences(files, output)
        if as_json:
            print_json({"directory": str(output), "up_to_date": not diff, "diff": diff})
        else:
            click.echo(diff or f"{output} is up to date\n", nl=False)
        return 1 if diff else 0
    write(files, output)
    if verbose:
        click.echo(f"{len(files)} files in {time.perf_counter() - start:.1f} s", err=True)
    if as_json:
        print_json(_summary(model, output, files))
    else:
        _print_summary(model, output, files)
    return 0


def _exported(spec: RobotSpec, real: Real, further: tuple[str, ...]) -> dict[str, Contents]:
    """The files of those words ``further`` that are targets of ``rrrgen export``, each in a folder of its name."""
    files: dict[str, Contents] = {}
    for target in (word for word in further if word not in EMIT):
        from rrrgen.emit.exporting import export_robot, exporter_of
        from rrrgen.emit.targets.interface import ExportOptions

        exporter = exporter_of(target)
        held = tuple(word for word in exporter.further if word in further)
        options = ExportOptions(real=real if "real" in exporter.options else "double", further=held)
        exported = export_robot(spec, target, options=options)
        files |= {f"{target}/{path}": contents for path, contents in exported.files.items()}
        for note in exported.notes:
            click.echo(f"{target}: {note}", err=True)
    return files


def _with_casadi(wanted: bool | None) -> bool:
    """Whether .casadi files are written: as requested, by default if CasADi is installed.

    Raises MissingExtraError if they are requested and CasADi is missing.
    """
    from rrrgen.base.errors import MissingExtraError
    from rrrgen.base.extras import installed

    if wanted is False or installed("casadi"):
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
