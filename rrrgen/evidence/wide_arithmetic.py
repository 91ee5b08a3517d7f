"""Programs in a wider format than the emitted one, by compiled C: what rounding errors at very many states need.

The printer of the emitted code has no part in it: every node is a statement, constants are the sum of two doubles, and
sines come from the C library. In 80-bit long double it takes a few nanoseconds per node and state.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
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


@dataclass(frozen=True)
class WideProgram:
    """A program compiled in the wider format; states are values (states, size) of every input port."""

    ffi: Any
    lib: Any
    narrow: type[Any]
    wide: type[Any]
    sizes: tuple[int, ...]  # of the outputs

    def outputs(self, states: Sequence[Array]) -> Array:
        """All output elements (elements, states) in the wider format."""
        count = len(states[0]) if states else 1
        results = np.empty((count, sum(self.sizes)), dtype=self.wide)
        self.lib.wide_values(count, *self._pointers(states), self.ffi.cast("wide *", results.ctypes.data))
        return results.T

    def errors(self, states: Sequence[Array], rounded: Sequence[Array]) -> Array:
        """The errors (elements, states) of outputs (states, size): their differences from the wider format.

        What the spacing of the wider format may contribute to a difference is taken off.
        """
        count = len(states[0]) if states else 1
        errors = np.empty((sum(self.sizes), count))
        kept = [np.ascontiguousarray(array, dtype=self.narrow) for array in (*states, *rounded)]
        self.lib.wide_errors(count, *self._pointers(kept), self.ffi.cast("double *", errors.ctypes.data))
        return errors

    def _pointers(self, arrays: Sequence[Array]) -> list[Any]:
        if any(array.dtype != self.narrow or not array.flags.c_contiguous for array in arrays):
            raise TypeError(f"states have to be contiguous arrays of {self.narrow.__name__}")
        return [self.ffi.cast("const narrow *", array.ctypes.data) for array in arrays]


def compile_wide(program: Program, precision: Precision) -> WideProgram | None:
    """``program`` compiled in the wider format than ``precision``; None if no compiler is found or it refuses."""
    in_double = precision.name == "double"
    narrow, wide, end = ("double", "long double", "l") if in_double else ("float", "double", "")
    types = f"typedef {narrow} narrow;\ntypedef {wide} wide;\n"
    inputs = "".join(f"const narrow *x{k}, " for k in range(len(program.inputs)))
    given = "".join(f"x{k} + s * {port.size}, " for k, port in enumerate(program.inputs))
    rounded = "".join(f"const narrow *r{k}, " for k in range(len(program.outputs)))
    values = f"void wide_values(long count, {inputs}wide *y)"
    errors = f"void wide_errors(long count, {inputs}{rounded}double *found)"
    order = [index for row in program.results for index in row]
    body = [f"    const wide v{index} = {_expression(program, index, end)};" for index in range(len(program.nodes))]
    body += [f"    y[{place}] = v{index};" for place, index in enumerate(order)]
    differences, first = [], 0
    for k, row in enumerate(program.results):
        differences += [
            f"        for (long e = 0; e < {len(row)}; ++e) {{",
            f"            const wide exact = y[{first} + e];",
            f"            const wide error = fabsl(r{k}[s * {len(row)} + e] - exact) - spacing * fabsl(exact);",
            f"            found[({first} + e) * count + s] = error > 0 || error != error ? (double)error : 0.0;",
            "        }",
        ]
        first += len(row)
    spacing = "LDBL_EPSILON" if in_double else "DBL_EPSILON"
    source = [
        '#include "wide.h"',
        "#include <float.h>",
        "#include <math.h>",
        f"static void at({inputs}wide *y)",
        "{",
        *body,
        "}",
        values,
        "{",
        f"    for (long s = 0; s < count; ++s) at({given}y + s * {len(order)});",
        "}",
        errors,
        "{",
        f"    const wide spacing = {spacing};",
        "    for (long s = 0; s < count; ++s) {",
        f"        wide y[{max(1, len(order))}];",
        f"        at({given}y);",
        *differences,
        "    }",
        "}",
        "",
    ]
    declarations = f"{types}{values};\n{errors};\n"
    try:
        ffi, lib = build_extension({"wide.h": declarations, "wide.c": "\n".join(source)}, declarations, "wide", FLAGS)
    except BuildError:
        return None
    sizes = tuple(len(row) for row in program.results)
    if in_double:
        return WideProgram(ffi, lib, np.float64, np.longdouble, sizes)
    return WideProgram(ffi, lib, np.float32, np.float64, sizes)


def _expression(program: Program, index: int, end: str) -> str:
    node = program.nodes[index]
    if node.op is Op.INPUT:
        port, element = node.place
        return f"x{port}[{element}]"
    if node.op is Op.CONST:
        exact = Fraction(node.number)
        high = float(exact)
        return f"(wide){high.hex()} + (wide){float(exact - Fraction(high)).hex()}"
    return _EXPRESSIONS[node.op].format(*(f"v{arg}" for arg in node.args), l=end)
