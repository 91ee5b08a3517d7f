"""Proven bounds of the residual ``M(q) ddq - (tau - h)`` of forward dynamics, by backward analysis of its solution.

Forward dynamics solves ``M x = tau - h`` by ``M = L D L'``. How far x is from the exact accelerations depends on the
condition of M; the residual does not. It is bounded here for the emitted order of operations, where the status is ok
and every ``|x_j|`` is at most ``A_j``, the limit of the acceleration. M and h are those of exact arithmetic.

The emitted program is read as follows; computed values are meant, and u is the unit roundoff. With r_k the emitted
reciprocal of the pivot d_k,

    S_ij = M_ij - sum over k < j of S_ik L_jk  (d_j = S_jj),   L_ik = S_ik r_k,
    y_i = tau_i - h_i - sum over k < i of L_ik y_k,            x_i = y_i r_i - sum over k > i of L_ki x_k .

1. Pivots. Where the status is ok, every d_k is positive, so S_jk and L_jk = S_jk r_k have the same sign, and the terms
   ``S_jk L_jk`` that are subtracted from M_jj are not negative. Their sum T is below M_jj plus the rounding errors of
   this subtraction, which are at most ``g (W + T)`` with W the magnitudes of the summands without S and ``g = m u/(1 -
   m u)`` for m summands. Hence ``T <= W (1 + g)/(1 - g)``, a first bound of every term.
2. The rounding analysis (:mod:`rrrgen.evidence.rounding`) of S_jj with the products ``S_jk L_jk`` as inputs in that
   range gives the error E_jj, so that ``d_j + T <= M_jj + E_jj``, and with ``L_jk d_k = S_jk (1 + 3u)`` the sum of
   ``L_jk^2 d_k`` over k <= j is at most ``G_j^2 = (max M_jj + E_jj)(1 + 8u)``. By Cauchy-Schwarz

       sum over k of |L_ik| d_k |L_jk| <= G_i G_j .                                              (*)

3. Entries. The same analysis with products in ``[-G_i G_j, G_i G_j]`` gives E_ij for all i >= j. Since S_ik differs
   from ``L_ik d_k`` by two roundings, ``L D L' = M + F`` with ``|F_ij| <= E_ij + 3u G_i G_j`` by (*).
4. Solution. x_i has at most n + 1 roundings from y_i, of d_i x_i as a sum of ``y_i`` and ``d_i L_ki x_k``. With
   ``c = (n + 1) u/(1 - (n + 1) u)`` and ``|y_i| <= (1 + 3c) sum of d_i |L_ki| |x_k|`` over k >= i, the error g_i of row
   i of ``L' x = y/d`` has ``d_i |g_i| <= 3c sum of d_i |L_ki| |x_k|``, so ``|L D g|_i <= 3c G_i Z`` with
   ``Z = sum of G_k A_k`` by (*).
5. Right side. ``|L_ik y_k| <= (1 + 3c) G_i Z`` by (*), so that the torques are at most ``|h_i| + G_i Z`` but for
   roundings, and the rounding analysis of y_i gives the error B_i of ``L y = tau - h``.

Together ``M x - (tau - h) = L y - (tau - h) + L D g - F x``, hence

    |residual_i| <= B_i + 3c G_i Z + sum over j of (E_ij + 3u G_i G_j) A_j .

A product that underflows adds the smallest normal number, times at most ``G_i G_k`` where it is multiplied by d_k.
Contraction to fused operations leaves roundings out, which every step allows.

That the emitted program is of this form is not assumed: its nodes are recognised by their values at a random state in
arithmetic with 50 digits, every sum is compared with its formula at random values of all operands, and a program that
is written in another way has no bound. Another sum would agree at random numbers only with negligible probability.
"""

from __future__ import annotations

import random
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import mpmath

from rrrgen.evidence.rounding import (
    DOUBLE,
    FLOAT,
    PRECISIONS,
    Box,
    NoBoundError,
    RoundingBounds,
    enclosures,
    rounding_bounds,
)
from rrrgen.evidence.vectors import DIGITS, exact_values
from rrrgen.program import Op, Port, Program, Role
from rrrgen.program.program import Node, reachable

_SAME = 30
"""Digits in which values of the same quantity agree."""

_REARRANGED = "the factorization is not emitted in the order of operations of the analysis"
_MARGIN = 1.0 + 2.0**-40  # covers the roundings of the formulas themselves


@dataclass(frozen=True)
class ResidualBounds:
    """Bounds of the residual of every row, N m or N, in both precisions, where the status is ok and ddq is in its box.

    ``parts`` is the number of equal parts into which every angle's range was split.
    """

    double: tuple[float, ...]
    single: tuple[float, ...]
    parts: int


def solved_with(programs: Mapping[str, Program], name: str) -> tuple[Program, Program] | None:
    """The programs of M and h for the function ``name``, if that is forward dynamics; its residual is bounded here."""
    suffix = "_nominal" if name.endswith("_nominal") else ""
    if name.removesuffix(suffix) != "forward_dynamics":
        return None
    found = [programs.get(f"{each}{suffix}") for each in ("mass_matrix", "bias")]
    mass, bias = found
    return None if mass is None or bias is None else (mass, bias)


def residual_bounds(program: Program, mass: Program, bias: Program, box: Box, reach: Sequence[float]) -> ResidualBounds:
    """Bound the residual of the forward dynamics ``program`` for inputs in ``box`` and ``|ddq_j| <= reach[j]``.

    ``mass`` and ``bias`` are the programs of M and of h = c + g with the same parameters; ``box`` holds the lower and
    upper bounds of their inputs, those of torques are not read. Raises NoBoundError with the reason if there is none.
    """
    form = _read(program, mass, bias, box)
    n, order = form.n, form.order
    known = {port.name: box[port.name] for port in program.inputs if port.role is not Role.TORQUE}
    entries = enclosures(mass, {port.name: box[port.name] for port in mass.inputs})[0]
    terms = enclosures(bias, {port.name: box[port.name] for port in bias.inputs})[0]
    largest = [entries[(n + 1) * k][1] for k in order]
    torques = [max(-low, high) for low, high in (terms[k] for k in order)]
    limits = [reach[k] for k in order]
    u = FLOAT.roundoff
    c = (n + 1) * u / (1.0 - (n + 1) * u)
    # step 1: the magnitudes of the summands, and the first bound of the products
    plain = form.magnitudes(known)
    m = form.most_summands
    g = m * u / (1.0 - m * u)
    G = [(plain[j] * (1.0 + g) / (1.0 - g)) ** 0.5 * _MARGIN for j in range(n)]
    # step 2
    errors = form.bounds(known, G, 1.0, [1.0] * n).single[0]
    G = [((largest[j] + errors[_place(j, j)]) * (1.0 + 8.0 * u)) ** 0.5 * _MARGIN for j in range(n)]
    # steps 3 to 5
    Z = sum(x * a for x, a in zip(G, limits, strict=True)) * (1.0 + 3.0 * c) * _MARGIN
    sizes = [
        (torques[i] + G[i] * Z + g * (plain[n + i] + G[i] * Z)) / (1.0 - g) * (1.0 + 3.0 * c) * _MARGIN
        for i in range(n)
    ]
    final = form.bounds(known, G, Z, sizes)
    found = []
    for precision, (inside, right) in zip(PRECISIONS, (final.double, final.single), strict=True):
        u = precision.roundoff
        c = (n + 1) * u / (1.0 - (n + 1) * u)
        tiny = 4.0 * n * n * precision.smallest * max(1.0, *G) ** 2 * (1.0 + sum(limits))
        rows = [
            right[i]
            + 3.0 * c * G[i] * Z
            + sum((inside[_place(max(i, j), min(i, j))] + 3.0 * u * G[i] * G[j]) * limits[j] for j in range(n))
            + tiny
            for i in range(n)
        ]
        found.append(tuple(rows[order.index(k)] * _MARGIN for k in range(n)))
    return ResidualBounds(found[0], found[1], final.parts)


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
    state = _state(program, box)
    known = {port.name: box[port.name] for port in program.inputs if port.role is not Role.TORQUE}
    with mpmath.workdps(DIGITS):
        read = _in_either_order(
            _torque_port(program).size, lambda order: _compared(_Factorization(program, mass, state, order))
        )
    rows = enclosures(_with_results(program, [read.summands(index) for index in read.pivots]), known, budget=0.0)
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


def _compared(read: _Factorization) -> _Factorization:
    """The factorization, if its sums are those of the analysis. Raises NoBoundError if not."""
    cut = _Cut(read)
    (triangle,), value = read.evaluated(cut, [read.triangle(cut)])
    read.compare(triangle, value)
    return read


_Read = TypeVar("_Read")


def _in_either_order(n: int, read: Callable[[tuple[int, ...]], _Read]) -> _Read:
    """What ``read`` finds with the base or with the tip eliminated first. Raises NoBoundError if neither is found."""
    reason = NoBoundError(_REARRANGED)
    for order in dict.fromkeys((tuple(range(n)), tuple(reversed(range(n))))):
        try:
            return read(order)
        except NoBoundError as found:
            reason = found
    raise reason


def _place(i: int, j: int) -> int:
    """The number of the entry (i, j), i >= j, of a lower triangle, row by row."""
    return i * (i + 1) // 2 + j


# ------------------------------------------------------------------------------------------------------------------
# The form of the emitted program
# ------------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Operand:
    """A computed quantity that stands in products: "S", "L", "y", "x" or "r" with its row and its column.

    y, x and r are vectors; their row is their column. ``sign`` is 1 or -1: the node holds this multiple of it.
    """

    kind: str
    row: int
    column: int
    sign: int


@dataclass(frozen=True)
class _Form:
    """Forward dynamics of n joints as sums whose products of computed quantities have inputs as operands.

    ``order`` are the joints in the order of elimination. Outputs of ``sums`` are the lower triangle of S, row by row,
    and y; its inputs are those of forward dynamics and the port "operands", described by ``operands``. Every output of
    ``summands`` holds the summands of a pivot, or then of an element of y, without products and torques.
    """

    n: int
    order: tuple[int, ...]
    sums: Program
    operands: tuple[_Operand, ...]
    summands: Program
    most_summands: int

    def magnitudes(self, known: Box) -> list[float]:
        """The sums of the magnitudes of the summands without products and torques: of the pivots, then of y."""
        rows = enclosures(self.summands, known, budget=0.0)
        return [sum(max(-low, high) for low, high in row) * _MARGIN for row in rows]

    def bounds(self, known: Box, G: Sequence[float], Z: float, torques: Sequence[float]) -> RoundingBounds:
        """Rounding bounds of the sums, with ``|S_ik L_jk| <= G_i G_j``, ``|L_ik y_k| <= G_i Z`` and these torques."""
        more = 1.0 + 8.0 * FLOAT.roundoff  # S differs by two roundings from L times the pivot
        sizes = [(Z if operand.kind == "y" else G[operand.row]) * more for operand in self.operands]
        symmetric = {
            _OPERANDS: ([-size for size in sizes], sizes),
            _torque_port(self.sums).name: self._in_order(torques),
        }
        return rounding_bounds(self.sums, {**known, **symmetric})

    def _in_order(self, torques: Sequence[float]) -> tuple[list[float], list[float]]:
        sizes = [torques[self.order.index(k)] for k in range(self.n)]
        return [-size for size in sizes], sizes


_OPERANDS = "operands"


def _torque_port(program: Program) -> Port:
    return next(port for port in program.inputs if port.role is Role.TORQUE)


def _read(program: Program, mass: Program, bias: Program, box: Box) -> _Form:
    """The form of forward dynamics, with the base or the tip eliminated first. Raises NoBoundError if there is none."""
    state = _state(program, box)
    with mpmath.workdps(DIGITS):
        return _in_either_order(
            _torque_port(program).size, lambda order: _Reader(program, mass, bias, state, order).form()
        )


def _state(program: Program, box: Box) -> dict[str, list[float]]:
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


class _Factorization:
    """Recognises the factors of M among the nodes of a program, by their values at one state."""

    def __init__(
        self, program: Program, mass: Program, state: Mapping[str, list[float]], order: tuple[int, ...]
    ) -> None:
        self.program, self.nodes, self.order, self.n = program, program.nodes, order, len(order)
        self.state = state
        self.values = exact_values(program, [state[port.name] for port in program.inputs])
        self._by_value: dict[str, list[int]] = {}
        for index, value in enumerate(self.values):
            self._by_value.setdefault(_digits(value), []).append(index)
        M = exact_values(mass, [state[port.name] for port in mass.inputs])
        self.M = [[M[mass.results[0][self.n * i + j]] for j in order] for i in order]
        self.S, self.L = self._factors()
        self.roles: dict[int, _Operand] = {}
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
                if abs(S[i][j]) < abs(self.M[i][i] * self.M[j][j]) ** 0.5 * mpmath.mpf(10) ** -_SAME:
                    S[i][j] = mpmath.mpf(0)
            for i in range(j + 1, n):
                L[i][j] = S[i][j] / S[j][j]
        return S, L

    # -- nodes -------------------------------------------------------------------------------------------------

    def _nodes_of(self, value: Any) -> list[int]:
        """The nodes that hold ``value`` or its negative."""
        return self._by_value.get(_digits(value), [])

    def _plain(self, index: int) -> int:
        """The node behind changes of sign."""
        while self.nodes[index].op is Op.NEG:
            index = self.nodes[index].args[0]
        return index

    def _take(self, index: int, kind: str, row: int, column: int, value: Any) -> None:
        sign = 1 if (self.values[index] > 0) == (value > 0) else -1
        known = self.roles.setdefault(index, _Operand(kind, row, column, sign))
        if (known.kind, known.row, known.column) != (kind, row, column):
            raise NoBoundError(_REARRANGED)

    def _pivot(self, k: int) -> int | None:
        """Take the reciprocal of pivot k; returns the node of the pivot.

        None where it is a number, whose reciprocal is one too.
        """
        reciprocal = 1 / self.S[k][k]
        for index in self._nodes_of(reciprocal):
            node = self.nodes[index]
            if node.op is Op.DIV and self.nodes[node.args[0]].op is Op.CONST and self.nodes[node.args[0]].number == 1:
                choice = self.nodes[node.args[1]]
                if choice.op is Op.SELECT and _digits(self.values[choice.args[1]]) == _digits(self.S[k][k]):
                    self._take(index, "r", k, k, reciprocal)
                    self.margins[choice.args[1]] = choice.args[0]
                    return choice.args[1]
            if node.op is Op.CONST and node.number > 0 and not any(self.S[k][:k]):
                self._take(index, "r", k, k, reciprocal)
                return None
        raise NoBoundError(_REARRANGED)

    def _positive(self, k: int, margin: int, pivot: int) -> bool:
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
        leaves = self._leaves(pivot, entry)
        whole = _digits(self.values[entry]) == _digits(self.M[k][k]) and leaves.count(entry) == 1
        return whole and all(leaf == entry or self.nodes[leaf].op is Op.MUL for leaf in leaves)

    def _leaves(self, index: int, last: int | None = None) -> list[int]:
        """The summands of a node: of sums, differences and changes of sign, down to other operations or to ``last``."""
        node = self.nodes[index]
        if node.op in _SUMS and index != last:
            return [leaf for arg in node.args for leaf in self._leaves(arg, last)]
        return [index]

    def _multiplier(self, i: int, k: int) -> None:
        """Take L_ik and the entry S_ik that it is made of; nothing if both are zero."""
        if self.S[i][k] == 0:
            return
        for index in self._nodes_of(self.L[i][k]):
            node = self.nodes[index]
            if node.op is not Op.MUL:
                continue
            for a, b in (node.args, node.args[::-1]):
                role = self.roles.get(a)
                if role is not None and (role.kind, role.row) == ("r", k):
                    self._take(index, "L", i, k, self.L[i][k])
                    entry = self._plain(b)
                    self._take(entry, "S", i, k, self.S[i][k])
                    if self.entries.setdefault((i, k), entry) != entry:
                        raise NoBoundError(_REARRANGED)
                    break
        if (i, k) not in self.entries:
            raise NoBoundError(_REARRANGED)

    def _dependent(self) -> list[bool]:
        """For every node, whether it depends on the reciprocal of a pivot."""
        depends: list[bool] = []
        for node in self.nodes:
            kinds = [self.roles[arg].kind for arg in node.args if arg in self.roles]
            own = node.op is Op.DIV or (node.op is Op.MUL and "r" in kinds)
            depends.append(own or any(depends[arg] for arg in node.args))
        return depends

    # -- sums --------------------------------------------------------------------------------------------------

    def triangle(self, cut: _Cut) -> list[int]:
        """The copies of the pivots and of the entries below them, row by row, that ``cut`` makes."""
        found = []
        for i in range(self.n):
            for j in range(i + 1):
                index = self.pivots[i] if i == j else self.entries.get((i, j))
                products = {
                    frozenset({("S", a, k), ("L", b, k)})
                    for k in range(j)
                    if self.S[i][k] != 0 and self.S[j][k] != 0
                    for a, b in ((i, j), (j, i))
                }
                found.append(cut.zero() if index is None else cut.copied(index, products))
        return found

    def summands(self, index: int | None) -> list[int]:
        """The summands of a sum that are no products of operands."""
        return [leaf for leaf in ([] if index is None else self._leaves(index)) if not self.depends[leaf]]

    def evaluated(
        self, cut: _Cut, results: Sequence[Sequence[int]]
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
                    self.agree(triangle[_place(i, j)], self.M[i][j], products)

    def agree(self, found: Any, first: Any, subtracted: Sequence[Any]) -> None:
        """Raise NoBoundError unless ``found`` is ``first`` minus what is ``subtracted``, or its negative."""
        expected = first - sum(subtracted)
        size = abs(first) + sum(abs(each) for each in subtracted)
        if abs(abs(found) - abs(expected)) > size * mpmath.mpf(10) ** -_SAME:
            raise NoBoundError(_REARRANGED)


class _Reader(_Factorization):
    """Recognises the whole solution of forward dynamics."""

    def __init__(
        self, program: Program, mass: Program, bias: Program, state: Mapping[str, list[float]], order: tuple[int, ...]
    ) -> None:
        super().__init__(program, mass, state, order)
        if not all(
            pivot is None or self._positive(k, self.margins[pivot], pivot) for k, pivot in enumerate(self.pivots)
        ):
            raise NoBoundError(_REARRANGED)
        h = exact_values(bias, [state[port.name] for port in bias.inputs])
        tau = state[_torque_port(program).name]
        self.rhs = [tau[i] - h[bias.results[0][i]] for i in order]
        self.y, self.x = self._solved()
        self.solution = [self._chosen(program.results[0][i]) for i in order]
        for k, index in enumerate(self.solution):
            self._take(index, "x", k, k, self.x[k])
        self.right = [self._right_side(k) for k in range(self.n)]

    def _solved(self) -> tuple[list[Any], list[Any]]:
        """y and x at the state."""
        n, L, y = self.n, self.L, list(self.rhs)
        for i in range(n):
            for k in range(i):
                y[i] -= L[i][k] * y[k]
        x = [y[i] / self.S[i][i] for i in range(n)]
        for i in reversed(range(n)):
            for k in range(i + 1, n):
                x[i] -= L[k][i] * x[k]
        return y, x

    def _chosen(self, index: int) -> int:
        """The node that a result holds where the status is ok."""
        node = self.nodes[index]
        return node.args[2] if node.op is Op.SELECT else index

    def _right_side(self, k: int) -> int:
        """Take y_k: the node that is multiplied by the reciprocal of the pivot."""
        for index in self._nodes_of(self.y[k]):
            for node in self.nodes:
                if node.op is Op.MUL and index in map(self._plain, node.args):
                    kinds = [self.roles[arg] for arg in map(self._plain, node.args) if arg in self.roles]
                    if any((role.kind, role.row) == ("r", k) for role in kinds):
                        self._take(self._plain(index), "y", k, k, self.y[k])
                        return self._plain(index)
        raise NoBoundError(_REARRANGED)

    def _is_torque(self, index: int) -> bool:
        node = self.nodes[index]
        return node.op is Op.INPUT and self.program.inputs[node.place[0]].role is Role.TORQUE

    def form(self) -> _Form:
        """The form of the program. Raises NoBoundError if a sum is not the one of the factorization."""
        n, cut = self.n, _Cut(self)
        triangle = self.triangle(cut)
        right = [cut.copied(self.right[i], {frozenset({("L", i, k), ("y", k, k)}) for k in range(i)}) for i in range(n)]
        solution = [
            cut.copied(
                self.solution[i],
                {frozenset({("r", i, i), ("y", i, i)})}
                | {frozenset({("L", k, i), ("x", k, k)}) for k in range(i + 1, n)},
            )
            for i in range(n)
        ]
        (entries, sides, results), value = self.evaluated(cut, [triangle, right, solution])
        self.compare(entries, value)
        for i in range(n):
            self.agree(sides[i], self.rhs[i], [value("L", i, k) * value("y", k, k) for k in range(i)])
            below = [value("L", k, i) * value("x", k, k) for k in range(i + 1, n)]
            self.agree(results[i], value("r", i, i) * value("y", i, i), below)
        roots = [*self.pivots, *self.right]
        own = [[leaf for leaf in self.summands(index) if not self._is_torque(leaf)] for index in roots]
        return _Form(
            n,
            self.order,
            cut.program([triangle, right]),
            tuple(cut.operands),
            _with_results(self.program, own),
            max(len(self._leaves(index)) for index in roots if index is not None),
        )


class _Cut:
    """Copies nodes of a program, with an input in place of every computed quantity that is an operand of a product."""

    def __init__(self, reader: _Factorization) -> None:
        self.reader, self.nodes = reader, list[Node]()
        self.operands: list[_Operand] = []
        self._copies: dict[int, int] = {}
        self._inputs: dict[int, int] = {}
        self._zero: int | None = None

    def zero(self) -> int:
        """The number of a node that is zero."""
        if self._zero is None:
            self._zero = self._added(Node(Op.CONST, (), 0))
        return self._zero

    def copied(self, root: int, products: set[frozenset[tuple[str, int, int]]]) -> int:
        """The number of the copy of node ``root``, a sum in which ``products`` of operands may occur."""
        reader = self.reader
        node = reader.nodes[root]
        if not reader.depends[root]:
            return self._kept(root)
        if node.op is Op.MUL:
            plain = [reader.roles.get(reader._plain(arg)) for arg in node.args]
            if {(o.kind, o.row, o.column) for o in plain if o is not None} not in products:
                raise NoBoundError(_REARRANGED)
            return self._added(Node(Op.MUL, tuple(self._operand(arg) for arg in node.args)))
        if node.op not in _SUMS:
            raise NoBoundError(_REARRANGED)
        return self._added(Node(node.op, tuple(self.copied(arg, products) for arg in node.args)))

    def _kept(self, root: int) -> int:
        """The number of the copy of a node without quotients."""
        for index in reachable(self.reader.nodes, [root]):
            if index not in self._copies:
                node = self.reader.nodes[index]
                self._copies[index] = self._added(node._replace(args=tuple(self._copies[arg] for arg in node.args)))
        return self._copies[root]

    def _operand(self, index: int) -> int:
        """The number of the input that stands for a computed quantity, or of its change of sign."""
        node = self.reader.nodes[index]
        if node.op is Op.NEG:
            return self._added(Node(Op.NEG, (self._operand(node.args[0]),)))
        if index not in self._inputs:
            place = len(self.reader.program.inputs), len(self.operands)
            self._inputs[index] = self._added(Node(Op.INPUT, (), place))
            self.operands.append(self.reader.roles[index])
        return self._inputs[index]

    def _added(self, node: Node) -> int:
        self.nodes.append(node)
        return len(self.nodes) - 1

    def program(self, results: Sequence[Sequence[int]]) -> Program:
        """The program of these nodes, one output for every list of results."""
        given = self.reader.program
        port = Port(_OPERANDS, (len(self.operands),))
        return _with_results(given.described(nodes=tuple(self.nodes), inputs=(*given.inputs, port)), results)


_SUMS = (Op.ADD, Op.SUB, Op.NEG)


def _digits(value: Any) -> str:
    """The magnitude of a number in the digits that two values of one quantity share."""
    return str(mpmath.nstr(abs(value), _SAME))


def _with_results(program: Program, results: Sequence[Sequence[int]]) -> Program:
    """The nodes of a program with other results, one output for each list, without status; other nodes are dropped."""
    kept = reachable(program.nodes, (index for row in results for index in row))
    place = {old: new for new, old in enumerate(kept)}
    nodes = tuple(
        program.nodes[old]._replace(args=tuple(place[arg] for arg in program.nodes[old].args)) for old in kept
    )
    return program.described(
        nodes=nodes,
        outputs=tuple(Port(f"sums{k}", (len(row),)) for k, row in enumerate(results)),
        results=tuple(tuple(place[index] for index in row) for row in results),
        labels={},
        status=None,
    )
