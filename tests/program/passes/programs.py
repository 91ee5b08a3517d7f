"""Random programs, and their values to sixty digits."""

from __future__ import annotations

from fractions import Fraction

import mpmath
from hypothesis import strategies as st

from rrrgen.program import Builder, Op, Port, Program, Role, Value

DIGITS = 60
PORTS = (
    Port("q", (3,), role=Role.POSITION),
    Port("dq", (2,), role=Role.VELOCITY),
    Port("beta", (3,), role=Role.BASE_PARAMETERS),
)
"""What decides where expansions are cut: positions, rates, parameters."""

NUMBERS = [Fraction(1, 2), Fraction(-3), Fraction(2), Fraction(7, 5), Fraction(0), Fraction(1)]
STEPS = ("add", "sub", "mul", "neg", "sin", "cos", "number", "div", "select", "sqrt")


def build(steps: list[tuple[str, int, int, int]], outputs: list[int]) -> Program:
    """The program of random steps: every step works on earlier values, chosen by its numbers."""
    b = Builder()
    ports = [b.input(port) for port in PORTS]
    values: list[Value] = [x for port in ports for x in port]
    q = ports[0]
    values += [b.sin(q[0]), b.cos(q[0]), b.sin(q[1] + q[2]), b.cos(q[1] + q[2]), b.cos(q[2] + Fraction(7, 10))]
    for name, i, j, k in steps:
        x, y, z = (values[number % len(values)] for number in (i, j, k))
        match name:
            case "number":
                values.append(b.mul(NUMBERS[i % len(NUMBERS)], y))
            case "sin" | "cos":  # of sums of positions, as models have them
                values.append(getattr(b, name)(b.add(q[i % 3], q[j % 3])))
            case "div":
                values.append(b.div(x, b.add(b.mul(y, y), 1)))
            case "sqrt":
                values.append(b.sqrt(b.add(b.mul(x, x), 1)))
            case "neg":
                values.append(b.neg(x))
            case "select":
                values.append(b.select(x, y, z))
            case _:
                values.append(getattr(b, name)(x, y))
    chosen = [values[-1 - number % len(values)] for number in outputs]
    return b.program("random", [(Port("y", (len(chosen),)), chosen)])


NUMBER = st.integers(0, 60)


def programs(steps: tuple[str, ...] = STEPS, size: int = 25) -> st.SearchStrategy[Program]:
    """Random programs of up to ``size`` steps."""
    step = st.tuples(st.sampled_from(steps), NUMBER, NUMBER, NUMBER)
    return st.builds(build, st.lists(step, min_size=1, max_size=size), st.lists(NUMBER, min_size=1, max_size=6))


ARITHMETIC = ("add", "sub", "mul", "neg", "sin", "cos", "number")


def precise(program: Program, inputs: list[list[Fraction]]) -> list[mpmath.mpf]:
    """All results, row by row, computed with sixty digits."""
    functions = {
        Op.ADD: lambda x, y: x + y,
        Op.SUB: lambda x, y: x - y,
        Op.MUL: lambda x, y: x * y,
        Op.DIV: lambda x, y: x / y,
        Op.NEG: lambda x: -x,
        Op.SIN: mpmath.sin,
        Op.COS: mpmath.cos,
        Op.SQRT: mpmath.sqrt,
        Op.SELECT: lambda c, x, y: x if c > 0 else y,
    }
    with mpmath.workdps(DIGITS):
        values = []
        for node in program.nodes:
            if node.op is Op.INPUT:
                port, element = node.place
                number = inputs[port][element]
                values.append(mpmath.mpf(number.numerator) / number.denominator)
            elif node.op is Op.CONST:
                values.append(mpmath.mpf(node.number.numerator) / node.number.denominator)
            else:
                values.append(functions[node.op](*(values[arg] for arg in node.args)))
        return [values[index] for row in program.results for index in row]


STATE = [
    [Fraction(3, 7), Fraction(-11, 9), Fraction(5, 8)],
    [Fraction(-9, 7), Fraction(13, 11)],
    [Fraction(17, 6), Fraction(-4, 13), Fraction(8, 19)],
]
"""One state with no small or equal numbers among its values."""


def recorded(function) -> Program:
    """A program over :data:`PORTS` with one output, the values that ``function(builder, q, dq, beta)`` returns."""
    b = Builder()
    values = function(b, *(b.input(port) for port in PORTS))
    return b.program("f", [(Port("y", (len(values),)), values)])


def body(program: Program) -> list[str]:
    """The definitions, the output and the operations of a recorded program, as text."""
    lines = [line.strip() for line in program.dump().splitlines()[1:]]
    return [line for line in lines if not line.startswith(("in ", "out "))]


def same_values(one: Program, two: Program, inputs: list[list[Fraction]] = STATE) -> bool:
    """Whether the results agree to 20 digits of the largest, far beyond chance, far above the error of 60 digits.

    Where a choice hangs on a value that vanishes but for rounding, the programs are not compared.
    """
    x, y = precise(one, inputs), precise(two, inputs)
    size = max([mpmath.mpf(1), *map(abs, x), *map(abs, y)])
    return all(abs(u - v) <= size * mpmath.mpf(10) ** -20 for u, v in zip(x, y, strict=True))
