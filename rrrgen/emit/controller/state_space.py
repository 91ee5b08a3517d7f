"""Modal state-space form of a difference equation: one block per mode, precise enough for single precision.

The companion form of a difference equation has large coefficients that nearly cancel where poles lie close together, as
all slow poles do at a high sampling rate. With a block of its own, each mode keeps its relative precision.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rrrgen.base.arrays import Array

SAME_POLE = 1e-3  # poles nearer to each other share a block: in separate blocks their outputs would nearly cancel
DOUBLE_POLE = 1e-5  # distance from 1 to which rounding splits the double pole of a joint that moves freely
HORIZON = 2000  # samples of the pulse response over which the states of a block are scaled to its output


@dataclass(frozen=True)
class StateSpace:
    """Single-input, single-output model in discrete time: ``x_{k+1} = A x_k + B u_k``, ``y_k = C x_k + D u_k``.

    ``A`` (n, n), ``B`` (n,), ``C`` (n,), and a number ``D``.
    """

    A: Array
    B: Array
    C: Array
    D: float

    def run(self, u: Array) -> Array:
        """Outputs (N,) for the inputs ``u`` (N,), started from the state zero."""
        x, y = np.zeros(len(self.B)), np.empty(len(u))
        for k, value in enumerate(u):
            y[k] = self.C @ x + self.D * value
            x = self.A @ x + self.B * value
        return y

    def to_json(self) -> dict[str, Any]:
        """The matrices A, B, C, D as plain data, for the key ``state_space`` of result files."""
        return {"A": self.A, "B": self.B, "C": self.C, "D": self.D}


def realize(numerator: Array, denominator: Array) -> StateSpace:
    """State-space model of ``(c_0 + c_1 z^-1 + ..)/(1 + d_1 z^-1 + ..)``, block-diagonal with one block per mode.

    ``numerator`` holds c_0, c_1, .. and ``denominator`` 1, d_1, ...

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
    while len(A):  # poles computed anew each time: a split may remove more poles than the cluster that was asked for
        (A, B, C), block = _split(A, B, C, _clusters(np.linalg.eigvals(A))[0])
        blocks.append(_scale_states(*_to_normal_form(*block)))
    total, start = np.zeros((n, n)), 0
    for part, _, _ in blocks:
        total[start : start + len(part), start : start + len(part)] = part
        start += len(part)
    return StateSpace(total, np.concatenate([b for _, b, _ in blocks]), np.concatenate([c for _, _, c in blocks]), D)


def in_parallel(parts: Sequence[StateSpace], delay: int = 0) -> StateSpace:
    """Sum of the outputs of ``parts``, all with the same input, which is late by ``delay`` samples."""
    sizes = [delay, *(len(part.B) for part in parts)]
    ends = np.cumsum(sizes)
    A, B, C = np.zeros((ends[-1], ends[-1])), np.zeros(ends[-1]), np.zeros(ends[-1])
    D = float(sum(part.D for part in parts))
    A[:delay, :delay] = np.eye(delay, k=-1)
    for part, start, end in zip(parts, ends[:-1], ends[1:], strict=True):
        A[start:end, start:end] = part.A
        C[start:end] = part.C
        if delay:
            A[start:end, delay - 1] = part.B
        else:
            B[start:end] = part.B
    if delay:
        B[0], C[delay - 1], D = 1.0, D, 0.0
    return StateSpace(A, B, C, D)


_Block = tuple[Array, Array, Array]


def _clusters(poles: Any) -> list[Any]:
    """Group the ``poles`` (n,): poles nearer than SAME_POLE, and conjugate pairs, are in the same group.

    Groups are ordered by the distance of their nearest pole from 1.
    """
    rest = list(poles[np.argsort(np.abs(poles - 1.0))])
    clusters = []
    while rest:
        group, grown = [rest.pop(0)], True
        while grown:
            near = [p for p in rest if min(min(abs(p - g), abs(p.conjugate() - g)) for g in group) < SAME_POLE]
            rest = [p for p in rest if not any(p is other for other in near)]
            group, grown = group + near, bool(near)
        clusters.append(np.array(group))
    return clusters


def _split(A: Array, B: Array, C: Array, poles: Any) -> tuple[_Block, _Block]:
    """Decouple the modes with the given ``poles`` from the model ``A``, ``B``, ``C`` by a change of its states.

    Returns (A, B, C) of the remaining model, then (A, B, C) of the block with the given poles. If rounding leaves them
    inseparable from the others, the remaining model is empty and the block is the whole.
    """
    from scipy.linalg import schur, solve_sylvester

    size = len(poles)
    empty = np.zeros(0)
    if size == len(A):
        return (np.zeros((0, 0)), empty, empty), (A, B, C)

    def is_selected(real: float, imaginary: float) -> bool:
        near = np.sort(np.abs(np.linalg.eigvals(A)[:, None] - poles).min(axis=1))
        border = 0.5 * (near[size - 1] + near[size])
        return bool(np.abs(real + 1j * imaginary - poles).min() <= border)

    T, Q, dimension = schur(A, output="real", sort=is_selected)
    size = int(dimension)
    if size in (0, len(A)):  # poles so close together that the reordering of the Schur form cannot separate them
        return (np.zeros((0, 0)), empty, empty), (A, B, C)
    X = solve_sylvester(T[:size, :size], -T[size:, size:], -T[:size, size:])
    left, right = Q[:, :size], Q[:, :size] @ X + Q[:, size:]
    to_right = Q[:, size:].T @ B
    to_left = Q[:, :size].T @ B - X @ to_right
    return (T[size:, size:], to_right, C @ right), (T[:size, :size], to_left, C @ left)


def _to_normal_form(A: Array, B: Array, C: Array) -> _Block:
    """Bring a block ``A``, ``B``, ``C`` of two states to a normal form; other blocks are returned as they are.

    A pair of complex poles a +- jb becomes ``A = [[a, b], [-b, a]]``; two poles within DOUBLE_POLE of 1 are set to
    exactly 1, with an upper triangular A.
    """
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


def _scale_states(A: Array, B: Array, C: Array) -> _Block:
    """Scale the states of a block ``A``, ``B``, ``C``: their pulse responses get the RMS of the block's output.

    A block whose response overflows or vanishes is returned as it is.
    """
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
