"""Estimates stiffness, damping and rotor inertia of elastic joints, together with the parameters of the links.

The encoders read the rotors, at theta; a spring and a damper drive the link of the joint, at q (Spong 1987):

    tau = J ddtheta + f(dtheta) + tau_t,        tau_t = K (theta - q) + D (dtheta - dq) = Y(q, dq, ddq) beta

with friction f at the rotors (viscous, Coulomb, offset) and the base parameters beta of the links. For given K, D, J
and f the recording itself tells the torque tau_t that the spring transmits, hence the positions of the links,

    q = theta - c (tau_t - T dtau_t + T^2 ddtau_t - T^3 dddtau_t),           c = 1/K,  T = D/K,

to third order in the short time T, without a state to be estimated. What is left is linear in beta and is projected
out (variable projection, Golub and Pereyra 1973); a damped search finds c, T, J and f. Theta is differentiated seven
times and tau_t five times: all signals pass one low-pass filter whose derivatives are exact, so that they are those
of one and the same motion. The base parameters and J can only be told apart by frequencies near the antiresonance at
which the link moves against its spring.

A drive holds its torque from one sample to the next. The record, the mean over a sample about its time (or the command,
aligned by half a sample, which is the same), is then too small by ``x cot x`` with ``x = pi f dt``: the torques of
a wave of frequency f average to ``cos x`` of those commanded, and act with ``sin(x)/x`` of them. The filter of the
torques makes up for it.

Where encoders at the links were recorded too, their readings of ``theta - q`` are further rows.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import ceil, pi, sqrt
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rrrgen.base.arrays import Array
from rrrgen.base.errors import DerivationError, InputError
from rrrgen.lab.data.recordings import Log
from rrrgen.lab.estimate.linear import project, solve
from rrrgen.lab.estimate.regression import correlated_covariance, least_squares
from rrrgen.lab.estimate.search import Search, search
from rrrgen.lab.estimate.statistics import correlation_lags, residual_whiteness, rms
from rrrgen.lab.estimate.tsqr import Rows, factor_rows
from rrrgen.lab.identify.scores import UNEXPLAINED, not_explained

DAMPER = 3  # order of the expansion in T = D/K; the odd orders hold the damping, which two made 1 % too small
ORDERS = 4 + DAMPER  # of the derivatives of the positions: accelerations, of torques that accelerate rotors
SHARPNESS = 4  # of the filter: its response is flat at zero up to the derivative of order 2 SHARPNESS - 1
REACH = 9.0  # half the length of the filter in its own widths: beyond, it is zero to round-off
LARGEST_BANDWIDTH = 1.0 / 6.0  # times the sampling rate
HELD_BELOW = 1.4  # pi f dt up to which the record of a held torque is made up for; tan grows without bound at pi/2
ROWS_PER_PERIOD = 3.0  # of the bandwidth
LADDER = sqrt(2.0)  # ratio of the bandwidths that are tried
LOWEST = 5.0  # Hz, the first of them
LONG_ENOUGH = 35.0  # periods of the bandwidth in a recording, of which the filters take 14
STARTS = (0.25, 0.5, 1.0)  # antiresonances from which the search starts, times the bandwidth
SHARES = (0.3, 0.6)  # and shares of the rotor in the inertia of a joint
ROUGH_STEPS, STEPS, PASSES = 8, 40, 3
WORSE = 2  # bandwidths in a row that tell the compliances less than the one before: the last to be tried
SETTLED = 1e-5  # relative decrease of the squares at which the search ends
LONG = 0.3  # angle by which the damper lags behind, rad, from which on the expansion in T is doubtful
TELLING = 3.0  # standard deviations by which a compliance differs from zero
FRICTION = ("viscous", "coulomb", "offset")
PARAMETERS = ("stiffness", "damping", "rotor_inertia", *FRICTION)


@dataclass(frozen=True, eq=False)
class ElasticJoints:
    """Estimated elastic joints of n ``joints``: ``values`` (n, 6) with standard deviations ``std`` (n, 6).

    The columns are stiffness K (N m/rad), damping D (N m s/rad), rotor inertia J (kg m^2) at the joint, and friction of
    the rotor: viscous (N m s/rad), Coulomb and offset (N m); for prismatic joints N/m and so on. ``least`` (n,) is the
    lower bound of the stiffness of joints in whose torques no elasticity shows, NaN for the others: their K, D and J
    are NaN. ``beta`` (b,) are the base parameters of the links. ``error`` and ``rigid_error`` (n,) are the relative
    torque errors of this model and of the rigid one, within ``bandwidth``, Hz.
    """

    joints: tuple[str, ...]
    values: Array
    std: Array
    least: Array
    beta: Array
    error: Array
    rigid_error: Array
    bandwidth: float
    notes: tuple[str, ...] = ()

    @property
    def unexplained(self) -> NDArray[np.bool_]:
        """Which joints (n,) have torques that the model does not explain: nothing is to be written then."""
        return self.error > UNEXPLAINED

    def parameters(self, spec: Any) -> tuple[tuple[str, ...], tuple[str, ...]]:
        """Names and units of the values, joint after joint."""
        turning = ("N m/rad", "N m s/rad", "kg m^2", "N m s/rad", "N m", "N m")
        sliding = ("N/m", "N s/m", "kg", "N s/m", "N", "N")
        names = tuple(f"{parameter}_{joint}" for joint in self.joints for parameter in PARAMETERS)
        return names, tuple(u for joint in spec.joints for u in (sliding if joint.type == "prismatic" else turning))

    def lines(self) -> list[str]:
        """The estimate as text, with what to write into the robot file."""
        lines, written = [], []
        for joint, (k, d, inertia, *_), (of_k, of_d, of_inertia, *_), least, unexplained in zip(
            self.joints, self.values, self.std, self.least, self.unexplained, strict=True
        ):
            if unexplained:
                continue
            if np.isnan(k):
                lines.append(f"{joint}: no elasticity shows; the stiffness is above {least:.3g}")
                continue
            lines.append(
                f"{joint}: stiffness {k:.5g} +- {of_k:.2g}, damping {d:.4g} +- {of_d:.2g}, "
                f"rotor inertia {inertia:.5g} +- {of_inertia:.2g}"
            )
            written.append(
                f"  {joint}: drive: {{inertia: {inertia:.6g}, stiffness: {k:.6g}, damping: {max(d, 0.0):.4g}}}"
            )
        before, after = (100.0 * float(rms(error)) for error in (self.rigid_error, self.error))
        lines.append(
            f"relative torque error below {self.bandwidth:.3g} Hz: {after:.3g} % with elastic joints, "
            f"{before:.3g} % with rigid ones"
        )
        if written and not self.unexplained.any():
            lines += ["in the robot file, in SI:", *written]
        return [*lines, *(f"note: {note}" for note in self.notes)]

    def to_json(self) -> dict[str, Any]:
        """The values, deviations and errors as plain data for JSON; None for what is not determined."""
        rows = zip(self.joints, self.values, self.std, self.least, strict=True)
        return {
            "joints": {
                joint: {
                    **dict(zip(PARAMETERS, values, strict=True)),
                    "std": dict(zip(PARAMETERS, std, strict=True)),
                    "least_stiffness": least,
                }
                for joint, values, std, least in rows
            },
            "base_parameters": self.beta,
            "relative_error": self.error,
            "relative_error_of_the_rigid_model": self.rigid_error,
            "bandwidth": self.bandwidth,
            "notes": list(self.notes),
        }


class Signals(NamedTuple):
    """Filtered signals of N rows: derivatives of the positions ``theta`` (8, N, n) and torques ``tau`` (6, N, n).

    ``friction`` (6, N, n, 3) are those of speed, its sign and 1. ``link`` (N, n) are positions of the links, or None.
    ``use`` (N, n) is False where the filter reaches a sample that is not valid, ``stretch`` (N,) numbers stretches.
    """

    t: Array
    theta: Array
    tau: Array
    friction: Array
    link: Array | None
    use: NDArray[np.bool_]
    stretch: NDArray[np.int64]


def identify_elastic_joints(
    model: Any,
    recordings: Sequence[Log],
    links: Sequence[Log] = (),
    bandwidth: float | None = None,
    progress: Any = None,
    held: bool = True,
) -> ElasticJoints:
    """Estimate the elastic joints of ``model`` from ``recordings`` of the rotors, seen at the joints.

    ``links`` are recordings of the link positions at the same times, one for each recording, or none. Without a
    ``bandwidth`` (Hz) of the filters, that is taken at which the stiffnesses have the smallest relative deviations.
    ``progress(done, total, message)`` is called as the work proceeds. ``held`` says that the drives hold their torques
    from one sample of the recording to the next; otherwise the record is one of torques that change smoothly.

    Raises InputError for recordings that do not fit the robot or each other, DerivationError if no joint shows that it
    is elastic.
    """
    _check(model, recordings, links)
    rate = 1.0 / max(recording.period for recording in recordings)
    shortest = min(recording.span[1] for recording in recordings)
    most = LARGEST_BANDWIDTH * rate
    if bandwidth is not None and not 0.0 < bandwidth <= most:
        raise InputError(
            f"a bandwidth of {bandwidth:g} Hz: it must lie between 0 and {most:.4g} Hz, a sixth of the rate"
        )
    ladder = _ladder(most, shortest) if bandwidth is None else _ladder(bandwidth, shortest)
    fits: list[_Fit] = []
    for number, cutoff in enumerate(ladder):
        if progress is not None:
            progress(number, len(ladder), "elastic joints")
        fits.append(_fit(model, filter_recordings(recordings, links, cutoff, held), cutoff, fits[-1] if fits else None))
        vague = [fit.vagueness for fit in fits]
        if bandwidth is None and len(fits) > WORSE and min(vague[-WORSE:]) > vague[-WORSE - 1]:
            break  # wider ones add noise alone
    best = fits[int(np.argmin(vague))] if bandwidth is None else fits[-1]
    elastic_joints = best.result(recordings[0].joints)
    if not np.any(np.isfinite(elastic_joints.values[:, 0])):
        if elastic_joints.unexplained.any():
            raise DerivationError(elastic_joints.notes[0])
        bounds = ", ".join(
            f"{name} above {k:.3g}" for name, k in zip(elastic_joints.joints, elastic_joints.least, strict=True)
        )
        raise DerivationError(
            "no joint shows that it is elastic: excite the joints up to their resonances. "
            f"The stiffnesses, N m/rad (N/m), are {bounds}"
        )
    return elastic_joints


def _check(model: Any, recordings: Sequence[Log], links: Sequence[Log]) -> None:
    spec = model.spec
    if spec.drives is not None or spec.loops or spec.floating_base:
        kind = "coupled drives" if spec.drives is not None else "closed loops" if spec.loops else "a floating base"
        raise InputError(f"{spec.name} has {kind}: elastic joints are estimated where every motor drives its own joint")
    if links and len(links) != len(recordings):
        raise InputError(f"{len(links)} recordings of link positions beside {len(recordings)} of the rotors")
    for recording in (*recordings, *links):
        if len(recording.joints) != model.n:
            raise InputError(f"a recording of {len(recording.joints)} joints for a robot with {model.n}")
    for recording, link in zip(recordings, links, strict=False):
        if len(link) != len(recording) or np.max(np.abs(link.t - recording.t)) > 1e-3 * recording.period:
            raise InputError("the positions of the links are not recorded at the times of the rotors")
    if any(recording.tau is None for recording in recordings):
        raise InputError("the recording has no torques: nothing can be estimated from it")


def _ladder(most: float, duration: float) -> list[float]:
    """Bandwidths, the last of them ``most``, from the lowest on that a recording of the ``duration`` (s) allows."""
    lowest = max(LOWEST, LONG_ENOUGH / duration)
    if most < lowest:
        raise InputError(
            f"{duration:.3g} s are too short for a bandwidth of {most:.3g} Hz: the filters need {lowest:.3g} Hz or more"
        )
    count = int(np.log(most / lowest) / np.log(LADDER)) + 1
    return [most / LADDER**k for k in reversed(range(count))]


# ------------------------------------------------------------------------------------------------------------------
# The filter: a low-pass and its derivatives, which differ by factors of i omega alone.
# ------------------------------------------------------------------------------------------------------------------


def kernels(bandwidth: float, period: float, held: bool = False) -> list[Array]:
    """Symmetric FIR filters for the derivatives of order 0 to 7 of a signal below ``bandwidth`` (-3 dB, Hz).

    Their frequency responses are ``(i w)^k Q(4, x)`` with ``x = (w s)^2 / 2`` and the regularized incomplete gamma
    function Q: ``exp(-x) (1 + x + x^2/2 + x^3/6)``, a Gaussian that is flattened at low frequencies. Those for means
    over a sample of what is ``held`` between samples give the derivatives of what acts.
    """
    from scipy.special import gammaincc, gammainccinv

    width = sqrt(2.0 * float(gammainccinv(SHARPNESS, sqrt(0.5)))) / (2.0 * pi * bandwidth)
    half = ceil(REACH * width / period)
    size = 16 * half
    w = 2.0 * pi * np.fft.rfftfreq(size, period)
    response = gammaincc(SHARPNESS, 0.5 * (w * width) ** 2)
    if held:
        x = np.clip(0.5 * w * period, 1e-9, HELD_BELOW)
        response *= np.tan(x) / x
    filters = []
    for order in range(ORDERS + 1):
        kernel = np.fft.irfft(response * (1j * w) ** order, size)
        filters.append(np.concatenate([kernel[-half:], kernel[: half + 1]]))
    return filters


def filter_recordings(recordings: Sequence[Log], links: Sequence[Log], bandwidth: float, held: bool) -> Signals:
    """Filter all stretches of the ``recordings`` and take :data:`ROWS_PER_PERIOD` rows per period of ``bandwidth``.

    ``held`` says that the drives hold their torques from one sample to the next.
    """
    stretches: list[Signals] = []
    for recording, link in zip(recordings, links or (None,) * len(recordings), strict=True):
        bank, of_torque = (kernels(bandwidth, recording.period, is_held) for is_held in (False, held))
        step = max(1, int(1.0 / (ROWS_PER_PERIOD * bandwidth * recording.period)))
        positions = iter(link.parts()) if link is not None else None
        for part in recording.parts():
            beside = next(positions).q if positions is not None else None
            for signals in _stretch(part.align_torques(), beside, bank, of_torque, step):
                stretches.append(signals._replace(stretch=np.full(len(signals.t), len(stretches), np.int64)))
    if not stretches:
        raise InputError(f"every stretch of the recording is shorter than a filter of {bandwidth:.3g} Hz")
    joined = [np.concatenate([s[k] for s in stretches], axis=axis) for k, axis in ((0, 0), (1, 1), (2, 1), (3, 1))]
    link_rows = None if stretches[0].link is None else np.concatenate([s.link for s in stretches if s.link is not None])
    use, stretch = np.concatenate([s.use for s in stretches]), np.concatenate([s.stretch for s in stretches])
    return Signals(joined[0], joined[1], joined[2], joined[3], link_rows, use, stretch)


def _stretch(
    part: Any, link: Array | None, bank: Sequence[Array], of_torque: Sequence[Array], step: int
) -> Iterator[Signals]:
    """The rows of one stretch, none where it is too short: the sign of the speed is filtered twice.

    ``bank`` are the filters of all signals but the torque, which has its own, ``of_torque``.
    """
    from scipy.ndimage import minimum_filter1d
    from scipy.signal import fftconvolve

    half = len(bank[0]) // 2
    if len(part) <= 4 * half + step:
        return

    def through(x: Array, order: int, filters: Sequence[Array] = bank) -> Array:
        return np.asarray(fftconvolve(x, filters[order][:, None], mode="valid", axes=0))

    mean = part.q.mean(axis=0)  # of which no derivative is to have round-off
    speed = through(part.q - mean, 1)
    inner = slice(half, len(part) - half)  # the samples at which the speed is known
    theta = np.stack([through((part.q - mean)[inner], order)[::step] for order in range(ORDERS + 1)])
    theta[0] += mean
    tau = np.stack([through(part.tau[inner], order, of_torque)[::step] for order in range(ORDERS - 1)])
    sign = np.stack([through(np.sign(speed), order)[::step] for order in range(ORDERS - 1)])
    one = np.zeros_like(sign)
    one[0] = 1.0
    valid = minimum_filter1d(part.valid.astype(np.uint8), 2 * half + 1, axis=0)
    rows = slice(2 * half, len(part) - 2 * half, step)
    yield Signals(
        part.t[rows],
        theta,
        tau,
        np.stack([theta[1:ORDERS], sign, one], axis=-1),
        None if link is None else through(link[inner], 0)[::step],
        valid[rows] > 0,
        np.zeros(len(part.t[rows]), np.int64),
    )


# ------------------------------------------------------------------------------------------------------------------
# The fit at one bandwidth. Unknowns x (6 n,): compliances c, times T, rotor inertias J, and friction (n, 3) by joint.
# ------------------------------------------------------------------------------------------------------------------


def _fit(model: Any, signals: Signals, bandwidth: float, before: _Fit | None) -> _Fit:
    """The best of the fits from ``before``, the result of a lower bandwidth, and from several other starts.

    A few steps are taken from each start, on some of the rows, and from the best of them to the end.
    """
    fit = _Fit(model, signals, bandwidth)
    rough = fit.with_rows(slice(None, None, 3))
    starts = [*rough.starts(), *([] if before is None else [before.end.state])]
    if before is not None and np.all(before.elastic):
        starts = starts[-1:]
    x = min((rough.search_from(start, ROUGH_STEPS) for start in starts), key=lambda minimum: minimum.cost).state
    for _ in range(PASSES):
        fit.end = fit.search_from(x, STEPS)
        x = fit.end.state
        fit.reweight(x)
    fit.rigid_error = rough.rigid_error
    return fit.finish()


class _Fit:
    """The least-squares problem at one bandwidth: rows of the torques (N, n), and of link positions where there are."""

    end: Search[Array]
    beta: Array
    covariance: Array
    error: Array
    rigid_error: Array
    elastic: NDArray[np.bool_]
    vagueness: float

    def __init__(self, model: Any, signals: Signals, bandwidth: float) -> None:
        self.model, self.signals, self.bandwidth, self.n = model, signals, bandwidth, int(model.n)
        size = _rms(signals.tau[0], signals.use)
        largest = float(np.max(size))
        if not largest > 0.0:
            raise DerivationError("all torques of the recording are zero, or none of them is valid")
        if not np.any(signals.theta[1]):
            raise DerivationError("no joint moves in the recording")
        self.size = np.maximum(size, 1e-9 * largest)
        self.weights = 1.0 / self.size
        if signals.link is not None:
            read = _rms(signals.theta[0] - signals.link, signals.use)
            self.weights = np.append(self.weights, 1.0 / np.maximum(read, np.finfo(float).tiny))

    def with_rows(self, rows: slice) -> _Fit:
        """The same problem with some of the rows."""
        s = self.signals
        link = None if s.link is None else s.link[rows]
        some = Signals(
            s.t[rows], s.theta[:, rows], s.tau[:, rows], s.friction[:, rows], link, s.use[rows], s.stretch[rows]
        )
        return _Fit(self.model, some, self.bandwidth)

    # -- torques that are transmitted, deflections, rows -----------------------------------------------------------

    def transmitted_torque(self, x: Array) -> Array:
        """The torque of the springs and dampers and its derivatives of order 1 to 5, (6, N, n)."""
        s, (_, _, J, f) = self.signals, self._unknowns(x)
        return np.asarray(s.tau - J * s.theta[2:] - np.einsum("kNjp,jp->kNj", s.friction, f))

    def _unknowns(self, x: Array) -> tuple[Array, Array, Array, Array]:
        n = self.n
        return x[:n], x[n : 2 * n], x[2 * n : 3 * n], x[3 * n :].reshape(n, len(FRICTION))

    def _motion(self, x: Array, u: Array) -> tuple[Array, Array, Array]:
        """Positions, speeds and accelerations (N, n) of the links, behind springs and dampers that transmit ``u``.

        ``u`` (6, N, n) are those torques and their derivatives, as of :meth:`transmitted_torque`.
        """
        c, T, _, _ = self._unknowns(x)
        return tuple(self.signals.theta[:3] - c * _damped_deflection(u, T))

    def rows(self, x: Array) -> tuple[Array, Array]:
        """Regressor (N, m, b) of beta and right-hand side (N, m), of the torques and then of the link positions."""
        u = self.transmitted_torque(x)
        motion = self._motion(x, u)
        W, y = np.asarray(self.model.regressor(*motion)), u[0]
        if self.signals.link is not None:
            W = np.concatenate([W, np.zeros_like(W)], axis=1)
            y = np.concatenate([y, self.signals.link - motion[0]], axis=1)
        return W, y

    def derivatives(self, x: Array, beta: Array) -> Array:
        """Derivatives (N, m, 6 n) of ``y - W beta`` by the unknowns, at fixed beta."""
        s, n, (c, T, _, _) = self.signals, self.n, self._unknowns(x)
        u = self.transmitted_torque(x)
        motion = self._motion(x, u)
        derivatives = np.zeros((len(s.t), n if s.link is None else 2 * n, len(x)))
        for j in range(n):
            # of the transmitted torque, which J and friction change, and of the deflection
            effects = [-s.theta[2:, :, j], *(-s.friction[:, :, j, p] for p in range(len(FRICTION)))]
            places = [2 * n + j, *(3 * n + len(FRICTION) * j + p for p in range(len(FRICTION)))]
            mine = u[:, :, j]
            bends = [(j, _damped_deflection(mine, T[j])), (n + j, c[j] * _damped_by_time(mine, T[j]))]
            bends += [(k, c[j] * _damped_deflection(v, T[j])) for k, v in zip(places, effects, strict=True)]
            for k, v in zip(places, effects, strict=True):
                derivatives[:, j, k] = v[0]
            by = [self._torque_by(motion, order, j, beta) for order in range(3)]
            for k, bent in bends:
                derivatives[:, :n, k] += sum(part * moved[:, None] for part, moved in zip(by, bent, strict=True))
                if s.link is not None:
                    derivatives[:, n + j, k] = bent[0]
        return derivatives

    def _torque_by(self, motion: tuple[Array, Array, Array], order: int, j: int, beta: Array) -> Array:
        """Derivative (N, n) of the torques of the links by position, speed or acceleration (``order``) of joint j.

        By central differences, which are exact for speeds and accelerations: torques are of degree two in them.
        """
        step = (1e-4, 1.0, 1.0)[order]
        ahead, behind = (list(motion) for _ in range(2))
        move = step * np.eye(self.n)[j]
        ahead[order], behind[order] = motion[order] + move, motion[order] - move
        W = np.asarray(self.model.regressor(*ahead)) - np.asarray(self.model.regressor(*behind))
        return np.asarray(W @ beta / (2.0 * step))

    # -- search ----------------------------------------------------------------------------------------------------

    def linearise(self, x: Array) -> tuple[Array, Array]:
        """Weighted residuals with beta projected out, and their derivatives by the unknowns."""
        W, y = self.rows(x)
        weights = self._row_weights()
        A, right = (W * weights[..., None]).reshape(-1, W.shape[-1]), (y * weights).ravel()

        def derivative(beta: Array) -> Array:
            return -(self.derivatives(x, beta) * weights[..., None]).reshape(len(right), -1)

        r, J, fit = project(A, right, derivative)
        self.beta = fit.x
        return r, J

    def _row_weights(self) -> Array:
        use = self.signals.use if self.signals.link is None else np.tile(self.signals.use, 2)
        return np.where(use, self.weights, 0.0)

    def residual(self, x: Array) -> Array:
        """Residuals (N, m) at the unknowns ``x``, with the beta that fits best."""
        self.linearise(x)
        W, y = self.rows(x)
        return np.asarray(y - W @ self.beta)

    def search_from(self, x: Array, steps: int) -> Search[Array]:
        """The unknowns that fit best, from ``x``."""
        return search(x, self.linearise, moved=self._apply_step, steps=steps, small_gain=SETTLED)

    def _apply_step(self, x: Array, step: Array) -> Array:
        """The unknowns after a step: compliances and inertias stay positive and change by a factor of e at most."""
        n = self.n
        unknowns = x + step
        for part in (slice(0, n), slice(2 * n, 3 * n)):
            unknowns[part] = x[part] * np.exp(np.clip(step[part] / x[part], -1.0, 1.0))
        largest = LONG / (2.0 * pi * self.bandwidth)
        unknowns[n : 2 * n] = x[n : 2 * n] + np.clip(step[n : 2 * n], -largest, largest)
        return unknowns

    def reweight(self, x: Array) -> None:
        """Weights by the residuals at ``x``; never more than round-off of the torques deserves."""
        left = _rms(self.residual(x), np.tile(self.signals.use, self.weights.size // self.n))
        self.weights = 1.0 / np.maximum(left, 1e-12 / self.weights)

    def starts(self) -> Iterator[Array]:
        """Starts with antiresonances and shares of the rotors in the inertias that the rigid model has."""
        x = np.zeros(6 * self.n)
        x[3 * self.n :] = self._rigid_friction().ravel()
        motion = tuple(self.signals.theta[:3])
        inertia = np.array([np.mean(self._torque_by(motion, 2, j, self.beta)[:, j]) for j in range(self.n)])
        inertia = np.maximum(inertia, 1e-3 * float(np.max(np.abs(inertia))))
        for share in SHARES:
            for place in STARTS:
                start = x.copy()
                start[2 * self.n : 3 * self.n] = share * inertia
                start[: self.n] = 1.0 / ((1.0 - share) * inertia * (2.0 * pi * place * self.bandwidth) ** 2)
                yield start

    def _rigid_friction(self) -> Array:
        """Friction (n, 3) of the rigid model; its base parameters become beta, its relative errors ``rigid_error``."""
        s, n = self.signals, self.n
        rotor_columns = np.concatenate([s.theta[2][..., None], s.friction[0]], axis=-1)  # rotor inertia and friction
        drives = np.zeros((len(s.t), n, n, rotor_columns.shape[-1]))
        drives[:, range(n), range(n)] = rotor_columns
        A = np.concatenate([np.asarray(self.model.regressor(*s.theta[:3])), drives.reshape(len(s.t), n, -1)], axis=-1)
        weights = np.where(s.use, 1.0 / self.size, 0.0)
        fit = solve((A * weights[..., None]).reshape(-1, A.shape[-1]), (s.tau[0] * weights).ravel())
        self.beta = fit.x[: -drives.shape[2] * rotor_columns.shape[-1]]
        self.rigid_error = _rms(s.tau[0] - A @ fit.x, s.use) / self.size
        return np.asarray(fit.x[len(self.beta) :].reshape(n, -1)[:, 1:])

    # -- result ----------------------------------------------------------------------------------------------------

    def finish(self) -> _Fit:
        """Compute the results at the end of the search: residuals, deviations, and how vague the compliances are."""
        x, n = self.end.state, self.n
        left = self.residual(x)
        W, _ = self.rows(x)
        A = np.concatenate([-self.derivatives(x, self.beta), W], axis=-1)
        use = np.tile(self.signals.use, self.weights.size // n)
        rows = Rows(self.signals.t, A, left, use, self.signals.stretch)
        estimate = least_squares(factor_rows(rows), [str(k) for k in range(A.shape[-1])], self.weights)
        lags = max(correlation_lags(white) for white in residual_whiteness([rows], estimate.x))
        covariance = correlated_covariance([rows], estimate, lags, lambda x: x, np.eye(A.shape[-1]))
        self.covariance = covariance[: 6 * n, : 6 * n]
        self.error = _rms(left, use)[:n] / self.size
        c, spread = x[:n], np.sqrt(np.maximum(np.diag(self.covariance)[:n], 0.0))
        self.elastic = c > TELLING * spread
        self.vagueness = float(np.sum(np.log(np.maximum(spread, 1e-300) / np.maximum(np.abs(c), 1e-300))))
        return self

    def result(self, joints: Sequence[str]) -> ElasticJoints:
        """The estimate in the parameters that users know."""
        n, x, P = self.n, self.end.state, self.covariance
        c, T, J, f = self._unknowns(x)
        std = np.sqrt(np.maximum(np.diag(P), 0.0))
        elastic = self.elastic
        known = np.where(elastic, c, np.nan)
        k, of_f = np.arange(n), std[3 * n :].reshape(n, -1)
        mixed = std[n : 2 * n] ** 2 + (T / known) ** 2 * std[:n] ** 2 - 2.0 * T / known * P[k, n + k]
        values = np.column_stack([1.0 / known, T / known, np.where(elastic, J, np.nan), f])
        deviations = [
            std[:n] / known**2,
            np.sqrt(np.maximum(mixed, 0.0)) / known,
            np.where(elastic, std[2 * n : 3 * n], np.nan),
        ]
        highest = np.maximum(c, 0.0) + 2.0 * std[:n]
        least = np.where(elastic, np.nan, 1.0 / np.maximum(highest, np.finfo(float).tiny))
        return ElasticJoints(
            joints=tuple(joints),
            values=values,
            std=np.column_stack([*deviations, of_f]),
            least=least,
            beta=self.beta,
            error=self.error,
            rigid_error=self.rigid_error,
            bandwidth=self.bandwidth,
            notes=self._notes(joints, elastic),
        )

    def _notes(self, joints: Sequence[str], elastic: NDArray[np.bool_]) -> tuple[str, ...]:
        _, T, J, _ = self._unknowns(self.end.state)
        explained, notes = self.error <= UNEXPLAINED, []

        def those(which: NDArray[np.bool_]) -> str:
            return ", ".join(name for name, it in zip(joints, which, strict=True) if it)

        if not explained.all():
            notes.append(not_explained(f"the torques of {those(~explained)} are not explained", self.error[~explained]))
        slow = explained & (np.abs(T) * 2.0 * pi * self.bandwidth > LONG)
        if slow.any():
            notes.append(
                f"{those(slow)}: D/K is not short beside the periods in the recording, which the method presumes; a "
                "lower bandwidth may help"
            )
        wrong = explained & elastic & (J <= 0.0)
        if wrong.any():
            notes.append(f"{those(wrong)}: the rotor inertia is not positive: the elasticity is not that of a joint")
        return tuple(notes)


def _damped_deflection(u: Array, T: Array | float) -> Array:
    """Deflection times stiffness and its first two derivatives, (3, ..), under torques ``u`` (6, ..) with derivatives.

    ``(1 + T s)^-1 u`` to the order :data:`DAMPER` in the time T of the damper.
    """
    return np.asarray(sum((-T) ** k * u[k : k + 3] for k in range(DAMPER + 1)))


def _damped_by_time(u: Array, T: float) -> Array:
    """Derivative (3, ..) of :func:`_damped_deflection` by the time ``T``."""
    return np.asarray(sum(-k * (-T) ** (k - 1) * u[k : k + 3] for k in range(1, DAMPER + 1)))


def _rms(x: Array, use: NDArray[np.bool_]) -> Array:
    """Root mean square (m,) of the columns of x (N, m) over the samples in use."""
    counts = np.maximum(1, np.sum(use, axis=0))
    return np.asarray(np.sqrt(np.sum(np.where(use, x, 0.0) ** 2, axis=0) / counts))
