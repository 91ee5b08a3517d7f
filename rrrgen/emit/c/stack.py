"""Upper bounds of the stack (bytes) that an emitted function takes in an optimised build, by a simple rule.

The rule counts the values that are alive (still needed) at the same time. gcc keeps about one number for each, up to
half as many again in the longest functions, and for ARM it computes some results early and stores them late. clang
combines neighbouring results to vectors, saves whole vectors, and delays stores until the neighbours are computed, so
that its frames depend less on the precision and more on the number of results.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import accumulate, pairwise

from rrrgen.emit import Real
from rrrgen.emit.c.division import divide
from rrrgen.program import Op, Program

STACK_RULE = (
    "the bytes stated with each function are upper bounds for builds with -O1, -O2 or -O3 (not -O0); the kernel of the "
    "sines is in them, functions of math.h are not. gcc: 128 + (3/2 a + 2 r) s, clang: 128 + 20 a + 16 r, where a is "
    "the most values that are alive at once (inputs from their first use to their last), r the number of different "
    "results and s the size of the real type. The rule rests on measurements, not on a proof: of the frames of all "
    "robots that come with rrrgen and of random ones (gcc 12 and clang 14 on x86-64, gcc 12 for Cortex-M4) none takes "
    "more than nine tenths of its bound; large ones mostly take between a quarter and a half, with vectors of AVX less"
)
"""The rule by which the bounds are computed, in words, for the comment at the top of an emitted header."""

_FIXED = 128  # return address and saved registers, the sine kernel where it is called, alignment of vectors


@dataclass(frozen=True)
class StackBound:
    """Upper bound of the stack of a function in bytes, for each compiler that may build it."""

    gcc: int
    clang: int

    def __str__(self) -> str:
        return f"at most {self.gcc} bytes built by gcc, {self.clang} by clang"


def stack_bound(program: Program, real: Real) -> StackBound:
    """The bound of the stack of a function by the :data:`STACK_RULE`, rounded up to multiples of 16 bytes.

    To a divided function (:mod:`rrrgen.emit.c.division`) gcc gives the array of the shared values, and in the worst
    case the frames of two parts, of one that it merges into the function and of one that this calls. clang merges all
    parts into one function, in which no array is left.
    """
    size = 8 if real == "double" else 4
    division = divide(program)
    gcc = _gcc_frame(program, 0, len(program.nodes), size)
    if division is not None:
        largest = max(_gcc_frame(program, *part, size) for part in pairwise(division.starts))
        gcc = _FIXED + division.size * size + 2 * largest
    return StackBound(gcc=_align(gcc), clang=_align(_FIXED + 20 * most_alive(program) + 16 * _results(program)))


def _gcc_frame(program: Program, start: int, end: int, size: int) -> int:
    alive = most_alive(program, start, end)
    return _FIXED + (3 * alive + 4 * _results(program, start, end)) * size // 2


def _results(program: Program, start: int = 0, end: int | None = None) -> int:
    """The number of different results; with ``start`` and ``end``, of those that these nodes compute."""
    nodes = range(start, len(program.nodes) if end is None else end)
    return len({element for elements in program.results for element in elements if element in nodes})


def most_alive(program: Program, start: int = 0, end: int | None = None) -> int:
    """The largest number of values that are needed at the same time while the program runs in its order.

    A computed value counts from its definition to its last use, an input from its first use on, a constant never.
    With ``start`` and ``end`` only these nodes run, and an earlier value counts from its first use among them on.
    """
    nodes = program.nodes
    end = len(nodes) if end is None else end
    first, last = list(range(len(nodes))), list(range(len(nodes)))
    for index in range(start, end):
        for arg in nodes[index].args:
            last[arg] = index
            if first[arg] == arg and (nodes[arg].op is Op.INPUT or arg < start):
                first[arg] = index
    change = [0] * (len(nodes) + 1)
    for index in range(end):
        node, used = nodes[index], last[index] > index
        if (node.args and (index >= start or used)) or (used and node.op is Op.INPUT):
            change[first[index]] += 1
            change[last[index] + 1] -= 1
    return max(accumulate(change), default=0)


def _align(size: int) -> int:
    return -(-size // 16) * 16
