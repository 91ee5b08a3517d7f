"""Design of a frequency response experiment: amplitude of the excitation, speed of the joint, and its strokes.

The joint moves at a constant speed above the peak of the speed that the excitation adds, so that friction never changes
its sign. The speed is chosen so that encoder quantisation does not repeat from period to period. A path that exceeds
the range of the joint is split into strokes back and forth, each of whole periods of the excitation.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from rrrgen.base.arrays import Array
from rrrgen.base.errors import InputError
from rrrgen.lab.design.plan import ResponseDesign, ResponsePlan, ResponseRun
from rrrgen.lab.design.signals import SIGNALS, excitation_signal
from rrrgen.robot.model.mechanism import follower_limits, limits_at

if TYPE_CHECKING:
    from rrrgen.robot.spec import RobotSpec

LARGEST_RMS = 7.0
"""Largest rms of the excitation that is chosen, rad/s^2 (m/s^2)."""
TORQUE_SHARE = 0.4
"""Share of the torque limit, and of the acceleration limit, that the peak of the excitation may take."""
SPEED_MARGIN = 2.5
"""Speed of the joint over the largest speed that the excitation adds to a rigid arm.

The motor of a flexible joint swings up to twice as far, and friction that reverses for a millisecond biases all lines.
"""
SPEED_SHARE = 0.9
RANGE_SHARE = 0.95
FRACTION = 0.5 * (3.0 - math.sqrt(5.0))
"""Of speed x period / resolution: the golden section, of which no small multiple is nearly whole."""
FEWEST_PERIODS = 2
DEFAULT_RESOLUTION = 1e-5


def design_response(
    model: Any, plan: ResponsePlan, rate: float, seed: int = 0, spec: RobotSpec | None = None
) -> ResponseDesign:
    """Design the runs of the experiment ``plan`` for the compiled robot ``model`` at the sampling ``rate`` (Hz).

    ``seed`` is that of the random phases; ``spec`` is the robot with the limits to keep, that of the model if None.
    Raises :class:`InputError` if the joint cannot execute the plan, because its speed, range or torque is too small, or
    if a period is no whole number of samples.
    """
    spec = model.spec if spec is None else spec
    names = tuple(joint.name for joint in spec.joints)
    i, samples = plan.joint_index(names), _samples(plan, rate)
    omega = 2.0 * math.pi * np.array([plan.bandwidth[0] if k == i else plan.bandwidth[1] for k in range(model.n)])
    kp, kd = omega**2, 2.0 * plan.damping * omega
    rng = np.random.default_rng(seed)
    periodic = plan.signal != "noise"
    postures = plan.postures or (_middle(spec),)
    runs: list[ResponseRun] = []
    for p, posture in enumerate(postures, start=1):
        _check_posture(spec, posture, p, i)
        for r in range(1, plan.realisations + 1):
            count = samples if periodic else samples * plan.periods * (plan.settle + 1)  # for the most strokes
            shape = excitation_signal(plan.signal, plan.band, count, rate, rng)
            n = shape * _rms(model, spec, plan, i, posture, float(np.abs(shape).max()))
            speed = _speed(spec, plan, i, n, rate, float(kp[i]), float(kd[i]), samples if periodic else None)
            name = f"{names[i]}_posture{p}_realisation{r}"
            runs += _strokes(spec, plan, i, posture, speed, n, samples / rate, name, (p, r), samples)
    return ResponseDesign(
        robot=model.name,
        joint=i,
        joint_name=names[i],
        signal=plan.signal,
        period=1.0 / rate,
        signal_period=samples if periodic else None,
        kp=tuple(kp.tolist()),
        kd=tuple(kd.tolist()),
        runs=tuple(runs),
    )


def _middle(spec: RobotSpec) -> tuple[float, ...]:
    """Default posture (n,): position 0 for each joint, or the middle of its range if this does not contain 0."""
    posture = []
    for joint in spec.joints:
        lower, upper = joint.limits.lower, joint.limits.upper
        if lower is None or upper is None or float(lower) < 0.0 < float(upper):
            posture.append(0.0)
        else:
            posture.append(0.5 * (float(lower) + float(upper)))
    return tuple(posture)


def _check_posture(spec: RobotSpec, posture: tuple[float, ...], number: int, moving: int) -> None:
    """Raise InputError for a ``posture`` with a wrong number of joints, or with a joint outside its range.

    ``number`` is that of the posture, for the message; the joint ``moving`` (from 0) is not checked.
    """
    if len(posture) != spec.n:
        raise InputError(f"posture {number} has {len(posture)} joint positions, the robot {spec.n}")
    for k, (position, joint) in enumerate(zip(posture, spec.joints, strict=True)):
        lower, upper = joint.limits.lower, joint.limits.upper
        below, above = lower is not None and position < lower, upper is not None and position > upper
        if k != moving and (below or above):
            raise InputError(f"posture {number} has joint {joint.name} at {position:.4g}, outside its range")
    for follower in follower_limits(spec):
        position = sum(f * x for f, x in zip(follower.factors, posture, strict=True))
        below, above = (
            follower.lower is not None and position < follower.lower,
            follower.upper is not None and position > follower.upper,
        )
        if follower.factors[moving] == 0.0 and (below or above):
            raise InputError(f"posture {number} has joint {follower.name} at {position:.4g}, outside its range")


def _samples(plan: ResponsePlan, rate: float) -> int:
    """Number of samples of one period; raises InputError for plans that are invalid for any robot."""
    samples = round(plan.period * rate)
    if abs(samples - plan.period * rate) > 1e-6 * samples or samples < 2:
        raise InputError(f"the period of {plan.period:g} s is no whole number of samples at {rate:g} Hz")
    if plan.signal not in SIGNALS:
        raise InputError(f"the signal is one of {', '.join(SIGNALS)}, not {plan.signal!r}")
    if plan.periods < FEWEST_PERIODS or plan.settle < 0 or plan.realisations < 1:
        raise InputError(f"record {FEWEST_PERIODS} periods at least, better ten, of one realisation at least")
    if min(*plan.bandwidth, plan.damping) <= 0.0:
        raise InputError("the bandwidths and the damping of the loops are positive")
    return samples


def _rms(model: Any, spec: RobotSpec, plan: ResponsePlan, i: int, posture: tuple[float, ...], crest: float) -> float:
    """RMS of the excitation of joint ``i``, rad/s^2 (m/s^2): that of the plan, or what torque and acceleration allow.

    ``crest`` is the peak of the excitation divided by its RMS. Raises :class:`InputError` if the peak of that of the
    plan alone exceeds a limit.
    """
    if plan.rms is not None and not plan.rms > 0.0:
        raise InputError(f"the rms of the excitation is positive, not {plan.rms:g}")
    limits, bounds = spec.joints[i].limits, []
    if limits.torque is not None and model.beta is not None:
        inertia = float(model.mass_matrix(np.array(posture, dtype=float))[i, i])
        bounds.append(("torque", float(limits.torque), inertia * crest))
    if limits.acceleration is not None:
        bounds.append(("acceleration", float(limits.acceleration), crest))
    if plan.rms is None:
        return min([LARGEST_RMS, *(TORQUE_SHARE * limit / peak for _, limit, peak in bounds)])
    for name, limit, peak in bounds:
        if plan.rms * peak > limit:
            raise InputError(
                f"the excitation of joint {i + 1} with the rms {plan.rms:g} takes up to {plan.rms * peak:.3g} of its "
                f"{name}, whose limit is {limit:.3g}; take {TORQUE_SHARE * limit / peak:.3g} at most"
            )
    return plan.rms


def _speed(
    spec: RobotSpec, plan: ResponsePlan, i: int, n: Array, rate: float, kp: float, kd: float, samples: int | None
) -> float:
    """Mean speed of joint ``i``, rad/s (m/s), that keeps its sign under the excitation ``n``.

    In one period of the excitation (``samples``) the joint moves by no whole number of encoder steps, so that
    quantisation does not repeat. ``kp`` (1/s^2) and ``kd`` (1/s) are the loop gains. Raises :class:`InputError` if the
    limit of the speed is too small, also for the speed of the plan.
    """
    drive = spec.joints[i].drive
    resolution = (drive and drive.encoder_resolution) or DEFAULT_RESOLUTION
    slowest, allowed = _added_speed(n, rate, kp, kd), spec.joints[i].limits.velocity
    if plan.speed is not None:
        if not plan.speed > 0.0:
            raise InputError(f"the speed of the joint is positive, not {plan.speed:g}; strokes reverse by themselves")
        steps = plan.speed * plan.period / resolution
        if samples is not None and abs(steps - round(steps)) < 0.05:
            better = (math.floor(steps) + FRACTION) * resolution / plan.period
            raise InputError(
                f"at {plan.speed:g} the joint moves {steps:.6g} encoder steps of {resolution:g} in a period: nearly a "
                f"whole number, so that quantisation repeats; take {better:.9g}"
            )
        if allowed is not None and plan.speed + slowest > float(allowed):
            raise InputError(
                f"joint {i + 1} moves at {plan.speed:.3g}, to which the excitation adds up to {slowest:.3g}; its limit "
                f"is {float(allowed):.3g}: lower the speed or the rms"
            )
        return plan.speed
    wanted = SPEED_MARGIN * slowest
    if samples is not None:
        wanted = (math.ceil(wanted * plan.period / resolution) + FRACTION) * resolution / plan.period
    if allowed is not None and wanted + slowest > SPEED_SHARE * float(allowed):
        raise InputError(
            f"joint {i + 1} must move at {wanted:.3g} so that the excitation, which adds up to {slowest:.3g}, never "
            f"turns it; its limit is {float(allowed):.3g}: lower the rms, or raise the lowest frequency"
        )
    return wanted


def _added_speed(n: Array, rate: float, kp: float, kd: float) -> float:
    """Peak of the speed that the excitation ``n`` adds to a rigid joint in its loop, ``s/(s^2 + kd s + kp) n``."""
    s = 2j * np.pi * np.fft.rfftfreq(len(n), 1.0 / rate)
    speed = np.fft.irfft(np.fft.rfft(n) * s / (s**2 + kd * s + kp), len(n))
    return float(np.abs(speed).max())


def _strokes(
    spec: RobotSpec,
    plan: ResponsePlan,
    i: int,
    posture: tuple[float, ...],
    speed: float,
    n: Array,
    period: float,
    name: str,
    numbers: tuple[int, int],
    samples: int,
) -> list[ResponseRun]:
    """Plan the motion of joint ``i`` at constant ``speed`` as one run, or several back and forth if its range is short.

    ``n`` is the excitation, ``period`` the sampling period (s), ``samples`` the length of an excitation period.
    ``numbers`` are those of posture and realisation.
    """
    limits = limits_at(spec, i, posture)
    lower, upper = (None if v is None else float(v) for v in (limits.lower, limits.upper))
    room = math.inf if lower is None or upper is None else RANGE_SHARE * (upper - lower)
    lead = plan.settle * period
    most = plan.periods if math.isinf(room) else math.floor((room / speed - lead) / period)
    if most < FEWEST_PERIODS:
        raise InputError(
            f"joint {i + 1} has room for {max(most, 0)} periods of {period:g} s at {speed:.3g} after a start of "
            f"{lead:g} s, and {FEWEST_PERIODS} are the least: a shorter period, or a smaller rms and with it speed"
        )
    count = math.ceil(plan.periods / most)
    run_periods = math.ceil(plan.periods / count)
    length = (run_periods + plan.settle) * samples
    runs = []
    for k in range(count):
        direction = -1.0 if k % 2 else 1.0
        start = list(posture)
        start[i] = _start(posture[i], lower, upper, direction, speed * length * period / samples)
        part = n[k * length : (k + 1) * length] if plan.signal == "noise" else np.resize(n, length)
        label = name if count == 1 else f"{name}_stroke{k + 1}"
        runs.append(ResponseRun(label, *numbers, tuple(start), direction * speed, plan.settle * samples, part))
    return runs


def _start(position: float, lower: float | None, upper: float | None, direction: float, travel: float) -> float:
    """Position, rad or m, from which the joint starts a run of constant mean speed that covers the distance ``travel``.

    It is the stated ``position`` if the whole run then stays between ``lower`` and ``upper``; otherwise the run is
    centred in that range, or moved away from the only limit. ``direction`` is +1 or -1.
    """
    low, high = -math.inf if lower is None else lower, math.inf if upper is None else upper
    end = position + direction * travel
    if low <= min(position, end) and max(position, end) <= high:
        return position
    reserve = 0.5 * (1.0 / RANGE_SHARE - 1.0) * travel
    if math.isinf(low):
        centre = high - reserve - 0.5 * travel
    elif math.isinf(high):
        centre = low + reserve + 0.5 * travel
    else:
        centre = 0.5 * (low + high)
    return centre - 0.5 * direction * travel
