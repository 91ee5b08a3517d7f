"""Closed-loop output error: finds the parameters for which the simulated loop reproduces the recorded torques.

Minimizes ``sum_j w_j^2 |tau_j - tau_j(z)|^2`` over all joints j by Levenberg-Marquardt, with sensitivities by finite
differences. The unknowns z are the identifiable parameters x and the logarithms of the friction shape parameters. The
torques tau_j(z) are simulated along the recorded reference, so noise of the measured motion affects only the recorded
torques. Position errors need no term of their own: the controller turns them into torque errors.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from rrrgen.base.arrays import Array
from rrrgen.base.errors import DerivationError
from rrrgen.lab.closed_loop.loop import CompiledLoop, SimulatedLoop
from rrrgen.lab.closed_loop.loop_recording import LoopRecording

ITERATIONS = 25
BLOCK = 1.0  # s: torque errors may be correlated within a block of this length, not beyond it
FEWEST_BLOCKS = 20  # of that length, which a short recording makes shorter
SETTLED = 1e-4  # relative decrease of the cost in one iteration below which the search ends
RELATIVE_STEP = 1e-3  # step of finite differences, relative to the parameter
STD_STEP = 0.1  # step of finite differences, relative to the standard deviation of the parameter
SHAPE_STEP = 1e-2  # step of finite differences, absolute, for the logarithm of a shape parameter
LARGEST_LOG_STEP = 0.7  # largest change of a logarithm in one iteration: a factor of two
RETRIES = 3  # difference steps tried, each a tenth of the last, while the loop diverges at the shifted parameters

Tell = Callable[[int, int, str], None]


class FreeParameters(Protocol):
    """Interface of a parameterization: maps the fitted unknowns z (k,), some of them logarithms, to theta (p,)."""

    def theta(self, z: Array) -> Array:
        """Parameters (p,) of the simulation for the unknowns ``z``, SI units."""
        ...

    def steps(self, z: Array) -> Array:
        """Step sizes (k,) of the finite differences at ``z``."""
        ...

    def logarithms(self, z: Array) -> NDArray[np.bool_]:
        """Mask (k,) of the unknowns that are logarithms."""
        ...


@dataclass(frozen=True, eq=False)
class Parameters:
    """Maps the unknowns ``z = [x; logs]`` to simulation parameters ``theta = [T x + known; exp(logs)]``.

    x (r,) are the identifiable parameters, ``T`` (c, r) and ``known`` (c,) their affine map to the parameters of the c
    regressor columns, ``logs`` the logarithms of the friction shape parameters. ``spread`` (r,) are the standard
    deviations of x before the fit; they scale the finite-difference steps.
    """

    T: Array
    known: Array
    spread: Array

    @property
    def count(self) -> int:
        """Number r of identifiable parameters x."""
        return int(self.T.shape[1])

    def logarithms(self, z: Array) -> NDArray[np.bool_]:
        """Mask (k,) of the unknowns that are logarithms: those after the first r."""
        return np.arange(len(z)) >= self.count

    def theta(self, z: Array) -> Array:
        """Parameters (p,) of the simulation for the unknowns ``z``, SI units."""
        return np.concatenate([self.T @ z[: self.count] + self.known, np.exp(z[self.count :])])

    def steps(self, z: Array) -> Array:
        """Step sizes (k,) of the finite differences at ``z``."""
        x = z[: self.count]
        steps = np.maximum(RELATIVE_STEP * np.abs(x), np.minimum(STD_STEP * self.spread, np.maximum(np.abs(x), 1.0)))
        steps = np.where(steps > 0.0, steps, RELATIVE_STEP)
        return np.concatenate([steps, np.full(len(z) - self.count, SHAPE_STEP)])


@dataclass(frozen=True, eq=False)
class LoopFit:
    """Result of a closed-loop fit.

    ``z`` (k,) are the fitted unknowns, ``runs`` the simulated loops at z, one for each recording, ``sensitivities``
    the derivatives (N, n, k) of their torques by z, ``weights`` (n,) the inverse torque error of each joint in
    1/(N m) or 1/N, and ``iterations`` the number of Levenberg-Marquardt steps.
    """

    z: Array
    runs: tuple[SimulatedLoop, ...]
    sensitivities: tuple[Array, ...]
    weights: Array
    iterations: int


class OutputErrorProblem:
    """Least-squares problem: fit the torques of the simulated ``loop`` to those of ``recordings``.

    ``parameters`` maps the unknowns to the parameters of the loop. ``use`` holds one mask (N, n) for each recording,
    of the samples to fit. ``jobs`` is the number of threads that compute sensitivities.
    """

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

    def runs(self, z: Array) -> tuple[SimulatedLoop, ...] | None:
        """Simulate all recordings with the unknowns ``z`` (k,); None if any simulation diverges."""
        theta = self.parameters.theta(z)
        runs = []
        for recording in self.recordings:
            run = self.loop.run(theta, recording)
            if run.diverged is not None:
                return None
            runs.append(run)
        return tuple(runs)

    def residual(self, runs: Sequence[SimulatedLoop]) -> Array:
        """Weighted torque residuals ``w_j (tau_j - tau_j(z))`` of all samples to fit, as one vector."""
        parts = []
        for recording, run, use in zip(self.recordings, runs, self.use, strict=True):
            parts.append(((recording.tau - run.tau) * self.weights)[use])
        return np.concatenate(parts)

    def renew(self, runs: Sequence[SimulatedLoop]) -> None:
        """Reset the weight of each joint to the inverse of its RMS torque error in ``runs``."""
        squares = sum(
            np.sum(np.where(u, r.tau - run.tau, 0.0) ** 2, axis=0)
            for r, run, u in zip(self.recordings, runs, self.use, strict=True)
        )
        sigma = np.sqrt(squares / self.counts)
        self.weights = 1.0 / np.maximum(sigma, 1e-9 * max(float(np.max(sigma)), 1e-12))

    def sensitivities(self, z: Array, runs: Sequence[SimulatedLoop]) -> tuple[Array, ...]:
        """Derivatives (N, n, k) of the simulated torques by z, for each recording, by finite differences."""
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
        return tuple(np.stack([derivatives[k] for derivatives in columns], axis=-1) for k in range(len(runs)))

    def stack_sensitivities(self, sensitivities: Sequence[Array]) -> Array:
        """Weighted sensitivities of all samples to fit, stacked as one Jacobian with k columns."""
        parts = [(J * self.weights[:, None])[use] for J, use in zip(sensitivities, self.use, strict=True)]
        return np.concatenate(parts)

    def fit(self, z: Array, tell: Tell) -> LoopFit:
        """Minimize the output error from the start values ``z`` (k,); ``tell`` is called with the progress.

        Raises DerivationError if the simulated loop diverges at the start values.
        """
        runs = self.runs(z)
        if runs is None:
            raise DerivationError(self._describe_divergence(z))
        self.renew(runs)
        damping, done, logs = 1e-3, 0, self.parameters.logarithms(z)
        for iteration in range(ITERATIONS):
            done = iteration + 1
            tell(iteration, ITERATIONS, "closed-loop output error")
            J = self.stack_sensitivities(self.sensitivities(z, runs))
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
        """Covariance (k, k) of z, robust to torque errors that are correlated within a block: ``H^-1 G H^-1``.

        ``H = J' J`` with the weighted sensitivities J, ``G = sum_b g_b g_b'`` with the gradient g_b = J_b' e_b of each
        block b.
        """
        return _sandwich(*self._curvature_and_scatter(fit))

    def spread_by_shapes(self, fit: LoopFit, count: int) -> Array:
        """Factors (count,) >= 1 by which uncertain friction shapes enlarge the standard deviations of other parameters.

        The first ``count`` unknowns are these parameters, the others the shapes. A factor is the standard deviation
        when the shapes are fitted too, divided by that for known shapes.
        """
        H, G = self._curvature_and_scatter(fit)
        whole = np.diag(_sandwich(H, G))[:count]
        known = np.diag(_sandwich(H[:count, :count], G[:count, :count]))
        ratio = np.divide(whole, known, out=np.ones(count), where=known > 0.0)
        return np.asarray(np.sqrt(np.maximum(ratio, 1.0)))

    def _curvature_and_scatter(self, fit: LoopFit) -> tuple[Array, Array]:
        """Matrices H = J' J and G = sum_b g_b g_b', (k, k) each, of which the covariance is ``H^-1 G H^-1``.

        J are the weighted sensitivities of the torques, g_b the gradient of the cost over block b of the samples.
        """
        k = len(fit.z)
        H, G = np.zeros((k, k)), np.zeros((k, k))
        length = min(BLOCK, sum(len(r) * r.period for r in self.recordings) / FEWEST_BLOCKS)
        for recording, run, J, use in zip(self.recordings, fit.runs, fit.sensitivities, self.use, strict=True):
            weighted = np.where(use, self.weights, 0.0)
            sensitivities = J * weighted[..., None]
            e = (recording.tau - run.tau) * weighted
            H += np.einsum("ija,ijb->ab", sensitivities, sensitivities)
            scores = np.einsum("ija,ij->ia", sensitivities, e)
            edges = np.arange(0, len(recording), max(1, round(length / recording.period)))
            for block in np.add.reduceat(scores, edges):
                G += np.outer(block, block)
        return H, G

    def _describe_divergence(self, z: Array) -> str:
        theta = self.parameters.theta(z)
        for recording in self.recordings:
            run = self.loop.run(theta, recording)
            if run.diverged is not None:
                return divergence(run, recording)
        return "the simulated loop diverges"


def _sandwich(H: Array, G: Array) -> Array:
    inverse = np.linalg.pinv(H, hermitian=True)
    return np.asarray(inverse @ G @ inverse)


def divergence(run: SimulatedLoop, recording: LoopRecording) -> str:
    """Error message for a simulated loop ``run`` that diverged: when, and the possible causes."""
    assert run.diverged is not None
    instant = recording.t[run.diverged] - recording.t[0]
    return (
        f"the simulated loop diverges {instant:.3g} s after the start of the recording: controller, delay or robot are "
        "not those that were recorded"
    )
