"""Closed-loop output error: parameters whose simulated loop computes the recorded torques.

``min sum_j w_j |tau_j - tau_j(x)|^2`` over the identifiable parameters x and the logarithms of the friction shapes, by
Levenberg-Marquardt with sensitivities from differences; tau(x) is simulated along the recorded reference, so that noise
in the measured motion enters nowhere but in the torques. In closed loop an error of the position appears in the torque,
weighted by the controller.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from rrrgen.arrays import Array
from rrrgen.closed_loop.loop import CompiledLoop, Run
from rrrgen.closed_loop.loop_recording import LoopRecording
from rrrgen.errors import DerivationError

ITERATIONS = 25
BLOCK = 1.0  # s of samples whose errors count as dependent
SETTLED = 1e-4  # of a standard deviation-like step: relative fall of the cost at which the search ends
RELATIVE_STEP = 1e-3  # of a parameter, for differences
STD_STEP = 0.1  # of its standard deviation
SHAPE_STEP = 1e-2  # of the logarithm of a shape
LARGEST_LOG_STEP = 0.7  # of a logarithm in one iteration
RETRIES = 3  # with a step a tenth as large, where the loop diverges beside the estimate

Tell = Callable[[int, int, str], None]


class FreeParameters(Protocol):
    """Interface of the parameters that are fitted: free ones z (k,), which may be logarithms."""

    def theta(self, z: Array) -> Array:
        """The parameters of the simulation."""
        ...

    def steps(self, z: Array) -> Array:
        """Differences (k,) at which the sensitivities are taken."""
        ...

    def logarithms(self, z: Array) -> NDArray[np.bool_]:
        """Which free parameters (k,) are logarithms."""
        ...


@dataclass(frozen=True, eq=False)
class Parameters:
    """The map from free parameters z to those of the simulation: ``theta = [T x + known; exp(logs)]``, z = [x; logs].

    ``spread`` (r,) are standard deviations of x before the fit, which scale the differences.
    """

    T: Array
    known: Array
    spread: Array

    @property
    def count(self) -> int:
        """Number r of parameters x."""
        return int(self.T.shape[1])

    def logarithms(self, z: Array) -> NDArray[np.bool_]:
        """Which free parameters are logarithms."""
        return np.arange(len(z)) >= self.count

    def theta(self, z: Array) -> Array:
        """The parameters of the simulation."""
        return np.concatenate([self.T @ z[: self.count] + self.known, np.exp(z[self.count :])])

    def steps(self, z: Array) -> Array:
        """Differences of z at which the sensitivities are taken."""
        x = z[: self.count]
        own = np.maximum(RELATIVE_STEP * np.abs(x), np.minimum(STD_STEP * self.spread, np.maximum(np.abs(x), 1.0)))
        own = np.where(own > 0.0, own, RELATIVE_STEP)
        return np.concatenate([own, np.full(len(z) - self.count, SHAPE_STEP)])


@dataclass(frozen=True, eq=False)
class LoopFit:
    """The fit: free parameters ``z``, the runs at them, and the sensitivities (N, n, r + shapes) of their torques."""

    z: Array
    runs: tuple[Run, ...]
    sensitivities: tuple[Array, ...]
    weights: Array
    iterations: int


class OutputError:
    """The output error of ``loop`` over ``recordings``; ``use`` (N, n) are the samples to fit in each."""

    def __init__(
        self,
        loop: CompiledLoop,
        parameters: FreeParameters,
        recordings: Sequence[LoopRecording],
        use: Sequence[NDArray[np.bool_]],
        jobs: int = 1,
    ) -> None:
        self.loop, self.parameters = loop, parameters
        self.recordings, self.use, self.jobs = tuple(recordings), tuple(use), jobs
        squares = sum(np.sum(np.where(u, r.tau, 0.0) ** 2, axis=0) for r, u in zip(recordings, use, strict=True))
        self.counts = np.maximum(1, sum(np.sum(u, axis=0) for u in use))
        self.weights: Array = 1.0 / np.maximum(np.sqrt(squares / self.counts), 1e-12)

    def runs(self, z: Array) -> tuple[Run, ...] | None:
        """The simulated loops; None where one diverges."""
        theta = self.parameters.theta(z)
        found = []
        for recording in self.recordings:
            run = self.loop.run(theta, recording)
            if run.diverged is not None:
                return None
            found.append(run)
        return tuple(found)

    def residual(self, runs: Sequence[Run]) -> Array:
        """Weighted residuals of all samples to fit, one after the other."""
        parts = []
        for recording, run, use in zip(self.recordings, runs, self.use, strict=True):
            parts.append(((recording.tau - run.tau) * self.weights)[use])
        return np.concatenate(parts)

    def renew(self, runs: Sequence[Run]) -> None:
        """Weights from the errors of the joints."""
        squares = sum(
            np.sum(np.where(u, r.tau - run.tau, 0.0) ** 2, axis=0)
            for r, run, u in zip(self.recordings, runs, self.use, strict=True)
        )
        sigma = np.sqrt(squares / self.counts)
        self.weights = 1.0 / np.maximum(sigma, 1e-9 * max(float(np.max(sigma)), 1e-12))

    def sensitivities(self, z: Array, runs: Sequence[Run]) -> tuple[Array, ...]:
        """Derivatives (N, n, k) of the simulated torques by z, by differences."""
        steps = self.parameters.steps(z)

        def column(i: int) -> list[Array]:
            for retry in range(RETRIES):
                h = steps[i] * 0.1**retry
                for signed in (h, -h):
                    moved = z.copy()
                    moved[i] += signed
                    other = self.runs(moved)
                    if other is not None:
                        return [(a.tau - b.tau) / signed for a, b in zip(other, runs, strict=True)]
            return [np.zeros_like(run.tau) for run in runs]

        with ThreadPoolExecutor(max(1, self.jobs)) as pool:
            columns = list(pool.map(column, range(len(z))))
        return tuple(np.stack([each[k] for each in columns], axis=-1) for k in range(len(runs)))

    def stacked(self, sensitivities: Sequence[Array]) -> Array:
        """Weighted sensitivities of all samples to fit."""
        parts = [(J * self.weights[:, None])[use] for J, use in zip(sensitivities, self.use, strict=True)]
        return np.concatenate(parts)

    def fit(self, z: Array, tell: Tell) -> LoopFit:
        """Minimise from ``z``; raises DerivationError where the loop diverges there."""
        runs = self.runs(z)
        if runs is None:
            raise DerivationError(self._diverged(z))
        self.renew(runs)
        damping, done, logs = 1e-3, 0, self.parameters.logarithms(z)
        for iteration in range(ITERATIONS):
            done = iteration + 1
            tell(iteration, ITERATIONS, "closed-loop output error")
            J = self.stacked(self.sensitivities(z, runs))
            e = self.residual(runs)
            cost = float(e @ e)
            size = np.maximum(np.linalg.norm(J, axis=0), np.finfo(float).tiny)
            A = J / size
            H, gradient = A.T @ A, A.T @ e
            fell = 0.0
            for _ in range(8):
                step = np.linalg.lstsq(H + damping * np.eye(len(z)), gradient, rcond=1e-12)[0] / size
                step = np.where(logs, np.clip(step, -LARGEST_LOG_STEP, LARGEST_LOG_STEP), step)
                tried = self.runs(z + step)
                after = np.inf if tried is None else float(np.sum(self.residual(tried) ** 2))
                if tried is not None and after < cost:
                    z, runs, fell = z + step, tried, 1.0 - after / cost
                    damping = max(1e-9, damping / 10.0)
                    break
                damping *= 10.0
            if fell < SETTLED:
                break
            self.renew(runs)
        return LoopFit(z, runs, self.sensitivities(z, runs), self.weights, done)

    def covariance(self, fit: LoopFit) -> Array:
        """Covariance of z: ``H^-1 (sum_b g_b g_b') H^-1`` over blocks of a second, whose errors may be correlated."""
        k = len(fit.z)
        H, meat = np.zeros((k, k)), np.zeros((k, k))
        for recording, run, J, use in zip(self.recordings, fit.runs, fit.sensitivities, self.use, strict=True):
            weighted = np.where(use, self.weights, 0.0)
            own = J * weighted[..., None]
            e = (recording.tau - run.tau) * weighted
            H += np.einsum("ija,ijb->ab", own, own)
            scores = np.einsum("ija,ij->ia", own, e)
            edges = np.arange(0, len(recording), max(1, round(BLOCK / recording.period)))
            for block in np.add.reduceat(scores, edges):
                meat += np.outer(block, block)
        inverse = np.linalg.pinv(H, hermitian=True)
        return np.asarray(inverse @ meat @ inverse)

    def _diverged(self, z: Array) -> str:
        theta = self.parameters.theta(z)
        for recording in self.recordings:
            run = self.loop.run(theta, recording)
            if run.diverged is not None:
                return divergence(run, recording)
        return "the simulated loop diverges"


def divergence(run: Run, recording: LoopRecording) -> str:
    """The message for a loop that diverged."""
    assert run.diverged is not None
    instant = recording.t[run.diverged] - recording.t[0]
    return (
        f"the simulated loop diverges {instant:.3g} s after the start of the recording: controller, delay or robot are "
        "not those that were recorded"
    )
