"""Reference evaluation: values, batches, and what it refuses."""

from __future__ import annotations

import mpmath
import numpy as np
import pytest

from rrrgen.program import Builder, OperationCount, Port, Program, count_operations, evaluate, evaluate_floats


def two_ports() -> Program:
    """A (2, 2) and a scalar output from a vector and a scalar input, and an empty one."""
    b = Builder()
    x, y = b.input(Port("x", (2,)))
    (k,) = b.input(Port("k", ()))
    outputs = [
        (Port("A", (2, 2)), [b.sin(x), b.cos(y) * k, 3, x / y]),
        (Port("s", ()), [b.select(k, x, y)]),
        (Port("none", (0, 3)), []),
    ]
    return b.program("two_ports", outputs)


def test_one_state():
    A, s, none = evaluate(two_ports(), [0.3, 0.5], 2.0)
    assert np.allclose(A, [[np.sin(0.3), 2 * np.cos(0.5)], [3, 0.6]], rtol=1e-15)
    assert s.shape == ()
    assert s == 0.3
    assert none.shape == (0, 3)


def test_select_takes_the_second_value_at_zero():
    for k, expected in ((1.0, 0.3), (0.0, 0.5), (-0.0, 0.5), (-1.0, 0.5)):
        assert evaluate(two_ports(), [0.3, 0.5], k)[1] == expected


def test_batches_broadcast_against_each_other():
    x = np.arange(12.0).reshape(3, 2, 2) + 1
    k = np.array([[1.0], [0.0], [-1.0]])
    A, s, none = evaluate(two_ports(), x, k)
    assert (A.shape, s.shape, none.shape) == ((3, 2, 2, 2), (3, 2), (3, 2, 0, 3))
    for index in np.ndindex(3, 2):
        single = evaluate(two_ports(), x[index], k[index[0], 0])
        assert np.array_equal(A[index], single[0])
        assert s[index] == single[1]


def test_an_empty_batch():
    A, s, _ = evaluate(two_ports(), np.zeros((0, 2)), 1.0)
    assert A.shape == (0, 2, 2)
    assert s.shape == (0,)


def test_a_program_without_inputs():
    b = Builder()
    program = b.program("constant", [(Port("c", (2,)), [1, 2])])
    assert np.array_equal(evaluate(program)[0], [1.0, 2.0])


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (([0.1, 0.2, 0.3], 1.0), r"two_ports: x must have shape \(\.\.\., \(2,\)\), got \(3,\)"),
        ((0.1, 1.0), "x must have shape"),
        ((np.zeros((3, 2)), np.zeros(4)), "broadcast"),
        (([0.1, 0.2],), "zip"),
    ],
)
def test_wrong_shapes_are_refused(arguments, complaint):
    with pytest.raises(ValueError, match=complaint):
        evaluate(two_ports(), *arguments)


def test_sizes_of_ports():
    assert Port("T", (3, 4, 4)).size == 48
    assert Port("s", ()).size == 1
    assert Port("none", (0, 3)).size == 0


def test_counting_operations():
    b = Builder()
    x, y, z = b.input(Port("x", (3,)))
    values = [b.sin(x) * b.cos(x), b.cos(y), x / y - z, b.sqrt(x), -(x * y), b.select(x, y, z), b.abs(z), 3]
    count = count_operations(b.program("f", [(Port("y", (len(values),)), values)]))
    # the sine and the cosine of x are one angle; a change of sign and a choice are not counted in the total
    assert count == OperationCount(mul=2, add=1, div=1, sqrt=1, sincos=2, neg=1, other=2)
    assert count.total == 5
    assert str(count) == "2 mul, 1 add, 1 div, 1 sqrt, 2 sincos, 1 neg, 2 other"
    assert count.as_dict()["sincos"] == 2


def every_operation() -> Program:
    """Every operation with two inputs, an output each."""
    b = Builder()
    x, y = b.input(Port("x", (2,)))
    values = [x + y, x - y, x * y, x / y, -x, b.sin(x), b.cos(x), b.sqrt(x), b.abs(x), b.sign(x), b.exp(x), b.tanh(x)]
    values += [b.min(x, y), b.select(x, y, 7), b.nonfinite(x)]
    return b.program("every", [(Port("z", (len(values),)), values)])


def test_floats_give_the_values_of_arrays_in_special_cases_too():
    numbers = [0.0, -0.0, 1.0, -2.5, 1e-310, 900.0, -900.0, 1e308, np.inf, -np.inf, np.nan]
    program = every_operation()
    for x in numbers:
        for y in numbers:
            with np.errstate(all="ignore"):
                expected = evaluate(program, [x, y])[0]
            np.testing.assert_allclose(evaluate_floats(program, [x, y])[0], expected, rtol=1e-15, err_msg=f"{x}, {y}")


def test_functions_of_floats_are_rounded_to_nearest():
    b = Builder()
    (x,) = b.input(Port("x", (1,)))
    functions = {"sin": b.sin, "cos": b.cos, "exp": b.exp, "tanh": b.tanh}
    program = b.program("f", [(Port("y", (4,)), [function(x) for function in functions.values()])])
    for angle in np.random.default_rng(3).uniform(-3.0, 3.0, 200):
        (values,) = evaluate_floats(program, [float(angle)])
        with mpmath.workdps(60):
            for value, name in zip(values, functions, strict=True):
                exact, ulp = getattr(mpmath, name)(mpmath.mpf(float(angle))), float(np.spacing(abs(value)))
                assert abs(mpmath.mpf(value) - exact) <= 0.5000001 * ulp


def test_floats_of_a_wrong_number_are_refused():
    with pytest.raises(ValueError, match="x must have 2 elements, got 3"):
        evaluate_floats(two_ports(), [0.1, 0.2, 0.3], [1.0])
