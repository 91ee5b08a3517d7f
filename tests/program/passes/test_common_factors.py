"""Taking common factors out of sums."""

from __future__ import annotations

from hypothesis import given

from program.passes.programs import body, programs, recorded, same_values
from rrrgen.program import count_operations
from rrrgen.program.passes.common_factors import Collect


@given(programs())
def test_collecting_keeps_the_values_and_saves_or_changes_nothing(program):
    result = Collect()(program)
    assert same_values(program, result)
    assert result is program or count_operations(result).total < count_operations(program).total


def test_a_factor_is_taken_out():
    program = recorded(lambda b, q, dq, beta: [dq[0] * beta[0] - dq[1] * beta[1] + dq[0] * beta[2]])
    assert body(program) == [
        "%1 = dq[0]*beta[0]",
        "%2 = dq[1]*beta[1]",
        "%3 = %1 - %2",
        "%4 = dq[0]*beta[2]",
        "%5 = %3 + %4",
        "y = %5",
        "operations: 3 mul, 2 add",
    ]
    assert body(Collect()(program)) == [
        "%1 = beta[0] + beta[2]",
        "%2 = dq[0]*%1",
        "%3 = dq[1]*beta[1]",
        "%4 = %2 - %3",
        "y = %4",
        "operations: 2 mul, 2 add",
    ]


def test_a_factor_is_taken_out_of_a_sum_of_sums():
    """x a + y - (z - x b) is x (a + b) + y - z, also where the parts were recorded in any order."""

    def function(b, q, dq, beta):
        x, (y, z), (a, c, d) = b.sin(q[0]), dq, beta
        return [x * a + y - (z - x * c) - y * d, (z + x * d) * 3]

    program = recorded(function)
    result = Collect()(program)
    assert same_values(program, result)
    before, after = count_operations(program), count_operations(result)
    assert (before.mul, before.add) == (5, 5)
    assert (after.mul, after.add) == (4, 5)


def test_shared_products_are_not_taken_apart():
    def function(b, q, dq, beta):
        one, other = b.sin(q[0]) * beta[0], b.sin(q[0]) * beta[1]
        return [one + other, one, other]

    program = recorded(function)
    assert Collect()(program) is program
