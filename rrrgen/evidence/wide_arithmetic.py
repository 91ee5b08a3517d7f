"""Programs in a wider format than the emitted one, by compiled C: what rounding errors at very many states need.

The printer of the emitted code has no part in it: every node is a statement, constants are the sum of two doubles, and
sines come from the C library. In 80-bit long double it takes a few nanoseconds per node and state.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from fractions import Fraction
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rrrgen.base.errors import BuildError
from rrrgen.program import Op
from rrrgen.runtime.build import build_extension

if TYPE_CHECKING:
    from rrrgen.evidence.rounding import Precision
    from rrrgen.program import Program

Array = NDArray[Any]
FLAGS = ("-O1", "-ffp-contract=off")

_EXPRESSIONS = {
    Op.ADD: "{0} + {1}",
    Op.SUB: "{0} - {1}",
    Op.MUL: "{0} * {1}",
    Op.DIV: "{0} / {1}",
    Op.NEG: "-{0}",
    Op.SIN: "sin{l}({0})",
    Op.COS: "cos{l}({0})",
    Op.TANH: "tanh{l}({0})",
    Op.EXP: "exp{l}({0})",
    Op.SQRT: "sqrt{l}({0})",
    Op.ABS: "fabs{l}({0})",
    Op.MIN: "{0} < {1} ? {0} : {1}",
    Op.SIGN: "(wide)(({0} > 0) - ({0} < 0))",
    Op.SELECT: "{0} > 0 ? {1} : {2}",
    Op.NONFINITE: "(wide)!isfinite({0})",
}


def wide_evaluator(program: Program, precision: Precision) -> Callable[[Sequence[Array]], Array] | None:
    """A function from values (states, size) of every input port to those of all output elements (elements, states).

    The inputs are in the emitted precision, the results in the wider format. None where no compiler is found, or it
    does not accept the code.
    """
    in_double = precision.name == "double"
    narrow, wide, end = ("double", "long double", "l") if in_double else ("float", "double", "")
    inputs = "".join(f"const {narrow} *x{k}, " for k in range(len(program.inputs)))
    head = f"void wide_values(long count, {inputs}{wide} *y)"
    lines = [
        f"        const wide v{index} = {_expression(program, index, end)};" for index in range(len(program.nodes))
    ]
    order = [index for row in program.results for index in row]
    lines += [f"        y[{k}L * count + s] = v{index};" for k, index in enumerate(order)]
    source = "\n".join(
        [
            '#include "wide.h"',
            "#include <math.h>",
            f"typedef {wide} wide;",
            head,
            "{",
            "    for (long s = 0; s < count; ++s) {",
            *lines,
            "    }",
            "}",
            "",
        ]
    )
    try:
        ffi, lib = build_extension({"wide.h": f"{head};\n", "wide.c": source}, f"{head};", "wide", FLAGS)
    except BuildError:
        return None
    kind = np.longdouble if in_double else np.float64

    def evaluate(states: Sequence[Array]) -> Array:
        given = [np.ascontiguousarray(state, dtype=np.float64 if in_double else np.float32) for state in states]
        count = len(given[0]) if given else 1
        results = np.empty((len(order), count), dtype=kind)
        pointers = [ffi.cast(f"{narrow} *", state.ctypes.data) for state in given]
        lib.wide_values(count, *pointers, ffi.cast(f"{wide} *", results.ctypes.data))
        return results

    return evaluate


def _expression(program: Program, index: int, end: str) -> str:
    node = program.nodes[index]
    if node.op is Op.INPUT:
        port, element = node.place
        return f"x{port}[s * {program.inputs[port].size} + {element}]"
    if node.op is Op.CONST:
        exact = Fraction(node.number)
        high = float(exact)
        return f"(wide){high.hex()} + (wide){float(exact - Fraction(high)).hex()}"
    return _EXPRESSIONS[node.op].format(*(f"v{arg}" for arg in node.args), l=end)
