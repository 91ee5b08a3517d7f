"""Answers of the compiler to the page of the playground: text of a robot file in, data for JSON out.

The page runs in a browser, with the compiler in a worker. It asks in three steps, each of which takes longer: the table
with its faults while the user types, the picture of the arm, and what is derived from it.
"""

from __future__ import annotations

from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

from markupsafe import Markup

from rrrgen.base.errors import DerivationError, Fault, InputError
from rrrgen.base.yamltext.document import FaultList, MappingNode, Node, ScalarNode, SequenceNode, parse_document

if TYPE_CHECKING:
    from rrrgen.derive.derived_model import Derivation
    from rrrgen.ik.plan import SolverPlan
    from rrrgen.robot.spec import RobotSpec

FILE = "robot.yaml"
"""Name of the text in messages."""

LARGEST = 100_000
"""Characters of a robot file that the page takes: a link holds a stranger's file."""

COLUMNS = ("name", "type", "alpha", "a", "d", "theta")
"""Columns of the form, keys of a joint in the robot file."""

FORMS = ("forward_kinematics", "mass_matrix", "coriolis", "gravity")
LIVE = ("mass_matrix", "gravity")
"""Functions whose values are shown for the posture of the arm."""

SHORT = 3
"""Functions whose closed forms are shown, of arms of up to this many joints: longer arms fill pages."""


def check(text: str) -> dict[str, Any]:
    """The faults of a robot file, and its Denavit-Hartenberg table as typed.

    ``faults`` holds severity, line, column, message and hint; ``joints`` for every row of the table and every one of
    :data:`COLUMNS` the text of the cell with its place, ``line`` and ``column`` from 1, or None for a value that the
    file does not state. ``units`` are those of the file.
    """
    from rrrgen.robot.file.reader import read_spec

    if len(text) > LARGEST:
        return {"faults": [_fault(Fault(FILE, 0, 0, f"the text is longer than {LARGEST} characters"))], "joints": []}
    try:
        faults = list(read_spec(text, FILE).faults)
    except InputError as error:
        faults = list(error.faults)
    joints, units = _table(text)
    return {"faults": [_fault(fault) for fault in faults], "joints": joints, "units": units}


def _fault(fault: Fault) -> dict[str, Any]:
    return {name: getattr(fault, name) for name in ("severity", "line", "column", "message", "hint")}


def _table(text: str) -> tuple[list[dict[str, Any]], dict[str, str]]:
    try:
        root = parse_document(text, FaultList(FILE, text))
    except InputError:
        return [], {}
    units = {
        key: value.text for key, value in _entries(_entries(root).get("units")).items() if isinstance(value, ScalarNode)
    }
    joints = _entries(root).get("joints")
    rows = joints.items if isinstance(joints, SequenceNode) else []
    return [{name: _cell(_entries(row).get(name)) for name in COLUMNS} for row in rows], units


def _entries(node: Node | None) -> dict[str, Node]:
    if not isinstance(node, MappingNode):
        return {}
    return {key.text: value for key, value in node.entries if isinstance(key, ScalarNode)}


def _cell(node: Node | None) -> dict[str, Any] | None:
    if not isinstance(node, ScalarNode) or "\n" in node.text:
        return None
    place = node.place
    return {"text": node.text, "line": place.line, "column": place.column + node.inset}


def picture(text: str) -> dict[str, Any]:
    """What the view needs of a robot without faults: ``scene``, and ``solvers``, JavaScript of its tips by their names.

    Closed loops are not drawn: their ``scene`` is None.
    ``family`` says in words how its tips are solved, or why they are not. Raises InputError with the faults.
    """
    return _picture(_spec(text))


def _spec(text: str) -> RobotSpec:
    from rrrgen.robot.file.reader import read_spec

    if len(text) > LARGEST:
        raise InputError([Fault(FILE, 0, 0, f"the text is longer than {LARGEST} characters")])
    return read_spec(text, FILE)


def _picture(spec: RobotSpec) -> dict[str, Any]:
    from rrrgen.emit.html.scene import scene
    from rrrgen.emit.targets.javascript_ik import modules
    from rrrgen.ik.classify import plan, tip_plans
    from rrrgen.ik.result_layout import most_rows
    from rrrgen.robot.identity import identify

    def words(solver_plan: SolverPlan) -> str:
        return (
            f"{solver_plan.title}: at most {most_rows(solver_plan)} configurations"
            if solver_plan.solvable
            else solver_plan.reason
        )

    tips = [f"{tip}: {words(solver_plan)}" for tip, (_, solver_plan) in tip_plans(spec).items()]
    return {
        "name": spec.name,
        "description": spec.description or "",
        "scene": None if spec.loops else scene(spec),
        "solvers": modules(spec, identify(spec)),
        "family": "; ".join(tips) or words(plan(spec)),
    }


def results(text: str) -> dict[str, str]:
    """What is derived from a robot without faults.

    ``base_parameters``, ``closed_forms`` and ``inverse_kinematics`` are HTML, ``dynamics`` a JavaScript module with the
    functions :data:`LIVE` for the numbers of the file; empty if it states no links.
    """
    return _results(_spec(text))


def _results(spec: RobotSpec) -> dict[str, str]:
    from rrrgen.derive import parametrize_robot, prepare
    from rrrgen.derive.closed_forms import closed_form
    from rrrgen.derive.parameters.listing import listing
    from rrrgen.emit.html import document, mathml, tables
    from rrrgen.emit.latex.equations import trig_abbreviates
    from rrrgen.emit.latex.formulas import Walk

    derivation = prepare(spec)
    parameters = listing(parametrize_robot(derivation))
    forms = {}
    if spec.n <= SHORT and not spec.loops:
        for name in FORMS:
            forms[name] = closed_form(derivation, name).readable()
    walk = Walk(mathml.MathmlMarkup(), trig_abbreviates(forms))
    try:
        inverse: Any = mathml.inverse_kinematics(spec)
    except DerivationError as error:
        inverse = {"reason": str(error)}
    module = document.environment().get_template("playground/results.html.j2").module
    view = SimpleNamespace(
        spec=spec,
        statement=Markup(tables.typeset(parameters.statement)),
        table=tables.base_parameters(parameters, walk),
        forms=mathml.closed_forms(forms, walk),
        short_trig=walk.short_trig,
        inverse=inverse,
    )
    pages = ("base_parameters", "closed_forms", "inverse_kinematics")
    return {name: str(getattr(module, name)(view)) for name in pages} | {"dynamics": _dynamics(derivation)}


def _dynamics(derivation: Derivation) -> str:
    from rrrgen.derive import record
    from rrrgen.derive.functions.table import functions_for
    from rrrgen.derive.optimizer import Optimizer
    from rrrgen.emit.targets.javascript import module
    from rrrgen.robot.identity import identify

    spec = derivation.spec
    if spec.links is None:
        return ""
    live = [function for function in functions_for(spec, ("model",)) if function.name in LIVE]
    return module(Optimizer()(record(derivation, live)), identify(spec))


def precompute(text: str) -> dict[str, Any]:
    """All answers about a bundled robot, so that its page needs no compiler."""
    spec = _spec(text)
    return {"text": text, "check": check(text), "picture": _picture(spec), "results": _results(spec)}
