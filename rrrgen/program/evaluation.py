"""Reference evaluation of a program with NumPy, node by node: slow, simple, for inputs of any batch shape."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from rrrgen.program.program import Op, Program

if TYPE_CHECKING:
    import numpy as np

_FUNCTIONS = {
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
    """Evaluate ``program`` in double precision.

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
        flat.append(array.reshape((*batch, port.size)))
    batch = np.broadcast_shapes(*batches) if batches else ()
    values: list[Any] = []
    for node in program.nodes:
        if node.op is Op.INPUT:
            position, element = node.place
            values.append(flat[position][..., element])
        elif node.op is Op.CONST:
            values.append(float(node.number))
        elif node.op is Op.SELECT:
            condition, positive, otherwise = (values[arg] for arg in node.args)
            values.append(np.where(condition > 0, positive, otherwise))
        elif node.op is Op.NONFINITE:
            value = values[node.args[0]]
            values.append(np.where(np.isnan(value), 2.0, np.isinf(value)))
        else:
            values.append(getattr(np, _FUNCTIONS[node.op])(*(values[arg] for arg in node.args)))
    return tuple(
        np.stack([np.broadcast_to(values[e], batch) for e in elements], axis=-1).reshape((*batch, *port.shape))
        if elements
        else np.zeros((*batch, *port.shape))
        for port, elements in zip(program.outputs, program.results, strict=True)
    )
