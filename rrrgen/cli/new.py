"""The command ``rrrgen new``: write a robot file to start from, with a comment on every field."""

from __future__ import annotations

from pathlib import Path

import click

from rrrgen.base.errors import Fault, InputError
from rrrgen.base.files import write_file
from rrrgen.base.tables import text_table
from rrrgen.cli.arguments import json_option, only_beside, print_json
from rrrgen.cli.terminal import say, terminal_width


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
    from rrrgen.robot.spec import name_fault

    fault = name_fault(name, "robot")
    if fault is not None:
        raise InputError([Fault(name, 0, 0, fault[0], hint=fault[1])])
    if not joints or set(joints.upper()) - set("RP"):
        raise click.BadParameter("one letter per joint, R or P, e.g. RRPR", param_hint="--joints")
    if bundled is not None:
        only_beside("--from", "name", "output", "bundled", "force")
    path = output or Path(f"{name}.yaml")
    if path.exists() and not force:
        raise InputError([Fault(str(path), 0, 0, "the file exists already", hint="--force overwrites it")])
    text = _rename_robot(bundled, name) if bundled else _template(name, joints.upper(), convention)
    loads_spec(text, str(path))  # what is written is valid, or nothing is written
    write_file(path, text)
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


def _rename_robot(bundled: str, name: str) -> str:
    from rrrgen.robot.file import bundled_path

    lines = bundled_path(bundled).read_text(encoding="utf-8").splitlines()
    return "\n".join(f"name: {name}" if line.startswith("name:") else line for line in lines) + "\n"


# ------------------------------------------------------------------------------------------------------------------
# The command ``rrrgen robots``: list the bundled robots with their joints and where their numbers come from.
# ------------------------------------------------------------------------------------------------------------------

NO_LINKS = " (kinematics only: no links)"


@click.command()
@json_option
def robots(as_json: bool) -> None:
    """List the bundled robots with their joints and where their numbers come from.

    \b
    Example:
      rrrgen robots
      rrrgen show ur5
    """
    from rrrgen.robot.file import bundled_names, load_spec

    rows = []
    for name in bundled_names():
        spec = load_spec(name)
        joints = "".join("R" if joint.is_revolute else "P" for joint in spec.joints)
        rows.append(
            {
                "name": name,
                "joints": joints,
                "convention": spec.convention,
                "links": spec.links is not None,
                "description": spec.description,
                "source": spec.source,
            }
        )
    if as_json:
        print_json(rows)
        return
    table = [
        (
            *(str(row[key]) for key in ("name", "joints", "convention")),
            f"{row['description']}{'' if row['links'] else NO_LINKS}",
        )
        for row in rows
    ]
    say("\n".join(text_table(table, terminal_width(), indent="")))


# ------------------------------------------------------------------------------------------------------------------
# The command ``rrrgen schema``: print the JSON Schema of robot files.
# ------------------------------------------------------------------------------------------------------------------


@click.command()
@click.option("--markdown", is_flag=True, help="Print a page with a table of every key instead.")
@click.option(
    "--other-files",
    is_flag=True,
    help="Print such a page for mapping, experiment, controller and response files instead.",
)
def schema(markdown: bool, other_files: bool) -> None:
    """Print the JSON Schema of robot files.

    \b
    Examples:
      rrrgen schema --markdown
      rrrgen schema --other-files
      rrrgen schema > robot.schema.json
    and as the first line of a robot file, for editors with the YAML language server:
      # yaml-language-server: $schema=./robot.schema.json
    """
    if markdown and other_files:
        raise click.UsageError("give one of --markdown and --other-files")
    if other_files:
        from rrrgen.lab.experiment import reference_page as other_pages

        click.echo(other_pages.reference_page(), nl=False)
    elif markdown:
        from rrrgen.robot.file.schema import reference_page

        click.echo(reference_page(), nl=False)
    else:
        from rrrgen.robot.file import json_schema

        print_json(json_schema())
