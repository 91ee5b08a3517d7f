"""What a Python user sees first: names, limits, representations, copies, errors of arguments, batches of poses."""

from __future__ import annotations

import copy
import pickle

import numpy as np
import pytest

import rrrgen
from rrrgen.runtime.results import JointLimits


@pytest.fixture(scope="module")
def model():
    return rrrgen.compile("puma560")


def test_name_joints_and_limits(model):
    assert model.name == "puma560"
    assert model.joint_names == tuple(joint.name for joint in model.spec.joints)
    assert isinstance(model.limits, JointLimits)
    for joint, low, high, speed in zip(model.spec.joints, *model.limits[:3], strict=True):
        assert low == (-np.inf if joint.limits.lower is None else joint.limits.lower)
        assert high == (np.inf if joint.limits.upper is None else joint.limits.upper)
        assert speed == (np.inf if joint.limits.velocity is None else joint.limits.velocity)
    assert np.isfinite(rrrgen.compile("rrr").limits.velocity).any()


def test_representations(model):
    assert repr(model) == f"<rrrgen.Model puma560: RRRRRR, {len(model.base_parameters)} base parameters>"
    html = model._repr_html_()
    assert html.count("<tr>") == 2 + 6 + len(model.base_parameters)
    assert f"{model.beta[0]:.6g}" in html
    assert repr(model.bind("gravity")) == "<bound gravity_nominal: q (6,) -> g (6,)>"
    form = rrrgen.compile("rrr").closed_form("gravity")
    assert "gravity" in repr(form)
    assert r"\sin" in form._repr_latex_()
    assert model.closed_form("mass_matrix")._repr_latex_() is None  # it would fill pages


@pytest.mark.parametrize("again", [copy.copy, copy.deepcopy, lambda m: pickle.loads(pickle.dumps(m))])
def test_a_model_copies_by_its_description(again):
    model = rrrgen.compile("rrr")
    model.threads = 2
    other = again(model)
    q = np.array([0.3, -0.7, 1.1])
    assert np.array_equal(other.mass_matrix(q), model.mass_matrix(q))
    assert (other.threads, other.name) == (2, "rrr")
    model.threads = 1


def test_errors_of_arguments_are_value_errors_without_a_place(model):
    for call in (lambda: model.ik.solve(np.eye(3)), lambda: model.ik.solve(np.eye(4), q_ref=[0.0])):
        with pytest.raises(ValueError, match=r"^(puma560 solves|q_ref must)"):
            call()
    with pytest.raises(ValueError, match=r"^base parameters|^beta|^mass_matrix"):
        model.mass_matrix(np.zeros(6), beta=np.zeros(3))


def test_inverse_kinematics_takes_one_pose_or_a_batch(model):
    q = np.random.default_rng(4).uniform(-1.0, 1.0, (2, 3, 6))
    T = model.forward_kinematics(q)
    found = model.inverse_kinematics(T, limits=False)
    assert found.q.shape == (2, 3, model.ik.max_solutions, 6)
    assert found.counts.shape == found.statuses.shape == found.distances.shape == (2, 3)
    for place in np.ndindex(2, 3):
        single = model.inverse_kinematics(T[place], limits=False)
        assert len(single) == found.counts[place] > 0
        assert np.array_equal(single.q, found.q[place][: len(single)])
        assert np.isnan(found.q[place][len(single) :]).all()


def test_inverse_kinematics_of_positions_in_a_batch():
    model = rrrgen.compile("rrr")
    p = np.array([[0.2, -0.4, 0.6], [0.1, 0.4, 0.5]])
    found = model.inverse_kinematics(p)
    assert found.q.shape == (2, model.ik.max_solutions, 3)
    assert np.array_equal(model.inverse_kinematics(p[0]).q, found.q[0][: found.counts[0]])
