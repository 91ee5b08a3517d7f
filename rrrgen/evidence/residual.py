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

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import mpmath

from rrrgen.evidence.factorization import (
    MARGIN,
    REARRANGED,
    Cut,
    Factorization,
    Form,
    in_either_order,
    in_triangle,
    state_in,
    torque_port,
)
from rrrgen.evidence.rounding import FLOAT, PRECISIONS, Box, NoBoundError, enclosures
from rrrgen.evidence.vectors import DIGITS, exact_values
from rrrgen.program import Op, Program, Role
from rrrgen.program.program import with_results


@dataclass(frozen=True)
class ResidualBounds:
    """Bounds of the residual of every row, N m or N, in both precisions, where the status is ok and ddq is in its box.

    ``parts`` is the number of equal parts into which every angle's range was split.
    """

    double: tuple[float, ...]
    single: tuple[float, ...]
    parts: int


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
    plain = form.magnitudes(known)
    g = form.growth(u)
    G = form.weights(known, plain, largest)  # steps 1 and 2
    # steps 3 to 5
    Z = sum(x * a for x, a in zip(G, limits, strict=True)) * (1.0 + 3.0 * c) * MARGIN
    sizes = [
        (torques[i] + G[i] * Z + g * (plain[n + i] + G[i] * Z)) / (1.0 - g) * (1.0 + 3.0 * c) * MARGIN for i in range(n)
    ]
    final = form.bounds(known, G, Z, sizes)
    bounds = []
    for precision, (inside, right) in zip(PRECISIONS, (final.double, final.single), strict=True):
        u = precision.roundoff
        c = (n + 1) * u / (1.0 - (n + 1) * u)
        tiny = 4.0 * n * n * precision.smallest * max(1.0, *G) ** 2 * (1.0 + sum(limits))
        rows = [
            right[i]
            + 3.0 * c * G[i] * Z
            + sum((inside[in_triangle(max(i, j), min(i, j))] + 3.0 * u * G[i] * G[j]) * limits[j] for j in range(n))
            + tiny
            for i in range(n)
        ]
        bounds.append(tuple(rows[order.index(k)] * MARGIN for k in range(n)))
    return ResidualBounds(bounds[0], bounds[1], final.parts)


def _read(program: Program, mass: Program, bias: Program, box: Box) -> Form:
    """The form of forward dynamics, with the base or the tip eliminated first. Raises NoBoundError if there is none."""
    state = state_in(program, box)
    with mpmath.workdps(DIGITS):
        return in_either_order(
            torque_port(program).size, lambda order: _SolutionReader(program, mass, bias, state, order).form()
        )


class _SolutionReader(Factorization):
    """Recognises the whole solution of forward dynamics."""

    def __init__(
        self, program: Program, mass: Program, bias: Program, state: Mapping[str, list[float]], order: tuple[int, ...]
    ) -> None:
        super().__init__(program, mass, state, order)
        self.require_positive_pivots()
        h = exact_values(bias, [state[port.name] for port in bias.inputs])
        tau = state[torque_port(program).name]
        self.rhs = [tau[i] - h[bias.results[0][i]] for i in order]
        self.y, self.x = self._solve()
        self.solution = [self._node_when_ok(program.results[0][i]) for i in order]
        for k, index in enumerate(self.solution):
            self.take(index, "x", k, k, self.x[k])
        self.right = [self._right_side(k) for k in range(self.n)]

    def _solve(self) -> tuple[list[Any], list[Any]]:
        """y (n,) of L y = rhs, and x (n,) of L' x = y / D with the pivots D, the diagonal of S.

        x are the accelerations at the state, in the order of elimination.
        """
        n, L, y = self.n, self.L, list(self.rhs)
        for i in range(n):
            for k in range(i):
                y[i] -= L[i][k] * y[k]
        x = [y[i] / self.S[i][i] for i in range(n)]
        for i in reversed(range(n)):
            for k in range(i + 1, n):
                x[i] -= L[k][i] * x[k]
        return y, x

    def _node_when_ok(self, index: int) -> int:
        """The node that a result holds where the status is ok."""
        node = self.nodes[index]
        return node.args[2] if node.op is Op.SELECT else index

    def _right_side(self, k: int) -> int:
        """Take y_k: the node that is multiplied by the reciprocal of the pivot."""
        for index in self.nodes_of(self.y[k]):
            for node in self.nodes:
                if node.op is Op.MUL and index in map(self.plain, node.args):
                    kinds = [self.roles[arg] for arg in map(self.plain, node.args) if arg in self.roles]
                    if any((role.kind, role.row) == ("r", k) for role in kinds):
                        self.take(self.plain(index), "y", k, k, self.y[k])
                        return self.plain(index)
        raise NoBoundError(REARRANGED)

    def _is_torque(self, index: int) -> bool:
        node = self.nodes[index]
        return node.op is Op.INPUT and self.program.inputs[node.place[0]].role is Role.TORQUE

    def form(self) -> Form:
        """The form of the program. Raises NoBoundError if a sum is not the one of the factorization."""
        n, cut = self.n, Cut(self)
        triangle = self.triangle(cut)
        right = [
            cut.copy_sum(self.right[i], {frozenset({("L", i, k), ("y", k, k)}) for k in range(i)}) for i in range(n)
        ]
        solution = [
            cut.copy_sum(
                self.solution[i],
                {frozenset({("r", i, i), ("y", i, i)})}
                | {frozenset({("L", k, i), ("x", k, k)}) for k in range(i + 1, n)},
            )
            for i in range(n)
        ]
        (entries, sides, results), value = self.evaluate_at_random(cut, [triangle, right, solution])
        self.compare(entries, value)
        for i in range(n):
            self.agree(sides[i], self.rhs[i], [value("L", i, k) * value("y", k, k) for k in range(i)])
            below = [value("L", k, i) * value("x", k, k) for k in range(i + 1, n)]
            self.agree(results[i], value("r", i, i) * value("y", i, i), below)
        roots = [*self.pivots, *self.right]
        summands = [[leaf for leaf in self.summands(index) if not self._is_torque(leaf)] for index in roots]
        return Form(
            n,
            self.order,
            cut.program([triangle, right]),
            tuple(cut.operands),
            with_results(self.program, summands),
            max(len(self.leaves(index)) for index in roots if index is not None),
        )
