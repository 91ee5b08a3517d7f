"""Sharing of operations between programs: the values stay, and each shared operation is computed in one place."""

from __future__ import annotations

import numpy as np

from rrrgen.program import Builder, Op, Port, count_operations, evaluate
from rrrgen.program.sharing import share_values

SINES = (Op.SIN, Op.COS)


def recorded(name: str, inputs: str, value):
    """A program with inputs of two elements each, named by one letter, and the result ``value(b, *inputs)``."""
    b = Builder()
    values = value(b, *(b.input(Port(each, (2,))) for each in inputs))
    return b.program(name, [(Port("y", (len(values),)), values)])


def law(b, q, r):
    return [b.sin(q[0]) * r[0] + b.cos(q[0] + q[1]) * b.sin(r[1]), q[0]]


def observer(b, p, q):
    return [b.cos(q[0] + q[1]) * p[0] - b.sin(b.neg(q[1])) * p[1]]


def test_values_stay_and_sines_move_into_one_function():
    programs = {"law": recorded("law", "qr", law), "observer": recorded("observer", "pq", observer)}
    programs["idle"] = recorded("idle", "pq", lambda b, p, q: [p[0] + q[0]])
    found = share_values(programs, "sines", ("q",), SINES, "Sines.")
    assert set(found) == {"sines", "law", "observer"}, "what uses none stays"
    assert [port.name for port in found["sines"].inputs] == ["q"]
    assert found["sines"].outputs[0].size == 3, "cos(q1 + q2) once, sin(q1) and sin(q2)"
    assert [port.name for port in found["law"].inputs] == ["q", "r", "sines"]
    assert count_operations(found["law"]).sincos == 1, "sin(r2) is no function of q"
    assert count_operations(found["observer"]).sincos == 0
    p, q, r = np.random.default_rng(3).normal(size=(3, 2))
    (sines,) = evaluate(found["sines"], q)
    for name, given in (("law", (q, r)), ("observer", (p, q))):
        expected, got = evaluate(programs[name], *given)[0], evaluate(found[name], *given, sines)[0]
        assert np.array_equal(got, expected), name


def test_one_program_alone_shares_nothing():
    programs = {"law": recorded("law", "qr", law), "idle": recorded("idle", "pq", lambda b, p, q: [p[0] + q[0]])}
    assert share_values(programs, "sines", ("q",), SINES, "") == {}
