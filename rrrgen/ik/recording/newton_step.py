"""One Newton step of six joints on a target pose, as a straight-line program: it is evaluated for all branches at once.

The task error e (position over the reach, rotation as the vector part of R_target R') and the Jacobian J give the step
d = J^-1 e by modified Gram-Schmidt without square roots, J = Q U with orthogonal columns in Q and U unit triangular:
stable without pivoting, so that there is no choice on the way and compilers can evaluate several branches in one
register. The same factors give the norm of J^-1, and minors of J its determinant.
"""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from itertools import combinations
from math import factorial

from rrrgen.ik.geometry.chain import Joint, KinematicChain, Matrix
from rrrgen.ik.solutions.general_6r import cosine_and_sine
from rrrgen.program import Builder, Port, Program, Value

TERMS = 11
"""Terms of the series of sine and cosine, for |x| <= pi/2: what is left out is below 1e-17."""


def newton_program(chain: KinematicChain, locked: int | None) -> Program:
    """The program of one step: ``q`` (n,) and ``T`` (12,) -> ``step`` (n,), ``error``, ``moved``, ``inverse``, ``det``.

    ``error`` is |e|^2 before the step, ``moved`` |d|^2 of the step, ``inverse`` the squared Frobenius norm of J^-1
    (rad, reaches), ``det`` the determinant of J. The joint ``locked`` stays. Angles are within (-3 pi/2, 3 pi/2).
    """
    b = Builder()
    columns, error = _columns_and_error(b, chain)
    free = [k for k in range(chain.n) if k != locked]
    J = [columns[k] for k in free]
    solved, inverse = _solve_linear(J, error)
    units = [1 if chain.joints[k].revolute else Fraction(chain.reach) for k in free]
    step: list[Value] = [0] * chain.n
    for k, unit, value in zip(free, units, solved, strict=True):
        step[k] = unit * chain.joints[k].sign * value
    outputs = [
        (Port("step", (chain.n,)), step),
        (Port("error", (1,)), [_dot(error, error)]),
        (Port("moved", (1,)), [_dot(solved, solved)]),
        (Port("inverse", (1,)), [inverse]),
        (Port("det", (1,)), [_determinant(J)]),
    ]
    return b.program("newton", outputs)


def error_program(chain: KinematicChain) -> Program:
    """The program of the ``error`` alone, with the inputs of :func:`newton_program`."""
    b = Builder()
    _, error = _columns_and_error(b, chain)
    return b.program("missed", [(Port("error", (1,)), [_dot(error, error)])])


def _columns_and_error(b: Builder, chain: KinematicChain) -> tuple[list[list[Value]], list[Value]]:
    """Columns of the Jacobian at the input ``q``, and the task error (6,) of the target ``T``."""
    q = b.input(Port("q", (chain.n,)))
    T = b.input(Port("T", (12,)))
    columns, tip, R = _kinematics(chain, q)
    per_reach = 1 / Fraction(chain.reach)
    position = [T[4 * i + 3] * per_reach - tip[i] for i in range(3)]
    E = [[sum(T[4 * i + k] * R[k][j] for k in range(3)) for j in range(3)] for i in range(3)]
    half = Fraction(1, 2)
    turn = [half * (E[2][1] - E[1][2]), half * (E[0][2] - E[2][0]), half * (E[1][0] - E[0][1])]
    return columns, [*position, *turn]


def _dot(x: list[Value], y: list[Value]) -> Value:
    return sum(u * v for u, v in zip(x, y, strict=True))


def _cross(u: list[Value], v: list[Value]) -> list[Value]:
    return [u[(i + 1) % 3] * v[(i + 2) % 3] - u[(i + 2) % 3] * v[(i + 1) % 3] for i in range(3)]


def _kinematics(chain: KinematicChain, q: Sequence[Value]) -> tuple[list[list[Value]], list[Value], list[list[Value]]]:
    """Columns of the Jacobian, position of the tip (in reaches), and the columns of its rotation."""
    x, y, z, p = _first_frame(chain.transforms[0], chain.reach)
    axes = []
    for joint, matrix, value in zip(chain.joints, chain.transforms[1:], q, strict=True):
        axes.append((z, p))
        if joint.revolute:
            c, s = _cosine_and_sine_series(joint, value)
            x, y = (
                [u * c + v * s for u, v in zip(x, y, strict=True)],
                [v * c - u * s for u, v in zip(x, y, strict=True)],
            )
        else:
            shift = (joint.sign * value + _number(joint.offset)) * (1 / Fraction(chain.reach))
            p = [u + shift * v for u, v in zip(p, z, strict=True)]
        x, y, z, p = _multiply_frame((x, y, z, p), matrix, chain.reach)
    columns = []
    for joint, (axis, at) in zip(chain.joints, axes, strict=True):
        if joint.revolute:
            columns.append([*_cross(axis, [u - v for u, v in zip(p, at, strict=True)]), *axis])
        else:
            columns.append([*axis, 0, 0, 0])
    return columns, p, [x, y, z]


def _number(x: object) -> Fraction:
    return Fraction(float(x))  # type: ignore[arg-type]


def _first_frame(matrix: Matrix, reach: float) -> tuple[list[Value], ...]:
    columns: list[list[Value]] = [[_number(row[k]) for row in matrix] for k in range(3)]
    columns.append([_number(row[3]) / Fraction(reach) for row in matrix])
    return tuple(columns)


def _multiply_frame(frame: tuple[list[Value], ...], matrix: Matrix, reach: float) -> tuple[list[Value], ...]:
    """Multiply a frame by a constant transform: the columns (x, y, z, p) of the product, p in reaches.

    ``frame`` holds the four columns of the frame, ``matrix`` is the 3x4 transform with lengths in m, ``reach`` in m.
    """
    M = [[_number(value) for value in row] for row in matrix]
    x, y, z, p = frame
    turned = [[x[i] * M[0][k] + y[i] * M[1][k] + z[i] * M[2][k] for i in range(3)] for k in range(3)]
    shift = [M[k][3] / Fraction(reach) for k in range(3)]
    return (*turned, [p[i] + x[i] * shift[0] + y[i] * shift[1] + z[i] * shift[2] for i in range(3)])


def _cosine_and_sine_series(joint: Joint, value: Value) -> tuple[Value, Value]:
    """Cosine and sine of the raw angle ``sign value + offset`` of a revolute joint, without calls of functions.

    They are summed as power series of half the angle, then doubled, then rotated by the constant offset.
    """
    half = Fraction(1, 2) * value
    square = half * half
    sine: Value = Fraction((-1) ** (TERMS - 1), factorial(2 * TERMS - 1))
    cosine: Value = Fraction((-1) ** TERMS, factorial(2 * TERMS))
    for k in range(TERMS - 2, -1, -1):
        sine = Fraction((-1) ** k, factorial(2 * k + 1)) + square * sine
    for k in range(TERMS - 1, -1, -1):
        cosine = Fraction((-1) ** k, factorial(2 * k)) + square * cosine
    s1 = half * sine
    c, s = 1 - 2 * (s1 * s1), 2 * joint.sign * (s1 * cosine)
    if not float(joint.offset):
        return c, s
    c0, s0 = (Fraction(v) for v in cosine_and_sine(float(joint.offset)))
    return c * c0 - s * s0, s * c0 + c * s0


def _solve_linear(J: list[list[Value]], e: list[Value]) -> tuple[list[Value], Value]:
    """The solution d of ``sum d_k J[k] = e``, and the squared Frobenius norm of the inverse of J."""
    columns, right, n = [list(column) for column in J], list(e), len(J)
    U: list[list[Value]] = [[0] * n for _ in range(n)]
    y: list[Value] = []
    scales: list[Value] = []
    for k in range(n):
        scale = Fraction(1) / _dot(columns[k], columns[k])
        scales.append(scale)
        for j in range(k + 1, n):
            U[k][j] = _dot(columns[k], columns[j]) * scale
            columns[j] = [v - U[k][j] * u for u, v in zip(columns[k], columns[j], strict=True)]
        y.append(_dot(columns[k], right) * scale)
        right = [v - y[k] * u for u, v in zip(columns[k], right, strict=True)]
    d: list[Value] = [0] * n
    inverse: Value = 0
    V: list[list[Value]] = [[0] * n for _ in range(n)]  # U^-1, column by column
    for j in range(n):
        V[j][j] = 1
        for i in range(j - 1, -1, -1):
            V[i][j] = -sum(U[i][k] * V[k][j] for k in range(i + 1, j + 1))
        inverse = inverse + scales[j] * sum(V[i][j] * V[i][j] for i in range(j + 1))
    for i in range(n - 1, -1, -1):
        d[i] = y[i] - sum(U[i][k] * d[k] for k in range(i + 1, n))
    return d, inverse


def _determinant(J: list[list[Value]]) -> Value:
    """The determinant of six columns by Laplace's expansion in the minors of their upper and lower halves."""
    upper, lower = ([column[half : half + 3] for column in J] for half in (0, 3))
    total: Value = 0
    normals = {pair: _cross(lower[pair[0]], lower[pair[1]]) for pair in combinations(range(6), 2)}
    above = {pair: _cross(upper[pair[0]], upper[pair[1]]) for pair in combinations(range(6), 2)}
    for chosen in combinations(range(6), 3):
        i, j, k = (index for index in range(6) if index not in chosen)
        sign = -1 if (sum(chosen) - 3) % 2 else 1
        total = total + sign * _dot(above[chosen[:2]], upper[chosen[2]]) * _dot(normals[i, j], lower[k])
    return total
