"""The command ``rrrgen schema``: print the JSON Schema of robot files."""

from __future__ import annotations

import click

from rrrgen.cli.arguments import print_json


@click.command()
@click.option("--markdown", is_flag=True, help="Print a page with a table of every key instead.")
def schema(markdown: bool) -> None:
    """Print the JSON Schema of robot files.

    \b
    Example:
      rrrgen schema > robot.schema.json
    and as the first line of a robot file, for editors with the YAML language server:
      # yaml-language-server: $schema=./robot.schema.json
    """
    from rrrgen.robotfile import json_schema
    from rrrgen.robotfile.reference_page import reference_page

    if markdown:
        click.echo(reference_page(), nl=False)
    else:
        print_json(json_schema())
