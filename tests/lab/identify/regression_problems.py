"""A regression of known parameters and noise, in rows and pieces."""

import numpy as np

from rrrgen.lab.estimate.tsqr import Rows

EXACT = 1e-10  # relative: condition numbers of the tests times the round-off of a double
N, JOINTS, P = 400, 3, 8
NAMES = [f"p{i}" for i in range(P)]
SIGMA = np.array([1.0, 0.3, 0.05])


def problem(seed=0, noise=SIGMA, samples=N):
    rng = np.random.default_rng(seed)
    W = rng.normal(size=(samples, JOINTS, P)) * 10.0 ** np.linspace(-2, 2, P)
    x = rng.normal(size=P)
    tau = W @ x + rng.normal(size=(samples, JOINTS)) * noise
    return rows_of(W, tau), x


def rows_of(W, tau):
    k = len(tau)
    return Rows(np.arange(k) * 0.01, W, tau, np.ones(tau.shape, bool), np.zeros(k, np.int64))


def pieces(rows, size):
    for start in range(0, len(rows.t), size):
        s = slice(start, start + size)
        yield Rows(rows.t[s], rows.W[s], rows.tau[s], rows.use[s], rows.segment[s])
