"""Fixtures that several test files of this folder share."""

import pytest

from samples.stick_slip_joint import Joint, record


@pytest.fixture(scope="module")
def moving():
    """A joint that moves as it should."""
    return record(Joint(), duration=16.0, substeps=2)
