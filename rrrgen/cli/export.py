"""The command ``rrrgen export``: write files of a robot for another program, or a package that other programs load."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import click

from rrrgen.base.errors import Fault, InputError
from rrrgen.cli.arguments import (
    complete_words,
    export_targets,
    read_with_warnings,
    real_option,
    robot_argument,
    unit_options,
    words,
)
from rrrgen.cli.terminal import say, working
from rrrgen.robot.file.fields import EMIT

if TYPE_CHECKING:
    from rrrgen.emit import Real
    from rrrgen.emit.targets.interface import Contents, Exporter


class _WithTargets(click.Command):
    """A command whose help ends with the list of export targets."""

    def format_epilog(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the name and meaning of every target, and the platforms to build for."""
        from rrrgen.emit.targets.shared_libraries import PLATFORMS
        from rrrgen.exporting import exporters

        with formatter.section("Targets"):
            formatter.write_dl([(exporter.name, _describe(exporter)) for exporter in exporters().values()])
        with formatter.section("Platforms"):
            formatter.write_text(", ".join(PLATFORMS))


@click.command(cls=_WithTargets)
@robot_argument
@click.option(
    "--to",
    "wanted",
    metavar="TARGET",
    required=True,
    multiple=True,
    shell_complete=complete_words((), export_targets),
    help="One of those below; may be repeated.",
)
@click.option("-o", "--output", type=click.Path(path_type=Path), help="File or folder; after the robot if not given.")
@click.option(
    "--beta",
    type=click.Path(path_type=Path, dir_okay=False),
    metavar="FILE",
    help="Base parameters (JSON, name: value) in place of the robot file's links.",
)
@real_option
@click.option(
    "--with",
    "further",
    callback=words(EMIT),
    multiple=True,
    metavar="WORD,...",
    help="What a package of code holds besides the model and what the robot file asks for under emit, such as "
    "control,observer; each target names what it takes.",
)
@click.option(
    "--platform",
    "platforms",
    multiple=True,
    metavar="NAME",
    help="Build for this platform instead of this machine, by the compiler of the package ziglang; may be repeated.",
)
@unit_options
@click.option("--force", is_flag=True, help="Overwrite a file.")
def export(
    robot: str,
    wanted: tuple[str, ...],
    output: Path | None,
    beta: Path | None,
    real: Real,
    further: tuple[str, ...],
    platforms: tuple[str, ...],
    modes: tuple[str, ...] | None,
    parts: tuple[str, ...] | None,
    force: bool,
) -> None:
    """Write files of a robot for another program, or a package that other programs load.

    What the target cannot represent is printed. Where a simulator needs rigid bodies and the robot file has others,
    bodies with the same base parameters are found, which have the same dynamics.

    \b
    Examples:
      rrrgen export panda.yaml --to urdf
      rrrgen export rrr --to mjcf -o rrr.xml
      rrrgen export rrr --to wheel --with control,observer
      rrrgen export rrr --to fmu --with controller --modes computed_torque --parts observer,friction
      rrrgen export rrr --to fmu --platform linux-x86_64 --platform windows-x86_64
    """
    from rrrgen.base.files import write, write_file
    from rrrgen.emit.targets.interface import ExportOptions
    from rrrgen.exporting import export_robot, exporter_of, unusable

    spec = read_with_warnings(robot)
    chosen = {name: words for name, words in (("modes", modes), ("parts", parts)) if words is not None}
    options = ExportOptions(real, platforms, further, chosen)
    targets = tuple(dict.fromkeys(wanted))
    if output is not None and len(targets) > 1:
        raise InputError(f"-o names one file or folder, but --to {len(targets)} targets: {', '.join(targets)}")
    values = _read_beta(beta) if beta is not None else None
    places = []
    for target in targets:
        with working(f"writing files for {target}"):
            exported = export_robot(spec, target, values, options)
        name = _alone(exported.files, exporter_of(target), output)
        places.append((exported, name, output or Path(name or f"{spec.name}_{target}")))
    files = [path for _, name, path in places if name is not None]
    if folders := [path for path in files if path.is_dir()]:
        hint = f"-o names a file, such as {folders[0] / str(places[0][1])}"
        raise InputError([Fault(str(path), 0, 0, "a folder has this name", hint=hint) for path in folders])
    there = [path for path in files if path.exists()]
    if there and not force:
        hint = "--force overwrites it"
        raise InputError([Fault(str(path), 0, 0, "the file exists already", hint=hint) for path in there])
    for exported, name, path in places:
        if name is not None:
            write_file(path, exported.files[name])
        else:
            write(exported.files, path)
        for note in exported.notes:
            click.echo(f"{path}: {note}", err=True)
        say(f"{path} written")
    for fault in unusable().values():
        click.echo(f"warning: {fault}", err=True)


def _alone(files: Mapping[str, Contents], exporter: Exporter, output: Path | None) -> str | None:
    """The file that is written alone, to ``output``: the only one, or a package that ``output`` names by its suffix.

    None where all files go into a folder. Raises InputError for a package whose file name must stay as it is.
    """
    if exporter.one_file:
        (name,) = files
        return name
    packages = [name for name in files if Path(name).suffix in PACKAGES and "/" not in name]
    if output is None or not any(output.suffix == Path(name).suffix for name in packages):
        return None
    named = [name for name in packages if name == output.name or PACKAGES[Path(name).suffix]]
    if len(named) != 1:
        hint = f"name a folder, or the file {packages[0]}: its name says for what it is built"
        raise InputError([Fault(str(output), 0, 0, "a package of another name cannot be installed", hint=hint)])
    return named[0]


PACKAGES = {".fmu": True, ".whl": False}
"""Suffixes of packages that are complete in themselves, and whether they may have any name."""


def _describe(exporter: Exporter) -> str:
    """Describe a target for the help: its meaning, and the words that it accepts after ``--with``."""
    return exporter.meaning + (f"; --with {','.join(exporter.further)}" if exporter.further else "")


def _read_beta(path: Path) -> dict[str, float]:
    """Read base parameters by name from the file of ``--beta``."""
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError) as error:
        raise InputError([Fault(str(path), 0, 0, f"the file cannot be read: {error}")]) from None
    except json.JSONDecodeError as error:
        raise InputError([Fault(str(path), error.lineno, error.colno, f"not valid JSON: {error.msg}")]) from None
    numbers = isinstance(content, dict) and all(
        isinstance(value, (int, float)) and not isinstance(value, bool) and abs(value) < 1e15
        for value in content.values()
    )
    if not numbers:
        hint = '{"Izz1R": 0.5, "mx2": 0.1, ...}, names as in rrrgen show'
        raise InputError([Fault(str(path), 0, 0, "the file is no object of names and numbers", hint=hint)])
    return {str(name): float(value) for name, value in content.items()}
