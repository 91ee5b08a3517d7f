"""Gravity and a payload at run time, in Python, C and CasADi, against the independent dynamics and other libraries."""

from __future__ import annotations

import pickle
from dataclasses import replace

import numpy as np
import pytest

from oracles import lagrange
from oracles import newton_euler as oracle
from oracles.external import MuJoCo, Pinocchio
from oracles.newton_euler import Link
from oracles.random_robots import random_link, random_robot, random_state, to_yaml, transform
from rrrgen import compile
from rrrgen.base.errors import InputError
from rrrgen.derive import derive
from rrrgen.robot.file import loads_spec, read

G = np.array([2.5, -6.0, -4.25])
EXACT = 1e-11


def together(first: Link, second: Link) -> Link:
    """Two rigidly connected bodies as one, by Steiner's theorem."""
    m = first.mass + second.mass
    com = (first.mass * first.com + second.mass * second.com) / m
    total = np.zeros((3, 3))
    for body in (first, second):
        d = body.com - com
        total += body.inertia + body.mass * (d @ d * np.eye(3) - np.outer(d, d))
    return Link(m, com, total)


@pytest.fixture(scope="module")
def robot():
    return random_robot(515, n=3, prismatic=0.3)


@pytest.fixture(scope="module")
def payload():
    return random_link(np.random.default_rng(3))


@pytest.fixture(scope="module")
def loaded(robot, payload):
    """The robot with the payload in its last link, in another gravity."""
    return replace(robot, gravity=G, links=(*robot.links[:-1], together(robot.links[-1], payload)))


@pytest.fixture(scope="module")
def model(robot):
    return compile(loads_spec(to_yaml(robot)))


@pytest.fixture(scope="module")
def evaluated(robot):
    """The model without C, whose loops over batches would take seconds to build."""
    return compile(loads_spec(to_yaml(robot)), backend="numpy")


@pytest.fixture(scope="module")
def state(robot):
    return random_state(robot, np.random.default_rng(8))


def close(value, expected):
    np.testing.assert_allclose(value, expected, atol=EXACT * max(1.0, np.max(np.abs(expected))), rtol=0)


def test_gravity_in_every_function_that_feels_it(model, robot, state):
    q, dq, ddq = state
    there = replace(robot, gravity=G)
    tau = oracle.inverse_dynamics(there, q, dq, ddq)
    e = np.array([1.0, -2.0, 0.5])
    close(model.inverse_dynamics(q, dq, ddq, gravity=G), tau)
    close(model.gravity(q, gravity=G), lagrange.gravity(there, q))
    close(model.bias(q, dq, gravity=G), oracle.bias(there, q, dq))
    close(model.dynamics_terms(q, dq, gravity=G).g, lagrange.gravity(there, q))
    close(model.forward_dynamics(q, dq, tau, gravity=G), ddq)
    close(model.inverse_dynamics_derivatives(q, dq, ddq, gravity=G).tau, tau)
    close(model.forward_dynamics_derivatives(q, dq, tau, gravity=G).ddq, ddq)
    close(model.momentum_terms(q, dq, gravity=G).g, lagrange.gravity(there, q))
    close(model.reference_torque(q, dq, dq, ddq, gravity=G), tau)
    beta = model.any_gravity.beta
    close(model.regressor(q, dq, ddq, gravity=G) @ beta, tau)
    close(model.regressor_transpose(q, dq, ddq, e, gravity=G) @ beta, e @ tau)
    close(model.reference_regressor_transpose(q, dq, dq, ddq, e, gravity=G) @ beta, e @ tau)
    close(model.standard_regressor(q, dq, ddq, gravity=G) @ robot.phi, tau)
    home = np.zeros(robot.n)
    fall = model.energy(q, dq, gravity=G)[1] - model.energy(home, dq, gravity=G)[1]
    close(fall, oracle.energy(there, q, dq)[1] - oracle.energy(there, home, dq)[1])


def test_without_gravity_it_is_that_of_the_file(model, robot, state):
    close(model.any_gravity.inverse_dynamics(*state), model.inverse_dynamics(*state))
    close(model.any_gravity.bind("inverse_dynamics")(*state), model.inverse_dynamics(*state))
    close(model.inverse_dynamics(*state, gravity=robot.gravity), model.inverse_dynamics(*state))


def test_a_batch_of_gravity_vectors(evaluated, robot, state):
    vectors = np.random.default_rng(1).uniform(-10, 10, (5, 3))
    batch = evaluated.inverse_dynamics(*state, gravity=vectors)
    close(batch, [oracle.inverse_dynamics(replace(robot, gravity=g), *state) for g in vectors])


def test_a_payload_is_a_heavier_last_link(model, loaded, payload, robot, state):
    beta = model.add_payload(mass=payload.mass, com=payload.com, inertia=payload.inertia)
    here = replace(loaded, gravity=robot.gravity)
    close(beta, model.base_parameters_of(here.phi))
    close(beta, model.base_projection @ here.phi)
    close(model.inverse_dynamics(*state, beta), oracle.inverse_dynamics(here, *state))
    close(model.mass_matrix(state[0], beta), oracle.mass_matrix(here, state[0]))
    close(model.add_payload(-payload.mass, payload.com, -payload.inertia, beta=beta), model.beta)


def test_payload_and_gravity_together_against_other_libraries(model, loaded, payload, state):
    q, dq, ddq = state
    beta = model.any_gravity.add_payload(mass=payload.mass, com=payload.com, inertia=payload.inertia)
    tau = model.inverse_dynamics(q, dq, ddq, beta, gravity=G)
    close(tau, oracle.inverse_dynamics(loaded, q, dq, ddq))
    for library in (Pinocchio(loaded), MuJoCo(loaded)):
        np.testing.assert_allclose(tau, library.inverse_dynamics(q, dq, ddq), atol=1e-8 * np.max(np.abs(tau)))


def test_a_payload_in_a_frame_of_its_own(model, payload):
    T = transform((1, 2, 2, 0), (0.1, 0.0, -0.25))
    R, p = T[:3, :3], T[:3, 3]
    inside = model.add_payload(payload.mass, R @ payload.com + p, R @ payload.inertia @ R.T)
    close(model.add_payload_at(payload.mass, payload.com, payload.inertia, T), inside)
    with pytest.raises(InputError, match="frame: the rotation of a pose is not orthonormal"):
        model.add_payload_at(payload.mass, payload.com, payload.inertia, np.diag([2.0, 2.0, 2.0, 1.0]))


def test_payloads_in_batches_and_point_masses(evaluated):
    masses = np.array([0.0, 1.0, 2.5])
    batch = evaluated.add_payload(masses, (0.1, 0.2, 0.3))
    close(batch, [evaluated.add_payload(mass, (0.1, 0.2, 0.3), np.zeros((3, 3))) for mass in masses])
    close(batch[0], evaluated.beta)


def test_wrong_arguments_are_named(model, state):
    with pytest.raises(ValueError, match="symmetric"):
        model.add_payload(1.0, inertia=[[1, 0.5, 0], [0, 1, 0], [0, 0, 1]])
    with pytest.raises(ValueError, match=r"inertia must be a tensor \(3, 3\)"):
        model.add_payload(1.0, inertia=[1.0, 2.0, 3.0])
    with pytest.raises(ValueError, match=r"gravity must have shape \(3,\)"):
        model.inverse_dynamics(*state, gravity=9.81)
    own, wider = len(model.beta), len(model.any_gravity.beta)
    if own != wider:
        with pytest.raises(ValueError, match=f"the {wider} base parameters of model.any_gravity, not the {own}"):
            model.inverse_dynamics(*state, model.beta, gravity=G)
    with pytest.raises(ValueError, match="no function 'momentum'"):
        model.bind("momentum")


def test_casadi_takes_gravity_and_payload(model, loaded, payload, state):
    pytest.importorskip("casadi")
    general = model.any_gravity
    beta = general.casadi_function("add_payload")(payload.mass, payload.com, payload.inertia, general.beta)
    tau = general.casadi_function("inverse_dynamics")(*state, G, beta)
    close(np.array(tau).ravel(), oracle.inverse_dynamics(loaded, *state))
    terms = general.casadi_function("momentum_terms")(state[0], state[1], G, beta)
    close(np.array(terms[0]).ravel(), oracle.mass_matrix(loaded, state[0]) @ state[1])


def test_a_copy_has_them_too(evaluated, state):
    again = pickle.loads(pickle.dumps(evaluated))
    close(again.inverse_dynamics(*state, gravity=G), evaluated.inverse_dynamics(*state, gravity=G))


def test_links_must_be_known():
    model = compile(loads_spec(to_yaml(random_robot(4, n=2, links="none"))), backend="numpy")
    with pytest.raises(ValueError, match="beta= must be given"):
        model.add_payload(1.0)
    with pytest.raises(ValueError, match="beta= must be given"):
        model.inverse_dynamics(*np.zeros((3, 2)), gravity=G)


def test_a_basis_of_the_file_holds_only_for_its_own_gravity():
    spec = read("rrr")
    general = derive(spec.in_any_gravity())
    assert [p.name for p in general.base_parameters][:3] == ["Izz1R", "hx1R", "hy1R"]
    assert general.b == 17
