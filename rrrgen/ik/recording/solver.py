"""The recorded closed form of an arm: the steps from the target to the joints, with choices between roots.

The solutions form a tree: values are computed, an equation is solved, and each of its roots leads to the same further
steps, down to a leaf, which is one candidate solution. Since all branches have the same steps, a :class:`Solver` stores
them once, in order; every scalar carries the ``level`` of the last choice that it depends on.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import count
from math import prod
from operator import add, mul, neg, sub, truediv

from rrrgen.ik.geometry.rigid_transforms import S
from rrrgen.ik.recording.builder import DerivationBuilder
from rrrgen.ik.recording.scalar import SolverScalar, collect
from rrrgen.ik.recording.steps import PairStep, ResidualStep, Stage, Step
from rrrgen.program import Op

# ------------------------------------------------------------------------------------------------------------------
# Readable text of a recorded solver, for people and for the comparison of solvers in tests.
#
# inverse kinematics of 3 joints: at most 4 solutions
#   px, py, pz = target
#   for each of up to 2 roots of pair(-py, px, 0.259), shoulder: c1, s1
#     ux = px*c1 + py*s1
#     ...
#
# What depends on a choice of a root is indented below it. An expression used more than once gets a number (%1, %2,
# ...) at the outermost depth at which it is known.
# ------------------------------------------------------------------------------------------------------------------

_SIGNS = {Op.ADD: (" + ", 1, 1), Op.SUB: (" - ", 1, 2), Op.MUL: ("*", 2, 2), Op.DIV: ("/", 2, 3)}
"""For each operation: its symbol, its precedence, and the least precedence that its right operand has without
parentheses."""


def text_of(n: int, steps: Sequence[Step], rows: int) -> str:
    """Print the ``steps`` of an arm with ``n`` joints and at most ``rows`` solutions; ends with a line feed."""
    return (
        "\n".join([f"inverse kinematics of {n} joints: at most {rows} solutions", *_TextWriter(steps).lines()]) + "\n"
    )


class _TextWriter:
    def __init__(self, steps: Sequence[Step]) -> None:
        self._steps = steps
        self._uses: dict[int, int] = {}
        self._named: dict[int, str] = {}
        self._numbers = count(1)
        depth = sum(step.stage is not None for step in steps)
        self._blocks: list[list[str]] = [[] for _ in range(depth + 1)]

    def lines(self) -> list[str]:
        """Lines of the text: one block for each depth of choices, indented by its depth."""
        for step in self._steps:
            for operand in step.operands:
                self._count(operand)
        depth = 0
        for step in self._steps:
            depth += self._write(step, depth)
        return [f"{'  ' * (k + 1)}{line}" for k, block in enumerate(self._blocks) for line in block]

    def _count(self, node: SolverScalar) -> None:
        self._uses[id(node)] = self._uses.get(id(node), 0) + 1
        if self._uses[id(node)] == 1:
            for arg in node.args:
                self._count(arg)

    def _write(self, step: Step, depth: int) -> bool:
        """Write one step at the depth at which its operands are known; returns whether it selects a root."""
        level = depth if isinstance(step, ResidualStep) else max((x.level for x in step.operands), default=0)
        operands = [self._text(operand, 0) for operand in step.operands]
        results = ", ".join(result.text for result in step.results)
        if step.kind == "name":
            self._blocks[level].append(f"{results} = {operands[0]}")
            return False
        what = f"{step.kind}({', '.join(operands)})" if operands else step.kind
        if step.stage is None:
            self._blocks[level].append(f"{results} = {what}" if results else what)
            return False
        stage = step.stage
        self._blocks[depth].append(f"for each of up to {stage.most} roots of {what}, {stage.label}: {results}")
        return True

    def _text(self, node: SolverScalar, strength: int) -> str:
        if node.op is Op.INPUT:
            return node.text
        if node.is_const:
            return f"{node.value:.12g}" if node.value >= 0 else f"({node.value:.12g})"
        if id(node) not in self._named and self._uses[id(node)] > 1 and node.op is not Op.NEG:
            text = self._expression(node, 0)
            self._named[id(node)] = f"%{next(self._numbers)}"
            self._blocks[node.level].append(f"{self._named[id(node)]} = {text}")
        return self._named.get(id(node)) or self._expression(node, strength)

    def _expression(self, node: SolverScalar, strength: int) -> str:
        if node.op is Op.NEG:
            return f"-{self._text(node.args[0], 3)}"
        if node.op not in _SIGNS:
            return f"{node.op.value}({self._text(node.args[0], 0)})"
        sign, precedence, right = _SIGNS[node.op]
        text = f"{self._text(node.args[0], precedence)}{sign}{self._text(node.args[1], right)}"
        return f"({text})" if precedence < strength else text


# ------------------------------------------------------------------------------------------------------------------
# The recorded closed form of an arm
# ------------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class CandidateLayout:
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
    def leaf(self) -> CandidateLayout:
        """The steps and the branch labels that make up a candidate solution."""
        decided = {joint.index: k for k, step in enumerate(self.steps) for joint in step.joints}
        labels, bit = [], 0
        for stage in self.stages:
            labels.append((stage.label, bit, stage.bits))
            bit += stage.bits
        checks = tuple(k for k, step in enumerate(self.steps) if isinstance(step, ResidualStep))
        return CandidateLayout(tuple(decided[j] for j in range(self.n)), tuple(labels), checks)

    @cached_property
    def opens(self) -> tuple[tuple[int, int], ...]:
        """Joints that some targets leave undetermined, each as (joint index, mask).

        ``mask`` holds the bits of the branch number that have no meaning while the joint is free.
        """
        masks: dict[int, int] = {}
        choice = 0
        for step in self.steps:
            joint = step.may_be_free
            if joint is not None and joint.index < self.n:
                masks.setdefault(joint.index, 0)
                if step.stage is not None:
                    _, bit, bits = self.leaf.labels[choice]
                    masks[joint.index] = ((1 << bits) - 1) << bit
            choice += step.stage is not None
        return tuple(sorted(masks.items()))

    @cached_property
    def fixed_pairs(self) -> frozenset[int]:
        """Joints solved from ``A cos x + B sin x = C`` with constant A and B, so that no target leaves them free."""
        return frozenset(step.joint.index for step in self.steps if isinstance(step, PairStep) and step.fixed)

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

    def play(self, b: DerivationBuilder) -> None:
        """Replay the recorded steps on the builder ``b``."""
        values: dict[int, S] = {}

        def read(node: SolverScalar) -> S:
            if node.is_const:
                return node.value
            key = id(node)
            if key not in values:
                values[key] = _apply_operation(b, node.op, [read(arg) for arg in node.args])
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
                    collect(operand, used)
        yield from reversed(kept)

    def dump(self) -> str:
        """Print the solver as readable text, one step per line, indented by the depth of choices; reproducible."""
        return text_of(self.n, list(self.live()), self.max_solutions)


def _apply_operation(b: DerivationBuilder, op: Op, args: list[S]) -> S:
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
