"""The emitted Kalman step against the textbook's filter of the motion itself, without a reference to deviate from."""

from __future__ import annotations

import numpy as np
import pytest

from rrrgen.base.errors import InputError
from rrrgen.emit.controller.filters import kalman_program
from rrrgen.program import evaluate


def test_the_filter_of_the_deviation_is_that_of_the_motion():
    """With a reference that follows the model, x_next = E (x + k (y - x1)) holds for the motion x as a whole."""
    period, joints, rng = 0.01, 2, np.random.default_rng(8)
    E = np.array([[1.0, period, period**2 / 2], [0.0, 1.0, period], [0.0, 0.0, 1.0]])
    gains = rng.uniform(0.1, 0.9, (joints, 3))
    program = kalman_program([E.tolist()] * joints, gains.tolist(), period)
    reference = rng.uniform(-1, 1, (joints, 3))
    motion = rng.uniform(-1, 1, (joints, 3))
    deviation = motion - reference
    for _ in range(20):
        y = rng.uniform(-1, 1, joints)
        innovation = y - motion[:, 0]
        updated = motion + gains * innovation[:, None]
        following, q, dq, ddq, e = evaluate(program, deviation, y, *reference.T)[:5]
        np.testing.assert_allclose(np.stack([q, dq, ddq], axis=1), updated, rtol=1e-12)
        np.testing.assert_allclose(e, innovation, rtol=1e-12, atol=1e-15)
        motion, reference, deviation = updated @ E.T, reference @ E.T, following.reshape(joints, 3)
        np.testing.assert_allclose(deviation, motion - reference, rtol=1e-9, atol=1e-12)


def test_transitions_and_gains_have_to_fit():
    with pytest.raises(InputError, match=r"\(n, 3, 3\) and the gains \(n, 3\)"):
        kalman_program([np.eye(3).tolist()], [[0.1, 0.2]], 0.01)
    with pytest.raises(InputError, match=r"\(n, 3, 3\)"):
        kalman_program([np.eye(3).tolist()], [[0.1, 0.2, 0.3]] * 2, 0.01)
