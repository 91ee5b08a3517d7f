"""Arguments and options that several commands share, and helpers for reading and printing."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click
from click.core import ParameterSource
from click.shell_completion import CompletionItem

from rrrgen.cli.terminal import fault_text, progress_bar, say, terminal_width, with_warning
from rrrgen.controller.table import MODES, PARTS, USUAL_PARTS

if TYPE_CHECKING:
    from rrrgen.base.errors import Fault
    from rrrgen.lab.data.mapping import LogMapping
    from rrrgen.lab.data.repair import Repairs
    from rrrgen.lab.identify.diagnosis.causes import Cause
    from rrrgen.lab.studies.options import StudyOptions
    from rrrgen.lab.studies.results import StudyResult
    from rrrgen.robot.spec import RobotSpec


SHORT = 3
"""Largest number of joints for which closed forms are shown by default."""

STDIN = "-"
"""The argument ROBOT that stands for the standard input."""

USUAL = ("forward_kinematics", "mass_matrix", "coriolis", "gravity")
"""Functions whose closed forms are shown by default."""

NONE = "none"
"""The word of ``--parts`` for a controller without optional parts."""

F = TypeVar("F", bound=Callable[..., Any])


class Number(click.FloatRange):
    """A finite real number, within bounds if there are any; ``click.FloatRange`` lets NaN and infinities pass."""

    def __init__(self, min: float | None = None, max: float | None = None, **more: bool) -> None:
        super().__init__(min, max, **more)
        self.name = "float" if min is None and max is None else self.name

    def _describe_range(self) -> str:
        """The bounds as the help prints them; click writes ``x<=None`` where there are none."""
        return "" if self.min is None and self.max is None else super()._describe_range()

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        """The number that the word ``value`` stands for."""
        number: float = super().convert(value, param, ctx)
        if not math.isfinite(number):
            self.fail(f"{value} is no finite number; write one such as 0.5 or 1e-3", param, ctx)
        return number


def complete_robot(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
    """Shell completion of the argument ROBOT: names of bundled robots, and files."""
    from rrrgen.robot.file import bundled_names

    names = [CompletionItem(name) for name in bundled_names() if name.startswith(incomplete)]
    return [*names, CompletionItem(incomplete, type="file")]


def complete_function(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[str]:
    """Shell completion of ``--function``: the functions of every model, and the inverse kinematics."""
    from rrrgen.derive.functions.table import TABLE

    names = [function.name for function in TABLE if function.group == "model"]
    return [name for name in (*names, "friction", "inverse_kinematics") if name.startswith(incomplete)]


def complete_words(
    known: Iterable[str], more: Callable[[], Iterable[str]]
) -> Callable[[click.Context, click.Parameter, str], list[CompletionItem]]:
    """Shell completion of a list of words with commas between them; ``more`` is asked when a word is completed."""

    def complete(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
        *before, last = incomplete.split(",")
        words = [word for word in sorted({*known, *more()}) if word.startswith(last) and word not in before]
        return [CompletionItem(",".join([*before, word])) for word in words]

    return complete


def export_targets() -> Iterable[str]:
    """Names of the targets of ``rrrgen export``, which ``--with`` takes too; unusable ones are named when asked for."""
    from rrrgen.exporting import exporters, unusable

    return [*exporters(), *unusable()]


def flag_here(name: str) -> str:
    """The flag of the option ``name`` of the command that runs; the name itself if the command has none."""
    context = click.get_current_context(silent=True)
    options = () if context is None else context.command.params
    return next(
        (parameter.opts[-1] for parameter in options if isinstance(parameter, click.Option) and parameter.name == name),
        name,
    )


def refuse(names: Iterable[str], reason: str) -> None:
    """Refuse options that would have no effect: raise click.UsageError with ``reason`` if the command line states any.

    ``names`` are those of the parameters of the command in Python; the error shows their flags.
    """
    context = click.get_current_context()
    stated = [name for name in names if context.get_parameter_source(name) is ParameterSource.COMMANDLINE]
    if stated:
        raise click.UsageError(f"{', '.join(map(flag_here, stated))}: {reason}")


def only_beside(mode: str, *allowed: str) -> None:
    """Refuse all options but ``allowed``, which the command would ignore because the option ``mode`` is given."""
    names = (str(parameter.name) for parameter in click.get_current_context().command.params)
    refuse((name for name in names if name not in allowed), f"has no effect with {mode}")


def robot_argument(function: F) -> F:
    """Add the argument ROBOT: the path of a robot file, the name of a bundled robot, or - for the standard input."""
    return click.argument("robot", shell_complete=complete_robot)(function)


def json_option(function: F) -> F:
    """Add the flag ``--json``, for machine-readable output."""
    return click.option("--json", "as_json", is_flag=True, help="Print JSON on stdout; messages go to stderr.")(
        function
    )


def real_option(function: F) -> F:
    """Add the option ``--real``, the floating-point type of the C code."""
    choice = click.Choice(["double", "float"])
    return click.option(
        "--real", type=choice, default="double", show_default=True, help="Floating-point type of the C code."
    )(function)


def ik_option(function: F) -> F:
    """Add the option ``--ik``: how the inverse kinematics is solved for an arm that is nearly of a special geometry."""
    from rrrgen.robot.file.fields import IK

    text = (
        "Inverse kinematics of an arm near a special geometry: general equations, or first the solutions of the "
        "special arm, refined.  [default: key `ik` of the robot file, else general]"
    )
    return click.option("--ik", "method", type=click.Choice(IK), help=text)(function)


def read_robot(robot: str, strict: bool = False) -> RobotSpec:
    """Read a robot file, a bundled robot by its name, or for ``-`` the standard input. Raises InputError for faults."""
    from rrrgen.robot.file import load_spec

    if robot != STDIN:
        return load_spec(robot, strict=strict)
    from rrrgen.base.yamltext.document import MAX_BYTES, decode
    from rrrgen.robot.file.reader import read_spec

    data = sys.stdin.buffer.read(MAX_BYTES + 1)
    return read_spec(decode(data, "<stdin>"), "<stdin>", strict)


def robot_source(robot: str) -> str | RobotSpec:
    """The robot for a study: as given, or read from the standard input for ``-``."""
    return read_robot(robot) if robot == STDIN else robot


def read_with_warnings(robot: str, strict: bool = False) -> RobotSpec:
    """Read the description of ``robot`` and print its warnings on stderr. Raises InputError for a faulty file."""
    spec = read_robot(robot, strict)
    for fault in spec.faults:
        click.echo(fault_text(fault), err=True)
    return spec


def words(
    choices: Iterable[str], more: Callable[[], Iterable[str]] = tuple
) -> Callable[[click.Context, click.Parameter, Iterable[str]], tuple[str, ...]]:
    """Make the callback of an option that takes words out of ``choices``, joined by commas; it may be given repeatedly.

    The callback returns the words as a tuple, each once, and raises BadParameter for another word. ``more`` gives
    further choices that take time to find: it is called for a word that is not among the first.
    """
    usual = tuple(choices)

    def callback(_ctx: click.Context, _param: click.Parameter, values: Iterable[str]) -> tuple[str, ...]:
        given = dict.fromkeys(word.strip() for value in values for word in value.split(","))
        allowed = usual if all(word in usual for word in given) else (*usual, *more())
        for word in given:
            if word not in allowed:
                from rrrgen.base.yamltext.suggestions import did_you_mean

                hint = " ".join(filter(None, (did_you_mean(word, allowed), f"allowed are {', '.join(allowed)}")))
                raise click.BadParameter(f"{word!r} is not known; {hint}")
        return tuple(given)

    return callback


def _parts(context: click.Context, option: click.Parameter, values: Iterable[str]) -> tuple[str, ...] | None:
    """The parts of the controller that were named, of which "none" has to stand alone; None for the usual ones."""
    named = words([*PARTS, NONE])(context, option, values)
    if NONE in named and len(named) > 1:
        raise click.BadParameter(f"'{NONE}' leaves all parts out, and '{named[named[0] == NONE]}' asks for one")
    return tuple(name for name in named if name != NONE) if named else None


def unit_options(function: F) -> F:
    """Add the options ``--modes`` and ``--parts`` of the controller; None where they are not given."""
    modes = words([mode.name for mode in MODES])
    function = click.option(
        "--parts",
        callback=_parts,
        multiple=True,
        metavar="PART,...",
        help=f"Parts of --with controller, instead of {', '.join(USUAL_PARTS)}: "
        + "; ".join(map(": ".join, PARTS.items()))
        + f"; {NONE}: without all of them.",
    )(function)
    return click.option(
        "--modes",
        callback=lambda context, option, values: modes(context, option, values) or None,
        multiple=True,
        metavar="MODE,...",
        help=f"Modes of --with controller, instead of all: {', '.join(mode.name for mode in MODES)}.",
    )(function)


def print_json(content: Any) -> None:
    """Print ``content`` on stdout as indented JSON."""
    readable = (sys.stdout.encoding or "").lower().replace("-", "") == "utf8"
    click.echo(json.dumps(content, indent=2, ensure_ascii=not readable, allow_nan=False))


# ------------------------------------------------------------------------------------------------------------------
# Options, settings and printing shared by the commands of the identification workflow.
# ------------------------------------------------------------------------------------------------------------------

ResultType = TypeVar("ResultType", bound="StudyResult")


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
    for recording_repairs in repairs:
        for line in [] if as_json else recording_repairs.lines():
            say(line)
        for line in recording_repairs.warnings():
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
        from rrrgen.lab.data.repair import Repairs

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
    with progress_bar() as progress:
        result = study(*arguments, progress=progress, **more)
    if as_json:
        print_json(result.to_json())
    else:
        say(*result.lines(terminal_width()), *([last] if last else []))
    return result


def run_on_recordings(
    study: Callable[..., ResultType],
    robot: str,
    logs: tuple[Path, ...],
    options: StudyOptions,
    output: Path,
    as_json: bool,
    findings: FindingsPrinter | None = None,
    written: str = "results",
    **more: Any,
) -> ResultType:
    """Run a ``study`` of the recordings ``logs`` of a ``robot`` and print its result, and what is ``written`` where."""
    return run_study(
        study,
        robot_source(robot),
        logs,
        options=options,
        folder=output,
        findings=findings or FindingsPrinter(as_json),
        as_json=as_json,
        last=f"{written} in {output}",
        **more,
    )


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
