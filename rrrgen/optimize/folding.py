"""Folding known numbers into a program: the nominal twins, and re-recording as the simplest pass."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from rrrgen.program import Builder, Program, Value
from rrrgen.program.builder import replay


def fold(program: Program, known: Mapping[str, Sequence[Value]]) -> Program:
    """``program`` with the inputs named in ``known`` replaced by numbers; other inputs stay."""
    builder = Builder()
    inputs: list[Sequence[Value]] = []
    for port in program.inputs:
        inputs.append(known[port.name] if port.name in known else builder.input(port))
    results = replay(program, builder, inputs)
    outputs = list(zip(program.outputs, results, strict=True))
    return builder.program(program.name, outputs, program.summary, program.formula, program.notes)
