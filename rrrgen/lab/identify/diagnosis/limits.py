"""Rule: positions, speeds and torques far beyond the limits of the robot file."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from rrrgen.lab.identify.diagnosis.causes import Cause
from rrrgen.lab.identify.diagnosis.motion import LAG, Motion

DEGREE = math.pi / 180.0
SLACK = 0.05  # of the allowed range: tolerated overshoot, since limits are nominal
FAR = 3.0  # times the allowed range: above it the cause is a wrong unit, below it a wrong sign or zero
TOO_FAST = 3.0  # times the limit: drives do not run so far beyond their rated speed
TOO_STRONG = 10.0  # times the limit: peak torques are usually three times the nominal torque
THOUSAND = 1000.0**0.5  # times the limit: above it a wrong factor of 1000 is more likely than none


def limits(motion: Motion) -> Iterator[Cause]:
    """Report positions, speeds and torques far beyond the limits of the robot file."""
    yield from _positions(motion)
    if len(motion.part) > 2 * LAG:
        yield from _speeds(motion)
        yield from _torques(motion)


def _positions(motion: Motion) -> Iterator[Cause]:
    q, words = motion.part.q, motion.words
    low, high = np.min(q, axis=0), np.max(q, axis=0)
    bounds = [_range(joint) for joint in motion.spec.joints]
    outside = [i for i, bound in enumerate(bounds) if not _within(low[i], high[i], bound)]
    if not outside:
        return
    told = ", ".join(
        f"{words.joints[i]} from {low[i]:.4g} to {high[i]:.4g}, allowed {bounds[i][0]:.4g} to {bounds[i][1]:.4g}"
        for i in outside
    )
    evidence = f"positions beyond the limits of the robot file (rad, m): {told}"
    turning = [i for i, turns in enumerate(words.revolute) if turns]
    far = [i for i in outside if words.revolute[i] and high[i] - low[i] > FAR * (bounds[i][1] - bounds[i][0])]
    if far:
        limited = [i for i in turning if bounds[i][1] < math.inf]
        everywhere = 2 * len(far) > len(limited)
        yield words.wrong_unit("position", turning if everywhere else far, DEGREE).because(evidence)
        return
    for i in outside:
        name = words.joints[i]
        if _within(-high[i], -low[i], bounds[i]):
            yield words.wrong_sign(["position"], i).because(evidence)
        else:
            yield Cause(
                f"the zero, the unit or the range of joint {name} is another one than the robot file's",
                f"`zero` or `unit` of joint {name} in the mapping, or its `limits` in {words.robot}",
                (evidence,),
                general=True,
            )


def _range(joint: Any) -> tuple[float, float]:
    """Lowest and highest allowed position of a joint, rad (m); infinite unless the robot file states both."""
    lower, upper = joint.limits.lower, joint.limits.upper
    return (-math.inf, math.inf) if lower is None or upper is None else (float(lower), float(upper))


def _within(low: float, high: float, bound: tuple[float, float]) -> bool:
    room = SLACK * (bound[1] - bound[0]) if bound[1] < math.inf else 0.0
    return low >= bound[0] - room and high <= bound[1] + room


def _speeds(motion: Motion) -> Iterator[Cause]:
    words = motion.words
    fastest = np.max(np.abs(motion.speeds()), axis=0)
    for i, joint in enumerate(motion.spec.joints):
        limit = joint.limits.velocity
        if limit is not None and fastest[i] > TOO_FAST * float(limit):
            name, unit = words.joints[i], "rad/s" if words.revolute[i] else "m/s"
            yield Cause(
                f"the unit of the positions of joint {name} or of the clock is another one",
                f"the unit of `position` of joint {name} or of `time` in the mapping",
                (f"speeds of {name} up to {fastest[i]:.4g} {unit}, limit {float(limit):.4g} {unit}",),
                general=True,
            )


def _torques(motion: Motion) -> Iterator[Cause]:
    words, tau = motion.words, motion.part.tau
    if tau is None:
        return
    peaks = np.max(np.abs(np.where(np.isfinite(tau), tau, 0.0)), axis=0)
    over = {
        i: peaks[i] / float(joint.limits.torque)
        for i, joint in enumerate(motion.spec.joints)
        if joint.limits.torque is not None
    }

    def told(joints: list[int]) -> str:
        units = ["N m" if turns else "N" for turns in words.revolute]
        each = (f"{words.joints[i]} up to {peaks[i]:.4g} {units[i]}, {over[i]:.3g} times its limit" for i in joints)
        return f"torques of {', '.join(each)}"

    thousand = [i for i, ratio in over.items() if ratio > THOUSAND]
    if thousand:
        joints = range(len(words.joints)) if 2 * len(thousand) > len(over) else thousand
        yield words.wrong_unit("torque", list(joints), 1e-3).because(told(thousand))
    strong = [i for i, ratio in over.items() if TOO_STRONG < ratio <= THOUSAND]
    if strong:
        yield Cause(
            f"the torques of {words.named(strong)} are on another side or scale than the limits of the robot file",
            f"`side`, `gear_ratio` or `constant` of {words.named(strong)} in the mapping, or `limits` in {words.robot}",
            (told(strong),),
            general=True,
        )
