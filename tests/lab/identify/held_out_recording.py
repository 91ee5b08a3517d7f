"""A recording of a planar arm with noise of known size, and a fault at its end."""

from __future__ import annotations

import numpy as np

from rrrgen.lab.data.preprocessing import Processing
from rrrgen.lab.data.recordings import Log
from rrrgen.lab.identify.parameters import DriveTerms
from rrrgen.lab.identify.regressor import FullRegressor
from samples.recordings import fourier_motion

TERMS = DriveTerms.everywhere(2, "viscous", "coulomb")
LOGGED = Processing("logged", decimate=1)
NOISE = np.array([0.4, 0.1])


def recording(arm, seed=0, samples=1500, wrong=0.0):
    t = 0.01 * np.arange(samples)
    q, dq, ddq = fourier_motion(t, 2, 5, base=1 / 5)
    tau = FullRegressor(arm, TERMS)(q, dq, ddq) @ np.concatenate([arm.beta, [0.8, 0.4, 1.5, 0.6]])
    tau = tau + NOISE * np.random.default_rng(seed).normal(size=tau.shape)
    tau[:, 1] += wrong * (t > 12.0)
    return Log(("q1", "q2"), t, q, tau, dq=dq, ddq=ddq, period=0.01)
