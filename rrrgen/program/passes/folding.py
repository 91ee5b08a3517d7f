"""The pass that replaces inputs by known numbers (constant folding), for functions with the robot file's parameters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from rrrgen.program import Builder, Program, Role, Value
from rrrgen.program.builder import replay


@dataclass(frozen=True)
class Fold:
    """Replaces the inputs whose role is in ``known`` by numbers (row-major) and simplifies; other inputs stay."""

    known: Mapping[Role, Sequence[Value]]

    def __call__(self, program: Program) -> Program:
        """Replace the known inputs of ``program`` by numbers; they are then no longer among its ports."""
        builder = Builder()
        inputs: list[Sequence[Value]] = []
        for port in program.inputs:
            inputs.append(self.known[port.role] if port.role in self.known else builder.input(port))
        return builder.rewritten(program, replay(program, builder, inputs))
