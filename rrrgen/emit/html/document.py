"""The report page: one self-contained, reproducible HTML file with its script and styles inside; nothing is fetched."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache
from typing import TYPE_CHECKING

from markupsafe import Markup

from rrrgen.base.templates import template_text
from rrrgen.derive.parameters.listing import listing
from rrrgen.emit.html import mathml, tables
from rrrgen.emit.html import robot_facts as facts
from rrrgen.emit.html.scene import as_json, scene
from rrrgen.emit.html.sketch import frame_sketch, zero_pose
from rrrgen.emit.latex.equations import Form, trig_abbreviates
from rrrgen.emit.latex.formulas import Walk
from rrrgen.emit.targets.javascript_ik import modules
from rrrgen.robot.identity import identify

if TYPE_CHECKING:
    from jinja2 import Environment

    from rrrgen.derive.derived_model import DerivedModel
    from rrrgen.emit.html.scene import Illustration, PlayedMotion


def html_report(
    model: DerivedModel,
    closed_forms: Mapping[str, Form],
    verification: tables.Verification | None = None,
    notice: str = "",
    motions: Sequence[PlayedMotion] = (),
    figures: Sequence[Illustration] = (),
) -> str:
    """Write a self-contained HTML page about the robot of ``model`` and return its text.

    It shows the arm in an interactive view, whose tip is dragged, states the convention, prints the
    Denavit-Hartenberg table in rad and m and in degrees and mm, draws the frames of the zero pose, lists the base
    parameters and how each link parameter enters them, shows ``closed_forms`` (name of a model function -> exact
    expression, matrix or shared form) as MathML and the inverse kinematics, counts operations, and tabulates
    ``verification``. The view plays ``motions``; ``figures`` are placed at the end. ``notice`` is one line about the
    origin (model hash, version).
    Raises :class:`rrrgen.base.errors.BackendError` when a closed form contains what has no notation, and
    :class:`rrrgen.base.errors.InputError` for a motion that is not one of this robot.
    """
    spec, parameters = model.spec, listing(model)
    walk = Walk(mathml.MathmlMarkup(), trig_abbreviates(closed_forms))
    _, _, tip = zero_pose(spec)
    view = scene(spec) | {"motions": [motion.as_data(spec.n) for motion in motions]}
    solvers = [(tip, Markup(script_text(text))) for tip, text in modules(spec, identify(spec)).items()]
    return (
        environment()
        .get_template("report/report.html.j2")
        .render(
            spec=spec,
            typeset=tables.typeset,
            notice=notice,
            sketch=Markup(frame_sketch(spec)),
            tip=Markup(tables.pose(tip)),
            gravity=[tables.number(float(spec.nominal(component))) for component in spec.gravity],
            parameters=[(name, tables.number(float(value))) for name, value in spec.parameters.items()],
            dh_exact=tables.dh_exact(spec, walk),
            dh_si=tables.dh_numbers(spec, in_degrees=False),
            dh_degrees=tables.dh_numbers(spec, in_degrees=True),
            stated=tables.robot_file_tables(spec),
            not_stated=facts.not_stated(spec),
            drives=tables.drives(spec),
            convention=tables.typeset(parameters.statement),
            base_parameters=tables.base_parameters(parameters, walk),
            regrouping=tables.regrouping(model),
            short_trig=walk.short_trig,
            closed_forms=mathml.closed_forms(closed_forms, walk),
            operations=tables.operations(model),
            passes=tables.passes(model),
            verification=verification,
            inverse=mathml.inverse_kinematics(spec),
            tips=facts.solvers_of_tips(spec),
            figures=figures,
            scene=Markup(as_json(view)),
            solvers=solvers,
        )
    )


def script_text(script: str) -> str:
    """Escape JavaScript for a ``<script>`` element, which its strings and comments cannot end then."""
    return script.replace("</", r"<\/").replace("<!--", r"<\!--").replace("<script", r"<\script")


@cache
def environment() -> Environment:
    """The Jinja environment of pages: text from a robot file is escaped."""
    from jinja2 import Environment, FunctionLoader, StrictUndefined

    return Environment(
        loader=FunctionLoader(template_text),
        undefined=StrictUndefined,
        keep_trailing_newline=True,
        trim_blocks=True,
        lstrip_blocks=True,
        autoescape=True,
    )
