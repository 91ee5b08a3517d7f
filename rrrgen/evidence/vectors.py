"""Test vectors: states inside the proven box with the outputs of exact arithmetic, to check a target with.

Everything is computed with 50 digits, and the states come from Python's own generator: the same bytes on every machine.
"""

from __future__ import annotations

import random
from collections.abc import Mapping
from typing import Any

import mpmath
import numpy as np

from rrrgen.evidence.boxes import PortRange
from rrrgen.evidence.sampling import ARITHMETIC
from rrrgen.program import Op, Program

_DIGITS = 50


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
    with mpmath.workdps(_DIGITS):
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
            elif op is Op.SIGN:
                values.append(mpmath.sign(x[0]))
            elif op is Op.SQRT:
                values.append(mpmath.sqrt(x[0]))
            elif op is Op.SIN:
                values.append(mpmath.sin(x[0]))
            elif op is Op.COS:
                values.append(mpmath.cos(x[0]))
            else:
                raise ValueError(f"the operation {op.value} has no rounding analysis")
        return [[values[index] for index in row] for row in program.results]
