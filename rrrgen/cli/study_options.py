"""Options of a command made from the dataclass of options of its study."""

from __future__ import annotations

import functools
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import click

from rrrgen.base.errors import options_written, with_names
from rrrgen.cli.arguments import (
    Number,
    flag_here,
    fresh_option,
    json_option,
    log_option,
    output_option,
    robot_argument,
    truncated_option,
)
from rrrgen.lab.studies.options import OptionError, OptionField, StudyOptions, option_fields, with_changes

F = TypeVar("F", bound=Callable[..., Any])


def click_options(kind: type[StudyOptions]) -> Callable[[F], F]:
    """Add the options of a study to a command, which receives them as ``options``, an instance of ``kind``.

    A Literal becomes a choice, a tuple a repeatable option, a bool a flag (a pair if it is on by default), a bound a
    range. An :class:`OptionError` of the study becomes a usage error that shows flags.
    """
    fields = {entry.name: entry for entry in option_fields(kind) if entry.about.command}

    def flag_name(name: str) -> str:
        return flags_of(fields[name])[-1] if name in fields else name

    def decorate(function: F) -> F:
        @functools.wraps(function)
        def command(**values: Any) -> Any:
            given = {name: values.pop(name) for name in fields}
            try:
                with options_written(flag_here):
                    return function(options=with_changes(kind, None, given), **values)
            except OptionError as error:
                if error.option in fields:
                    raise click.BadParameter(str(error), param_hint=flag_name(error.option)) from None
                raise click.UsageError(str(error)) from None

        decorated: Any = command
        for entry in reversed(fields.values()):
            decorated = click_option(entry, flag_name)(decorated)
        return decorated  # type: ignore[no-any-return]

    return decorate


def recording_options(kind: type[StudyOptions], *more: Callable[[Any], Any]) -> Callable[[F], F]:
    """Add the arguments of a study of recordings: ROBOT, ``--log``, ``more`` options, the folder, those of ``kind``."""

    def decorate(function: F) -> F:
        decorator: Callable[[F], F] = click_options(kind)
        function = truncated_option(output_option(decorator(fresh_option(json_option(function)))))
        for option in reversed((robot_argument, log_option, *more)):
            function = option(function)
        return function

    return decorate


def flags_of(entry: OptionField) -> tuple[str, ...]:
    """The flags of an option on the command line."""
    return entry.about.flags or (f"--{entry.name.replace('_', '-')}",)


def click_option(entry: OptionField, shown: Callable[[str], str]) -> Callable[[F], F]:
    """One option of a command; ``shown`` writes the names of other options in its help."""
    about, kind = entry.about, entry.item or entry.kind
    text = with_names(about.meaning, shown)
    flags = flags_of(entry)
    if kind is bool:
        pair = f"{flags[-1]}/--no-{entry.name.replace('_', '-')}" if entry.default else ""
        declared = (*flags[:-1], pair) if pair else flags
        more: dict[str, Any] = {"default": entry.default} if pair else {"is_flag": True}
        return click.option(*declared, entry.name, help=text, show_default=about.shown, **more)
    return click.option(
        *flags,
        entry.name,
        type=_click_type(entry, kind),
        default=None if entry.item else entry.default,
        multiple=entry.item is not None,
        metavar=about.metavar or about.unit.upper() or None,
        show_default=about.shown,
        help=text,
    )


def _click_type(entry: OptionField, kind: Any) -> Any:
    about = entry.about
    if entry.choices:
        return click.Choice(list(entry.choices))
    if kind is Path:
        return click.Path(path_type=Path)
    if kind is str:
        return str
    if kind is int:
        return int if about.least is None else click.IntRange(min=int(about.least))
    low = about.least if about.above is None else about.above
    return Number(min=low, min_open=about.above is not None)
