"""The steps of a solution: those of the reference robot give its rows, and what is read is compiled."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
import sympy as sp

from ik.checks import sample
from ik.robots import ROWS, make
from rrrgen.emit.latex.inverse_kinematics import closed_form
from rrrgen.ik.classify import plan
from rrrgen.ik.plan import record_exactly
from rrrgen.ik.recording.float_builder import FloatBuilder, every_branch
from rrrgen.ik.singularities import number_chain, symbolic_chain
from rrrgen.robot.file import load_spec

SAME = 1e-9  # rad; the reading form evaluates in double as the emitted code does


def evaluated(form, target: np.ndarray) -> list[np.ndarray]:
    """Rows of all choices of signs; a choice that leaves the real numbers is left out."""
    pairs = [step for step in form.steps if step.either is not None]
    free = set().union(*(step.expression.free_symbols for step in form.steps))
    entries = {symbol: float(target["xyz".index(symbol.name)]) for symbol in free if symbol.name in ("x", "y", "z")}
    rows = []
    for signs in itertools.product((1, -1), repeat=len(pairs)):
        known, sign = {**entries, **dict(form.values)}, iter(signs)
        for step in form.steps:
            value = step.expression + (next(sign) * step.either if step.either is not None else 0)
            known[step.symbol] = complex(value.subs(known)) if value.free_symbols else complex(value)
        found = {str(symbol): value for symbol, value in known.items() if str(symbol).startswith("q_")}
        values = np.array([found[f"q_{k + 1}"] for k in range(len(found))])
        if np.abs(values.imag).max() < SAME:
            rows.append(values.real)
    return rows


def test_the_steps_of_the_reference_robot_give_its_rows():
    form, result = closed_form(make("rrr", ROWS["rrr"])), sample("rrr", N=6)
    for goal in result.T[:, :3, 3]:
        answer = result.solver.solve(goal, limits=False).q
        rows = evaluated(form, goal)
        assert len(rows) == len(answer) > 0
        for row in rows:
            apart = np.abs((answer - row + np.pi) % (2 * np.pi) - np.pi).max(axis=1)
            assert apart.min() < SAME


@pytest.mark.parametrize("name", ["planar2r", "puma560"])
def test_what_is_read_is_what_is_compiled(name):
    """The record that is read, with its symbols replaced by numbers, gives the rows of the record that is printed as C.

    The planar arm needs numbers for a decision; with symbols it once divided by a slope of zero.
    """
    spec = load_spec(name)
    found = plan(spec)
    chain, values = symbolic_chain(spec, found)
    numbers = {symbol: spec.nominal(value) for symbol, value in values}
    parameters = {symbol: spec.parameters[str(symbol)] for link in chain.links for symbol in names(link, spec)}
    exact = record_exactly(found, chain)
    assert (exact is None) == (name == "planar2r")
    exact = exact or record_exactly(found, number_chain(spec, found))
    T = found.chain.forward(np.linspace(0.2, 0.7, found.chain.n))

    def rows(solver):
        return every_branch(
            lambda b: solver.play(Numbers(b, numbers | parameters)),
            lambda script: FloatBuilder(T, [0.1] * found.chain.n, script),
        )

    read, compiled = rows(exact), rows(found.equations)
    assert len(read) == len(compiled) > 0
    np.testing.assert_allclose(read, compiled, atol=1e-9)
    assert "zoo" not in closed_form(spec).text()


def names(link, spec) -> set:
    """The symbols of a link that are named parameters of the robot."""
    entries = (link.a, link.d)
    return {symbol for x in entries for symbol in getattr(x, "free_symbols", ()) if str(symbol) in spec.parameters}


class Numbers:
    """Passes everything to an interpreter in floats, symbols replaced by what they stand for."""

    def __init__(self, builder, values):
        self._builder, self._values = builder, values

    def __getattr__(self, name):
        method = getattr(self._builder, name)
        return lambda *args, **options: method(
            *map(self._float, args), **{k: self._float(v) for k, v in options.items()}
        )

    def _float(self, x):
        if isinstance(x, sp.Basic):
            return float(x.subs(self._values))
        return type(x)(map(self._float, x)) if type(x) is tuple else x
