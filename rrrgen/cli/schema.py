"""The command ``rrrgen schema``: print the JSON Schema of robot files."""

from __future__ import annotations

import click

from rrrgen.cli.arguments import print_json


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
        from rrrgen.robot.file.reference_page import reference_page

        click.echo(reference_page(), nl=False)
    else:
        from rrrgen.robot.file import json_schema

        print_json(json_schema())
