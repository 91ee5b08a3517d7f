"""A certified folder for the tests that look at it."""

from __future__ import annotations

import pytest

from evidence.certified import run


@pytest.fixture(scope="session")
def certified(tmp_path_factory):
    folder = tmp_path_factory.mktemp("certified") / "pendulum"
    assert run("pendulum", "-o", folder, "--samples", 20, "--no-casadi-files").return_value == 0
    return folder
