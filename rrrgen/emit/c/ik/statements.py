"""Printing of a loop nest as C; the values between two loops form a program, printed once in the order of use."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from math import prod

from rrrgen.emit.c.ik.costs import CALLS, SolverOperations, block_operations, sum_of
from rrrgen.emit.c.ik.loop_nest import ARC, STOP, Leaf, LoopNest, Statement, Value, opening
from rrrgen.emit.interface import Target
from rrrgen.emit.printing import Names, Statements
from rrrgen.ik.recording.scalar import SolverScalar, collect
from rrrgen.program import Node, Op, Port, Program


@dataclass(frozen=True)
class CBody:
    """The printed body of a C function that lists candidates: its text, the kernels it calls, its operation counts."""

    text: str
    needs: frozenset[str]
    operations: SolverOperations


class _Blocks:
    """The statements and the values that they need, sorted into one block for each depth of nested loops.

    A value belongs to the block where it is needed first; ``exported`` are those that deeper blocks read.
    """

    def __init__(self, nest: LoopNest) -> None:
        depths = len(nest.loops) + 1
        self.values: list[list[SolverScalar]] = [[] for _ in range(depths)]
        self.items: list[list[tuple[int, Statement | Leaf]]] = [[] for _ in range(depths)]
        self.exported: set[int] = set()
        self._places: dict[int, int] = {}
        for item in nest.items:
            for operand in item.operands:
                self._need(operand, item.depth)
            if not isinstance(item, Value):
                self.items[item.depth].append((len(self.values[item.depth]), item))

    def _need(self, node: SolverScalar, depth: int) -> None:
        if node.is_plain:
            return
        place = self._places.get(id(node))
        if place is None:
            self._places[id(node)] = depth
            for arg in node.args:
                self._need(arg, depth)
            self.values[depth].append(node)
        elif place < depth:
            self.exported.add(id(node))


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

    def add(self, node: SolverScalar) -> int:
        """Record ``node`` with everything it depends on, unless it is recorded already; returns its index."""
        index = self._index.get(id(node))
        if index is None:
            index = self._index[id(node)] = self._new(node)
        return index

    def _new(self, node: SolverScalar) -> int:
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

    def use(self, nodes: Sequence[SolverScalar]) -> tuple[int, ...]:
        """Make ``nodes`` an output, because a statement or a deeper block reads them; returns their indices."""
        self._results.append(tuple(self.add(node) for node in nodes))
        return self._results[-1]

    def program(self) -> Program:
        """The block as a program with one output per call of :meth:`use`."""
        outputs = tuple(Port(f"use{k}", (len(row),)) for k, row in enumerate(self._results))
        inputs = (Port("variables", (len(self.texts),)),)
        return Program(f"block{self._level}", inputs, outputs, tuple(self._nodes), tuple(self._results))

    def restrict(self, values: Iterable[SolverScalar]) -> Program:
        """A program of the nodes of ``values`` alone, for counting operations; it has no outputs."""
        kept = [self._nodes[self.add(node)] for node in values]
        return replace(self.program(), outputs=(), nodes=tuple(kept), results=())


class _BlockPrinter(Statements):
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


def print_nest(nest: LoopNest, target: Target, taken: Iterable[str]) -> tuple[str, SolverOperations]:
    """Print ``nest`` as C: (text, operations of one evaluation).

    ``taken`` are names that new variables must not have.
    """
    blocks, regular = _Blocks(nest), _regular(nest)
    names = Names(target.reserved, taken)
    outside: dict[int, str] = {}
    lines = [f"    {line}" for line in nest.before]
    counts = [CALLS[name] for name in nest.calls]
    for depth in range(len(nest.loops) + 1):
        indent = "    " * (depth + 1)
        block, printer = _block(blocks, depth, outside, target, names)
        lines += [indent + line for line in printer.lines]
        calls = [call for _, item in blocks.items[depth] if isinstance(item, Statement) for call in item.calls]
        evaluated = block.restrict(node for node in blocks.values[depth] if id(node) in regular)
        counts.append(block_operations(evaluated, calls, prod(loop.most for loop in nest.loops[:depth])))
        if depth < len(nest.loops):
            lines.append(indent + opening(nest.loops[depth]))
    lines += ["    " * (depth + 1) + "}" for depth in reversed(range(len(nest.loops)))]
    lines += [f"    {line}" for line in nest.after]
    return "\n".join(lines), sum_of(counts)


def _block(
    blocks: _Blocks, depth: int, outside: dict[int, str], target: Target, names: Names
) -> tuple[_Recorded, _BlockPrinter]:
    """Print the block at one depth of loops.

    ``outside`` maps the values known from outer blocks to their C names; those that deeper blocks read are added to it.
    """
    block = _Recorded(depth, outside)
    values, done = blocks.values[depth], 0
    uses: list[tuple[int, Statement | Leaf, tuple[int, ...]]] = []
    for count, item in blocks.items[depth]:
        for node in values[done:count]:
            block.add(node)
        done = count
        operands = block.use(item.operands)
        uses.append((len(block), item, operands))
    for node in values[done:]:
        block.add(node)
    exported = {id(node): block.add(node) for node in values if id(node) in blocks.exported}
    printer = _BlockPrinter(block, exported.values(), target, names)
    for count, item, operands in uses:
        printer.advance(count)
        texts = [printer.texts[index].code for index in operands]
        printer.lines += [_fill(line, texts) for line in _lines(item)]
    printer.advance(len(block))
    outside.update({key: printer.texts[index].code for key, index in exported.items()})
    return block, printer


def _regular(nest: LoopNest) -> set[int]:
    """The ids of the values that are needed when no joint is free; operands marked ``rare`` are not followed."""
    ids: set[int] = set()
    for item in nest.items:
        if isinstance(item, Value):
            continue  # it is counted where a statement reads it
        for k, operand in enumerate(item.operands):
            if isinstance(item, Leaf) or k not in item.rare:
                collect(operand, ids)
    return ids


def _lines(item: Statement | Leaf) -> list[str]:
    """The C lines of ``item``; the variable of an arc tangent in them is declared where it is first used."""
    if isinstance(item, Leaf):
        return list(item.lines)
    lines = [line.replace(STOP, "" if item.depth else "return 0; ") for line in item.lines]
    if item.arc is None:
        return lines
    taken = f"{item.arc.angle.text} = ik_atan2({item.arc.sine}, {item.arc.cosine});"
    first = lines.index(ARC)
    return [line.replace(ARC, f"REAL {taken}" if k == first else taken) for k, line in enumerate(lines)]


def _fill(line: str, operands: list[str]) -> str:
    for i, text in enumerate(operands):
        line = line.replace(f"{{{i}}}", text)
    return line
