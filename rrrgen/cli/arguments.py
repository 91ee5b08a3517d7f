"""Arguments and options that several commands share, and how they print."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, TypeVar

import click
from click.shell_completion import CompletionItem

if TYPE_CHECKING:
    from rrrgen.spec.robot_spec import RobotSpec

F = TypeVar("F", bound=Callable[..., Any])


def complete_robot(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
    """Shell completion of ROBOT: bundled names, and files."""
    from rrrgen.spec import bundled_names

    names = [CompletionItem(name) for name in bundled_names() if name.startswith(incomplete)]
    return [*names, CompletionItem(incomplete, type="file")]


def robot_argument(function: F) -> F:
    """The argument ROBOT: a path to a robot file, or a bundled name."""
    return click.argument("robot", shell_complete=complete_robot)(function)


def json_option(function: F) -> F:
    """The flag ``--json``."""
    return click.option("--json", "as_json", is_flag=True, help="Print JSON on stdout; messages go to stderr.")(
        function
    )


def real_option(function: F) -> F:
    """The choice ``--real``."""
    choice = click.Choice(["double", "float"])
    return click.option("--real", type=choice, default="double", show_default=True, help="Real type of the C code.")(
        function
    )


def read_with_warnings(robot: str, strict: bool = False) -> RobotSpec:
    """The description of ``robot``; its warnings go to stderr."""
    from rrrgen.spec import load_spec

    spec = load_spec(robot, strict=strict)
    for fault in spec.faults:
        click.echo(str(fault), err=True)
    return spec


def print_json(content: Any) -> None:
    """``content`` on stdout."""
    click.echo(json.dumps(content, indent=2, ensure_ascii=False, allow_nan=False))
