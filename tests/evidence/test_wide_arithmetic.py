"""Programs compiled in the wider format give the values and errors of the same operations in NumPy."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest

from rrrgen.evidence.rounding import DOUBLE, FLOAT
from rrrgen.evidence.sampling import _evaluate_nodes, errors_at
from rrrgen.evidence.wide_arithmetic import compile_wide
from rrrgen.program import Builder, Port


@pytest.fixture(scope="module")
def program():
    """Every operation once, two input ports and two outputs, one of them a constant and an input."""
    b = Builder()
    q, x = b.input(Port("q", (2,))), b.input(Port("x", (3,)))
    s, c = b.sin(q[0] + q[1]), b.cos(q[0])
    values = [
        s * x[0] - c * x[1],
        b.div(s, b.exp(x[2])),
        b.neg(b.sqrt(b.abs(x[0]))),
        b.min(s, b.tanh(x[1])),
        b.select(x[0] - x[1], s, b.sign(x[2])),
        b.nonfinite(c),
        Fraction(1, 3) * x[2],
    ]
    return b.program("f", [(Port("a", (7,)), values), (Port("b", (2,)), [Fraction(1, 10), x[1]])])


@pytest.mark.parametrize("precision", [DOUBLE, FLOAT], ids=lambda precision: precision.name)
def test_values_and_errors_are_those_of_numpy(program, precision):
    kind, wide = (np.float64, np.longdouble) if precision is DOUBLE else (np.float32, np.float64)
    rng = np.random.default_rng(2)
    states = [rng.uniform(-3, 3, (500, 2)).astype(kind), rng.uniform(-1, 1, (500, 3)).astype(kind)]
    states[1][::5, 2] = 0.0  # the sign of zero
    values = _evaluate_nodes(program, states, precision, wide)
    expected = np.stack([np.broadcast_to(values[index], 500) for row in program.results for index in row])
    compiled = compile_wide(program, precision)
    got = compiled.outputs(states)
    assert got.dtype == wide
    assert (np.abs(got - expected) <= 4 * np.finfo(wide).eps * np.abs(expected)).all()

    def rounded(given):
        outputs = _evaluate_nodes(program, given, precision, None)
        return [np.stack([np.broadcast_to(outputs[k], 500) for k in row], axis=1) for row in program.results]

    errors = compiled.errors(states, rounded(states))
    assert errors == pytest.approx(errors_at(program, states, precision, rounded), rel=1e-2, abs=1e-19)
    assert errors.max() > 0.1 * precision.roundoff


def test_an_error_that_is_no_number_is_seen(program):
    compiled = compile_wide(program, DOUBLE)
    states = [np.zeros((1, 2)), np.zeros((1, 3))]
    outputs = [np.full((1, 7), np.nan), np.zeros((1, 2))]
    assert np.isnan(compiled.errors(states, outputs)[:7]).all()


def test_states_of_another_type_are_refused(program):
    with pytest.raises(TypeError, match="contiguous arrays of float64"):
        compile_wide(program, DOUBLE).outputs([np.zeros((1, 2), dtype=np.float32), np.zeros((1, 3))])


def test_without_a_compiler_there_is_none(program, monkeypatch):
    monkeypatch.setenv("CC", "no-such-compiler")
    assert compile_wide(program, DOUBLE) is None
