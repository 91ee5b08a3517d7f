"""Arithmetic modulo a large prime, for exact ranks without tolerances.

Rational numbers map to the field by reduction modulo the prime. If a minor is non-zero in the field, it is non-zero
over the rationals; a rank found here is therefore an exact lower bound. The prime is chosen such that all primes up to
19 are squares modulo it, so the square roots in the sines of usual twist angles (30, 45, 60, 72 degrees) have exact
images.
"""

from __future__ import annotations

from fractions import Fraction

PRIME = 2305843009213682039  # 2**61 - 11913


class Residue:
    """An element of the prime field, with the Python operators."""

    __slots__ = ("value",)

    def __init__(self, value: int) -> None:
        self.value = value % PRIME

    @staticmethod
    def of(number: Operand) -> Residue:
        """The element of the prime field that represents an integer or a fraction."""
        if isinstance(number, Residue):
            return number
        if type(number) is int:
            return Residue(number)
        return Residue(number.numerator * pow(number.denominator, -1, PRIME))

    def __add__(self, other: Operand) -> Residue:
        if type(other) is not Residue:
            if other == 0:
                return self
            other = Residue.of(other)
        return Residue(self.value + other.value)

    __radd__ = __add__

    def __sub__(self, other: Operand) -> Residue:
        if type(other) is not Residue:
            if other == 0:
                return self
            other = Residue.of(other)
        return Residue(self.value - other.value)

    def __rsub__(self, other: Operand) -> Residue:
        return Residue.of(other) - self if other != 0 else -self

    def __mul__(self, other: Operand) -> Residue | int:
        if type(other) is not Residue:
            if other == 0:
                return 0
            if other == 1:
                return self
            other = Residue.of(other)
        return Residue(self.value * other.value)

    __rmul__ = __mul__

    def __truediv__(self, other: Operand) -> Residue:
        return Residue(self.value * pow(Residue.of(other).value, -1, PRIME))

    def __rtruediv__(self, other: Operand) -> Residue:
        return Residue.of(other) / self

    def __neg__(self) -> Residue:
        return Residue(-self.value)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, (Residue, int, Fraction)) and Residue.of(other).value == self.value

    def __hash__(self) -> int:
        return hash(self.value)

    def __repr__(self) -> str:
        return f"Residue({self.value})"


Operand = Residue | int | Fraction


def square_root(number: int) -> int | None:
    """A square root of ``number`` modulo the prime, None if there is none. Uses that the prime is 3 modulo 4."""
    root = pow(number % PRIME, (PRIME + 1) // 4, PRIME)
    return root if root * root % PRIME == number % PRIME else None


def row_echelon(rows: list[list[int]]) -> tuple[list[list[int]], list[int]]:
    """The non-zero rows of the reduced row echelon form and the pivot columns; modifies ``rows``."""
    pivots: list[int] = []
    height, width = len(rows), len(rows[0]) if rows else 0
    top = 0
    for column in range(width):
        pivot_index = next((r for r in range(top, height) if rows[r][column]), None)
        if pivot_index is None:
            continue
        rows[top], rows[pivot_index] = rows[pivot_index], rows[top]
        inverse = pow(rows[top][column], -1, PRIME)
        pivot_row = [v * inverse % PRIME for v in rows[top]]
        rows[top] = pivot_row
        for r in range(height):
            factor = rows[r][column]
            if r != top and factor:
                rows[r] = [(v - factor * w) % PRIME for v, w in zip(rows[r], pivot_row, strict=True)]
        pivots.append(column)
        top += 1
        if top == height:
            break
    return rows[:top], pivots
