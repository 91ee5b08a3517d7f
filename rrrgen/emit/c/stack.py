"""Upper bounds of the stack (bytes) that an emitted function takes in an optimised build, by a simple rule.

The rule counts the values that are alive (still needed) at the same time. gcc keeps about one number for each, up to
half as many again in the longest functions, and for ARM it computes some results early and stores them late. clang
combines neighbouring results to vectors, saves whole vectors, and delays stores until the neighbours are computed, so
that its frames depend less on the precision and more on the number of results.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import accumulate

from rrrgen.emit import Real
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
    """The bound of the stack of a function by the :data:`STACK_RULE`, rounded up to multiples of 16 bytes."""
    size = 8 if real == "double" else 4
    alive = most_alive(program)
    results = len({element for elements in program.results for element in elements})
    return StackBound(
        gcc=_aligned(_FIXED + (3 * alive + 4 * results) * size // 2),
        clang=_aligned(_FIXED + 20 * alive + 16 * results),
    )


def most_alive(program: Program) -> int:
    """The largest number of values that are needed at the same time while the program runs in its order.

    A computed value counts from its definition to its last use, an input from its first use on, a constant never.
    """
    nodes = program.nodes
    first, last = list(range(len(nodes))), list(range(len(nodes)))
    for index, node in enumerate(nodes):
        for arg in node.args:
            last[arg] = index
            if nodes[arg].op is Op.INPUT and first[arg] == arg:
                first[arg] = index
    change = [0] * (len(nodes) + 1)
    for index, node in enumerate(nodes):
        if node.args or (last[index] > index and node.op is Op.INPUT):
            change[first[index]] += 1
            change[last[index] + 1] -= 1
    return max(accumulate(change), default=0)


def _aligned(size: int) -> int:
    return -(-size // 16) * 16
