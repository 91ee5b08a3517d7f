"""Options that the commands of the identification workflow share."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

if TYPE_CHECKING:
    from rrrgen.experiments.experiment_file import Experiment
    from rrrgen.recordings.mapping import LogMapping
    from rrrgen.recordings.repairs import Repairs
    from rrrgen.signals.fourier import FourierTrajectory
    from rrrgen.signals.processing import Processing

F = TypeVar("F", bound=Callable[..., Any])


def output_option(function: F) -> F:
    """The run folder ``-o``."""
    return click.option(
        "-o", "--output", required=True, type=click.Path(path_type=Path), metavar="DIR", help="Run folder to write."
    )(function)


def log_option(function: F) -> F:
    """The recording, or its mapping file, ``--log``; may be given several times."""
    return click.option(
        "--log",
        "logs",
        required=True,
        multiple=True,
        type=click.Path(path_type=Path),
        help="A recording with rrrgen's own columns, or the mapping file of one; repeat for several.",
    )(function)


def jobs_options(function: F) -> F:
    """``--jobs`` and ``--cluster``."""
    function = click.option("--cluster", metavar="ADDRESS", help="Dask scheduler to share the work with.")(function)
    return click.option("--jobs", type=click.IntRange(min=1), default=1, show_default=True, help="Processes.")(function)


def parallel_packages(options: dict[str, Any]) -> tuple[str, ...]:
    """The packages that ``--jobs`` and ``--cluster`` need."""
    if options["cluster"] is not None:
        return ("joblib", "dask", "distributed")
    return ("joblib",) if options["jobs"] > 1 else ()


def experiment_option(function: F) -> F:
    """``--experiment``."""
    return click.option(
        "--experiment",
        type=click.Path(path_type=Path),
        metavar="FILE",
        help="Experiment file: limits, objective, writing task, virtual robot, control. Options win over it.",
    )(function)


def chosen_experiment(path: Path | None, joints: int, options: dict[str, Any]) -> Experiment:
    """The experiment file, or one that says nothing, with the command line's own words on top."""
    from dataclasses import replace

    from rrrgen.experiments.experiment_file import Experiment, load_experiment

    found = Experiment() if path is None else load_experiment(path, joints)
    excitation, virtual_robot, control = dict(found.excitation), dict(found.virtual_robot), found.control
    if options.get("harmonics") is not None:
        excitation["harmonics"] = options["harmonics"]
    if options.get("cycle") is not None:
        excitation["base_frequency"] = 1.0 / options["cycle"]
    if options.get("torque_noise") is not None:
        virtual_robot["torque_noise"] = (options["torque_noise"],) * joints
    if options.get("base_mode") is not None:
        virtual_robot["flexible_base"] = {**virtual_robot.get("flexible_base", {}), "frequency": options["base_mode"]}
    if options.get("bandwidth") is not None:
        control = replace(control, bandwidth=options["bandwidth"], kp=None, kd=None)
    if options.get("control") is not None:
        control = replace(control, kind=options["control"].replace("-", "_"))
    changes = {name: options[name] for name in ("starts", "seed") if options.get(name) is not None}
    if options.get("rate") is not None:
        changes["period"] = 1.0 / options["rate"]
    return replace(found, excitation=excitation, virtual_robot=virtual_robot, control=control, **changes)


def seed_option(default: int | None) -> Callable[[F], F]:
    """``--seed``; without a default the experiment file has its say."""
    return click.option("--seed", type=int, default=default, help="Of everything random; 0 by default.")


def processing_options(function: F) -> F:
    """How recordings are made ready; a mapping file's own ``processing`` is the default."""
    function = click.option("--decimate", type=click.IntRange(min=1), help="Keep every k-th row, filtered.")(function)
    function = click.option("--cutoff", type=float, metavar="HZ", help="Of the Butterworth filter.")(function)
    methods = click.Choice(["butterworth", "kalman", "kalman_filter", "logged"])
    return click.option("--method", "reconstruction", type=methods, help="How the motion is reconstructed.")(function)


def chosen_processing(
    mappings: list[LogMapping], reconstruction: str | None, cutoff: float | None, decimate: int | None
) -> Processing:
    """The processing of the first mapping file that names one, with the command line's own words on top."""
    from rrrgen.signals.processing import Processing

    settings: dict[str, Any] = dict(next((m.processing for m in mappings if m.processing), {}))
    given = {"method": reconstruction, "cutoff": cutoff, "decimate": decimate}
    settings |= {name: value for name, value in given.items() if value is not None}
    if not settings:
        settings = {"method": "kalman", "decimate": 10}
    return Processing(**settings)


def print_repairs(repairs: Iterable[Repairs], as_json: bool = False) -> None:
    """What was put right in recordings; warnings go to stderr, and to JSON the rest goes with the record."""
    for each in repairs:
        for line in [] if as_json else each.lines():
            click.echo(line)
        for line in each.warnings():
            click.echo(line, err=True)


def input_files(robot: str, logs: tuple[Path, ...], mappings: list[LogMapping]) -> dict[str, Path]:
    """Everything that a run reads, for its record: the robot (if it is a file), mapping files and data files."""
    files = {"robot": Path(robot)} if Path(robot).is_file() else {}
    for k, (log, mapping) in enumerate(zip(logs, mappings, strict=True)):
        files[f"log{k + 1}"] = log
        for source in mapping.files:
            files[f"log{k + 1}.{source.name}"] = Path(source.path)
    return files


def described_files(**paths: Path | None) -> dict[str, Path]:
    """The files among the inputs of a run, by role; a bundled robot is none."""
    return {role: path for role, path in paths.items() if path is not None and path.is_file()}


def read_trajectory(path: Path) -> FourierTrajectory:
    """The trajectory of an excitation result, or a trajectory by itself."""
    import json

    from rrrgen.errors import InputError
    from rrrgen.signals.fourier import FourierTrajectory

    try:
        data = json.loads(path.read_text(encoding="utf-8"))
        coefficients = dict(data.get("trajectory", data))
    except (ValueError, AttributeError, TypeError) as error:
        raise InputError(f"{path} is no trajectory of `rrrgen excite`: {error}") from None
    return FourierTrajectory.from_json(coefficients)
