"""Control laws, the momentum observer and motions: by their formulas from the independent dynamics, and in the loop."""

from __future__ import annotations

from functools import cached_property

import numpy as np
import pytest

from oracles import lagrange
from oracles import newton_euler as oracle
from oracles.random_robots import random_robot, to_yaml, transform
from rrrgen.derive import derive_model
from rrrgen.program import evaluate
from rrrgen.robot.file import load_spec, loads_spec

EXACT = 1e-9
Ts = 1e-3


class Case:
    """A random robot with one state, one desired motion, gains and friction, and its functions by name."""

    def __init__(self, seed: int) -> None:
        self.robot = random_robot(6100 + seed, n=2 + seed % 2, prismatic=0.3)
        rng = np.random.default_rng(seed)
        n = self.robot.n
        recorded = derive_model(loads_spec(to_yaml(self.robot)), ("control", "observer", "trajectory"))
        self.programs = {name: ways[0] for name, ways in recorded.alternatives.items()}
        K = np.array(recorded.base_projection).reshape(-1, 10 * n)
        self.values = {name: rng.uniform(-1, 1, n) for name in ("q", "dq", "q_d", "dq_d", "ddq_d", "z", "tau")}
        self.values |= {name: rng.uniform(1, 20, n) for name in ("kp", "kd", "ki", "lam", "k")}
        self.values |= {name: rng.uniform(-1, 1, n) for name in ("p_last", "u_last", "r_last")}
        self.values |= {"beta": K @ self.robot.phi, "friction": rng.uniform(0.1, 1, 3 * n), "width": np.full(n, 0.2)}
        self.values |= {"tau_max": np.full(n, np.inf), "Ts": Ts, "gain": 50.0}
        self.values |= {"gamma": rng.uniform(0, 5, len(K)), "beta_min": np.full(len(K), -1e9)}
        self.values |= {"beta_max": np.full(len(K), 1e9)}

    def __getattr__(self, name: str):
        return self.values[name]

    def __call__(self, name: str, **changes):
        values = {**self.values, **changes}
        program = self.programs[name]
        found = evaluate(program, *(np.asarray(values[port.name], float) for port in program.inputs))
        return dict(zip((port.name for port in program.outputs), found, strict=True))

    def friction_at(self, speeds):
        viscous, coulomb, offset = self.friction.reshape(-1, 3).T
        return viscous * speeds + coulomb * np.tanh(speeds / 0.2) + offset

    @cached_property
    def M(self):
        return oracle.mass_matrix(self.robot, self.q)

    @cached_property
    def C(self):
        return lagrange.christoffel_matrix(self.robot, self.q, self.dq)

    @cached_property
    def g(self):
        return lagrange.gravity(self.robot, self.q)

    @property
    def feedback(self):
        return self.kp * (self.q_d - self.q) + self.kd * (self.dq_d - self.dq) + self.ki * self.z

    def torques(self, name: str):
        """Torques of a law without limits, by its formula."""
        f = self.friction_at(self.dq_d)
        if name == "pd_gravity":
            return self.feedback + self.g + f
        if name == "feedforward":
            return oracle.inverse_dynamics(self.robot, self.q_d, self.dq_d, self.ddq_d) + self.feedback + f
        return self.M @ (self.ddq_d + self.feedback) + self.C @ self.dq + self.g + f


@pytest.fixture(params=range(4))
def case(request):
    return Case(request.param)


def close(value, expected):
    np.testing.assert_allclose(value, expected, rtol=0, atol=EXACT * max(1.0, np.max(np.abs(expected))))


@pytest.mark.parametrize("name", ["pd_gravity", "feedforward", "computed_torque"])
def test_laws_with_integral_action(case, name):
    wanted = case.torques(name)
    free = case(name)
    close(free["tau"], wanted)
    close(free["z_next"], case.z + Ts * (case.q_d - case.q))
    limit = 0.5 * np.abs(wanted) + 0.01  # below every torque
    held = case(name, tau_max=limit)
    close(held["tau"], np.clip(wanted, -limit, limit))
    into = wanted * (case.q_d - case.q) > 0
    close(held["z_next"], np.where(into, case.z, case.z + Ts * (case.q_d - case.q)))


def test_slotine_li(case):
    v = case.dq_d + case.lam * (case.q_d - case.q)
    a = case.ddq_d + case.lam * (case.dq_d - case.dq)
    s = case.dq - v
    tau = case.M @ a + case.C @ v + case.g - case.k * s + case.friction_at(case.dq_d)
    step = case("slotine_li")
    close(step["tau"], tau)
    slope = (case.beta - step["beta_next"]) / (Ts * case.gamma)
    # Y' s is linear in s: the power that it takes from the parameters is that of the reference torques
    close(slope @ case.beta, s @ (case.M @ a + case.C @ v + case.g))
    held = case("slotine_li", tau_max=0.5 * np.abs(tau) + 0.01)
    close(held["beta_next"], case.beta)
    bounded = case("slotine_li", beta_min=case.beta, beta_max=case.beta)
    close(bounded["beta_next"], case.beta)


def test_impedance(case):
    J, T = oracle.jacobian(case.robot, case.q), oracle.forward_kinematics(case.robot, case.q)
    rng = np.random.default_rng(3)
    T_d = T @ transform((5, 1, -2, 1), (0.05, -0.02, 0.1))
    given = {"T_d": T_d, "V_d": rng.normal(size=6)}
    given |= {"stiffness": rng.uniform(50, 90, 6), "damping": rng.uniform(1, 9, 6)}
    turn = T_d[:3, :3] @ T[:3, :3].T  # its skew part is sin(angle) times the axis
    skew = (turn - turn.T) / 2
    error = [*(T_d[:3, 3] - T[:3, 3]), skew[2, 1], skew[0, 2], skew[1, 0]]
    F = given["stiffness"] * error + given["damping"] * (given["V_d"] - J @ case.dq)
    tau = J.T @ F + case.g
    close(case("impedance", **given)["tau"], tau)
    limit = 0.5 * np.abs(tau) + 0.01
    close(case("impedance", **given, tau_max=limit)["tau"], np.clip(tau, -limit, limit))


def test_momentum_observer(case):
    p, u = case.M @ case.dq, case.C.T @ case.dq - case.g - case.friction_at(case.dq)
    start = case("momentum_observer_start")
    close(start["p"], p)
    close(start["u"], u)
    y = (p - case.p_last) / Ts - case.tau - (u + case.u_last) / 2
    alpha = np.exp(-50.0 * Ts)
    step = case("momentum_observer")
    close(step["r"], alpha * case.r_last + (1 - alpha) * y)
    close(step["p"], p)
    close(step["u"], u)


@pytest.fixture(scope="module")
def motions():
    return {name: ways[0] for name, ways in derive_model(load_spec("rrr"), ("trajectory",)).alternatives.items()}


def test_quintic_meets_its_ends_and_is_smooth(motions):
    rng = np.random.default_rng(0)
    ends, T = rng.normal(size=(6, 3)), 0.7
    at = lambda t: evaluate(motions["quintic"], t, T, *ends)  # noqa: E731
    for time, wanted in ((0.0, ends[:3]), (-1.0, ends[:3]), (T, ends[3:]), (2.0, ends[3:])):
        for value, expected in zip(at(time), wanted, strict=True):
            np.testing.assert_allclose(value, expected, atol=1e-12)
    h = 1e-5
    for t in (0.1, 0.33, 0.6):
        ahead, here, behind = at(t + h), at(t), at(t - h)
        for order in (0, 1):
            slope = (ahead[order] - behind[order]) / (2 * h)
            np.testing.assert_allclose(slope, here[order + 1], atol=1e-6)


@pytest.mark.parametrize("way", [[1.0, -0.5, 0.25], [0.01, 0.02, -0.001], [0.0, 0.0, 0.0], [0.0, 3.0, 0.0]])
def test_trapezoidal_motion_keeps_its_limits_and_is_the_fastest(motions, way):
    q0, speed, acceleration = np.array([0.2, -0.1, 0.4]), np.array([1.0, 2.0, 0.5]), np.array([4.0, 3.0, 8.0])
    q1 = q0 + way
    at = lambda t: evaluate(motions["trapezoidal"], t, q0, q1, speed, acceleration)  # noqa: E731
    T = float(at(0.0)[3])
    times = np.linspace(-0.1, T + 0.1, 801)
    q, dq, ddq = (np.array(part) for part in zip(*(at(t)[:3] for t in times), strict=True))
    np.testing.assert_allclose(q[[0, -1]], [q0, q1], atol=1e-12)
    assert np.all(np.abs(dq) <= speed * (1 + 1e-9))
    assert np.all(np.abs(ddq) <= acceleration * (1 + 1e-9))
    np.testing.assert_allclose(q0 + np.cumsum(dq, axis=0) * (times[1] - times[0]), q, atol=3e-3 * max(T, 1))
    if np.any(way):  # a limit is met: of one joint the speed, or the acceleration all the way
        assert np.max(np.abs(dq) / speed) > 0.99 or np.max(np.abs(ddq) / acceleration) > 0.999
        W, B = np.max(np.abs(way) / speed), np.max(np.abs(way) / acceleration)
        assert pytest.approx(W + B / W if W * W >= B else 2 * np.sqrt(B)) == T
    else:
        assert T == 0


LOADED = """schema: rrrgen/1
name: loaded
convention: standard
units: {angle: rad, length: m}
gravity: [0, -9.81, 0]
joints:
  - {name: a, type: revolute, alpha: 0, a: 1, d: 0, friction: {law: load_dependent, load_ratio: 0.1}}
  - {name: b, type: revolute, alpha: 0, a: 1, d: 0, friction: {law: load_dependent, load_ratio: 0.2}}
"""


def test_the_load_of_friction_is_the_torque_before_it():
    """Laws compensate friction under the torque they command, the observer under the weight; retyped from the law."""
    recorded = derive_model(loads_spec(LOADED), ("control", "observer"))
    rng = np.random.default_rng(0)
    p = rng.uniform(0.1, 1, (2, 4))  # coulomb, viscous, load_ratio, offset

    def run(name, friction):
        program = recorded.alternatives[name][0]
        rng = np.random.default_rng(1)
        values = {port.name: rng.uniform(0.5, 2, port.shape) for port in program.inputs}
        values |= {"friction": friction.ravel(), "tau_max": np.full(2, np.inf)}
        found = evaluate(program, *(values[port.name] for port in program.inputs))
        return found, values

    def law(speed, width, load):
        s = np.tanh(speed / width)
        return (p[:, 0] + p[:, 2] * np.abs(load)) * s + p[:, 1] * speed + p[:, 3]

    for name in ("pd_gravity", "feedforward", "computed_torque", "slotine_li"):
        (before, *_), (after, *_) = run(name, np.zeros((2, 4)))[0], run(name, p)[0]
        values = run(name, p)[1]
        close(after - before, law(values["dq_d"], values["width"], before))
    (_, before), values = run("momentum_observer_start", np.zeros((2, 4)))
    (_, after), _ = run("momentum_observer_start", p)
    difference = before - after - law(values["dq"], values["width"], 0.0)
    share = difference / (p[:, 2] * np.tanh(values["dq"] / values["width"]))
    model = derive_model(loads_spec(LOADED)).alternatives["gravity"][0]
    (weight,) = evaluate(model, *(values[port.name] for port in model.inputs))
    close(share, np.abs(weight))
