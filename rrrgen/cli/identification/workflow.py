"""Options that the commands of the identification workflow share."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

if TYPE_CHECKING:
    from rrrgen.experiments.experiment_file import Experiment
    from rrrgen.identify.diagnosis.cause import Cause
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


def truncated_option(function: F) -> F:
    """``--skip-truncated-line``."""
    told = "Leave out the last line of a text file where the recording was cut off in the middle of it."
    return click.option("--skip-truncated-line", is_flag=True, help=told)(function)


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
    """How recordings are made ready for a comparison of torques; a mapping file's own ``processing`` is the default."""
    function = click.option("--decimate", type=click.IntRange(min=1), help="Keep every k-th row, filtered.")(function)
    return reconstruction_options(function)


def reconstruction_options(function: F) -> F:
    """How the motion is reconstructed."""
    told = "Of the Butterworth filter, which it chooses where no method is named."
    positive = click.FloatRange(min=0, min_open=True)
    function = click.option("--cutoff", type=positive, metavar="HZ", help=told)(function)
    methods = click.Choice(["butterworth", "kalman", "kalman_filter", "differences", "logged"])
    told = "How the motion is reconstructed; kalman where nothing is said."
    return click.option("--method", "reconstruction", type=methods, help=told)(function)


def chosen_processing(
    mappings: list[LogMapping], reconstruction: str | None, cutoff: float | None, decimate: int | None = None
) -> Processing:
    """What the mapping files say, with the command line's own words on top; the rest is left to the rule.

    Raises UsageError for words that contradict one another, InputError where mapping files do.
    """
    from rrrgen.errors import InputError
    from rrrgen.signals.processing import OWNERS, Processing

    given = {"method": reconstruction, "cutoff": cutoff, "decimate": decimate}
    named: dict[str, Any] = {name: value for name, value in given.items() if value is not None}
    settings: dict[str, Any] = {}
    sources: dict[str, str] = {}
    for mapping in mappings:
        for name, value in mapping.processing.items():
            if name not in named and settings.setdefault(name, value) != value:
                raise InputError(
                    f"{sources[name]} and {mapping.source} disagree on {name} of their processing, and recordings "
                    "that are used together are made ready alike: let them agree, or name it on the command line"
                )
            sources.setdefault(name, mapping.source)
    if cutoff is not None and reconstruction is None:
        method = settings.setdefault("method", "butterworth")
        if method != "butterworth":
            where = f"{sources['method']} says {method}"
            raise click.UsageError(f"--cutoff belongs to the Butterworth filter, and {where}: add --method butterworth")
    method = named.get("method", settings.get("method", "kalman"))
    if method not in OWNERS["cutoff"] and cutoff is not None:
        raise click.UsageError(f"--cutoff belongs to --method butterworth, not to {method}")
    # what a mapping file says of a method falls with the method, where the command line names another
    settings = {name: value for name, value in settings.items() if method in OWNERS.get(name, (method,))}
    return Processing(**{**settings, **named})


def print_repairs(repairs: Iterable[Repairs], as_json: bool = False) -> None:
    """What was put right in recordings; warnings go to stderr, and to JSON the rest goes with the record."""
    for each in repairs:
        for line in [] if as_json else each.lines():
            click.echo(line)
        for line in each.warnings():
            click.echo(line, err=True)


def print_causes(causes: Iterable[Cause], as_json: bool = False) -> None:
    """Likely causes of trouble, their evidence and what to write instead; on stderr beside JSON."""
    for cause in causes:
        for line in cause.lines():
            click.echo(line, err=as_json)


def input_files(robot: str, logs: tuple[Path, ...], mappings: list[LogMapping], role: str = "log") -> dict[str, Path]:
    """Everything that a run reads, for its record: the robot (if it is a file), mapping files and data files."""
    files = {"robot": Path(robot)} if Path(robot).is_file() else {}
    for k, (log, mapping) in enumerate(zip(logs, mappings, strict=True)):
        files[f"{role}{k + 1}"] = log
        for source in mapping.files:
            files[f"{role}{k + 1}.{source.name}"] = Path(source.path)
    return files


def recording_names(mappings: list[LogMapping]) -> list[str]:
    """The names of the files that recordings are read from."""
    return [source.path.name for mapping in mappings for source in mapping.files]


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
