"""Fixtures that several test files of this folder share."""

from __future__ import annotations

import pytest

import rrrgen


@pytest.fixture(scope="module")
def rrr():
    return rrrgen.compile("rrr")


@pytest.fixture(scope="module")
def controller(rrr):
    return lambda mode="computed_torque", **parameters: rrr.controller(mode, **parameters)
