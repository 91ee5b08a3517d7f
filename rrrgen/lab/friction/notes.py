"""Warnings to the user: what a recording hardly tells about the friction of a joint, and what two models share."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from rrrgen.lab.friction.joint_recording import JointData

if TYPE_CHECKING:
    from rrrgen.lab.friction.estimation import LawEstimate

EXTRAPOLATED = 1.0  # s: with less time of sliding below the Stribeck speed, stiction is an extrapolation
HARDLY = 0.02  # relative standard deviation of the inertia above which a note warns the user
UNEXPLAINED = 0.1  # torque error in sliding above which a note warns that no law fits
MISFIT = 1.6  # held-out error above which a note warns that the law is doubtful
LEFT = 1.35  # held-out error above which something is left to explain; true laws have 0.8 to 1.35
UNCERTAIN = 0.2  # relative standard deviation of another parameter above which a note warns the user
SMALL = 0.02  # times break-away: torque below which viscous friction does not matter
CERTAIN = 3.0  # standard deviations from zero from which on a difference counts
RESOLVED = 1.0  # encoder steps: bristles that bend by less are seen only through the motion that follows
CLOSE = 1.05  # times the held-out error of the chosen law: one up to this is as good

TOLD_BY = {
    **dict.fromkeys(("coulomb", "coulomb_p", "coulomb_n"), "steady motion in both directions tells it"),
    **dict.fromkeys(("viscous", "viscous_p", "viscous_n"), "fast motion tells it"),
    **dict.fromkeys(("stiction_excess", "stribeck_speed"), "slow reversals tell it"),
    **dict.fromkeys(("sigma0", "sigma1"), "slow reversals tell it, better a recording below break-away"),
}
"""What kind of motion tells a parameter."""


def notes(chosen: LawEstimate, data: JointData) -> tuple[str, ...]:
    """Sentences on what the recording ``data`` of a joint tells poorly about the ``chosen`` law, or not at all."""
    found = []
    if chosen.torque_error > UNEXPLAINED:
        found.append(
            f"no law fits well: {100 * chosen.torque_error:.0f} % of the torque in sliding remain unexplained; check "
            "that the other joints stand still, and look for torque ripple, backlash or a limit cycle in the recording"
        )
    elif chosen.score.held_out > MISFIT:
        found.append(
            f"errors on windows that were not fitted are {chosen.score.held_out:.2g} times the noise: {chosen.name} is "
            "the best law tried, but does not describe rest and reversals; add slow reversals, which tell the law"
        )
    elif chosen.score.held_out > LEFT:
        found.append(
            f"errors on windows that were not fitted are {chosen.score.held_out:.3g} times the noise: something is "
            f"left that {chosen.name} does not describe, such as torque ripple or a flexible joint; it can hide a "
            "part of the friction, which the deviations do not count"
        )
    if chosen.std["inertia"] > HARDLY * chosen.values["inertia"]:
        found.append("inertia is hardly determined: the joint accelerates too little; add a fast multisine")
    if "stribeck_speed" in chosen.values:
        slow = data.sliding & (np.abs(data.motion[1]) < chosen.values["stribeck_speed"])
        seconds = float(np.count_nonzero(slow)) * data.period
        if seconds < EXTRAPOLATED:
            found.append(
                f"the joint slides below the Stribeck speed for {seconds:.2g} s only: stiction_excess is extrapolated, "
                "and its deviation a lower bound; add slow reversals"
            )
    for name, advice in TOLD_BY.items():
        value, std = chosen.values.get(name), chosen.std.get(name, 0.0)
        # viscous friction may be next to none: then its torque has to be uncertain, too
        matters = "viscous" not in name or std * data.speed > SMALL * chosen.break_away
        if value is not None and std > UNCERTAIN * abs(value) and matters:
            found.append(f"{name} is hardly determined ({value:.3g} +- {std:.2g}): {advice}")
    return (*found, *_bristles(chosen, data), *_ambiguities(chosen))


def _bristles(chosen: LawEstimate, data: JointData) -> tuple[str, ...]:
    """Sentences on LuGre bristles that bend by less than an encoder step of ``data``, or carry nothing."""
    if "sigma0" not in chosen.values:
        return ()
    level = chosen.values["coulomb"] + chosen.values["stiction_excess"]
    if level <= 0.0:
        return (
            f"friction at rest, coulomb + stiction_excess, is estimated as {level:.2g}, which no bristles can have: "
            "the law does not hold near rest; the robot file gets the least positive value",
        )
    bend = level / chosen.values["sigma0"] / data.resolution
    if bend >= RESOLVED:
        return ()
    return (
        f"the bristles bend by {bend:.2g} encoder steps before the joint slides: the deviations of sigma0, sigma1 and "
        "stiction_excess are lower bounds; a finer encoder tells them, or a recording below break-away",
    )


def stiff_bristles(chosen: LawEstimate, laws: Sequence[LawEstimate], largest: float) -> tuple[str, ...]:
    """A sentence with a lower bound of the bristles' stiffness where the Stribeck law, of rigid contact, is chosen.

    The bound is the stiffness of the LuGre law among the estimated ``laws`` less three standard deviations, and at most
    ``largest``, N m/rad (N/m), which the sampling rate resolves. There is none if that law is clearly worse.
    """
    bent = next((law for law in laws if law.name == "lugre"), None)
    if chosen.name != "stribeck" or bent is None or bent.score.held_out > CLOSE * chosen.score.held_out:
        return ()
    value, std = bent.values["sigma0"], bent.std["sigma0"]
    bound = min(value * float(np.exp(-CERTAIN * std / value)), largest)
    return (
        f"LuGre friction with stiff bristles explains the recording as well (held-out error {bent.score.held_out:.3g}, "
        f"Stribeck {chosen.score.held_out:.3g}): of sigma0 it tells a lower bound alone, about {bound:.2g}",
    )


def _ambiguities(chosen: LawEstimate) -> tuple[str, ...]:
    """Sentences on another model that describes the recording equally well.

    An offset of the torque acts like a difference between the Coulomb torques of the two directions.
    """
    values, std = chosen.values, chosen.std
    if chosen.name == "coulomb_viscous" and abs(values.get("offset", 0.0)) > CERTAIN * std.get("offset", 0.0):
        up, down = (values["coulomb"] + s * values["offset"] for s in (1.0, -1.0))
        return (
            f"the offset can be one of the measured torque, or Coulomb friction of {up:.4g} forward and {down:.4g} "
            "backward (law asymmetric): the recording cannot tell these apart",
        )
    if chosen.name != "asymmetric":
        return ()
    if chosen.candidate.gravity == 1:
        return (
            "a constant force and a difference between coulomb_p and coulomb_n cannot be told apart: gravity is the "
            "force for which the two are equal",
        )
    slopes = abs(values["viscous_p"] - values["viscous_n"])
    if slopes < CERTAIN * float(np.hypot(std["viscous_p"], std["viscous_n"])):
        offset = 0.5 * (values["coulomb_p"] - values["coulomb_n"])
        return (
            f"the directions differ in Coulomb friction alone: an offset of the measured torque of {offset:.4g} with "
            f"equal Coulomb friction (law coulomb_viscous) cannot be told apart from that",
        )
    return ()
