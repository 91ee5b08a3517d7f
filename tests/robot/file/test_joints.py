"""Joints of robot files: limits in every bundled robot."""

from __future__ import annotations

import pytest

from rrrgen.robot.file import bundled_names, load_spec

"""Arms with small offsets in the maker's own data, of which a file is warned."""


@pytest.mark.parametrize("name", bundled_names())
def test_every_joint_has_limits(name: str) -> None:
    for joint in load_spec(name).joints:
        turns_forever = name in ("rrr", "pendulum", "gen3")  # limits of speed and torque only
        assert (joint.limits.velocity is not None) if turns_forever else (joint.limits.upper is not None)
