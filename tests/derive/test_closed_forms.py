"""Closed forms: their values are those of the programs, entry by entry and as a whole."""

from __future__ import annotations

from fractions import Fraction
from functools import cache
from itertools import cycle

import numpy as np
import pytest
import sympy as sp

from pipeline.optimized import bundled
from rrrgen.base.errors import DerivationError
from rrrgen.derive import prepare
from rrrgen.derive.closed_forms import CLOSED, SharedForm, closed_form, shared_form
from rrrgen.program import Builder, Op, Port, evaluate
from rrrgen.robot.file import load_spec

DIGITS = 1e-12  # relative to the largest entry; the program computes in double, the closed form with 30 digits
SEED = 3


@cache
def prepared(name: str):
    """What the closed forms of a bundled robot are derived from."""
    return prepare(load_spec(name))


def inputs(model, program) -> list[np.ndarray]:
    rng = np.random.default_rng(SEED)
    return [rng.uniform(-1.5, 1.5, port.shape) for port in program.inputs]


def point(model, program, values) -> dict[sp.Symbol, sp.Expr]:
    """The same numbers for the symbols of the closed form."""
    numbers = {symbol: model.spec.nominal(symbol) for symbol in map(parameter, model.spec.parameters)}
    for port, value in zip(program.inputs, values, strict=True):
        own = model.base_parameters if port.name == "beta" else None
        for k, number in enumerate(value.ravel()):
            name = own[k].name if own else f"{port.name}{k + 1}" if port.shape else port.name
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
    "energy": ("kinetic", "potential"),
}
SINGLE = [name for name in sorted(CLOSED) if name not in SEVERAL]
PARTS = [f"{name}.{result}" for name, results in SEVERAL.items() for result in results]


SMALL = ("rrr", "pendulum", "scara", "planar2r", "gantry")


@pytest.mark.parametrize(("robot", "name"), [*zip(cycle(SMALL), [*SINGLE, *PARTS], strict=False)])
def test_whole_functions_have_the_values_of_the_programs(robot, name):
    """The robots in turn: an expression follows from a program in the same way for every function and every robot."""
    small = bundled(robot)
    function, _, result = name.partition(".")
    program = small.programs[function]
    values = inputs(small, program)
    results = {port.name: v for port, v in zip(program.outputs, evaluate(program, *values), strict=True)}
    expected = np.atleast_1d(results[result] if result else next(iter(results.values())))
    matrix = closed_form(prepared(small.name), name).matrix()
    numbers = point(small, program, values)
    got = np.array([value(entry, numbers) for entry in matrix]).reshape(expected.shape)
    assert np.abs(got - expected).max() <= DIGITS * max(np.abs(expected).max(), 1e-3)


@pytest.mark.parametrize(
    ("name", "function", "entry"),
    [
        pytest.param("puma560", "mass_matrix", (2, 1), marks=pytest.mark.sweep),
        ("puma560", "gravity", (1,)),
        ("panda", "jacobian", (2, 3)),
        ("panda", "mass_matrix", (6, 6)),
    ],
)
def test_one_entry_of_a_large_robot(name, function, entry):
    model = bundled(name)
    program = model.programs[function]
    values = inputs(model, program)
    expected = evaluate(program, *values)[-1]
    got = value(closed_form(prepared(name), function)[entry], point(model, program, values))
    assert abs(got - expected[entry]) <= DIGITS * np.abs(expected).max()


def substituted(form: SharedForm, numbers) -> list[float]:
    """The entries of the matrix, the definitions evaluated in their order."""
    known = dict(numbers)
    for symbol, expression in form.definitions:
        assert expression.free_symbols <= set(known), "uses what is defined later"
        known[symbol] = sp.N(expression.subs(known), 30)
    return [float(sp.N(entry.subs(known), 30)) for entry in form.matrix]


@pytest.mark.parametrize(
    ("name", "function", "most"),
    [("panda", "mass_matrix", 110), pytest.param("ur10e", "inverse_dynamics", 120, marks=pytest.mark.sweep)],
)
def test_long_forms_name_their_intermediate_results(name, function, most):
    model = bundled(name)
    program = model.programs[function]
    values = inputs(model, program)
    expected = np.ravel(evaluate(program, *values)[-1])
    form = closed_form(prepared(name), function).readable()
    assert isinstance(form, SharedForm)
    assert 10 < len(form.definitions) <= most
    got = np.array(substituted(form, point(model, program, values)))
    assert np.abs(got - expected).max() <= DIGITS * np.abs(expected).max()
    everything = [form.matrix, *(value for _, value in form.definitions)]
    uses = [
        sum(int(entry.count(name)) for part in everything for entry in np.ravel(part)) for name, _ in form.definitions
    ]
    assert min(uses) > 0
    assert sum(count == 1 for count in uses) <= 1 + len(uses) // 20  # SymPy merges x + (y + x) into 2*x + y


def test_short_forms_are_expanded_and_entries_follow_the_same_rule():
    form = closed_form(prepared("rrr"), "mass_matrix")
    assert form.readable() == form.matrix()
    assert form.readable((0, 1)) == form[0, 1]
    large = closed_form(prepared("panda"), "mass_matrix")
    assert large.readable((6, 6)) == large[6, 6]
    entry = large.readable((0, 0))
    assert isinstance(entry, SharedForm)
    assert entry.matrix.shape == (1, 1)
    with pytest.raises(IndexError):
        large.readable((7, 0))


def test_names_of_intermediate_results_avoid_the_names_of_the_robot():
    builder = Builder()
    total = builder.input(Port("q", ()))[0] + builder.input(Port("beta", ()))[0]
    program = builder.program("square", [(Port("r", (1,)), [total * total])])
    symbols = [[sp.Symbol("q1")], [sp.Symbol("t1")]]
    form = shared_form(program, program.results[0], (1, 1), symbols, {})
    assert [str(symbol) for symbol, _ in form.definitions] == ["t2"]


def test_a_number_may_be_an_angle_and_a_length():
    builder, quarter = Builder(), Fraction(1, 4)
    q = builder.input(Port("q", ()))[0]
    turned = builder.add(q, quarter)
    program = builder.program("reach", [(Port("x", (1,)), [builder.mul(quarter, builder.sin(turned)) + quarter])])
    symbol = sp.Symbol("q1")
    (angle,) = (node.args[0] for node in program.nodes if node.op is Op.SIN)
    angles = {k: symbol + sp.Rational(1, 4) for k in (angle, *program.nodes[angle].args)}
    form = shared_form(program, program.results[0], (1, 1), [[symbol]], angles)
    expected = (1 + sp.sin(symbol + sp.Rational(1, 4))) / 4
    assert sp.expand(form.matrix[0].subs(form.definitions[::-1]) - expected) == 0


def test_what_has_no_closed_form_and_wrong_entries_are_refused():
    pendulum = prepared("pendulum")
    with pytest.raises(DerivationError, match="no closed form of 'forward_dynamics'; there is one of: forward_kinem"):
        closed_form(pendulum, "forward_dynamics")
    with pytest.raises(DerivationError, match="no closed form of 'mass_matrx'; did you mean 'mass_matrix'"):
        closed_form(pendulum, "mass_matrx")
    with pytest.raises(DerivationError, match="no closed form of 'forward_dynamics_derivatives'"):
        closed_form(pendulum, "forward_dynamics_derivatives")
    for unclear in (*SEVERAL, "inverse_dynamics_derivatives.dtau", "mass_matrix.C"):
        with pytest.raises(DerivationError, match=r"(name one result:|there is) \w+\.(tau|M|T|kinetic)"):
            closed_form(pendulum, unclear)
    form = closed_form(pendulum, "mass_matrix")
    for wrong in ((0,), (0, 1), (1, 0), 0):
        with pytest.raises(IndexError, match="shape"):
            form[wrong]


def test_printed_forms_have_the_decimals_of_the_robot_file():
    form = closed_form(prepared("rrr"), "gravity")
    assert form[1].atoms(sp.Float) == set()  # entries stay exact
    lines = str(form).splitlines()
    assert [line.partition(" = ")[0] for line in lines] == ["gravity[0]", "gravity[1]", "gravity[2]"]
    assert "9.81*p14*cos(q2)" in lines[1]
    assert "981/100" not in str(form)
    assert r"9.81 p_{14} \cos" in form._repr_latex_()
    scara = closed_form(prepared("scara"), "mass_matrix")
    for line, entry in zip(str(scara).splitlines(), scara, strict=True):
        printed = sp.sympify(line.partition(" = ")[2], locals={s.name: s for s in entry.free_symbols}, rational=True)
        assert sp.expand(printed - entry) == 0
    assert "0.325*hx2R" in str(scara)


def test_long_forms_and_results_of_several_are_named_when_printed():
    assert str(closed_form(prepared("puma560"), "mass_matrix")).startswith("<closed form of mass_matrix")
    assert str(closed_form(prepared("rrr"), "energy.potential")).startswith("energy.potential = 9.81*p14")
