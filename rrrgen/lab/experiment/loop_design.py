"""Designs the control loop of the virtual robot from the arm: gains, observer, and their stability margin.

PD gains place the poles of every joint, with the others at rest, at its bandwidth: as fast as its load needs to bend
it little. In its lightest direction the arm is several times lighter than ``M_ii``, so the same gains cross over at a
several times higher frequency. There the observer must still be fast, and the delay of the hold small. Where no
observer keeps the modulus margin :data:`MARGIN` in all postures along the motion, all joints are slowed alike, and
then raised one by one as far as the margin lasts. The slowest observer that keeps it is taken, and where the steps of
the encoders would shake the drives, lower bandwidths. Where PD control with the margin is too soft for the load, the
torques of the model are fed forward. Where it is too slow to follow a motion at all, as for joints whose inertia
changes many times along it, the law is computed torque. What the experiment file states is kept, and warned of if its
margin is smaller.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache, partial
from typing import TYPE_CHECKING, Any

import numpy as np

from rrrgen.base.arrays import Array
from rrrgen.base.errors import Fault
from rrrgen.lab.data.kalman import kalman_matrices, quantisation_variance
from rrrgen.lab.plant.controllers import PD, BackwardDifference, ComputedTorque, ControlLaw, DeviationFilter, Observer
from rrrgen.lab.plant.experiment import SimulatedRecording
from rrrgen.lab.plant.loop_margin import LoopMargin, SampledArm, torque_noise
from rrrgen.lab.plant.tracking import Tracking, check_tracking

if TYPE_CHECKING:
    from rrrgen.lab.experiment.experiment_file import ControlSection
    from rrrgen.lab.plant.plant import Plant, RigidBody

MARGIN = 0.5
"""Modulus margin of a designed loop over all postures: sensitivity below 2, gain margin 2, phase margin 29 degrees."""

BANDWIDTH = 4.0
"""Least bandwidth that a design aims at, Hz: arms follow exciting motions of up to 1 Hz."""

SLOWEST = 1.0
"""Least bandwidth of a joint, Hz, with which PD control is taken where the law is free: that of exciting motions."""

BEND = 0.01
"""Share of its motion that the largest load may bend a joint by at rest: what the bandwidth aimed at is chosen for."""

SAGS = 0.1
"""Share of its motion by which the load may bend a joint at rest: where PD control alone is softer, the torques of the
model are fed forward. A step of the load overshoots by less than twice as much, and then :mod:`tracking` still passes.
"""

SMALL = 0.1
"""A joint that moves less than this share of what the others do is designed for this share of their motion."""

LOWEST = 1.0 / 64.0
"""Lowest designed bandwidth, relative to the one aimed at."""

STEP = 2.0 ** (-1.0 / 3.0)
"""Ratio of successive bandwidths that the design tries."""

OBSERVER_SPEED = 8.0
"""Least ratio of the pole frequency of a Kalman observer to the natural frequency of its loop."""

FASTEST = 10.0
"""Pole frequency of the fastest observer, times the sampling period: its poles are within 1e-4 of zero."""

NOISE = 0.1
"""Largest torque, in standard deviations over the largest torque of the motion, that the encoder steps may cause."""

GENTLE = 1.0
"""Acceleration, rad/s^2 (m/s^2), whose torque stands for that of the motion at a joint that takes less."""

POSTURES = 200
"""Number of postures along the motion over which the inertia is averaged."""

LIGHT, HEAVY, SPREAD = 5, 3, 16
"""How many of them the margin is computed in: those in which the arm is lightest and heaviest relative to its gains,
which the search looks at alone, and others spread over the motion.
"""


@dataclass(frozen=True)
class ControlledArm:
    """The arm that a loop is designed for, along a motion of ``duration`` s.

    ``masses`` (m, n, n) are the mass matrices of the links at times spread over the motion, with the drives where
    the joints are rigid; ``body`` and ``friction`` the model that computed torque uses. ``torques`` (N, n) are those
    that the motion takes without friction, ``rubbing`` (N, n) those of friction, ``load`` (n,) the largest sum of both,
    ``jerk`` (n,) the largest jerk, ``span`` (n,) how far the joints move; ``prismatic`` (n,) says which move along a
    line. ``resolution`` (n,) is that of the encoders for the design of observers, ``stepped`` whether the encoders
    round.
    """

    plant: Plant
    body: RigidBody
    friction: Any
    masses: Array
    duration: float
    torques: Array
    rubbing: Array
    load: Array
    jerk: Array
    span: Array
    prismatic: Array
    resolution: tuple[float, ...]
    stepped: bool
    period: float
    delay: int

    @property
    def moved(self) -> Array:
        """Mass matrices (m, n, n) that the drives accelerate at low frequencies: with the rotors of flexible joints."""
        joints = self.plant.joints
        return self.masses if joints is None else self.masses + np.diag(joints.rotor_inertia)

    @property
    def inertia(self) -> Array:
        """Mean inertia (n,) of every joint with the others at rest, kg m^2 (kg)."""
        return np.asarray(np.mean(np.diagonal(self.moved, axis1=1, axis2=2), axis=0))

    @property
    def reach(self) -> Array:
        """The motion (n,) of every joint that deviations are compared with, rad (m)."""
        largest = np.array([self.span[self.prismatic == kind].max() for kind in self.prismatic])
        return np.maximum(self.span, SMALL * largest)


@dataclass(frozen=True, eq=False)
class LoopDesign:
    """A control loop with its margin.

    ``margin`` was found over postures along the motion, the worst at ``instant`` (s). ``bandwidth`` (n,), Hz, is None
    where the gains are stated, ``asked`` (n,), Hz, what was aimed at. ``poles`` (rad/s) is the pole frequency of a
    designed Kalman observer, None for another. ``noise`` (n,) is the torque that the encoder steps cause, standard
    deviation in N m (N). ``stiffness`` (n,) is the torque per deviation, N m/rad (N/m). ``feedforward`` (N, n) are
    torques of the model along the motion, added to those of PD control, or None. ``instead`` (n,), Hz, are the
    bandwidths of the PD control that was too slow, None where the law is not chosen for that. ``warnings`` are about
    stated settings.
    """

    controller: ControlLaw
    observer: Observer
    margin: LoopMargin
    instant: float
    bandwidth: tuple[float, ...] | None
    asked: tuple[float, ...] | None
    poles: float | None
    noise: Array
    stiffness: Array
    feedforward: Array | None = None
    instead: tuple[float, ...] | None = None
    warnings: tuple[Fault, ...] = field(default=())

    @property
    def robust(self) -> bool:
        """Whether the loop is stable with the margin :data:`MARGIN`."""
        return not self.margin.unstable and self.margin.modulus >= MARGIN

    def lines(self) -> list[str]:
        """The design in words: gains, observer and margin, and a lower bandwidth than the one aimed at."""
        law = "PD control" if isinstance(self.controller, PD) else "computed torque"
        gains = "with stated gains" if self.bandwidth is None else f"of {_in_words(self.bandwidth)} Hz"
        if self.feedforward is not None:
            gains += " with the torques of the model fed forward"
        watch = "backward differences" if isinstance(self.observer, BackwardDifference) else "a Kalman observer"
        if self.poles is not None:
            watch += f" with its poles at {self.poles / (2.0 * math.pi):.3g} Hz"
        sentences = [f"{law} {gains}, {watch}: {self.margin_text()}"]
        if self.instead is not None:
            sentences.append(
                f"not PD control: with this margin it would have {_in_words(self.instead)} Hz, too slow for the motion "
                "(`--control pd` takes it anyway)"
            )
        if self.bandwidth is not None and self.asked is not None and self.bandwidth != self.asked:
            sentences.append(
                f"not {_in_words(self.asked)} Hz: it would not be robust, or the encoder steps would shake the drives; "
                "a higher rate or finer encoders allow more, and so does computed torque (`--control computed-torque`)"
            )
        return sentences

    def margin_text(self) -> str:
        """The margin in words."""
        where = f"at {self.margin.frequency:.3g} Hz in the posture at t = {self.instant:.3g} s"
        if self.margin.unstable:
            return f"unstable, {where} an oscillation grows by {self.margin.radius:.4g} a sample"
        return f"modulus margin {self.margin.modulus:.2f}, smallest {where} (at least {MARGIN} is robust)"

    def to_json(self) -> dict[str, Any]:
        """The design as plain data, for ``--json``."""
        return {
            "bandwidth": None if self.bandwidth is None else list(self.bandwidth),
            "observer_poles": None if self.poles is None else self.poles / (2.0 * math.pi),
            "stable": not self.margin.unstable,
            "modulus_margin": None if self.margin.unstable else self.margin.modulus,
            "margin_frequency": self.margin.frequency,
            "worst_instant": self.instant,
            "largest_pole": self.margin.radius,
        }


def design_loop(arm: ControlledArm, control: ControlSection) -> LoopDesign:
    """Design the loop of ``arm``: what ``control`` states is kept, everything else is chosen for the margin."""
    search = _LoopSearch(arm, control)
    loop = search.best()
    left_open = (control.kind, control.bandwidth, control.kp, control.jerk, control.feedforward)
    if left_open == (None,) * 5 and loop.bandwidth is not None and min(loop.bandwidth) < SLOWEST:
        model_based = _LoopSearch(arm, replace(control, kind="computed_torque"))
        cancelled = model_based.best()
        if model_based.good(cancelled) and cancelled.bandwidth is not None and min(cancelled.bandwidth) >= SLOWEST:
            return replace(cancelled, instead=loop.bandwidth)
    if loop.robust or not control.places:
        return loop
    stated = {key: place for key, place in control.places.items() if key in DECISIVE}
    if not stated:
        return loop
    free = replace(control, bandwidth=None, damping=1.0, kp=None, kd=None, observer="kalman", jerk=None, places={})
    return replace(loop, warnings=_warnings(loop, stated, _LoopSearch(arm, free).best()))


def check_loop(recording: SimulatedRecording, arm: ControlledArm, loop: LoopDesign) -> Tracking:
    """Check how ``arm`` followed its motion in the ``recording`` under ``loop``."""
    resolution = np.array(arm.resolution) if arm.stepped else np.zeros(len(arm.load))
    bandwidth = float(np.sqrt(loop.stiffness / arm.inertia).max()) / (2.0 * math.pi)
    return check_tracking(recording, arm.torques, arm.load, loop.stiffness, bandwidth, resolution, arm.prismatic)


DECISIVE = ("bandwidth", "damping", "kp", "kd", "observer", "jerk")
"""Keys of the control section on which the margin depends."""


def _warnings(loop: LoopDesign, stated: Mapping[str, Fault], free: LoopDesign) -> tuple[Fault, ...]:
    """The warning about the settings ``stated``, at the place of the first; ``free`` is the design without them."""
    place = min(stated.values())
    names = ", ".join(f"`{name}`" for name in stated)
    verb = "makes" if len(stated) == 1 else "make"
    message = f"{names} {verb} a loop that is not robust: {loop.margin_text()}"
    hint = f"without {'it' if len(stated) == 1 else 'them'}: {free.lines()[0]}"
    return (replace(place, message=message, hint=hint, severity="warning"),)


class _LoopSearch:
    """The search for the fastest bandwidth and the slowest observer with the margin."""

    def __init__(self, arm: ControlledArm, control: ControlSection) -> None:
        self.arm, self.control = arm, control
        whole, self.inertia = arm.moved, arm.inertia
        self.extreme = np.array([0])  # if the model cancels M(q), the loop is the same in all postures
        self.compared = self.extreme
        if control.kind != "computed_torque" or arm.plant.joints is not None or arm.plant.base is not None:
            self.extreme = _extreme(whole / np.sqrt(np.outer(self.inertia, self.inertia)))
            spread = np.linspace(0, len(whole) - 1, SPREAD).round().astype(int)
            self.compared = np.unique(np.concatenate([self.extreme, spread]))
        self.sampled_arm = lru_cache(maxsize=8)(self._sampled_arm)

    def best(self) -> LoopDesign:
        """The loop with the stated settings, or the fastest; with feedforward where the load would bend it too far."""
        control, pd = self.control, self.control.kind != "computed_torque"
        fed = self.arm.torques + self.arm.rubbing if pd and control.feedforward is not False else None
        stated = control.kp is not None and control.kd is not None
        if stated or control.bandwidth is not None:
            loop = self.at(None if stated else np.array(control.bandwidth))
            return replace(loop, feedforward=fed if control.feedforward else None)
        if control.feedforward is None:
            alone = self.fastest(self.aim())
            if fed is None or not self.sags(alone):
                return alone
        return replace(self.fastest(self.aim(fed is None)), feedforward=fed)

    def sags(self, loop: LoopDesign) -> bool:
        """Whether the load bends this loop at rest by more than :data:`SAGS` of the motion of a joint."""
        return bool(np.any(self.arm.load > SAGS * self.arm.reach * loop.stiffness))

    def fastest(self, asked: Array) -> LoopDesign:
        """The fastest loop with margin and quiet drives, no faster than ``asked`` (n,), Hz; else the best tried."""
        steps = round(math.log(LOWEST) / math.log(STEP))
        # no joint falls below the usual bandwidth for the load of others, unless it must
        floor = BANDWIDTH if self.possible(np.full(len(asked), BANDWIDTH)) else 0.0
        slowed = bisect_left(range(steps), True, key=lambda k: self.possible(np.maximum(asked * STEP**k, floor)))
        fastest = asked if slowed == 0 else self.raise_bandwidths(np.maximum(asked * STEP**slowed, floor), asked)
        best: LoopDesign | None = None
        for level in _slower(fastest, np.minimum(fastest, floor), max(1, steps - slowed)):
            tried = self.at(level)
            if best is None or self.good(tried) or _rank(tried) > _rank(best):
                best = tried
            if self.good(tried):
                break
        assert best is not None
        return replace(best, asked=tuple(asked.tolist()))

    def aim(self, loaded: bool = True) -> Array:
        """The bandwidths (n,) aimed at, Hz: :data:`BANDWIDTH`, or more where the load would bend the loop too far.

        PD control of the bandwidth w deviates by ``load / (J w^2)``, if no model carries the load.
        """
        arm, least = self.arm, np.full(len(self.arm.load), BANDWIDTH)
        moves = arm.reach > 0.0
        if self.control.kind == "computed_torque" or not loaded:
            return least
        needed = np.sqrt(arm.load / (self.inertia * BEND * np.where(moves, arm.reach, 1.0))) / (2.0 * math.pi)
        return np.where(moves, np.maximum(least, needed), least)

    def raise_bandwidths(self, bandwidth: Array, asked: Array) -> Array:
        """Bandwidths (n,) raised from ``bandwidth`` towards ``asked`` (n,), Hz, as far as the margin lasts.

        The joint that is farthest from its aim is raised first, until it cannot be raised any more: the joints with the
        heaviest load take the margin that all share.
        """
        free = set(range(len(asked)))
        while free:
            joint = max(free, key=lambda i: float(asked[i] / bandwidth[i]))
            tried = bandwidth.copy()
            tried[joint] = min(float(asked[joint]), float(bandwidth[joint]) / STEP)
            if tried[joint] > bandwidth[joint] and self.possible(tried):
                bandwidth = tried
            else:
                free.remove(joint)
        return bandwidth

    def good(self, loop: LoopDesign) -> bool:
        """Whether the loop is robust and the encoder steps do not shake the drives."""
        allowed = NOISE * np.maximum(self.arm.load, GENTLE * self.inertia)
        return loop.robust and (not self.arm.stepped or bool(np.all(loop.noise <= allowed)))

    def possible(self, bandwidth: Array) -> bool:
        """Whether the fastest observer gives the margin with these bandwidths (n,), Hz, in the extreme postures."""
        _, kp, kd = self.gains(bandwidth)
        observer, _ = self.observer(FASTEST / self.arm.period, lambda _: True)
        return self.enough(MARGIN, _octaves(2.0 * math.pi * float(bandwidth.min())), kp, kd, observer)

    def at(self, bandwidth: Array | None) -> LoopDesign:
        """The loop with bandwidths (n,), Hz, or the stated gains, and the slowest observer that keeps the margin."""
        controller, kp, kd = self.gains(bandwidth)
        speeds = np.sqrt(kp if isinstance(controller, ComputedTorque) else kp / self.inertia)
        octaves = _octaves(float(speeds.min()))
        whole = self.sampled_arm(octaves, False)
        aim, margin = MARGIN, None
        for _ in range(3):  # the other postures may need a little more than the extreme ones
            observer, poles = self.observer(
                float(speeds.max()),
                partial(self.enough, aim, octaves, kp, kd),
            )
            margin = whole.margin(observer.feedback(kp, kd))
            if poles is None or margin.unstable or margin.modulus >= MARGIN:
                break
            aim += MARGIN - margin.modulus
        assert margin is not None
        heavy = self.inertia if isinstance(controller, ComputedTorque) else np.ones(len(kp))
        rounding = np.array([quantisation_variance(step) ** 0.5 for step in self.arm.resolution])
        noise = heavy * rounding * [torque_noise(system) for system in observer.feedback(kp, kd)]
        posture = int(self.compared[margin.posture])
        instant = self.arm.duration * posture / max(1, len(self.arm.masses) - 1)
        stated = None if bandwidth is None else tuple(bandwidth.tolist())
        return LoopDesign(controller, observer, margin, instant, stated, stated, poles, noise, heavy * kp)

    def enough(self, aim: float, octaves: int, kp: Array, kd: Array, tried: Observer) -> bool:
        """Whether these gains and the observer ``tried`` have the margin ``aim`` in the extreme postures."""
        return self.sampled_arm(octaves, True).meets(aim, tried.feedback(kp, kd))

    def gains(self, bandwidth: Array | None) -> tuple[ControlLaw, Array, Array]:
        """The controller of these bandwidths (n,), Hz, or of the stated gains, with its gains kp and kd (n,)."""
        control = self.control
        computed = control.kind == "computed_torque"
        if bandwidth is None:
            kp, kd = np.array(control.kp, dtype=float), np.array(control.kd, dtype=float)
        else:
            omega = 2.0 * math.pi * bandwidth
            inertia = np.ones(len(self.inertia)) if computed else self.inertia
            kp, kd = inertia * omega**2, 2.0 * control.damping * inertia * omega
        if computed:
            law = ComputedTorque(self.arm.body, tuple(kp.tolist()), tuple(kd.tolist()), friction=self.arm.friction)
            return law, kp, kd
        return PD(tuple(kp.tolist()), tuple(kd.tolist())), kp, kd

    def observer(self, natural: float, enough: Callable[[Observer], bool]) -> tuple[Observer, float | None]:
        """The observer, and its pole frequency (rad/s) where it is designed; ``natural`` is that of the fastest loop.

        A designed one is the slowest that is ``enough``, or the fastest if none is: the margin grows with the speed of
        the observer where the loop is stable. All joints get the same poles, unless the jerk of the reference asks for
        faster ones: the largest jerk is the process noise of (14.29).
        """
        control, period = self.control, self.arm.period
        if control.observer == "difference":
            return BackwardDifference(period), None
        if control.jerk is not None:
            return self.observer_for_jerk(np.array(control.jerk, dtype=float)), None
        slow, fast = OBSERVER_SPEED * natural, FASTEST / period
        if slow >= fast or enough(self.observer_with_poles(slow)):
            return self.observer_with_poles(slow), slow
        if not enough(self.observer_with_poles(fast)):
            return self.observer_with_poles(fast), fast
        while fast > 1.05 * slow:
            middle = math.sqrt(slow * fast)
            slow, fast = (slow, middle) if enough(self.observer_with_poles(middle)) else (middle, fast)
        return self.observer_with_poles(fast), fast

    def observer_with_poles(self, poles: float) -> DeviationFilter:
        """The Kalman observer with the pole frequency ``poles`` (rad/s), faster where the reference jerks more.

        Readings of standard deviation R and a jerk of standard deviation Q give a filter of third order with its poles
        at ``(Q/R)^(1/3)``.
        """
        least = np.array([quantisation_variance(step) ** 0.5 for step in self.arm.resolution]) * poles**3
        return self.observer_for_jerk(np.maximum(self.arm.jerk, least))

    def observer_for_jerk(self, jerk: Array) -> DeviationFilter:
        """The Kalman observer for a jerk (n,) of this standard deviation, rad/s^3 (m/s^3)."""
        rows = [(step, max(float(top), 1e-3)) for step, top in zip(self.arm.resolution, jerk, strict=True)]
        period = self.arm.period
        designed = {row: kalman_matrices(period, quantisation_variance(row[0]), row[1] ** 2) for row in set(rows)}
        return DeviationFilter([designed[row].E for row in rows], [designed[row].k for row in rows])

    def _sampled_arm(self, octaves: int, extreme: bool) -> SampledArm:
        """The sampled arm for loops of about ``2^octaves`` rad/s, in all compared postures or only the extreme ones."""
        arm, plant = self.arm, self.arm.plant
        postures = self.extreme if extreme else self.compared
        return SampledArm.at(
            arm.masses[postures],
            plant.joints,
            plant.base,
            arm.period,
            delay=arm.delay,
            assumed=arm.moved[postures] if self.control.kind == "computed_torque" else None,
            slowest=2.0**octaves / (2.0 * math.pi),
        )


def _slower(bandwidth: Array, floor: Array, steps: int) -> Iterator[Array]:
    """Bandwidths (n,) from ``bandwidth`` down by ``steps`` steps, first no lower than ``floor`` (n,), then below it."""
    held = np.where(floor > 0.0, floor, bandwidth)
    levels = [np.maximum(bandwidth * STEP**k, held) for k in range(steps)]
    yield from levels[: 1 + next((k for k, level in enumerate(levels) if np.all(level == held)), steps)]
    yield from (held * STEP**k for k in range(1, steps))


def _in_words(values: Sequence[float]) -> str:
    """Numbers in words, a single one where they are all the same."""
    shown = [f"{value:.3g}" for value in values]
    return shown[0] if len(set(shown)) == 1 else ", ".join(shown)


def _octaves(natural: float) -> int:
    """A natural frequency (rad/s) in octaves, rounded down to even ones: the arm is sampled once for several."""
    return 2 * math.floor(0.5 * math.log2(natural))


def _rank(loop: LoopDesign) -> tuple[bool, float]:
    """How good a loop is that does not meet every aim: robust ones first, of these the quietest, then by the margin."""
    return loop.robust, (-float(loop.noise.max()) if loop.robust else loop.margin.modulus)


def _extreme(relative: Array) -> Array:
    """Indices of the extreme postures, from the mass matrices (m, n, n) relative to the gains, rising."""
    values = np.linalg.eigvalsh(relative)
    light, heavy = np.argsort(values[:, 0])[:LIGHT], np.argsort(-values[:, -1])[:HEAVY]
    return np.unique(np.concatenate([light, heavy]))
