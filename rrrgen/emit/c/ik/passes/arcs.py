"""The pass that moves all arc tangents behind the loops over roots, into one loop that compilers vectorize.

An arc tangent costs as much as all other operations of a solution together. Nothing inside the loops needs the angle of
a joint once its cosine and sine are known, so every distinct angle gets a *slot* in an array, written in the outermost
loop in which it is known. After the loops, one loop over all slots takes the arc tangents, and each solution copies its
angles from their slots.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

from rrrgen.emit.c.ik.loop_nest import (
    ARC,
    Arc,
    Dependence,
    Flip,
    Item,
    Leaf,
    Loop,
    LoopNest,
    Statement,
    Value,
    opening,
    position,
)

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
        other = [f"{self.step} * {self.choice}"] if self.choice else []
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
        copies, end = self._copied(arcs)
        loops = self.nest.loops
        before = (
            f"REAL sine[{arcs}] = {{(REAL)0}}, cosine[{arcs}] = {{(REAL)0}}, angle[{end}];",
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
            return [self._stored(item, item.arc, sorted(dependence.of(item.operands)))]
        loop = None if item.opens is None else self.nest.loops[item.opens]
        if loop is None or loop.level == 0:
            return [item]
        at = " + ".join(position(self.nest.loops[: loop.level])[0])
        return [item, Statement(item.depth, (f"{_kept_count(loop)}[{at}] = {loop.count};",))]

    def _stored(self, item: Statement, arc: Arc, around: Sequence[int]) -> Statement:
        """Rewrite ``item`` to store an angle in slots, one for every pass through the loops ``around``."""
        terms, count = position([self.nest.loops[k] for k in around])
        slot = self.slots[arc.angle.text] = _Slot(self.taken, count, tuple(terms))
        self.taken += count
        stores = (f"cosine[{slot.text}] = {arc.cosine};", f"sine[{slot.text}] = {arc.sine};")
        alone = item.lines == (ARC,)
        lines = stores if alone else tuple(line.replace(ARC, " ".join(stores)) for line in item.lines)
        calls = tuple(name for name in item.calls if name != "arc")
        return replace(item, lines=lines, calls=calls, arc=None)

    def _copied(self, arcs: int) -> tuple[list[str], int]:
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


def _kept_count(loop: Loop) -> str:
    """Name of the C array that stores how many roots an inner loop had in each pass of the outer loops."""
    return f"m{loop.variable[1:]}"
