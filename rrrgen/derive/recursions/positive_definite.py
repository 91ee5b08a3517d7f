"""The factorization M = L D L' of the mass matrix, recorded without branches and without division by zero."""

from __future__ import annotations

from dataclasses import dataclass, replace
from fractions import Fraction

from rrrgen.program import Builder, Status, Value

PIVOT_TOLERANCE = Fraction(1, 2**40)
"""A pivot smaller than this fraction of the diagonal entry of M counts as zero: half the digits of a double."""


def status_at(output: int) -> Status:
    """Describe the status output, number ``output``, of a program that solves with M: 1 if a pivot is not positive."""
    return Status.of(
        output,
        name="not positive definite",
        message="the mass matrix is not positive definite",
        meaning="the mass matrix is indefinite or singular",
    )


Rows = list[list[Value]]


@dataclass(frozen=True)
class Factors:
    """The factorization ``M = L D L'`` of a symmetric matrix: L (unit lower triangular), D and its reciprocals.

    ``status`` is 1 if a pivot is not positive; the factors are then finite but meaningless from that pivot on. With an
    ``order``, they are those of M with its rows and columns in this order; solutions are in the order of M.
    """

    builder: Builder
    L: Rows
    pivots: list[Value]
    reciprocals: list[Value]
    status: Value
    order: tuple[int, ...] = ()

    def forward(self, rhs: list[Value]) -> list[Value]:
        """The solution y (n,) of L y = rhs."""
        b, L, y = self.builder, self.L, list(rhs)
        for i in range(len(y)):
            for k in range(i):
                y[i] = b.sub(y[i], b.mul(L[i][k], y[k]))
        return y

    def solve(self, rhs: list[Value]) -> list[Value]:
        """The solution x (n,) of M x = rhs; zero if the status is 1."""
        b, L, n = self.builder, self.L, len(rhs)
        order = self.order or tuple(range(n))
        y = self.forward([rhs[i] for i in order])
        x = [b.mul(y[i], self.reciprocals[i]) for i in range(n)]
        for i in reversed(range(n)):
            for k in range(i + 1, n):
                x[i] = b.sub(x[i], b.mul(L[k][i], x[k]))
        return [b.select(self.status, 0, x[order.index(i)]) for i in range(n)]

    def negative_inverse(self) -> Rows:
        """The matrix ``-inv(M)`` (n, n) of the derivatives of forward dynamics; zero if the status is 1."""
        b, n = self.builder, len(self.L)
        scales = [b.select(self.status, 0, b.neg(value)) for value in self.reciprocals]
        X = self._inverse_of_L()
        scaled = [[b.mul(scales[k], X[k][j]) for j in range(k + 1)] for k in range(n)]
        result: Rows = [[0] * n for _ in range(n)]
        for i in range(n):
            for j in range(i, n):
                total: Value = 0
                for k in range(j, n):
                    total = b.add(total, b.mul(X[k][i], scaled[k][j]))
                result[i][j] = result[j][i] = total
        places = [self.order.index(i) for i in range(n)] if self.order else range(n)
        return [[result[i][j] for j in places] for i in places]

    def _inverse_of_L(self) -> Rows:
        b, L, n = self.builder, self.L, len(self.L)
        X: Rows = [[int(i == j) for j in range(n)] for i in range(n)]
        for j in range(n):
            for i in range(j + 1, n):
                total = L[i][j]
                for k in range(j + 1, i):
                    total = b.add(total, b.mul(L[i][k], X[k][j]))
                X[i][j] = b.neg(total)
        return X


def factorize(builder: Builder, M: Rows, *, tips_first: bool = False) -> Factors:
    """The factors L, D of the symmetric matrix ``M`` (n, n), recorded into ``builder``.

    ``tips_first`` eliminates the last joint first: in the mass matrix of a tree, whose entries between branches are
    zero, no entry of L between branches then differs from zero (Featherstone 2005). For a chain both orders cost the
    same.
    """
    if tips_first:
        order = tuple(reversed(range(len(M))))
        return replace(factorize(builder, [[M[i][j] for j in order] for i in order]), order=order)
    b, n = builder, len(M)
    L: Rows = [[0] * n for _ in range(n)]
    margins: list[Value] = []
    pivots: list[Value] = []
    reciprocals: list[Value] = []
    for j in range(n):
        scaled = [L[j][k] for k in range(j)]  # still L_jk d_k
        pivot = M[j][j]
        for k in range(j):
            L[j][k] = b.mul(scaled[k], reciprocals[k])
            pivot = b.sub(pivot, b.mul(L[j][k], scaled[k]))
        margin = pivot if j == 0 else b.sub(pivot, b.mul(PIVOT_TOLERANCE, M[j][j]))
        margins.append(margin)
        pivots.append(pivot)
        reciprocals.append(b.div(1, b.select(margin, pivot, 1)))
        for i in range(j + 1, n):
            entry = M[i][j]
            for k in range(j):
                entry = b.sub(entry, b.mul(L[i][k], L[j][k]))
            L[i][j] = entry
        L[j][j] = 1
    status: Value = 0
    for margin in reversed(margins):
        status = b.select(margin, status, 1)
    return Factors(b, L, pivots, reciprocals, status)
