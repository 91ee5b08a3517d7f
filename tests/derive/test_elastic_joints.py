"""Elastic joints: by an independent Newton-Euler differentiated on a circle of complex times, and in simulation."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import rrrgen
from oracles import newton_euler as oracle
from oracles.random_robots import random_robot, to_yaml
from rrrgen.derive import derive, derive_model
from rrrgen.lab.plant.plant import FlexibleJoints, make_plant
from rrrgen.program import count_operations, evaluate
from rrrgen.program.guard import add_guard
from rrrgen.robot.file import load_spec, loads_spec

EXACT = 1e-9


class Case:
    """A random robot with elastic joints and one motion."""

    def __init__(self, seed: int) -> None:
        self.robot = random_robot(7300 + seed, n=2 + seed % 2, prismatic=0.3)
        recorded = derive_model(loads_spec(to_yaml(self.robot)), ("elastic",))
        self.programs = dict(recorded.alternatives)
        n = self.n = self.robot.n
        rng = np.random.default_rng(seed)
        K = np.array(recorded.base_projection).reshape(-1, 10 * n)
        self.motion = rng.uniform(-1, 1, (5, n))
        self.values = dict(zip(("q", "dq", "ddq", "d3q", "d4q"), self.motion, strict=True))
        self.values |= {f"{name}_d": rng.uniform(-1, 1, n) for name in ("q", "dq", "ddq", "d3q", "d4q")}
        self.values |= {"rotor_inertia": rng.uniform(0.1, 1, n), "stiffness": rng.uniform(50, 900, n)}
        self.values |= {"damping": rng.uniform(0, 5, n), "beta": K @ self.robot.phi, "tau": rng.uniform(-9, 9, n)}
        self.values |= {"theta": self.q + rng.uniform(-0.1, 0.1, n), "dtheta": self.dq + rng.uniform(-1, 1, n)}
        self.values |= {"kp": rng.uniform(1, 50, n), "kd": rng.uniform(1, 9, n), "w": rng.uniform(3, 8, n)}
        self.values |= {"friction": np.zeros(3 * n), "width": np.ones(n), "tau_max": np.full(n, np.inf)}

    def __getattr__(self, name: str):
        return self.values[name]

    def __call__(self, name: str, way: int = 0, **changes):
        values = {**self.values, **changes}
        program = self.programs[name][way]
        found = evaluate(program, *(values[port.name] for port in program.inputs))
        return dict(zip((port.name for port in program.outputs), found, strict=True))

    def rotors(self, motion):
        """tau, theta and theta' for a motion of the links, by Cauchy's integrals over a circle of complex times."""
        radius, count = 0.05, 24
        turns = np.exp(2j * np.pi * np.arange(count) / count)
        powers = np.array([1, 1, 1 / 2, 1 / 6, 1 / 24])
        torques = []
        for t in radius * turns:
            q = (powers * t ** np.arange(5)) @ motion
            dq = (powers[:4] * t ** np.arange(4)) @ motion[1:]
            ddq = (powers[:3] * t ** np.arange(3)) @ motion[2:]
            torques.append(oracle.inverse_dynamics(self.robot, q, dq, ddq))
        tau_l, dtau_l, ddtau_l = (
            factor * np.mean(np.array(torques) * turns[:, None] ** -k, axis=0).real / radius**k
            for k, factor in enumerate((1, 1, 2))
        )
        theta, dtheta, ddtheta = (
            x + t / self.stiffness for x, t in zip(motion, (tau_l, dtau_l, ddtau_l), strict=False)
        )
        return self.rotor_inertia * ddtheta + tau_l, theta, dtheta


@pytest.fixture(scope="module", params=range(3))
def case(request):
    return Case(request.param)


def close(value, expected):
    np.testing.assert_allclose(value, expected, rtol=0, atol=EXACT * max(1.0, np.max(np.abs(expected))))


def test_inverse_dynamics(case):
    for way in range(2):
        found = case("elastic_inverse_dynamics", way)
        for value, expected in zip(found.values(), case.rotors(case.motion), strict=True):
            close(value, expected)


def test_forward_dynamics(case):
    load = case.stiffness * (case.theta - case.q) + case.damping * (case.dtheta - case.dq)
    found = case("elastic_forward_dynamics")
    close(found["ddq"], oracle.forward_dynamics(case.robot, case.q, case.dq, load))
    close(found["ddtheta"], (case.tau - load) / case.rotor_inertia)
    assert found["status"] == 0


def test_feedforward(case):
    desired = np.array([case.values[f"{name}_d"] for name in ("q", "dq", "ddq", "d3q", "d4q")])
    tau, theta, dtheta = case.rotors(desired)
    wanted = tau + case.kp * (theta - case.theta) + case.kd * (dtheta - case.dtheta)
    close(case("elastic_feedforward")["tau"], wanted)
    friction = np.tile([0.5, 0.3, 0.1], case.n)
    with_friction = case("elastic_feedforward", friction=friction)["tau"]
    close(with_friction, wanted + 0.5 * case.dq_d + 0.3 * np.tanh(case.dq_d) + 0.1)
    close(case("elastic_feedforward", tau_max=0.5 * np.abs(wanted))["tau"], 0.5 * wanted)


def test_feedback_linearization_gives_the_links_the_wanted_fourth_derivative(case):
    """The measured state is that of a motion whose fourth derivative the law has to change."""
    _, theta, dtheta = case.rotors(case.motion)
    desired = np.array([case.values[f"{name}_d"] for name in ("q", "dq", "ddq", "d3q", "d4q")])
    gains = np.stack([case.w**4, 4 * case.w**3, 6 * case.w**2, 4 * case.w])
    v = desired[4] + np.sum(gains * (desired[:4] - case.motion[:4]), axis=0)
    found = case("elastic_feedback_linearization", theta=theta, dtheta=dtheta)
    close(found["tau"], case.rotors(np.vstack([case.motion[:4], v]))[0])
    assert found["status"] == 0


# -- in simulation ------------------------------------------------------------------------------------------------

ROTORS = {"rotor_inertia": np.array([0.2, 0.1, 0.02]), "stiffness": np.array([4e3, 3e3, 800.0])}


@cache
def rrr():
    return rrrgen.compile("rrr")


def smooth(t, order):
    """A motion with derivatives of every order, at any state when it begins."""
    w, amplitude = np.array([3.0, 4.0, 5.0]), np.array([0.5, 0.4, 0.6])
    return amplitude * w**order * np.sin(w * t + order * np.pi / 2 + np.array([0.3, 1.0, 2.0]))


def motion_at(t):
    return [smooth(t, order) for order in range(5)]


def simulated(torque, damping, start=None, duration=0.3):
    """The state at the end under ``torque(t, state)``, from the state of the motion or from ``start``."""
    m = rrr()

    def rates(t, x):
        q, dq, theta, dtheta = x.reshape(4, 3)
        found = m.elastic_forward_dynamics(q, dq, theta, dtheta, torque(t, x), damping=damping, **ROTORS)
        return np.concatenate([dq, found.ddq, dtheta, found.ddtheta])

    if start is None:
        rotor = m.elastic_inverse_dynamics(*motion_at(0.0), **ROTORS)
        start = np.concatenate([smooth(0.0, 0), smooth(0.0, 1), rotor.theta, rotor.dtheta])
    return solve_ivp(rates, (0.0, duration), start, method="DOP853", rtol=1e-11, atol=1e-12).y[:, -1]


def test_spong_plant_in_open_loop():
    m, zero = rrr(), np.zeros(3)
    elastic = simulated(lambda t, x: m.elastic_inverse_dynamics(*motion_at(t), **ROTORS).tau, zero)
    rigid = simulated(lambda t, x: m.inverse_dynamics(*motion_at(t)[:3]) + ROTORS["rotor_inertia"] * smooth(t, 2), zero)
    error = np.max(np.abs(elastic[:3] - smooth(0.3, 0)))

    assert error < 1e-11
    assert np.max(np.abs(rigid[:3] - smooth(0.3, 0))) > 1e-4


def test_feedback_linearization_in_the_loop():
    """From an error of 0.02 rad: the error of four equal poles, e (1 + wt + (wt)^2/2 + (wt)^3/6) exp(-wt)."""
    m, w = rrr(), 40.0
    rotor = m.elastic_inverse_dynamics(*motion_at(0.0), **ROTORS)
    offset = np.array([0.02, -0.01, 0.015])
    other = m.elastic_inverse_dynamics(smooth(0.0, 0) + offset, *motion_at(0.0)[1:], **ROTORS)
    start = np.concatenate([smooth(0.0, 0) + offset, smooth(0.0, 1), other.theta, other.dtheta])
    assert np.any(other.theta != rotor.theta)

    def law(t, x):
        return m.elastic_feedback_linearization(
            *x.reshape(4, 3), *motion_at(t), np.full(3, w), width=1.0, friction=np.zeros(9), tau_max=np.full(3, np.inf),
            **ROTORS,
        )  # fmt: skip

    found = simulated(law, np.zeros(3), start, 0.1)
    z = w * 0.1
    left = offset * (1 + z + z**2 / 2 + z**3 / 6) * np.exp(-z)
    np.testing.assert_allclose(found[:3] - smooth(0.1, 0), left, atol=1e-10)


def test_virtual_robot_has_the_same_equations():
    m, D = rrr(), np.array([20.0, 10.0, 2.0])
    joints = FlexibleJoints(*(tuple(values) for values in (ROTORS["rotor_inertia"], ROTORS["stiffness"], D)))
    plant = make_plant(m, joints=joints)
    rng = np.random.default_rng(1)
    state, tau, layout = rng.uniform(-1, 1, 12), rng.uniform(-9, 9, 3), plant.layout
    rates = plant.state_derivative()(state, 0.0, tau)
    parts = [state[layout[name]] for name in ("q", "dq", "rotor", "rotor_speed")]
    found = m.elastic_forward_dynamics(*parts, tau, damping=D, **ROTORS)
    np.testing.assert_allclose(rates[layout["dq"]], found.ddq, rtol=1e-9)
    np.testing.assert_allclose(rates[layout["rotor_speed"]], found.ddtheta, rtol=1e-9)


@pytest.mark.parametrize(("robot", "most"), [("puma560", 2108 + 48), ("panda", 2661 + 56)])
def test_operations(robot, most):
    """Inverse dynamics with two derivatives, and 8 operations per joint for spring and rotor, before optimization."""
    recorded = derive_model(load_spec(robot), ("elastic",)).alternatives
    count = min((count_operations(way) for way in recorded["elastic_inverse_dynamics"]), key=lambda each: each.total)
    assert count.mul + count.add <= most


def test_operations_and_values_from_the_optimized_inverse_dynamics():
    """Beside the model the functions of a small robot come from its optimized inverse dynamics."""
    spec = load_spec("rrr")
    derived = derive(spec, groups=("model", "elastic"))
    count = count_operations(derived.programs["elastic_inverse_dynamics"])
    assert count.mul + count.add <= 475 + 24
    recorded = derive_model(spec, ("elastic",)).alternatives
    rng = np.random.default_rng(2)
    for name in ("elastic_inverse_dynamics", "elastic_feedforward", "elastic_feedback_linearization"):
        values = {port.name: rng.uniform(0.5, 2, port.shape) for port in recorded[name][0].inputs}
        values |= {"stiffness": np.full(3, 300.0), "tau_max": np.full(3, np.inf)}
        values["beta"] = np.array([float(value) for value in derived.beta_nominal])
        found, wanted = (
            evaluate(program, *(values[port.name] for port in program.inputs))
            for program in (derived.programs[name], add_guard(recorded[name][0]))
        )
        for value, expected in zip(found, wanted, strict=True):
            close(value, expected)
