"""The record of one derivation: what a branch of the inverse kinematics is, for every interpreter and for counting.

A :class:`Solver` is a tree: straight-line values, then a choice of a root, and below each of its roots the same again,
down to a leaf, which is one candidate row. Since all subtrees of a choice have one form, the tree is kept as one path:
the steps in order, every scalar with the ``level`` of the last choice that it depends on.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from math import prod
from operator import add, mul, neg, sub, truediv

from rrrgen.ik.geometry.rigid import S
from rrrgen.ik.recording.builder import Builder
from rrrgen.ik.recording.scalar import Scalar
from rrrgen.ik.recording.solver_text import text_of
from rrrgen.ik.recording.steps import Pair, Residual, Stage, Step
from rrrgen.program import Op


@dataclass(frozen=True)
class Leaf:
    """What a candidate row is made of.

    ``values`` names for each joint of the user the step that decides it, ``labels`` the parts of the branch label
    (name, lowest bit, bits), ``checks`` the steps whose quantities make up the residual, all by their numbers.
    """

    values: tuple[int, ...]
    labels: tuple[tuple[str, int, int], ...]
    checks: tuple[int, ...]


@dataclass(frozen=True, eq=False)
class Solver:
    """The steps of one derivation for an arm with ``n`` joints; recorded by :class:`rrrgen.ik.recording.recorder`."""

    n: int
    steps: tuple[Step, ...]

    @cached_property
    def stages(self) -> tuple[Stage, ...]:
        """The choices between roots, from the outermost to the innermost."""
        return tuple(step.stage for step in self.steps if step.stage is not None)

    @property
    def max_solutions(self) -> int:
        """The number of leaves: every choice with all its roots."""
        return prod(stage.most for stage in self.stages)

    @cached_property
    def leaf(self) -> Leaf:
        """The candidate row."""
        decided = {joint.index: k for k, step in enumerate(self.steps) for joint in step.joints}
        labels, bit = [], 0
        for stage in self.stages:
            labels.append((stage.label, bit, stage.bits))
            bit += stage.bits
        checks = tuple(k for k, step in enumerate(self.steps) if isinstance(step, Residual))
        return Leaf(tuple(decided[j] for j in range(self.n)), tuple(labels), checks)

    @cached_property
    def opens(self) -> tuple[tuple[int, int], ...]:
        """Joints that the target may leave open, with the bits of the branch label that mean nothing then."""
        found: dict[int, int] = {}
        choice = 0
        for step in self.steps:
            joint = step.may_be_free
            if joint is not None and joint.index < self.n:
                found.setdefault(joint.index, 0)
                if step.stage is not None:
                    _, bit, bits = self.leaf.labels[choice]
                    found[joint.index] = ((1 << bits) - 1) << bit
            choice += step.stage is not None
        return tuple(sorted(found.items()))

    @cached_property
    def fixed_pairs(self) -> frozenset[int]:
        """The joints decided by a pair whose direction (A, B) is a constant of the robot."""
        return frozenset(step.joint.index for step in self.steps if isinstance(step, Pair) and step.fixed)

    @property
    def outline(self) -> tuple[tuple[object, ...], ...]:
        """What is asked for, in order, without the values: two records of one arm agree in it."""
        return tuple(
            (step.kind, tuple(joint.index for joint in step.joints), step.stage)
            for step in self.steps
            if step.kind not in ("name", "residual")
        )

    def play(self, b: Builder) -> None:
        """Let ``b`` interpret the recorded steps."""
        values: dict[int, S] = {}

        def read(node: Scalar) -> S:
            if node.is_const:
                return node.value
            key = id(node)
            if key not in values:
                values[key] = _applied(b, node.op, [read(arg) for arg in node.args])
            return values[key]

        for step in self.steps:
            for result, value in zip(step.results, step.play(b, read), strict=True):
                values[id(result)] = value

    def live(self) -> Iterator[Step]:
        """The steps without named values that nothing uses."""
        used: set[int] = set()
        kept = []
        for step in reversed(self.steps):
            if step.kind != "name" or id(step.results[0]) in used:
                kept.append(step)
                for operand in step.operands:
                    _collect(operand, used)
        yield from reversed(kept)

    def dump(self) -> str:
        """The solver as readable text, the same every time: see :mod:`rrrgen.ik.recording.solver_text`."""
        return text_of(self.n, list(self.live()), self.max_solutions)


def _collect(node: Scalar, used: set[int]) -> None:
    if id(node) not in used:
        used.add(id(node))
        for arg in node.args:
            _collect(arg, used)


def _applied(b: Builder, op: Op, args: list[S]) -> S:
    if op is Op.SQRT:
        return b.sqrt(args[0])
    if op is Op.ABS:
        return b.sqrt(args[0] * args[0])
    return _ARITHMETIC[op](*args)


_ARITHMETIC: dict[Op, Callable[..., S]] = {
    Op.ADD: add,
    Op.SUB: sub,
    Op.MUL: mul,
    Op.DIV: truediv,
    Op.NEG: neg,
}
