"""Test vectors: states inside the proven box with the outputs of exact arithmetic, to check a target with.

Everything is computed with 50 digits, and the states come from Python's own generator: the same bytes on every machine.
"""

from __future__ import annotations

import random
from collections.abc import Mapping, Sequence
from typing import Any

import mpmath
import numpy as np

from rrrgen.evidence.boxes import PortRange
from rrrgen.evidence.sampling import ARITHMETIC
from rrrgen.program import Op, Program

DIGITS = 50
"""Digits of the arithmetic that counts as exact."""


def test_vectors(
    program: Program, box: Mapping[str, PortRange], single: bool, states: int, seed: int
) -> list[dict[str, Any]]:
    """``states`` random states inside ``box``, representable in float where ``single``, with the exact outputs.

    Each is {"inputs": {name: elements}, "outputs": {name: elements}}, row-major, outputs rounded to double.
    """
    generator = random.Random(f"{seed} {program.name}")
    vectors = []
    for _ in range(states):
        inputs = []
        for port in program.inputs:
            bounds = zip(*box[port.name].bounds, strict=True)
            values = [generator.uniform(low, high) for low, high in bounds]
            inputs.append([float(np.float32(value)) if single else value for value in values])
        outputs = exact_outputs(program, inputs)
        named = {port.name: values for port, values in zip(program.inputs, inputs, strict=True)}
        results = {
            port.name: [float(value) for value in row] for port, row in zip(program.outputs, outputs, strict=True)
        }
        vectors.append({"inputs": named, "outputs": results})
    return vectors


def exact_outputs(program: Program, inputs: list[list[float]]) -> list[list[Any]]:
    """The outputs of ``program`` with 50 digits, one list of mpmath numbers per output port."""
    values = exact_values(program, inputs)
    return [[values[index] for index in row] for row in program.results]


def exact_values(program: Program, inputs: Sequence[Sequence[Any]]) -> list[Any]:
    """The values of all nodes of ``program`` with 50 digits, as mpmath numbers."""
    with mpmath.workdps(DIGITS):
        values: list[Any] = []
        for node in program.nodes:
            op, x = node.op, [values[arg] for arg in node.args]
            if op is Op.INPUT:
                port, element = node.place
                values.append(mpmath.mpf(inputs[port][element]))
            elif op is Op.CONST:
                values.append(mpmath.mpf(node.number.numerator) / mpmath.mpf(node.number.denominator))
            elif op in ARITHMETIC:
                values.append(ARITHMETIC[op](*x))
            elif op in _FUNCTIONS:
                values.append(_FUNCTIONS[op](*x))
            elif op is Op.SELECT:
                values.append(x[1] if x[0] > 0 else x[2])
            else:  # NONFINITE, of a number
                values.append(mpmath.mpf(0))
        return values


_FUNCTIONS = {
    Op.SIGN: mpmath.sign,
    Op.SQRT: mpmath.sqrt,
    Op.SIN: mpmath.sin,
    Op.COS: mpmath.cos,
    Op.ABS: abs,
    Op.MIN: min,
    Op.TANH: mpmath.tanh,
    Op.EXP: mpmath.exp,
}
