"""``rrrgen import``."""

from __future__ import annotations

from pathlib import Path

import click

from rrrgen.errors import Fault, InputError


class _WithFormats(click.Command):
    """Its help ends with the formats there are."""

    def format_epilog(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Name and meaning of every importer."""
        from rrrgen.robotfile.importers.importing import importers

        with formatter.section("Formats"):
            formatter.write_dl([(each.name, each.meaning) for each in importers().values()])


@click.command(cls=_WithFormats)
@click.argument("file", type=click.Path(path_type=Path), metavar="FILE")
@click.option("-o", "--output", type=click.Path(path_type=Path, dir_okay=False), help="File; NAME.yaml if not given.")
@click.option("--format", "form", metavar="FORMAT", help="One of those below; found from the content if not given.")
@click.option("--name", help="Name of the robot, instead of the one in the file.")
@click.option("--set", "values", multiple=True, metavar="NAME=VALUE", help="Value of a name in the file; repeat.")
@click.option("--force", is_flag=True, help="Overwrite the file.")
def import_robot(
    file: Path, output: Path | None, form: str | None, name: str | None, values: tuple[str, ...], force: bool
) -> None:
    """Write a robot file from a file of another program.

    What a robot file cannot represent is printed, or refused where the robot would be another one without it. Values
    are in SI units and rad, or have a unit.

    \b
    Examples:
      rrrgen import RX90.par --set D3=450mm --set RL4=450mm --set G3=-9.81
      rrrgen import arm.par --format symoro -o my_arm.yaml
    """
    from rrrgen.robotfile.importers.importing import import_robot as read

    found = read(file, form, name, dict(_pair(value) for value in values))
    path = output or Path(f"{found.spec.name}.yaml")
    if path.exists() and not force:
        raise InputError([Fault(str(path), 0, 0, "the file exists already", hint="--force overwrites it")])
    try:
        path.write_text(found.text, encoding="utf-8", newline="\n")
    except OSError as error:
        raise InputError([Fault(str(path), 0, 0, f"the file cannot be written: {error.strerror}")]) from None
    for note in found.notes:
        click.echo(str(note), err=True)
    click.echo(f"{path} written from {found.format}; next: rrrgen check {path}, rrrgen show {path}")


def _pair(text: str) -> tuple[str, str]:
    name, equals, value = text.partition("=")
    if not equals or not name.strip() or not value.strip():
        raise click.BadParameter(f"'{text}' is not NAME=VALUE, e.g. D3=0.45", param_hint="--set")
    return name.strip(), value.strip()
