"""Folding known numbers into a program: the nominal specializations, and re-recording as the simplest pass."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from rrrgen.program import Builder, Program, Role, Value
from rrrgen.program.builder import replay


@dataclass(frozen=True)
class Fold:
    """Replaces the inputs of the roles in ``known`` by numbers; the other inputs stay."""

    known: Mapping[Role, Sequence[Value]]

    def __call__(self, program: Program) -> Program:
        """``program`` with the numbers in it."""
        builder = Builder()
        inputs: list[Sequence[Value]] = []
        for port in program.inputs:
            inputs.append(self.known[port.role] if port.role in self.known else builder.input(port))
        return builder.rewritten(program, replay(program, builder, inputs))
