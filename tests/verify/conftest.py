"""Fixtures that several test files of this folder share."""

from __future__ import annotations

import pytest

from rrrgen.verify import Report, verify
from verify.distorted import FRICTION, Without, arm
from verify.oracle_model import OracleModel


@pytest.fixture(scope="module")
def complete() -> OracleModel:
    return arm(drive=(0.1, 0.2, 0.05), friction=FRICTION)


@pytest.fixture(scope="module")
def whole(complete) -> Report:
    return verify(Without(complete, "nothing"), samples=1, libraries=False)
