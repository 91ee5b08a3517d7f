"""Many arms at once under computed torque, with the errors of a real controller, to be touched or left alone."""

from __future__ import annotations

import numpy as np

from rrrgen.lab.contact import changes
from rrrgen.lab.data.kalman import kalman_matrices, kalman_step

Ts = 1e-3
RESOLUTION = 1e-5
WIDTH = 0.05
FRICTION = (2.0, 3.0, 0.0) * 3  # of the RRR: viscous, coulomb, offset of each joint


class Arms:
    """``count`` copies of an arm on random motions: 1 kHz, a tick of delay, encoder of 1e-5 rad, smooth friction.

    The controller knows parameters to 2 % and friction to 5 %, wrong in the same way for all arms of one number
    ``errors``; ``seed`` chooses the motions. ``pole`` is the bandwidth of the loop, in rad/s.
    """

    def __init__(
        self, model, count, friction, amplitude=0.4, gain=50.0, jerk=300.0, pole=20.0, seed=0, q0=None, errors=0
    ):
        rng = np.random.default_rng([7, errors])
        n = model.n
        self.model, self.n, self.count, self.gain, self.pole = model, n, count, gain, pole
        self.friction = np.array(friction)
        self.believed = self.friction * (1 + 0.05 * rng.choice([-1, 1], len(self.friction)))
        self.beta = model.beta * (1 + 0.02 * rng.uniform(-1, 1, len(model.beta)))
        rng = np.random.default_rng(seed)
        self.centre = np.zeros(n) if q0 is None else np.asarray(q0)
        self.amplitude = amplitude * rng.uniform(0.3, 1, (count, n))
        self.omega, self.phase = rng.uniform(1, 3, (count, n)), rng.uniform(0, 2 * np.pi, (count, n))
        self.matrices = kalman_matrices(Ts, RESOLUTION**2 / 12, jerk**2)

    def desired(self, t):
        a, w, angle = self.amplitude, self.omega, self.omega * t + self.phase
        return self.centre + a * np.sin(angle), a * w * np.cos(angle), -a * w * w * np.sin(angle)

    def acceleration(self, q, dq, tau, step):
        """Mean acceleration over a ``step``, with friction linearised: it changes within less for a light wrist."""
        viscous, coulomb = self.friction[::3], self.friction[1::3]
        slope = viscous + coulomb / WIDTH / np.cosh(dq / WIDTH) ** 2
        M = self.model.mass_matrix(q) + step * np.einsum("ki,ij->kij", slope, np.eye(self.n))
        friction = self.model.smooth_friction(dq, friction=self.friction, width=WIDTH)
        return np.linalg.solve(M, (tau - friction - self.model.bias(q, dq))[..., None])[..., 0]

    def run(self, seconds, force=None, at=np.inf):
        """Residuals (N, count, n) of the observer in the loop; ``force`` (count, 3) acts on the tips from ``at`` on."""
        m, n = self.model, self.n
        q, dq, _ = self.desired(0.0)
        self.readings, self.torques, self.seen, self.truth = [], [], [], []
        state = np.zeros((self.count, n, 3))
        tau, r, last, out = np.zeros((self.count, n)), np.zeros((self.count, n)), None, []
        options = {"friction": self.believed, "width": WIDTH}
        for k in range(round(seconds / Ts)):
            wanted = self.desired(k * Ts)
            reading = np.round(q / RESOLUTION) * RESOLUTION
            state, seen = kalman_step(self.matrices.E, self.matrices.k, state, reading, np.stack(wanted, -1))
            p, ct, g = m.momentum_terms(seen[..., 0], seen[..., 1], self.beta)
            u = ct - g - m.smooth_friction(seen[..., 1], **options)
            if last is not None:
                alpha = np.exp(-self.gain * Ts)
                r = alpha * r + (1 - alpha) * ((p - last[0]) / Ts - self.torques[-1] - 0.5 * (u + last[1]))
            last = (p, u)
            out.append(r)
            self.readings.append(reading)
            self.seen.append(seen)
            self.truth.append(np.stack([q, dq], -1))
            e, de = wanted[0] - seen[..., 0], wanted[1] - seen[..., 1]
            ddq = wanted[2] + self.pole**2 * e + 2 * self.pole * de
            command = m.inverse_dynamics(seen[..., 0], seen[..., 1], ddq, self.beta) + m.smooth_friction(
                wanted[1], **options
            )
            pushed = 0.0
            if k * Ts >= at:
                pushed = np.einsum("kij,ki->kj", m.jacobian(q)[:, :3], force)
            for _ in range(2):
                dq = dq + Ts / 2 * self.acceleration(q, dq, tau + pushed, Ts / 2)
                q = q + Ts / 2 * dq
            self.torques.append(tau)  # applied from this reading to the next
            tau = command
        return np.array(out)


def forces(count, size=10.0):
    """Forces (count, 3) of one ``size``, N, in random directions."""
    F = np.random.default_rng(3).normal(size=(count, 3))
    return size * F / np.linalg.norm(F, axis=1, keepdims=True)


def ratios(r, found, gain=50.0):
    """Largest ratio of residuals ``r`` (N, count, n), or of their changes, to the thresholds ``found``, (N, count)."""
    slow, fast = np.abs(r) / np.array(found.levels), np.abs(changes(r, Ts, gain)) / np.array(found.change_levels)
    return np.maximum(slow, fast).max(axis=2)


def visibility(poses, forces, found, responses, ticks=15, gain=50.0):
    """How far each force would exceed a threshold within ``ticks`` if the residuals were zero before, (N,).

    ``poses`` (N, 6, n) are Jacobians of the tip, ``forces`` (N, 3), ``responses`` (K, n) of residuals to a step.
    """
    torques = np.einsum("kij,ki->kj", poses[:, :3], forces)
    before = np.zeros((1, *torques.shape))
    return ratios(np.concatenate([before, responses[: ticks + 1, None] * torques]), found, gain).max(axis=0)
