"""Regressors of a model: times the nominal parameters they are the whole torque."""

from __future__ import annotations

import numpy as np

from runtime.states import close


def test_the_identification_regressor_times_its_nominal_parameters_is_the_whole_torque(model, states):
    q, dq, ddq, _ = states
    assert model.identification_parameter_names[6:] == ("Ia1", "Ia2", "fv1", "fv2", "fc2", "off2")
    W = model.identification_regressor(q, dq, ddq)
    expected = model.inverse_dynamics(q, dq, ddq) + model.friction(dq)
    close(W @ model.identification_parameters, expected)
    close(model.identification_regressor(q, dq[0], np.zeros(2))[4], model.identification_regressor(q[4], dq[0], [0, 0]))
