"""The pass that leaves out definitions of values that nothing reads."""

from __future__ import annotations

from dataclasses import dataclass, replace

from rrrgen.emit.c.ik.loop_nest import Item, LoopNest, Statement, collect


@dataclass(frozen=True)
class DropUnused:
    """Leaves out optional statements whose variables no later item reads. Runs before values are moved."""

    def __call__(self, nest: LoopNest) -> LoopNest:
        """Remove the unused definitions from ``nest``."""
        used: set[int] = set()
        kept: list[Item] = []
        for item in reversed(nest.items):
            if isinstance(item, Statement) and item.optional and used.isdisjoint(map(id, item.defines)):
                continue
            kept.append(item)
            for operand in item.operands:
                collect(operand, used)
        return replace(nest, items=tuple(reversed(kept)))
