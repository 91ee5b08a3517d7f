"""Hoisting: statements and values leave the loops on which they do not depend, in the order of the derivation."""

import pytest

from emit.loop_nests import counted, leaf, opened, text
from rrrgen.emit.c.ik.loop_nest import Hoist, LoopNest, RootLoop, Statement
from rrrgen.ik.recording.scalar import Pool


@pytest.fixture
def pool() -> Pool:
    return Pool()


def roots(pool, depth, name, *operands):
    """An equation solved by a kernel, which tells the number of its roots."""
    return Statement(depth, (f"const int {name} = solve({{0}});",), operands, (pool.var(name),))


def two_choices(pool, second):
    """Two loops: over the roots of an equation in ``a``, and inside it over those of one in ``second``."""
    a, i = pool.var("a"), pool.var("i")
    items = (
        roots(pool, 0, "n", a),
        opened(pool, 0, 0, "n"),
        Statement(1, ("const REAL v = {0} == 0 ? w : -w;",), (i,), (pool.var("v"),)),
        roots(pool, 1, "m", second),
        opened(pool, 1, 1, "m"),
        leaf(2, pool.var("v") * pool.var("j") + a * a),
    )
    return LoopNest((RootLoop("i", "n", 2, 0), RootLoop("j", "m", 4, 1)), items)


def test_an_equation_that_does_not_need_a_root_is_solved_outside_its_loop(pool):
    b = pool.var("b")
    nest = two_choices(pool, b * b)
    assert text(Hoist()(nest)) == [
        "const int n = solve(a);",
        "if (n == 0) { failed(0); return 0; }",
        "const int m = solve(b*b);",
        "if (m == 0) { failed(1); return 0; }",
        "const REAL t1 = a*a;",
        "for (int i = 0; i < n; ++i) {",
        "    const REAL v = i == 0 ? w : -w;",
        "    for (int j = 0; j < m; ++j) {",
        "        found->flags[rows] = 0u;",
        "        found->branch[rows] = 0u;",
        "        found->residual[rows] = (v*j) + t1;",
        "        ++rows;",
        "    }",
        "}",
    ]
    assert [loop.level for loop in Hoist()(nest).loops] == [0, 0]


def test_an_equation_in_a_root_stays_inside_its_loop(pool):
    nest = two_choices(pool, pool.var("v") * pool.var("a"))
    hoisted = Hoist()(nest)
    assert [loop.level for loop in hoisted.loops] == [0, 1]
    assert "    if (m == 0) { failed(1); }" in text(hoisted)  # other roots may have some


def test_the_parts_of_a_value_are_computed_where_each_is_known(pool):
    a, b, i = pool.var("a"), pool.var("b"), pool.var("i")
    value = (a * b + i) * (a * b)
    nest = LoopNest((RootLoop("i", "n", 2, 0),), (leaf(1, value),))
    assert counted(nest).as_dict()["mul"] == 2 * 2
    hoisted = Hoist()(nest)
    assert text(hoisted)[0] == "const REAL t1 = a*b;"
    assert counted(hoisted).as_dict()["mul"] == 1 + 2
    assert Hoist()(hoisted) == hoisted


def test_a_variable_changed_in_place_stays_beside_the_statement_that_changes_it(pool):
    a, i, k = pool.var("a"), pool.var("i"), pool.var("k")
    items = (
        Statement(1, ("REAL k = {0};",), (a,), (k,), beside=(i * a,)),
        Statement(1, ("change(&k, {0});",), (i * a, k)),
        leaf(1, k),
    )
    hoisted = Hoist()(LoopNest((RootLoop("i", "n", 2, 0),), items))
    assert [item.depth for item in hoisted.items] == [1, 1, 1]


def test_the_end_of_the_innermost_loop_stays(pool):
    hoisted = Hoist()(LoopNest((RootLoop("i", "n", 2, 0),), (leaf(1, pool.var("a")),)))
    assert hoisted.items[-1].depth == 1
