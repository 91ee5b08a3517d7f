"""The description of a robot that ``show`` prints, as text and as JSON data."""

from __future__ import annotations

import textwrap
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rrrgen.base.tables import text_table
from rrrgen.base.yamltext.units import QUANTITIES
from rrrgen.derive.parameters.listing import ParameterListing, listing
from rrrgen.emit.html.robot_facts import data, in_words, measured, not_stated, tables
from rrrgen.program import count_operations, evaluate
from rrrgen.robot.model.drive_text import coupling_equations, motor_facts
from rrrgen.robot.model.mechanism import mechanism_data, mechanism_equations

if TYPE_CHECKING:
    import sympy as sp

    from rrrgen.derive.derived_model import DerivedModel
    from rrrgen.emit.latex.inverse_kinematics import ClosedForm as InverseForm
    from rrrgen.robot.robot_spec import JointSpec, RobotSpec

_CONVENTION = {
    "standard": "standard DH, T = Rz(theta) Tz(d) Tx(a) Rx(alpha), joint i about z of frame i-1",
    "modified": "modified DH, T = Rx(alpha) Tx(a) Rz(theta) Tz(d), joint i about z of frame i",
}


def as_text(model: DerivedModel, width: int | None = None) -> str:
    """The text that ``rrrgen show`` prints before closed forms: conventions, tables, base parameters, operations.

    Lines are folded to ``width`` characters; None leaves them as long as they are.
    """
    lines = stated(model.spec, width)
    lines += ["", "Pose of the tip at q = 0, in the base frame; lengths in m"]
    lines += [f"  {'  '.join(f'{value:10.6f}' for value in row)}" for row in zero_pose(model)]
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


def stated(spec: RobotSpec, width: int | None = None) -> list[str]:
    """The lines of :func:`as_text` about what the robot file states, up to the links."""
    lines = [f"{spec.name}: {spec.description or 'serial robot'}", *_facts(spec, width), ""]
    lines += ["Denavit-Hartenberg table, exact and in both units at the nominal parameters"]
    rows = [("joint", "type", "alpha", "a", "d", "theta"), *(_row(spec, joint) for joint in spec.rows)]
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
        "zero_pose": [[float(value) for value in row] for row in zero_pose(model)],
        "link_parameters": parameters.statement,
        "base_parameters": [
            {"name": p.name, "unit": p.unit, "expression": str(p.expression), "nominal": p.nominal}
            for p in parameters.rows
        ],
        "regrouping": [{"parameter": r.parameter, "formula": r.formula, "reason": r.reason} for r in model.regrouping],
        "operations": {name: count_operations(program).as_dict() for name, program in model.programs.items()},
        "closed_forms": closed_forms,
        "inverse_kinematics": _inverse_kinematics(inverse),
    }


def _inverse_kinematics(found: InverseForm | str | None) -> dict[str, Any] | None:
    """Data about the inverse kinematics: family, singularities and steps, or the reason why there is no closed form."""
    if found is None or isinstance(found, str):
        return None if found is None else {"reason": found}
    return {
        "family": found.plan.family,
        "title": found.plan.title,
        "max_solutions": found.plan.max_solutions,
        "redundancy": found.plan.redundancy or None,
        "incomplete": found.plan.incomplete or None,
        "singular": [item.words if item.expression is None else str(item.expression) for item in found.singularities],
        "steps": [step.text() for step in found.steps],
    }


def zero_pose(model: DerivedModel) -> NDArray[np.float64]:
    """The pose (4, 4) of the tip at q = 0 in the base frame, with round-off below 1e-15 set to 0."""
    (T,) = evaluate(model.programs["forward_kinematics"], np.zeros(model.spec.n))
    return np.where(np.abs(T) < 1e-15, 0.0, T)


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
    return (
        joint.name,
        joint.type,
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
    return f"{value} ({', '.join(f'{number:.6g} {name}' for name, number in measured(nominal, unit).items())})"


def _angle(spec: RobotSpec, value: sp.Expr) -> str:
    return _in_both(spec, value, "rad")


def _length(spec: RobotSpec, value: sp.Expr) -> str:
    return _in_both(spec, value, "m")


def _number(value: sp.Expr) -> str:
    return f"{float(value):.10g}" if value.is_Rational else str(value)


def _joint(spec: RobotSpec, joint: JointSpec) -> dict[str, Any]:
    exact = {name: getattr(joint, name) for name in ("alpha", "a", "d", "theta")}
    return {
        "name": joint.name,
        "type": joint.type,
        **({} if joint.sign > 0 else {"sign": joint.sign}),
        **{name: _exact(spec, value, "m" if name in ("a", "d") else "rad") for name, value in exact.items()},
    }


def _exact(spec: RobotSpec, value: sp.Expr, unit: str) -> dict[str, Any]:
    """Data for JSON about an exact value: its expression, and its nominal value in SI and in the second unit."""
    nominal = float(spec.nominal(value))
    return {"exact": str(value), "nominal": nominal, **measured(nominal, unit)}


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
        found = [f"{', '.join(parameters)}: {formula}" for formula, parameters in formulas.items()]
        lines += [line for text in found for line in text_table([(text,)], width, indent=" " * 4)]
    return lines
