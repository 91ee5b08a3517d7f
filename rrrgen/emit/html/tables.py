"""The tables of the report, with cells as text or MathML."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from math import degrees, isfinite
from typing import TYPE_CHECKING

import sympy as sp
from markupsafe import Markup, escape

from rrrgen.emit.html import robot_facts as facts
from rrrgen.emit.html.mathml import folding, inline
from rrrgen.emit.html.sketch import variables
from rrrgen.emit.latex.formulas import Walk
from rrrgen.program import OperationCount, count_operations
from rrrgen.robot.model.drives import coupling_equations, motor_facts
from rrrgen.robot.spec import RobotSpec

if TYPE_CHECKING:
    from rrrgen.derive.derived_model import DerivedModel
    from rrrgen.derive.parameters.listing import ParameterListing


DECIMALS = 12  # of the entries of the zero pose; rounding errors of cosines, such as 6e-17, become zero


@dataclass(frozen=True)
class HtmlTable:
    """Headings and rows; ``numeric`` columns are aligned to the right, ``failed`` rows are marked."""

    headings: tuple[str, ...]
    rows: tuple[tuple[str | Markup, ...], ...]
    numeric: frozenset[int] = frozenset()
    failed: frozenset[int] = frozenset()  # rows to be marked


@dataclass(frozen=True)
class Verification:
    """What the page says of a verification over ``samples`` random states drawn with ``seed``.

    ``table`` has a row per comparison; ``ok`` is whether all passed; ``skipped`` holds pairs (what was not compared,
    reason).
    """

    table: HtmlTable
    ok: bool
    samples: int
    seed: int
    skipped: tuple[tuple[str, str], ...] = ()


def number(value: float, digits: int = 6) -> str:
    """Print a number for a table, with ``digits`` significant digits and without a negative zero."""
    if not isfinite(value):
        return str(value)
    return f"{value + 0.0:.{digits}g}".replace("-", "−")


def unit(text: str) -> str:
    """Print a unit with raised exponents, without line breaks: ``kg m^2`` becomes kg m²."""
    return text.replace("^2", "²").replace("^3", "³").replace(" ", "\u00a0")


def dh_exact(spec: RobotSpec, walk: Walk) -> HtmlTable:
    """The table of Denavit-Hartenberg parameters as in the robot file, with named parameters."""
    rows = []
    q = sp.Matrix([sp.Symbol(f"q{k}", real=True) for k in range(1, spec.n + 1)])
    S = sp.diag(*(joint.sign for joint in spec.joints)) if spec.mechanism is None else sp.Matrix(spec.mechanism.matrix)
    moved = S * q
    for i, (joint, y) in enumerate(zip(spec.rows, moved, strict=True), start=1):
        theta, d = (joint.theta + y, joint.d) if joint.is_revolute else (joint.theta, joint.d + y)
        placed = (joint.gamma, joint.b) if spec.has_placements else ()
        cells = (Markup(inline(value, walk)) for value in (*placed, joint.alpha, joint.a, d, theta))
        rows.append((str(i), joint.name, joint.type, *_carrier(spec, i - 1), *cells))
    carried = () if spec.mechanism is None else ("on",)
    placed = ("γ", "b") if spec.has_placements else ()
    return HtmlTable(("i", "joint", "type", *carried, *placed, "α", "a", "d", "θ"), tuple(rows), frozenset({0}))


def _carrier(spec: RobotSpec, i: int) -> tuple[str, ...]:
    """Name of the row whose link carries row ``i`` of a mechanism, as a tuple of one cell; empty for a serial chain."""
    if spec.mechanism is None:
        return ()
    return (spec.rows[spec.parents[i]].name if spec.parents[i] >= 0 else "base",)


def dh_numbers(spec: RobotSpec, in_degrees: bool) -> HtmlTable:
    """The Denavit-Hartenberg table at nominal parameters, in rad and m or in degrees and mm."""
    angle, length = (degrees, 1000.0) if in_degrees else (float, 1.0)
    rows = []
    moved = zip(spec.rows, spec.dh_table(), variables(spec), strict=True)
    for i, (joint, (_, alpha, a, d, theta), y) in enumerate(moved, start=1):
        d_text, theta_text = number(d * length), number(angle(theta))
        if joint.is_revolute:
            theta_text = _with_variable(y, theta_text)
        else:
            d_text = _with_variable(y, d_text)
        gamma, b = spec.placements()[i - 1]
        placed = (number(angle(gamma)), number(b * length)) if spec.has_placements else ()
        rows.append((str(i), *placed, number(angle(alpha)), number(a * length), d_text, theta_text))
    units = ("°", "mm") if in_degrees else ("rad", "m")
    placed = (f"γ [{units[0]}]", f"b [{units[1]}]") if spec.has_placements else ()
    headings = ("i", *placed, f"α [{units[0]}]", f"a [{units[1]}]", f"d [{units[1]}]", f"θ [{units[0]}]")
    return HtmlTable(headings, tuple(rows), frozenset(range(len(headings))))


def _with_variable(q: str, offset: str) -> str:
    if offset == "0":
        return q
    return f"{q} − {offset[1:]}" if offset.startswith("−") else f"{q} + {offset}"


def robot_file_tables(spec: RobotSpec) -> list[tuple[str, HtmlTable]]:
    """Tables by title of what the robot file states beside the Denavit-Hartenberg table.

    Values are in SI units and in other usual ones, such as degrees and mm.
    """
    tables = []
    for title, (first, *others) in facts.tables(spec):
        headed = first[0] in ("joint", "link")
        rows = others if headed else [first, *others]
        cells = tuple(
            (name, *("" if cell == "-" else unit(cell).replace("-", "−") for cell in row)) for name, *row in rows
        )
        headings = first if headed else ("",) * len(first)
        tables.append((title.replace("^2", "²"), HtmlTable(headings, cells)))
    return tables


def typeset(text: str) -> Markup:
    """Set a sentence about link parameters with subscripts: ``Ixy`` becomes I with the subscript xy."""
    text = str(escape(text)).replace("-integral of x*y dm", "−∫ <i>x y</i> d<i>m</i>")
    text = text.replace("integral of r r&#39; dm", "∫ <i>r rᵀ</i> d<i>m</i>").replace("mi*(", "mi (")
    text = re.sub(r"\b([IJ])([xyz]{2})(i?)\b", lambda m: f"<i>{m[1]}<sub>{m[2]}{',i' * bool(m[3])}</sub></i>", text)
    return Markup(re.sub(r"\b(m[xyz]?|[xyz])i\b", r"<i>\1<sub>i</sub></i>", text))


def drives(spec: RobotSpec) -> tuple[HtmlTable, HtmlTable] | None:
    """The tables of coupled drives, or None: joint speeds as sums of drive speeds, and the motors of the robot file."""
    if spec.drives is None:
        return None
    equations = tuple((equation.replace("-", "−"),) for equation in coupling_equations(spec))
    shafts = {motor.name: motor_facts(motor).replace("^2", "²").replace("-", "−") for motor in spec.drives.motors}
    speeds = HtmlTable(("speed of the joint from those of the drives",), equations)
    return speeds, HtmlTable(("motor", "at its shaft"), tuple(shafts.items()))


def base_parameters(parameters: ParameterListing, walk: Walk) -> HtmlTable:
    """The table of base parameters: name, expression, unit and, with link data, nominal value."""
    rows = []
    for k, parameter in enumerate(parameters.rows):
        symbol = Markup(inline(sp.Symbol(parameter.name, real=True), walk))
        value = () if parameter.nominal is None else (number(parameter.nominal),)
        rows.append((str(k + 1), symbol, *value, unit(parameter.unit), Markup(folding(parameter.expression, walk))))
    nominal = ("nominal value",) if rows and len(rows[0]) == 5 else ()
    right = frozenset({0, 2}) if nominal else frozenset({0})
    return HtmlTable(("", "parameter", *nominal, "unit", "expression"), tuple(rows), right)


def regrouping(model: DerivedModel) -> HtmlTable:
    """The table of regrouping: how each standard parameter enters the base parameters, and why."""
    rows = tuple((item.parameter, _formula(item.formula), item.reason) for item in model.regrouping)
    return HtmlTable(("standard parameter", "regrouped into", "reason"), rows)


def _formula(text: str) -> str:
    """Print a formula of plain text with raised exponents and signs of mathematics."""
    return text.replace("**2", "²").replace("**3", "³").replace("*", "·").replace("-", "−")


_COUNTS = ("total", "multiplications", "additions", "divisions", "roots", "sine and cosine pairs", "other")


def operations(model: DerivedModel) -> HtmlTable:
    """The table of operation counts per evaluation of every function."""
    rows = tuple((name, *_counts(count_operations(program))) for name, program in model.programs.items())
    return HtmlTable(("function", *_COUNTS), rows, frozenset(range(1, len(_COUNTS) + 1)))


def _counts(count: OperationCount) -> tuple[str, ...]:
    values = (count.total, count.mul, count.add, count.div, count.sqrt, count.sincos, count.other)
    return tuple(str(value) for value in values)


def passes(model: DerivedModel) -> HtmlTable:
    """The table of optimization passes: operations before and after."""
    rows = tuple((p.function, p.name, str(p.before.total), str(p.after.total)) for p in model.passes)
    return HtmlTable(("function", "pass", "operations before", "after"), rows, frozenset({2, 3}))


def pose(rows: Sequence[Sequence[float]]) -> str:
    """Print a homogeneous transform as a MathML matrix of numbers."""
    cells = "".join(
        "<mtr>" + "".join(f"<mtd><mn>{number(round(v, DECIMALS), 5)}</mn></mtd>" for v in row) + "</mtr>"
        for row in rows
    )
    return f'<math><mtable class="matrix">{cells}</mtable></math>'
