"""Options, settings and printing shared by the commands of the identification workflow."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

from rrrgen.cli.colour import fault_text, with_warning
from rrrgen.cli.progress import progress_bar
from rrrgen.cli.terminal import say, terminal_width

if TYPE_CHECKING:
    from rrrgen.base.errors import Fault
    from rrrgen.lab.data.mapping import LogMapping
    from rrrgen.lab.data.repairs import Repairs
    from rrrgen.lab.identify.diagnosis.causes import Cause
    from rrrgen.lab.studies.results import StudyResult

ResultType = TypeVar("ResultType", bound="StudyResult")
F = TypeVar("F", bound=Callable[..., Any])


def output_option(function: F) -> F:
    """Add the required option ``-o``, ``--output``: the run folder."""
    return click.option(
        "-o", "--output", required=True, type=click.Path(path_type=Path), metavar="DIR", help="Run folder to write to."
    )(function)


def log_option(function: F) -> F:
    """Add the repeatable option ``--log``: a recording or its mapping file."""
    return click.option(
        "--log",
        "logs",
        required=True,
        multiple=True,
        type=click.Path(path_type=Path),
        help="Recording with rrrgen's own columns, or mapping file of a recording; repeat for several.",
    )(function)


def truncated_option(function: F) -> F:
    """Add the flag ``--skip-truncated-line``."""
    text = "Leave out the last line of a text file if it is incomplete."
    return click.option("--skip-truncated-line", is_flag=True, help=text)(function)


def fresh_option(function: F) -> F:
    """Add the flag ``--fresh``."""
    text = "Discard a run that DIR already holds, and start over."
    return click.option("--fresh", is_flag=True, help=text)(function)


def jobs_options(function: F) -> F:
    """Add the options ``--jobs`` and ``--cluster``."""
    cluster = "Address of a Dask scheduler that distributes the work, tcp://HOST:PORT."
    function = click.option("--cluster", metavar="ADDRESS", help=cluster)(function)
    jobs = "Number of parallel processes."
    return click.option("-j", "--jobs", type=click.IntRange(min=1), default=1, show_default=True, help=jobs)(function)


def print_repairs(repairs: Iterable[Repairs], as_json: bool = False) -> None:
    """Print the repairs of every recording; with ``as_json`` only the warnings, which go to stderr."""
    for each in repairs:
        for line in [] if as_json else each.lines():
            say(line)
        for line in each.warnings():
            click.echo(with_warning(line), err=True)


def print_causes(causes: Iterable[Cause], as_json: bool = False) -> None:
    """Print the diagnoses with evidence and remedy; on stderr if stdout carries JSON."""
    for cause in causes:
        for line in cause.lines():
            click.echo(line, err=as_json)


@dataclass
class FindingsPrinter:
    """Prints what a study finds before its estimation; ``causes`` are the probable faults that were printed."""

    as_json: bool
    causes: list[Cause] = field(default_factory=list)

    def __call__(self, finding: Fault | Repairs | Cause) -> None:
        """Print a warning of the robot file, the repairs of a recording, or a probable fault."""
        from rrrgen.base.errors import Fault
        from rrrgen.lab.data.repairs import Repairs

        if isinstance(finding, Fault):
            click.echo(fault_text(finding), err=True)
        elif isinstance(finding, Repairs):
            print_repairs([finding], self.as_json)
        else:
            self.causes.append(finding)
            print_causes([finding], self.as_json)


def run_study(
    study: Callable[..., ResultType], *arguments: Any, as_json: bool, last: str = "", **more: Any
) -> ResultType:
    """Run a ``study`` with a progress bar and print its result, as JSON or as its report with the line ``last``."""
    from rrrgen.cli.arguments import print_json

    with progress_bar() as progress:
        result = study(*arguments, progress=progress, **more)
    if as_json:
        print_json(result.to_json())
    else:
        say(*result.lines(terminal_width()), *([last] if last else []))
    return result


def input_files(robot: str, logs: tuple[Path, ...], mappings: list[LogMapping], role: str = "log") -> dict[str, Path]:
    """The files that a run reads, by role: the robot (if it is a file), mapping files and data files."""
    files = {"robot": Path(robot)} if Path(robot).is_file() else {}
    for k, (log, mapping) in enumerate(zip(logs, mappings, strict=True)):
        files[f"{role}{k + 1}"] = log
        for source in mapping.files:
            files[f"{role}{k + 1}.{source.name}"] = Path(source.path)
    return files


def described_files(**paths: Path | None) -> dict[str, Path]:
    """Select those of ``paths``, by role, that are existing files; the name of a bundled robot is left out."""
    return {role: path for role, path in paths.items() if path is not None and path.is_file()}
