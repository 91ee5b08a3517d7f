"""The command ``rrrgen new``: write a robot file to start from, with a comment on every field."""

from __future__ import annotations

from pathlib import Path

import click

from rrrgen.base.errors import Fault, InputError, cannot_write
from rrrgen.cli.terminal import say


@click.command()
@click.argument("name")
@click.option(
    "-o", "--output", type=click.Path(path_type=Path, dir_okay=False), help="File to write; NAME.yaml by default."
)
@click.option("--joints", default="RRR", show_default=True, help="One letter per joint: R revolute, P prismatic.")
@click.option(
    "--convention",
    type=click.Choice(["standard", "modified"]),
    default="standard",
    show_default=True,
    help="Denavit-Hartenberg convention.",
)
@click.option("--from", "bundled", metavar="ROBOT", help="Start from a copy of a bundled robot instead.")
@click.option("--force", is_flag=True, help="Overwrite an existing file.")
def new(name: str, output: Path | None, joints: str, convention: str, bundled: str | None, force: bool) -> None:
    """Write a robot file to start from, with a comment on every field.

    The arm in it can move in as many independent directions as its joints allow; six or more joints that end in RRR
    have a spherical wrist. Change the numbers to those of your robot.

    \b
    Examples:
      rrrgen new elbow3                     # elbow3.yaml with three revolute joints
      rrrgen new arm6 --joints RRRRRR       # a shoulder, an elbow and a spherical wrist
      rrrgen new gantry2 --joints PP
      rrrgen new my_ur5 --from ur5
    """
    from rrrgen.robot.file import loads_spec
    from rrrgen.robot.names import name_fault

    fault = name_fault(name, "robot")
    if fault is not None:
        raise InputError([Fault(name, 0, 0, fault[0], hint=fault[1])])
    if not joints or set(joints.upper()) - set("RP"):
        raise click.BadParameter("one letter per joint, R or P, e.g. RRPR", param_hint="--joints")
    path = output or Path(f"{name}.yaml")
    if path.exists() and not force:
        raise InputError([Fault(str(path), 0, 0, "the file exists already", hint="--force overwrites it")])
    text = _renamed(bundled, name) if bundled else _template(name, joints.upper(), convention)
    loads_spec(text, str(path))  # what is written is valid, or nothing is written
    try:
        path.write_text(text, encoding="utf-8", newline="\n")
    except OSError as error:
        raise cannot_write(path, error) from None
    say(f"{path} written; next: rrrgen check {path}, rrrgen show {path}")


def _template(name: str, joints: str, convention: str) -> str:
    from rrrgen.base.templates import render
    from rrrgen.robot.file.fields import EMIT, FRICTION, LINEAR_FRICTION
    from rrrgen.robot.friction.laws import LAWS
    from rrrgen.robot.robots.starting_rows import starting_rows

    start = starting_rows(joints, convention)
    return render(
        "robot.yaml.j2",
        name=name,
        joints=joints,
        convention=convention,
        rows=start.rows,
        parameters=start.parameters,
        tip=start.tip,
        laws=LAWS.values(),
        law_fields=[key for key in FRICTION if key not in LINEAR_FRICTION and key.name != "law"],
        emitted=EMIT,
    )


def _renamed(bundled: str, name: str) -> str:
    from rrrgen.robot.file import bundled_path

    lines = bundled_path(bundled).read_text(encoding="utf-8").splitlines()
    return "\n".join(f"name: {name}" if line.startswith("name:") else line for line in lines) + "\n"
