"""The report as one self-contained, reproducible HTML file without scripts, fonts and external resources."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from typing import TYPE_CHECKING

from markupsafe import Markup

from rrrgen.backends.latex import Form, Walk, lay_out, trig_abbreviates
from rrrgen.derive.parameter_listing import listing
from rrrgen.report import tables
from rrrgen.report.geometry import zero_pose
from rrrgen.report.mathml import MathmlMarkup, definition_lines, display, equation_lines
from rrrgen.report.sketch import frame_sketch
from rrrgen.resources import template_text

if TYPE_CHECKING:
    from jinja2 import Environment

    from rrrgen.derive.derived_model import DerivedModel
    from rrrgen.verify.report import Report


def html_report(
    model: DerivedModel,
    closed_forms: Mapping[str, Form],
    verify_report: Report | None = None,
    notice: str = "",
) -> str:
    """The text of a self-contained HTML file about the robot of ``model``.

    It states the convention, prints the Denavit-Hartenberg table in both unit systems, draws the frames of the zero
    pose, lists the base parameters with what became of every link parameter, shows ``closed_forms`` (name of a model
    function -> exact expression or matrix) as MathML, counts operations, and tabulates ``verify_report``. ``notice``
    is one line about the origin (model hash, version). Raises :class:`rrrgen.errors.BackendError` when a closed form
    contains what has no notation.
    """
    spec, parameters = model.spec, listing(model)
    walk = Walk(MathmlMarkup(), trig_abbreviates(closed_forms))
    _, _, tip = zero_pose(spec)
    return (
        _environment()
        .get_template("report/report.html.j2")
        .render(
            spec=spec,
            notice=notice,
            sketch=Markup(frame_sketch(spec)),
            tip=Markup(tables.pose(tip)),
            gravity=[tables.number(float(spec.nominal(component))) for component in spec.gravity],
            parameters=[(name, tables.number(float(value))) for name, value in spec.parameters.items()],
            dh_exact=tables.dh_exact(spec, walk),
            dh_si=tables.dh_numbers(spec, in_degrees=False),
            dh_degrees=tables.dh_numbers(spec, in_degrees=True),
            limits=tables.limits(spec),
            drives=tables.drives(spec),
            convention=parameters.statement,
            base_parameters=tables.base_parameters(parameters, walk),
            regrouping=tables.regrouping(model),
            short_trig=walk.short_trig,
            closed_forms=_closed_forms(closed_forms, walk),
            operations=tables.operations(model),
            passes=tables.passes(model),
            verification=None if verify_report is None else tables.verification(verify_report),
            report=verify_report,
        )
    )


def _closed_forms(closed_forms: Mapping[str, Form], walk: Walk) -> list[dict[str, object]]:
    """Name, meaning, MathML and remarks of every quantity."""
    shown: list[dict[str, object]] = []
    for item in lay_out(closed_forms):
        lines = [line for symbol, value in item.definitions for line in definition_lines(symbol, value, walk)]
        for equation in item.equations:
            lines += equation_lines(item.quantity, equation, walk)
        shown.append(
            {
                "name": item.name,
                "meaning": item.quantity.meaning,
                "mathml": Markup(display(lines)),
                "remarks": item.remarks,
            }
        )
    return shown


@cache
def _environment() -> Environment:
    from jinja2 import Environment, FunctionLoader, StrictUndefined

    return Environment(
        loader=FunctionLoader(template_text),
        undefined=StrictUndefined,
        keep_trailing_newline=True,
        trim_blocks=True,
        lstrip_blocks=True,
        autoescape=True,
    )
