"""A joint with flexible modes in a sampled loop with exact discrete truth."""

from dataclasses import dataclass

import numpy as np

from rrrgen.lab.response.response_file import ResponseRecording
from rrrgen.lab.response.response_model import ControllerTransferFunction

PERIOD = 1e-3
MODES = ((28.0, 0.02, 0.3), (96.0, 0.02, 0.5))  # Hz, damping, residue


@dataclass(frozen=True)
class FlexibleJoint:
    """``z^-1 ZOH{1/s^2 + sum g/(s^2 + 2 zeta w s + w^2)}``: zero-order hold and one sample of delay."""

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray

    def response(self, frequency):
        z = np.exp(2j * np.pi * np.asarray(frequency) * PERIOD)
        return np.array([self.C @ np.linalg.solve(w * np.eye(len(self.A)) - self.A, self.B) / w for w in z])


def flexible_joint(modes=MODES):
    from scipy.signal import cont2discrete

    n = 2 + 2 * len(modes)
    A, B, C = np.zeros((n, n)), np.zeros((n, 1)), np.zeros((1, n))
    A[0, 1] = B[1, 0] = C[0, 0] = 1.0
    for i, (frequency, damping, residue) in enumerate(modes, start=1):
        w = 2 * np.pi * frequency
        A[2 * i : 2 * i + 2, 2 * i : 2 * i + 2] = [[0.0, 1.0], [-w * w, -2 * damping * w]]
        B[2 * i + 1, 0], C[0, 2 * i] = 1.0, residue
    A, B, C, _, _ = cont2discrete((A, B, C, np.zeros((1, 1))), PERIOD)
    return FlexibleJoint(A, B[:, 0], C[0])


def multisine(rng, samples, rms=7.0, step=0.5, band=(0.5, 200.0), odd=False):
    """Random phases at every (odd) multiple of ``step`` Hz in the band."""
    length = round(1 / (step * PERIOD))
    k = np.arange(round(band[0] / step), round(band[1] / step) + 1)
    X = np.zeros(length // 2 + 1, complex)
    k = k[k % 2 == 1] if odd else k
    X[k] = np.exp(2j * np.pi * rng.random(len(k)))
    x = np.fft.irfft(X, length)
    return np.tile(rms / x.std() * x, samples // length + 1)[:samples]


KP, KD = (2 * np.pi) ** 2, 4 * np.pi  # 1 Hz
CONTROLLER = ControllerTransferFunction((KP + KD / PERIOD, -KD / PERIOD))


def record(
    rng,
    n,
    joint=None,
    speed=0.51237,
    resolution=1e-5,
    disturbance=0.1,
    friction=0.0,
    turn_after=None,
    limit=None,
    name="run",
):
    """The loop ``u = n - kp e - kd (e - e_1)/T`` of a joint; e = rounded position - reference.

    The reference has a constant speed, whose sign changes every ``turn_after`` s where that is given. Friction is
    compensated at the reference's first direction. Where a limit is given, no more of the recorded input acts.
    """
    joint = joint or flexible_joint()
    A, B, C = joint.A, joint.B, joint.C
    d = disturbance * rng.standard_normal(len(n))
    x = np.zeros(len(A))
    x[1], u_1, e_1 = speed, 0.0, 0.0
    q, u = np.empty(len(n)), np.empty(len(n))
    reference = speed * PERIOD * np.arange(len(n))
    if turn_after:
        reference = speed * np.abs((PERIOD * np.arange(len(n)) + turn_after) % (2 * turn_after) - turn_after)
    for i in range(len(n)):
        y = float(C @ x)
        q[i] = resolution * round(y / resolution) if resolution else y
        e = q[i] - reference[i]
        u[i] = n[i] - KP * e - KD / PERIOD * (e - e_1)
        x = A @ x + B * (u_1 + d[i] - friction * (np.sign(x[1]) - np.sign(speed)))
        u_1, e_1 = u[i] if limit is None else min(max(u[i], -limit), limit), e
    return ResponseRecording(name, PERIOD, np.asarray(n), u, q)
