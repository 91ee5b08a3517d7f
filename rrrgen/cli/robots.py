"""The command ``rrrgen robots``: list the bundled robots with their joints and where their numbers come from."""

from __future__ import annotations

import click

from rrrgen.base.tables import text_table
from rrrgen.cli.arguments import json_option, print_json
from rrrgen.cli.terminal import say, terminal_width

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
