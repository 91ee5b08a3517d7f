"""Upper bounds of the stack (bytes) that the emitted inverse kinematics takes, callees included, found from its C text.

Most of a stack frame is arrays, whose sizes the text states. The bound is the largest sum of arrays along a chain of
calls, with a margin for what compilers keep beside the arrays.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from functools import cache
from typing import TYPE_CHECKING

from rrrgen.base.errors import InternalError
from rrrgen.program import Program, count_operations

if TYPE_CHECKING:
    from rrrgen.ik.geometry.mechanism import Coupling

STACK_RULE = (
    "Stack: the bytes stated with each function are upper bounds for builds with -O1, -O2 or -O3 (not -O0) by gcc or "
    "clang; its callees are in them, functions of math.h are not. They are the local arrays along the deepest chain of "
    "calls and half as much again (callees compiled into one caller do not always share their space), 192 bytes for "
    "every function in it, and 2048 for loops that clang unrolls. The rule rests on measurements, not on a proof: of "
    "the chains measured (gcc 12 and clang 14 on x86-64, gcc 12 for Cortex-M4) none takes more than nine tenths of its "
    "bound; long ones mostly take half of it."
)
"""The rule by which the bounds are computed, in words, for the comment at the top of the emitted header."""

_FIXED = 2048
_EACH = 192  # return address, saved registers and scalars of one function

_COMMENT = re.compile(r"/\*.*?\*/", re.DOTALL)
_CONSTANT = re.compile(r"^#define (\w+) (\d+)\s*$", re.MULTILINE)
_FUNCTION = re.compile(r"^[A-Za-z_][\w *]*?(\w+)\([^;{}]*\)\n\{\n(.*?)^\}$", re.MULTILINE | re.DOTALL)
_INITIAL_ARRAY = re.compile(r"= \{[^{};]*(?:\{[^{};]*\}[^{};]*)*\}")
_DECLARATION = re.compile(r"(?:const )?(\w+) (\w.*)", re.DOTALL)
_ARRAY = re.compile(r"\w+((?:\[[^\]]+\])+)")


@dataclass(frozen=True)
class _FunctionCost:
    """One emitted C function: the bytes of the local arrays it declares, and the functions it calls."""

    arrays: int
    calls: tuple[str, ...]


def stack_bounds(source: str, name: str, real: str, solutions: Mapping[str, tuple[int, int]]) -> dict[str, int]:
    """Upper bounds (bytes) of the stack of each function of ``source``, the emitted C of robot ``name``, with callees.

    ``solutions``: the numbers of joints and rows of each type ``<name>_<key>_solutions``.
    """
    functions = _functions(source, _sizes(name, real, solutions))

    @cache
    def deepest(function: str) -> int:
        """Bytes of arrays and margins along the deepest chain of calls from ``function``; there is no recursion."""
        below = max(map(deepest, functions[function].calls), default=0)
        return 3 * functions[function].arrays // 2 + _EACH + below

    return {function: -(-(_FIXED + deepest(function)) // 16) * 16 for function in functions}


def _sizes(name: str, real: str, solutions: Mapping[str, tuple[int, int]]) -> dict[str, int]:
    """The size in bytes of each C type of which local arrays and structures consist."""
    size = 8 if real == "double" else 4
    sizes = {f"{name}_ik_real": size, "int": 4, "unsigned": 4}
    sizes |= {f"{name}_{part}_6r_real": 8 for part in ("ik", "ik_chain")}  # double in float packages too
    for key, (joints, rows) in solutions.items():
        total = 8 + size + rows * (joints * size + 4 + 4 + size)  # see the structure in the header
        sizes[f"{name}_{key}_solutions"] = -(-total // size) * size
    return sizes


def _functions(source: str, sizes: dict[str, int]) -> dict[str, _FunctionCost]:
    text = _COMMENT.sub("", source)
    constants = dict(_CONSTANT.findall(text))
    bodies = dict(_FUNCTION.findall(text))
    called = re.compile(r"\b(" + "|".join(map(re.escape, bodies)) + r")\(")
    return {
        name: _FunctionCost(_local_bytes(body, sizes, constants), tuple(sorted(set(called.findall(body)))))
        for name, body in bodies.items()
    }


def _local_bytes(body: str, sizes: dict[str, int], constants: dict[str, str]) -> int:
    """Bytes of the arrays and structures that ``body`` declares; scalars and pointers belong to the margin.

    ``sizes`` are the bytes of C types by name, ``constants`` the texts that C constants in array sizes stand for.
    """
    total = 0
    for statement in re.split(r"[;{}]", _INITIAL_ARRAY.sub("", body)):
        declaration = _DECLARATION.fullmatch(statement.strip())
        if declaration is None or declaration[1] not in sizes:
            continue
        for declarator in _declarators(declaration[2]):
            array = _ARRAY.fullmatch(declarator)
            if array is not None or declaration[1].endswith("_solutions"):
                total += sizes[declaration[1]] * _elements(array[1] if array else "", constants)
    return total


def _declarators(text: str) -> list[str]:
    """Split a C declaration list such as ``a[3], b = 0, *p`` into names with array sizes, leaving out pointers."""
    depth, plain = 0, ""
    for character in text:  # commas inside parentheses are not those of the list
        depth += (character == "(") - (character == ")")
        plain += "" if depth or character == ")" else character
    parts = (part.split("=")[0].strip() for part in plain.split(","))
    return [part for part in parts if part and not part.startswith("*")]


def _elements(dimensions: str, constants: dict[str, str]) -> int:
    """The product of the sizes in brackets: whole numbers, names of constants, or sums of both."""
    product = 1
    for dimension in re.findall(r"\[([^\]]+)\]", dimensions):
        terms = [constants.get(term, term) for term in dimension.split(" + ")]
        if not all(term.isdecimal() for term in terms):
            raise InternalError(f"the size [{dimension}] of an array in the emitted inverse kinematics is not a number")
        product *= sum(map(int, terms))
    return product


# ------------------------------------------------------------------------------------------------------------------
# Counting the operations of an emitted inverse kinematics, from the straight-line programs between its loops.
#
# Every block between two loops is a :class:`rrrgen.program.Program`, evaluated once per pass of the loops around it;
# the kernels that its statements call (``templates/c/ik/roots.c``) have known operations. The count holds for a
# target at which every equation has all its roots and no joint is free. The check of the target, joint limits and
# refinement are not counted; roots of quartics are found by iteration and counted apart. Of an elimination the mean
# is stated.
# ------------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class SolverOperations:
    """Arithmetic operations of one call of the inverse kinematics that finds all solutions.

    ``sincos`` counts angles, ``atan2`` arc tangents, ``quartics`` equations of degree four, each solved by at most 40
    iterations.
    """

    mul: int = 0
    add: int = 0
    div: int = 0
    sqrt: int = 0
    sincos: int = 0
    atan2: int = 0
    quartics: int = 0

    def as_dict(self) -> dict[str, int]:
        """The counts by name, in the form in which the manifest lists them."""
        return asdict(self)

    def times(self, turns: int) -> SolverOperations:
        """The operations of ``turns`` evaluations."""
        return SolverOperations(**{name: turns * value for name, value in self.as_dict().items()})

    def __str__(self) -> str:
        parts = [f"{value} {name}" for name, value in self.as_dict().items() if value or name in ("mul", "add")]
        return ", ".join(parts)


CALLS = {
    "linear": SolverOperations(mul=6, add=2, div=1, sqrt=1),
    "linear_given": SolverOperations(mul=5, add=1, div=1, sqrt=1),  # with a^2 + b^2 - k^2 given
    "cosine": SolverOperations(sqrt=1),
    "root": SolverOperations(mul=1, sqrt=1),
    "root_constant": SolverOperations(sqrt=1),  # of a size known in advance
    "quadratic": SolverOperations(mul=9, add=3, div=2, sqrt=1),
    "quartic": SolverOperations(quartics=1),
    "power4": SolverOperations(quartics=1),
    "unit": SolverOperations(mul=4, add=1, div=1, sqrt=1),
    "length": SolverOperations(mul=2, add=1, sqrt=1),  # of a vector in the plane
    "inverse": SolverOperations(div=1),
    "wrap": SolverOperations(mul=1, add=2),
    "opposite": SolverOperations(add=1),
    "angle": SolverOperations(sincos=1),
    "arc": SolverOperations(atan2=1),
}
"""Operations of one call of each kernel function, at a target that is not singular."""

ELIMINATION = SolverOperations(mul=15500, add=14800, div=490, sqrt=4)
ELIMINATED = SolverOperations(mul=2220, add=2150, div=64, sqrt=8)
"""Operations of the elimination for six joints, and of each solution that it finds.

Its iterations depend on the target. These are fitted to random targets of random arms and up to 5 % from the mean of
each, square roots 20 % (tests/ik/test_operations.py); near a singular configuration there are up to ten times as many.
"""


def block_operations(program: Program, calls: Iterable[str], turns: int) -> SolverOperations:
    """Operations of a block of statements that is evaluated ``turns`` times, including its ``calls`` of C functions.

    ``calls`` are keys of :data:`CALLS`.
    """
    count = count_operations(program)
    arithmetic = SolverOperations(count.mul, count.add, count.div, count.sqrt, count.sincos)
    return sum_of([arithmetic, *(CALLS[name] for name in calls)]).times(turns)


def coupling_operations(coupling: Coupling, solutions: int, types: str) -> SolverOperations:
    """Operations by which ``solutions`` of a chain with joints of ``types`` become joint positions of its mechanism.

    For each way in which the drives can stand: q from the displacements of n rows, and how far all rows are off it. The
    pose at q, which is checked on the mechanism, is not counted.
    """
    n, turns = coupling.n, coupling.count
    full = n if turns > 1 else 0  # turns that are added to the rows
    lead = SolverOperations(mul=n * n, add=n * n + full)
    off = SolverOperations(mul=len(types) * n, add=len(types) * (n + 1), div=types.count("P"))
    wraps = [CALLS["wrap"]] * types.count("R")
    return sum_of([lead, off, *wraps]).times(solutions * turns)


def sum_of(counts: Iterable[SolverOperations]) -> SolverOperations:
    """The sum of several counts, operation by operation."""
    tally: Counter[str] = Counter()
    for count in counts:
        tally.update(count.as_dict())
    return SolverOperations(**tally)
