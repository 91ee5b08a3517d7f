"""Reference evaluation of a program with NumPy: the slow, obviously right way, for any batch shape."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from rrrgen.program.ir import Op, Program

_FUNCTIONS: dict[Op, Callable[..., Any]] = {
    Op.ADD: np.add,
    Op.SUB: np.subtract,
    Op.MUL: np.multiply,
    Op.DIV: np.divide,
    Op.NEG: np.negative,
    Op.SIN: np.sin,
    Op.COS: np.cos,
    Op.SQRT: np.sqrt,
    Op.ABS: np.abs,
    Op.SIGN: np.sign,
    Op.EXP: np.exp,
    Op.TANH: np.tanh,
    Op.SELECT: lambda c, x, y: np.where(c > 0, x, y),
}


def evaluate(program: Program, *inputs: Any) -> tuple[np.ndarray, ...]:
    """Evaluate ``program``; every input has shape (..., *port.shape) with one common batch shape ``...``.

    Returns one array (..., *port.shape) per output.
    """
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
        else:
            values.append(_FUNCTIONS[node.op](*(values[arg] for arg in node.args)))
    return tuple(
        np.stack([np.broadcast_to(values[e], batch) for e in elements], axis=-1).reshape((*batch, *port.shape))
        if elements
        else np.zeros((*batch, *port.shape))
        for port, elements in zip(program.outputs, program.results, strict=True)
    )
