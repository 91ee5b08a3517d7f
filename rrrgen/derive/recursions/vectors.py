"""Three-vectors and 3x3 matrices as plain lists of any scalar that has the operators + - *."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from typing import Any

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
