"""Statements of emitted C between loops: every value is computed once, as far outside as it can be."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from math import prod

from rrrgen.backends.c.solver.counting import SolverOperations, block_operations, sum_of
from rrrgen.backends.interface import Target
from rrrgen.backends.names import Names
from rrrgen.backends.printing import Statements
from rrrgen.ik.recording.scalar import Scalar
from rrrgen.program import Node, Op, Port, Program


@dataclass(frozen=True)
class Loop:
    """One loop over the roots of a choice; ``level`` is the number of loops that its count depends on."""

    variable: str
    count: str
    most: int
    level: int


def position(loops: Sequence[Loop]) -> tuple[list[str], int]:
    """The array index of one pass through nested loops, as C terms to be added, and the number of all passes."""
    terms = []
    for k, loop in enumerate(loops):
        stride = prod(inner.most for inner in loops[k + 1 :])
        terms.append(loop.variable if stride == 1 else f"{stride} * {loop.variable}")
    return terms, prod(loop.most for loop in loops)


@dataclass
class Statement:
    """Lines of C at one depth of loops; ``{0}``, ``{1}``, ... in them are replaced by the text of the operands."""

    level: int
    lines: tuple[str, ...]
    operands: tuple[Scalar, ...]
    defines: Scalar | None = None
    """The one variable of a plain definition, which can be left out where nothing uses it."""
    calls: tuple[str, ...] = ()
    """The kernels that are called, by their names in :mod:`rrrgen.backends.c.solver.counting`."""
    rare: tuple[int, ...] = ()
    """The operands that are read only where a joint is free."""


@dataclass(frozen=True)
class CBody:
    """The finished body of a branch function: its C text, the template functions it calls, its operation counts."""

    text: str
    needs: frozenset[str]
    operations: SolverOperations


def opening(loop: Loop, count: str = "") -> str:
    """The line that opens a loop."""
    return f"for (int {loop.variable} = 0; {loop.variable} < {count or loop.count}; ++{loop.variable}) {{"


class _Blocks:
    """Sorts statements and the values that they need into one block for each depth of loops.

    A value belongs to the block of its own level, at the place where it is needed first; ``exported`` are those that
    deeper blocks read.
    """

    def __init__(self, items: Sequence[Statement], depth: int) -> None:
        self.values: list[list[Scalar]] = [[] for _ in range(depth + 1)]
        self.items: list[list[tuple[int, Statement]]] = [[] for _ in range(depth + 1)]
        self.exported: set[int] = set()
        self._seen: set[int] = set()
        for item in items:
            for operand in item.operands:
                self._need(operand, item.level)
            self.items[item.level].append((len(self.values[item.level]), item))

    def _need(self, node: Scalar, level: int) -> None:
        if node.is_plain:
            return
        if node.level < level:
            self.exported.add(id(node))
        if id(node) not in self._seen:
            self._seen.add(id(node))
            for arg in node.args:
                self._need(arg, node.level)
            self.values[node.level].append(node)


class _Recorded:
    """The values of one block as a :class:`rrrgen.program.Program`.

    Its inputs are the C variables that the block reads; ``texts`` holds their names in the order of the inputs.
    """

    def __init__(self, level: int, outside: Mapping[int, str]) -> None:
        self.texts: list[str] = []
        self.exported: set[int] = set()
        self._level, self._outside = level, outside
        self._nodes: list[Node] = []
        self._index: dict[int, int] = {}
        self._places: dict[str, int] = {}
        self._results: list[tuple[int, ...]] = []

    def __len__(self) -> int:
        return len(self._nodes)

    def add(self, node: Scalar) -> int:
        """Record ``node`` with everything it depends on, unless it is recorded already; returns its index."""
        index = self._index.get(id(node))
        if index is None:
            index = self._index[id(node)] = self._new(node)
        return index

    def _new(self, node: Scalar) -> int:
        if node.is_const:
            return self._node(Node(Op.CONST, (), Fraction(repr(node.value))))
        text = node.text if node.op is Op.INPUT else self._outside.get(id(node), "")
        if not text:
            return self._node(Node(node.op, tuple(self.add(arg) for arg in node.args)))
        if text not in self._places:
            self._places[text] = self._node(Node(Op.INPUT, (), (0, len(self.texts))))
            self.texts.append(text)
        return self._places[text]

    def _node(self, node: Node) -> int:
        self._nodes.append(node)
        return len(self._nodes) - 1

    def use(self, nodes: Sequence[Scalar]) -> tuple[int, ...]:
        """Make ``nodes`` an output, because a statement or a deeper block reads them; returns their indices."""
        self._results.append(tuple(self.add(node) for node in nodes))
        return self._results[-1]

    def program(self) -> Program:
        """The block as a program with one output per call of :meth:`use`."""
        outputs = tuple(Port(f"use{k}", (len(row),)) for k, row in enumerate(self._results))
        inputs = (Port("variables", (len(self.texts),)),)
        return Program(f"block{self._level}", inputs, outputs, tuple(self._nodes), tuple(self._results))

    def restricted(self, values: Iterable[Scalar]) -> Program:
        """A program of the nodes of ``values`` alone, for counting operations; it has no outputs."""
        kept = [self._nodes[self.add(node)] for node in values]
        return replace(self.program(), outputs=(), nodes=tuple(kept), results=())


class _Lines(Statements):
    """Prints one block: each of its statements, preceded by the definitions of the values that it reads."""

    def __init__(self, block: _Recorded, exported: Iterable[int], target: Target, names: Names) -> None:
        self._exported = frozenset(exported)
        super().__init__(block.program(), target, names, lambda _, element: block.texts[element])
        self._named = self._worth_a_name()
        self._visited = 0

    def _worth_a_name(self) -> list[bool]:
        """For every node, whether it gets a C variable: if it is used more than once or read by a deeper block.

        The negative of a variable gets none; it is written as ``-x`` wherever it is read.
        """
        nodes = self.program.nodes
        plain = [node.op is Op.NEG and nodes[node.args[0]].op is Op.INPUT for node in nodes]
        shared = super()._worth_a_name()
        return [(shared[k] or k in self._exported) and not plain[k] for k in range(len(nodes))]

    def advance(self, count: int) -> None:
        """Print the definitions of all nodes before index ``count`` that have not been printed yet."""
        for index in range(self._visited, count):
            self._visit(index)
        self._visited = max(self._visited, count)


def printed(
    items: Sequence[Statement], loops: Sequence[Loop], target: Target, taken: Iterable[str]
) -> tuple[str, SolverOperations]:
    """The C text of the statements nested in their loops, and the operations of one evaluation.

    Definitions that nothing uses are left out. ``taken`` are names that new variables must not have.
    """
    live = _live(items)
    blocks, regular = _Blocks(live, len(loops)), _regular(live)
    names = Names(target.reserved, taken)
    outside: dict[int, str] = {}
    lines: list[str] = []
    counts: list[SolverOperations] = []
    for depth in range(len(loops) + 1):
        indent = "    " * (depth + 1)
        block, printer = _block(blocks, depth, outside, target, names)
        lines += [indent + line for line in printer.lines]
        calls = [call for _, item in blocks.items[depth] for call in item.calls]
        evaluated = block.restricted(node for node in blocks.values[depth] if id(node) in regular)
        counts.append(block_operations(evaluated, calls, prod(loop.most for loop in loops[:depth])))
        if depth < len(loops):
            lines.append(indent + opening(loops[depth]))
    lines += ["    " * (depth + 1) + "}" for depth in reversed(range(len(loops)))]
    return "\n".join(lines), sum_of(counts)


def _block(
    blocks: _Blocks, depth: int, outside: dict[int, str], target: Target, names: Names
) -> tuple[_Recorded, _Lines]:
    """Print the block at one depth of loops; the names of values that deeper blocks read are added to ``outside``."""
    block = _Recorded(depth, outside)
    values, done = blocks.values[depth], 0
    uses: list[tuple[int, Statement, tuple[int, ...]]] = []
    for count, item in blocks.items[depth]:
        for node in values[done:count]:
            block.add(node)
        done = count
        operands = block.use(item.operands)
        uses.append((len(block), item, operands))
    for node in values[done:]:
        block.add(node)
    exported = {id(node): block.add(node) for node in values if id(node) in blocks.exported}
    printer = _Lines(block, exported.values(), target, names)
    for count, item, operands in uses:
        printer.advance(count)
        texts = [printer.texts[index].code for index in operands]
        printer.lines += [_fill(line, texts) for line in item.lines]
    printer.advance(len(block))
    outside.update({key: printer.texts[index].code for key, index in exported.items()})
    return block, printer


def _regular(items: Sequence[Statement]) -> set[int]:
    """The ids of the values that are needed when no joint is free; operands marked ``rare`` are not followed."""
    found: set[int] = set()
    for item in items:
        for k, operand in enumerate(item.operands):
            if k not in item.rare:
                _collect(operand, found)
    return found


def _collect(node: Scalar, found: set[int]) -> None:
    if id(node) not in found:
        found.add(id(node))
        for arg in node.args:
            _collect(arg, found)


def _live(items: Sequence[Statement]) -> list[Statement]:
    """The statements without definitions of variables that no later statement uses."""
    used: set[int] = set()
    kept = []
    for item in reversed(items):
        if item.defines is None or id(item.defines) in used:
            kept.append(item)
            for operand in item.operands:
                _collect(operand, used)
    return kept[::-1]


def _fill(line: str, operands: list[str]) -> str:
    for i, text in enumerate(operands):
        line = line.replace(f"{{{i}}}", text)
    return line
