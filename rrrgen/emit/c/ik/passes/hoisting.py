"""The pass that moves every statement and value to the outermost loop in which its operands are known (hoisting)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

from rrrgen.emit.c.ik.loop_nest import Dependence, Item, LoopNest, Statement, Value
from rrrgen.ik.recording.scalar import Scalar


@dataclass(frozen=True)
class Hoist:
    """Moves statements, and the values that they read, out of the loops on which they do not depend.

    The order of the derivation is kept at every depth. The end of the innermost loop stays where it is.
    """

    def __call__(self, nest: LoopNest) -> LoopNest:
        """Move every item of ``nest`` to its least depth; values that move out of a statement become items."""
        loops = list(nest.loops)
        dependence = Dependence(loops)
        items: list[Item] = []
        seen: set[int] = set()
        for item in nest.items:
            depth = item.depth
            if isinstance(item, Statement):
                depth = dependence.depth((*item.operands, *item.beside))
                dependence.read(item)
                if item.opens is not None:
                    loops[item.opens] = replace(loops[item.opens], level=depth)
            for operand in item.operands:
                items += _moved(operand, depth, dependence, seen)
            items.append(replace(item, depth=depth))
        return replace(nest, loops=tuple(loops), items=tuple(items))


def _moved(value: Scalar, depth: int, dependence: Dependence, seen: set[int]) -> Iterator[Value]:
    """Yield the parts of ``value`` that are known in fewer loops than ``depth``, where it is needed first.

    ``seen`` holds the ids of values that were visited before; they are not yielded again.
    """
    if value.is_plain or id(value) in seen:
        return
    seen.add(id(value))
    own = dependence.depth((value,))
    for arg in value.args:
        yield from _moved(arg, own, dependence, seen)
    if own < depth:
        yield Value(own, value)
