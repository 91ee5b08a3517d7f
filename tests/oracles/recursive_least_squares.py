"""Recursive estimation in its information form: another algebra than the package, from the definitions alone."""

from __future__ import annotations

import numpy as np


class InformationFilter:
    """Least squares with directional forgetting on ``J = inv(P)``, one row after the other.

    A row r of noise 1 brings the information r r'. In its direction J holds ``i = 1/(r' inv(J) r)``; forgetting takes
    away the share 1 - forgetting of it, ``(1 - forgetting) i r r'``, but never more than the row brings.
    """

    def __init__(self, start, spread, noise, forgetting: float) -> None:
        self.p = np.array(start, dtype=float)
        self.J = np.diag(1.0 / np.square(np.asarray(spread, dtype=float)))
        self.noise, self.forgetting = np.asarray(noise, dtype=float), forgetting

    def update(self, Y, y, use) -> None:
        W = np.linalg.inv(np.linalg.cholesky(self.noise[np.ix_(use, use)]))
        for r, target in zip(W @ Y[use], W @ y[use], strict=True):
            present = 1.0 / (r @ np.linalg.solve(self.J, r))
            self.J = self.J + (1.0 - min((1.0 - self.forgetting) * present, 1.0)) * np.outer(r, r)
            self.p = self.p + np.linalg.solve(self.J, r) * (target - r @ self.p)


def batch_estimate(Y, y, start, spread, noise):
    """Least squares over all rows at once, the start as an observation: (N, n, p), (N, n) -> p."""
    W = np.linalg.inv(np.linalg.cholesky(np.asarray(noise, dtype=float)))
    rows = (W @ Y).reshape(-1, Y.shape[-1])
    targets = (y @ W.T).ravel()
    prior = np.diag(1.0 / np.asarray(spread, dtype=float))
    A = np.vstack([rows, prior])
    b = np.concatenate([targets, prior @ np.asarray(start, dtype=float)])
    return np.linalg.lstsq(A, b, rcond=None)[0]


def gradient_step(Y, y, p, gain, use):
    """``p - gain Y'(Y p - y)`` over the joints in use; at the bound of the parameter error the best gain instead."""
    e = (Y @ p - y)[use]
    r = Y[use].T @ e
    if gain * (r @ r) > 2.0 * (e @ e):
        gain = (e @ e) / (r @ r)
    return p - gain * r
