"""Closed forms in LaTeX, plain text and MathML, read back and computed."""

from __future__ import annotations

import math

import pytest
import sympy as sp
from hypothesis import given
from hypothesis import strategies as st

from emit.formula_reading import compute, raise_functions, read_latex, read_mathml, read_plain
from emit.transcribed import TRANSCRIBED, VALUES, S, value_of
from rrrgen.base.errors import BackendError
from rrrgen.emit.html.mathml import MathmlMarkup
from rrrgen.emit.latex.equations import break_sum, plain
from rrrgen.emit.latex.formulas import LatexMarkup, TextMarkup, Walk, notation

rationals = st.builds(sp.Rational, st.integers(-9, 9), st.sampled_from([1, 2, 3, 7, 20, 1000]))
angles = st.builds(
    lambda k, j, m, half: k * S["q1"] + j * S["q2"] + m * S["q3"] + half,
    *(st.integers(-1, 2) for _ in range(3)),
    st.sampled_from([0, sp.pi / 2]),
)
leaves = st.one_of(
    st.sampled_from(list(S.values())), rationals, angles.map(sp.cos), angles.map(sp.sin), st.just(sp.sqrt(2) / 2)
)
expressions = st.recursive(
    leaves,
    lambda inner: st.one_of(
        st.lists(inner, min_size=2, max_size=4).map(lambda terms: sp.Add(*terms)),
        st.lists(inner, min_size=2, max_size=3).map(lambda factors: sp.Mul(*factors)),
        st.tuples(inner, st.sampled_from([2, 3])).map(lambda pair: pair[0] ** pair[1]),
        inner.map(lambda e: 1 / (2 + e**2)),
        inner.map(lambda e: sp.sqrt(1 + e**2)),
    ),
    max_leaves=12,
)


def latex_expression(expression: sp.Expr, short_trig: bool = True) -> str:
    return Walk(LatexMarkup(), short_trig).write(expression)


def plain_expression(expression: sp.Expr, short_trig: bool = True) -> str:
    return Walk(TextMarkup(), short_trig).write(expression)


READERS = {
    "plain": lambda e, short: read_plain(plain_expression(e, short)),
    "latex": lambda e, short: read_latex(latex_expression(e, short)),
    "mathml": lambda e, short: raise_functions(read_mathml(Walk(MathmlMarkup(), short).write(e))),
}


@pytest.mark.parametrize("markup", READERS)
@given(expression=expressions, short=st.booleans())
def test_what_is_printed_means_the_expression(markup: str, expression: sp.Expr, short: bool) -> None:
    printed = READERS[markup](expression, short)
    assert math.isclose(compute(printed, VALUES), value_of(expression), rel_tol=TRANSCRIBED, abs_tol=TRANSCRIBED), (
        printed
    )


@given(expression=expressions, width=st.integers(5, 60))
def test_breaking_into_lines_keeps_the_meaning(expression: sp.Expr, width: int) -> None:
    walk = Walk(TextMarkup(), True)
    rows = break_sum(expression, walk, width)
    printed = " ".join(f"{'-' if negative else '+'} {term}" for row in rows for negative, term in row)
    assert math.isclose(
        compute(read_plain(printed), VALUES), value_of(expression), rel_tol=TRANSCRIBED, abs_tol=TRANSCRIBED
    ), printed


@pytest.mark.parametrize(
    ("name", "printed"),
    [
        ("q1", "q_{1}"),
        ("ddq12", r"\ddot{q}_{12}"),
        ("Ixx2", "I_{xx,2}"),
        ("Jyz3", "J_{yz,3}"),
        ("mx2", r"\mathit{mx}_{2}"),
        ("hx2R", "h_{x,2R}"),
        ("m3R", "m_{3R}"),
        ("Jxy10R", "J_{xy,10R}"),
        ("Ia1", "I_{a,1}"),
        ("fc2", "f_{c,2}"),
        ("beta10", r"\beta_{10}"),
        ("L_tool", r"L_{\mathrm{tool}}"),
        ("d1", "d_{1}"),
        ("reach", r"\mathit{reach}"),
    ],
)
def test_notation_of_names(name: str, printed: str) -> None:
    assert latex_expression(sp.Symbol(name, real=True)) == printed
    assert notation(name).base in name


@pytest.mark.parametrize("name", ["Izz1R", "Jxy10R", "hx2R", "m3R", "p12", "L_tool"])
def test_names_stay_words_in_plain_text(name: str) -> None:
    assert plain_expression(sp.Symbol(name, real=True)) == name


def test_chapter_notation() -> None:
    q1, q2, q3 = S["q1"], S["q2"], S["q3"]
    assert latex_expression(sp.cos(q2 + q3) ** 2) == "c_{23}^{2}"
    assert latex_expression(sp.sin(2 * (q2 + q3))) == r"\sin\left(2 q_{2} + 2 q_{3}\right)"
    assert latex_expression(sp.cos(q1), short_trig=False) == r"\cos\left(q_{1}\right)"
    assert plain_expression(S["p3"] * sp.cos(q2 + q3) - sp.Rational(981, 100) * S["p12"]) == "p3*c23 - 9.81*p12"


def test_a_parameter_called_c2_switches_the_short_form_off() -> None:
    text = plain({"gravity": sp.Matrix([sp.Symbol("c2", real=True) * sp.cos(S["q2"])])})
    assert "c2*cos(q2)" in text


def test_unknown_functions_are_refused() -> None:
    with pytest.raises(BackendError, match="erf"):
        plain_expression(sp.erf(S["q1"]))
