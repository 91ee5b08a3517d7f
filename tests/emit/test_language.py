"""Programs as C statements: the values, the spelling, and the rules that readers rely on."""

from __future__ import annotations

import re
from fractions import Fraction

import numpy as np
import pytest

from emit.casadi_cases import arguments, random_program
from rrrgen.base.errors import BackendError
from rrrgen.emit.c.batches import declarations
from rrrgen.emit.c.header_comments import prototype
from rrrgen.emit.c.language import Dialect, LibmSinCos, print_body
from rrrgen.emit.printing import decimal
from rrrgen.program import Builder, Port, Program, Role, Status, evaluate
from rrrgen.runtime.build import build_extension

DIALECT = Dialect("t")
ROUND_OFF = 1e-12  # relative; sine, cosine, exp of libm and of NumPy differ in the last bit, random programs amplify it

HEADER = """#ifndef T_H
#define T_H
#define T_RESTRICT restrict
typedef double t_real;
{prototypes}
#endif
"""


def build(programs: list[Program]):
    """All programs in one extension."""
    prototypes = "\n".join(f"{prototype(program, DIALECT)};" for program in programs)
    functions = [
        "\n".join([prototype(program, DIALECT), "{", *print_body(program, DIALECT), "}"]) for program in programs
    ]
    sources = {
        "t.h": HEADER.format(prototypes=prototypes),
        "t.c": "\n".join(['#include "t.h"', "#include <math.h>", *functions, ""]),
    }
    lines = [line for line in declarations(programs, DIALECT).splitlines() if "_loop_" not in line]
    return build_extension(sources, "\n".join(lines), "printer")


def call(ffi, lib, program: Program, values: list[np.ndarray]) -> list[np.ndarray]:
    inputs = [
        float(value) if port.shape == () else ffi.from_buffer("double[]", np.ascontiguousarray(value))
        for port, value in zip(program.inputs, values, strict=True)
    ]
    outputs = [np.full(max(port.size, 1), np.nan) for port in program.outputs]
    getattr(lib, f"t_{program.name}")(*inputs, *(ffi.from_buffer("double[]", array) for array in outputs))
    return [array.reshape(port.shape) for array, port in zip(outputs, program.outputs, strict=True)]


def test_random_programs_compute_what_the_reference_evaluation_does():
    rng = np.random.default_rng(3)
    programs = [random_program(rng, f"f{k}", nodes=int(rng.integers(5, 60))) for k in range(120)]
    ffi, lib = build(programs)
    for program in programs:
        for _ in range(4):
            values = arguments(program, rng)
            for result, expected in zip(call(ffi, lib, program, values), evaluate(program, *values), strict=True):
                np.testing.assert_allclose(result, expected, rtol=ROUND_OFF, atol=ROUND_OFF, err_msg=program.name)


def arithmetic(rng: np.random.Generator, name: str) -> Program:
    """Operations that IEEE 754 defines to the last bit, so that only a wrong association can change the result."""
    b = Builder()
    values = [*b.input(Port("x", (5,))), *b.input(Port("y", (3,))), Fraction(1, 3), Fraction(-7, 5), 4]
    for _ in range(50):
        x, y, z = (values[int(i)] for i in rng.integers(0, len(values), 3))
        kind = ("add", "sub", "mul", "add", "sub", "mul", "div", "neg", "sqrt", "select", "sign")[rng.integers(11)]
        if kind == "div":
            values.append(b.div(x, b.add(1, b.mul(y, y))))
        elif kind == "sqrt":
            values.append(b.sqrt(b.abs(x)))
        elif kind == "select":
            values.append(b.select(x, y, z))
        else:
            values.append(getattr(b, kind)(*((x,) if kind in ("neg", "sign") else (x, y))))
    return b.program(name, [(Port("r", (30,)), values[-30:])])


def test_arithmetic_rounds_exactly_as_the_reference():
    rng = np.random.default_rng(5)
    programs = [arithmetic(rng, f"g{k}") for k in range(60)]
    ffi, lib = build(programs)
    for program in programs:
        values = [rng.normal(size=port.shape) for port in program.inputs]
        with np.errstate(over="ignore", invalid="ignore"):
            (expected,) = evaluate(program, *values)
        (result,) = call(ffi, lib, program, values)
        np.testing.assert_array_equal(result, expected, err_msg=program.name)


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (Fraction(0), "0.0"),
        (Fraction(2), "2.0"),
        (Fraction(7, 20), "0.35"),
        (Fraction(-981, 100), "-9.81"),
        (Fraction(1, 3), "0.33333333333333331"),
        (Fraction(2, 3), "0.66666666666666663"),
        (Fraction(10) ** 22, "1e+22"),
        (Fraction(1, 10**7), "1e-07"),
        (Fraction(31415926535897932384626433832795028841971, 10**40), "3.1415926535897931"),
    ],
)
def test_literals_read_back_to_the_nearest_double(value, text):
    assert decimal(value) == text
    assert float(text) == float(value)


@pytest.mark.parametrize("value", [Fraction(10) ** 400, Fraction(1, 10**400)])
def test_constants_beyond_a_double_are_refused(value):
    with pytest.raises(BackendError, match="does not fit"):
        decimal(value)


@pytest.mark.parametrize("value", [Fraction(10) ** 39, Fraction(-1, 10**39)])
def test_constants_beyond_a_float_are_refused_in_single_precision(value):
    assert float(DIALECT.literal(value).removeprefix("(t_real)")) == float(value)
    with pytest.raises(BackendError, match="does not fit a float"):
        Dialect("t", "float").literal(value)


def planar() -> Program:
    b = Builder()
    q = b.input(Port("angles", (3,), role=Role.POSITION))
    q23 = q[1] + q[2]
    c23 = b.cos(q23)
    x = b.label(c23 * c23 + 1, "for")
    return b.program("f", [(Port("y", (4,)), [x * b.sin(q23), b.sin(q[1]), x - b.sin(b.sin(q[0])), -(q[0] + x)])])


def test_each_angle_is_evaluated_once_under_a_readable_name():
    code = "\n".join(print_body(planar(), DIALECT))
    assert "const t_real q23 = angles[1] + angles[2];" in code
    assert "const t_real s23 = sin(q23);" in code
    assert "const t_real c23 = cos(q23);" in code
    assert "y[1] = s2;" in code
    assert len(re.findall(r"\b(sin|cos)\(", code)) == 5
    assert re.search(r"\bfor_2 = ", code), "a keyword must not become a name"


def test_float_uses_the_functions_of_single_precision():
    code = "\n".join(print_body(planar(), Dialect("t", "float")))
    assert "sinf(q23)" in code
    assert not re.search(r"\b(sin|cos|sqrt)\(", code)


def test_a_strategy_for_sine_and_cosine_can_be_exchanged():
    class Pair(LibmSinCos):
        def statements(self, dialect, angle, sine, cosine):
            return [f"{dialect.prefix}_sincos({angle}, {sine}, {cosine});"]

    assert "t_sincos(q23, s23, c23);" in print_body(planar(), DIALECT, Pair())


def test_lines_stay_short_and_every_local_is_used():
    rng = np.random.default_rng(11)
    for k in range(60):
        program = random_program(rng, f"f{k}", nodes=80)
        lines = print_body(program, DIALECT)
        code = "\n".join(lines)
        assert max(map(len, lines)) < 150
        for name in re.findall(r"const t_real (\w+) =", code):
            assert len(re.findall(rf"\b{name}\b", code)) > 1, name


def test_printing_takes_time_proportional_to_the_program():
    b = Builder()
    x, y = b.input(Port("x", (2,)))
    for k in range(20_000):
        x, y = b.label(x * y + k, "t"), y + x
    lines = print_body(b.program("f", [(Port("z", (2,)), [x, y])]), DIALECT)
    assert len(lines) > 20_000


def test_outputs_of_one_value_are_copied_and_constants_written():
    b = Builder()
    x = b.input(Port("x", (2,)))
    M = [x[0] * x[1], 0, 0, x[0] * x[1]]
    assert print_body(b.program("f", [(Port("M", (2, 2)), M)]), DIALECT) == [
        "M[0] = x[0]*x[1];",
        "M[3] = M[0];",
        "M[1] = (t_real)0.0;",
        "M[2] = (t_real)0.0;",
    ]


def test_an_input_that_is_not_read_is_discarded():
    b = Builder()
    b.input(Port("q", (2,)))
    y = b.input(Port("y", ()))
    assert print_body(b.program("f", [(Port("r", ()), y)]), DIALECT) == ["(void)q;", "*r = y;"]


def test_the_status_becomes_the_return_value_and_nan_is_not_ok():
    b = Builder()
    x = b.input(Port("x", (1,)))[0]
    outputs = [(Port("r", (1,)), [x]), (Port("code", ()), [b.select(x, 0, 1)])]
    program = b.program("f", outputs, status=Status.of(1, "too cold", "the oil is too cold", "x is not positive"))
    assert prototype(program, DIALECT) == "t_status f(const t_real x[1], t_real r[T_RESTRICT 1])".replace("f(", "t_f(")
    last = print_body(program, DIALECT)[-1]
    assert last.startswith("return (")
    assert last.endswith("< (t_real)0.5) ? T_OK : T_TOO_COLD;")
