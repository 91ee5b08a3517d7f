"""Output-error fit over many short windows (multiple shooting), with its simulation, windows and bootstrap."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rrrgen.base.arrays import Array
from rrrgen.lab.friction.candidate_laws import Candidate

# ------------------------------------------------------------------------------------------------------------------
# Simulation of one joint over many short windows and many parameter vectors at once.
#
# All quantities are arrays (C, S) over C parameter vectors and S windows. With a friction law that jumps at zero
# speed, a joint sticks exactly while the load is below break-away; the instant at which it stops is located within a
# time step.
# ------------------------------------------------------------------------------------------------------------------

LUGRE_STEPS = (4, 20)
"""Fewest and most steps within a sampling period of about 1 ms: bristles are stiff."""
RESOLVED = 0.16  # angle, in rad, by which the joint on its bristles may oscillate within a step
MEAN_SPEEDS = 3  # iterations for the mean speed of a step
RINGING_SPEED = 2.0  # times the speed to which bristles bent to break-away accelerate the joint
SMALLEST = 1e-8  # least share of the deflection that is forgotten in a step: a smaller one would lose digits
NEURAL_STEPS = 4


@dataclass(frozen=True)
class Torque:
    """Recorded torque over S windows of ``length`` sampling periods.

    ``samples`` (N,) is the torque of the whole recording, ``starts`` (S,) the first sample of each window.
    """

    samples: Array
    starts: NDArray[np.int64]
    length: int

    def held(self, step: int, delay: Array) -> Array:
        """Torque (C, S) during sampling period number ``step`` of each window, delayed by ``delay`` (C, 1) periods.

        A fractional delay interpolates between two periods.
        """
        at = self.starts + step - delay
        low = np.floor(at).astype(np.int64)
        weight = at - low
        last = len(self.samples) - 1
        first, second = np.clip(low, 0, last), np.clip(low + 1, 0, last)
        return np.asarray((1.0 - weight) * self.samples[first] + weight * self.samples[second])

    def centred(self, delay: Array) -> Array:
        """Torque (C, S) at the start of each window: the mean of the values held before and after that instant."""
        return 0.5 * (self.held(0, delay) + self.held(-1, delay))


def simulate(
    candidate: Candidate,
    theta: Array,
    torque: Torque,
    q: Array,
    v: Array,
    period: float,
    stride: int,
    direction: Array | None = None,
    friction: Array | None = None,
) -> Array:
    """Simulate one joint over S windows for C parameter vectors.

    Returns the positions after every ``stride`` sampling periods, (length // stride + 1, C, S), rad or m. ``q`` and
    ``v`` (C, S) are the positions and speeds at the start of the windows, ``theta`` (k, C) the parameters of
    ``candidate``, ``torque`` the recorded torque, ``period`` is the sampling period (s). With a ``direction`` (S,), +1
    or -1, the joint is taken to slide that way all the time, even where a simulation with wrong parameters would stop:
    then positions are smooth functions of the parameters. ``friction`` (C, S) is the force of the bristles at the
    start, for a law with a state.
    """
    columns = [row[:, None] for row in theta]
    advance: Any
    if direction is not None and candidate.jumps:
        advance = _Sliding(candidate, columns, period, direction)
    elif friction is not None:
        advance = _Bristles(candidate, columns, period, friction)
    else:
        advance = (_Smooth if candidate.name == "neural" else _Sticking)(candidate, columns, period)
    delay = columns[-1]
    positions = np.empty((torque.length // stride + 1, *q.shape))
    positions[0] = q
    state = advance.start(q, v)
    for k in range(torque.length):
        state = advance.step(state, torque.held(k, delay))
        if (k + 1) % stride == 0:
            positions[(k + 1) // stride] = state[0]
    return positions


class _Sliding:
    """Integrator for laws that jump at zero speed, where the direction of sliding is given: midpoint rule."""

    def __init__(self, candidate: Candidate, theta: list[Array], period: float, direction: Array) -> None:
        self.candidate, self.theta, self.h, self.direction = candidate, theta, period, direction

    def start(self, q: Array, v: Array) -> tuple[Array, ...]:
        return q, v

    def step(self, state: tuple[Array, ...], u: Array) -> tuple[Array, ...]:
        q, v = state
        h, J = self.h, self.theta[0]
        net = u - self.candidate.gravity_torque(q + 0.5 * h * v, self.theta)
        a = (net - self.candidate.torque(v, self.theta, self.direction)) / J
        a = (net - self.candidate.torque(v + 0.5 * h * a, self.theta, self.direction)) / J
        return q + h * (v + 0.5 * h * a), v + h * a


class _Sticking:
    """Integrator for laws that jump at zero speed, with sticking.

    A step is the midpoint rule with a constant direction of sliding; it is cut at the instant at which the joint stops.
    """

    def __init__(self, candidate: Candidate, theta: list[Array], period: float) -> None:
        self.candidate, self.theta, self.h, self.J = candidate, theta, period, theta[0]
        zero = np.zeros_like(theta[0])
        self.forward = candidate.torque(zero, theta, 1.0)
        self.backward = candidate.torque(zero, theta, -1.0)

    def start(self, q: Array, v: Array) -> tuple[Array, ...]:
        return q, v

    def step(self, state: tuple[Array, ...], u: Array) -> tuple[Array, ...]:
        q, v = state
        h = self.h
        net = u - self.candidate.gravity_torque(q + 0.5 * h * v, self.theta)
        starting = (net > self.forward).astype(float) - (net < self.backward)
        direction = np.where(v == 0.0, starting, np.sign(v))
        sliding = np.abs(direction)
        a = (net - self.candidate.torque(v, self.theta, direction)) * sliding / self.J
        a = (net - self.candidate.torque(v + 0.5 * h * a, self.theta, direction)) * sliding / self.J
        after = v + h * a
        stops = after * direction < 0.0
        if not stops.any():
            return q + 0.5 * h * (v + after), after
        share = np.where(stops, v / np.where(stops, v - after, 1.0), 1.0)
        rest = (1.0 - share) * h
        level = np.where(starting > 0.0, self.forward, self.backward)
        again = np.where(stops & (starting != 0.0), (net - level) / self.J * rest, 0.0)
        q = q + 0.5 * share * h * (v + np.where(stops, 0.0, after)) + 0.5 * again * rest
        return q, np.where(stops, again, after)


class _Smooth:
    """Integrator for continuous laws: linearly implicit steps, stable for friction that is steep at low speed."""

    def __init__(self, candidate: Candidate, theta: list[Array], period: float) -> None:
        self.candidate, self.theta, self.J = candidate, theta, theta[0]
        self.h = period / NEURAL_STEPS
        values = candidate.law_values(theta)
        units = (len(values) - 1) // 2
        self.f, self.w, self.viscous = values[:units], values[units:-1], values[-1]

    def start(self, q: Array, v: Array) -> tuple[Array, ...]:
        return q, v

    def step(self, state: tuple[Array, ...], u: Array) -> tuple[Array, ...]:
        q, v = state
        for _ in range(NEURAL_STEPS):
            h = self.h
            net = u - self.candidate.gravity_torque(q + 0.5 * h * v, self.theta)
            friction, slope = self.viscous * v, self.viscous
            for f, w in zip(self.f, self.w, strict=True):
                bent = np.tanh(w * v)
                friction = friction + f * bent
                slope = slope + f * w * (1.0 - bent * bent)
            # 2 J dv/h + slope dv = 2 (net - friction): the trapezoidal rule, linearised
            dv = (net - friction) / (self.J / h + 0.5 * np.maximum(slope, -self.J / h))
            q, v = q + h * (v + 0.5 * dv), v + dv
        return q, v


class _Bristles:
    """Integrator for the LuGre law: at a step's mean speed the deflection and its mean over the step are exact.

    The mean of the deflections at both ends in place of the exact one would spoil stiffness and damping: bristles that
    bend back from break-away to sliding do so in less than a step.
    """

    def __init__(self, candidate: Candidate, theta: list[Array], period: float, friction: Array) -> None:
        self.candidate, self.theta, self.J = candidate, theta, theta[0]
        self.s0, self.s1, self.excess, self.coulomb, self.viscous, self.speed = candidate.law_values(theta)
        self.friction = friction
        self.period = period
        angle = period * float(np.sqrt(np.max(self.s0 / self.J)))
        self.steps = int(np.clip(np.ceil(angle / RESOLVED), *LUGRE_STEPS))
        # at most this speed the joint can come to rest within a period, or ring on its bristles
        level = self.excess + self.coulomb
        self.slow = np.abs(level) * (period / self.J + RINGING_SPEED / np.sqrt(self.s0 * self.J))

    def start(self, q: Array, v: Array) -> tuple[Array, ...]:
        return q, v, self.friction / self.s0

    def step(self, state: tuple[Array, ...], u: Array) -> tuple[Array, ...]:
        near = (np.abs(state[1]) < self.slow).any(axis=0)  # windows in which steady sliding is not certain
        if self.steps == LUGRE_STEPS[0] or near.all():
            return self._advanced(state, u, self.steps)
        found = np.empty((3, *u.shape))
        for part, steps in ((near, self.steps), (~near, LUGRE_STEPS[0])):
            found[:, :, part] = self._advanced(tuple(each[:, part] for each in state), u[:, part], steps)
        return tuple(found)

    def _advanced(self, state: tuple[Array, ...], u: Array, steps: int) -> tuple[Array, ...]:
        """Solve ``dz/dt = v - x z/h`` with the mean speed, ``x = h sigma0 |v| / g(v)``, and ``J dv = h (u - tau_f)``.

        After a step of length h ``z+ = e^-x z + h p v``, the mean deflection is ``p z + h r v`` with
        ``p = (1 - e^-x)/x`` and ``r = (1 - p)/x``. The mean speed follows from them, and they from it: by iteration.
        """
        q, v, z = state
        h, s0, b = self.period / steps, self.s0, self.viscous
        decay, damping, inertia = -h * s0, self.s1 / h, self.J / h
        for _ in range(steps):
            net = u - self.candidate.gravity_torque(q + 0.5 * h * v, self.theta)
            driving, spring, damper = net + (inertia - 0.5 * b) * v, s0 * z, damping * z
            mean = v
            for _ in range(MEAN_SPEEDS):
                ratio = mean / self.speed
                level = self.excess * np.exp(-ratio * ratio) + self.coulomb
                x = np.minimum(decay * np.abs(mean) / level, -SMALLEST)  # -x of the formulas
                forgotten = np.expm1(x)
                p = forgotten / x
                gain = 0.5 * h * p
                resistance = (0.5 * decay) * ((1.0 - p) / x) + damping * gain
                after = driving - spring * p - resistance * v - damper * forgotten
                after = after / (inertia + 0.5 * b + resistance)
                mean = 0.5 * (v + after)
            z = z + gain * (v + after) + forgotten * z
            q, v = q + h * mean, after
        return q, v, z


# ------------------------------------------------------------------------------------------------------------------
# Windows of a recording, and the noise of the positions simulated over them.
# ------------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Windows:
    """A recording cut into S short windows over which the joint is simulated.

    ``period`` is the sampling period (s), ``torque`` the recorded torque of the windows. Positions are compared every
    ``stride`` periods: ``measured`` (m, S) are the recorded ones, rad (m), and ``used`` (m, S) marks those that belong
    to a window, which may be shorter than the longest. ``q0``, ``v0`` (S,) are estimated positions and speeds at the
    start, with the standard deviations ``q0_std``, ``v0_std``. ``block`` (S,) is the number of the longer stretch that
    a window belongs to; blocks are held out or resampled as a whole. ``resolution`` is that of the encoder, rad (m).
    ``direction`` (S,), +1 or -1, is the direction of sliding if it is constant in each window, otherwise None.
    ``a0`` (S,) is the acceleration at the start, ``smoothed`` the torque after the low-pass filter that gave it.
    """

    period: float
    stride: int
    torque: Torque
    smoothed: Torque
    measured: Array
    q0: Array
    v0: Array
    a0: Array
    q0_std: float
    v0_std: float
    used: NDArray[np.bool_]
    block: NDArray[np.int64]
    resolution: float
    direction: Array | None = None

    def __len__(self) -> int:
        return len(self.q0)

    @property
    def points(self) -> int:
        """Number of positions that are compared, over all windows."""
        return int(np.count_nonzero(self.used))

    def by_length(self) -> list[tuple[NDArray[np.int64], Windows]]:
        """Short and long windows apart: their numbers and the windows, cut to the longest of them.

        Windows are short that take at most half as long as the longest: to simulate them further is lost time.
        """
        points = np.asarray(np.count_nonzero(self.used, axis=0))
        long = points > (len(self.measured) + 1) // 2
        found = []
        for numbers in (np.flatnonzero(~long), np.flatnonzero(long)):
            if len(numbers):
                part, most = self.of(numbers), int(np.max(points[numbers]))
                torque = replace(part.torque, length=(most - 1) * self.stride)
                found.append(
                    (numbers, replace(part, torque=torque, measured=part.measured[:most], used=part.used[:most]))
                )
        return found

    def of(self, chosen: NDArray[Any]) -> Windows:
        """The ``chosen`` windows, given by a mask (S,) or by their numbers."""
        torque, smoothed = (replace(each, starts=each.starts[chosen]) for each in (self.torque, self.smoothed))
        return replace(
            self, torque=torque, smoothed=smoothed, measured=self.measured[:, chosen],
            q0=self.q0[chosen], v0=self.v0[chosen], a0=self.a0[chosen],
            direction=None if self.direction is None else self.direction[chosen],
            used=self.used[:, chosen], block=self.block[chosen],
        )  # fmt: skip


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

STEP = 1e-4  # step of forward differences, relative to a parameter's scale
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
FRICTION_STEP = 1e-3  # step of finite differences of that force
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
    return ShootingFit(
        candidate, theta, start, noise, found.sigma, found.cost, found.shifted[:, 0], work.free, found.normal,
        found.gradient,
    )  # fmt: skip


def rigid_limit(found: ShootingFit, law: Candidate) -> ShootingFit:
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


def likely_noise(found: ShootingFit, windows: Windows) -> Noise:
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
            self.prior = np.array([windows.q0_std, RINGING_UNCERTAINTY * windows.v0_std, FRICTION_STD])
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


# ------------------------------------------------------------------------------------------------------------------
# Standard deviations of the estimates by resampling blocks of windows (block bootstrap).
#
# The covariance from the Hessian of a fit assumes independent residuals and an exact friction law. Estimates from
# blocks drawn with replacement vary as those from different parts of the recording do, without these assumptions.
# ------------------------------------------------------------------------------------------------------------------

RESAMPLES = 400


def resampled(found: ShootingFit, blocks: NDArray[np.int64], seed: int) -> Array:
    """Draw blocks with replacement and estimate the parameters from each draw; returns (k, resamples).

    ``found`` is the fit to all windows, ``blocks`` (S,) the number of the block of each window, ``seed`` that of the
    draws. Each estimate is one Gauss-Newton step from the fit.
    """
    groups = np.unique(blocks, return_inverse=True)[1]
    count, f = int(np.max(groups)) + 1, len(found.free)
    H, g = np.zeros((count, f, f)), np.zeros((count, f))
    np.add.at(H, groups, found.normal)
    np.add.at(g, groups, found.gradient)
    g -= g.mean(axis=0)  # the search ends near the optimum, where the gradient is not quite zero
    rng = np.random.default_rng(seed)
    drawn = rng.multinomial(count, np.full(count, 1.0 / count), size=RESAMPLES).astype(float)
    normal, gradient = np.einsum("bg,gjk->bjk", drawn, H), drawn @ g
    size = np.einsum("bjj->bj", normal)
    normal[:, np.arange(f), np.arange(f)] += 1e-10 * size + 1e-300
    steps = np.linalg.solve(normal, gradient[:, :, None])[:, :, 0]
    free = np.repeat(found.candidate.to_free(found.theta)[:, None], RESAMPLES, axis=1)
    logs = found.candidate.is_logarithmic[found.free]
    free[found.free] -= np.where(logs, np.clip(steps, -3.0, 3.0), steps).T
    return found.candidate.clipped(found.candidate.from_free(free))
