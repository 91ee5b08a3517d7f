"""The columns of drives and friction: one piece of code for the model, for what is fitted, and for what is scored."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import rrrgen
from rrrgen.base.errors import DerivationError
from rrrgen.lab.identify.consistency import ConsistentEstimate
from rrrgen.lab.identify.parameters import DriveTerms
from rrrgen.lab.identify.regressor import FullRegressor
from rrrgen.lab.identify.results import identified_spec
from rrrgen.lab.identify.validation import robot_model
from rrrgen.robot.file import FrictionSpec, loads_spec
from rrrgen.runtime.regressor_columns import STANDSTILL

ARM = """
schema: rrrgen/1
name: arm
convention: standard
units: {angle: deg, length: m}
gravity: [0, -9.81, 0]
joints:
  - type: revolute
    alpha: 0
    a: 0.5
    d: 0
    friction: {viscous: 0.4, coulomb: 1.5, offset: -0.2}
    drive: {inertia: 0.3}
  - {type: revolute, alpha: 0, a: 0.4, d: 0, friction: {coulomb: 0.7}}
links:
  - {mass: 2, com: [-0.2, 0, 0], inertia: {about: com, xx: 0.01, yy: 0.02, zz: 0.02}}
  - {mass: 1, com: [-0.1, 0.02, 0], inertia: {about: com, xx: 0.01, yy: 0.02, zz: 0.02}}
"""


@pytest.fixture(scope="module")
def model():
    return rrrgen.compile(loads_spec(ARM), backend="numpy")


def motion(speeds: tuple[float, ...], seed: int = 0) -> tuple[np.ndarray, ...]:
    """Random poses and accelerations, with every pair of ``speeds``."""
    dq = np.array(np.meshgrid(speeds, speeds)).reshape(2, -1).T
    rng = np.random.default_rng(seed)
    return rng.uniform(-2, 2, dq.shape), dq, rng.uniform(-5, 5, dq.shape)


AT_REST = (0.0, -0.0, 1e-17, -1e-12, 0.5 * STANDSTILL, -STANDSTILL)
MOVING = (1.01 * STANDSTILL, -2 * STANDSTILL, 1e-3, -1.0)


@pytest.mark.parametrize("speeds", [AT_REST, MOVING, (*AT_REST, *MOVING)], ids=["at rest", "moving", "mixed"])
def test_what_the_model_states_is_what_is_fitted(model, speeds):
    states = motion(speeds)
    fitted = FullRegressor(model, DriveTerms.of_spec(model.spec))
    assert model.identification_parameter_names == fitted.names
    np.testing.assert_array_equal(model.identification_regressor(*states), fitted(*states))
    np.testing.assert_array_equal(model.identification_regressor(*states)[..., fitted.names.index("fc2")][:, 1] != 0.0,
                                  np.abs(states[1][:, 1]) > STANDSTILL)  # fmt: skip


def test_a_model_is_scored_with_the_columns_it_was_fitted_with(model):
    states = motion((*AT_REST, *MOVING))
    expected = model.identification_regressor(*states) @ model.identification_parameters
    np.testing.assert_allclose(robot_model(model)(*states), expected, rtol=1e-12, atol=1e-12)


def test_the_emitted_friction_is_the_same_but_for_round_off_speeds(model):
    q, dq, ddq = motion((0.0, *MOVING))
    whole = model.inverse_dynamics(q, dq, ddq) + model.friction(dq)
    np.testing.assert_allclose(robot_model(model)(q, dq, ddq), whole, rtol=1e-12, atol=1e-12)


def test_estimated_terms_that_the_file_does_not_state_are_written_too():
    """Joint 2 has no offset and no drive in the file, which gains them; a motor unknown to the robot is refused."""
    spec = loads_spec(ARM)
    phi = np.tile([2.0, 0.1, 0.0, 0.0, 0.1, 0.0, 0.1, 0.0, 0.0, 0.1], 2)
    drives = {"fv1": 0.5, "off2": 0.125, "Ia2": 0.25}
    estimate = ConsistentEstimate(phi, phi, phi, (), drives, phi, 0.0, phi, 0.0)
    first, second = identified_spec(spec, estimate).joints
    assert first.friction == FrictionSpec(0.5, 1.5, -0.2)
    assert second.friction == FrictionSpec(None, 0.7, 0.125)
    assert second.drive.inertia == 0.25
    with pytest.raises(DerivationError, match="no motor of the robot file is that of fv_m2"):
        identified_spec(spec, replace(estimate, drives={**drives, "fv_m2": 1.0}))
