"""Derivatives of programs by the chain rule against numerical differentiation with 40 digits."""

from __future__ import annotations

from collections.abc import Callable

import mpmath as mp
import numpy as np
import pytest
from hypothesis import given

from emit.casadi_cases import arguments, random_program
from program.passes.programs import programs, recorded, same_values
from rrrgen.base.errors import InternalError
from rrrgen.program import Builder, Op, Port, Program, count_operations, evaluate
from rrrgen.program.differentiation import jacobian, record, tangents

DIGITS = 40
ROUND_OFF = 1e-12  # relative to the largest derivative: the program computes in double, the reference does not

OPERATIONS: dict[Op, Callable] = {
    Op.ADD: lambda x, y: x + y,
    Op.SUB: lambda x, y: x - y,
    Op.MUL: lambda x, y: x * y,
    Op.DIV: lambda x, y: x / y,
    Op.NEG: lambda x: -x,
    Op.SIN: mp.sin,
    Op.COS: mp.cos,
    Op.SQRT: mp.sqrt,
    Op.ABS: abs,
    Op.SIGN: mp.sign,
    Op.EXP: mp.exp,
    Op.TANH: mp.tanh,
    Op.SELECT: lambda condition, x, y: x if condition > 0 else y,
}


def exact(program: Program, inputs: list[list[mp.mpf]], output: int) -> list[mp.mpf]:
    """One output of a program in arbitrary precision."""
    values: list[mp.mpf] = []
    for node in program.nodes:
        if node.op is Op.INPUT:
            port, element = node.place
            values.append(inputs[port][element])
        elif node.op is Op.CONST:
            values.append(mp.mpf(node.number.numerator) / node.number.denominator)
        else:
            values.append(OPERATIONS[node.op](*(values[k] for k in node.args)))
    return [values[k] for k in program.results[output]]


def slopes(program: Program, inputs: list[np.ndarray], output: int, port: int) -> np.ndarray:
    """d output / d input by central differences of 40 digits, good to 25."""
    step = mp.mpf(10) ** -13
    flat = [[mp.mpf(float(v)) for v in np.ravel(value)] for value in inputs]
    columns = []
    for element in range(len(flat[port])):
        moved = []
        for sign in (1, -1):
            place = [list(row) for row in flat]
            place[port][element] += sign * step
            moved.append(exact(program, place, output))
        columns.append([float((after - before) / (2 * step)) for after, before in zip(*moved, strict=True)])
    return np.array(columns).T.reshape(len(program.results[output]), len(flat[port]))


@pytest.mark.parametrize("reverse", [False, True], ids=["forward", "reverse"])
@pytest.mark.parametrize("smooth", [True, False], ids=["smooth", "kinks"])
@pytest.mark.parametrize("seed", range(12))
def test_random_programs(seed, smooth, reverse):
    rng = np.random.default_rng(seed)
    program = random_program(rng, smooth=smooth)
    values = arguments(program, rng)
    names = [port.name for port in program.inputs]
    with mp.workdps(DIGITS):
        for output, port in enumerate(program.outputs):
            own, *found = evaluate(jacobian(program, port.name, names, reverse), *values)
            assert np.array_equal(own, evaluate(program, *values)[output])
            for k, D in enumerate(found):
                expected = slopes(program, values, output, k)
                assert D.shape == expected.shape
                assert np.max(np.abs(D - expected)) <= ROUND_OFF * max(1.0, np.max(np.abs(expected)))


def test_ports_of_the_result_and_its_shared_evaluation():
    b = Builder()
    x = b.input(Port("x", (2,)))
    (k,) = b.input(Port("k", ()))
    program = b.program("f", [(Port("y", (2,)), [b.sin(x[0]) * k, x[1] * k]), (Port("z", ()), [b.exp(k)])])
    found = jacobian(program, "y", ("k", "x"))
    assert [(port.name, port.shape) for port in found.outputs] == [("y", (2,)), ("dy_dk", (2, 1)), ("dy_dx", (2, 2))]
    assert found.name == "f_derivatives"
    count = count_operations(found)
    assert (count.mul, count.add, count.sincos) == (3, 0, 1), "zeros cost nothing, and sin x and exp k are not repeated"


def test_what_has_no_rule_is_an_internal_error(monkeypatch):
    from rrrgen.program import differentiation as differentiate

    with pytest.raises(InternalError, match="no derivative rule"):
        differentiate._partials(Builder(), Op.SELECT, [1, 2, 3], 1)


def along_a_direction(program: Program, rotations: bool) -> Program:
    """The one output of ``program`` and its derivative along a direction that depends on the inputs."""
    builder = Builder()
    inputs = [builder.input(port) for port in program.inputs]
    q, dq, beta = inputs
    seeds = [[{0: value} for value in row] for row in ([*dq, beta[0]], [beta[1], q[0]], q)]
    values = record(program, builder, inputs)
    (slopes,) = tangents(program, builder, values, seeds, rotations)
    results = [[values[k] for k in program.results[0]], [slope.get(0, 0) for slope in slopes]]
    return builder.program("slopes", list(zip(program.outputs * 2, results, strict=True)))


@given(programs())
def test_the_rule_for_rotations_changes_no_derivative(program):
    assert same_values(*(along_a_direction(program, rotations) for rotations in (False, True)))


def test_a_rotated_vector_takes_fewer_operations():
    """Also where the terms stand in longer sums, as those of a wrench that is added to another."""

    def rotated(b, q, dq, beta):
        c, s, (x, y) = b.cos(q[0]), b.sin(q[0]), dq
        return [c * x - s * y, beta[0] + s * x + c * y - beta[1]]

    program = recorded(rotated)
    plain, short = (along_a_direction(program, rotations) for rotations in (False, True))
    assert same_values(plain, short)
    assert count_operations(plain).total - count_operations(short).total == 3


def test_a_product_of_cosine_and_sine_of_one_angle_is_one_term():
    """Its derivative c c - s s is made of known products twice over."""

    def function(b, q, dq, beta):
        c, s = b.cos(q[0]), b.sin(q[0])
        return [c * s + beta[0], c * c, s * s, c * s + c * dq[0] - s * dq[1], s * dq[0] + c * dq[1]]

    program = recorded(function)
    assert same_values(*(along_a_direction(program, rotations) for rotations in (False, True)))
