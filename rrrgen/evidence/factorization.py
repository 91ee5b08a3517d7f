"""The factorization ``M = L D L'`` in emitted programs: its nodes, its sums, and what is known of its numbers.

Programs that solve with M are read as :mod:`rrrgen.evidence.residual` writes them. That an emitted program is of this
form is not assumed: its nodes are recognised by their values at a random state in arithmetic with 50 digits, every sum
is compared with its formula at random values of all operands, and a program that is written in another way is refused.
Another sum would agree at random numbers only with negligible probability.
"""

from __future__ import annotations

import random
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import mpmath

from rrrgen.evidence.rounding import DOUBLE, FLOAT, Box, NoBoundError, RoundingBounds, enclosures, rounding_bounds
from rrrgen.evidence.vectors import DIGITS, exact_values
from rrrgen.program import Op, Port, Program, Role
from rrrgen.program.program import Node, reachable, with_results

SAME = 30
"""Digits in which values of the same quantity agree."""

REARRANGED = "the factorization is not emitted in the order of operations of the analysis"
MARGIN = 1.0 + 2.0**-40
"""Factor that covers the roundings of the formulas themselves."""


@dataclass(frozen=True)
class Fact:
    """Bounds ``low`` and ``high`` of a node, which hold as soon as the node ``after`` has passed its test."""

    after: int
    node: int
    low: float
    high: float


LEAST_PIVOT = 2.0**-50
"""Pivots, kg m^2 or kg, down to which :func:`factorization_facts` hold."""


def factorization_facts(program: Program, mass: Program, box: Box) -> list[Fact]:
    """Bounds of the factors of M in ``program``, in double, where the status is ok and no pivot is below LEAST_PIVOT.

    By step 1 of the module, every term ``S_jk L_jk`` that is subtracted from M_jj is at most ``T = W (1 + g)/(1 - g)``
    where pivot j is positive, and so is the pivot itself. With ``L_jk = S_jk r_k`` and the bounds of pivot k,
    ``S_jk^2 <= T_j T_k`` and ``L_jk^2 <= T_j / LEAST_PIVOT`` but for roundings. ``mass`` is the program of M; ``box``
    holds the ranges of the inputs but for torques. Raises NoBoundError if the factorization is not recognised.
    """
    state = state_in(program, box)
    known = {port.name: box[port.name] for port in program.inputs if port.role is not Role.TORQUE}
    with mpmath.workdps(DIGITS):
        read = in_either_order(
            mass.data_outputs[0].shape[0], lambda order: _require_same_sums(Factorization(program, mass, state, order))
        )
    rows = enclosures(with_results(program, [read.summands(index) for index in read.pivots]), known, budget=0.0)
    u, n = DOUBLE.roundoff, read.n
    more = 1.0 + 2.0**-20
    m = n + max(map(len, rows))
    g = m * u / (1.0 - m * u)
    T = [sum(max(-low, high) for low, high in row) * (1.0 + g) / (1.0 - g) * more for row in rows]
    facts = []
    for j, pivot in enumerate(read.pivots):
        if pivot is None:
            continue
        facts.append(Fact(pivot, pivot, LEAST_PIVOT, T[j]))
        for index, role in read.roles.items():
            if role.row == j and role.kind in ("S", "L") and read.nodes[index].op not in (Op.INPUT, Op.CONST):
                of_pivot = (
                    T[role.column] if read.pivots[role.column] is not None else float(read.S[role.column][role.column])
                )
                size = (T[j] * (of_pivot if role.kind == "S" else 1.0 / LEAST_PIVOT)) ** 0.5 * more
                facts.append(Fact(pivot, index, -size, size))
    return facts


def _require_same_sums(read: Factorization) -> Factorization:
    """The factorization, if its sums are those of the analysis. Raises NoBoundError if not."""
    cut = Cut(read)
    (triangle,), value = read.evaluate_at_random(cut, [read.triangle(cut)])
    read.compare(triangle, value)
    return read


_Read = TypeVar("_Read")


def in_either_order(n: int, read: Callable[[tuple[int, ...]], _Read]) -> _Read:
    """What ``read`` finds with the base or with the tip eliminated first. Raises NoBoundError if neither is found."""
    reason = NoBoundError(REARRANGED)
    for order in dict.fromkeys((tuple(range(n)), tuple(reversed(range(n))))):
        try:
            return read(order)
        except NoBoundError as fault:
            reason = fault
    raise reason


def in_triangle(i: int, j: int) -> int:
    """The number of the entry (i, j), i >= j, of a lower triangle, row by row."""
    return i * (i + 1) // 2 + j


# ------------------------------------------------------------------------------------------------------------------
# The form of the emitted program
# ------------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Operand:
    """A computed quantity that stands in products: "S", "L", "y", "x" or "r" with its row and its column.

    y, x and r are vectors; their row is their column. ``sign`` is 1 or -1: the node holds this multiple of it.
    """

    kind: str
    row: int
    column: int
    sign: int


@dataclass(frozen=True)
class Form:
    """Forward dynamics of n joints as sums whose products of computed quantities have inputs as operands.

    ``order`` are the joints in the order of elimination. Outputs of ``sums`` are the lower triangle of S, row by row,
    and y; its inputs are those of forward dynamics and the port "operands", described by ``operands``. Every output of
    ``summands`` holds the summands of a pivot, or then of an element of y, without products and torques.
    """

    n: int
    order: tuple[int, ...]
    sums: Program
    operands: tuple[Operand, ...]
    summands: Program
    most_summands: int

    def growth(self, roundoff: float) -> float:
        """The factor m u/(1 - m u) of the sums of :mod:`rrrgen.evidence.residual`, with the unit roundoff u."""
        return self.most_summands * roundoff / (1.0 - self.most_summands * roundoff)

    def weights(self, known: Box, plain: Sequence[float], largest: Sequence[float]) -> list[float]:
        """The numbers G_j with ``sum over k of |L_ik| d_k |L_jk| <= G_i G_j``: steps 1 and 2 of the residual's proof.

        ``plain`` are the :meth:`magnitudes`, ``largest`` the upper bounds of M_jj.
        """
        u = FLOAT.roundoff
        g = self.growth(u)
        G = [(plain[j] * (1.0 + g) / (1.0 - g)) ** 0.5 * MARGIN for j in range(self.n)]
        errors = self.bounds(known, G, 1.0, [1.0] * self.n).single[0]
        return [((largest[j] + errors[in_triangle(j, j)]) * (1.0 + 8.0 * u)) ** 0.5 * MARGIN for j in range(self.n)]

    def magnitudes(self, known: Box) -> list[float]:
        """The sums of the magnitudes of the summands without products and torques: of the pivots, then of y."""
        rows = enclosures(self.summands, known, budget=0.0)
        return [sum(max(-low, high) for low, high in row) * MARGIN for row in rows]

    def bounds(self, known: Box, G: Sequence[float], Z: float, torques: Sequence[float]) -> RoundingBounds:
        """Rounding bounds of the sums, with ``|S_ik L_jk| <= G_i G_j``, ``|L_ik y_k| <= G_i Z`` and these torques."""
        more = 1.0 + 8.0 * FLOAT.roundoff  # S differs by two roundings from L times the pivot
        sizes = [(Z if operand.kind == "y" else G[operand.row]) * more for operand in self.operands]
        symmetric = {
            OPERANDS: ([-size for size in sizes], sizes),
            torque_port(self.sums).name: self._in_order(torques),
        }
        return rounding_bounds(self.sums, {**known, **symmetric})

    def _in_order(self, torques: Sequence[float]) -> tuple[list[float], list[float]]:
        sizes = [torques[self.order.index(k)] for k in range(self.n)]
        return [-size for size in sizes], sizes


OPERANDS = "operands"


def torque_port(program: Program) -> Port:
    """The input port of the joint torques."""
    return next(port for port in program.inputs if port.role is Role.TORQUE)


def state_in(program: Program, box: Box) -> dict[str, list[float]]:
    """A state whose mass matrix is positive definite: motions and torques at random, parameters amid their ranges."""
    generator = random.Random(program.name)
    for _ in range(_TRIES):
        state = {}
        for port in program.inputs:
            if port.role is Role.TORQUE:
                state[port.name] = [generator.uniform(-10.0, 10.0) for _ in range(port.size)]
            elif port.name not in box:
                raise NoBoundError(f"the input {port.name} has no range")
            else:
                bounds = zip(*box[port.name], strict=True)
                amid = port.role.is_parameter
                state[port.name] = [(a + b) / 2.0 if amid else generator.uniform(a, b) for a, b in bounds]
        values = exact_values(program, [state[port.name] for port in program.inputs])
        assert program.status is not None
        if values[program.results[program.status.output][0]] == 0:
            return state
    raise NoBoundError("no state with a positive definite mass matrix was found")


_TRIES = 8


class Factorization:
    """Recognises the factors of M among the nodes of a program, by their values at one state."""

    def __init__(
        self, program: Program, mass: Program, state: Mapping[str, list[float]], order: tuple[int, ...]
    ) -> None:
        self.program, self.nodes, self.order, self.n = program, program.nodes, order, len(order)
        self.state = state
        self.values = exact_values(program, [state[port.name] for port in program.inputs])
        self._by_value: dict[str, list[int]] = {}
        for index, value in enumerate(self.values):
            self._by_value.setdefault(digits(value), []).append(index)
        M = exact_values(mass, [state[port.name] for port in mass.inputs])
        self.M = [[M[mass.results[0][self.n * i + j]] for j in order] for i in order]
        self.S, self.L = self._factors()
        self.roles: dict[int, Operand] = {}
        self.margins: dict[int, int] = {}  # of pivots: nodes that are positive where the status is ok
        self.pivots = [self._pivot(k) for k in range(self.n)]
        self.entries: dict[tuple[int, int], int] = {}
        for k in range(self.n):
            for i in range(k + 1, self.n):
                self._multiplier(i, k)
        self.depends = self._dependent()

    def _factors(self) -> tuple[list[list[Any]], list[list[Any]]]:
        """S with the pivots on its diagonal, and L, at the state."""
        n, S, L = self.n, [list(row) for row in self.M], [[mpmath.mpf(0)] * self.n for _ in range(self.n)]
        for j in range(n):
            for i in range(j, n):
                for k in range(j):
                    S[i][j] -= S[i][k] * L[j][k]
                if abs(S[i][j]) < abs(self.M[i][i] * self.M[j][j]) ** 0.5 * mpmath.mpf(10) ** -SAME:
                    S[i][j] = mpmath.mpf(0)
            if S[j][j] == 0:
                raise NoBoundError(REARRANGED)
            for i in range(j + 1, n):
                L[i][j] = S[i][j] / S[j][j]
        return S, L

    # -- nodes -------------------------------------------------------------------------------------------------

    def nodes_of(self, value: Any) -> list[int]:
        """The nodes that hold ``value`` or its negative."""
        return self._by_value.get(digits(value), [])

    def plain(self, index: int) -> int:
        """The node behind changes of sign."""
        while self.nodes[index].op is Op.NEG:
            index = self.nodes[index].args[0]
        return index

    def take(self, index: int, kind: str, row: int, column: int, value: Any) -> None:
        """Note that a node holds the quantity ``kind`` of a row and column, whose value at the state is ``value``."""
        sign = 1 if (self.values[index] > 0) == (value > 0) else -1
        known = self.roles.setdefault(index, Operand(kind, row, column, sign))
        if (known.kind, known.row, known.column) != (kind, row, column):
            raise NoBoundError(REARRANGED)

    def _pivot(self, k: int) -> int | None:
        """Take the reciprocal of pivot k; returns the node of the pivot.

        None where it is a number, whose reciprocal is one too.
        """
        reciprocal = 1 / self.S[k][k]
        for index in self.nodes_of(reciprocal):
            node = self.nodes[index]
            if node.op is Op.DIV and self.nodes[node.args[0]].op is Op.CONST and self.nodes[node.args[0]].number == 1:
                choice = self.nodes[node.args[1]]
                if choice.op is Op.SELECT and digits(self.values[choice.args[1]]) == digits(self.S[k][k]):
                    self.take(index, "r", k, k, reciprocal)
                    self.margins[choice.args[1]] = choice.args[0]
                    return choice.args[1]
            if node.op is Op.CONST and node.number > 0 and not any(self.S[k][:k]):
                self.take(index, "r", k, k, reciprocal)
                return None
        raise NoBoundError(REARRANGED)

    def require_positive_pivots(self) -> None:
        """Raise NoBoundError unless a status that is ok implies that every pivot is positive."""
        for k, pivot in enumerate(self.pivots):
            if pivot is not None and not self.is_positive(k, self.margins[pivot], pivot):
                raise NoBoundError(REARRANGED)

    def is_positive(self, k: int, margin: int, pivot: int) -> bool:
        """Whether ``margin > 0`` implies that pivot k is positive.

        The margin is the pivot itself, or the pivot minus a positive number, or minus a positive multiple of the entry
        m of M from which the pivot is what remains when products that are not negative are subtracted: rounded to
        nearest, it is at most m, so that both are positive if the margin is.
        """
        if margin == pivot:
            return True
        node = self.nodes[margin]
        if node.op is not Op.SUB or node.args[0] != pivot:
            return False
        other = self.nodes[node.args[1]]
        if other.op is Op.CONST:
            return other.number > 0
        if other.op is not Op.MUL:
            return False
        factor, entry = other.args
        if self.nodes[factor].op is not Op.CONST:
            factor, entry = entry, factor
        if self.nodes[factor].op is not Op.CONST or self.nodes[factor].number <= 0:
            return False
        leaves = self.leaves(pivot, entry)
        whole = digits(self.values[entry]) == digits(self.M[k][k]) and leaves.count(entry) == 1
        return whole and all(leaf == entry or self.nodes[leaf].op is Op.MUL for leaf in leaves)

    def leaves(self, index: int, last: int | None = None) -> list[int]:
        """The summands of a node: of sums, differences and changes of sign, down to other operations or to ``last``."""
        node = self.nodes[index]
        if node.op in SUMS and index != last:
            return [leaf for arg in node.args for leaf in self.leaves(arg, last)]
        return [index]

    def _multiplier(self, i: int, k: int) -> None:
        """Take L_ik and the entry S_ik that it is made of; nothing if both are zero."""
        if self.S[i][k] == 0:
            return
        for index in self.nodes_of(self.L[i][k]):
            node = self.nodes[index]
            if node.op is not Op.MUL:
                continue
            for a, b in (node.args, node.args[::-1]):
                role = self.roles.get(a)
                if role is not None and (role.kind, role.row) == ("r", k):
                    self.take(index, "L", i, k, self.L[i][k])
                    entry = self.plain(b)
                    self.take(entry, "S", i, k, self.S[i][k])
                    if self.entries.setdefault((i, k), entry) != entry:
                        raise NoBoundError(REARRANGED)
                    break
        if (i, k) not in self.entries:
            raise NoBoundError(REARRANGED)

    def _dependent(self) -> list[bool]:
        """For every node, whether it depends on the reciprocal of a pivot."""
        depends: list[bool] = []
        for node in self.nodes:
            kinds = [self.roles[arg].kind for arg in node.args if arg in self.roles]
            reciprocal = node.op is Op.DIV or (node.op is Op.MUL and "r" in kinds)
            depends.append(reciprocal or any(depends[arg] for arg in node.args))
        return depends

    # -- sums --------------------------------------------------------------------------------------------------

    def triangle(self, cut: Cut) -> list[int]:
        """The copies of the pivots and of the entries below them, row by row, that ``cut`` makes."""
        copies = []
        for i in range(self.n):
            for j in range(i + 1):
                index = self.pivots[i] if i == j else self.entries.get((i, j))
                products = {
                    frozenset({("S", a, k), ("L", b, k)})
                    for k in range(j)
                    if self.S[i][k] != 0 and self.S[j][k] != 0
                    for a, b in ((i, j), (j, i))
                }
                copies.append(cut.zero() if index is None else cut.copy_sum(index, products))
        return copies

    def summands(self, index: int | None) -> list[int]:
        """The summands of a sum that are no products of operands."""
        return [leaf for leaf in ([] if index is None else self.leaves(index)) if not self.depends[leaf]]

    def evaluate_at_random(
        self, cut: Cut, results: Sequence[Sequence[int]]
    ) -> tuple[list[list[Any]], Callable[[str, int, int], Any]]:
        """The sums of ``cut`` at random operands, and the function that returns operands by kind, row and column.

        The operands are independent but for ``S_ik = L_ik / r_k``, as either of the two may stand in a product.
        """
        program = cut.program(results)
        generator = random.Random(program.name)
        reciprocals = [mpmath.mpf(generator.uniform(0.5, 2.0)) for _ in range(self.n)]
        known: dict[tuple[str, int, int], Any] = {}

        def value(kind: str, row: int, column: int) -> Any:
            if kind == "r":
                return reciprocals[row]
            if kind == "S":
                return value("L", row, column) / reciprocals[column]
            if kind == "L" and self.S[row][column] == 0:
                return mpmath.mpf(0)
            place = (kind, row, column)
            if place not in known:
                known[place] = mpmath.mpf(generator.uniform(0.5, 2.0))
            return known[place]

        operands = [o.sign * value(o.kind, o.row, o.column) for o in cut.operands]
        values = exact_values(program, [*(self.state[port.name] for port in self.program.inputs), operands])
        return [[values[index] for index in row] for row in program.results], value

    def compare(self, triangle: Sequence[Any], value: Callable[[str, int, int], Any]) -> None:
        """Compare pivots and entries with their formulas. Raises NoBoundError if one is another sum."""
        for i in range(self.n):
            for j in range(i + 1):
                if (i, j) in self.entries or (i == j and self.pivots[i] is not None):
                    products = [value("S", i, k) * value("L", j, k) for k in range(j)]
                    self.agree(triangle[in_triangle(i, j)], self.M[i][j], products)

    def agree(self, value: Any, first: Any, subtracted: Sequence[Any]) -> None:
        """Raise NoBoundError unless ``value`` is ``first`` minus what is ``subtracted``, or its negative."""
        expected = first - sum(subtracted)
        size = abs(first) + sum(abs(term) for term in subtracted)
        if abs(abs(value) - abs(expected)) > size * mpmath.mpf(10) ** -SAME:
            raise NoBoundError(REARRANGED)


class Cut:
    """Copies nodes of a program, with an input in place of every computed quantity that is an operand of a product."""

    def __init__(self, reader: Factorization) -> None:
        self.reader, self.nodes = reader, list[Node]()
        self.operands: list[Operand] = []
        self._copies: dict[int, int] = {}
        self._inputs: dict[int, int] = {}
        self._zero: int | None = None

    def zero(self) -> int:
        """The number of a node that is zero."""
        if self._zero is None:
            self._zero = self._add(Node(Op.CONST, (), 0))
        return self._zero

    def copy_sum(self, root: int, products: set[frozenset[tuple[str, int, int]]]) -> int:
        """The number of the copy of node ``root``, a sum in which ``products`` of operands may occur."""
        reader = self.reader
        node = reader.nodes[root]
        if not reader.depends[root]:
            return self._copy_unchanged(root)
        if node.op is Op.MUL:
            plain = [reader.roles.get(reader.plain(arg)) for arg in node.args]
            if {(o.kind, o.row, o.column) for o in plain if o is not None} not in products:
                raise NoBoundError(REARRANGED)
            return self._add(Node(Op.MUL, tuple(self._operand(arg) for arg in node.args)))
        if node.op not in SUMS:
            raise NoBoundError(REARRANGED)
        return self._add(Node(node.op, tuple(self.copy_sum(arg, products) for arg in node.args)))

    def _copy_unchanged(self, root: int) -> int:
        """The number of the copy of a node without quotients."""
        for index in reachable(self.reader.nodes, [root]):
            if index not in self._copies:
                node = self.reader.nodes[index]
                self._copies[index] = self._add(node._replace(args=tuple(self._copies[arg] for arg in node.args)))
        return self._copies[root]

    def _operand(self, index: int) -> int:
        """The number of the input that stands for a computed quantity, or of its change of sign."""
        node = self.reader.nodes[index]
        if node.op is Op.NEG:
            return self._add(Node(Op.NEG, (self._operand(node.args[0]),)))
        if index not in self._inputs:
            place = len(self.reader.program.inputs), len(self.operands)
            self._inputs[index] = self._add(Node(Op.INPUT, (), place))
            self.operands.append(self.reader.roles[index])
        return self._inputs[index]

    def _add(self, node: Node) -> int:
        self.nodes.append(node)
        return len(self.nodes) - 1

    def program(self, results: Sequence[Sequence[int]]) -> Program:
        """The program of these nodes, one output for every list of results."""
        given = self.reader.program
        port = Port(OPERANDS, (len(self.operands),))
        return with_results(given.with_fields(nodes=tuple(self.nodes), inputs=(*given.inputs, port)), results)


SUMS = (Op.ADD, Op.SUB, Op.NEG)


def digits(value: Any) -> str:
    """The magnitude of a number in the digits that two values of one quantity share."""
    return str(mpmath.nstr(abs(value), SAME))
