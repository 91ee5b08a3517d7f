"""The recorded closed form of an arm: the steps from the target to the joints, with choices between roots.

The solutions form a tree: values are computed, an equation is solved, and each of its roots leads to the same further
steps, down to a leaf, which is one candidate solution. Since all branches have the same steps, a :class:`Solver` stores
them once, in order; every scalar carries the ``level`` of the last choice that it depends on.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from math import prod
from operator import add, mul, neg, sub, truediv

from rrrgen.ik.geometry.rigid_transforms import S
from rrrgen.ik.recording.builder import Builder
from rrrgen.ik.recording.scalar import Scalar
from rrrgen.ik.recording.solver_text import text_of
from rrrgen.ik.recording.steps import Pair, Residual, Stage, Step
from rrrgen.program import Op


@dataclass(frozen=True)
class Leaf:
    """Where a candidate solution finds its joint values, its branch number and its residual among the steps.

    ``values`` holds for each joint of the user the index of the step that sets it, ``labels`` the fields of the branch
    number (name, lowest bit, bits), ``checks`` the indices of the steps whose quantities make up the residual.
    """

    values: tuple[int, ...]
    labels: tuple[tuple[str, int, int], ...]
    checks: tuple[int, ...]


@dataclass(frozen=True, eq=False)
class Solver:
    """The closed-form inverse kinematics of an arm with ``n`` joints, as the ordered ``steps`` of its derivation."""

    n: int
    steps: tuple[Step, ...]

    @cached_property
    def stages(self) -> tuple[Stage, ...]:
        """The choices between roots, from the outermost to the innermost."""
        return tuple(step.stage for step in self.steps if step.stage is not None)

    @property
    def max_solutions(self) -> int:
        """Largest possible number of solutions: the product of the numbers of roots of all choices."""
        return prod(stage.most for stage in self.stages)

    @cached_property
    def leaf(self) -> Leaf:
        """The steps and the branch labels that make up a candidate solution."""
        decided = {joint.index: k for k, step in enumerate(self.steps) for joint in step.joints}
        labels, bit = [], 0
        for stage in self.stages:
            labels.append((stage.label, bit, stage.bits))
            bit += stage.bits
        checks = tuple(k for k, step in enumerate(self.steps) if isinstance(step, Residual))
        return Leaf(tuple(decided[j] for j in range(self.n)), tuple(labels), checks)

    @cached_property
    def opens(self) -> tuple[tuple[int, int], ...]:
        """Joints that some targets leave undetermined, each as (joint index, mask).

        ``mask`` holds the bits of the branch number that have no meaning while the joint is free.
        """
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
        """Joints solved from ``A cos x + B sin x = C`` with constant A and B, so that no target leaves them free."""
        return frozenset(step.joint.index for step in self.steps if isinstance(step, Pair) and step.fixed)

    @property
    def outline(self) -> tuple[tuple[object, ...], ...]:
        """The kind, joints and root selection of every step, without its values.

        Two recordings of the same arm, one with numbers and one with symbols, have equal outlines.
        """
        return tuple(
            (step.kind, tuple(joint.index for joint in step.joints), step.stage)
            for step in self.steps
            if step.kind not in ("name", "residual")
        )

    def play(self, b: Builder) -> None:
        """Replay the recorded steps on the builder ``b``."""
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
        """Iterate over the steps, omitting named values that no other step uses."""
        used: set[int] = set()
        kept = []
        for step in reversed(self.steps):
            if step.kind != "name" or id(step.results[0]) in used:
                kept.append(step)
                for operand in step.operands:
                    _collect(operand, used)
        yield from reversed(kept)

    def dump(self) -> str:
        """Print the solver as readable text, one step per line, indented by the depth of choices; reproducible."""
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
