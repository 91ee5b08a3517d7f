"""Arc tangents taken together: slots for every distinct angle, angles that follow from others, the second visit."""

import pytest

from emit.loop_nests import arc, counted, leaf, opened, text
from rrrgen.emit.c.ik.loop_nest import ARC, ArcTangent, Flip, LoopNest, RootLoop, Statement, TakeArcsTogether
from rrrgen.ik.recording.scalar import Pool

LOOPS = (RootLoop("i1", "n1", 2, 0), RootLoop("i2", "n2", 4, 1))


@pytest.fixture
def pool() -> Pool:
    return Pool()


def two_choices(pool, c, s):
    """An angle of (c, s) known inside two loops, the number of passes of the second depends on the first."""
    count = Statement(1, ("const int n2 = solve({0});",), (pool.var("i1"),), (pool.var("n2"),))
    items = (opened(pool, 0, 0, "n1"), count, opened(pool, 1, 1, "n2"), arc(pool, 2, "q1", c, s))
    return LoopNest(LOOPS, (*items, leaf(2, pool.var("e"), (0, pool.var("q1")), (1, pool.var("x2")))))


def test_before_the_pass_an_arc_tangent_stands_where_it_is_needed(pool):
    lines = text(two_choices(pool, pool.var("i1"), pool.var("i2")))
    assert lines[5:8] == [
        "        REAL q1 = ik_atan2(i2, i1);",
        "        found->q[rows][0] = q1;",
        "        found->q[rows][1] = x2;",
    ]


def test_an_angle_gets_a_slot_for_every_pass_and_the_solutions_are_visited_again(pool):
    assert text(TakeArcsTogether()(two_choices(pool, pool.var("i1"), pool.var("i2")))) == [
        "REAL sine[8] = {0};",
        "REAL cosine[8] = {0};",
        "REAL angle[8];",
        "int m2[2] = {0};",
        "int i;",
        "if (n1 == 0) { failed(0); return 0; }",
        "for (int i1 = 0; i1 < n1; ++i1) {",
        "    const int n2 = solve(i1);",
        "    if (n2 == 0) { failed(1); }",
        "    m2[i1] = n2;",
        "    for (int i2 = 0; i2 < n2; ++i2) {",
        "        cosine[(4 * i1) + i2] = i1;",
        "        sine[(4 * i1) + i2] = i2;",
        "        found->q[rows][1] = x2;",
        "        found->flags[rows] = 0u;",
        "        found->branch[rows] = 0u;",
        "        found->residual[rows] = e;",
        "        ++rows;",
        "    }",
        "}",
        "ik_arcs(8, sine, cosine, angle);",
        "i = 0;",
        "for (int i1 = 0; i1 < n1; ++i1) {",
        "    for (int i2 = 0; i2 < m2[i1]; ++i2) {",
        "        found->q[i][0] = angle[(4 * i1) + i2];",
        "        ++i;",
        "    }",
        "}",
    ]


@pytest.mark.parametrize(("loops", "slots"), [((), 1), (("i1",), 2), (("i2",), 4), (("i1", "i2"), 8)])
def test_an_angle_has_as_many_slots_as_the_loops_that_it_depends_on_have_passes(pool, loops, slots):
    c = pool.var("c") + sum(pool.var(loop) for loop in loops)
    nest = two_choices(pool, c, pool.var("s"))
    count = Statement(0, ("const int n2 = 4;",), (), (pool.var("n2"),))
    nest = LoopNest((LOOPS[0], RootLoop("i2", "n2", 4, 0)), (nest.items[0], count, *nest.items[2:]))
    assert counted(nest).atan2 == 8
    assert counted(TakeArcsTogether()(nest)).atan2 == slots


@pytest.mark.parametrize(("lanes", "size"), [(1, 8), (3, 9), (16, 16)])
def test_lanes_pad_the_arrays(pool, lanes, size):
    nest = TakeArcsTogether(lanes)(two_choices(pool, pool.var("i1"), pool.var("i2")))
    assert nest.after[0] == f"ik_arcs({size}, sine, cosine, angle);"
    assert counted(nest).atan2 == 8


def flipped(pool, other, formula):
    """An angle known outside the loop, and its flip in the second pass."""
    i1, q, flip = pool.var("i1"), pool.var("q1"), pool.var("q1_2")
    items = [arc(pool, 0, "q1", pool.var("c"), pool.var("s"))]
    if other is not None:
        items.append(arc(pool, 0, other.text, pool.var("c"), -pool.var("s")))
    second = other.text if other is not None else formula.format("q1")
    operands = (i1, q) if other is None else (i1, q, other)
    line = f"const REAL q1_2 = i1 == 0 ? q1 : {second};"
    calls = ("opposite",) if formula else ()
    items.append(Statement(1, (line,), operands, (flip,), calls=calls, flip=Flip("i1", q, other, formula)))
    return LoopNest((LOOPS[0],), (*items, leaf(1, pool.var("e"), (0, flip))))


def test_an_angle_that_follows_from_another_costs_no_arc_tangent(pool):
    nest = TakeArcsTogether()(flipped(pool, None, "ik_opposite({})"))
    assert nest.after[1] == "for (i = 0; i < 1; ++i) { angle[4 + i] = ik_opposite(angle[0 + i]); }"
    assert "    found->q[i][0] = angle[(4 * i1)];" in nest.after
    assert (counted(nest).atan2, counted(nest).add) == (1, 1)


def test_a_flip_between_two_arcs_takes_the_slot_of_either(pool):
    nest = TakeArcsTogether()(flipped(pool, pool.var("p"), ""))
    assert "    found->q[i][0] = angle[(1 * i1)];" in nest.after
    assert counted(nest).atan2 == 2


def test_an_arc_within_a_statement_is_stored_in_its_place(pool):
    q = pool.var("q1")
    lines = ("REAL c = {0};", ARC, "if (c < 0) {", f"    {ARC}", "}")
    whole = Statement(0, lines, (pool.var("x"),), (q,), calls=("unit", "arc"), arc=ArcTangent(q, "c", "-s"))
    nest = LoopNest((), (whole, leaf(0, pool.var("e"), (0, q))))
    assert text(nest)[:5] == [
        "REAL c = x;",
        "REAL q1 = ik_atan2(-s, c);",
        "if (c < 0) {",
        "    q1 = ik_atan2(-s, c);",
        "}",
    ]
    assert text(TakeArcsTogether()(nest))[5:10] == [
        "cosine[0] = c;",
        "sine[0] = -s;",
        "if (c < 0) {",
        "    cosine[0] = c;",
        "    sine[0] = -s;",
    ]


def test_without_arcs_the_nest_stays_the_same_object(pool):
    nest = LoopNest((), (leaf(0, pool.var("e")),))
    assert TakeArcsTogether()(nest) is nest
