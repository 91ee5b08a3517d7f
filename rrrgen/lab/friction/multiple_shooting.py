"""Output-error fit over many short windows (multiple shooting), with its bootstrap."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rrrgen.base.arrays import Array
from rrrgen.lab.estimate.statistics import rms
from rrrgen.lab.friction.candidate_laws import Candidate
from rrrgen.lab.friction.joint_simulation import Windows, joint_simulation

# ------------------------------------------------------------------------------------------------------------------
# Noise of the positions simulated over the windows of a recording.
# ------------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Noise:
    """Noise model of the m position errors of a window: ``covariance = sigma^2 (I + ratio D)``.

    I is encoder noise; D is the covariance of white torque noise integrated twice, 1 at the last position. ``ratio`` is
    thus torque noise over encoder noise. ``whitener`` (m, m), lower triangular, maps the errors to ones with covariance
    ``sigma^2 I``; its leading block does so for a shorter window. ``logarithms`` (m,) are ``-ln`` of its diagonal.
    """

    ratio: float
    whitener: Array
    logarithms: Array


def make_noise(points: int, step: float, ratio: float) -> Noise:
    """Noise model of windows with ``points`` positions at a distance of ``step`` seconds.

    ``ratio`` is the variance due to torque noise at the end of a window divided by that of the encoder.
    """
    t = np.arange(points) * step
    early, late = np.minimum.outer(t, t), np.maximum.outer(t, t)
    D = early**2 * (3.0 * late - early) / 6.0  # white noise integrated twice
    D = D / D[-1, -1]
    C = np.eye(points) + ratio * D
    lower = np.linalg.cholesky(C)
    return Noise(ratio, np.linalg.inv(lower), np.log(np.diag(lower)))


# ------------------------------------------------------------------------------------------------------------------
# Output-error fit over many short windows (multiple shooting): parameters, and the initial state of every window.
#
# Positions simulated over a window from its initial state are compared with the recorded ones. The residuals are
# whitened by the covariance of encoder noise plus white torque noise that the joint integrates twice. The initial
# states have a prior, the state of a low-pass filter with its uncertainty, and are eliminated from the normal
# equations of each window. Bristles have a state, too: their initial force is what smoothed torque and acceleration
# leave for friction, plus a correction that is estimated like position and speed.
# ------------------------------------------------------------------------------------------------------------------

ROBUST = 3.0  # standard deviations at which the loss turns from quadratic to linear
RATIOS = 10.0 ** np.arange(-1.0, 5.1)
MOST_ITERATIONS = 25
ADAPTING = 4  # iterations in which only the initial states are fitted
LARGEST_STEP = 0.7  # largest change of a logarithm in one iteration
QUADRATIC = 0.6  # factor by which the lower bound on the robust scale falls in every iteration
FRICTION_STD = 1.0  # prior standard deviation of the bristles' initial force, relative to the break-away torque
RINGING_UNCERTAINTY = (
    20.0  # factor by which the initial speed is less certain on bristles: the filter does not see them ring
)
STEP = 1e-6  # step of forward differences of the bristles' initial deflection
SMALL_GAIN = 1e-4  # relative decrease of the cost at which the search ends


@dataclass(frozen=True, eq=False)
class ShootingFit:
    """Result of fitting a law to S windows: parameters ``theta`` (k,) and initial states ``start`` (s, S).

    The initial states are q and dq, for a law with bristles also a correction of their force, relative to break-away.

    ``sigma`` is the robust standard deviation of the residuals whitened by ``noise``; ``cost`` (S,) are the robust
    losses of the windows in units of its square, ``residuals`` (m + s, S) the whitened residuals. ``free`` (f,) are the
    indices of the fitted parameters; ``normal`` (S, f, f) and ``gradient`` (S, f) are the contributions of the windows
    to their normal equations, after elimination of the initial states.
    """

    candidate: Candidate
    theta: Array
    start: Array
    noise: Noise
    sigma: float
    cost: Array
    residuals: Array
    free: NDArray[np.int64]
    normal: Array
    gradient: Array


def fit(
    candidate: Candidate,
    theta: Array,
    windows: Windows,
    noise: Noise,
    held: tuple[str, ...] = (),
    start: Array | None = None,
    iterations: int = MOST_ITERATIONS,
) -> ShootingFit:
    """Fit the parameters of ``candidate`` to ``windows`` by the Levenberg-Marquardt method.

    ``theta`` (k,) are the initial values. ``noise`` whitens the residuals. Parameters named in ``held`` keep their
    values. ``start`` (s, S) are initial states of the windows to begin with, those of the recording's filter if None;
    ``iterations`` is the largest number.
    """
    work = _Problem(candidate, windows, noise, held)
    theta = candidate.clip(theta)
    start = work.usual if start is None else start
    damping, done = 1e-2, 0
    linearisation = work.linearise(theta, start, 1.0)
    for done in range(1, iterations + 1):
        trial, trial_start = work.take_step(linearisation, theta, start, damping)
        cost = _losses(work.residuals(trial, trial_start), linearisation.sigma)
        if not len(work.free):  # without free parameters windows are independent: each keeps its better initial state
            better = cost < linearisation.cost
            trial_start, cost = np.where(better, trial_start, start), np.minimum(cost, linearisation.cost)
        if np.sum(cost) < np.sum(linearisation.cost):
            gain = 1.0 - float(np.sum(cost) / np.sum(linearisation.cost))
            theta, start = trial, trial_start
            damping = max(damping / 10.0, 1e-9)
        elif damping > 1e6:
            break
        else:
            gain = 1.0
            damping *= 10.0
            continue
        linearisation = work.linearise(theta, start, QUADRATIC**done)
        if gain < SMALL_GAIN and QUADRATIC**done < 0.1:
            break
    return ShootingFit(
        candidate, theta, start, noise, linearisation.sigma, linearisation.cost, linearisation.residuals, work.free,
        linearisation.normal, linearisation.gradient,
    )  # fmt: skip


def rigid_limit(bristle_fit: ShootingFit, law: Candidate) -> ShootingFit:
    """The ``law`` of sliding with the parameters of a law with bristles, ``bristle_fit``, as if these were rigid.

    The bristles are fitted to rest and reversals too, which tell the friction at low speed where the joint hardly ever
    slides slowly.
    """
    kept = [bristle_fit.candidate.names.index(name) for name in law.names]
    normal, gradient = bristle_fit.normal[:, kept][:, :, kept], bristle_fit.gradient[:, kept]
    return replace(
        bristle_fit, candidate=law, theta=bristle_fit.theta[kept], start=bristle_fit.start[:2],
        free=np.arange(len(kept)), normal=normal, gradient=gradient,
    )  # fmt: skip


def best_start(candidate: Candidate, tried: Sequence[Array], windows: Windows, noise: Noise) -> Array:
    """The initial parameters (k,) among those ``tried`` with the least mean magnitude of the whitened residuals.

    A median would ignore the few windows with reversals, which alone tell bristles.
    """
    work = _Problem(candidate, windows, noise, ())
    sizes = [float(np.mean(np.abs(work.errors(work.residuals(theta, work.usual))[windows.used]))) for theta in tried]
    return tried[int(np.argmin(np.where(np.isfinite(sizes), sizes, np.inf)))]


def window_losses(candidate: Candidate, theta: Array, windows: Windows, noise: Noise, sigma: float) -> Array:
    """Robust losses (S,) of the windows for given parameters ``theta`` (k,), in units of ``sigma`` squared.

    The initial state of each window is fitted first.
    """
    fitted = fit(candidate, theta, windows, noise, held=candidate.names, iterations=ADAPTING)
    return _losses(fitted.residuals, sigma)


def likely_noise(shooting: ShootingFit, windows: Windows) -> Noise:
    """Estimate the ratio of torque noise to encoder noise from the position errors of a fit, by maximum likelihood.

    Minimises ``N ln(sigma) + sum ln L_ii`` over the N positions used, with a robust sigma for each ratio; L is the
    Cholesky factor of the covariance of the position errors. Returns the :class:`Noise` with this ratio.
    """
    work = _Problem(shooting.candidate, windows, shooting.noise, ())
    errors = windows.measured - work.positions(shooting.theta, shooting.start)
    tried = []
    for ratio in RATIOS:
        noise = make_noise(len(errors), windows.period * windows.stride, float(ratio))
        sigma = float(np.median(np.abs((noise.whitener @ errors)[windows.used])))
        tried.append((windows.points * np.log(sigma) + float(noise.logarithms @ windows.used.sum(axis=1)), noise))
    return min(tried, key=lambda trial: trial[0])[1]


@dataclass(frozen=True, eq=False)
class _Linear:
    sigma: float
    cost: Array
    residuals: Array
    normal: Array
    gradient: Array
    back: Array
    start_shift: Array


class _Problem:
    """Least-squares problem of one fit: residuals of all windows and their derivatives."""

    def __init__(self, candidate: Candidate, windows: Windows, noise: Noise, held: tuple[str, ...]) -> None:
        self.candidate, self.windows, self.noise = candidate, windows, noise
        self.simulation = joint_simulation(candidate, candidate.jumps and windows.direction is not None)
        self.free = np.array([i for i, name in enumerate(candidate.names) if name not in held], dtype=int)
        self.usual = np.stack([windows.q0, windows.v0])
        # standard deviations of the initial states' prior
        self.prior = np.array([windows.q0_std, windows.v0_std])
        if candidate.has_bristles:
            self.usual = np.vstack([self.usual, np.zeros(len(windows))])
            self.prior = np.array([windows.q0_std, RINGING_UNCERTAINTY * windows.v0_std, FRICTION_STD])

    def positions(self, theta: Array, start: Array) -> Array:
        """Simulated positions (m, S) for parameters ``theta`` (k,) and initial states ``start`` (s, S).

        They are 0 after the end of a window.
        """
        return self.simulation.positions(theta, self.windows, self._states(theta, start))[0]

    def _states(self, theta: Array, start: Array) -> Array:
        """State (s, S) at the start of each of S windows: position, speed and, if there are bristles, their deflection.

        The first force of the bristles is the friction that the smoothed torque and acceleration imply, plus a
        correction: the last unknown in ``start`` of each window, in multiples of break-away friction.
        """
        if not self.candidate.has_bristles:
            return start
        w, law = self.windows, self.candidate
        known = dict(zip(law.names, theta, strict=True))
        net = w.smoothed.centred_torque(theta[-1]) - law.gravity_torque(w.q0, theta) - theta[0] * w.a0
        level = np.abs(law.torque(w.v0, theta, 1.0) - known["viscous"] * w.v0)
        force = np.clip(net - known["viscous"] * w.v0, -level, level)
        force = force + start[2] * (known["coulomb"] + known["stiction_excess"])
        return np.vstack([start[:2], force / known["sigma0"]])

    def _slopes(self, theta: Array, start: Array) -> Array:
        """Derivatives (s, f + s, S) of the initial states by the fitted parameters and by ``start``."""
        order, f = len(self.prior), len(self.free)
        slopes = np.zeros((order, f + order, start.shape[1]))
        slopes[range(order), range(f, f + order)] = 1.0
        if self.candidate.has_bristles:
            here = self._states(theta, start)
            for column, i in enumerate(self.free):
                moved = theta.copy()
                moved[i] += STEP * max(abs(theta[i]), STEP)
                slopes[:, column] = (self._states(moved, start) - here) / (moved[i] - theta[i])
            bent = self._states(theta, start + np.array([[0.0], [0.0], [1.0]]))
            slopes[:, -1] = bent - here
        return slopes

    def whiten(self, errors: Array, prior: Array) -> Array:
        """Whitened residuals (m + s, ..., S): position errors (m, ..., S), then those from the prior (s, ..., S)."""
        first = np.tensordot(self.noise.whitener, errors, 1) / self.windows.resolution
        used = self.windows.used.reshape(len(errors), *[1] * (errors.ndim - 2), -1)
        return np.concatenate([first * used, prior / self.prior.reshape(-1, *[1] * (prior.ndim - 1))])

    def residuals(self, theta: Array, start: Array) -> Array:
        """Whitened residuals (m + s, S): m position errors, then the initial states' deviation from their prior."""
        return self.whiten(self.windows.measured - self.positions(theta, start), self.usual - start)

    def errors(self, residuals: Array) -> Array:
        """The position errors (m, ...) among whitened ``residuals`` (m + s, ...)."""
        return residuals[: -len(self.prior)]

    def linearise(self, theta: Array, start: Array, quadratic: float) -> _Linear:
        """Normal equations of the fit at ``theta`` (k,) and ``start`` (s, S), with the initial states eliminated.

        The scale of the robust loss is at least ``quadratic`` times the root mean square of the residuals. A large
        ``quadratic`` at the start of a search makes it ordinary least squares, because far from the optimum a robust
        loss would treat informative windows as outliers.
        """
        k, order = len(self.free), len(self.prior)
        seeds = [*self.free.tolist(), *[-1] * order]
        states, along = self._states(theta, start), self._slopes(theta, start)
        positions, slopes = self.simulation.positions(theta, self.windows, states, seeds, along)
        slopes[:, :k] *= np.where(self.candidate.is_logarithmic, theta, 1.0)[self.free][:, None]
        base = self.whiten(self.windows.measured - positions, self.usual - start)
        known = np.zeros((order, k + order, len(self.windows)))
        known[range(order), range(k, k + order)] = 1.0
        counted = self.errors(base)[self.windows.used]
        sigma = max(_scale(counted), quadratic * float(rms(counted)))
        weight = np.sqrt(_weights(base / sigma))
        rows = -self.whiten(slopes, known) * weight[:, None] / sigma
        J, B = rows[:, :k], rows[:, k:]
        e = base * weight / sigma
        start_normal = np.einsum("mas,mbs->sab", B, B)
        cross = np.einsum("mas,mks->sak", B, J)
        start_gradient = np.einsum("mas,ms->sa", B, e)
        start_normal[:, np.arange(order), np.arange(order)] *= 1.0 + 1e-12
        back = np.linalg.solve(start_normal, cross)
        start_shift = np.linalg.solve(start_normal, start_gradient[:, :, None])[:, :, 0]
        normal = np.einsum("mjs,mks->sjk", J, J) - np.einsum("saj,sak->sjk", cross, back)
        gradient = np.einsum("mks,ms->sk", J, e) - np.einsum("sak,sa->sk", cross, start_shift)
        return _Linear(sigma, _losses(base, sigma), base, normal, gradient, back, start_shift)

    def take_step(self, at: _Linear, theta: Array, start: Array, damping: float) -> tuple[Array, Array]:
        """Parameters and initial states after one damped Gauss-Newton step from the linearisation ``at``."""
        step = np.zeros(len(self.free))
        if len(step):
            H, g = at.normal.sum(axis=0), at.gradient.sum(axis=0)
            scale = np.diag(H) + 1e-12 * max(float(np.max(np.diag(H))), 1e-300)
            step = -np.linalg.solve(H + damping * np.diag(scale), g)
        free = self.candidate.to_free(theta)
        limit = np.where(self.candidate.is_logarithmic, LARGEST_STEP, np.inf)[self.free]
        step = np.clip(step, -limit, limit)
        free[self.free] += step
        start_step = -at.start_shift / (1.0 + damping) - at.back @ step  # initial states follow the step that is taken
        return self.candidate.clip(self.candidate.from_free(free)), start + start_step.T


def _scale(r: Array) -> float:
    """Robust standard deviation of whitened residuals ``r`` from their median, at least that of encoder rounding."""
    return max(float(np.median(np.abs(r))) / 0.6745, 0.29)


def _losses(r: Array, sigma: float) -> Array:
    """Robust losses (S,) of the windows: soft_l1, quadratic below ROBUST ``sigma`` and linear above, of residuals r."""
    s = (r / (ROBUST * sigma)) ** 2
    return np.asarray(np.sum(2.0 * ROBUST**2 * (np.sqrt(1.0 + s) - 1.0), axis=0))


def _weights(x: Array) -> Array:
    return np.asarray(1.0 / np.sqrt(1.0 + (x / ROBUST) ** 2))


# ------------------------------------------------------------------------------------------------------------------
# Standard deviations of the estimates by resampling blocks of windows (block bootstrap).
#
# The covariance from the Hessian of a fit assumes independent residuals and an exact friction law. Estimates from
# blocks drawn with replacement vary as those from different parts of the recording do, without these assumptions.
# ------------------------------------------------------------------------------------------------------------------

RESAMPLES = 400


def bootstrap(shooting: ShootingFit, blocks: NDArray[np.int64], seed: int) -> Array:
    """Draw blocks with replacement and estimate the parameters from each draw; returns (k, resamples).

    ``shooting`` is the fit to all windows, ``blocks`` (S,) the number of the block of each window, ``seed`` that of the
    draws. Each estimate is one Gauss-Newton step from the fit.
    """
    groups = np.unique(blocks, return_inverse=True)[1]
    count, f = int(np.max(groups)) + 1, len(shooting.free)
    H, g = np.zeros((count, f, f)), np.zeros((count, f))
    np.add.at(H, groups, shooting.normal)
    np.add.at(g, groups, shooting.gradient)
    g -= g.mean(axis=0)  # the search ends near the optimum, where the gradient is not quite zero
    rng = np.random.default_rng(seed)
    drawn = rng.multinomial(count, np.full(count, 1.0 / count), size=RESAMPLES).astype(float)
    normal, gradient = np.einsum("bg,gjk->bjk", drawn, H), drawn @ g
    size = np.einsum("bjj->bj", normal)
    normal[:, np.arange(f), np.arange(f)] += 1e-10 * size + 1e-300
    steps = np.linalg.solve(normal, gradient[:, :, None])[:, :, 0]
    free = np.repeat(shooting.candidate.to_free(shooting.theta)[:, None], RESAMPLES, axis=1)
    logs = shooting.candidate.is_logarithmic[shooting.free]
    free[shooting.free] -= np.where(logs, np.clip(steps, -3.0, 3.0), steps).T
    return shooting.candidate.clip(shooting.candidate.from_free(free))
