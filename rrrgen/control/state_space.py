"""Modal state space of a difference equation: one block per mode, so that it also runs in single precision.

The companion form of a difference equation holds a few large numbers that nearly cancel where poles lie close to one
another, as all slow ones do at a high sampling rate. In blocks of its own every mode keeps its relative precision.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from rrrgen.arrays import Array

SAME_POLE = 1e-3  # poles nearer to each other share a block: apart, their parts of the output would nearly cancel
DOUBLE_POLE = 1e-5  # from 1: by so much does rounding split the two poles of a joint that moves freely
HORIZON = 2000  # samples over which the states of a block are brought to the size of the output


@dataclass(frozen=True)
class StateSpace:
    """``x_{k+1} = A x_k + B u_k``, ``y_k = C x_k + D u_k``: A (n, n), B (n,), C (n,), D a number."""

    A: Array
    B: Array
    C: Array
    D: float

    def run(self, u: Array) -> Array:
        """The outputs (N,) for the inputs ``u`` (N,) from the state 0."""
        x, y = np.zeros(len(self.B)), np.empty(len(u))
        for k, value in enumerate(u):
            y[k] = self.C @ x + self.D * value
            x = self.A @ x + self.B * value
        return y

    def to_json(self) -> dict[str, Any]:
        """The state space as plain data, for the key ``state_space`` of result files."""
        return {"A": self.A, "B": self.B, "C": self.C, "D": self.D}


def realize(numerator: Array, denominator: Array) -> StateSpace:
    """The state space of ``(c_0 + c_1 z^-1 + ..)/(1 + d_1 z^-1 + ..)``, block-diagonal with one block per mode.

    Blocks are ordered by the distance of their poles from 1, slow ones first; a pair of complex poles r e^(+-j w) has
    the block ``r [[cos w, sin w], [-sin w, cos w]]``. States are scaled to the size of the output.
    """
    n = max(len(numerator), len(denominator)) - 1
    c, d = np.zeros(n + 1), np.zeros(n + 1)
    c[: len(numerator)], d[: len(denominator)] = numerator, denominator
    A: Array = np.eye(n, k=1)
    A[:, 0] -= d[1:]
    B, C, D = c[1:] - d[1:] * c[0], np.eye(n)[0], float(c[0])
    blocks = []
    while len(
        A
    ):  # the poles anew each time: a block may take others along than those that were near one another before
        (A, B, C), block = _split(A, B, C, _clusters(np.linalg.eigvals(A))[0])
        blocks.append(_scaled(*_rotated(*block)))
    total, start = np.zeros((n, n)), 0
    for part, _, _ in blocks:
        total[start : start + len(part), start : start + len(part)] = part
        start += len(part)
    return StateSpace(total, np.concatenate([b for _, b, _ in blocks]), np.concatenate([c for _, _, c in blocks]), D)


_Block = tuple[Array, Array, Array]


def _clusters(poles: Any) -> list[Any]:
    """Poles in groups that are closed under conjugation and lie apart from one another."""
    rest = list(poles[np.argsort(np.abs(poles - 1.0))])
    found = []
    while rest:
        group, grown = [rest.pop(0)], True
        while grown:
            near = [p for p in rest if min(min(abs(p - g), abs(p.conjugate() - g)) for g in group) < SAME_POLE]
            rest = [p for p in rest if not any(p is other for other in near)]
            group, grown = group + near, bool(near)
        found.append(np.array(group))
    return found


def _split(A: Array, B: Array, C: Array, poles: Any) -> tuple[_Block, _Block]:
    """The model without the given poles, and the block that has them."""
    from scipy.linalg import schur, solve_sylvester

    size = len(poles)
    empty = np.zeros(0)
    if size == len(A):
        return (np.zeros((0, 0)), empty, empty), (A, B, C)

    def chosen(real: float, imaginary: float) -> bool:
        near = np.sort(np.abs(np.linalg.eigvals(A)[:, None] - poles).min(axis=1))
        border = 0.5 * (near[size - 1] + near[size])
        return bool(np.abs(real + 1j * imaginary - poles).min() <= border)

    T, Q, found = schur(A, output="real", sort=chosen)
    size = int(found)
    if size in (0, len(A)):  # poles so near to one another that the reordering does not tell them apart
        return (np.zeros((0, 0)), empty, empty), (A, B, C)
    X = solve_sylvester(T[:size, :size], -T[size:, size:], -T[:size, size:])
    left, right = Q[:, :size], Q[:, :size] @ X + Q[:, size:]
    to_right = Q[:, size:].T @ B
    to_left = Q[:, :size].T @ B - X @ to_right
    return (T[size:, size:], to_right, C @ right), (T[:size, :size], to_left, C @ left)


def _rotated(A: Array, B: Array, C: Array) -> _Block:
    """A pair of complex poles as a scaled rotation; two poles at 1 exactly there."""
    from scipy.linalg import schur

    if len(A) != 2:
        return A, B, C
    values, vectors = np.linalg.eig(A)
    if np.abs(values - 1.0).max() < DOUBLE_POLE:
        T, Q = schur(A, output="real")
        return np.array([[1.0, T[0, 1]], [0.0, 1.0]]), Q.T @ B, C @ Q
    if abs(values[0].imag) < SAME_POLE:
        return A, B, C
    k = int(np.argmax(values.imag))
    T = np.column_stack([vectors[:, k].real, vectors[:, k].imag])
    a, b = values[k].real, values[k].imag
    return np.array([[a, b], [-b, a]]), np.linalg.solve(T, B), C @ T


def _scaled(A: Array, B: Array, C: Array) -> _Block:
    """States in units in which they are as large as the block's output, and as one another, after a pulse."""
    x, states = B, []
    for _ in range(HORIZON):
        states.append(x)
        x = A @ x
    with np.errstate(over="ignore", invalid="ignore"):
        sizes = np.sqrt(np.mean(np.square(states), axis=0))
        output = float(np.sqrt(np.mean((np.array(states) @ C) ** 2)))
        scale = sizes / output if output > 0.0 else np.ones(len(B))
    if not np.all(np.isfinite(scale)) or not np.all(scale > 0.0):
        return A, B, C
    return A * scale / scale[:, None], B / scale, C * scale
