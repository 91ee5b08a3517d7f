"""What is printed about base parameters is true in the convention that is printed beside it.

Every page is read back as its reader would: the expressions are parsed from the text, evaluated with the link
parameters of the robot in the convention that the same text states, and compared with the nominal values.
"""

from __future__ import annotations

import ast
import json
import re
from dataclasses import replace
from functools import cache
from html.parser import HTMLParser
from typing import Any

import numpy as np
import pytest

from emit.formula_reading import compute, read_latex, read_mathml
from rrrgen.cli.show import as_data, as_text
from rrrgen.derive import derive
from rrrgen.derive.parameters.listing import listing
from rrrgen.emit.html import html_report
from rrrgen.emit.latex.equations import latex_base_parameters
from rrrgen.emit.package import emit
from rrrgen.robot.file import load_spec, loads_spec

ROUND_OFF = 1e-14
"""Relative to the sum of the magnitudes in play, which no expression of ours multiplies by more than about ten."""
TWELVE_DIGITS = 1e-11
"""HTML and LaTeX write long decimals to twelve digits."""

OFF_DIAGONAL = """
  - mass: {m}
    com: [{x}, 0.03, -0.07]
    inertia:
      {{about: {about}, products: {products}, xx: 0.31, yy: 0.42, zz: 0.53, xy: {s}0.041, xz: {s}0.032, yz: {s}0.023}}
"""

TWO_LINKS = """schema: rrrgen/1
name: twolinks
convention: modified
units: {{angle: deg, length: m}}
gravity: [0, 0, -9.81]
parameters: {{a1: 0.4}}
joints:
  - {{type: revolute, alpha: 0, a: 0, d: 0.3, theta: 0}}
  - {{type: revolute, alpha: 90, a: a1, d: 0.1, theta: 20}}
links:{links}
{basis}"""


def two_links(about: str, products: str, basis: bool = False) -> Any:
    """An arm whose products of inertia all differ from zero, with the compiler's own names or the user's."""
    sign = "-" if products == "tensor" else ""  # one body, however it is written
    links = "".join(
        OFF_DIAGONAL.format(m=m, x=x, about=about, products=products, s=sign) for m, x in ((3, 0.11), (2, 0.2))
    )
    spec = loads_spec(TWO_LINKS.format(links=links, basis=""))
    if not basis:
        return spec
    from rrrgen.derive import derive_model

    flip = (lambda text: re.sub(r"\b(I(?:xy|xz|yz)\d)", r"(-\1)", text)) if products == "positive" else str
    lines = [f"  - b{k} = {flip(str(p.expression))}" for k, p in enumerate(derive_model(spec).base_parameters, start=1)]
    return loads_spec(TWO_LINKS.format(links=links, basis="\n".join(["basis:", *lines])))


def without_basis() -> Any:
    return replace(load_spec("rrr"), basis=None)


ROBOTS = {
    "rrr: positive about the origin, basis of the file": lambda: load_spec("rrr"),
    "rrr: positive about the origin, own basis": without_basis,
    "planar2r: tensor about the centre of mass": lambda: load_spec("planar2r"),
    "scara: sliding joint": lambda: load_spec("scara"),
    "positive about the centre of mass": lambda: two_links("com", "positive"),
    "positive about the centre of mass, basis": lambda: two_links("com", "positive", basis=True),
    "tensor about the origin": lambda: two_links("origin", "tensor"),
    "tensor about the origin, basis": lambda: two_links("origin", "tensor", basis=True),
}


@cache
def derived(robot: str) -> Any:
    return derive(ROBOTS[robot]())


@cache
def emitted(robot: str) -> dict[str, str]:
    return emit(derived(robot))


@cache
def html(robot: str) -> str:
    return html_report(derived(robot), {})


def one_line(text: str) -> str:
    """Comments and indentation taken off, in one line."""
    return " ".join(re.sub(r"^\s*(?:\*|#|%)?\s*", "", line) for line in text.splitlines())


def stated_sign(text: str) -> int:
    """The sign of products of inertia that a text states: exactly one, wherever it speaks of it."""
    stated = set(re.findall(r"[=,] *([+-]|−|)\s*(?:integral of|int|∫) *x\W*y", one_line(text)))
    assert len(stated) == 1, f"the text states {stated or 'no sign at all'}"
    return -1 if stated.pop() in ("-", "−") else 1


def link_values(spec: Any, sign: int) -> dict[str, float]:
    """The symbols of links and geometry as numbers, with products of inertia ``sign * integral of x*y dm``."""
    values = {name: float(value) for name, value in spec.parameters.items()}
    for i, link in enumerate(spec.links, start=1):
        m, com = float(link.mass), np.array([float(v) for v in link.com])
        xx, yy, zz, xy, xz, yz = (float(v) for v in link.inertia)
        I = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])  # noqa: E741
        if link.about == "com":
            I = I + m * (com @ com * np.eye(3) - np.outer(com, com))  # noqa: E741
        values[f"m{i}"] = m
        for r, axis in enumerate("xyz"):
            values[f"{axis}{i}"], values[f"m{axis}{i}"] = com[r], m * com[r]
            for c, other in enumerate("xyz"):
                values[f"I{axis}{other}{i}"] = I[r, c] if r == c else -sign * I[r, c]
    return values


def check(robot: str, expressions: list[str], statement: str, tolerance: float = ROUND_OFF) -> None:
    """Every expression, evaluated in the convention of ``statement``, is the nominal base parameter."""
    model = derived(robot)
    values = link_values(model.spec, stated_sign(statement))
    assert len(expressions) == len(model.beta_nominal) > 0
    size = max(1.0, *(abs(v) for v in values.values()))
    for text, nominal in zip(expressions, model.beta_nominal, strict=True):
        assert abs(compute(text, values) - float(nominal)) <= tolerance * size, text


@pytest.mark.parametrize("robot", ROBOTS)
def test_the_header(robot):
    text = emitted(robot)[f"{derived(robot).spec.name}.h"]
    opening = text[: text.index("*/")]
    rows = re.findall(
        r"^ \*   beta\[\d+\] +\S+ +(?:kg m\^2|kg m|kg|-) +(.*(?:\n \* {10,}\S.*)*)", opening, re.MULTILINE
    )
    check(
        robot, [one_line(row).replace("^", "**") for row in rows], text
    )  # of the whole header: no function states another sign


@pytest.mark.parametrize("robot", ROBOTS)
def test_show(robot):
    text = as_text(derived(robot))
    part = text[text.index(" base parameters, tau") : text.index("Where each link parameter went")]
    rows = re.findall(r"^  \S+ +(?:kg m\^2|kg m|kg) +\S+ +(.*)", part, re.MULTILINE)
    check(robot, rows, part)


@pytest.mark.parametrize("robot", ROBOTS)
def test_show_says_in_the_same_signs_where_every_link_parameter_went(robot):
    """The sum of all that is said to be added to a base parameter is its value."""
    model = derived(robot)
    values = link_values(model.spec, stated_sign(as_text(model)))
    totals = dict.fromkeys((p.name for p in model.base_parameters), 0.0)
    for entry in model.regrouping:
        for piece in entry.formula.split(", ") if entry.formula != "no effect" else []:
            name, added = re.fullmatch(r"(\w+) \+?= (.*)", piece).groups()
            totals[name] += compute(added, values)
    expected = [float(v) for v in model.beta_nominal]
    assert list(totals.values()) == pytest.approx(expected, rel=ROUND_OFF, abs=ROUND_OFF * 100)


@pytest.mark.parametrize("robot", ROBOTS)
def test_show_as_json(robot):
    data = json.loads(json.dumps(as_data(derived(robot), {}, None)))
    check(robot, [p["expression"] for p in data["base_parameters"]], data["link_parameters"])
    assert [p["nominal"] for p in data["base_parameters"]] == [float(v) for v in derived(robot).beta_nominal]


@pytest.mark.parametrize("robot", ROBOTS)
def test_the_manifest(robot):
    data = json.loads(emitted(robot)["manifest.json"])
    check(robot, [p["expression"] for p in data["base_parameters"]], data["link_parameters"])
    assert [p["nominal"] for p in data["base_parameters"]] == [float(v) for v in derived(robot).beta_nominal]


@pytest.mark.parametrize("robot", ROBOTS)
def test_the_casadi_module(robot):
    name = derived(robot).spec.name
    text = emitted(robot)[f"casadi/{name}_casadi.py"]
    rows = ast.literal_eval(re.search(r"^BASE_PARAMETERS = (\(.*?^\))", text, re.MULTILINE | re.DOTALL)[1])
    check(robot, [expression for _, expression in rows], text)


@pytest.mark.parametrize("robot", ROBOTS)
def test_latex(robot):
    text = latex_base_parameters(listing(derived(robot)))
    body = text[text.index("\\begin{align*}") + 15 : text.index("\\end{align*}")].replace("&\\quad", "")
    rows = [row.split("&=")[1] for row in re.sub(r"\\\\\n +(?=[+-])|\\\\\n(?=[+-])", " ", body).split("\\\\\n")]
    comments = "\n".join(line for line in text.splitlines() if line.startswith("%"))
    check(robot, [read_latex(row) for row in rows], comments, TWELVE_DIGITS)


class Text(HTMLParser):
    """The text of a page without its tags."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.parts: list[str] = []
        self.feed(page)

    def handle_data(self, data: str) -> None:
        self.parts.append(data)


@pytest.mark.parametrize("robot", ROBOTS)
def test_the_html_report(robot):
    page = html(robot)
    part = page[page.index("<h2>Base parameters") : page.index("Where each link parameter went")]
    cells = [re.findall(r"<td[^>]*>(.*?)</td>", row) for row in re.findall(r"<tr>(.*?)</tr>", part)]
    terms = [re.findall(r"<math>(.*?)</math>", row[-1]) for row in cells if row]  # one piece a term
    formulas = ["".join(pieces) for pieces in terms]
    assert ["<wbr/>".join(f"<math>{piece}</math>" for piece in pieces) for pieces in terms] == [
        row[-1] for row in cells if row
    ]
    check(robot, [read_mathml(formula) for formula in formulas], "".join(Text(page).parts), TWELVE_DIGITS)


def test_the_model_in_python_has_the_expressions_of_the_header():
    model = derived("rrr: positive about the origin, basis of the file")
    values = link_values(model.spec, -1)
    for parameter, nominal in zip(model.base_parameters, model.beta_nominal, strict=True):
        exact = compute(str(parameter.expression), values)
        assert exact == pytest.approx(float(nominal), rel=ROUND_OFF, abs=ROUND_OFF)


def test_the_reading_would_notice_the_other_sign():
    """The chapter's expressions in its own signs, read under the statement of the tensor: six of fifteen differ."""
    robot = "rrr: positive about the origin, basis of the file"
    model = derived(robot)
    wrong = [str(e) for e in model.spec.basis.expressions]
    values, nominal = link_values(model.spec, -1), [float(v) for v in model.beta_nominal]
    differ = [k for k, text in enumerate(wrong) if abs(compute(text, values) - nominal[k]) > 1e-6]
    assert [f"p{k + 1}" for k in differ] == ["p2", "p6", "p8", "p9", "p10", "p11"]
    with pytest.raises(AssertionError):
        check(robot, wrong, "with Ixy = -integral of x*y dm")
    check(robot, wrong, "with Ixy = +integral of x*y dm")
    with pytest.raises(AssertionError, match="states"):
        stated_sign("Ixy = +integral of x*y dm, later Ixy = -integral of x*y dm")


STANDARD = re.compile(r"(m|m[xyz]|[xyz]|I[xyz]{2})\d+")


@pytest.mark.parametrize("robot", ["pendulum", "planar2r", "scara", "gantry", "stanford"])
def test_no_base_parameter_has_the_name_of_a_standard_one(robot):
    from rrrgen.derive import derive_model

    names = [p.name for p in derive_model(load_spec(robot)).base_parameters]
    assert all(re.fullmatch(r"(m|h[xyz]|J[xyz]{2}|Izz)\d+R", name) for name in names)
    assert not any(STANDARD.fullmatch(name) for name in names)
    assert len(set(names)) == len(names)
