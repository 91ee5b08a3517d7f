"""Closed forms: their values are those of the programs, entry by entry and as a whole."""

from __future__ import annotations

import numpy as np
import pytest
import sympy as sp

from pipeline.optimized import bundled
from rrrgen import pipeline
from rrrgen.derive import prepare
from rrrgen.derive.closed_forms.closed_form import CLOSED, closed_form
from rrrgen.errors import DerivationError
from rrrgen.program import evaluate
from rrrgen.robotfile import load_spec

DIGITS = 1e-12  # relative to the largest entry; the program computes in double, the closed form with 30 digits
SEED = 3


@pytest.fixture(scope="module", params=["pendulum", "planar2r", "rrr", "scara", "gantry"])
def small(request):
    return pipeline.derive(load_spec(request.param))


def inputs(model, program) -> list[np.ndarray]:
    rng = np.random.default_rng(SEED)
    return [rng.uniform(-1.5, 1.5, port.shape) for port in program.inputs]


def point(model, program, values) -> dict[sp.Symbol, sp.Expr]:
    """The same numbers for the symbols of the closed form."""
    numbers = {symbol: model.spec.nominal(symbol) for symbol in map(parameter, model.spec.parameters)}
    for port, value in zip(program.inputs, values, strict=True):
        own = model.base_parameters if port.name == "beta" else None
        for k, number in enumerate(value.ravel()):
            name = own[k].name if own else f"{port.name}{k + 1}"
            numbers[sp.Symbol(name, real=True)] = sp.Rational(float(number))
    return numbers


def parameter(name: str) -> sp.Symbol:
    return sp.Symbol(name, real=True)


def value(expression: sp.Expr, numbers) -> float:
    result = sp.N(sp.sympify(expression, strict=True).subs(numbers), 30)
    assert result.is_number, expression.free_symbols
    return float(result)


SEVERAL = {
    "inverse_dynamics_derivatives": ("tau", "dtau_dq", "dtau_dv", "M"),
    "kinematics": "TJ",
    "dynamics_terms": "Mcg",
}
SINGLE = [name for name in sorted(CLOSED) if name not in SEVERAL]
PARTS = [f"{name}.{result}" for name, results in SEVERAL.items() for result in results]


@pytest.mark.parametrize("name", [*SINGLE, *PARTS])
def test_whole_functions_have_the_values_of_the_programs(small, name):
    function, _, result = name.partition(".")
    program = small.programs[function]
    values = inputs(small, program)
    results = {port.name: v for port, v in zip(program.outputs, evaluate(program, *values), strict=True)}
    expected = np.atleast_1d(results[result] if result else next(iter(results.values())))
    matrix = closed_form(prepare(small.spec), name).matrix()
    numbers = point(small, program, values)
    got = np.array([value(entry, numbers) for entry in matrix]).reshape(expected.shape)
    assert np.abs(got - expected).max() <= DIGITS * max(np.abs(expected).max(), 1e-3)


@pytest.mark.parametrize(
    ("name", "function", "entry"),
    [
        ("puma560", "mass_matrix", (5, 5)),
        ("puma560", "mass_matrix", (2, 1)),
        ("puma560", "gravity", (1,)),
        ("ur10e", "forward_kinematics", (0, 3)),
        ("panda", "jacobian", (2, 3)),
        ("panda", "mass_matrix", (6, 6)),
    ],
)
def test_one_entry_of_a_large_robot(name, function, entry):
    model = bundled(name)
    program = model.programs[function]
    values = inputs(model, program)
    expected = evaluate(program, *values)[-1]
    got = value(closed_form(prepare(model.spec), function)[entry], point(model, program, values))
    assert abs(got - expected[entry]) <= DIGITS * np.abs(expected).max()


def test_what_has_no_closed_form_and_wrong_entries_are_refused():
    model = pipeline.derive(load_spec("pendulum"))
    with pytest.raises(DerivationError, match="no closed form of 'forward_dynamics'; there is one of: forward_kinem"):
        closed_form(prepare(model.spec), "forward_dynamics")
    with pytest.raises(DerivationError, match="no closed form of 'forward_dynamics_derivatives'"):
        closed_form(prepare(model.spec), "forward_dynamics_derivatives")
    for unclear in (*SEVERAL, "inverse_dynamics_derivatives.dtau", "mass_matrix.C"):
        with pytest.raises(DerivationError, match=r"name one result: \w+\.(tau|M|T)"):
            closed_form(prepare(model.spec), unclear)
    form = closed_form(prepare(model.spec), "mass_matrix")
    for wrong in ((0,), (0, 1), (1, 0), 0):
        with pytest.raises(IndexError, match="shape"):
            form[wrong]
