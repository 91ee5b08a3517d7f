"""Dense matrices of a few rows as lists of rows, where loading NumPy would cost more than the work with it.

The compiler decides by them what an arm can do: ranks of Jacobians, definite mass matrices, roots of quartics.
"""

from __future__ import annotations

from cmath import rect
from collections.abc import Sequence
from math import fsum, hypot, isfinite, pi, sqrt

Rows = Sequence[Sequence[float]]

MOST_SWEEPS = 30
"""Sweeps of Jacobi rotations; they converge quadratically, a matrix of ten columns after five or six."""

ORTHOGONAL = 1e-15
"""Cosine of the angle between two columns below which they count as orthogonal: round-off of their product."""


def singular_values(rows: Rows) -> list[float]:
    """The min(m, n) singular values of a matrix (m, n), the largest first.

    One-sided Jacobi method (Hestenes 1958; Golub and Van Loan, Matrix Computations, 8.6.3): pairs of columns are
    rotated until all are orthogonal, and their lengths are the singular values. It finds small ones with a small
    relative error, which methods that go by A'A do not.
    """
    columns = [list(column) for column in zip(*rows, strict=True)]
    if len(columns) > len(rows):
        columns = [list(row) for row in rows]  # the same values, and fewer pairs
    for _ in range(MOST_SWEEPS):
        rotated = 0
        for q in range(len(columns)):
            for p in range(q):
                rotated += _rotate(columns, p, q)
        if rotated == 0:
            break
    return sorted((hypot(*column) for column in columns), reverse=True)


def _rotate(columns: list[list[float]], p: int, q: int) -> bool:
    """Make the columns ``p`` and ``q`` orthogonal by a rotation of the plane; False where they are already."""
    x, y = columns[p], columns[q]
    a, b, c = (fsum(u * v for u, v in zip(*pair, strict=True)) for pair in ((x, x), (y, y), (x, y)))
    if abs(c) <= ORTHOGONAL * sqrt(a) * sqrt(b):
        return False
    zeta = (b - a) / (2.0 * c)
    t = (1.0 if zeta >= 0.0 else -1.0) / (abs(zeta) + hypot(1.0, zeta))  # the smaller of both angles
    cosine = 1.0 / hypot(1.0, t)
    sine = cosine * t
    columns[p] = [cosine * u - sine * v for u, v in zip(x, y, strict=True)]
    columns[q] = [sine * u + cosine * v for u, v in zip(x, y, strict=True)]
    return True


def is_positive_definite(rows: Rows, least: float = 0.0) -> bool:
    """Whether every eigenvalue of a symmetric matrix is above ``least``: its Cholesky factorization exists.

    The factors are those of ``A - least I``; only the lower triangle is read. NaN is not definite.
    """
    n = len(rows)
    if not all(isfinite(x) for row in rows for x in row):
        return False
    L = [[0.0] * n for _ in range(n)]
    for i in range(n):
        for j in range(i):
            L[i][j] = (rows[i][j] - fsum(L[i][k] * L[j][k] for k in range(j))) / L[j][j]
        pivot = rows[i][i] - least - fsum(L[i][k] ** 2 for k in range(i))
        if not pivot > 0.0:
            return False
        L[i][i] = sqrt(pivot)
    return True


MOST_ROOT_STEPS = 200
"""Steps of the simultaneous iteration; simple roots take about ten, double ones, where it converges linearly, fifty."""

ROOT_STEP = 1e-15
"""Relative step below which the roots stand still."""


def polynomial_roots(coefficients: Sequence[complex]) -> list[complex]:
    """All complex roots of ``c[0] z^n + c[1] z^(n-1) + ... + c[n]``, for a small degree n.

    Simultaneous iteration of Ehrlich and Aberth: a Newton step for each root, on the polynomial divided by the others.
    Leading zeros lower the degree; a constant has no roots. Starts are on a circle of Cauchy's radius, turned off the
    real axis, on which a pair of conjugate roots would hold each other.
    """
    c = [complex(x) for x in coefficients]
    while c and c[0] == 0:
        del c[0]
    zeros = 0
    while len(c) > 1 and c[-1] == 0:
        del c[-1]
        zeros += 1
    n = len(c) - 1
    if n < 1:
        return [0j] * zeros
    radius = max((abs(x / c[0]) ** (1 / k) for k, x in enumerate(c) if k), default=1.0)
    z = [rect(radius, 0.4 + 2 * pi * k / n) for k in range(n)]
    for _ in range(MOST_ROOT_STEPS):
        largest = 0.0
        for i in range(n):
            step = _aberth_step(c, z, i)
            z[i] -= step
            largest = max(largest, abs(step))
        if largest <= ROOT_STEP * radius:
            break
    return z + [0j] * zeros


def _aberth_step(c: Sequence[complex], z: Sequence[complex], i: int) -> complex:
    value, slope = c[0], 0j
    for coefficient in c[1:]:
        slope = slope * z[i] + value
        value = value * z[i] + coefficient
    if value == 0:
        return 0j
    repulsion = sum(1 / (z[i] - other) for k, other in enumerate(z) if k != i and other != z[i])
    denominator = slope / value - repulsion
    return 1 / denominator if denominator else 0j
