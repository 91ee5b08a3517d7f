"""The loop nest: statements of an inverse kinematics in nested loops over the roots of its equations.

The builder writes a :class:`LoopNest` in the order of the derivation: every statement stands inside all loops opened
so far, and every value is computed where it is first used. The passes of :mod:`rrrgen.emit.c.ik.passes` rewrite
the nest, :mod:`rrrgen.emit.c.ik.statements` prints it; it can be printed before and after every pass.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import prod
from typing import TypeAlias

from rrrgen.ik.recording.scalar import Scalar
from rrrgen.program import Op

ARC = "{arc}"
"""Placeholder in the lines of a statement for the computation of its arc tangent."""

STOP = "{stop}"
"""Placeholder in a line for the end of the search; printed as a return statement where the line is outside all
loops."""


@dataclass(frozen=True)
class Loop:
    """A loop over the roots of one equation.

    ``variable`` is the loop variable, ``count`` the variable with the number of roots, ``most`` its largest value,
    ``level`` the number of loops around the statement that computes ``count``.
    """

    variable: str
    count: str
    most: int
    level: int


@dataclass(frozen=True)
class Arc:
    """The arc tangent that a statement takes: the variable ``angle`` and the C texts of its cosine and sine.

    Cosine and sine may have any common factor; ``{0}``, ``{1}``, ... in the texts are operands of the statement.
    """

    angle: Scalar
    cosine: str
    sine: str


@dataclass(frozen=True)
class Flip:
    """Two angles of a joint: ``source`` in the first pass of the loop ``choice``, another one in the second pass.

    The other angle is the variable ``other``, or follows from ``source`` by ``formula``, in which ``{}`` stands for it.
    """

    choice: str
    source: Scalar
    other: Scalar | None
    formula: str


@dataclass(frozen=True)
class Statement:
    """Lines of C inside ``depth`` loops; ``{0}``, ``{1}``, ... in them are replaced by the text of the operands.

    * ``operands``: all values that the lines read, ``rare`` the numbers of those read only where a joint is free.
    * ``defines``: the variables that the lines declare.
    * ``optional``: whether the statement may be left out where nothing uses what it defines.
    * ``beside``: values that a later statement combines with the variables of this one in place, so that both must be
      inside the same loops.
    * ``calls``: the kernels that are called, by their names in :mod:`rrrgen.emit.c.ik.counting`.
    * ``arc``: the arc tangent, if the statement computes a joint angle by one; ``flip``: the two angles of a joint, if
      it chooses between them; otherwise None.
    * ``opens``: index of the loop whose number of roots is known from here on.
    """

    depth: int
    lines: tuple[str, ...]
    operands: tuple[Scalar, ...] = ()
    defines: tuple[Scalar, ...] = ()
    optional: bool = False
    beside: tuple[Scalar, ...] = ()
    calls: tuple[str, ...] = ()
    rare: tuple[int, ...] = ()
    arc: Arc | None = None
    flip: Flip | None = None
    opens: int | None = None


@dataclass(frozen=True)
class Value:
    """A value that is computed here, inside ``depth`` loops, before any statement at that depth uses it."""

    depth: int
    value: Scalar

    @property
    def operands(self) -> tuple[Scalar, ...]:
        """The operands of this item: the one value that it computes."""
        return (self.value,)


@dataclass(frozen=True)
class Leaf:
    """The end of the innermost loop, which stores one candidate.

    ``joints`` holds (joint index, value), ``flags`` and ``branch`` are C texts, ``error`` is the squared residual.
    """

    depth: int
    joints: tuple[tuple[int, Scalar], ...]
    flags: str
    branch: str
    error: Scalar

    @property
    def operands(self) -> tuple[Scalar, ...]:
        """The values that are stored."""
        return (*(value for _, value in self.joints), self.error)

    @property
    def lines(self) -> tuple[str, ...]:
        """The C lines that store the candidate, with ``{0}``, ``{1}``, ... for the operands."""
        return (
            *(f"found->q[rows][{joint}] = {{{k}}};" for k, (joint, _) in enumerate(self.joints)),
            f"found->flags[rows] = {self.flags};",
            f"found->branch[rows] = {self.branch};",
            f"found->residual[rows] = {{{len(self.joints)}}};",
            "++rows;",
        )


Item: TypeAlias = Statement | Value | Leaf


@dataclass(frozen=True)
class LoopNest:
    """Loops, each directly inside the one before, and the items in them in the order of the derivation.

    ``before`` and ``after`` are C lines outside the loops, ``calls`` the kernels that ``after`` calls.
    """

    loops: tuple[Loop, ...]
    items: tuple[Item, ...]
    before: tuple[str, ...] = ()
    after: tuple[str, ...] = ()
    calls: tuple[str, ...] = ()


def position(loops: Sequence[Loop]) -> tuple[list[str], int]:
    """The array index of one pass through ``loops``, as C terms to be added, and the number of all passes."""
    terms = []
    for k, loop in enumerate(loops):
        stride = prod(inner.most for inner in loops[k + 1 :])
        terms.append(loop.variable if stride == 1 else f"{stride} * {loop.variable}")
    return terms, prod(loop.most for loop in loops)


def opening(loop: Loop, count: str = "") -> str:
    """The C line that opens a loop, ``for (int i = 0; i < count; ++i) {``.

    ``count`` is the C text of the number of passes, by default the variable ``loop.count``.
    """
    return f"for (int {loop.variable} = 0; {loop.variable} < {count or loop.count}; ++{loop.variable}) {{"


class Dependence:
    """Finds the loops on which each value of a nest depends, by index; statements are read in their order.

    Values that no statement defines (target, reference, prescribed joint) depend on no loop.
    """

    def __init__(self, loops: Sequence[Loop]) -> None:
        self._variables = {loop.variable: frozenset([k]) for k, loop in enumerate(loops)}
        self._values: dict[int, frozenset[int]] = {}

    def of(self, values: Sequence[Scalar]) -> frozenset[int]:
        """The loops on which any of ``values`` depends."""
        return frozenset().union(*map(self._loops, values))

    def depth(self, values: Sequence[Scalar]) -> int:
        """The number of loops inside which all of ``values`` are known."""
        return max(self.of(values), default=-1) + 1

    def read(self, item: Statement) -> None:
        """Take note of the variables that ``item`` defines."""
        loops = self.of((*item.operands, *item.beside))
        self._variables.update({variable.text: loops for variable in item.defines})

    def _loops(self, value: Scalar) -> frozenset[int]:
        if value.op is Op.INPUT:
            return self._variables.get(value.text, frozenset())
        found = self._values.get(id(value))
        if found is None:
            found = self._values[id(value)] = self.of(value.args)
        return found


def collect(value: Scalar, found: set[int]) -> None:
    """Add the ids of ``value`` and of everything that it depends on to ``found``."""
    if id(value) not in found:
        found.add(id(value))
        for arg in value.args:
            collect(arg, found)
