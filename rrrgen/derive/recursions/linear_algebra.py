"""Vectors and matrices of scalars that are being recorded, and the factorization M = L D L' of the mass matrix."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any

from rrrgen.program import Builder, Status, Value

# ------------------------------------------------------------------------------------------------------------------
# The factorization M = L D L' of the mass matrix, recorded without branches and without division by zero.
# ------------------------------------------------------------------------------------------------------------------

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
class LDLFactors:
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


def factorize(builder: Builder, M: Rows, *, tips_first: bool = False) -> LDLFactors:
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
    return LDLFactors(b, L, pivots, reciprocals, status)


# ------------------------------------------------------------------------------------------------------------------
# Three-vectors and 3x3 matrices as plain lists of any scalar that has the operators + - *.
# ------------------------------------------------------------------------------------------------------------------

Vector = list[Any]
Matrix = list[list[Any]]

ZERO3: Vector = [0, 0, 0]


def is_number(value: Any, *numbers: int) -> bool:
    """Whether ``value`` is a number known while deriving and equals one of ``numbers``."""
    return isinstance(value, (int, Fraction)) and value in numbers


def add(u: Sequence[Any], v: Sequence[Any]) -> Vector:
    """u + v."""
    return [x + y for x, y in zip(u, v, strict=True)]


def subtract(u: Sequence[Any], v: Sequence[Any]) -> Vector:
    """u - v."""
    return [x - y for x, y in zip(u, v, strict=True)]


def scale(factor: Any, u: Sequence[Any]) -> Vector:
    """factor * u."""
    return [factor * x for x in u]


def elementwise(u: Sequence[Any], v: Sequence[Any]) -> Vector:
    """The products of the entries, (u_k v_k)."""
    return [x * y for x, y in zip(u, v, strict=True)]


def dot(u: Sequence[Any], v: Sequence[Any]) -> Any:
    """u . v."""
    total: Any = 0
    for x, y in zip(u, v, strict=True):
        if x and y:  # false only for a zero known while deriving, as most entries of constant rotations are
            total = total + x * y
    return total


def cross(u: Sequence[Any], v: Sequence[Any]) -> Vector:
    """u x v."""
    return [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]]


def times(A: Matrix, v: Sequence[Any]) -> Vector:
    """A v."""
    return [dot(row, v) for row in A]


def transposed_times(A: Matrix, v: Sequence[Any]) -> Vector:
    """A' v."""
    return [dot([row[k] for row in A], v) for k in range(len(A[0]))]


def product(A: Matrix, B: Matrix) -> Matrix:
    """A B."""
    columns = list(zip(*B, strict=True))
    return [[dot(row, column) for column in columns] for row in A]


def transpose(A: Matrix) -> Matrix:
    """A'."""
    return [list(row) for row in zip(*A, strict=True)]


def rotate_z(c: Any, s: Any, v: Sequence[Any]) -> Vector:
    """``Rz v``: the vector rotated about z by the angle with cosine ``c`` and sine ``s``."""
    return [c * v[0] - s * v[1], s * v[0] + c * v[1], v[2]]


def rotate_z_back(c: Any, s: Any, v: Sequence[Any]) -> Vector:
    """``Rz' v``: the vector rotated about z by minus the angle with cosine ``c`` and sine ``s``."""
    return [c * v[0] + s * v[1], c * v[1] - s * v[0], v[2]]


def flat(M: list[list[Any]]) -> list[Any]:
    """The entries of a matrix, row-major."""
    return [value for row in M for value in row]


def rows(n: int, entries: Sequence[Any]) -> Matrix:
    """The n x n matrix of ``entries``, given row-major."""
    return [list(entries[k * n : (k + 1) * n]) for k in range(n)]
