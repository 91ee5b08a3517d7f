"""Proven bounds of the residuals of the derivatives of forward dynamics, by backward analysis of the inverse of M.

``forward_dynamics_derivatives`` returns x = ddq and three matrices. How far they are from exact ones depends on the
condition of M; their residuals do not. With D_q(x) and D_v the exact derivatives of inverse dynamics by q and by dq,
at the returned x, and M and h those of exact arithmetic, bounded are the elements of

    M x - (tau - h),     M dddq_dq + D_q(x),     M dddq_dv + D_v,     M dddq_dtau - 1 ,

where the status is ok, ``|x_j|`` is at most the limit of the acceleration, and the diagonal entries of dddq_dtau, the
inverse of M, are at most B_j. The limits B_j belong to the result: whoever calls the function sees whether they hold.

The emitted program is read as follows, with S, L, d and r as in :mod:`rrrgen.evidence.residual` and 1 = X_jj:

    X_ij = -L_ij - sum over j < k < i of L_ik X_kj,        P_ij = sum over k >= i, j of X_ki r_k X_kj,
    x = -P w,   dddq_dq = -P Q,   dddq_dv = -P V,   dddq_dtau = P,

w is h - tau as it is computed, Q and V are the computed D_q and D_v. X is the inverse of L, P that of M. With
``g_m = m u/(1 - m u)``, a sum of products in which no path from an operand to the result has more than m roundings is
within g_m times the sum of the magnitudes of the products. p, q and s are the numbers of X, of P, and of the products
with P; they are counted in the emitted program, with every sum and product as one.

1. Weights. G is that of the other module: the sum of ``|L_ik| d_k |L_jk|`` over k is at most ``G_i G_j``, and ``L D L'
   = M + F`` with ``|F_ij| <= f_ij = E_ij + 3u G_i G_j``. All ``r_k`` are positive, so that P_jj is a sum of terms that
   are not negative, and ``sum over k of r_k X_kj^2 <= P_jj/(1 - g_q) <= B_j/(1 - g_q) = H_j^2``. By Cauchy-Schwarz

       sum over k of |X_ki| r_k |X_kj| <= H_i H_j,     sum over k of |L_ik| |X_kj| <= (1 + 4u) G_i H_j,          (*)

   the second since ``d_k r_k`` is within u of 1. Let K be the sum of ``G_k H_k`` over k.
2. ``L X = 1 + R`` with ``|R_ij| <= a G_i H_j``, ``a = (1 + 4u) g_p``, by (*). R is strictly lower triangular.
3. ``P = X' r X + e`` with ``|e_ij| <= g_q H_i H_j`` by (*), so that ``|P_ij| <= (1 + g_q) H_i H_j``.
4. From 2, ``X L = 1 + inv(L) R L`` and ``inv(L') = inv(1 + R') X'``. Hence

       L D L' X' r X = L D (1 + L' R' inv(L')) r X = L D r X + (L D L') R' inv(1 + R') X' r X .

   L D r X is ``1 + R`` but for u times (*). By ``|R'| <= a H G'`` (H and G as columns) and ``G' H = K``, the elements
   of ``R' inv(1 + R')`` are at most ``a/(1 - a K) H G'``, those of its product with X' r X at most ``a K/(1 - a K) H
   H'``, and those of the product of that with L D L' at most ``a K^2/(1 - a K) G H'``. It is required that a K is at
   most 1/2.
5. ``M P - 1 = L D L' X' r X - 1 + L D L' e - F P``, hence

       |M P - 1|_ij <= c_ij = H_j (G_i (a + 2u + a K^2/(1 - a K) + g_q K) + (1 + g_q) sum over k of f_ik H_k) .

6. Products with P. With ``dddq_dq = -P Q + e`` and ``|e_kj| <= g_s sum over l of |P_kl| |Q_lj|``,

       M dddq_dq + D_q = (D_q - Q) - (M P - 1) Q + M e ,

   and ``|M_ik| <= G_i G_k + f_ik``. The error of Q, as of w and V, comes from the rounding analysis of the emitted
   sums with x as an input in its range, their magnitudes from its enclosures. x and dddq_dv likewise. As ``w = -M x -
   (M P - 1) w + M e``, the limits of x bound w too, often more tightly than those of the torques.

A product that underflows adds the smallest normal number; in X it is multiplied by at most ``K^2`` times weights.
Contraction to fused operations leaves roundings out, which every step allows.

The program is read as in the other module. X, P and the products with P are recognised by expanding them into products
of their operands: which products these are and their signs is exact, whatever the order of summation. Q, V and w are
compared with inverse dynamics and its derivatives at another random x.
"""

from __future__ import annotations

import random
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import mpmath

from rrrgen.derive.recursions.linear_algebra import PIVOT_TOLERANCE
from rrrgen.evidence.factorization import (
    MARGIN,
    REARRANGED,
    SUMS,
    Cut,
    Factorization,
    Form,
    in_either_order,
    in_triangle,
    state_in,
    torque_port,
)
from rrrgen.evidence.rounding import FLOAT, PRECISIONS, Box, NoBoundError, enclosures, rounding_bounds
from rrrgen.evidence.vectors import DIGITS, exact_values
from rrrgen.program import Op, Port, Program, Role
from rrrgen.program.program import Node, reachable, with_results

OUTPUTS = ("ddq", "dddq_dq", "dddq_dv", "dddq_dtau")
"""The outputs whose residuals are bounded."""


@dataclass(frozen=True)
class DerivativeResiduals:
    """Bounds of the residuals, for every output in the order of its elements, in both precisions.

    They hold where no diagonal entry of M is below ``least_double`` or ``least_single``, kg m^2 or kg: rounding errors
    of the entries. ``parts`` is the number of equal parts into which every angle's range was split.
    """

    double: dict[str, tuple[float, ...]]
    single: dict[str, tuple[float, ...]]
    least_double: float
    least_single: float
    parts: int


def derivative_residuals(
    program: Program, mass: Program, derivatives: Program, box: Box, reach: Sequence[float], inverse: Sequence[float]
) -> DerivativeResiduals:
    """Bound the residuals of ``program``, the derivatives of forward dynamics, for inputs in ``box``.

    ``mass`` and ``derivatives`` are the programs of M and of the derivatives of inverse dynamics with the same
    parameters. ``reach`` are the limits of the magnitudes of ddq, ``inverse`` those of the diagonal entries of
    dddq_dtau. Raises NoBoundError with the reason if there is no bound.
    """
    state = state_in(program, box)
    with mpmath.workdps(DIGITS):
        read = in_either_order(
            torque_port(program).size, lambda order: _DerivativeReader(program, mass, derivatives, state, order)
        )
        form, right = read.form(), read.right_sides()
        margins = read.margins_at_zero()
    n, order = read.n, read.order
    known = {port.name: box[port.name] for port in program.inputs if port.role is not Role.TORQUE}
    entries = enclosures(mass, {port.name: box[port.name] for port in mass.inputs})[0]
    G = form.weights(known, form.magnitudes(known), [entries[(n + 1) * k][1] for k in order])
    of_margins = rounding_bounds(margins, known) if margins.results[0] else None
    q = read.roundings_of_P
    H = [(inverse[k] / (1.0 - _growth(q, FLOAT.roundoff))) ** 0.5 * MARGIN for k in order]
    factors = form.bounds(known, G, 1.0, [1.0] * n)
    around = {**{port.name: box[port.name] for port in program.inputs}, _GIVEN: ([-x for x in reach], list(reach))}
    sizes = [[max(-low, high) for low, high in row] for row in enclosures(right, around)]
    wide = sizes[0]
    errors = rounding_bounds(right, around)
    residuals = []
    for precision, inside, of_right in zip(
        PRECISIONS, (factors.double[0], factors.single[0]), (errors.double, errors.single), strict=True
    ):
        u = precision.roundoff
        f = [[inside[in_triangle(max(i, j), min(i, j))] + 3.0 * u * G[i] * G[j] for j in range(n)] for i in range(n)]
        bounds = _Weighted(n, G, H, f, u, precision.smallest, read)
        sizes[0] = bounds.right_side(wide, [reach[k] for k in order])
        rows = {
            name: [bounds.of_product(sizes[k], of_right[k], i, j, width) for i in range(n) for j in range(width)]
            for k, (name, width) in enumerate(zip(OUTPUTS, (1, n, n), strict=False))
        }
        rows["dddq_dtau"] = [bounds.inverse[i][j] for i in range(n) for j in range(n)]
        residuals.append({name: read.in_joints(name, row) for name, row in rows.items()})
    least = [0.0, 0.0]
    if of_margins is not None:
        least = [max(row[0]) / float(PIVOT_TOLERANCE) for row in (of_margins.double, of_margins.single)]
    return DerivativeResiduals(residuals[0], residuals[1], least[0], least[1], errors.parts)


_GIVEN = "given_ddq"


def _growth(count: int, roundoff: float) -> float:
    """The factor ``g_m`` of the module."""
    return count * roundoff / (1.0 - count * roundoff)


class _Weighted:
    """Steps 2 to 6 of the module in one precision; rows and columns in the order of elimination."""

    def __init__(
        self,
        n: int,
        G: list[float],
        H: list[float],
        f: list[list[float]],
        u: float,
        smallest: float,
        read: _DerivativeReader,
    ) -> None:
        counts = read.roundings_of_X, read.roundings_of_P, read.roundings_of_products
        p, q, s = (_growth(count, u) for count in counts)
        K = sum(x * y for x, y in zip(G, H, strict=True)) * MARGIN
        a = (1.0 + 4.0 * u) * p
        if a * K > 0.5:
            raise NoBoundError("the scaled condition of M is too large for the analysis of its inverse")
        tiny = 8.0 * n**3 * smallest * (1.0 + sum(G)) ** 3 * (1.0 + sum(H)) ** 2
        common = a + 2.0 * u + a * K * K / (1.0 - a * K) + q * K
        self.inverse = [
            [
                (H[j] * (G[i] * common + (1.0 + q) * sum(f[i][k] * H[k] for k in range(n))) + tiny) * MARGIN
                for j in range(n)
            ]
            for i in range(n)
        ]
        self._mass = [[G[i] * G[k] + f[i][k] for k in range(n)] for i in range(n)]
        self._through = [s * (1.0 + q) * sum(row[k] * H[k] for k in range(n)) for row in self._mass]
        self._n, self._H, self._smallest = n, H, smallest

    def right_side(self, sizes: Sequence[float], limits: Sequence[float]) -> list[float]:
        """Bounds of the magnitudes of w, which are at most ``sizes``, from the ``limits`` of those of x."""
        bounds = list(sizes)
        for _ in range(2):
            through = sum(x * size for x, size in zip(self._H, bounds, strict=True))
            bounds = [
                min(
                    bounds[k],
                    MARGIN
                    * (
                        sum(x * limit for x, limit in zip(self._mass[k], limits, strict=True))
                        + sum(x * size for x, size in zip(self.inverse[k], bounds, strict=True))
                        + self._through[k] * through
                        + 2.0 * self._n * self._smallest * sum(self._mass[k])
                    ),
                )
                for k in range(self._n)
            ]
        return bounds

    def of_product(self, sizes: Sequence[float], errors: Sequence[float], i: int, j: int, width: int) -> float:
        """The bound of element (i, j) of ``M P Q - Q``, for Q of this width with magnitudes and errors row by row."""
        n, column = self._n, sizes[j::width]
        total = errors[width * i + j]
        total += sum(x * size for x, size in zip(self.inverse[i], column, strict=True))
        total += self._through[i] * sum(x * size for x, size in zip(self._H, column, strict=True))
        total += 2.0 * n * self._smallest * sum(self._mass[i])
        return total * MARGIN


# ------------------------------------------------------------------------------------------------------------------
# The form of the emitted program
# ------------------------------------------------------------------------------------------------------------------

_Key = tuple[str, int, int]
"""A quantity "L", "X", "P" or "r" with its row and its column; those of r are the same."""

_Leaf = Callable[[int], "tuple[_Key, int] | None"]


class _Product(NamedTuple):
    """A product of operands in an expanded sum: its sign, the operands, and its roundings in the emitted order."""

    sign: int
    operands: tuple[_Key, ...]
    roundings: int


class _DerivativeReader(Factorization):
    """Recognises the inverse of M and what is multiplied with it."""

    def __init__(
        self,
        program: Program,
        mass: Program,
        derivatives: Program,
        state: Mapping[str, list[float]],
        order: tuple[int, ...],
    ) -> None:
        super().__init__(program, mass, state, order)
        assert program.status is not None
        self._status = program.results[program.status.output][0]
        self._derivatives = derivatives
        self.roundings_of_X = self.roundings_of_P = self.roundings_of_products = 1
        self._keys: dict[int, tuple[_Key, int]] = {
            index: ((role.kind, role.row, role.column), role.sign)
            for index, role in self.roles.items()
            if role.kind in ("L", "r")
        }
        self._X = self._inverse_of_L()
        self._negative: dict[tuple[int, int], bool] = {}  # whether X_ij is -L_ij
        for distance in range(1, self.n):
            for j in range(self.n - distance):
                self._take_X(j + distance, j)
        self._P: dict[int, tuple[int, int, int]] = {}
        self._entries_of_P: set[tuple[int, int]] = set()  # those that are not zero at all states
        for i in range(self.n):
            for j in range(self.n):
                self._take_P(i, j)
        self._x = {self.plain(index): k for k, index in enumerate(program.results[0])}
        if len(self._x) != self.n or any(self.nodes[index].op is Op.CONST for index in self._x):
            raise NoBoundError(REARRANGED)
        self._right = self._right_sides()

    def in_joints(self, name: str, rows: Sequence[float]) -> tuple[float, ...]:
        """Elements of an output in the order of the joints; ``rows`` has them row by row in that of elimination."""
        n = self.n
        at = [self.order.index(k) for k in range(n)]
        if name == "ddq":
            return tuple(rows[i] for i in at)
        columns = at if name == "dddq_dtau" else range(n)
        return tuple(rows[n * i + j] for i in at for j in columns)

    def form(self) -> Form:
        """The sums of the factorization. Raises NoBoundError if a sum is not the one of the factorization."""
        cut = Cut(self)
        triangle = self.triangle(cut)
        (entries,), value = self.evaluate_at_random(cut, [triangle])
        self.compare(entries, value)
        summands = [self.summands(index) for index in self.pivots]
        most = max((len(self.leaves(index)) for index in self.pivots if index is not None), default=1)
        return Form(
            self.n, self.order, cut.program([triangle]), tuple(cut.operands), with_results(self.program, summands), most
        )

    def margins_at_zero(self) -> Program:
        """The margins, by which the status is decided, of those pivots that it may not show to be positive, at zero.

        The emitted margin is a sum that grows with the pivot. If the pivot is not positive, the margin is at most what
        it is for a pivot of zero: -PIVOT_TOLERANCE times the entry of M, but for rounding errors.
        """
        nodes, results = list(self.nodes), list[int]()
        for k, pivot in enumerate(self.pivots):
            if pivot is None or self.is_positive(k, self.margins[pivot], pivot):
                continue
            base = self.plain(pivot)
            grows = 1 if self.values[base] == self.values[pivot] else -1
            results.append(self._without(self.margins[pivot], base, grows, nodes))
        program = with_results(self.program.with_fields(nodes=tuple(nodes)), [results])
        values = exact_values(program, [self.state[port.name] for port in program.inputs])
        wanted = [
            -self.M[k][k] * mpmath.mpf(PIVOT_TOLERANCE.numerator) / PIVOT_TOLERANCE.denominator
            for k, pivot in enumerate(self.pivots)
            if pivot is not None and not self.is_positive(k, self.margins[pivot], pivot)
        ]
        for index, value in zip(program.results[0], wanted, strict=True):
            if abs(values[index] - value) > abs(value) * mpmath.mpf(10) ** -SAME_AT_X:
                raise NoBoundError(REARRANGED)
        return program

    def _without(self, index: int, base: int, grows: int, nodes: list[Node]) -> int:
        """The number of a copy of a sum in which the node ``base`` is zero; appended to ``nodes``.

        Raises NoBoundError unless it is a sum that grows with ``grows`` times the node, which is 1 or -1.
        """
        if index == base and grows == 1:
            nodes.append(Node(Op.CONST, (), 0))
            return len(nodes) - 1
        node = self.nodes[index]
        inside = [place for place, arg in enumerate(node.args) if base in reachable(self.nodes, [arg])]
        if node.op not in SUMS or len(inside) != 1:
            raise NoBoundError(REARRANGED)
        (place,) = inside
        turned = -grows if node.op is Op.NEG or (node.op is Op.SUB and place == 1) else grows
        args = list(node.args)
        args[place] = self._without(args[place], base, turned, nodes)
        nodes.append(Node(node.op, tuple(args)))
        return len(nodes) - 1

    # -- the inverse -------------------------------------------------------------------------------------------

    def _inverse_of_L(self) -> list[list[Any]]:
        """X at the state."""
        n = self.n
        X = [[mpmath.mpf(int(i == j)) for j in range(n)] for i in range(n)]
        for j in range(n):
            for i in range(j + 1, n):
                X[i][j] = -sum((self.L[i][k] * X[k][j] for k in range(j, i)), mpmath.mpf(0))
                if abs(X[i][j]) < mpmath.mpf(10) ** -(DIGITS // 2):
                    X[i][j] = mpmath.mpf(0)
        return X

    def _take_X(self, i: int, j: int) -> None:
        """Take the node of X_ij; that of L_ij where X_ij is its negative."""
        if self._X[i][j] == 0:
            return
        expected: dict[tuple[_Key, ...], int] = {(("L", i, j),): -1} if self.L[i][j] != 0 else {}
        for k in range(j + 1, i):
            if self.L[i][k] != 0 and self._X[k][j] != 0:
                expected[tuple(sorted([("L", i, k), ("X", k, j)]))] = -1
        self._negative[i, j] = list(expected) == [(("L", i, j),)]
        if self._negative[i, j]:
            return
        for index in self.nodes_of(self._X[i][j]):
            if index in self._keys:
                continue
            sign = 1 if (self.values[index] > 0) == (self._X[i][j] > 0) else -1
            try:
                products = self._expand(index, partial(self._operand, row=i))
            except NoBoundError:
                continue
            if self._agree(products, expected, sign):
                self._keys[index] = (("X", i, j), sign)
                self.roundings_of_X = max(self.roundings_of_X, *(product.roundings for product in products))
                return
        raise NoBoundError(REARRANGED)

    def _operand(self, index: int, row: int | None = None) -> tuple[_Key, int] | None:
        """The operand that a node is in the sum of X_ij, i = ``row``, or of an entry of P; None if it is none.

        L_kj stands for X_kj where that is its negative, except for the row of L in the sum of X_ij.
        """
        operand = self._keys.get(index)
        if operand is None or operand[0][0] != "L" or operand[0][1] == row:
            return operand
        (_, i, j), sign = operand
        return (("X", i, j), -sign) if self._negative[i, j] else None

    def _take_P(self, i: int, j: int) -> None:
        """Take the node of P_ij, which the output dddq_dtau holds."""
        n, X = self.n, self._X
        index = self.plain(self.program.results[3][n * self.order[i] + self.order[j]])
        value = sum((X[k][i] * X[k][j] / self.S[k][k] for k in range(max(i, j), n)), mpmath.mpf(0))
        expected = {
            tuple(sorted([("r", k, k), *(("X", k, m) for m in (i, j) if m != k)])): 1
            for k in range(max(i, j), n)
            if X[k][i] != 0 and X[k][j] != 0
        }
        if not expected:
            if self.nodes[index].op is not Op.CONST or self.nodes[index].number != 0:
                raise NoBoundError(REARRANGED)
            return
        self._entries_of_P.add((i, j))
        sign = 1 if (self.values[index] > 0) == (value > 0) else -1
        products = self._expand(index, self._operand, root=True)
        if not self._agree(products, expected, sign):
            raise NoBoundError(REARRANGED)
        self.roundings_of_P = max(self.roundings_of_P, *(product.roundings for product in products))
        # a number or the reciprocal itself may stand for entries of several places
        known = self._P.setdefault(index, (min(i, j), max(i, j), sign))
        if known != (min(i, j), max(i, j), sign):
            raise NoBoundError(REARRANGED)

    def _agree(self, products: Sequence[_Product], expected: Mapping[tuple[_Key, ...], int], sign: int) -> bool:
        """Whether the expanded sum has the ``expected`` products, each once and with its sign times ``sign``."""
        occurrences = Counter((product.operands, product.sign * sign) for product in products)
        return occurrences == Counter(expected.items())

    def _expand(self, index: int, leaf: _Leaf, root: bool = False) -> list[_Product]:
        """The sum of products of operands that a node is; ``root``: the node itself counts as no operand.

        Raises NoBoundError if it is none.
        """
        operand = None if root and self.nodes[index].op is Op.SELECT else leaf(index)
        if operand is not None:
            return [_Product(operand[1], (operand[0],), 0)]
        node = self.nodes[index]
        if node.op is Op.CONST and node.number in (-1, 0, 1):
            return [_Product(int(node.number), (), 0)] if node.number else []
        if node.op is Op.NEG:
            return [product._replace(sign=-product.sign) for product in self._expand(node.args[0], leaf)]
        if node.op is Op.SELECT and node.args[0] == self._status:
            return self._expand(node.args[2], leaf)
        if node.op is Op.ADD or node.op is Op.SUB:
            first, second = (self._expand(arg, leaf) for arg in node.args)
            turned = -1 if node.op is Op.SUB else 1
            return [
                *(product._replace(roundings=product.roundings + 1) for product in first),
                *(_Product(turned * product.sign, product.operands, product.roundings + 1) for product in second),
            ]
        if node.op is Op.MUL:
            first, second = (self._expand(arg, leaf) for arg in node.args)
            return [
                _Product(a.sign * b.sign, tuple(sorted(a.operands + b.operands)), a.roundings + b.roundings + 1)
                for a in first
                for b in second
            ]
        raise NoBoundError(REARRANGED)

    # -- what is multiplied with it ----------------------------------------------------------------------------

    def _right_sides(self) -> list[dict[tuple[int, int], tuple[int, int]]]:
        """The nodes of w, Q and V with their signs, by row in the order of elimination and by column."""
        holds = self._holding()
        tables = []
        for output, width in zip(self.program.results[:3], (1, self.n, self.n), strict=True):
            table: dict[tuple[int, int], tuple[int, int]] = {}
            rows: dict[tuple[int, int], list[int]] = {}
            for i, joint in enumerate(self.order):
                for j in range(width):
                    products = self._products_with_P(output[width * joint + j], holds, i)
                    rows[i, j] = sorted(k for k, *_ in products)
                    for k, sign, other, roundings in products:
                        self.roundings_of_products = max(self.roundings_of_products, roundings)
                        if table.setdefault((k, j), (other, sign)) != (other, sign):
                            raise NoBoundError(REARRANGED)
            for (i, j), row in rows.items():  # every row has each product once, but for entries of P that are zero
                if row != [k for k in range(self.n) if (k, j) in table and (i, k) in self._entries_of_P]:
                    raise NoBoundError(REARRANGED)
            tables.append(table)
        return tables

    def _holding(self) -> list[bool]:
        """For every node whether it depends on entries of P otherwise than through x."""
        holds: list[bool] = []
        for index, node in enumerate(self.nodes):
            of_args = any(holds[arg] and arg not in self._x for arg in node.args)
            holds.append(index in self._P or of_args)
        return holds

    def _products_with_P(self, index: int, holds: Sequence[bool], row: int) -> list[tuple[int, int, int, int]]:
        """The products ``-P_ik Q_kj`` of a sum, i = ``row``: k, sign and node of Q_kj, and the roundings."""

        def walk(index: int, root: bool = False) -> list[tuple[int, int, int | None, int]]:
            node = self.nodes[index]
            if index in self._P:
                first, second, sign = self._P[index]
                if row not in (first, second):
                    raise NoBoundError(REARRANGED)
                return [(first + second - row, sign, None, 0)]
            if node.op is Op.CONST and node.number == 0:
                return []
            if not root and (index in self._x or not holds[index]):
                raise NoBoundError(REARRANGED)
            if node.op is Op.NEG:
                return [(k, -sign, other, count) for k, sign, other, count in walk(node.args[0], root)]
            if node.op is Op.ADD or node.op is Op.SUB:
                turned = -1 if node.op is Op.SUB else 1
                first_, second_ = (walk(arg) for arg in node.args)
                return [
                    *((k, sign, other, count + 1) for k, sign, other, count in first_),
                    *((k, turned * sign, other, count + 1) for k, sign, other, count in second_),
                ]
            if node.op is Op.MUL:
                a, b = node.args
                if not holds[a] or a in self._x:
                    a, b = b, a
                if holds[b] and b not in self._x:
                    raise NoBoundError(REARRANGED)
                rest = self.plain(b)
                turned = 1 if self.values[rest] == self.values[b] else -1
                products: list[tuple[int, int, int | None, int]] = []
                for k, sign, other, count in walk(a):
                    if other is not None:
                        raise NoBoundError(REARRANGED)
                    products.append((k, sign * turned, rest, count + 1))
                return products
            raise NoBoundError(REARRANGED)

        summands = []
        for k, sign, other, count in walk(index, root=True):
            if other is None:
                raise NoBoundError(REARRANGED)
            summands.append((k, -sign, other, count))  # the sum is minus P times Q
        return summands

    def right_sides(self) -> Program:
        """The program of w, Q and V, row by row in the order of elimination, with x as an input.

        Raises NoBoundError if they are not those of inverse dynamics at another x.
        """
        n, given = self.n, self.program
        place = {index: (len(given.inputs), joint) for index, joint in self._x.items()}
        nodes = [Node(Op.INPUT, (), place[index]) if index in place else node for index, node in enumerate(given.nodes)]
        zero = len(nodes)
        nodes.append(Node(Op.CONST, (), 0))
        widths = (1, n, n)
        results = [
            [table.get((i, j), (zero, 1))[0] for i in range(n) for j in range(width)]
            for table, width in zip(self._right, widths, strict=True)
        ]
        wide = given.with_fields(nodes=tuple(nodes), inputs=(*given.inputs, Port(_GIVEN, (n,))))
        program = with_results(wide, results)
        if any(node.op is Op.DIV or node.op is Op.SELECT for node in program.nodes):
            raise NoBoundError(REARRANGED)
        self._compare_right_sides(program)
        return program

    def _compare_right_sides(self, program: Program) -> None:
        n = self.n
        generator = random.Random(f"{program.name} at another x")
        x = [generator.uniform(-2.0, 2.0) for _ in range(n)]
        given = [0.0] * n
        for index, k in self._x.items():
            given[k] = x[k] if self.values[index] == self.values[self.program.results[0][k]] else -x[k]
        values = exact_values(program, [*(self.state[port.name] for port in self.program.inputs), given])
        other = self._derivatives
        zero = exact_values(other, [self._value_of(port, [0.0] * n) for port in other.inputs])
        at_x = exact_values(other, [self._value_of(port, x) for port in other.inputs])
        tau = self.state[torque_port(self.program).name]
        wanted = [
            [zero[other.results[0][k]] - tau[k] for k in self.order],
            *([at_x[other.results[m][n * k + j]] for k in self.order for j in range(n)] for m in (1, 2)),
        ]
        for table, row, expected, width in zip(self._right, program.results, wanted, (1, n, n), strict=True):
            size = max(map(abs, expected))
            for place, (index, value) in enumerate(zip(row, expected, strict=True)):
                sign = table.get(divmod(place, width), (0, 1))[1]
                if abs(sign * values[index] - value) > size * mpmath.mpf(10) ** -SAME_AT_X:
                    raise NoBoundError(REARRANGED)

    def _value_of(self, port: Port, x: Sequence[Any]) -> Sequence[Any]:
        return x if port.role is Role.ACCELERATION else self.state[port.name]


SAME_AT_X = 25
"""Digits in which right sides agree with inverse dynamics, of their largest element."""
