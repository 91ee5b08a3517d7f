"""Independent libraries: what each can take, and one that is missing."""

from __future__ import annotations

import sys

import numpy as np
import pytest

from oracles import chapter14
from oracles.newton_euler import Link
from oracles.random_robots import random_robot
from rrrgen.verify import verify
from verify.distorted import SAMPLES
from verify.oracle_model import OracleModel


def test_massless_link_is_left_to_the_built_in_reference():
    links = list(random_robot(1, 3).links)
    links[0] = Link(0.0, np.zeros(3), np.diag([0.0, 0.35, 0.0]))
    report = verify(OracleModel(chapter14.rrr(tuple(links))), samples=SAMPLES)
    assert report.ok, report.to_text()
    assert any("no mass" in reason for _, reason in report.skipped)


@pytest.mark.parametrize("module", ["pinocchio", "mujoco", "roboticstoolbox"])
def test_missing_library_is_reported_and_is_no_failure(monkeypatch, complete, module):
    monkeypatch.setitem(sys.modules, module, None)
    report = verify(complete, samples=1)
    assert report.ok
    assert ["not installed" in reason for name, reason in report.skipped if name != "inverse_kinematics"] == [True]
    assert "not asked" in report.to_text()
