"""Operations of a list of candidates: blocks count once for every turn of the loops around them, kernels by name."""

import pytest

from emit.loop_nests import FOUR, TWO, counted
from rrrgen.emit.c.ik.costs import CALLS, SolverOperations, block_operations, sum_of
from rrrgen.emit.c.ik.loop_nest import LoopNest, Statement, Value
from rrrgen.ik.recording.scalar import Pool
from rrrgen.program import Builder, Port


@pytest.fixture
def pool() -> Pool:
    return Pool()


def test_a_block_counts_its_program_and_its_calls_for_every_turn():
    builder = Builder()
    x, y = builder.input(Port("v", (2,)))
    program = builder.program("block", [(Port("r", ()), [builder.sqrt(x * y + x) / y])])
    once = SolverOperations(mul=1, add=1, div=1, sqrt=1)
    assert block_operations(program, (), 1) == once
    assert block_operations(program, ["unit", "unit"], 3) == sum_of([once, CALLS["unit"], CALLS["unit"]]).times(3)


def test_a_shared_value_counts_once_at_the_level_where_it_is_computed(pool):
    a, b, inner = pool.var("a"), pool.var("b"), pool.var("c")
    shared = a * b + a
    items = (Statement(0, ("use({0});",), (shared,)), Statement(2, ("use({0}, {1});",), (shared * inner, shared)))
    assert counted(LoopNest((TWO, FOUR), items)) == SolverOperations(mul=1 + 8, add=1)


def test_calls_count_for_every_turn_of_the_loops_around_them():
    items = (Statement(0, ("f();",), calls=("linear",)), Statement(1, ("g();",), calls=("wrap", "inverse")))
    expected = sum_of([CALLS["linear"], CALLS["wrap"].times(2), CALLS["inverse"].times(2), CALLS["arc"].times(2)])
    assert counted(LoopNest((TWO, FOUR), items, calls=("arc", "arc"))) == expected


def test_values_for_free_joints_do_not_count(pool):
    a, b = pool.var("a"), pool.var("b")
    rare = Statement(1, ("use({0}, {1});",), (a * b, (a + b) * b), rare=(1,))
    assert counted(LoopNest((), (Statement(0, ("use({0}, {1});",), rare.operands, rare=(1,)),))).as_dict()["add"] == 0
    assert counted(LoopNest((TWO,), (Value(0, (a + b) * b), rare))) == SolverOperations(mul=2)


def test_text_and_sum():
    total = sum_of([SolverOperations(mul=2, atan2=3), SolverOperations(add=1, mul=1)])
    assert str(total) == "3 mul, 1 add, 3 atan2"
    assert total.times(2).as_dict()["mul"] == 6
