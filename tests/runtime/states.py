"""States, arguments and references of the functions of a model."""

from __future__ import annotations

import numpy as np

ROUND_OFF = 1e-13  # relative to the largest value; C and NumPy differ in the last bits of sine and cosine only
STATES = {"q": 0, "dq": 1, "ddq": 2, "e": 3, "tau": 3}
CALLS = {
    "forward_kinematics": "q",
    "link_frames": "q",
    "jacobian": "q",
    "link_jacobians": "q",
    "jacobian_dot_dq": "q dq",
    "mass_matrix": "q",
    "coriolis_matrix": "q dq",
    "coriolis": "q dq",
    "coriolis_transpose": "q dq",
    "gravity": "q",
    "bias": "q dq",
    "inverse_dynamics": "q dq ddq",
    "forward_dynamics": "q dq tau",
    "regressor": "q dq ddq",
    "regressor_transpose": "q dq ddq e",
    "standard_regressor": "q dq ddq",
    "energy": "q dq",
    "friction": "dq",
    "identification_regressor": "q dq ddq",
}


def arguments(name, states):
    return [states[STATES[port]] for port in CALLS[name].split()]


def close(result, expected, tolerance=ROUND_OFF):
    result, expected = np.asarray(result), np.asarray(expected)
    assert result.shape == expected.shape
    assert np.max(np.abs(result - expected), initial=0) <= tolerance * max(1, np.max(np.abs(expected), initial=0))
