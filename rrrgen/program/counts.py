"""Counting the operations of a program."""

from __future__ import annotations

from collections import Counter
from dataclasses import asdict, dataclass
from operator import itemgetter
from typing import TYPE_CHECKING

from rrrgen.program.nodes import Op

if TYPE_CHECKING:
    from rrrgen.program.ir import Program


_OTHER = (Op.ABS, Op.SIGN, Op.EXP, Op.TANH, Op.MIN, Op.NONFINITE, Op.SELECT)


@dataclass(frozen=True)
class OperationCount:
    """Number of operations of one evaluation, by kind.

    ``add`` includes subtractions. ``sincos`` counts angles: the sine and the cosine of one angle count once. ``neg`` is
    listed apart and left out of ``total``, since a change of sign is practically free on current processors. ``other``
    counts absolute values, signs, exponentials, hyperbolic tangents, minima, checks for finite numbers and
    selections.
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
        """Number of multiplications, additions, divisions and square roots together."""
        return self.mul + self.add + self.div + self.sqrt

    def as_dict(self) -> dict[str, int]:
        """The counts by name, in the form in which the manifest lists them."""
        return asdict(self)

    def __str__(self) -> str:
        parts = [f"{self.mul} mul", f"{self.add} add"]
        parts += [f"{value} {name}" for name, value in self.as_dict().items() if name not in ("mul", "add") and value]
        return ", ".join(parts)


def count_operations(program: Program) -> OperationCount:
    """Count the operations of one evaluation of ``program``, by kind."""
    tally = Counter(map(itemgetter(0), program.nodes))  # by operation
    has_angles = tally[Op.SIN] or tally[Op.COS]
    angles = {args[0] for op, args, _ in program.nodes if op is Op.SIN or op is Op.COS} if has_angles else ()
    return OperationCount(
        mul=tally[Op.MUL],
        add=tally[Op.ADD] + tally[Op.SUB],
        div=tally[Op.DIV],
        sqrt=tally[Op.SQRT],
        sincos=len(angles),
        neg=tally[Op.NEG],
        other=sum(tally[op] for op in _OTHER),
    )
