"""Stability margin of the sampled control loop of the virtual robot, linearised at postures along a motion.

The arm at rest in a posture, with springs of joints and base, is sampled with its torques held (zero-order hold) and
closed through the feedback of the observer and a delay of whole samples. Friction and gravity are left out: friction
only adds damping, and the stiffness of gravity is small against the gains. A loop with one joint is robust if its
open-loop response L keeps away from -1; the distance is its modulus margin, the smallest ``|1 + L|`` over all
frequencies, which bounds the gain margin by 1/(1 - margin) and the phase margin by 2 asin(margin/2). The loops of an
arm are coupled through M(q): the gain of a joint is chosen for the inertia ``M_ii`` with all others at rest, but
torques move the lightest direction of the arm, in which the same gains act on a several times smaller inertia. The
margin of all joints together is the smallest singular value of ``I + L(z)``, at every frequency in coordinates scaled
by the square roots of the magnitudes of the controllers: there L of an arm whose controllers shift the phase alike is a
normal matrix, and the margin is that of its worst direction.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from rrrgen.base.arrays import Array
from rrrgen.emit.controller.state_space import StateSpace
from rrrgen.lab.estimate.statistics import rms
from rrrgen.lab.plant.elastic_modes import linear_model
from rrrgen.lab.plant.plant import FlexibleBase, FlexibleJoints

GRID = 160
"""Number of frequencies, evenly spaced in their logarithm up to half the sampling rate: 5 % apart over 3.5 decades."""

OCTAVES_BELOW = 4.0
"""How far below the slowest loop the grid begins: lower, the integrators of the arm make |L| large."""


@dataclass(frozen=True)
class LoopMargin:
    """How far the sampled loop is from instability, at the worst of the postures.

    ``modulus`` is the modulus margin, 0 at the edge of stability and negative where the loop is ``unstable``;
    ``frequency`` (Hz) is where it is smallest, or that of the fastest growing oscillation. ``radius`` is the largest
    magnitude of a closed-loop pole, ``posture`` the index of the worst posture.
    """

    modulus: float
    frequency: float
    radius: float
    posture: int

    @property
    def unstable(self) -> bool:
        """Whether an oscillation grows in some posture."""
        return self.radius >= 1.0


@dataclass(frozen=True, eq=False)
class SampledArm:
    """The arm at m postures, sampled with ``period`` (s), with its torques ``delay`` samples after the readings.

    Per posture ``x(k+1) = A x(k) + B u(k)`` and readings ``C x``: ``A`` (m, s, s), ``B`` (m, s, n), ``C`` (n, s). The
    input u is the torque of PD control, or the acceleration that computed torque asks for. ``slowest`` (Hz) is the
    frequency below which responses are not looked at.
    """

    period: float
    delay: int
    A: Array
    B: Array
    C: Array
    slowest: float

    @classmethod
    def at(
        cls,
        masses: Array,
        joints: FlexibleJoints | None,
        base: FlexibleBase | None,
        period: float,
        *,
        delay: int = 0,
        assumed: Array | None = None,
        slowest: float,
    ) -> SampledArm:
        """Sample the arm with the mass matrices ``masses`` (m, n, n) of its links, kg m^2, at m postures.

        ``assumed`` (m, n, n) is the mass matrix by which computed torque multiplies its input, None for PD control.
        ``slowest`` (Hz) is the natural frequency of the slowest loop. Without flexible ``joints``, ``masses`` hold the
        drives too.
        """
        from scipy.linalg import expm

        models = [linear_model(mass, joints, base) for mass in masses]
        A, B = np.array([model[0] for model in models]), np.array([model[1] for model in models])
        if assumed is not None:
            B = B @ assumed
        m, s, n = B.shape
        held = np.zeros((m, s + n, s + n))  # exp of [[A, B], [0, 0]] Ts holds A and B of the sampled arm
        held[:, :s, :s], held[:, :s, s:] = A * period, B * period
        sampled = expm(held)
        return cls(period, delay, sampled[:, :s, :s], sampled[:, :s, s:], models[0][2], slowest / 2.0**OCTAVES_BELOW)

    @cached_property
    def frequencies(self) -> Array:
        """The frequencies (m, F), Hz, of the responses: an even grid, and the vibrations of every posture.

        A sharp resonance between two points of the grid would be missed, so its frequency is a point of its own.
        """
        grid = np.geomspace(min(self.slowest, 0.05 / self.period), 0.5 / self.period, GRID)
        poles = np.log(np.linalg.eigvals(self.A).astype(complex)) / self.period
        sharp = np.where(np.abs(poles.imag) > 1.0, np.abs(poles.imag) / (2.0 * np.pi), grid[0])
        beside = np.concatenate([sharp, 0.97 * sharp, 1.03 * sharp], axis=1)
        rows = [np.concatenate([grid, row]) for row in np.clip(beside, grid[0], grid[-1])]
        if not np.any(np.abs(poles.imag) > 1.0):
            rows = [grid] * len(self.A)
        return np.array(rows)

    @cached_property
    def response(self) -> Array:
        """Frequency response (m, F, n, n) from the input to the readings, the delay included."""
        s, n = self.B.shape[1:]
        z = np.exp(2j * np.pi * self.frequencies * self.period)
        inner = z[:, :, None, None] * np.eye(s) - self.A[:, None]
        states = np.linalg.solve(inner, np.broadcast_to(self.B[:, None], (*z.shape, s, n)).astype(complex))
        return np.asarray(self.C @ states * (z**-self.delay)[:, :, None, None])

    def meets(self, aim: float, feedback: Sequence[StateSpace]) -> bool:
        """Whether the loop is stable with a modulus margin of at least ``aim``, in all postures."""
        if self._distance(feedback).min() < aim:
            return False
        return bool(np.abs(np.linalg.eigvals(self.closed_loop_matrices(feedback))).max() < 1.0)

    def margin(self, feedback: Sequence[StateSpace]) -> LoopMargin:
        """Margin of the loop closed by ``u_i = -feedback_i(e_i)``, the worst of the postures."""
        distance = self._distance(feedback)
        poles = np.linalg.eigvals(self.closed_loop_matrices(feedback))
        radii = np.abs(poles).max(axis=1)
        if radii.max() >= 1.0:
            posture = int(radii.argmax())
            growing = poles[posture][np.abs(poles[posture]).argmax()]
            frequency = abs(float(np.angle(growing))) / (2.0 * np.pi * self.period)
            return LoopMargin(-float(distance[posture].min()), frequency, float(radii.max()), posture)
        posture, place = divmod(int(distance.argmin()), distance.shape[1])
        return LoopMargin(float(distance.min()), float(self.frequencies[posture, place]), float(radii.max()), posture)

    def _distance(self, feedback: Sequence[StateSpace]) -> Array:
        """Smallest singular values (m, F) of ``I + L``."""
        z = np.exp(2j * np.pi * self.frequencies * self.period)
        gains = np.stack([_response(system, z) for system in feedback], axis=-1)
        scale = np.sqrt(np.maximum(np.abs(gains), np.finfo(float).tiny))
        L = (gains / scale)[..., :, None] * self.response * scale[..., None, :]
        return np.asarray(np.linalg.svd(np.eye(len(feedback)) + L, compute_uv=False)[..., -1])

    def closed_loop_matrices(self, feedback: Sequence[StateSpace]) -> Array:
        """State matrices (m, S, S) of the closed loop: arm, feedback of every joint, torques on their way."""
        from scipy.linalg import block_diag

        m, s, n = self.B.shape
        Ac = block_diag(*[system.A for system in feedback])
        Bc = block_diag(*[system.B[:, None] for system in feedback])
        Cc = block_diag(*[system.C[None] for system in feedback])
        Dc = np.diag([system.D for system in feedback])
        c, d = len(Ac), self.delay
        A: Any = np.zeros((m, s + c + d * n, s + c + d * n))
        torque = np.hstack([-Dc @ self.C, -Cc, np.zeros((n, d * n))])  # of this sample
        A[:, :s, :s] = self.A
        A[:, s : s + c, :s], A[:, s : s + c, s : s + c] = Bc @ self.C, Ac
        if d == 0:
            A[:, :s] += self.B @ torque
            return np.asarray(A)
        A[:, :s, -n:] += self.B  # the oldest torque acts
        A[:, s + c : s + c + n] = torque
        for k in range(1, d):
            A[:, s + c + k * n : s + c + (k + 1) * n, s + c + (k - 1) * n : s + c + k * n] = np.eye(n)
        return np.asarray(A)


def _response(system: StateSpace, z: Array) -> Array:
    """Frequency response of a sampled model at the points ``z``, of the same shape."""
    size = len(system.B)
    states = np.linalg.solve(z[..., None, None] * np.eye(size) - system.A, system.B[:, None].astype(complex))
    return np.asarray((system.C @ states)[..., 0] + system.D)


def torque_noise(system: StateSpace) -> float:
    """Standard deviation of the output of a sampled model for white readings of variance 1: torque per encoder noise.

    It is the square root of the mean squared magnitude of the frequency response.
    """
    z = np.exp(2j * np.pi * (np.arange(512) + 0.5) / 1024.0)
    return float(rms(np.abs(_response(system, z))))
