"""Puts the chosen friction law into the robot file."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from rrrgen.robot.friction.law import LEAST
from rrrgen.robot.robot_spec import FrictionSpec, LawSpec

if TYPE_CHECKING:
    from rrrgen.lab.friction.estimation import LawEstimate
    from rrrgen.lab.friction.presliding import Presliding
    from rrrgen.robot.robot_spec import RobotSpec

CERTAIN = 3.0  # standard deviations from zero from which on a torque offset is written


def with_friction(spec: RobotSpec, joint: str, chosen: LawEstimate, rest: Presliding | None = None) -> RobotSpec:
    """A copy of ``spec`` whose joint named ``joint`` has the law ``chosen``; all else stays as it is.

    An estimated offset of the torque is part of it where it is certain.
    Stiffness and damping of LuGre bristles are replaced by the values of ``rest``, a presliding measurement, if those
    have the smaller standard deviations.
    """
    law = chosen.candidate.law
    values = dict(
        zip((p.name for p in law.parameters), chosen.candidate.law_values(chosen.theta.tolist()), strict=True)
    )
    if rest is not None:
        measured = {"sigma0": rest.sigma0, "sigma1": rest.sigma1}
        for name, pair in measured.items():
            if pair is not None and name in values and pair[1] < chosen.std[name]:
                values[name] = pair[0]
    offset = chosen.values.get("offset")
    if offset is not None and abs(offset) < CERTAIN * chosen.std["offset"]:
        offset = None
    if law.damping:  # bristles carry something at rest, or the robot file would be refused
        values["coulomb"] = max(values["coulomb"], LEAST)
        values["stiction_excess"] = max(values["stiction_excess"], LEAST - values["coulomb"])
    if law.name == "coulomb_viscous":
        friction = FrictionSpec(viscous=values["viscous"], coulomb=values["coulomb"], offset=offset)
    else:
        numbers = tuple(max(values[p.name], LEAST) if p.positive else values[p.name] for p in law.parameters)
        friction = FrictionSpec(law=LawSpec(law.name, numbers), offset=offset)
    joints = tuple(replace(each, friction=friction) if each.name == joint else each for each in spec.joints)
    return replace(spec, joints=joints)
