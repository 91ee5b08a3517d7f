"""Computing equal values once, and sums of known values by one sum."""

from __future__ import annotations

import pytest
from hypothesis import given

from program.passes.programs import body, programs, recorded, same_values
from rrrgen.program import count_operations
from rrrgen.program.passes.equal_values import ShareEqualValues


@pytest.mark.parametrize("sums", [False, True])
def test_sharing_keeps_the_values_and_saves_or_changes_nothing(sums):
    @given(programs())
    def check(program):
        result = ShareEqualValues(sums)(program)
        assert same_values(program, result)
        assert result is program or count_operations(result).total < count_operations(program).total

    check()


def test_values_that_are_written_differently_are_computed_once():
    """(x + y) z = x z + y z, its negative, and half of it."""

    def function(b, q, dq, beta):
        x, y, z = beta
        return [(x + y) * z, x * z + y * z, -(z * y) - z * x, 2 * (x * z) + z * (y + y)]

    assert body(ShareEqualValues()(recorded(function))) == [
        "%1 = beta[0] + beta[1]",
        "%2 = beta[2]*%1",
        "%3 = -%2",
        "%4 = 2*%2",
        "y = %2, %2, %3, %4",
        "operations: 2 mul, 1 add, 1 neg",
    ]


def test_cosines_and_sines_of_a_sum_are_those_of_its_terms():
    def function(b, q, dq, beta):
        angle = q[0] + q[1]
        c, s, d, t = b.cos(q[0]), b.sin(q[0]), b.cos(q[1]), b.sin(q[1])
        return [b.cos(angle), c * d - s * t, b.sin(angle), s * d + c * t, c * c + s * s - 1]

    shared = ShareEqualValues()(recorded(function))
    assert same_values(shared, recorded(function))
    count = count_operations(shared)
    assert (count.total, count.sincos) == (1, 1)  # the addition of the angles


def test_the_derivative_of_a_turned_inertia_is_made_of_its_entries():
    def function(b, q, dq, beta):
        c, s, (Jxx, Jxy, Jyy) = b.cos(q[0]), b.sin(q[0]), beta
        u = (Jxx - Jyy) * c - 2 * Jxy * s
        du = -(s * (Jxx - Jyy)) - 2 * Jxy * c
        turned = [Jyy + c * u, Jxy + s * u, Jxx - c * u]
        return [*turned, c * du - s * u, s * du + c * u]

    program = recorded(function)
    shared = ShareEqualValues(sums=True)(program)
    assert same_values(shared, program)
    assert count_operations(program).total == 17
    assert count_operations(shared).total == 12  # the entries take ten, -2 Jxy and Jxx - Jyy one each


def test_a_small_value_is_no_difference_of_large_ones():
    """x y + x z is the difference of x (g + y + z) and x g, in which bits are lost where g is large."""

    def saved(g: int) -> int:
        def function(b, q, dq, beta):
            x, y, z = beta
            return [x * (g * dq[0]), x * (g * dq[0] + dq[0] * y + dq[1] * z), dq[0] * (x * y) + dq[1] * (x * z)]

        program = recorded(function)
        shared = ShareEqualValues(sums=True)(program)
        assert same_values(shared, program)
        return count_operations(program).total - count_operations(shared).total

    assert saved(1) == 4
    assert saved(1000) == 0


def test_a_program_without_equal_values_stays_the_same_object():
    program = recorded(lambda b, q, dq, beta: [b.sqrt(dq[0]) * beta[0], b.select(dq[1], dq[0], beta[1])])
    assert ShareEqualValues(sums=True)(program) is program
