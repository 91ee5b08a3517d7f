"""The command ``rrrgen check``: report every fault of robot files."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from rrrgen.base.errors import Fault, InputError
from rrrgen.cli.arguments import complete_robot, json_option, print_json, read_robot
from rrrgen.cli.terminal import fault_text, mark_failed, mark_passed, say

if TYPE_CHECKING:
    from rrrgen.robot.spec import RobotSpec


@click.command()
@click.argument("files", nargs=-1, required=True, metavar="ROBOT...", shell_complete=complete_robot)
@click.option("--strict", is_flag=True, help="Treat warnings, such as unphysical inertias, as errors.")
@json_option
def check(files: tuple[str, ...], strict: bool, as_json: bool) -> int:
    """Check robot files and print every fault as file:line:col, with the line and what is allowed.

    A file named - is the standard input. Exits with 3 if a file has errors.

    \b
    Examples:
      rrrgen check elbow3.yaml
      rrrgen check --strict robots/*.yaml
      make-robot | rrrgen check -
    """
    results = [_check(file, strict, as_json) for file in files]
    if as_json:
        print_json(results)
    return 0 if all(result["ok"] for result in results) else InputError.exit_code


def _check(file: str, strict: bool, quiet: bool) -> dict[str, Any]:
    summary, faults = "", []
    try:
        spec = read_robot(file, strict)
        faults = [fault for fault in spec.faults if isinstance(fault, Fault)]
        coupled = "" if spec.drives is None else ", coupled drives"
        summary = f"{spec.name}, {spec.n} joints, {spec.convention} DH{coupled}{_approach(spec)}"
    except InputError as error:
        faults = list(error.faults)
    ok = bool(summary)
    if not quiet:
        for fault in faults:
            click.echo(fault_text(fault), err=True)
        say(f"{file}: {mark_passed('ok')} ({summary})" if ok else f"{file}: {mark_failed(_count(faults))}")
    return {"file": file, "ok": ok, "summary": summary, "faults": [_plain(fault) for fault in faults]}


def _approach(spec: RobotSpec) -> str:
    """Text on how the inverse kinematics treats an arm near a special geometry; empty unless the file asks for it."""
    if spec.ik == "general":
        return ""
    from rrrgen.ik.classify import plan

    return f", {plan(spec).approach}"


def _count(faults: list[Fault]) -> str:
    errors = sum(fault.severity == "error" for fault in faults)
    warnings = len(faults) - errors
    text = f"{errors} error{'s' * (errors != 1)}"
    return f"{text}, {warnings} warning{'s' * (warnings != 1)}" if warnings else text


def _plain(fault: Fault) -> dict[str, Any]:
    return {
        "file": fault.file,
        "line": fault.line,
        "column": fault.column,
        "severity": fault.severity,
        "message": fault.message,
        "hint": fault.hint,
    }
