"""Expanding a program into polynomials and factoring those."""

from __future__ import annotations

from fractions import Fraction

import pytest
from hypothesis import given, settings

from program.passes.programs import body, programs, recorded, same_values
from rrrgen.program import Builder, Op, OperationCount, Port, Status, count_operations
from rrrgen.program.passes.rewriting import CutSet, ExpandAndFactor, SeenExpansions


@pytest.mark.parametrize("cut_set", CutSet)
def test_expanding_and_factoring_keeps_the_values(cut_set):
    @settings(max_examples=120)
    @given(programs())
    def check(program):
        result = ExpandAndFactor(cut_set).attempt(program)
        if result is not None:
            assert result.inputs == program.inputs
            assert result.outputs == program.outputs
            assert same_values(program, result)

    check()


def test_a_product_of_sums_is_found():
    def function(b, q, dq, beta):
        x, y = dq
        return [x * beta[0] * q[0] + x * beta[1] * q[0] + y * q[0] * beta[0] + y * beta[1] * q[0]]

    result = ExpandAndFactor(CutSet.NOTHING)(recorded(function))
    assert body(result) == [
        "%1 = beta[0] + beta[1]",
        "%2 = q[0]*%1",
        "%3 = dq[0] + dq[1]",
        "%4 = %2*%3",
        "y = %4",
        "operations: 2 mul, 2 add",
    ]


def test_squares_of_one_angle_add_up_to_one():
    program = recorded(lambda b, q, dq, beta: [beta[0] * (b.sin(q[0]) * b.sin(q[0]) + b.cos(q[0]) * b.cos(q[0]))])
    result = ExpandAndFactor(CutSet.NOTHING).attempt(program)
    assert count_operations(result) == OperationCount()
    assert [node.op for node in result.nodes] == [Op.INPUT]


def test_a_term_beside_one_of_the_size_of_residue_is_kept():
    """Squares of the cosine of an angle 2e-16 beside pi/2 are 4e-32; a sum of both must not be scaled by that."""
    tiny = Fraction(2, 10**16)

    def function(b, q, dq, beta):
        return [(tiny * x) * (tiny * beta[0]) + x * beta[1] for x in dq]

    def expected(b, q, dq, beta):
        return [x * beta[1] for x in dq]

    for cut_set in CutSet:
        assert same_values(recorded(expected), ExpandAndFactor(cut_set)(recorded(function)))


def test_absolute_rates_stay_sums():
    """A sum of inputs is one literal, so that (dq1 + dq2)^2 is not torn into three products."""

    def function(b, q, dq, beta):
        W = dq[0] + dq[1]
        return [beta[0] * (W * W) * b.sin(q[0]), beta[1] * (W * W) * b.cos(q[0])]

    count = count_operations(ExpandAndFactor(CutSet.NOTHING)(recorded(function)))
    assert (count.mul, count.add) == (5, 1)


def test_angles_with_a_constant_stay_angles():
    program = recorded(lambda b, q, dq, beta: [b.sin(q[0] + q[1] + Fraction(1, 3)) * dq[0]])
    for cut_set in CutSet:
        result = ExpandAndFactor(cut_set).attempt(program)
        assert count_operations(result).sincos == 1
        assert same_values(program, result)


def test_what_is_too_large_is_left_alone():
    def function(b, q, dq, beta):
        value = 1
        for _ in range(4):
            value = value * (dq[0] * beta[0] + dq[1] * beta[1] + b.sin(q[0]) * beta[2] + b.sin(q[1]))
        return [value]

    assert ExpandAndFactor(CutSet.NOTHING)(recorded(function)) is not None
    program = recorded(lambda *inputs: [function(*inputs)[0] * function(*inputs)[0] + 1])
    assert ExpandAndFactor(CutSet.NOTHING).attempt(program) is None


def test_the_status_is_computed_before_the_other_outputs():
    b = Builder()
    x, y = b.input(Port("q", (2,)))
    status = Status.of(1, "negative", "the product is negative", "x y < 0")
    outputs = [(Port("sum", ()), [x * x + y]), (Port("status", ()), [x * y - y])]
    result = ExpandAndFactor(CutSet.NOTHING)(b.program("f", outputs, status=status))
    (total,), (failure,) = result.results
    assert failure < total
    assert result.status == status


def test_the_options_bound_the_search():
    program = recorded(lambda b, q, dq, beta: [(q[0] * beta[0] + q[1] * beta[1]) * (q[1] * beta[0] + beta[2])])
    assert ExpandAndFactor(CutSet.NOTHING)(program) is not program
    assert ExpandAndFactor(CutSet.NOTHING, max_terms=3)(program) is program
    assert ExpandAndFactor(CutSet.NOTHING, max_pairs=5)(program) is program
    assert ExpandAndFactor(CutSet.LOCAL, max_pairs=5)(program) is not program


def test_an_expansion_is_factored_once():
    program = recorded(lambda b, q, dq, beta: [dq[0] * (beta[0] + b.sin(q[0])) - dq[0] * beta[0]])
    seen = SeenExpansions()
    assert ExpandAndFactor(CutSet.NOTHING).attempt(program, seen) is not None
    assert ExpandAndFactor(CutSet.NOTHING).attempt(program, seen) is None
