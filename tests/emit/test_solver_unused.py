"""Unused definitions are left out, and what only they needed with them."""

from emit.loop_nests import leaf, text
from rrrgen.emit.c.ik.loop_nest import DropUnused, LoopNest, Statement
from rrrgen.ik.recording.scalar import Pool


def definition(pool, name, value, optional=True):
    return Statement(0, (f"const REAL {name} = {{0}};",), (value,), (pool.var(name),), optional)


def test_definitions_that_nothing_uses_are_left_out():
    pool = Pool()
    a, b = pool.var("a"), pool.var("b")
    items = (
        definition(pool, "first", a / b),
        definition(pool, "second", pool.var("first") * b),
        definition(pool, "used", a * a),
        definition(pool, "needed", a - b, optional=False),
        leaf(0, pool.var("used") + b),
    )
    nest = LoopNest((), items)
    assert text(DropUnused()(nest))[:3] == [
        "const REAL used = a*a;",
        "const REAL needed = a - b;",
        "found->flags[rows] = 0u;",
    ]
    assert text(nest)[:2] == ["const REAL first = a/b;", "const REAL second = first*b;"]


def test_of_several_variables_one_reader_is_enough():
    pool = Pool()
    both = Statement(0, ("const REAL x = 1, y = 2;",), (), (pool.var("x"), pool.var("y")), optional=True)
    assert DropUnused()(LoopNest((), (both, leaf(0, pool.var("y"))))).items[0] is both
    assert len(DropUnused()(LoopNest((), (both, leaf(0, pool.var("z"))))).items) == 1
