"""A joint that swings on its spring, recorded."""

import numpy as np


def simulated(a, b, delay, u):
    y = np.zeros(len(u))
    for k in range(len(u)):
        y[k] = sum(c * y[k - i] for i, c in enumerate(a, 1) if k >= i)
        y[k] += sum(c * u[k - delay - j] for j, c in enumerate(b) if k >= delay + j)
    return y
