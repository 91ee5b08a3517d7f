"""``rrrgen schema``."""

from __future__ import annotations

import click

from rrrgen.cli.arguments import print_json


@click.command()
def schema() -> None:
    """Print the JSON Schema of robot files.

    \b
    Example:
      rrrgen schema > robot.schema.json
    and as the first line of a robot file, for editors with the YAML language server:
      # yaml-language-server: $schema=./robot.schema.json
    """
    from rrrgen.robotfile import json_schema

    print_json(json_schema())
