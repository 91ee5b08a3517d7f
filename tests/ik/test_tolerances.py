"""Tolerances of the inverse kinematics: every one reaches the code."""

from __future__ import annotations

from ik.robots import robot
from rrrgen.emit.c.ik.files import sources
from rrrgen.ik.tolerances import runtime


def test_every_tolerance_reaches_the_code():
    text = sources(robot("puma"))["puma_ik.c"]
    for name in ("eps", "free", "doubt", "merge", "same", "slack", "circle", "tight", "accept", "done", "limit"):
        assert f"#define PUMA_IK_TOL_{name.upper()} (puma_ik_real){runtime('double')[name]}" in text


"""Its wrist has one real axis, which is turned by pi in no solution."""
