"""Recordings of an arm with and without a known payload."""

from __future__ import annotations

import numpy as np

from rrrgen.lab.data.preprocessing import Processing
from rrrgen.lab.data.recordings import Log
from samples.recordings import fourier_motion

LOGGED = Processing("logged", decimate=2)
MASS, COM, TENSOR = 2.3, np.array([0.03, -0.02, 0.09]), np.array([0.012, 0.010, 0.006, 0.001, -0.0005, 0.0008])


def recording(model, seed, carried=True, noise=0.05, friction=0.0, seconds=15.0, gains=1.0, size=0.8):
    """Torques of the arm with the payload by the compiled add_payload, which shares nothing with the estimation."""
    t = 0.01 * np.arange(round(seconds / 0.01))
    q, dq, ddq = fourier_motion(t, model.n, seed, base=1 / 7, size=size)
    xx, yy, zz, xy, xz, yz = TENSOR
    tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    beta = model.add_payload(MASS, COM, tensor) if carried else model.beta
    tau = model.inverse_dynamics(q, dq, ddq, beta) + model.friction(dq) + friction * (0.3 * np.sign(dq) + 0.2 * dq)
    tau = (tau + noise * np.random.default_rng(seed).normal(size=tau.shape)) / gains
    return Log(tuple(joint.name for joint in model.spec.joints), t, q, tau, dq=dq, ddq=ddq, period=0.01)
