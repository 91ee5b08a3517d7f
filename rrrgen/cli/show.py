"""The command ``rrrgen show``: print a robot as rrrgen understands it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rrrgen.cli.arguments import (
    SHORT,
    USUAL,
    complete_function,
    json_option,
    print_json,
    read_with_warnings,
    robot_argument,
)
from rrrgen.cli.colour import with_headings
from rrrgen.cli.html import html_option, read_motions, write_html
from rrrgen.cli.progress import progress_bar
from rrrgen.cli.terminal import say, terminal_width

if TYPE_CHECKING:
    from rrrgen.derive.derived_model import Derivation, ParametrizedRobot
    from rrrgen.emit.latex import Form
    from rrrgen.emit.latex.inverse_kinematics import ClosedForm as InverseForm
    from rrrgen.program import Program
    from rrrgen.robot.robot_spec import RobotSpec

INVERSE = "inverse_kinematics"


@click.command()
@robot_argument
@click.option(
    "-f",
    "--function",
    "functions",
    multiple=True,
    shell_complete=complete_function,
    help="Function to show in closed form; repeat for several.",
)
@click.option("--entry", help="Only this entry of the function, e.g. 1,2, counted from 1; for large robots.")
@click.option("--closed-forms/--no-closed-forms", default=None, help="Show closed forms; by default up to 3 joints.")
@click.option("--program", "as_program", is_flag=True, help="Show the intermediate representation of the functions.")
@click.option("--recorded", is_flag=True, help="With --program: every recorded variant, before any pass.")
@click.option("--latex", "as_latex", is_flag=True, help="Print the closed forms as LaTeX.")
@html_option
@click.option(
    "--motion",
    "motions",
    multiple=True,
    type=click.Path(path_type=Path, exists=True, dir_okay=False),
    help="With --html: trajectory of `rrrgen excite`, or recording, to be played; repeat for several.",
)
@click.option(
    "--run",
    "runs",
    multiple=True,
    type=click.Path(path_type=Path, exists=True, file_okay=False),
    help="With --html: run folder whose figures are included; repeat for several.",
)
@json_option
def show(
    robot: str,
    functions: tuple[str, ...],
    entry: str | None,
    closed_forms: bool | None,
    as_program: bool,
    recorded: bool,
    as_latex: bool,
    html: Path | None,
    motions: tuple[Path, ...],
    runs: tuple[Path, ...],
    as_json: bool,
) -> None:
    """Print what rrrgen reads in a robot file, and what it derives from it.

    First comes the file as it is understood, each value in SI and in the usual units (rad and deg, m and mm):
    conventions, DH table, base, tool, limits, friction, drives and links. Then follow the pose at q = 0, the base
    parameters with the link parameters that each of them combines, the operations of every function, and the closed
    forms of an arm of up to three joints, or those that --function names.

    \b
    Examples:
      rrrgen show rrr
      rrrgen show rrr -f mass_matrix --latex
      rrrgen show panda -f mass_matrix --entry 7,7
      rrrgen show ur10e -f inverse_kinematics
      rrrgen show rrr -f gravity --program
      rrrgen show rrr -f gravity --program --recorded
      rrrgen show ur10e -f inverse_kinematics --program
      rrrgen show ur10e --html ur10e.html
      rrrgen show rrr --html rrr.html --motion runs/experiment/results/log.yaml --run runs/identified
    """
    from rrrgen.derive import derive_once, parametrized, prepare

    if as_latex and as_json:
        raise click.UsageError("give one of --latex and --json")
    if entry is not None and len(functions) != 1:
        raise click.UsageError("--entry needs exactly one --function")
    if html is None and (motions or runs):
        raise click.UsageError("--motion and --run go with --html")
    if recorded and not as_program:
        raise click.UsageError("--recorded goes with --program")
    if as_program:
        if as_latex or html is not None or entry is not None:
            raise click.UsageError("--program goes with --function and --json only")
        _show_programs(robot, functions, recorded, as_json)
        return
    spec = read_with_warnings(robot)
    short = closed_forms or (closed_forms is None and spec.n <= SHORT)
    wanted = [name for name in functions if name != INVERSE] or (USUAL if short and not functions else ())
    asked = INVERSE in functions
    inverse = _inverse_kinematics(spec, asked, bool(short)) if asked or not functions else None
    forms: dict[str, Form] = {}
    with progress_bar() as tell:
        tell(0, 0, "derivation")
        derivation = prepare(spec)
        for done, name in enumerate(wanted):
            tell(done, len(wanted), f"closed form of {name}")
            forms |= _closed_forms(derivation, name, entry)
    if html is not None:
        from rrrgen.emit.html.motions import illustrations

        figures = [figure for folder in runs for figure in illustrations(folder)]
        write_html(html, derive_once(spec), None, read_motions(motions, spec), figures)
    if as_json:
        from rrrgen.cli.description import as_data

        print_json(as_data(derive_once(spec), {name: _plain(form) for name, form in forms.items()}, inverse))
    elif as_latex:
        click.echo(_as_latex(parametrized(derivation), forms, inverse), nl=False)
    else:
        from rrrgen.cli.description import as_text

        text = "" if functions else with_headings(as_text(derive_once(spec), terminal_width()))
        say(_as_plain(text, forms, inverse))


def _show_programs(robot: str, functions: tuple[str, ...], recorded: bool, as_json: bool) -> None:
    """Print the programs of ``functions`` (default: all), optimized, or with ``recorded`` before any pass."""
    from rrrgen.derive import derive_model, derive_once

    spec = read_with_warnings(robot)
    programs: Mapping[str, Sequence[Program]]
    if recorded:
        programs = derive_model(spec).alternatives
    else:
        programs = {name: (program,) for name, program in derive_once(spec).programs.items()}
    if missing := [name for name in functions if name not in programs and name != INVERSE]:
        there = ", ".join((*programs, INVERSE))
        raise click.BadParameter(f"no program '{missing[0]}'; there are {there}", param_hint="--function")
    texts = {
        name: [_solver(spec)] if name == INVERSE else [program.dump() for program in programs[name]]
        for name in functions or programs
    }
    if as_json:
        print_json({"programs": texts})
    else:
        click.echo("\n".join(text for each in texts.values() for text in each), nl=False)


def _solver(spec: RobotSpec) -> str:
    """Text of the recorded solver of the inverse kinematics, from the target to the joints."""
    from rrrgen.base.errors import DerivationError
    from rrrgen.ik.classify import plan

    found = plan(spec)
    if found.solver is None:
        raise DerivationError(f"{spec.name}: {found.reason or found.title}; there is no closed form to show")
    return found.solver.dump()


def _inverse_kinematics(spec: RobotSpec, asked: bool, short: bool) -> InverseForm | str:
    """Derive the printed inverse kinematics: all steps, a summary for large robots, or the reason why there is none."""
    from rrrgen.base.errors import DerivationError
    from rrrgen.emit.latex.inverse_kinematics import closed_form, summary
    from rrrgen.ik.classify import plan

    if asked or short:
        try:
            return closed_form(spec)
        except DerivationError as error:
            if asked:
                raise
            return f"inverse kinematics: none; {error}"
    found = plan(spec)
    return summary(found) if found.solvable else f"inverse kinematics: none; {found.reason}"


def _as_latex(robot: ParametrizedRobot, forms: Mapping[str, Form], inverse: InverseForm | str | None) -> str:
    """The closed forms in LaTeX, preceded by the definitions of the base parameters if they contain any."""
    from rrrgen.derive.parameters.listing import listing
    from rrrgen.emit.latex import latex, latex_base_parameters
    from rrrgen.emit.latex.inverse_kinematics import ClosedForm as InverseForm

    used = {symbol.name for form in forms.values() for symbol in form.free_symbols}
    defined = any(p.name in used for p in robot.base_parameters)
    text = latex_base_parameters(listing(robot)) if defined else ""
    text += latex(forms) if forms else ""
    return text + (f"{inverse.latex()}\n" if isinstance(inverse, InverseForm) and inverse.steps else "")


def _as_plain(description: str, forms: Mapping[str, Form], inverse: InverseForm | str | None) -> str:
    """Print the requested ones of description, closed forms and inverse kinematics, separated by empty lines."""
    from rrrgen.emit.latex import plain

    said = inverse if inverse is None or isinstance(inverse, str) else inverse.text()
    text = description + (plain(forms) if forms else "")
    return "\n\n".join(part.rstrip("\n") for part in (text, said) if part)


def _closed_forms(derivation: Derivation, name: str, entry: str | None) -> dict[str, Form]:
    """Derive the closed forms of the function ``name``: of all its results by label, or of the single ``entry``."""
    from rrrgen.derive.closed_forms.closed_form import closed_form, closed_forms

    if entry is None:
        return {label: form.readable() for label, form in closed_forms(derivation, name).items()}
    form = closed_form(derivation, name)
    try:
        place = tuple(int(part) - 1 for part in entry.split(","))
        if min(place) < 0:
            raise IndexError(f"entries count from 1, got {entry}")
        return {f"{name}[{entry}]": form.readable(place)}
    except (ValueError, IndexError) as error:
        raise click.BadParameter(str(error), param_hint="--entry") from None


def _plain(form: Form) -> Any:
    """Convert a closed form to data for JSON: text, rows of text, or an object that also has the definitions used."""
    from sympy import MatrixBase

    from rrrgen.derive.closed_forms.shared_form import SharedForm

    if isinstance(form, SharedForm):
        definitions = {str(symbol): str(value) for symbol, value in form.definitions}
        return {"definitions": definitions, "entries": _plain(form.matrix)}
    return [[str(value) for value in row] for row in form.tolist()] if isinstance(form, MatrixBase) else str(form)
