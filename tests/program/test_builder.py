"""Recording arithmetic: what the builder simplifies, shares and keeps."""

from __future__ import annotations

import copy
import math
import pickle
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rrrgen.base.errors import InternalError
from rrrgen.program import Builder, Op, Port, Program, Scalar, evaluate
from rrrgen.program.builder import replay
from rrrgen.program.program import ARITY

HALF = Fraction(1, 2)


@pytest.fixture
def recording():
    builder = Builder()
    return builder, builder.input(Port("x", (4,)))


def program_of(builder: Builder, *values) -> Program:
    return builder.program("f", [(Port("y", (len(values),)), values)])


def test_neutral_elements_disappear(recording):
    b, (x, y, *_) = recording
    assert x + 0 is x
    assert 0 + x is x
    assert x - 0 is x
    assert x * 1 == x
    assert x / 1 == x
    assert x * 0 == 0
    assert isinstance(x * 0, int)
    assert b.div(0, x) == 0
    assert x - x == 0
    assert (x + y) - y == x
    assert (x + y) - x == y
    assert (x - y) + y == x


def test_numbers_stay_numbers():
    b = Builder()
    assert b.add(2, Fraction(1, 3)) == Fraction(7, 3)
    assert b.sub(1, Fraction(1, 3)) == Fraction(2, 3)
    assert b.mul(Fraction(2, 3), 6) == 4
    assert b.div(1, 4) == Fraction(1, 4)
    assert b.neg(3) == -3
    assert b.double(HALF) == 1
    assert (b.sin(0), b.cos(0), b.sqrt(1), b.abs(-3), b.sign(-2), b.exp(0), b.tanh(0)) == (0, 1, 1, 3, -1, 1, 0)
    assert b.select(1, 5, 6) == 5
    assert b.select(0, 5, 6) == 6
    assert not b.nodes


def test_no_number_is_rounded():
    """Functions of numbers without an exact value are recorded, never computed in floating point."""
    b = Builder()
    for function in (b.sin, b.cos, b.exp, b.tanh, b.sqrt):
        assert isinstance(function(2), Scalar)
    assert [node.value for node in b.nodes if node.op is Op.CONST] == [Fraction(2)]


def test_common_subexpressions_exist_once(recording):
    b, (x, y, z, _) = recording
    assert x + y == y + x
    assert x * y == y * x
    assert x * y + z == z + y * x
    assert b.sin(x + y) == b.sin(y + x)
    assert len([n for n in b.nodes if n.op is Op.ADD]) == 2
    assert len([n for n in b.nodes if n.op is Op.MUL]) == 1


def test_signs_move_outwards(recording):
    b, (x, y, *_) = recording
    negated = -x
    assert -negated == x
    assert x + (-y) == x - y
    assert (-x) + y == y - x
    assert x - (-y) == x + y
    assert (-x) * (-y) == x * y
    assert (-x) * y == -(x * y)
    assert x * -2 == -(2 * x)
    assert b.sin(-x) == -b.sin(x)
    assert b.cos(-x) == b.cos(x)
    assert -(x - y) == y - x
    assert (y - x) == -(x - y)


def test_constant_factors_combine(recording):
    _, (x, *_) = recording
    assert 2 * (3 * x) == 6 * x
    assert HALF * (2 * x) == x
    assert -2 * (HALF * x) == -x
    assert x / 4 == Fraction(1, 4) * x


def test_a_sum_of_equal_terms_is_a_product(recording):
    b, (x, *_) = recording
    double = x + x
    assert b.nodes[double.index].op is Op.MUL
    kept = b.double(x)
    assert b.nodes[kept.index].op is Op.ADD


def test_scalars_of_two_builders_do_not_mix():
    one, two = Builder(), Builder()
    (x,) = one.input(Port("x", (1,)))
    _, y = two.input(Port("y", (2,)))
    assert x != two.input(Port("x", (1,)))[0]
    with pytest.raises(InternalError, match="used in another"):
        one.mul(x, y * y)


def test_the_first_label_stays(recording):
    b, (x, y, *_) = recording
    total = x + y
    b.label(total, "first")
    b.label(total, "second")
    b.label(x, "input")  # inputs have their own names
    b.label(3, "number")
    assert b.labels == {total.index: "first"}


def test_a_program_keeps_only_what_its_outputs_need(recording):
    b, (x, y, z, _) = recording
    unused = b.sin(z)
    program = program_of(b, x * y, 3, x)
    assert unused.index < len(b.nodes)
    assert [node.op for node in program.nodes] == [Op.INPUT, Op.INPUT, Op.MUL, Op.CONST]
    assert program.inputs == (Port("x", (4,)),)
    program.validate()


def test_representation_in_words(recording):
    _, (x, *_) = recording
    assert repr(x).startswith("Scalar(0: Node(op=Op.INPUT")


@given(st.integers(-20, 20), st.integers(1, 9), st.floats(-3, 3))
def test_identities_hold_for_numbers(numerator, denominator, value):
    """Every operator against Python's own arithmetic, with a number on either side."""
    number = Fraction(numerator, denominator)
    b = Builder()
    (x,) = b.input(Port("x", (1,)))
    recorded = [x + number, number + x, x - number, number - x, x * number, number * x, -x, number * x - x, x - 2 * x]
    f = float(number)
    expected = [value + f, value + f, value - f, f - value, value * f, value * f, -value, f * value - value, -value]
    if number:
        recorded += [x / number, number / (x * x + 1)]
        expected += [value / f, f / (value * value + 1)]
    result = evaluate(program_of(b, *recorded), [value])[0]
    for one, two in zip(result, expected, strict=True):
        assert math.isclose(one, two, rel_tol=1e-14, abs_tol=1e-14)


# -- validation ------------------------------------------------------------------------------------------------------


def broken(program: Program, **changes) -> Program:
    return program.with_fields(**changes)


def test_validation_finds_what_the_representation_forbids(recording):
    b, (x, y, *_) = recording
    program = program_of(b, x * y, x)
    nodes = program.nodes
    cases = {
        "operand after use": broken(program, nodes=(nodes[2]._replace(args=(1, 2)), *nodes[1:])),
        "too few operands": broken(program, nodes=(*nodes[:2], nodes[2]._replace(args=(0,)))),
        "input outside its port": broken(program, nodes=(nodes[0]._replace(value=(0, 4)), *nodes[1:])),
        "result outside": broken(program, results=((2, 3),)),
        "result missing": broken(program, results=((2,),)),
    }
    for case in cases.values():
        with pytest.raises(InternalError, match="program f"):
            case.validate()


def test_an_output_of_the_wrong_size_is_an_internal_error(recording):
    b, (x, y, *_) = recording
    with pytest.raises(InternalError, match="output y is not fully defined"):
        b.program("f", [(Port("y", (3,)), [x, y])])


# -- replay ----------------------------------------------------------------------------------------------------------


def every_operation() -> Program:
    b = Builder()
    x, y, z = b.input(Port("x", (3,)))
    values = [x + y, x - y, x * y, x / (z * z + 2), -x * z, b.sin(x), b.cos(y), b.sqrt(z * z), b.abs(x), b.sign(y)]
    values += [b.exp(x), b.tanh(z), b.select(x, y, z), x + 1, 2 - y, HALF * z, b.double(x), b.label(x * z, "xz")]
    return program_of(b, *values)


def test_replay_gives_the_same_program():
    program = every_operation()
    again = Builder()
    inputs = [again.input(port) for port in program.inputs]
    results = replay(program, again, inputs)
    copy = again.program("f", list(zip(program.outputs, results, strict=True)))
    state = np.random.default_rng(1).normal(size=(5, 3))
    assert np.array_equal(evaluate(copy, state)[0], evaluate(program, state)[0])
    assert {copy.labels[k] for k in copy.labels} == {"xz"}
    assert copy.nodes == program.nodes or len(copy.nodes) <= len(program.nodes)


def test_replay_with_numbers_folds_exactly():
    program = every_operation()
    b = Builder()
    (x,) = b.input(Port("x", (1,)))
    ((*values,),) = replay(program, b, [[x, Fraction(1, 3), 0]])
    assert values[1] == x - Fraction(1, 3)
    assert values[2] == Fraction(1, 3) * x
    assert values[3] == HALF * x
    assert values[4] == 0
    assert values[7] == 0
    assert values[9] == 1
    assert values[11] == 0
    folded = program_of(b, *values)
    direct = evaluate(program, [0.7, 1 / 3, 0.0])[0]
    assert np.allclose(evaluate(folded, [0.7])[0], direct, rtol=1e-15, atol=0)


@pytest.mark.parametrize("copied", [lambda op: pickle.loads(pickle.dumps(op)), copy.deepcopy])
def test_operations_stay_the_same_objects(copied):
    assert all(copied(op) is op for op in ARITY)
