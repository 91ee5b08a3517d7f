"""The sections of the report that hold equations: closed forms of the model functions, and the inverse kinematics."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from markupsafe import Markup

from rrrgen.base.errors import BackendError, DerivationError
from rrrgen.emit.html.mathml import Line, MathmlMarkup, definition, display, equation, inline, step
from rrrgen.emit.latex.equations import Form, lay_out
from rrrgen.emit.latex.formulas import Walk

if TYPE_CHECKING:
    from rrrgen.emit.latex.inverse_kinematics import SolverForm
    from rrrgen.robot.spec import RobotSpec


def closed_forms(forms: Mapping[str, Form], walk: Walk) -> list[dict[str, object]]:
    """The template variables of every quantity of the closed forms: name, meaning, equations and remarks."""
    shown: list[dict[str, object]] = []
    for item in lay_out(forms):
        lines = [definition(symbol, value, walk) for symbol, value in item.definitions]
        lines += [equation(item.quantity, each, walk) for each in item.equations]
        shown.append(
            {
                "name": item.name,
                "meaning": item.quantity.meaning,
                "equations": Markup(display(lines)),
                "remarks": item.remarks,
            }
        )
    return shown


def inverse_kinematics(spec: RobotSpec) -> dict[str, object]:
    """The template variables of the inverse kinematics, or ``reason`` why there is none.

    ``title`` names the method; ``remarks`` are clauses, ``lengths`` and ``singular`` pairs, ``equations`` the closed
    form, empty where it is long.
    """
    from rrrgen.emit.latex.inverse_kinematics import closed_form, summary
    from rrrgen.ik.classify import plan

    found = plan(spec)
    if not found.solvable:
        return {"reason": found.reason}
    try:
        form = closed_form(spec)
        lines = _steps(form)
    except (BackendError, DerivationError):  # an equation that has no notation in mathematics
        form, lines = summary(found), []
    walk = Walk(MathmlMarkup(), short_trig=False)
    singular = [
        (Markup(inline(each.expression, walk)) if each.expression is not None else "", each.words)
        for each in form.singularities
    ]
    return {
        "reason": "",
        "title": form.plan.title,
        "remarks": form.remarks(),
        "singular": singular,
        "lengths": [(Markup(inline(symbol, walk)), Markup(inline(value, walk))) for symbol, value in form.values],
        "equations": Markup(display(lines)) if lines else "",
    }


def _steps(form: SolverForm) -> list[Line]:
    walk = Walk(MathmlMarkup(), short_trig=False)
    return [step(each.symbol, each.expression, each.either, each.note, walk) for each in form.steps]
