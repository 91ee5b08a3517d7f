"""ARMAX models ``A y = B u + C e``: difference equations with coloured noise, e being white."""

from __future__ import annotations

import numpy as np

from rrrgen.base.arrays import Array
from rrrgen.lab.response.equations import Equation

REFINEMENTS = 20
LARGEST = 1e100  # bound on the outputs of an unstable model, so that their squares stay finite
LONG_ORDER = 2  # order of the ARX model whose residuals are the first estimate of e, as a multiple of the model's order


def armax(start_from: Equation, u: Array, y: Array, start: int, stop: int) -> Equation:
    """Fit an ARMAX model ``A y = B u + C e`` that minimizes the one-step prediction errors e on samples [start, stop).

    ``u`` and ``y`` (N,) are input and output, ``start_from`` gives orders and first estimate; C has the order of A.
    Begins with least squares on estimated e (Hannan-Rissanen) and refines by Levenberg-Marquardt steps: the derivatives
    of e are past outputs, inputs and errors filtered by 1/C. Zeros of C outside the unit circle are reflected. The
    returned equation holds A and B.
    """
    order, size, delay = len(start_from.a), len(start_from.b), start_from.delay
    part_y, part_u = y[start:stop], u[start:stop]
    theta = _begin(start_from, part_u, part_y)
    e = _errors(theta, order, size, delay, part_u, part_y)
    cost, damping = _cost(e), 1e-3
    for _ in range(REFINEMENTS):
        J = _derivatives(theta, order, size, delay, part_u, part_y, e)
        if not float(np.abs(J).max()) < LARGEST:
            break
        information = J.T @ J
        step = np.linalg.lstsq(information + damping * np.diag(np.diag(information)), -J.T @ e, rcond=None)[0]
        trial = theta + step
        trial[order + size :] = _inside(trial[order + size :])
        e_new = _errors(trial, order, size, delay, part_u, part_y)
        if _cost(e_new) < cost:
            done = cost - _cost(e_new) < 1e-7 * cost
            theta, e, cost, damping = trial, e_new, _cost(e_new), damping / 5.0
            if done:
                break
        else:
            damping *= 10.0
    return Equation(theta[:order], theta[order : order + size], delay)


def _cost(e: Array) -> float:
    found = float(e @ e)
    return found if np.isfinite(found) else np.inf


def _columns(order: int, size: int, delay: int, u: Array, y: Array) -> Array:
    """The matrix (N, order + size) of past outputs and inputs, with zeros for times before the first row."""
    shifts = [(y, i) for i in range(1, order + 1)] + [(u, delay + j) for j in range(size)]
    columns = np.zeros((len(y), len(shifts)))
    for column, (signal, shift) in zip(columns.T, shifts, strict=True):
        column[shift:] = signal[: len(y) - shift]
    return columns


def _begin(start_from: Equation, u: Array, y: Array) -> Array:
    order, size, delay = len(start_from.a), len(start_from.b), start_from.delay
    many = LONG_ORDER * order + 1
    F = _columns(many, many, delay, u, y)
    if len(y) <= 3 * F.shape[1]:
        return np.concatenate([start_from.a, start_from.b, np.zeros(order)])
    e = y - F @ np.linalg.lstsq(F, y, rcond=1e-12)[0]
    G = np.column_stack([_columns(order, size, delay, u, y), _columns(order, 0, 0, e, e)])
    theta = np.linalg.lstsq(G[many:], y[many:], rcond=1e-12)[0]
    theta[order + size :] = _inside(theta[order + size :])
    return np.asarray(theta)


def _inside(c: Array) -> Array:
    """Reflect the zeros of ``1 + sum c_l z^-l`` that lie outside the unit circle into it; returns the new ``c``."""
    roots = np.roots(np.concatenate([[1.0], c]))
    sizes = np.abs(roots)
    outside = sizes > 0.999
    if not np.any(outside):
        return c
    inner = np.minimum(1.0 / np.maximum(sizes, 1.0), 0.999)
    reflected = np.where(outside, roots / np.maximum(sizes, 1e-12) * inner, roots)
    found = np.real(np.poly(reflected))[1:]
    return np.concatenate([found, np.zeros(len(c) - len(found))])


def _errors(theta: Array, order: int, size: int, delay: int, u: Array, y: Array) -> Array:
    from scipy.signal import lfilter

    rest = y - _columns(order, size, delay, u, y) @ theta[: order + size]
    rest[: max(order, delay + size - 1)] = 0.0  # rows that need values from before the first row
    with np.errstate(over="ignore", invalid="ignore"):
        return np.asarray(lfilter([1.0], np.concatenate([[1.0], theta[order + size :]]), rest))


def _derivatives(theta: Array, order: int, size: int, delay: int, u: Array, y: Array, e: Array) -> Array:
    """Derivatives of the one-step errors (N,) by theta = [a, b, c], one column each."""
    from scipy.signal import lfilter

    columns = np.column_stack([_columns(order, size, delay, u, y), _columns(order, 0, 0, e, e)])
    columns[: max(order, delay + size - 1)] = 0.0
    with np.errstate(over="ignore", invalid="ignore"):
        return np.asarray(-lfilter([1.0], np.concatenate([[1.0], theta[order + size :]]), columns, axis=0))
