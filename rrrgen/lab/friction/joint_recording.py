"""The motion and torque of one joint, taken from the recording of a robot whose other joints stand still."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rrrgen.base.arrays import Array
from rrrgen.base.errors import DerivationError, InputError
from rrrgen.base.yamltext.signal_units import TIME, unit_of_factor
from rrrgen.lab.data.clock import clock_factor
from rrrgen.lab.data.mapping import LogMapping
from rrrgen.lab.data.reconstruction import Butterworth
from rrrgen.lab.data.recordings import Log, check_robot
from rrrgen.lab.estimate.statistics import rms
from rrrgen.lab.friction.joint_simulation import Torque, Windows
from rrrgen.lab.response.response_file import ResponseRecording
from rrrgen.verify.references.numeric_robot import chain_of

PERIOD = 1e-3  # s; faster recordings are reduced to about this
CUTOFF = 50.0  # Hz, of the low-pass filter that gives the states at the start of windows
SHORTEST = 15.0  # s; 10 s leave the Stribeck speed undetermined in simulations, 30 s are enough
WINDOW = 0.2  # s, longest window in fast motion
SLOW_WINDOW = 0.06  # s, longest window in slow or unstable motion
FAST = 0.3  # times the rms speed: faster motion counts as fast
GROWTH = 3.0  # logarithm by which an error may grow within a window of fast motion
SPACING = 5e-3  # s between two positions at which simulation and recording are compared
ROUGH = 5.0  # factor by which initial states are less certain where the joint may start, stop or ring on its bristles
BLOCK = 2.0  # s: windows within a block are held out or resampled together
LEAST_POINTS = 6  # compared positions that a window needs
MARGIN = 8  # samples at the ends of a stretch at which only the torque is used
LEAST_COUNTS = 200  # encoder steps that the joint has to move
LEAST_SLIDING = 2.0  # s of sliding that are needed in each direction
PARALLEL = 1e-6  # sine or 1 - cosine of an angle between directions below which they count as parallel
STILL = 0.02  # times the range of the moving joint: largest motion of a joint that counts as locked


@dataclass(frozen=True, eq=False)
class JointData:
    """Recorded motion and torque of one joint, sampled at the constant ``period`` (s).

    ``q`` (N,) is the position in rad (m), ``u`` (N,) the torque in N m (N), where ``u[k]`` acts from sample k to the
    next. ``usable`` (N,) marks known torques. ``stretches`` are the uninterrupted parts as (first sample, last + 1),
    ``resolution`` is that of the encoder in rad (m).
    """

    name: str
    period: float
    q: Array
    u: Array
    usable: NDArray[np.bool_]
    stretches: tuple[tuple[int, int], ...]
    resolution: float

    @cached_property
    def motion(self) -> tuple[Array, Array, Array]:
        """Position, speed and acceleration, (N,) each, from the recorded positions by a zero-phase low-pass filter."""
        cutoff = min(CUTOFF, 0.2 / self.period)
        parts = []
        for first, last in self.stretches:
            t = np.arange(last - first) * self.period
            motion = Butterworth(cutoff)(t, self.q[first:last, None])
            parts.append(np.column_stack([motion.q, motion.dq, motion.ddq]))
        q, dq, ddq = np.concatenate(parts).T
        return q, dq, ddq

    @cached_property
    def smoothed(self) -> Array:
        """Torque (N,), N m (N), after the zero-phase low-pass filter of :attr:`motion`."""
        from scipy.signal import butter, sosfiltfilt

        sections = butter(4, min(CUTOFF, 0.2 / self.period), fs=1.0 / self.period, output="sos")
        return np.concatenate([sosfiltfilt(sections, self.u[first:last]) for first, last in self.stretches])

    @cached_property
    def speed(self) -> float:
        """Root mean square of the speed, rad/s (m/s), the scale for thresholds."""
        return float(rms(self.motion[1]))

    @property
    def speed_noise(self) -> float:
        """Standard deviation of the filtered speed due to the encoder: white rounding error up to the cut-off."""
        cutoff = min(CUTOFF, 0.2 / self.period)
        return float(2.0 * np.pi * self.resolution * np.sqrt(cutoff**3 / 3.0 * self.period / 6.0))

    @property
    def slow(self) -> float:
        """Speed above which the direction of sliding is certain, rad/s (m/s)."""
        return max(0.02 * self.speed, 6.0 * self.speed_noise)

    @cached_property
    def sliding(self) -> NDArray[np.bool_]:
        """Samples (N,) at which the joint moves and has not changed direction within 30 ms."""
        from scipy.ndimage import binary_dilation

        dq = self.motion[1]
        turning = np.abs(dq) < self.slow
        turning[1:] |= dq[1:] * dq[:-1] < 0.0  # a fast reversal has no slow sample
        for first, last in self.stretches:  # filtered speeds are poor at the ends
            turning[[first, last - 1]] = True
        return np.asarray(~binary_dilation(turning, iterations=round(0.03 / self.period)) & self.usable)

    def windows(self, growth: Array) -> Windows:
        """Consecutive short windows over the whole recording, except where the torque is unknown.

        ``growth`` (N,) is the rate, 1/s, at which an error of the state grows because friction falls with the speed.
        The low-pass filter, which gives the initial states, rounds off reversals: they are less certain here.
        """
        windows = self._tile(self.usable, growth)
        return replace(windows, q0_std=ROUGH * windows.q0_std, v0_std=ROUGH * windows.v0_std)

    def sliding_windows(self, growth: Array) -> Windows:
        """Windows in which the joint slides in one direction without sticking.

        Positions simulated over such a window are smooth functions of the parameters. ``growth`` (N,) is the rate, 1/s,
        at which an error of the state grows.
        """
        windows = self._tile(self.sliding, growth)
        return replace(windows, direction=np.sign(windows.v0))

    def _tile(self, allowed: NDArray[np.bool_], growth: Array) -> Windows:
        """Cut the samples with ``allowed`` (N,) True into windows of at most 0.2 s in fast and 0.06 s in slow motion.

        Windows are shorter, too, where friction that falls with the speed makes the motion unstable: there an error of
        the initial state may grow like e^(60 t), and hides what the parameters do.
        """
        length, stride = self._grid
        inside = np.zeros(len(self.q), np.int8)
        for a, b in self.stretches:
            inside[a + MARGIN : b - MARGIN - length] = 1
        fast = (np.abs(self.motion[1]) > FAST * self.speed) & (growth * WINDOW < GROWTH)
        kinds = np.where(allowed, 1 + fast, 0) * inside
        edges = np.concatenate([[0], np.flatnonzero(np.diff(kinds)) + 1, [len(kinds)]])
        starts, lengths = [], []
        for first, last in pairwise(edges.tolist()):
            if kinds[first]:
                most = length if kinds[first] == 2 else max(round(SLOW_WINDOW / self.period), LEAST_POINTS * stride)
                for start in range(first, last - LEAST_POINTS * stride, most):
                    starts.append(start)
                    lengths.append(min(most, last - 1 - start))
        return self._cut(np.array(starts, np.int64), np.array(lengths, np.int64))

    @property
    def _grid(self) -> tuple[int, int]:
        """Length of the longest window and distance of two compared positions, both in sampling periods."""
        length = max(round(WINDOW / self.period), 4)
        stride = max(1, min(round(SPACING / self.period), length // 10))
        return length - length % stride, stride

    def _cut(self, starts: NDArray[np.int64], lengths: NDArray[np.int64]) -> Windows:
        length, stride = self._grid
        q, dq, ddq = self.motion
        ticks = np.arange(0, length + 1, stride)
        return Windows(
            period=self.period,
            stride=stride,
            torque=Torque(self.u, starts),
            smoothed=Torque(self.smoothed, starts),
            measured=self.q[starts + ticks[:, None]],
            q0=q[starts],
            v0=dq[starts],
            a0=ddq[starts],
            q0_std=self.resolution,
            v0_std=max(3.0 * self.speed_noise, 1e-3 * self.speed),
            used=ticks[:, None] <= lengths,
            block=(starts * self.period // BLOCK).astype(np.int64),
            resolution=self.resolution,
        )


@dataclass(frozen=True)
class RecordedJoint:
    """Data of a recorded joint from the robot file.

    ``gravity`` is the number of coefficients of its gravity torque: 2 for ``a cos q + b sin q``, 1 for a constant
    force, 0 for none. ``resolution`` is that of its encoder, rad (m), None if the file does not state it; ``units`` are
    those of its speed and torque. ``revolute`` says whether it turns.
    """

    name: str
    revolute: bool
    gravity: int
    resolution: float | None
    units: tuple[str, str]


def recorded_joint(spec: Any, recording: LogMapping | Log, joint: str) -> RecordedJoint:
    """Look up what the robot file ``spec`` says about ``joint``, the moving joint of a recording.

    The recording, or its mapping, may hold all joints of the robot or only some, ``joint`` among them.
    Raises :class:`InputError` if names or units of the recording do not match the robot.
    """
    names = [joint_spec.name for joint_spec in spec.joints]
    if joint not in names:
        raise InputError(f"robot '{spec.name}' has no joint '{joint}'; its joints are {', '.join(names)}")
    recorded = recording.joints if isinstance(recording, Log) else recording.names
    if len(recorded) == len(names) and not isinstance(recording, Log):
        check_robot(recording, spec)
    unknown = [name for name in recorded if name not in names]
    if unknown or joint not in recorded:
        raise InputError(
            f"the recording holds the joints {', '.join(recorded)}: they must be joints of the robot "
            f"({', '.join(names)}), '{joint}' among them"
        )
    row = spec.joints[names.index(joint)]
    resolution = None if row.drive is None else row.drive.encoder_resolution
    units = ("rad/s", "N m") if row.is_revolute else ("m/s", "N")
    return RecordedJoint(joint, row.is_revolute, _gravity_coefficients(spec, names.index(joint)), resolution, units)


def _gravity_coefficients(spec: Any, joint: int) -> int:
    """Number of coefficients of the gravity torque of joint number ``joint``: 2 if revolute, 1 if prismatic, or 0.

    It is 0 if gravity causes no torque in any posture: a revolute axis is always vertical, a prismatic one always
    horizontal. Earlier joints that are prismatic, or revolute about vertical axes, do not tilt the axis.
    """
    chain = chain_of(spec)
    gravity = chain.gravity / max(float(np.linalg.norm(chain.gravity)), 1e-300)
    rotation = chain.base[:3, :3]
    for k, (before, after) in enumerate(chain.around_joints()):
        axis = (rotation @ before[:3, :3])[:, 2]
        along = abs(float(gravity @ axis))
        if k == joint:
            if not chain.revolute[k]:
                return int(along > PARALLEL)
            return 0 if along > 1.0 - PARALLEL or not chain.gravity.any() else 2
        if chain.revolute[k] and along < 1.0 - PARALLEL:
            return 2 if chain.revolute[joint] else 1
        rotation = rotation @ before[:3, :3] @ after[:3, :3]
    raise AssertionError(f"no joint {joint}")


def joint_data(log: Any, joint: str, resolution: float | None = None) -> JointData:
    """Extract motion and torque of the joint named ``joint`` from the recording ``log``.

    ``log`` is a :class:`rrrgen.lab.data.recordings.Log`. ``resolution`` is that of the encoder, rad (m), used if the
    recorded positions do not lie on a grid. Raises :class:`InputError` for a recording without the joint or its torque,
    :class:`DerivationError` if other joints move or the motion does not determine friction.
    """
    if joint not in log.joints:
        raise InputError(f"the recording has no joint '{joint}'; it has {', '.join(log.joints)}")
    if log.tau is None:
        raise InputError(f"the recording has no torque of joint '{joint}', from which friction could be estimated")
    i = log.joints.index(joint)
    _others_stand_still(log, i)
    stretches: list[tuple[int, int]] = []
    columns: list[tuple[Array, Array, NDArray[np.bool_]]] = []
    factor = max(1, round(PERIOD / log.period))
    count = 0
    for part in log.parts():
        rows = len(part) // factor * factor
        if rows * log.period < 1.0:
            continue
        torque = part.tau[:rows, i].reshape(-1, factor)
        known = part.valid[:rows, i].reshape(-1, factor).all(axis=1) & np.isfinite(torque).all(axis=1)
        columns.append((part.q[:rows:factor, i], np.where(known, torque.mean(axis=1), 0.0), known))
        stretches.append((count, count + len(known)))
        count += len(known)
    period = log.period * factor
    if count * period < SHORTEST:
        raise DerivationError(
            f"{count * period:.3g} s of recording without a gap are too little to tell inertia, gravity and friction "
            f"of joint '{joint}' apart: record {SHORTEST:g} s at least, better 40 s "
            "(`rrrgen experiment excite --friction`)"
        )
    q, u, usable = (np.concatenate(parts) for parts in zip(*columns, strict=True))
    if not usable.any() or float(np.ptp(u[usable])) == 0.0:
        raise DerivationError(
            f"the torque of joint '{joint}' is constant or unknown in the whole recording: check that its column is "
            "the measured torque"
        )
    data = JointData(joint, period, q, u, usable, tuple(stretches), encoder_step(q, resolution))
    _check_motion(data)
    return data


def resting_record(log: Any, joint: str) -> ResponseRecording:
    """Torque and position of a joint excited below break-away, from the longest uninterrupted stretch of ``log``."""
    if joint not in log.joints or log.tau is None:
        raise InputError(f"a recording of presliding needs position and torque of joint '{joint}'")
    i = log.joints.index(joint)
    part = max(log.parts(), key=len)
    name = "presliding" if log.mapping is None else log.mapping.name or log.mapping.files[0].path.name
    return ResponseRecording(name, log.period, part.tau[:, i], part.tau[:, i], part.q[:, i])


def encoder_step(q: Array, stated: float | None) -> float:
    """Step of an encoder, rad (m): the spacing of the grid on which the positions ``q`` (N,) lie.

    If they lie on no grid it is ``stated``; if that is None too, a millionth of the range of motion.
    """
    steps = np.abs(np.diff(q))
    real = steps[steps > 1e-12 * max(1.0, float(np.ptp(q)))]
    if len(real) == 0:
        return stated or 1e-12
    for divisor in (1.0, 2.0, 3.0):  # the smallest step that occurs may be a few steps of the grid
        step = float(real.min()) / divisor
        whole = real / step
        if np.mean(np.abs(whole - np.round(whole)) < 0.05) > 0.9:
            return step
    return stated or max(1e-6 * float(np.ptp(q)), 1e-9)


def _others_stand_still(log: Any, moving: int) -> None:
    """Raise :class:`DerivationError` if other joints than number ``moving`` move.

    Their inertia torques would be taken for friction of this joint.
    """
    ranges = np.ptp(log.q, axis=0)
    for k, name in enumerate(log.joints):
        if k != moving and ranges[k] > max(STILL * ranges[moving], 0.01):
            raise DerivationError(
                f"joint '{name}' moves over {ranges[k]:.3g} while joint '{log.joints[moving]}' is tested: (14.15) "
                "holds for one moving joint; lock the others and record again"
            )


def _check_motion(data: JointData) -> None:
    """Raise :class:`DerivationError` if the motion does not excite friction in both directions."""
    span = float(np.ptp(data.q))
    if span < LEAST_COUNTS * data.resolution or data.speed <= 3.0 * data.speed_noise:
        raise DerivationError(
            f"joint '{data.name}' hardly moves in this recording ({span:.3g} in all, encoder steps of "
            f"{data.resolution:.3g}): there is no excitation from which friction could be estimated"
        )
    dq = data.motion[1]
    for direction, name in ((1.0, "forward"), (-1.0, "backward")):
        seconds = float(np.count_nonzero(data.sliding & (direction * dq > 0.0))) * data.period
        if seconds < LEAST_SLIDING:
            _check_clock(data)
            raise DerivationError(
                f"joint '{data.name}' slides {name} for {seconds:.2g} s only: friction needs motion in both "
                f"directions, {LEAST_SLIDING:g} s each at least, better a multisine and slow reversals "
                "(`rrrgen experiment excite --friction`)"
            )


def _check_clock(data: JointData) -> None:
    """Raise :class:`DerivationError` if sampling and motion are those of times in another unit."""
    spread = float(np.std(data.q))
    frequency = data.speed / (2.0 * np.pi * spread) if spread > 0.0 else np.nan
    factor = clock_factor(data.period, frequency)
    if factor == 1.0:
        return
    size = f"{factor:.4g} times too small" if factor > 1.0 else f"{1.0 / factor:.4g} times too large"
    unit = unit_of_factor(TIME, factor)
    what = f", as those of a clock in {unit} that is read in s" if unit else ""
    raise DerivationError(
        f"the times of the recording are {size}{what}: a sampling period of {data.period:.4g} s and a motion of "
        f"{frequency:.3g} Hz; with the other unit {factor * data.period:.4g} s and {frequency / factor:.3g} Hz"
    )
