"""Output-error fit over many short windows (multiple shooting): parameters, and the initial state of every window.

Positions simulated over a window from its initial state are compared with the recorded ones. The residuals are whitened
by the covariance of encoder noise plus white torque noise that the joint integrates twice. The initial states have a
prior, the state of a low-pass filter with its uncertainty, and are eliminated from the normal equations of each window.
Bristles have a state, too: their initial force is what smoothed torque and acceleration leave for friction, plus a
correction that is estimated like position and speed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rrrgen.base.arrays import Array
from rrrgen.lab.friction.candidate_laws import Candidate
from rrrgen.lab.friction.simulation import simulate
from rrrgen.lab.friction.windows import Noise, Windows, make_noise

STEP = 1e-4  # step of forward differences, relative to a parameter's scale
ROBUST = 3.0  # standard deviations at which the loss turns from quadratic to linear
RATIOS = 10.0 ** np.arange(-1.0, 5.1)
MOST_ITERATIONS = 25
ADAPTING = 4  # iterations in which only the initial states are fitted
LARGEST_STEP = 0.7  # largest change of a logarithm in one iteration
QUADRATIC = 0.6  # factor by which the lower bound on the robust scale falls in every iteration
FRICTION_STD = 1.0  # prior standard deviation of the bristles' initial force, relative to the break-away torque
RINGING = 20.0  # factor by which the initial speed is less certain on bristles: the filter does not see them ring
FRICTION_STEP = 1e-3  # step of finite differences of that force
SMALL_GAIN = 1e-4  # relative decrease of the cost at which the search ends


@dataclass(frozen=True, eq=False)
class Fit:
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
) -> Fit:
    """Fit the parameters of ``candidate`` to ``windows`` by the Levenberg-Marquardt method.

    ``theta`` (k,) are the initial values. ``noise`` whitens the residuals. Parameters named in ``held`` keep their
    values. ``start`` (s, S) are initial states of the windows to begin with, those of the recording's filter if None;
    ``iterations`` is the largest number.
    """
    work = _Problem(candidate, windows, noise, held)
    theta = candidate.clipped(theta)
    start = work.usual if start is None else start
    damping, done = 1e-2, 0
    found = work.linearise(theta, work.shifted(theta, start), 1.0)
    for done in range(1, iterations + 1):
        trial, trial_start = work.moved(found, theta, start, damping)
        r = work.shifted(trial, trial_start)  # most steps are accepted, and their derivatives are then needed
        cost = _losses(r[:, 0], found.sigma)
        if not len(work.free):  # without free parameters windows are independent: each keeps its better initial state
            better = cost < found.cost
            trial_start, r = np.where(better, trial_start, start), np.where(better, r, found.shifted)
            cost = np.minimum(cost, found.cost)
        if np.sum(cost) < np.sum(found.cost):
            gain = 1.0 - float(np.sum(cost) / np.sum(found.cost))
            theta, start = trial, trial_start
            damping = max(damping / 10.0, 1e-9)
        elif damping > 1e6:
            break
        else:
            gain = 1.0
            damping *= 10.0
            continue
        found = work.linearise(theta, r, QUADRATIC**done)
        if gain < SMALL_GAIN and QUADRATIC**done < 0.1:
            break
    return Fit(
        candidate, theta, start, noise, found.sigma, found.cost, found.shifted[:, 0], work.free, found.normal,
        found.gradient,
    )  # fmt: skip


def rigid_limit(found: Fit, law: Candidate) -> Fit:
    """The ``law`` of sliding with the parameters of a law with bristles, ``found``, as if these were rigid.

    The bristles are fitted to rest and reversals too, which tell the friction at low speed where the joint hardly ever
    slides slowly.
    """
    kept = [found.candidate.names.index(name) for name in law.names]
    normal, gradient = found.normal[:, kept][:, :, kept], found.gradient[:, kept]
    return replace(
        found, candidate=law, theta=found.theta[kept], start=found.start[:2],
        free=np.arange(len(kept)), normal=normal, gradient=gradient,
    )  # fmt: skip


def best_start(candidate: Candidate, tried: Sequence[Array], windows: Windows, noise: Noise) -> Array:
    """The initial parameters (k,) among those ``tried`` with the least mean magnitude of the whitened residuals.

    A median would ignore the few windows with reversals, which alone tell bristles.
    """
    work = _Problem(candidate, windows, noise, ())
    r = work.residuals(np.stack(tried, axis=1), np.repeat(work.usual[:, None], len(tried), axis=1))
    sizes = np.mean(np.abs(work.errors(r).swapaxes(1, 2)[windows.used]), axis=0)
    finite = np.isfinite(r).all(axis=(0, 2))
    return tried[int(np.argmin(np.where(finite, sizes, np.inf)))]


def window_losses(candidate: Candidate, theta: Array, windows: Windows, noise: Noise, sigma: float) -> Array:
    """Robust losses (S,) of the windows for given parameters ``theta`` (k,), in units of ``sigma`` squared.

    The initial state of each window is fitted first.
    """
    fitted = fit(candidate, theta, windows, noise, held=candidate.names, iterations=ADAPTING)
    return _losses(fitted.residuals, sigma)


def likely_noise(found: Fit, windows: Windows) -> Noise:
    """Estimate the ratio of torque noise to encoder noise from the position errors of a fit, by maximum likelihood.

    Minimises ``N ln(sigma) + sum ln L_ii`` over the N positions used, with a robust sigma for each ratio; L is the
    Cholesky factor of the covariance of the position errors. Returns the :class:`Noise` with this ratio.
    """
    work = _Problem(found.candidate, windows, found.noise, ())
    errors = windows.measured - work.positions(found.theta[:, None], found.start[:, None, :])[:, 0]
    tried = []
    for ratio in RATIOS:
        noise = make_noise(len(errors), windows.period * windows.stride, float(ratio))
        sigma = float(np.median(np.abs((noise.whitener @ errors)[windows.used])))
        tried.append((windows.points * np.log(sigma) + float(noise.logarithms @ windows.used.sum(axis=1)), noise))
    return min(tried, key=lambda each: each[0])[1]


@dataclass(frozen=True, eq=False)
class _Linear:
    sigma: float
    cost: Array
    shifted: Array
    normal: Array
    gradient: Array
    own: Array
    back: Array
    own_gradient: Array


class _Problem:
    """Least-squares problem of one fit: residuals of all windows and their derivatives."""

    def __init__(self, candidate: Candidate, windows: Windows, noise: Noise, held: tuple[str, ...]) -> None:
        self.candidate, self.windows, self.noise = candidate, windows, noise
        self.parts = windows.by_length()
        self.free = np.array([i for i, name in enumerate(candidate.names) if name not in held], dtype=int)
        self.usual = np.stack([windows.q0, windows.v0])
        # standard deviations of the initial states' prior, and steps of finite differences
        self.prior = np.array([windows.q0_std, windows.v0_std])
        self.steps = np.array([windows.resolution, max(windows.v0_std, 1e-6)]) * 0.1
        if candidate.has_bristles:
            self.usual = np.vstack([self.usual, np.zeros(len(windows))])
            self.prior = np.array([windows.q0_std, RINGING * windows.v0_std, FRICTION_STD])
            self.steps = np.append(self.steps, FRICTION_STEP)

    def positions(self, theta: Array, start: Array) -> Array:
        """Simulated positions (m, C, S) for parameters ``theta`` (k, C) and initial states ``start`` (s, C, S).

        They are 0 after the end of a window.
        """
        friction = self.bristle_force(theta, start[2]) if self.candidate.has_bristles else None
        found = np.zeros((len(self.windows.measured), *start.shape[1:]))
        for numbers, w in self.parts:
            q, v = start[:2, :, numbers]
            force = None if friction is None else friction[:, numbers]
            simulated = simulate(self.candidate, theta, w.torque, q, v, w.period, w.stride, w.direction, force)
            found[: len(simulated), :, numbers] = simulated
        return found

    def bristle_force(self, theta: Array, correction: Array) -> Array:
        """Force (C, S) of the bristles at the start of the windows, that of the filtered motion plus a ``correction``.

        The correction (C, S) is an unknown of the fit, in multiples of break-away friction.
        """
        w, law = self.windows, self.candidate
        columns = [row[:, None] for row in theta]
        known = dict(zip(law.names, columns, strict=True))
        net = w.smoothed.centred(columns[-1]) - law.gravity_torque(w.q0, columns) - columns[0] * w.a0
        level = np.abs(law.torque(w.v0, columns, 1.0) - known["viscous"] * w.v0)
        force = np.clip(net - known["viscous"] * w.v0, -level, level)
        return np.asarray(force + correction * (known["coulomb"] + known["stiction_excess"]))

    def whitened(self, plain: Array, start: Array) -> Array:
        """Whitened residuals (m + s, C, S): m position errors, then the initial states' deviation from their prior.

        ``plain`` (m, C, S) are the errors before whitening, ``start`` (s, C, S) the initial states.
        """
        w = self.windows
        points, C, S = plain.shape
        first = (self.noise.whitener @ plain.reshape(points, C * S)).reshape(points, C, S) / w.resolution
        first *= w.used[:, None]
        prior = (self.usual[:, None] - start) / self.prior[:, None, None]
        return np.concatenate([first, prior])

    def residuals(self, theta: Array, start: Array) -> Array:
        return self.whitened(self.windows.measured[:, None] - self.positions(theta, start), start)

    def errors(self, residuals: Array) -> Array:
        """The position errors (m, ...) among whitened ``residuals`` (m + s, ...)."""
        return residuals[: -len(self.prior)]

    def shifted(self, theta: Array, start: Array) -> Array:
        """Whitened residuals (m + s, 1 + f + s, S) at a point, then with each fitted parameter, each state shifted.

        One simulation of all of them takes little longer than one of the point alone.
        """
        k, own_k = len(self.free), len(self.prior)
        free = np.repeat(self.candidate.to_free(theta)[:, None], k + 1 + own_k, axis=1)
        free[self.free, np.arange(1, k + 1)] += self._shifts(theta)
        states = np.repeat(start[:, None, :], k + 1 + own_k, axis=1)
        for i, step in enumerate(self.steps):
            states[i, k + 1 + i] += step
        return self.residuals(self.candidate.from_free(free), states)

    def _shifts(self, theta: Array) -> Array:
        """Steps (f,) of the forward differences by the fitted parameters, or by their logarithms."""
        steps = np.where(self.candidate.is_logarithmic, STEP, STEP * np.maximum(np.abs(theta), 0.05))
        return np.asarray(steps[self.free])

    def linearise(self, theta: Array, r: Array, quadratic: float) -> _Linear:
        """Normal equations of the fit from the residuals ``r`` of :meth:`shifted`, with the initial states eliminated.

        The scale of the robust loss is at least ``quadratic`` times the root mean square of the residuals. A large
        ``quadratic`` at the start of a search makes it ordinary least squares, because far from the optimum a robust
        loss would treat informative windows as outliers.
        """
        k, own_k = len(self.free), len(self.prior)
        base = r[:, 0]
        counted = self.errors(base)[self.windows.used]
        sigma = max(_scale(counted), quadratic * float(np.sqrt(np.mean(counted**2))))
        weight = np.sqrt(_weights(base / sigma))
        J = (r[:, 1 : k + 1] - base[:, None]) / self._shifts(theta)[None, :, None] * weight[:, None] / sigma
        B = (r[:, k + 1 :] - base[:, None]) / self.steps[None, :, None] * weight[:, None] / sigma
        e = base * weight / sigma
        own = np.einsum("mas,mbs->sab", B, B)
        cross = np.einsum("mas,mks->sak", B, J)
        own_gradient = np.einsum("mas,ms->sa", B, e)
        own[:, np.arange(own_k), np.arange(own_k)] *= 1.0 + 1e-12
        back = np.linalg.solve(own, cross)
        settled = np.linalg.solve(own, own_gradient[:, :, None])[:, :, 0]
        normal = np.einsum("mjs,mks->sjk", J, J) - np.einsum("saj,sak->sjk", cross, back)
        gradient = np.einsum("mks,ms->sk", J, e) - np.einsum("sak,sa->sk", cross, settled)
        return _Linear(sigma, _losses(base, sigma), r, normal, gradient, own, back, settled)

    def moved(self, at: _Linear, theta: Array, start: Array, damping: float) -> tuple[Array, Array]:
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
        own = -at.own_gradient / (1.0 + damping) - at.back @ step  # initial states follow the step that is taken
        return self.candidate.clipped(self.candidate.from_free(free)), start + own.T


def _scale(r: Array) -> float:
    """Robust standard deviation of whitened residuals ``r`` from their median, at least that of encoder rounding."""
    return max(float(np.median(np.abs(r))) / 0.6745, 0.29)


def _losses(r: Array, sigma: float) -> Array:
    """Robust losses (S,) of the windows: soft_l1, quadratic below ROBUST ``sigma`` and linear above, of residuals r."""
    s = (r / (ROBUST * sigma)) ** 2
    return np.asarray(np.sum(2.0 * ROBUST**2 * (np.sqrt(1.0 + s) - 1.0), axis=0))


def _weights(x: Array) -> Array:
    return np.asarray(1.0 / np.sqrt(1.0 + (x / ROBUST) ** 2))
