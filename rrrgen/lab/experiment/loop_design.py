"""Designs the control loop of the virtual robot from the arm: gains, observer, and their stability margin.

PD gains place the poles of every joint, with the others at rest, at a bandwidth. In its lightest direction the arm is
several times lighter than ``M_ii``, so the same gains cross over at a several times higher frequency. There the
observer must still be fast, and the delay of the hold small. The design takes the slowest observer that keeps the
modulus margin :data:`MARGIN` in all postures along the motion, and where none does, or where the steps of the encoders
would shake the drives, a lower bandwidth. What the experiment file states is kept, and warned of if its margin is
smaller.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache, partial
from typing import TYPE_CHECKING, Any

import numpy as np

from rrrgen.base.arrays import Array
from rrrgen.base.errors import Fault
from rrrgen.lab.data.kalman import kalman_matrices
from rrrgen.lab.data.smoother import quantisation_variance
from rrrgen.lab.plant.controllers import PD, BackwardDifference, ComputedTorque, Controller, DeviationFilter, Observer
from rrrgen.lab.plant.experiment import Recording
from rrrgen.lab.plant.loop_margin import LoopMargin, SampledArm, torque_noise
from rrrgen.lab.plant.tracking import Tracking, check_tracking

if TYPE_CHECKING:
    from rrrgen.lab.experiment.experiment_file import ControlSection
    from rrrgen.lab.plant.plant import Plant, RigidBody

MARGIN = 0.5
"""Modulus margin of a designed loop over all postures: sensitivity below 2, gain margin 2, phase margin 29 degrees."""

BANDWIDTH = 4.0
"""Bandwidth that a design aims at, Hz: arms follow exciting motions of up to 1 Hz, and no light arm asks for more."""

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

    ``masses`` (m, n, n) are the mass matrices of the links at instants spread over the motion, with the drives where
    the joints are rigid; ``body`` and ``friction`` the model that computed torque uses. ``torques`` (N, n) are those
    that the motion takes without friction, ``load`` (n,) the largest with friction, ``jerk`` (n,) the largest jerk.
    ``resolution`` (n,) is that of the encoders for the design of observers, ``stepped`` whether the encoders round.
    """

    plant: Plant
    body: RigidBody
    friction: Any
    masses: Array
    duration: float
    torques: Array
    load: Array
    jerk: Array
    resolution: tuple[float, ...]
    stepped: bool
    period: float
    delay: int

    @property
    def moved(self) -> Array:
        """Mass matrices (m, n, n) that the drives accelerate at low frequencies: with the rotors of flexible joints."""
        joints = self.plant.joints
        return self.masses if joints is None else self.masses + np.diag(joints.rotor_inertia)


@dataclass(frozen=True, eq=False)
class LoopDesign:
    """A control loop with its margin.

    ``margin`` was found over postures along the motion, the worst at ``instant`` (s). ``bandwidth`` (Hz) is None where
    the gains are stated, ``asked`` (Hz) what was aimed at. ``poles`` (rad/s) is the pole frequency of a designed Kalman
    observer, None for another. ``noise`` (n,) is the torque that the encoder steps cause, standard deviation in N m
    (N). ``stiffness`` (n,) is the torque per deviation, N m/rad (N/m). ``warnings`` are about stated settings.
    """

    controller: Controller
    observer: Observer
    margin: LoopMargin
    instant: float
    bandwidth: float | None
    asked: float | None
    poles: float | None
    noise: Array
    stiffness: Array
    warnings: tuple[Fault, ...] = field(default=())

    @property
    def robust(self) -> bool:
        """Whether the loop is stable with the margin :data:`MARGIN`."""
        return not self.margin.unstable and self.margin.modulus >= MARGIN

    def lines(self) -> list[str]:
        """The design in words: gains, observer and margin, and a lower bandwidth than the one aimed at."""
        law = "PD control" if isinstance(self.controller, PD) else "computed torque"
        gains = "with stated gains" if self.bandwidth is None else f"of {self.bandwidth:.3g} Hz"
        watch = "backward differences" if isinstance(self.observer, BackwardDifference) else "a Kalman observer"
        if self.poles is not None:
            watch += f" with its poles at {self.poles / (2.0 * math.pi):.3g} Hz"
        found = [f"{law} {gains}, {watch}: {self.margin_text()}"]
        if self.bandwidth is not None and self.asked is not None and self.bandwidth < self.asked:
            found.append(
                f"not {self.asked:.3g} Hz: it would not be robust, or the encoder steps would shake the drives; "
                "a higher rate or finer encoders allow more, and so does computed torque"
            )
        return found

    def margin_text(self) -> str:
        """The margin in words."""
        where = f"at {self.margin.frequency:.3g} Hz in the posture at t = {self.instant:.3g} s"
        if self.margin.unstable:
            return f"unstable, {where} an oscillation grows by {self.margin.radius:.4g} a sample"
        return f"modulus margin {self.margin.modulus:.2f}, smallest {where} (at least {MARGIN} is robust)"

    def to_json(self) -> dict[str, Any]:
        """The design as plain data, for ``--json``."""
        return {
            "bandwidth": self.bandwidth,
            "observer_poles": None if self.poles is None else self.poles / (2.0 * math.pi),
            "stable": not self.margin.unstable,
            "modulus_margin": None if self.margin.unstable else self.margin.modulus,
            "margin_frequency": self.margin.frequency,
            "worst_instant": self.instant,
            "largest_pole": self.margin.radius,
        }


def design_loop(arm: ControlledArm, control: ControlSection) -> LoopDesign:
    """Design the loop of ``arm``: what ``control`` states is kept, everything else is chosen for the margin."""
    search = _Search(arm, control)
    found = search.best()
    if found.robust or not control.places:
        return found
    stated = {key: place for key, place in control.places.items() if key in DECISIVE}
    if not stated:
        return found
    free = replace(control, bandwidth=None, damping=1.0, kp=None, kd=None, observer="kalman", jerk=None, places={})
    return replace(found, warnings=_warnings(found, stated, _Search(arm, free).best()))


def checked(recording: Recording, arm: ControlledArm, loop: LoopDesign, prismatic: Sequence[bool]) -> Tracking:
    """Check how ``arm`` followed its motion in the ``recording`` under ``loop``; ``prismatic`` (n,) joints slide."""
    resolution = np.array(arm.resolution) if arm.stepped else np.zeros(len(arm.load))
    inertia = np.mean(np.diagonal(arm.moved, axis1=1, axis2=2), axis=0)
    bandwidth = float(np.sqrt(loop.stiffness / inertia).max()) / (2.0 * math.pi)
    return check_tracking(recording, arm.torques, arm.load, loop.stiffness, bandwidth, resolution, np.array(prismatic))


DECISIVE = ("bandwidth", "damping", "kp", "kd", "observer", "jerk")
"""Keys of the control section on which the margin depends."""


def _warnings(found: LoopDesign, stated: Mapping[str, Fault], free: LoopDesign) -> tuple[Fault, ...]:
    """The warning about the settings ``stated``, at the place of the first; ``free`` is the design without them."""
    place = min(stated.values())
    names = ", ".join(f"`{name}`" for name in stated)
    verb = "makes" if len(stated) == 1 else "make"
    message = f"{names} {verb} a loop that is not robust: {found.margin_text()}"
    hint = f"without {'it' if len(stated) == 1 else 'them'}: {free.lines()[0]}"
    return (replace(place, message=message, hint=hint, severity="warning"),)


class _Search:
    """The search for the fastest bandwidth and the slowest observer with the margin."""

    def __init__(self, arm: ControlledArm, control: ControlSection) -> None:
        self.arm, self.control = arm, control
        whole = arm.moved
        self.inertia = np.mean(np.diagonal(whole, axis1=1, axis2=2), axis=0)
        self.extreme = np.array([0])  # if the model cancels M(q), the loop is the same in all postures
        self.compared = self.extreme
        if control.kind != "computed_torque" or arm.plant.joints is not None or arm.plant.base is not None:
            self.extreme = _extreme(whole / np.sqrt(np.outer(self.inertia, self.inertia)))
            spread = np.linspace(0, len(whole) - 1, SPREAD).round().astype(int)
            self.compared = np.unique(np.concatenate([self.extreme, spread]))
        self.sampled = lru_cache(maxsize=8)(self._sampled)

    def best(self) -> LoopDesign:
        """The first bandwidth, from the one aimed at downward, with margin and quiet drives; else the best tried."""
        control = self.control
        if control.kp is not None and control.kd is not None:
            return self.at(None)
        asked = BANDWIDTH if control.bandwidth is None else control.bandwidth
        if control.bandwidth is not None:
            return self.at(asked)
        found = best = None
        for bandwidth in asked * STEP ** np.arange(0.0, math.log(LOWEST) / math.log(STEP) + 0.5):
            if bandwidth * STEP >= asked * LOWEST and not self.possible(bandwidth):
                continue
            found = self.at(float(bandwidth))
            if best is None or _rank(found) > _rank(best):
                best = found
            if self.good(found):
                break
        assert found is not None
        assert best is not None
        return replace(found if self.good(found) else best, asked=asked)

    def good(self, found: LoopDesign) -> bool:
        """Whether the loop is robust and the encoder steps do not shake the drives."""
        allowed = NOISE * np.maximum(self.arm.load, GENTLE * self.inertia)
        return found.robust and (not self.arm.stepped or bool(np.all(found.noise <= allowed)))

    def possible(self, bandwidth: float) -> bool:
        """Whether the fastest observer gives the margin at this bandwidth (Hz), in the extreme postures."""
        _, kp, kd = self.gains(bandwidth)
        observer, _ = self.observer(FASTEST / self.arm.period, lambda _: True)
        return self.enough(MARGIN, _octaves(2.0 * math.pi * bandwidth), kp, kd, observer)

    def at(self, bandwidth: float | None) -> LoopDesign:
        """The loop with this bandwidth (Hz; None: the stated gains) and the slowest observer that keeps the margin."""
        controller, kp, kd = self.gains(bandwidth)
        speeds = np.sqrt(kp if isinstance(controller, ComputedTorque) else kp / self.inertia)
        octaves = _octaves(float(speeds.min()))
        whole = self.sampled(octaves, False)
        aim, margin = MARGIN, None
        for _ in range(3):  # the other postures may need a little more than the extreme ones
            observer, poles = self.observer(
                float(speeds.max()),
                partial(self.enough, aim, octaves, kp, kd),
            )
            margin = whole.margin(observer.feedback(kp, kd), kp)
            if poles is None or margin.unstable or margin.modulus >= MARGIN:
                break
            aim += MARGIN - margin.modulus
        assert margin is not None
        heavy = self.inertia if isinstance(controller, ComputedTorque) else np.ones(len(kp))
        rounding = np.array([quantisation_variance(step) ** 0.5 for step in self.arm.resolution])
        noise = heavy * rounding * [torque_noise(system) for system in observer.feedback(kp, kd)]
        posture = int(self.compared[margin.posture])
        instant = self.arm.duration * posture / max(1, len(self.arm.masses) - 1)
        return LoopDesign(controller, observer, margin, instant, bandwidth, bandwidth, poles, noise, heavy * kp)

    def enough(self, aim: float, octaves: int, kp: Array, kd: Array, tried: Observer) -> bool:
        """Whether these gains and the observer ``tried`` have the margin ``aim`` in the extreme postures."""
        return self.sampled(octaves, True).meets(aim, tried.feedback(kp, kd), kp)

    def gains(self, bandwidth: float | None) -> tuple[Controller, Array, Array]:
        """The controller of a bandwidth (Hz), or of the stated gains, with its gains kp and kd (n,)."""
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
            return self.filtered(np.array(control.jerk, dtype=float)), None
        slow, fast = OBSERVER_SPEED * natural, FASTEST / period
        if slow >= fast or enough(self.designed(slow)):
            return self.designed(slow), slow
        if not enough(self.designed(fast)):
            return self.designed(fast), fast
        while fast > 1.05 * slow:
            middle = math.sqrt(slow * fast)
            slow, fast = (slow, middle) if enough(self.designed(middle)) else (middle, fast)
        return self.designed(fast), fast

    def designed(self, poles: float) -> DeviationFilter:
        """The Kalman observer with the pole frequency ``poles`` (rad/s), faster where the reference jerks more.

        Readings of standard deviation R and a jerk of standard deviation Q give a filter of third order with its poles
        at ``(Q/R)^(1/3)``.
        """
        least = np.array([quantisation_variance(step) ** 0.5 for step in self.arm.resolution]) * poles**3
        return self.filtered(np.maximum(self.arm.jerk, least))

    def filtered(self, jerk: Array) -> DeviationFilter:
        """The Kalman observer for a jerk (n,) of this standard deviation, rad/s^3 (m/s^3)."""
        rows = [(step, max(float(top), 1e-3)) for step, top in zip(self.arm.resolution, jerk, strict=True)]
        period = self.arm.period
        designed = {row: kalman_matrices(period, quantisation_variance(row[0]), row[1] ** 2) for row in set(rows)}
        return DeviationFilter([designed[row].E for row in rows], [designed[row].k for row in rows])

    def _sampled(self, octaves: int, extreme: bool) -> SampledArm:
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


def _octaves(natural: float) -> int:
    """A natural frequency (rad/s) in octaves, rounded down to even ones: the arm is sampled once for several."""
    return 2 * math.floor(0.5 * math.log2(natural))


def _rank(found: LoopDesign) -> tuple[bool, float]:
    """How good a loop is that does not meet every aim: robust ones first, of these the quietest, then by the margin."""
    return found.robust, (-float(found.noise.max()) if found.robust else found.margin.modulus)


def _extreme(relative: Array) -> Array:
    """Indices of the extreme postures, from the mass matrices (m, n, n) relative to the gains, rising."""
    values = np.linalg.eigvalsh(relative)
    light, heavy = np.argsort(values[:, 0])[:LIGHT], np.argsort(-values[:, -1])[:HEAVY]
    return np.unique(np.concatenate([light, heavy]))
