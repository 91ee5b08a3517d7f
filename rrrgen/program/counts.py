"""Counting what a program costs."""

from __future__ import annotations

from collections import Counter
from dataclasses import asdict, dataclass
from operator import itemgetter
from typing import TYPE_CHECKING

from rrrgen.program.nodes import Op

if TYPE_CHECKING:
    from rrrgen.program.ir import Program


@dataclass(frozen=True)
class OperationCount:
    """Arithmetic of one evaluation.

    ``sincos`` counts angles (a sine and a cosine of one angle are one). Changes of sign cost nothing that is worth
    counting on current processors and are listed apart.
    """

    mul: int = 0
    add: int = 0
    div: int = 0
    sqrt: int = 0
    sincos: int = 0
    neg: int = 0
    other: int = 0

    @property
    def total(self) -> int:
        """Multiplications, additions, divisions and roots."""
        return self.mul + self.add + self.div + self.sqrt

    def as_dict(self) -> dict[str, int]:
        """For the manifest."""
        return asdict(self)

    def __str__(self) -> str:
        parts = [f"{self.mul} mul", f"{self.add} add"]
        parts += [f"{value} {name}" for name, value in self.as_dict().items() if name not in ("mul", "add") and value]
        return ", ".join(parts)


def count_operations(program: Program) -> OperationCount:
    """Operations of one evaluation of ``program``."""
    tally = Counter(map(itemgetter(0), program.nodes))  # by operation
    angles = {args[0] for op, args, _ in program.nodes if op is Op.SIN or op is Op.COS}
    return OperationCount(
        mul=tally[Op.MUL],
        add=tally[Op.ADD] + tally[Op.SUB],
        div=tally[Op.DIV],
        sqrt=tally[Op.SQRT],
        sincos=len(angles),
        neg=tally[Op.NEG],
        other=sum(tally[op] for op in (Op.ABS, Op.SIGN, Op.EXP, Op.TANH, Op.SELECT)),
    )
