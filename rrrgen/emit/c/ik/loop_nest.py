"""The loop nest: statements of an inverse kinematics in nested loops over the roots of its equations.

The builder writes a :class:`LoopNest` in the order of the derivation: every statement stands inside all loops opened
so far, and every value is computed where it is first used. The passes of :mod:`rrrgen.emit.c.ik.loop_nest` rewrite
the nest, :mod:`rrrgen.emit.c.ik.statements` prints it; it can be printed before and after every pass.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from math import prod
from typing import Protocol, TypeAlias

from rrrgen.ik.recording.scalar import SolverScalar, collect
from rrrgen.program import Op

ARC = "{arc}"
"""Placeholder in the lines of a statement for the computation of its arc tangent."""

STOP = "{stop}"
"""Placeholder in a line for the end of the search; printed as a return statement where the line is outside all
loops."""


@dataclass(frozen=True)
class RootLoop:
    """A loop over the roots of one equation.

    ``variable`` is the loop variable, ``count`` the variable with the number of roots, ``most`` its largest value,
    ``level`` the number of loops around the statement that computes ``count``.
    """

    variable: str
    count: str
    most: int
    level: int


@dataclass(frozen=True)
class ArcTangent:
    """The arc tangent that a statement takes: the variable ``angle`` and the C texts of its cosine and sine.

    Cosine and sine may have any common factor; ``{0}``, ``{1}``, ... in the texts are operands of the statement.
    """

    angle: SolverScalar
    cosine: str
    sine: str


@dataclass(frozen=True)
class Flip:
    """Two angles of a joint: ``source`` in the first pass of the loop ``choice``, another one in the second pass.

    The other angle is the variable ``other``, or follows from ``source`` by ``formula``, in which ``{}`` stands for it.
    """

    choice: str
    source: SolverScalar
    other: SolverScalar | None
    formula: str


@dataclass(frozen=True)
class Statement:
    """Lines of C inside ``depth`` loops; ``{0}``, ``{1}``, ... in them are replaced by the text of the operands.

    * ``operands``: all values that the lines read, ``rare`` the numbers of those read only where a joint is free.
    * ``defines``: the variables that the lines declare.
    * ``optional``: whether the statement may be left out where nothing uses what it defines.
    * ``beside``: values that a later statement combines with the variables of this one in place, so that both must be
      inside the same loops.
    * ``calls``: the kernels that are called, by their names in :mod:`rrrgen.emit.c.ik.costs`.
    * ``arc``: the arc tangent, if the statement computes a joint angle by one; ``flip``: the two angles of a joint, if
      it chooses between them; otherwise None.
    * ``opens``: index of the loop whose number of roots is known from here on.
    """

    depth: int
    lines: tuple[str, ...]
    operands: tuple[SolverScalar, ...] = ()
    defines: tuple[SolverScalar, ...] = ()
    optional: bool = False
    beside: tuple[SolverScalar, ...] = ()
    calls: tuple[str, ...] = ()
    rare: tuple[int, ...] = ()
    arc: ArcTangent | None = None
    flip: Flip | None = None
    opens: int | None = None


@dataclass(frozen=True)
class Value:
    """A value that is computed here, inside ``depth`` loops, before any statement at that depth uses it."""

    depth: int
    value: SolverScalar

    @property
    def operands(self) -> tuple[SolverScalar, ...]:
        """The operands of this item: the one value that it computes."""
        return (self.value,)


@dataclass(frozen=True)
class Leaf:
    """The end of the innermost loop, which stores one candidate.

    ``joints`` holds (joint index, value), ``flags`` and ``branch`` are C texts, ``error`` is the squared residual.
    """

    depth: int
    joints: tuple[tuple[int, SolverScalar], ...]
    flags: str
    branch: str
    error: SolverScalar

    @property
    def operands(self) -> tuple[SolverScalar, ...]:
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

    loops: tuple[RootLoop, ...]
    items: tuple[Item, ...]
    before: tuple[str, ...] = ()
    after: tuple[str, ...] = ()
    calls: tuple[str, ...] = ()


def position(loops: Sequence[RootLoop]) -> tuple[list[str], int]:
    """The array index of one pass through ``loops``, as C terms to be added, and the number of all passes."""
    terms = []
    for k, loop in enumerate(loops):
        stride = prod(inner.most for inner in loops[k + 1 :])
        terms.append(loop.variable if stride == 1 else f"({stride} * {loop.variable})")
    return terms, prod(loop.most for loop in loops)


def opening(loop: RootLoop, count: str = "") -> str:
    """The C line that opens a loop, ``for (int i = 0; i < count; ++i) {``.

    ``count`` is the C text of the number of passes, by default the variable ``loop.count``.
    """
    return f"for (int {loop.variable} = 0; {loop.variable} < {count or loop.count}; ++{loop.variable}) {{"


class Dependence:
    """Finds the loops on which each value of a nest depends, by index; statements are read in their order.

    Values that no statement defines (target, reference, prescribed joint) depend on no loop.
    """

    def __init__(self, loops: Sequence[RootLoop]) -> None:
        self._variables = {loop.variable: frozenset([k]) for k, loop in enumerate(loops)}
        self._values: dict[int, frozenset[int]] = {}

    def of(self, values: Sequence[SolverScalar]) -> frozenset[int]:
        """The loops on which any of ``values`` depends."""
        return frozenset().union(*map(self._loops, values))

    def depth(self, values: Sequence[SolverScalar]) -> int:
        """The number of loops inside which all of ``values`` are known."""
        return max(self.of(values), default=-1) + 1

    def read(self, item: Statement) -> None:
        """Take note of the variables that ``item`` defines."""
        loops = self.of((*item.operands, *item.beside))
        self._variables.update({variable.text: loops for variable in item.defines})

    def _loops(self, value: SolverScalar) -> frozenset[int]:
        if value.op is Op.INPUT:
            return self._variables.get(value.text, frozenset())
        loops = self._values.get(id(value))
        if loops is None:
            loops = self._values[id(value)] = self.of(value.args)
        return loops


# ------------------------------------------------------------------------------------------------------------------
# The pass that moves all arc tangents behind the loops over roots, into one loop that compilers vectorize.
#
# An arc tangent costs as much as all other operations of a solution together. Nothing inside the loops needs the
# angle of a joint once its cosine and sine are known, so every distinct angle gets a *slot* in an array, written in
# the outermost loop in which it is known. After the loops, one loop over all slots takes the arc tangents, and each
# solution copies its angles from their slots.
# ------------------------------------------------------------------------------------------------------------------

RESERVED = frozenset({"sine", "cosine", "angle", "i"})
"""Names of C variables in the lines that this pass adds, which no other variable may have."""


@dataclass(frozen=True)
class TakeArcsTogether:
    """Moves all arc tangents behind the loops; their number is rounded up to a multiple of ``lanes``.

    Four doubles fill the vector registers of most processors.
    """

    lanes: int = 4

    def __call__(self, nest: LoopNest) -> LoopNest:
        """Move the arc tangents of ``nest`` behind the loops; returns ``nest`` itself if there are none."""
        if not any(isinstance(item, Statement) and item.arc is not None for item in nest.items):
            return nest
        return _Gathering(nest, self.lanes).run()


@dataclass(frozen=True)
class _Slot:
    """The place of one joint's angles in the array of all angles.

    Its ``count`` entries begin at ``first``; ``index`` holds the C terms that select the entry of one pass through the
    loops around it. In the second pass of the loop ``choice`` the joint has another angle, ``step`` entries further on.
    """

    first: int
    count: int
    index: tuple[str, ...]
    choice: str = ""
    step: int = 0

    @property
    def text(self) -> str:
        """The C expression of the array index."""
        other = [f"({self.step} * {self.choice})"] if self.choice else []
        first = [str(self.first)] if self.first or not (self.index or other) else []
        return " + ".join([*first, *self.index, *other])


@dataclass
class _Gathering:
    """One run of the pass over ``nest``: the slots, and the angles of second passes of a loop (:class:`Flip`).

    Both are dictionaries by the name of the C variable of the angle. ``taken`` counts the array entries in use.
    """

    nest: LoopNest
    lanes: int
    slots: dict[str, _Slot] = field(default_factory=dict)
    flips: dict[str, Flip] = field(default_factory=dict)
    taken: int = 0

    def run(self) -> LoopNest:
        """The nest with its arc tangents behind the loops."""
        dependence = Dependence(self.nest.loops)
        items: list[Item] = []
        joints: list[tuple[int, str]] = []
        for item in self.nest.items:
            if isinstance(item, Leaf):
                joints = [(joint, value.text) for joint, value in item.joints if self._is_gathered(value.text)]
                items.append(replace(item, joints=tuple(x for x in item.joints if not self._is_gathered(x[1].text))))
            elif isinstance(item, Value):
                items.append(item)
            else:
                dependence.read(item)
                items += self._rewritten(item, dependence)
        arcs = -(-self.taken // self.lanes) * self.lanes
        copies, end = self._copy_angles(arcs)
        loops = self.nest.loops
        before = (
            f"REAL sine[{arcs}] = {{0}};",
            f"REAL cosine[{arcs}] = {{0}};",
            f"REAL angle[{end}];",
            *(f"int {_kept_count(loop)}[{position(loops[: loop.level])[1]}] = {{0}};" for loop in loops if loop.level),
            "int i;",
        )
        after = (f"ik_arcs({arcs}, sine, cosine, angle);", *copies, *self._solutions(joints))
        return replace(self.nest, items=tuple(items), before=before, after=after, calls=self._calls())

    def _is_gathered(self, angle: str) -> bool:
        return angle in self.slots or angle in self.flips

    def _rewritten(self, item: Statement, dependence: Dependence) -> list[Item]:
        """Rewrite ``item`` to store its angle in a slot; where it opens a loop, the number of roots is stored too."""
        if item.flip is not None:
            self.flips[item.defines[0].text] = item.flip
            return []
        if item.arc is not None:
            return [self._store(item, item.arc, sorted(dependence.of(item.operands)))]
        loop = None if item.opens is None else self.nest.loops[item.opens]
        if loop is None or loop.level == 0:
            return [item]
        at = " + ".join(position(self.nest.loops[: loop.level])[0])
        return [item, Statement(item.depth, (f"{_kept_count(loop)}[{at}] = {loop.count};",))]

    def _store(self, item: Statement, arc: ArcTangent, around: Sequence[int]) -> Statement:
        """Rewrite ``item`` to store an angle in slots, one for every pass through the loops ``around``."""
        terms, count = position([self.nest.loops[k] for k in around])
        slot = self.slots[arc.angle.text] = _Slot(self.taken, count, tuple(terms))
        self.taken += count
        stores = (f"cosine[{slot.text}] = {arc.cosine};", f"sine[{slot.text}] = {arc.sine};")
        alone = item.lines == (ARC,)
        lines = stores if alone else tuple(part for line in item.lines for part in _in_place_of_arc(line, stores))
        calls = tuple(name for name in item.calls if name != "arc")
        return replace(item, lines=lines, calls=calls, arc=None)

    def _copy_angles(self, arcs: int) -> tuple[list[str], int]:
        """C lines that compute angles from other angles, stored after the first ``arcs`` slots; and the slot count."""
        lines, end = [], arcs
        for angle, flip in self.flips.items():
            slot = self.slots[flip.source.text]
            if flip.other is not None:
                step = self.slots[flip.other.text].first - slot.first
            else:
                step = end - slot.first
                copied = flip.formula.format(f"angle[{slot.first} + i]")
                lines.append(f"for (i = 0; i < {slot.count}; ++i) {{ angle[{end} + i] = {copied}; }}")
                end += slot.count
            self.slots[angle] = replace(slot, choice=flip.choice, step=step)
        return lines, end

    def _solutions(self, joints: Sequence[tuple[int, str]]) -> list[str]:
        """C lines that go through the solutions once more, in the same order, and copy the angles to each of them.

        Numbers of roots that vary between passes of a loop have been stored for this.
        """
        lines, loops = ["i = 0;"], self.nest.loops
        for depth, loop in enumerate(loops):
            kept = f"{_kept_count(loop)}[{' + '.join(position(loops[: loop.level])[0])}]" if loop.level else ""
            lines.append("    " * depth + opening(loop, kept))
        row = [f"found->q[i][{joint}] = angle[{self.slots[angle].text}];" for joint, angle in joints]
        lines += ["    " * len(loops) + line for line in [*row, "++i;"]]
        return [*lines, *("    " * depth + "}" for depth in reversed(range(len(loops))))]

    def _calls(self) -> tuple[str, ...]:
        """The operations after the loops, for counting: an arc tangent per slot, and rotations of angles by pi."""
        turned = [flip for flip in self.flips.values() if flip.formula.startswith("ik_opposite")]
        return ("arc",) * self.taken + ("opposite",) * sum(self.slots[flip.source.text].count for flip in turned)


def _in_place_of_arc(line: str, stores: tuple[str, ...]) -> list[str]:
    """The line itself or, where it holds the placeholder of an arc tangent, one line for each of ``stores``."""
    return [line.replace(ARC, store) for store in stores] if ARC in line else [line]


def _kept_count(loop: RootLoop) -> str:
    """Name of the C array that stores how many roots an inner loop had in each pass of the outer loops."""
    return f"m{loop.variable[1:]}"


# ------------------------------------------------------------------------------------------------------------------
# The pass that moves every statement and value to the outermost loop in which its operands are known (hoisting).
# ------------------------------------------------------------------------------------------------------------------


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
                items += _parts_to_move(operand, depth, dependence, seen)
            items.append(replace(item, depth=depth))
        return replace(nest, loops=tuple(loops), items=tuple(items))


def _parts_to_move(value: SolverScalar, depth: int, dependence: Dependence, seen: set[int]) -> Iterator[Value]:
    """Yield the parts of ``value`` that are known in fewer loops than ``depth``, where it is needed first.

    ``seen`` holds the ids of values that were visited before; they are not yielded again.
    """
    if value.is_plain or id(value) in seen:
        return
    seen.add(id(value))
    level = dependence.depth((value,))
    for arg in value.args:
        yield from _parts_to_move(arg, level, dependence, seen)
    if level < depth:
        yield Value(level, value)


# ------------------------------------------------------------------------------------------------------------------
# The pass that leaves out definitions of values that nothing reads.
# ------------------------------------------------------------------------------------------------------------------


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


# ------------------------------------------------------------------------------------------------------------------
# Passes over the loop nest of an inverse kinematics, in the order in which they run.
# ------------------------------------------------------------------------------------------------------------------


class LoopPass(Protocol):
    """Rewrites a loop nest to one that finds the same candidates with less work, or returns it unchanged.

    Passes are frozen dataclasses: their fields are their options.
    """

    def __call__(self, nest: LoopNest) -> LoopNest:
        """The rewritten nest."""
        ...


PASSES: tuple[LoopPass, ...] = (DropUnused(), Hoist(), TakeArcsTogether())
