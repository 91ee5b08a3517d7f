"""Random faults through every socket of the controller that has code of its own."""

from __future__ import annotations

import pytest

from emit.targets.socket_fuzz import SOCKETS, fuzz

# one closed loop with a fault of every kind runs through all of them in test_controller_sockets.py
OTHERS = ("rust", "mex", "arduino", "zephyr", "ros2")


@pytest.mark.parametrize(
    "target", ["fmu", *(pytest.param(name, marks=pytest.mark.sweep) for name in ("simulink", *OTHERS))]
)
def test_random_faults_leave_a_socket_as_they_leave_the_unit(target):
    if SOCKETS[target].missing:
        pytest.skip(f"needs {SOCKETS[target].missing}")
    assert "of 1" in fuzz(target, 3000)  # ten or more kinds of faults
