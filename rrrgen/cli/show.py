"""The command ``rrrgen show``: print a robot as rrrgen understands it."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rrrgen.base.tables import text_table
from rrrgen.base.yamltext.units import QUANTITIES
from rrrgen.cli.arguments import (
    SHORT,
    USUAL,
    complete_function,
    json_option,
    print_json,
    read_with_warnings,
    robot_argument,
)
from rrrgen.cli.html import html_option, read_motions, write_html
from rrrgen.cli.terminal import progress_bar, say, terminal_width, with_headings
from rrrgen.derive.parameters.listing import ParameterListing, listing
from rrrgen.derive.recursions.loop_positions import LoopClosure
from rrrgen.emit.html.robot_facts import data, in_units, in_words, not_stated, tables
from rrrgen.program import count_operations, evaluate_floats
from rrrgen.robot.model import build_model
from rrrgen.robot.model.drives import coupling_equations, motor_facts
from rrrgen.robot.model.mechanism import mechanism_data, mechanism_equations

if TYPE_CHECKING:
    import sympy as sp

    from rrrgen.derive.derived_model import Derivation, DerivedModel, ParametrizedRobot
    from rrrgen.emit.latex.equations import Form
    from rrrgen.emit.latex.inverse_kinematics import SolverForm as InverseForm
    from rrrgen.program import Program
    from rrrgen.robot.spec import JointSpec, RobotSpec


# ------------------------------------------------------------------------------------------------------------------
# The description of a robot that ``show`` prints, as text and as JSON data.
# ------------------------------------------------------------------------------------------------------------------

_CONVENTION = {
    "standard": "standard DH, T = Rz(theta) Tz(d) Tx(a) Rx(alpha), joint i about z of frame i-1",
    "modified": "modified DH, T = Rx(alpha) Tx(a) Rz(theta) Tz(d), joint i about z of frame i",
}


def as_text(model: DerivedModel, width: int | None = None) -> str:
    """The text that ``rrrgen show`` prints before closed forms: conventions, tables, base parameters, operations.

    Lines are folded to ``width`` characters; None leaves them as long as they are.
    """
    lines = robot_file_lines(model.spec, width)
    lines += ["", "Pose of the tip at q = 0, in the base frame; lengths in m"]
    pose = zero_pose(model)
    lines += [f"  {'  '.join(f'{value:10.6f}' for value in row)}" for row in pose]
    missing = "outside the limits" if model.spec.newton else "a closed loop cannot be assembled there"
    lines += [] if pose else [f"  none: {missing}"]
    parameters = listing(model)
    lines += ["", f"{model.b} base parameters, tau = Y(q, dq, ddq) beta"]
    lines += textwrap.wrap(parameters.statement, width or 118, initial_indent="  ", subsequent_indent="  ")
    lines += _parameters(parameters, width)
    lines += ["", "Where each link parameter went"]
    lines += _regrouping(model, width)
    lines += ["", "Operations of the emitted functions"]
    counts = [(name, str(count_operations(program))) for name, program in model.programs.items()]
    lines += text_table(counts, width)
    return "\n".join(lines) + "\n\n"


def robot_file_lines(spec: RobotSpec, width: int | None = None) -> list[str]:
    """The lines of :func:`as_text` about what the robot file states, up to the links."""
    lines = [f"{spec.name}: {spec.description or 'serial robot'}", *_facts(spec, width), ""]
    lines += ["Denavit-Hartenberg table, exact and in both units at the nominal parameters"]
    placed = ("gamma", "b") if spec.has_placements else ()
    rows = [("joint", "type", *placed, "alpha", "a", "d", "theta"), *(_row(spec, joint) for joint in spec.rows)]
    lines += text_table(rows, width)
    lines += _mechanism(spec, width)
    lines += _drives(spec, width)
    for title, rows in tables(spec):
        lines += ["", *text_table([(title,)], width, indent=""), *text_table(rows, width)]
    return lines


def as_data(model: DerivedModel, closed_forms: dict[str, Any], inverse: InverseForm | str | None) -> dict[str, Any]:
    """The description as data for JSON, closed forms and inverse kinematics included."""
    spec, parameters = model.spec, listing(model)
    return {
        "name": spec.name,
        "description": spec.description,
        "source": spec.source,
        "convention": spec.convention,
        "gravity": [str(component) for component in spec.gravity],
        "parameters": {name: str(value) for name, value in spec.parameters.items()},
        "joints": [_joint(spec, joint) for joint in spec.rows],
        **({} if spec.mechanism is None else {"mechanism": mechanism_data(spec)}),
        **data(spec),
        "units": {"angle": spec.angle_unit, "length": spec.length_unit},
        "zero_pose": zero_pose(model),
        "link_parameters": parameters.statement,
        "base_parameters": [
            {"name": p.name, "unit": p.unit, "expression": str(p.expression), "nominal": p.nominal}
            for p in parameters.rows
        ],
        "regrouping": [{"parameter": r.parameter, "formula": r.formula, "reason": r.reason} for r in model.regrouping],
        "operations": {name: count_operations(program).as_dict() for name, program in model.programs.items()},
        "closed_forms": closed_forms,
        "inverse_kinematics": _described_inverse_kinematics(inverse),
    }


def _described_inverse_kinematics(form: InverseForm | str | None) -> dict[str, Any] | None:
    """Data about the inverse kinematics: family, singularities and steps, or the reason why there is no closed form."""
    if form is None or isinstance(form, str):
        return None if form is None else {"reason": form}
    return {
        "family": form.plan.family,
        "title": form.plan.title,
        "max_solutions": form.plan.max_solutions,
        "redundancy": form.plan.redundancy or None,
        "incomplete": form.plan.incomplete or None,
        "singular": [item.words if item.expression is None else str(item.expression) for item in form.singularities],
        "steps": [step.text() for step in form.steps],
    }


def zero_pose(model: DerivedModel) -> list[list[float]]:
    """The pose (4, 4) of the tip at q = 0 in the base frame, with round-off below 1e-15 set to 0.

    Empty if a closed loop cannot be assembled there, or, solved by Newton's method, starts elsewhere.
    """
    at: tuple[list[float], ...] = ([0.0] * model.spec.n,)
    if model.spec.newton:
        loops = LoopClosure(build_model(model.spec))
        if any(loops.drives):  # followed from the start within the limits, outside of which zero is
            return []
        at = (*at, loops.start)
    elif model.spec.loops:
        *_, (status,) = evaluate_floats(model.programs["closed_loops"], *at)
        if status:
            return []
    (T,) = evaluate_floats(model.programs["forward_kinematics"], *at)
    return [[0.0 if abs(x) < 1e-15 else x for x in T[4 * i : 4 * i + 4]] for i in range(4)]


def _facts(spec: RobotSpec, width: int | None) -> list[str]:
    gravity = ", ".join(_number(value) for value in spec.gravity)
    facts = [
        ("convention", _CONVENTION[spec.convention]),
        ("units", f"file: {spec.angle_unit}, {spec.length_unit}; here and in emitted code: SI and rad"),
        ("gravity", f"acceleration [{gravity}] m/s^2 in the base frame"),
    ]
    if spec.parameters:
        facts.append(("parameters", ", ".join(_parameter(spec, name) for name in spec.parameters)))
    if missing := not_stated(spec):
        facts.append(("not stated", missing))
    if spec.links is None:
        facts.append(("dynamics", "without links they take the base parameters at run time"))
    if spec.source:
        facts.append(("source", spec.source))
    return text_table(facts, width)


def _parameter(spec: RobotSpec, name: str) -> str:
    """A named parameter with its value, in both units if it was declared with a unit of angle or length."""
    value, unit = spec.parameters[name], spec.parameter_units.get(name, "")
    measures = {quantity.units: quantity.si_unit for quantity in (QUANTITIES["angle"], QUANTITIES["length"])}
    si = next((unit_si for units, unit_si in measures.items() if unit in units), None)
    return f"{name} = {_number(value) if si is None else in_words(float(value), si)}"


def _row(spec: RobotSpec, joint: JointSpec) -> tuple[str, ...]:
    q = joint.name if joint.sign > 0 else f"-{joint.name}"
    theta = f"{q} + {_angle(spec, joint.theta)}" if joint.is_revolute and joint.theta != 0 else None
    d = f"{q} + {_length(spec, joint.d)}" if not joint.is_revolute and joint.d != 0 else None
    placed = (_angle(spec, joint.gamma), _length(spec, joint.b)) if spec.has_placements else ()
    return (
        joint.name,
        joint.type,
        *placed,
        _angle(spec, joint.alpha),
        _length(spec, joint.a),
        d or (_length(spec, joint.d) if joint.is_revolute else q),
        theta or (q if joint.is_revolute else _angle(spec, joint.theta)),
    )


def _mechanism(spec: RobotSpec, width: int | None) -> list[str]:
    """The lines about the branches of a mechanism and its joints that follow others; none for a serial chain."""
    if spec.mechanism is None:
        return []
    title = (
        f"Mechanism: what carries each row, and how it follows q; the tool is fixed to {spec.rows[spec.tip_row].name}"
    )
    lines = ["", *text_table([(title,)], width, indent="")]
    return lines + text_table([(clause,) for clause in mechanism_equations(spec)], width)


def _drives(spec: RobotSpec, width: int | None) -> list[str]:
    """The lines about coupled drives: their equations and motors; none without coupling."""
    if spec.drives is None:
        return []
    lines = ["", "Coupled drives: speeds of the joints from those of the drives; values of the motors at their shafts"]
    lines += [f"  {equation}" for equation in coupling_equations(spec)]
    return lines + text_table([(motor.name, motor_facts(motor)) for motor in spec.drives.motors], width)


def _in_both(spec: RobotSpec, value: sp.Expr, unit: str) -> str:
    """Print a value in both units: ``0.35 m (350 mm)``; an expression first: ``pi/2 (1.5708 rad, 90 deg)``."""
    if value == 0:
        return "0"
    nominal = float(spec.nominal(value))
    if value.is_Rational:
        return in_words(nominal, unit)
    return f"{value} ({', '.join(f'{number:.6g} {name}' for name, number in in_units(nominal, unit).items())})"


def _angle(spec: RobotSpec, value: sp.Expr) -> str:
    return _in_both(spec, value, "rad")


def _length(spec: RobotSpec, value: sp.Expr) -> str:
    return _in_both(spec, value, "m")


def _number(value: sp.Expr) -> str:
    return f"{float(value):.10g}" if value.is_Rational else str(value)


def _joint(spec: RobotSpec, joint: JointSpec) -> dict[str, Any]:
    placed = ("gamma", "b") if spec.has_placements else ()
    exact = {name: getattr(joint, name) for name in (*placed, "alpha", "a", "d", "theta")}
    return {
        "name": joint.name,
        "type": joint.type,
        **({} if joint.sign > 0 else {"sign": joint.sign}),
        **{name: _exact(spec, value, "m" if name in ("a", "d", "b") else "rad") for name, value in exact.items()},
    }


def _exact(spec: RobotSpec, value: sp.Expr, unit: str) -> dict[str, Any]:
    """Data for JSON about an exact value: its expression, and its nominal value in SI and in the second unit."""
    nominal = float(spec.nominal(value))
    return {"exact": str(value), "nominal": nominal, **in_units(nominal, unit)}


def _parameters(parameters: ParameterListing, width: int | None) -> list[str]:
    values = ["" if p.nominal is None else f"{p.nominal:.10g}" for p in parameters.rows]
    rows = zip(parameters.rows, values, strict=True)
    return text_table([(p.name, p.unit, value, str(p.expression)) for p, value in rows], width)


def _regrouping(model: DerivedModel, width: int | None) -> list[str]:
    """The lines about regrouping: reasons, and under each the standard parameters with their formula."""
    reasons: dict[str, dict[str, list[str]]] = {}
    for entry in model.regrouping:
        reasons.setdefault(entry.reason, {}).setdefault(entry.formula, []).append(entry.parameter)
    lines = []
    for reason, formulas in reasons.items():
        lines += text_table([(reason,)], width)
        texts = [f"{', '.join(parameters)}: {formula}" for formula, parameters in formulas.items()]
        lines += [line for text in texts for line in text_table([(text,)], width, indent=" " * 4)]
    return lines


# ------------------------------------------------------------------------------------------------------------------
# The command ``rrrgen show``
# ------------------------------------------------------------------------------------------------------------------

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
    help="With --html: trajectory of `rrrgen experiment excite`, or recording, to be played; repeat for several.",
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
    from rrrgen.derive import derive_once, parametrize_robot, prepare

    if as_latex and as_json:
        raise click.UsageError("give one of --latex and --json")
    if entry is not None and len(functions) != 1:
        raise click.UsageError("--entry needs exactly one --function")
    if entry is not None and functions == (INVERSE,):
        raise click.UsageError(f"--entry: {INVERSE} has no closed form with entries")
    if recorded and INVERSE in functions:
        raise click.UsageError(f"--recorded: {INVERSE} has one program, which is not optimized")
    if as_latex and closed_forms is False and not functions:
        raise click.UsageError("--latex prints closed forms, which --no-closed-forms leaves out")
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
    short = closed_forms or (closed_forms is None and spec.n <= SHORT and not spec.loops)
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
        from rrrgen.emit.html.scene import illustrations

        figures = [figure for folder in runs for figure in illustrations(folder)]
        write_html(html, derive_once(spec), None, read_motions(motions, spec), figures)
    if as_json:
        print_json(as_data(derive_once(spec), {name: _plain(form) for name, form in forms.items()}, inverse))
    elif as_latex:
        click.echo(_as_latex(parametrize_robot(derivation), forms, inverse), nl=False)
    else:
        text = "" if functions else with_headings(as_text(derive_once(spec), terminal_width()))
        text += "" if functions else _solvers_of_tips(spec)
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
        click.echo("\n".join(text for dumps in texts.values() for text in dumps), nl=False)


def _solver(spec: RobotSpec) -> str:
    """Text of the recorded solver of the inverse kinematics, from the target to the joints."""
    from rrrgen.base.errors import DerivationError
    from rrrgen.ik.classify import plan

    solver_plan = plan(spec)
    if solver_plan.solver is None:
        raise DerivationError(
            f"{spec.name}: {solver_plan.reason or solver_plan.title}; there is no closed form to show"
        )
    return solver_plan.solver.dump()


def _solvers_of_tips(spec: RobotSpec) -> str:
    """The solver of every named tip in a line, or the reason why there is none; empty without named tips."""
    from rrrgen.emit.html.robot_facts import solvers_of_tips

    lines = [f"  {tip}: {words}\n" for tip, words in solvers_of_tips(spec)]
    return "".join(["\nInverse kinematics of named tips\n", *lines]) if lines else ""


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
    solver_plan = plan(spec)
    return summary(solver_plan) if solver_plan.solvable else f"inverse kinematics: none; {solver_plan.reason}"


def _as_latex(robot: ParametrizedRobot, forms: Mapping[str, Form], inverse: InverseForm | str | None) -> str:
    """The closed forms in LaTeX, preceded by the definitions of the base parameters if they contain any."""
    from rrrgen.derive.parameters.listing import listing
    from rrrgen.emit.latex.equations import latex, latex_base_parameters
    from rrrgen.emit.latex.inverse_kinematics import SolverForm as InverseForm

    used = {symbol.name for form in forms.values() for symbol in form.free_symbols}
    defined = any(p.name in used for p in robot.base_parameters)
    text = latex_base_parameters(listing(robot)) if defined else ""
    text += latex(forms) if forms else ""
    return text + (f"{inverse.latex()}\n" if isinstance(inverse, InverseForm) and inverse.steps else "")


def _as_plain(description: str, forms: Mapping[str, Form], inverse: InverseForm | str | None) -> str:
    """Print the requested ones of description, closed forms and inverse kinematics, separated by empty lines."""
    from rrrgen.emit.latex.equations import plain

    said = inverse if inverse is None or isinstance(inverse, str) else inverse.text()
    text = description + (plain(forms) if forms else "")
    return "\n\n".join(part.rstrip("\n") for part in (text, said) if part)


def _closed_forms(derivation: Derivation, name: str, entry: str | None) -> dict[str, Form]:
    """Derive the closed forms of the function ``name``: of all its results by label, or of the single ``entry``."""
    from rrrgen.derive.closed_forms import closed_form, closed_forms

    if entry is None:
        return {label: form.readable() for label, form in closed_forms(derivation, name).items()}
    form = closed_form(derivation, name)
    words = [word.strip() for word in entry.split(",")]
    inside = [word.isdecimal() and 1 <= int(word) <= size for word, size in zip(words, form.shape, strict=False)]
    if len(words) != len(form.shape) or not all(inside):
        size = " x ".join(map(str, form.shape))
        raise click.BadParameter(
            f"'{entry}' is none of the {size} entries of {name}, counted from 1", param_hint="--entry"
        )
    return {f"{name}[{entry}]": form.readable(tuple(int(word) - 1 for word in words))}


def _plain(form: Form) -> Any:
    """Convert a closed form to data for JSON: text, rows of text, or an object that also has the definitions used."""
    from sympy import MatrixBase

    from rrrgen.derive.closed_forms import SharedForm

    if isinstance(form, SharedForm):
        definitions = {str(symbol): str(value) for symbol, value in form.definitions}
        return {"definitions": definitions, "entries": _plain(form.matrix)}
    return [[str(value) for value in row] for row in form.tolist()] if isinstance(form, MatrixBase) else str(form)
