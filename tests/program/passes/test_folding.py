"""Folding known numbers into a program."""

from __future__ import annotations

from fractions import Fraction

from hypothesis import given

from program.passes.programs import PORTS, STATE, body, precise, programs, recorded
from rrrgen.program import Builder, Op, Port, Role, count_operations
from rrrgen.program.passes.folding import Fold


@given(programs())
def test_folding_keeps_the_values(program):
    folded = Fold({Role.BASE_PARAMETERS: STATE[2]})(program)
    assert folded.inputs == PORTS[:2]
    x, y = precise(program, STATE), precise(folded, STATE[:2])
    size = max([1, *map(abs, x)])
    assert all(abs(u - v) <= size * 1e-20 for u, v in zip(x, y, strict=True))
    assert count_operations(folded).total <= count_operations(program).total


def test_folding_everything_leaves_numbers():
    b = Builder()
    x, y = b.input(Port("x", (2,), role=Role.FRICTION))
    program = b.program("f", [(Port("y", ()), [x * y + x])])
    folded = Fold({Role.FRICTION: [Fraction(2, 3), Fraction(1, 5)]})(program)
    assert [node.op for node in folded.nodes] == [Op.CONST]
    assert folded.nodes[0].value == Fraction(4, 5)


def test_zeros_take_their_terms_with_them():
    program = recorded(lambda b, q, dq, beta: [beta[0] * b.sin(q[0]) + beta[1] * b.cos(q[0]) + beta[2] * dq[0]])
    folded = Fold({Role.BASE_PARAMETERS: [0, 1, Fraction(1, 4)]})(program)
    assert body(folded) == [
        "%1 = cos(q[0])",
        "%2 = (1/4)*dq[0]",
        "%3 = %1 + %2",
        "y = %3",
        "operations: 1 mul, 1 add, 1 sincos",
    ]
