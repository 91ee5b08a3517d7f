"""The command ``rrrgen import``: write a robot file from a file of another program."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Literal

import click

from rrrgen.base.errors import Fault, InputError
from rrrgen.cli.arguments import Number
from rrrgen.cli.terminal import fault_text, say


class _WithFormats(click.Command):
    """A command whose help ends with the list of formats that can be imported."""

    def format_epilog(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the name and meaning of every importer."""
        from rrrgen.robot.importers.importing import importers

        with formatter.section("Formats"):
            formatter.write_dl([(importer.name, importer.meaning) for importer in importers().values()])


@click.command(cls=_WithFormats)
@click.argument("file", type=click.Path(path_type=Path), metavar="FILE")
@click.option("-o", "--output", type=click.Path(path_type=Path, dir_okay=False), help="File; NAME.yaml if not given.")
@click.option("--format", "form", metavar="FORMAT", help="One of those below; found from the content if not given.")
@click.option("--name", help="Name of the robot, instead of the one in the file.")
@click.option("--set", "values", multiple=True, metavar="NAME=VALUE", help="Value of a name in the file; repeat.")
@click.option("--base", metavar="LINK", default="", help="URDF, MJCF: first link; the root if not given.")
@click.option(
    "--tip",
    "tips",
    multiple=True,
    metavar="LINK",
    help="URDF, MJCF: last link; the only leaf if not given. Repeat for branches.",
)
@click.option("--hold", "held", multiple=True, metavar="JOINT=VALUE", help="URDF, MJCF: hold a joint; repeat.")
@click.option(
    "--convention",
    type=click.Choice(["standard", "modified"]),
    default="standard",
    show_default=True,
    help="URDF, MJCF: Denavit-Hartenberg convention to write.",
)
@click.option(
    "--angle-tolerance",
    type=Number(0, 0.01),
    default=1e-5,
    show_default=True,
    metavar="RAD",
    help="URDF, MJCF, .par: angles this near to a multiple of 15 degrees are taken as exact.",
)
@click.option("--force", is_flag=True, help="Overwrite the file.")
@click.option("-v", "--verbose", is_flag=True, help="List what has no effect on a model too, such as shapes.")
def import_robot(
    file: Path,
    output: Path | None,
    form: str | None,
    name: str | None,
    values: tuple[str, ...],
    base: str,
    tips: tuple[str, ...],
    held: tuple[str, ...],
    convention: Literal["standard", "modified"],
    angle_tolerance: float,
    force: bool,
    verbose: bool,
) -> int:
    """Write a robot file from a file of another program.

    Whatever a robot file cannot represent is listed in the output; if leaving it out would change how the robot
    moves, the import is refused. Where Pinocchio (URDF) or MuJoCo (MJCF) is installed, the robot is compared with
    its reading of the file; exits with 1 if they move differently. Values are in SI units and rad, or have a unit.

    \b
    Examples:
      rrrgen import RX90.par --set D3=450mm --set RL4=450mm --set G3=-9.81
      rrrgen import panda.urdf --tip panda_link8 -o panda.yaml
      rrrgen import cell.xml --tip tool --hold rail=250mm
      rrrgen import torso.urdf --tip left_hand --tip right_hand --convention modified
    """
    from rrrgen.base.files import write_file
    from rrrgen.robot.importers.importing import import_robot as read
    from rrrgen.robot.importers.importing import parse_quantity
    from rrrgen.robot.importers.interface import ChainChoice

    stated = {joint: parse_quantity(joint, value) for joint, value in (_pair(text, "--hold") for text in held)}
    fixed = {joint: value for joint, (value, _) in stated.items()}
    units = {joint: unit for joint, (_, unit) in stated.items() if unit is not None}
    chain = ChainChoice(base, tips[0] if tips else "", fixed, convention, angle_tolerance, tips[1:], units)
    imported = read(file, form, name, dict(_pair(value, "--set") for value in values), chain)
    path = output or Path(f"{imported.spec.name}.yaml")
    if path.exists() and not force:
        raise InputError([Fault(str(path), 0, 0, "the file exists already", hint="--force overwrites it")])
    write_file(path, imported.text)
    say(f"{path} written from {imported.format}; next: rrrgen check {path}, rrrgen show {path}")
    contradictions = ""
    if imported.chain is not None:
        from rrrgen.verify.references.imported_source import compare_with_source

        compared = compare_with_source(imported)
        contradictions = compared.contradictions
        say(str(compared))
    shapes = [note for note in imported.notes if note.message.startswith(SHAPES)]
    for note in imported.notes if verbose else (note for note in imported.notes if note not in shapes):
        click.echo(fault_text(note), err=True)
    if shapes and not verbose:
        click.echo(f"{_shapes_in(imported.source)} left out (--verbose lists them)", err=True)
    if not contradictions:
        return 0
    hint = "what is left out may explain it; do not rely on this file before it is explained"
    message = f"the robot file does not move as {file}: {contradictions}"
    click.echo(fault_text(Fault(str(path), 0, 0, message, hint=hint, severity="warning")), err=True)
    return 1


SHAPES = ("<visual> is left out", "<collision> is left out")
"""Beginnings of the notes on elements that change nothing in a model and stand in nearly every file."""


def _shapes_in(source: str) -> str:
    """The number of elements of a URDF that describe looks and shapes for contact, in words."""
    count = len(re.findall(r"<(?:visual|collision)[\s>/]", source))
    return f"{count} visual and collision element{'s' * (count != 1)}"


def _pair(text: str, option: str) -> tuple[str, str]:
    name, equals, value = text.partition("=")
    if not equals or not name.strip() or not value.strip():
        raise click.BadParameter(f"'{text}' is not NAME=VALUE, e.g. D3=0.45", param_hint=option)
    return name.strip(), value.strip()
