"""Reference evaluation of a program, node by node: slow, simple, with floats or with NumPy arrays of any batch shape.

Floats need no NumPy, and their sines, cosines and exponentials are correctly rounded, as the four operations and the
square root are by IEEE 754: the same program and inputs give the same bits on every machine. That is why the golden
values of the emitted self-test come from them. The mathematics libraries of two systems differ in the last bit of a
sine, and NumPy's differ even between two processors.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import TYPE_CHECKING, Any

from rrrgen.program.program import Op, Program

if TYPE_CHECKING:
    import numpy as np

Function = Callable[..., Any]

# ------------------------------------------------------------------------------------------------------------------
# The walk over the nodes, the same for floats and arrays
# ------------------------------------------------------------------------------------------------------------------


def _walk(program: Program, inputs: Sequence[Callable[[int], Any]], functions: dict[Op, Function]) -> list[list[Any]]:
    """The elements of every output; ``inputs`` returns an element of an input, ``functions`` compute the operations."""
    values: list[Any] = []
    for node in program.nodes:
        if node.op is Op.INPUT:
            position, element = node.place
            values.append(inputs[position](element))
        elif node.op is Op.CONST:
            values.append(float(node.number))
        else:
            values.append(functions[node.op](*(values[arg] for arg in node.args)))
    return [[values[e] for e in elements] for elements in program.results]


# ------------------------------------------------------------------------------------------------------------------
# Floats
# ------------------------------------------------------------------------------------------------------------------


def evaluate_floats(program: Program, *inputs: Sequence[float]) -> list[list[float]]:
    """Evaluate ``program`` for one state in double precision, with lists instead of arrays.

    Every input is a sequence of its ``port.size`` elements, row-major. Returns one list per output, row-major as well;
    an operation without a result gives NaN or infinity, as in C. Raises ValueError for a wrong number of elements.
    """
    for port, values in zip(program.inputs, inputs, strict=True):
        if len(values) != port.size:
            raise ValueError(f"{program.name}: {port.name} must have {port.size} elements, got {len(values)}")
    return _walk(program, [values.__getitem__ for values in inputs], _FLOATS)


def _divide(x: float, y: float) -> float:
    if y == 0.0:
        return math.nan if x == 0.0 or math.isnan(x) else math.copysign(math.inf, x) * math.copysign(1.0, y)
    return x / y


def _sqrt(x: float) -> float:
    return math.sqrt(x) if not x < 0.0 else math.nan


def _sign(x: float) -> float:
    return x if x == 0.0 or math.isnan(x) else math.copysign(1.0, x)


def _rounded_function(name: str) -> Function:
    """The function ``name`` of the library mpmath with the result rounded to the nearest float.

    120 bits leave no doubt about the 53 of a float, but for the argument that nobody will meet (the table maker's
    dilemma, Muller et al., Handbook of Floating-Point Arithmetic, ch. 10).
    """

    @lru_cache(maxsize=4096)
    def function(x: float) -> float:
        from mpmath import libmp

        if not math.isfinite(x):
            return _of_infinity(name, x)
        if name == "exp" and abs(x) > 800.0:
            return math.inf if x > 0.0 else 0.0
        return float(libmp.to_float(getattr(libmp, f"mpf_{name}")(libmp.from_float(x), 120, "n"), rnd="n"))

    return function


def _of_infinity(name: str, x: float) -> float:
    if math.isnan(x) or name in ("sin", "cos"):
        return math.nan
    return math.copysign(1.0, x) if name == "tanh" else (math.inf if x > 0.0 else 0.0)


_FLOATS: dict[Op, Function] = {
    Op.ADD: lambda x, y: x + y,
    Op.SUB: lambda x, y: x - y,
    Op.MUL: lambda x, y: x * y,
    Op.DIV: _divide,
    Op.NEG: lambda x: -x,
    Op.SIN: _rounded_function("sin"),
    Op.COS: _rounded_function("cos"),
    Op.SQRT: _sqrt,
    Op.ABS: abs,
    Op.SIGN: _sign,
    Op.EXP: _rounded_function("exp"),
    Op.TANH: _rounded_function("tanh"),
    Op.MIN: lambda x, y: math.nan if math.isnan(x) or math.isnan(y) else min(x, y),
    Op.SELECT: lambda condition, positive, otherwise: positive if condition > 0 else otherwise,
    Op.NONFINITE: lambda x: 2.0 if math.isnan(x) else float(math.isinf(x)),
}

# ------------------------------------------------------------------------------------------------------------------
# Arrays
# ------------------------------------------------------------------------------------------------------------------

_UNIVERSAL = {
    Op.ADD: "add",
    Op.SUB: "subtract",
    Op.MUL: "multiply",
    Op.DIV: "divide",
    Op.NEG: "negative",
    Op.SIN: "sin",
    Op.COS: "cos",
    Op.SQRT: "sqrt",
    Op.ABS: "abs",
    Op.SIGN: "sign",
    Op.EXP: "exp",
    Op.TANH: "tanh",
    Op.MIN: "minimum",
}
"""Name of the NumPy function for each operation."""


def evaluate(program: Program, *inputs: Any) -> tuple[np.ndarray, ...]:
    """Evaluate ``program`` in double precision with NumPy.

    Every input is an array of shape (..., *port.shape); the batch shapes ``...`` are broadcast against each other.
    Returns one array of shape (..., *port.shape) per output. Raises ValueError for a wrong shape.
    """
    import numpy as np

    arrays = [np.asarray(value, dtype=float) for value in inputs]
    flat, batches = [], []
    for port, array in zip(program.inputs, arrays, strict=True):
        rank = len(port.shape)
        batch = array.shape[: array.ndim - rank]
        if array.shape[array.ndim - rank :] != port.shape:
            raise ValueError(f"{program.name}: {port.name} must have shape (..., {port.shape}), got {array.shape}")
        batches.append(batch)
        flat.append(np.moveaxis(array.reshape((*batch, port.size)), -1, 0))
    batch = np.broadcast_shapes(*batches) if batches else ()
    functions: dict[Op, Function] = {op: getattr(np, name) for op, name in _UNIVERSAL.items()}
    functions[Op.SELECT] = lambda condition, positive, otherwise: np.where(condition > 0, positive, otherwise)
    functions[Op.NONFINITE] = lambda x: np.where(np.isnan(x), 2.0, np.isinf(x))
    results = _walk(program, [array.__getitem__ for array in flat], functions)
    return tuple(
        np.stack([np.broadcast_to(value, batch) for value in values], axis=-1).reshape((*batch, *port.shape))
        if values
        else np.zeros((*batch, *port.shape))
        for port, values in zip(program.outputs, results, strict=True)
    )
