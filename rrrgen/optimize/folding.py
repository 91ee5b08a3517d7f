"""Folding known numbers into a program: the nominal twins, and re-recording as the simplest pass."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from rrrgen.program import Builder, Program, Role, Value
from rrrgen.program.builder import replay


def fold(program: Program, known: Mapping[Role, Sequence[Value]]) -> Program:
    """``program`` with the inputs of the roles in ``known`` replaced by numbers; other inputs stay."""
    builder = Builder()
    inputs: list[Sequence[Value]] = []
    for port in program.inputs:
        inputs.append(known[port.role] if port.role in known else builder.input(port))
    return builder.rewritten(program, replay(program, builder, inputs))
