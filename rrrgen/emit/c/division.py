"""Division of a long function into parts, which share the values that several of them need in one array.

Compilers take a time that grows with the square of a function's length: gcc 12 -O2 54 s for 28 000 operations in one
function, of which it takes two thirds to assign registers, and 12 s in parts of 2500. The values pass through an array
in memory, as most of them do in one function too. The order of the operations stays, and with it every bit.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import accumulate

from rrrgen.program import REFUSED, Op, Program, count_operations

LONGEST = 8000
"""Operations of the longest function that stays whole."""

PART = 2500
"""Operations of a part, about."""

_ROUGHLY = 0.1
"""Share of a part's length by which a cut may move to where few values are alive."""


@dataclass(frozen=True)
class Division:
    """Part k of a program has the nodes ``starts[k]`` to ``starts[k + 1]``.

    ``slots`` has the element of the shared array, of ``size`` elements, for every node that a later part needs, and
    ``loaded[k]`` lists the nodes that part k takes from there; the last one is for the statement that reports the
    status, behind all parts.
    """

    starts: tuple[int, ...]
    slots: dict[int, int]
    size: int
    loaded: tuple[tuple[int, ...], ...]

    @property
    def parts(self) -> int:
        """The number of parts."""
        return len(self.starts) - 1


def divide(program: Program) -> Division | None:
    """How a long ``program`` is divided; None for one that stays whole.

    A guarded function, whose results are all selected at its end, stays whole too.
    """
    operations = count_operations(program).total
    if operations <= LONGEST or (program.status is not None and REFUSED in program.status.failures):
        return None
    starts = _starts(program, -(-operations // PART))
    homes = _homes(program, starts)
    needed: list[set[int]] = [set() for _ in starts]
    for k in range(len(starts) - 1):
        for index in range(starts[k], starts[k + 1]):
            needed[k].update(arg for arg in program.nodes[index].args if homes[arg] < k)
    if program.status is not None:
        needed[-1].update(program.results[program.status.output])
    last: dict[int, int] = {}
    for k, nodes in enumerate(needed):
        last.update(dict.fromkeys(nodes, k))
    slots, size = _slots(sorted(last), homes, last)
    return Division(starts, slots, size, tuple(tuple(sorted(nodes)) for nodes in needed))


def _starts(program: Program, parts: int) -> tuple[int, ...]:
    """The first node of every part, and the number of nodes: parts of equal length, cut where few values are alive."""
    counted = [0]
    for node in program.nodes:
        counted.append(counted[-1] + (node.op not in (Op.INPUT, Op.CONST, Op.NEG)))
    alive, length = _alive(program), counted[-1] / parts
    starts = [0]
    for k in range(1, parts):
        near = [index for index, n in enumerate(counted) if abs(n - k * length) <= _ROUGHLY * length]
        starts.append(min(near, key=lambda index: alive[index]))
    return (*starts, len(program.nodes))


def _alive(program: Program) -> list[int]:
    """How many values that were computed before each node are needed by it or behind it."""
    last = list(range(len(program.nodes)))
    for index, node in enumerate(program.nodes):
        for arg in node.args:
            last[arg] = index
    change = [0] * (len(program.nodes) + 2)
    for index, node in enumerate(program.nodes):
        if node.args:
            change[index + 1] += 1
            change[last[index] + 1] -= 1
    return list(accumulate(change))


def _homes(program: Program, starts: tuple[int, ...]) -> list[int]:
    """The part in which each value is computed; inputs and constants are at home in every part.

    Sine and cosine of an angle are computed together.
    """
    homes: list[int] = []
    first: dict[int, int] = {}
    part = 0
    for index, node in enumerate(program.nodes):
        while index >= starts[part + 1]:
            part += 1
        everywhere = node.op in (Op.INPUT, Op.CONST)
        trigonometric = node.op in (Op.SIN, Op.COS)
        homes.append(len(starts) if everywhere else first.setdefault(node.args[0], part) if trigonometric else part)
    return homes


def _slots(nodes: list[int], homes: list[int], last: dict[int, int]) -> tuple[dict[int, int], int]:
    """An element of the shared array for each of ``nodes``, free again behind the last part that needs it."""
    slots: dict[int, int] = {}
    size, free = 0, list[int]()
    busy: list[tuple[int, int]] = []  # last part, slot
    for node in sorted(nodes, key=lambda node: (homes[node], node)):
        over = [slot for until, slot in busy if until < homes[node]]
        busy = [(until, slot) for until, slot in busy if until >= homes[node]]
        free += over
        if free:
            slots[node] = free.pop()
        else:
            slots[node] = size
            size += 1
        busy.append((last[node], slots[node]))
    return slots, size
