"""Fixtures that several test files of this folder share."""

from __future__ import annotations

import pytest

import rrrgen


@pytest.fixture(scope="module")
def model():
    return rrrgen.compile("rrr")
