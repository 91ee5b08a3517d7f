"""Recording programs: arithmetic on the nodes of a :class:`Builder`, written with the Python operators.

Nodes are hash-consed while they are recorded, so a common subexpression exists once, and the identities of arithmetic
that never change a value in exact arithmetic (x + 0, 1*x, -(-x), constants folded exactly as fractions) are applied at
once. Structural zeros never enter a program: an operation whose result is known while recording returns a plain number.

:class:`Scalar` wraps a node with the Python operators. Code that derives models is written with those operators only,
so the same derivation also runs over floats, exact rationals, finite fields and trigonometric polynomials.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from fractions import Fraction

from rrrgen.base.errors import InternalError
from rrrgen.program.program import Node, Op, Port, Program, Status, reachable

Number = int | Fraction
"""A number known while recording; whole ones are ints."""

RESIDUE_INVERSE = 10**30
"""Magnitudes below 1/RESIDUE_INVERSE are cancellation residue of irrational constants, which have 40 digits: treated
as 0."""


def plain(number: Number) -> Number:
    """Convert a whole number to an int, with which Python computes ten times as fast; other numbers stay."""
    return number if type(number) is int or number.denominator != 1 else number.numerator


def drop_residue(value: Number) -> Number:
    """Replace ``value`` by 0 where it is only cancellation residue, below 1/:data:`RESIDUE_INVERSE` in magnitude."""
    return 0 if _negligible(value) else value


def _negligible(value: Number) -> bool:
    """Whether ``value`` is zero or residue. In integers, since comparing Fractions would dominate recording time."""
    return not value if type(value) is int else abs(value.numerator) * RESIDUE_INVERSE < value.denominator


class Scalar:
    """A node of a builder with the Python operators + - * /; results known while recording are plain numbers."""

    __slots__ = ("builder", "index")

    def __init__(self, builder: Builder, index: int) -> None:
        self.builder = builder
        self.index = index

    def __add__(self, other: Value) -> Value:
        return self.builder.add(self, other)

    def __radd__(self, other: Value) -> Value:
        return self.builder.add(other, self)

    def __sub__(self, other: Value) -> Value:
        return self.builder.sub(self, other)

    def __rsub__(self, other: Value) -> Value:
        return self.builder.sub(other, self)

    def __mul__(self, other: Value) -> Value:
        return self.builder.mul(self, other)

    def __rmul__(self, other: Value) -> Value:
        return self.builder.mul(other, self)

    def __truediv__(self, other: Value) -> Value:
        return self.builder.div(self, other)

    def __rtruediv__(self, other: Value) -> Value:
        return self.builder.div(other, self)

    def __neg__(self) -> Value:
        return self.builder.neg(self)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Scalar) and other.builder is self.builder and other.index == self.index

    def __hash__(self) -> int:
        return hash((id(self.builder), self.index))

    def __repr__(self) -> str:
        return f"Scalar({self.index}: {self.builder.nodes[self.index]})"


Value = Scalar | Number
"""What recorded arithmetic works on: a node, or a number known while recording."""


class Builder:
    """Records arithmetic into the nodes of a program."""

    def __init__(self) -> None:
        self.nodes: list[Node] = []
        self.ports: list[Port] = []
        self.labels: dict[int, str] = {}
        self._index: dict[tuple[Op, tuple[int, ...], object], int] = {}
        self._constants: dict[tuple[int, int], int] = {}  # keyed by two ints, since hashing a Fraction is slow

    # -- recording -----------------------------------------------------------------------------------------------

    def _node(self, op: Op, args: tuple[int, ...] = (), value: object = None) -> int:
        key = (op, args, value)
        index = self._index.get(key)
        if index is None:
            index = self._index[key] = len(self.nodes)
            self.nodes.append(tuple.__new__(Node, key))  # half the time of Node(...)
        return index

    def _find_node(self, op: Op, args: tuple[int, ...]) -> int | None:
        return self._index.get((op, args, None))

    def input(self, port: Port) -> list[Scalar]:
        """Declare an input port and return its elements, row-major."""
        self.ports.append(port)
        position = len(self.ports) - 1
        return [Scalar(self, self._node(Op.INPUT, (), (position, k))) for k in range(port.size)]

    def index_of(self, value: Value) -> int:
        """The node that holds ``value``; numbers become constants."""
        if isinstance(value, Scalar):
            if value.builder is not self:
                raise InternalError("a value of one builder was used in another")
            return value.index
        value = plain(value)
        if type(value) is int:
            return self._node(Op.CONST, (), value)
        key = (value.numerator, value.denominator)
        index = self._constants.get(key)
        if index is None:
            index = self._constants[key] = len(self.nodes)
            self.nodes.append(Node(Op.CONST, (), value))
        return index

    def label(self, value: Value, name: str) -> Value:
        """Suggest a readable name for a value; the first suggestion stays."""
        if isinstance(value, Scalar) and self.nodes[value.index].op is not Op.INPUT:
            self.labels.setdefault(value.index, name)
        return value

    def _op(self, value: Scalar) -> Node:
        if value.builder is not self:
            raise InternalError("a value of one builder was used in another")
        return self.nodes[value.index]

    def _strip_negation(self, value: Value) -> Value | None:
        """Return ``x`` if ``value`` is recorded as ``-x``, else None."""
        if not isinstance(value, Scalar):
            return None
        node = self.nodes[value.index]
        return Scalar(self, node.args[0]) if node.op is Op.NEG else None

    def _split_sign(self, value: Scalar) -> tuple[int, bool]:
        """Split off a sign: ``(k, False)`` if ``value`` is node k, ``(k, True)`` if it is recorded as minus node k."""
        node = self._op(value)
        return (node.args[0], True) if node.op is Op.NEG else (value.index, False)

    def _split_factor(self, value: Scalar) -> tuple[Number, Scalar]:
        """Split ``value`` into (constant factor, remaining node)."""
        node = self._op(value)
        if node.op is Op.NEG:
            factor, rest = self._split_factor(Scalar(self, node.args[0]))
            return -factor, rest
        if node.op is Op.MUL and self.nodes[node.args[0]].op is Op.CONST:
            return self.nodes[node.args[0]].number, Scalar(self, node.args[1])
        return 1, value

    # -- arithmetic ----------------------------------------------------------------------------------------------

    def add(self, x: Value, y: Value) -> Value:
        """x + y."""
        if not isinstance(x, Scalar):
            x, y = y, x
        if not isinstance(x, Scalar):
            return drop_residue(x + y)  # type: ignore[arg-type]
        if not isinstance(y, Scalar):
            if _negligible(y):
                return x
            minus = self._strip_negation(x)
            return self.sub(y, minus) if minus is not None else self._binary(Op.ADD, x, y)
        if x.index == y.index:
            return self.mul(2, x)
        first, second = self._op(x), self._op(y)
        if second.op is Op.NEG:
            return self.sub(x, Scalar(self, second.args[0]))
        if first.op is Op.NEG:
            return self.sub(y, Scalar(self, first.args[0]))
        if first.op is Op.SUB and first.args[1] == y.index:  # (a - b) + b = a
            return Scalar(self, first.args[0])
        if second.op is Op.SUB and second.args[1] == x.index:
            return Scalar(self, second.args[0])
        return self._binary(Op.ADD, x, y)

    def sub(self, x: Value, y: Value) -> Value:
        """x - y."""
        if not isinstance(x, Scalar) and not isinstance(y, Scalar):
            return drop_residue(x - y)
        if not isinstance(y, Scalar):
            if _negligible(y):
                return x
            return self.add(x, -Fraction(y)) if y < 0 else self._subtract(x, y)
        if (minus := self._strip_negation(y)) is not None:
            return self.add(x, minus)
        if not isinstance(x, Scalar):
            return self.neg(y) if _negligible(x) else self._subtract(x, y)
        if x.index == y.index:
            return 0
        node = self._op(x)
        if node.op is Op.ADD and y.index in node.args:  # (a + b) - b = a
            return Scalar(self, node.args[0] if node.args[1] == y.index else node.args[1])
        if (minus := self._strip_negation(x)) is not None:
            return self.neg(self.add(minus, y))
        return self._subtract(x, y)

    def _subtract(self, x: Value, y: Value) -> Value:
        i, j = self.index_of(x), self.index_of(y)
        reverse = self._find_node(Op.SUB, (j, i))
        if reverse is not None:
            return self.neg(Scalar(self, reverse))
        return Scalar(self, self._node(Op.SUB, (i, j)))

    def mul(self, x: Value, y: Value) -> Value:
        """x * y."""
        if not isinstance(x, Scalar):
            return self._scale(x, y) if isinstance(y, Scalar) else x * y
        if not isinstance(y, Scalar):
            return self._scale(y, x)
        # Signs move outwards, where sums absorb them; constant factors stay where they are shared.
        (i, minus_x), (j, minus_y) = self._split_sign(x), self._split_sign(y)
        product = Scalar(self, self._node(Op.MUL, (i, j) if i < j else (j, i)))
        return product if minus_x == minus_y else self.neg(product)

    def knows_product(self, x: Value, y: Value) -> bool:
        """Whether x * y is recorded, up to its sign."""
        if not isinstance(x, Scalar) or not isinstance(y, Scalar):
            return False
        (i, _), (j, _) = self._split_sign(x), self._split_sign(y)
        return self._find_node(Op.MUL, (i, j) if i < j else (j, i)) is not None

    def _scale(self, factor: Number, x: Scalar) -> Value:
        recorded, x = self._split_factor(x)
        factor = plain(factor if recorded == 1 else factor * recorded)
        if _negligible(factor):
            return 0
        if factor.numerator < 0:  # the sign is kept outside, where sums absorb it
            return self.neg(self._times(-factor, x))
        return self._times(factor, x)

    def _times(self, factor: Number, x: Scalar) -> Scalar:
        if type(factor) is int and factor == 1:
            return x
        return Scalar(self, self._node(Op.MUL, (self.index_of(factor), x.index)))

    def double(self, x: Value) -> Value:
        """2 x, recorded as the addition x + x."""
        return self._binary(Op.ADD, x, x) if isinstance(x, Scalar) else 2 * Fraction(x)

    def _binary(self, op: Op, x: Value, y: Value) -> Scalar:
        i, j = self.index_of(x), self.index_of(y)
        return Scalar(self, self._node(op, (i, j) if i < j else (j, i)))

    def neg(self, x: Value) -> Value:
        """-x."""
        if not isinstance(x, Scalar):
            return -Fraction(x)
        node = self._op(x)
        if node.op is Op.NEG:
            return Scalar(self, node.args[0])
        if node.op is Op.SUB and (reverse := self._find_node(Op.SUB, node.args[::-1])) is not None:
            return Scalar(self, reverse)
        return Scalar(self, self._node(Op.NEG, (x.index,)))

    def div(self, x: Value, y: Value) -> Value:
        """x / y."""
        if not isinstance(y, Scalar):
            return self.mul(x, 1 / Fraction(y))
        if not isinstance(x, Scalar) and x == 0:
            return 0
        return Scalar(self, self._node(Op.DIV, (self.index_of(x), y.index)))

    def _function(self, op: Op, x: Value, exact: Callable[[Fraction], Value | None]) -> Value:
        if not isinstance(x, Scalar):
            value = exact(Fraction(x))
            if value is not None:
                return value
        return Scalar(self, self._node(op, (self.index_of(x),)))

    def sin(self, x: Value) -> Value:
        """sin(x), x in rad; sin(-x) is recorded as -sin(x)."""
        if (minus := self._strip_negation(x)) is not None:
            return self.neg(self.sin(minus))
        return self._function(Op.SIN, x, lambda v: 0 if v == 0 else None)

    def cos(self, x: Value) -> Value:
        """cos(x), x in rad; cos(-x) is recorded as cos(x)."""
        if (minus := self._strip_negation(x)) is not None:
            return self.cos(minus)
        return self._function(Op.COS, x, lambda v: 1 if v == 0 else None)

    def sqrt(self, x: Value) -> Value:
        """The square root of x >= 0."""
        return self._function(Op.SQRT, x, lambda v: v if v in (0, 1) else None)

    def abs(self, x: Value) -> Value:
        """|x|."""
        return self._function(Op.ABS, x, lambda v: abs(v))

    def sign(self, x: Value) -> Value:
        """sgn(x): -1, 0 or +1."""
        return self._function(Op.SIGN, x, lambda v: Fraction((v > 0) - (v < 0)))

    def exp(self, x: Value) -> Value:
        """exp(x)."""
        return self._function(Op.EXP, x, lambda v: 1 if v == 0 else None)

    def tanh(self, x: Value) -> Value:
        """tanh(x)."""
        return self._function(Op.TANH, x, lambda v: 0 if v == 0 else None)

    def min(self, x: Value, y: Value) -> Value:
        """The smaller of x and y."""
        if isinstance(x, Scalar) or isinstance(y, Scalar):
            return self._binary(Op.MIN, x, y)
        return min(x, y)

    def nonfinite(self, x: Value) -> Value:
        """0 where x is finite, 1 where it is infinite, 2 where it is NaN."""
        return self._function(Op.NONFINITE, x, lambda v: 0)

    def select(self, condition: Value, positive: Value, otherwise: Value) -> Value:
        """Record a selection: ``positive`` where ``condition > 0``, else ``otherwise``."""
        if not isinstance(condition, Scalar):
            return positive if condition > 0 else otherwise
        return Scalar(
            self,
            self._node(Op.SELECT, (condition.index, self.index_of(positive), self.index_of(otherwise))),
        )

    # -- finishing -----------------------------------------------------------------------------------------------

    def program(
        self,
        name: str,
        outputs: Iterable[tuple[Port, Sequence[Value]]],
        summary: str = "",
        formula: str = "",
        notes: Sequence[str] = (),
        status: Status | None = None,
    ) -> Program:
        """The recorded program with the given outputs; nodes that no output depends on are dropped.

        ``outputs`` pairs each output port with its elements, row-major. ``summary``, ``formula`` and ``notes`` describe
        the function in generated files; ``status`` names the output that reports failure, if evaluation can fail.
        """
        ports, values = [], []
        for port, elements in outputs:
            ports.append(port)
            values.append([self.index_of(element) for element in elements])
        keep = reachable(self.nodes, (index for row in values for index in row))
        nodes, place = _renumber(self.nodes, keep)
        program = Program(
            name=name,
            inputs=tuple(self.ports),
            outputs=tuple(ports),
            nodes=tuple(nodes),
            results=tuple(tuple(place[index] for index in row) for row in values),
            summary=summary,
            formula=formula,
            notes=tuple(notes),
            labels={place[k]: v for k, v in self.labels.items() if k in place},
            status=status,
        )
        program.validate()
        return program

    def rewritten(self, program: Program, results: Iterable[Sequence[Value]]) -> Program:
        """The recording as a new version of ``program``: same ports and description, ``results`` per output."""
        outputs = zip(program.outputs, results, strict=True)
        return self.program(program.name, outputs, program.summary, program.formula, program.notes, program.status)


def _renumber(nodes: list[Node], keep: Sequence[int]) -> tuple[list[Node], range | dict[int, int]]:
    """The nodes ``keep``, in order, with operands numbered anew, and the new number of each."""
    if len(keep) == len(nodes):
        return nodes, range(len(nodes))
    place = {old: new for new, old in enumerate(keep)}
    moved = place.__getitem__
    kept = [nodes[old] for old in keep]
    return [tuple.__new__(Node, (op, tuple(map(moved, args)), value)) for op, args, value in kept], place


def replay(
    program: Program, builder: Builder, inputs: Sequence[Sequence[Value]], given: Mapping[int, Value] | None = None
) -> list[list[Value]]:
    """Record ``program`` into ``builder`` with ``inputs[k]`` (row-major elements) in place of its input port k.

    Returns the elements of each output. It is used to call one program from another, to replace inputs by numbers, and
    to simplify a program again. ``given`` are values of operations, by their nodes, that are not recorded again.
    """
    values: list[Value] = []
    known, labels, given = values.__getitem__, program.labels, given or {}
    for index, node in enumerate(program.nodes):
        op, args, _ = node
        if op is Op.INPUT:
            port, element = node.place
            value: Value = inputs[port][element]
        elif op is Op.CONST:
            value = node.number
        elif index in given:
            value = given[index]
        else:
            value = getattr(builder, op.value)(*map(known, args))
        if index in labels:
            builder.label(value, labels[index])
        values.append(value)
    return [[values[index] for index in row] for row in program.results]
