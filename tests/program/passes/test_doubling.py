"""Doubling by addition."""

from __future__ import annotations

import numpy as np
from hypothesis import given

from program.passes.programs import STATE, body, programs, recorded
from rrrgen.program import Op, count_operations, evaluate
from rrrgen.program.passes.doubling import DoubleByAddition


@given(programs())
def test_doubling_by_addition_is_exact(program):
    result = DoubleByAddition()(program)
    state = [np.array([float(v) for v in row]) for row in STATE]
    with np.errstate(all="ignore"):
        assert np.array_equal(evaluate(result, *state)[0], evaluate(program, *state)[0], equal_nan=True)
    before, after = count_operations(program), count_operations(result)
    assert after.mul + after.add <= before.mul + before.add
    assert after.mul <= before.mul
    twos = {k for k, node in enumerate(result.nodes) if node.op is Op.CONST and node.value == 2}
    assert not any(node.op is Op.MUL and twos & set(node.args) for node in result.nodes)


def test_twice_becomes_a_sum():
    program = recorded(lambda b, q, dq, beta: [2 * (dq[0] * beta[0]), 3 * dq[1], -2 * dq[1]])
    assert body(DoubleByAddition()(program)) == [
        "%1 = dq[0]*beta[0]",
        "%2 = %1 + %1",
        "%3 = 3*dq[1]",
        "%4 = dq[1] + dq[1]",
        "%5 = -%4",
        "y = %2, %3, %5",
        "operations: 2 mul, 2 add, 1 neg",
    ]


def test_without_doubling_the_program_stays_the_same_object():
    program = recorded(lambda b, q, dq, beta: [3 * dq[1]])
    assert DoubleByAddition()(program) is program
