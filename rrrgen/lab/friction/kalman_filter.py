"""Extended Kalman filter for position, speed, inertia, gravity and friction parameters of one joint.

The state is ``x = [q, v, p]`` with constant parameters p, some as logarithms; the acceleration is that of (14.15), in
Kostic, de Jager, Steinbuch, Robotics and Automation Handbook, CRC Press 2005, chapter 14. sgn(v) is smoothed to tanh
and the integration step is linearly implicit. Where friction jumps, the model of one sample is wrong by up to the
break-away torque: process noise on the speed accounts for it there and keeps the estimates unbiased.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from rrrgen.base.arrays import Array
from rrrgen.lab.friction.candidate_laws import Candidate
from rrrgen.lab.friction.joint_recording import JointData
from rrrgen.lab.friction.multiple_shooting import Torque

WIDTH = 3e-3  # width w of tanh(v/w) in place of sgn(v), relative to the rms speed
SLIDING_NOISE = 0.05  # standard deviation of unmodelled torque relative to the friction torque, in sliding
REVERSAL_NOISE = 1.6  # the same near rest and at changes of direction
SLOW = 0.03  # times the rms speed: slower motion counts as near rest
START_SPEED = 0.1  # standard deviation of the initial speed relative to the rms speed: the low-pass is poor there
PRIOR = 0.2  # relative standard deviation of the initial parameters
SURPRISE = 4.0  # standard deviations at which an innovation is clipped
LARGEST_LOGARITHM = 50.0
DIFFERENCE = 1e-6
FAR = 1.0  # rad (m) between prediction and measurement beyond which the filter has diverged
DIVERGED = 0.7  # change of the logarithm of the inertia beyond which the filter has diverged
REPORT = 2000  # samples between two calls of ``tell``


class _Smoothed:
    """Operations of a friction law on floats, with sgn(x) replaced by a given number ``direction``."""

    exp, tanh = staticmethod(math.exp), staticmethod(math.tanh)

    def __init__(self, direction: float) -> None:
        self.direction = direction

    def sign(self, x: float) -> float:
        return self.direction


def kalman_estimates(
    laws: Sequence[Candidate],
    starts: Sequence[Array],
    data: JointData,
    tell: Callable[[int, int], None] | None = None,
) -> list[Array]:
    """Estimate the parameters (k,) of several laws without a state by one pass of an extended Kalman filter each.

    ``starts`` are the initial parameters (k,) of each law; a law whose filter diverges keeps them. The filters run over
    the recording ``data`` together. ``tell(done, total)`` is called with the number of samples processed.
    """
    run = _Filters(laws, starts, data)
    total = sum(last - first for first, last in data.stretches)
    done = 0
    for first, last in data.stretches:
        run.begin(first)
        own = Torque(data.u[first:last], np.arange(last - first), 1)
        torque = np.stack([own.held(0, np.array([[theta[-1]]]))[0] for theta in starts], axis=1)
        for k in range(last - first - 1):
            run.step(torque[k], data.q[first + k + 1])
            done += 1
            if tell is not None and done % REPORT == 0:
                tell(done, total)
    return run.results()


class _Filters:
    """The Kalman filters of L laws, run together: states x (L, n) and covariances P (L, n, n).

    The states ``[q, v, parameters]`` are padded with zeros to the same length n.
    """

    def __init__(self, laws: Sequence[Candidate], starts: Sequence[Array], data: JointData) -> None:
        self.laws, self.starts, self.data = laws, starts, data
        self.logarithmic = [np.flatnonzero(law.is_logarithmic).tolist() for law in laws]
        self.k = [len(theta) - 1 for theta in starts]  # the delay is not a state
        n = 2 + max(self.k)
        self.x, self.P = np.zeros((len(laws), n)), np.zeros((len(laws), n, n))
        self.level = np.zeros(len(laws))
        for row, (law, theta, k) in enumerate(zip(laws, starts, self.k, strict=True)):
            free = law.to_free(theta)[:k]
            self.x[row, 2 : 2 + k] = free
            self.level[row] = float(np.mean(np.abs(law.torque(np.array([0.5, -0.5]) * data.speed, theta))))
            size = np.maximum(np.abs(theta[:k]), 0.25 * self.level[row])
            spread = PRIOR * np.where(law.is_logarithmic[:k], 1.0, size)
            self.P[row, 2 : 2 + k, 2 : 2 + k] = np.diag(spread**2)
        self.first, self.lost = self.x.copy(), np.zeros(len(laws), bool)
        self.noise = max(data.resolution**2 / 12.0, 1e-24)
        self.width, self.slow = WIDTH * data.speed, SLOW * data.speed

    def begin(self, sample: int) -> None:
        """Reset position and speed at the first ``sample`` of an uninterrupted stretch; the parameters are kept."""
        self.x[:, 0], self.x[:, 1] = (part[sample] for part in self.data.motion[:2])
        self.P[:, :2], self.P[:, :, :2] = 0.0, 0.0
        self.P[:, 0, 0], self.P[:, 1, 1] = self.noise, (START_SPEED * self.data.speed) ** 2

    def step(self, u: Array, measured: float) -> None:
        """Predict one period ahead under the torques ``u`` (L,), then correct by the next ``measured`` position.

        The torques differ between laws because each has its own delay.
        """
        T, x, P = self.data.period, self.x, self.P
        a, a_q, a_v, a_p, inertia = self._accelerations(u)
        v = x[:, 1].copy()
        implicit = 1.0 / (1.0 - T * np.minimum(a_v, 0.0))
        dv = T * a * implicit
        row = np.zeros_like(x)  # derivative of the next speed by the state
        row[:, 0], row[:, 1] = T * a_q * implicit, 1.0 + T * a_v * implicit
        row[:, 2:] = T * a_p * implicit[:, None]
        first = 0.5 * T * row
        first[:, 0] += 1.0
        first[:, 1] += 0.5 * T
        x[:, 0] += T * (v + 0.5 * dv)
        x[:, 1] = v + dv
        F = np.stack([first, row], axis=1)  # (L, 2, n)
        FP = F @ P
        corner = FP @ F.transpose(0, 2, 1)
        P[:, :2, :] = FP
        P[:, :, :2] = FP.transpose(0, 2, 1)
        P[:, :2, :2] = corner
        uncertain = (np.abs(v) < self.slow) | (v * x[:, 1] <= 0.0)
        P[:, 1, 1] += (T * self.level * np.where(uncertain, REVERSAL_NOISE, SLIDING_NOISE) / inertia) ** 2
        variance = P[:, 0, 0] + self.noise
        gain = P[:, :, 0] / variance[:, None]
        limit = SURPRISE * np.sqrt(np.maximum(variance, self.noise))
        x += gain * np.minimum(np.maximum(measured - x[:, 0], -limit), limit)[:, None]
        P -= gain[:, :, None] * P[:, None, 0, :]
        lost = ~np.isfinite(x).all(axis=1) | ~(np.abs(x[:, 0] - measured) < FAR)
        if lost.any():
            self.lost |= lost
            x[lost], P[lost] = self.first[lost], 0.0
            x[lost, 0] = measured

    def _accelerations(self, u: Array) -> tuple[Array, Array, Array, Array, Array]:
        """Acceleration (L,), its derivatives by q (L,), v (L,) and the parameters (L, n - 2), and the inertia (L,).

        ``u`` (L,) are the torques. Computed with Python floats, which are faster here than short arrays.
        """
        L, n = self.x.shape
        a, a_q, a_v, a_p, inertia = np.empty(L), np.empty(L), np.empty(L), np.zeros((L, n - 2)), np.empty(L)
        for i, (law, k, torque) in enumerate(zip(self.laws, self.k, u.tolist(), strict=True)):
            q, v, *theta = self.x[i, : 2 + k].tolist()
            for j in self.logarithmic[i]:
                theta[j] = math.exp(min(theta[j], LARGEST_LOGARITHM))
            J, first = theta[0], 1 + law.gravity
            net, by_q = torque, 0.0
            if law.gravity >= 2:
                c, s = math.cos(q), math.sin(q)
                net -= theta[1] * c + theta[2] * s
                by_q = theta[1] * s - theta[2] * c
                a_p[i, 1], a_p[i, 2] = -c / J, -s / J
                if law.gravity == 3:
                    net -= theta[3]
                    a_p[i, 3] = -1.0 / J
            elif law.gravity:
                net -= theta[1]
                a_p[i, 1] = -1.0 / J
            values = theta[first:] + [0.0] * len(law.left_out)
            ops = _Smoothed(math.tanh(v / self.width))
            friction = law.law.torque(ops, v, values)
            by_v = DIFFERENCE * self.width
            ahead = law.law.torque(_Smoothed(math.tanh((v + by_v) / self.width)), v + by_v, values)
            for j in range(first, k):
                was = values[j - first]
                step = DIFFERENCE * max(abs(was), DIFFERENCE)
                values[j - first] = was + step
                a_p[i, j] = (friction - law.law.torque(ops, v, values)) / step / J
                values[j - first] = was
            a[i], inertia[i] = (net - friction) / J, J
            a_q[i], a_v[i] = by_q / J, (friction - ahead) / by_v / J
            a_p[i, 0] = -a[i] / J
            for j in self.logarithmic[i]:
                a_p[i, j] *= theta[j]
        return a, a_q, a_v, a_p, inertia

    def results(self) -> list[Array]:
        """Estimated parameters (k,) of each law; the initial ones for a filter that diverged."""
        found = []
        for i, (law, start) in enumerate(zip(self.laws, self.starts, strict=True)):
            theta = np.append(law.from_free(self.x[i, 2 : 1 + len(start)]), start[-1])
            kept = not self.lost[i] and abs(math.log(theta[0] / start[0])) < DIVERGED
            found.append(law.clipped(theta) if kept else start)
        return found
