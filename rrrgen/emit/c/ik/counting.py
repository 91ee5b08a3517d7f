"""Counting the operations of an emitted inverse kinematics, from the straight-line programs between its loops.

Every block between two loops is a :class:`rrrgen.program.Program`, evaluated once per pass of the loops around it; the
kernels that its statements call (``templates/c/ik/roots.c``) have known operations. The count holds for a target at
which every equation has all its roots and no joint is free. The check of the target, joint limits and refinement are
not counted; roots of quartics are found by iteration and counted apart. Of an elimination the mean is stated.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING

from rrrgen.program import Program, count_operations

if TYPE_CHECKING:
    from rrrgen.ik.geometry.coupling import Coupling


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

ELIMINATION = SolverOperations(mul=15500, add=14800, div=450, sqrt=4)
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
    own = SolverOperations(count.mul, count.add, count.div, count.sqrt, count.sincos)
    return sum_of([own, *(CALLS[name] for name in calls)]).times(turns)


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
    for each in counts:
        tally.update(each.as_dict())
    return SolverOperations(**tally)
