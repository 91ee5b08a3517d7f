"""Parameters of a model: given ones replace the nominal ones, and must be given where there are no links."""

from __future__ import annotations

import numpy as np
import pytest

from emit.c_tools import IDENTITY
from emit.planar import BETA_NOMINAL, IA_NOMINAL, planar_model
from rrrgen.program import evaluate
from rrrgen.runtime.load import load_model
from runtime.states import close


def test_given_parameters_replace_the_nominal_ones(model, states):
    q, dq, ddq, _ = states
    beta = np.random.default_rng(2).normal(size=6)
    Ia = np.array([0.3, 0.4])
    program = planar_model().programs["inverse_dynamics"]
    close(model.inverse_dynamics(q, dq, ddq, beta, Ia=Ia), evaluate(program, q, dq, ddq, np.concatenate([beta, Ia]))[0])
    nominal = np.concatenate([beta, [float(x) for x in IA_NOMINAL]])
    close(model.inverse_dynamics(q, dq, ddq, beta), evaluate(program, q, dq, ddq, nominal)[0])
    close(model.inverse_dynamics(q, dq, ddq, Ia=Ia), evaluate(program, q, dq, ddq, np.concatenate([model.beta, Ia]))[0])
    close(model.inverse_dynamics(q, dq, ddq, model.beta), model.inverse_dynamics(q, dq, ddq))
    many = np.random.default_rng(3).normal(size=(7, 6))
    close(model.gravity(q, many), np.stack([model.gravity(x, y) for x, y in zip(q, many, strict=True)]))


def test_without_links_the_parameters_must_be_given(states):
    model = load_model(planar_model(links=False, drives=False), IDENTITY)
    q = states[0]
    assert model.beta is None
    assert model.identification_parameters is None
    with pytest.raises(ValueError, match=r"gravity: the robot file has no links, so beta= must be given"):
        model.gravity(q)
    close(model.gravity(q, np.array([float(x) for x in BETA_NOMINAL])), load_model(planar_model(), IDENTITY).gravity(q))
    with pytest.raises(ValueError, match="gives no drive inertia"):
        model.mass_matrix(q, np.ones(6), Ia=[1, 1])


# ------------------------------------------------------------------------------------------------------------------
# Regressors of a model: times the nominal parameters they are the whole torque.
# ------------------------------------------------------------------------------------------------------------------


def test_the_identification_regressor_times_its_nominal_parameters_is_the_whole_torque(model, states):
    q, dq, ddq, _ = states
    assert model.identification_parameter_names[6:] == ("Ia1", "Ia2", "fv1", "fv2", "fc2", "off2")
    W = model.identification_regressor(q, dq, ddq)
    expected = model.inverse_dynamics(q, dq, ddq) + model.friction(dq)
    close(W @ model.identification_parameters, expected)
    close(model.identification_regressor(q, dq[0], np.zeros(2))[4], model.identification_regressor(q[4], dq[0], [0, 0]))
