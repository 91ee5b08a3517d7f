"""Operational-space control and contact: by their formulas from the independent dynamics, and near singular poses."""

from __future__ import annotations

import numpy as np
import pytest

from oracles import newton_euler as oracle
from oracles.random_robots import random_robot, to_yaml, transform
from rrrgen.derive import derive_model, prepare
from rrrgen.derive.functions import contact, operational_space
from rrrgen.derive.functions.table import functions_for, recorders
from rrrgen.program import evaluate
from rrrgen.robot.file import load_spec, loads_spec
from rrrgen.verify.references.numeric_robot import nominal_parameters

Ts = 1e-3


def close(value, expected, tolerance=1e-9):
    np.testing.assert_allclose(value, expected, rtol=0, atol=tolerance * max(1.0, np.max(np.abs(expected))))


def called(program, values):
    found = evaluate(program, *(np.asarray(values[port.name], float) for port in program.inputs))
    return dict(zip((port.name for port in program.outputs), found, strict=True))


class Case:
    """A random robot whose tip is to move, with the pose or the position of the tip as the task."""

    def __init__(self, joints: int, rows: int, seed: int) -> None:
        robot = self.robot = random_robot(7300 + seed, n=joints, prismatic=0)
        rng = np.random.default_rng(seed)
        derivation = prepare(loads_spec(to_yaml(robot)))
        task = operational_space.POSE if rows == 6 else operational_space.POSITION
        self.program = recorders(f"{task.prefix}operational_space")[0](derivation.recording())
        K = np.array(derivation.recording().parametrization.projection, dtype=float)
        q, dq = rng.uniform(-1, 1, (2, joints))
        T = oracle.forward_kinematics(robot, q)
        self.T_d = T @ transform((5, 1, -2, 1), (0.05, -0.02, 0.1))
        self.M, self.h = oracle.mass_matrix(robot, q), oracle.bias(robot, q, dq)
        self.J, self.drift = oracle.jacobian(robot, q)[:rows], oracle.jacobian_dot_dq(robot, q, dq)[:rows]
        turn = self.T_d[:3, :3] @ T[:3, :3].T
        skew = (turn - turn.T) / 2
        self.e = np.array([*(self.T_d - T)[:3, 3], skew[2, 1], skew[0, 2], skew[1, 0]])[:rows]
        v = self.values = {"q": q, "dq": dq, "T_d": self.T_d, "p_d": self.T_d[:3, 3], "beta": K @ robot.phi}
        v |= {name: rng.normal(size=rows) for name in ("V_d", "A_d", "z")}
        v |= {name: rng.uniform(1, 9, rows) for name in ("kp", "kd", "ki")}
        v |= {"tau_0": rng.normal(size=joints), "tau_add": rng.normal(size=joints)}
        v |= {"damping": 1e-9, "tau_max": np.full(joints, np.inf), "Ts": Ts}

    @property
    def wanted(self):
        """The acceleration of the tip that the law asks for."""
        v = self.values
        return v["A_d"] + v["kp"] * self.e + v["kd"] * (v["V_d"] - self.J @ v["dq"]) + v["ki"] * v["z"]

    def torques(self):
        M_inv, v, J = np.linalg.inv(self.M), self.values, self.J
        L = np.linalg.inv(J @ M_inv @ J.T)
        task = J.T @ L @ (self.wanted - self.drift)
        projected = (np.eye(len(self.M)) - J.T @ L @ J @ M_inv) @ v["tau_0"]
        return task + projected + self.h + v["tau_add"]


@pytest.mark.parametrize(("joints", "rows", "seed"), [(3, 3, 0), (4, 3, 1), (6, 6, 2), (7, 6, 3)])
def test_operational_space(joints, rows, seed):
    case = Case(joints, rows, seed)
    step = called(case.program, case.values)
    tau = case.torques()
    close(step["tau"], tau, 1e-7)
    close(step["z_next"], case.values["z"] + Ts * case.e)
    assert step["status"] == 0
    ddq = np.linalg.solve(case.M, step["tau"] - case.values["tau_add"] - case.h)
    close(case.J @ ddq + case.drift, case.wanted, 1e-7)  # whatever tau_0 is
    limit = 0.5 * np.abs(tau) + 0.01
    held = called(case.program, case.values | {"tau_max": limit})
    close(held["tau"], np.clip(tau, -limit, limit), 1e-7)
    close(held["z_next"], case.values["z"])


def test_the_tip_is_damped_where_it_cannot_move_and_the_torques_stay_continuous():
    """A Puma passes q5 = 0 while its tip is asked to turn about the axis that is lost there."""
    spec = load_spec("puma560")
    derivation = prepare(spec)
    program = recorders("operational_space")[0](derivation.recording())
    beta = np.array(derivation.recording().parametrization.projection, dtype=float) @ nominal_parameters(spec).ravel()
    values = {name: np.zeros(6) for name in ("dq", "V_d", "ki", "kp", "kd", "z", "tau_0", "tau_add")}
    values |= {"beta": beta, "tau_max": np.full(6, 1e9), "Ts": Ts, "T_d": np.eye(4)}
    values |= {"A_d": np.array([0, 0, 0, 5.0, -10.0, 20.0])}
    at_rest = values | {"A_d": np.zeros(6)}

    def sweep(damping):
        q = np.tile([0.3, -0.9, 0.4, 0.2, 0.0, 0.1], (300, 1))
        q[:, 4] = np.linspace(-0.3, 0.3, 300)
        step, still = (called(program, given | {"q": q, "damping": damping}) for given in (values, at_rest))
        return step["tau"] - still["tau"], step["status"]

    tau, status = sweep(0.01)
    assert np.all(status[140:160] == 1)
    assert not np.any(status[[0, -1]])
    assert np.abs(tau).max() < 8 * np.abs(tau[[0, -1]]).max()
    assert np.abs(np.diff(tau, axis=0)).max() < 0.2 * np.abs(tau).max()
    undamped, _ = sweep(1e-12)
    assert np.abs(undamped).max() > 10 * np.abs(tau).max()
    close(undamped[0], tau[0])
    values["q"] = np.tile([0.3, -0.9, 0.4, 0.2, 0.0, 0.1], (2, 1))
    step = called(program, values | {"damping": 0.0})  # the tip can move, but no torque says how: not in silence
    assert np.all(step["status"] == 1)


def test_contact_compares_with_thresholds():
    derivation = prepare(load_spec("rrr"))
    program = recorders("contact")[0](derivation.recording())
    given = {"r_last": [1.0, -3.0, 0.5], "change_last": np.zeros(3), "gain": 50.0, "Ts": 1e-3}
    given |= {"threshold": [2.0, 2.0, np.inf], "change_threshold": [0.1, 0.1, np.inf]}
    found = called(program, given | {"r": [1.0, -3.0, 0.5]})
    close(found["ratio"], [0.5, 1.5, 0.0])
    assert found["touches"] == 1
    assert called(program, given | {"r": [1.0, -1.9, 9.0], "r_last": [1.0, -1.9, 0.0]})["touches"] == 0
    assert called(program, given | {"r": [1.0, -1.9, 9.0], "r_last": [0.8, -1.9, 0.0]})["touches"] == 1


def test_the_change_is_what_an_observer_twice_as_fast_sees_before():
    """Estimates of the same torques by observers with poles K and 2K: the recursion gives their difference."""
    program = recorders("contact")[0](prepare(load_spec("pendulum")).recording())
    gain, y = 60.0, np.random.default_rng(5).normal(size=40)
    slow = fast = r_last = change = 0.0
    for value in y:
        r_last, slow = slow, slow + (1 - np.exp(-gain * Ts)) * (value - slow)
        fast += (1 - np.exp(-2 * gain * Ts)) * (value - fast)
        given = {"r": [slow], "r_last": [r_last], "change_last": [change], "gain": gain, "Ts": Ts}
        change = float(called(program, given | {"threshold": [1.0], "change_threshold": [1.0]})["change"][0])
        assert change == pytest.approx(fast - slow, abs=1e-14)


@pytest.mark.parametrize(
    ("load", "name"), [(contact.WRENCH, "puma560"), (contact.WRENCH, "iiwa14"), (contact.FORCE, "rrr")]
)
def test_external_loads_by_weighted_least_squares(load, name):
    program = recorders(load.name)[0](prepare(load_spec(name)).recording())
    joints = program.inputs[1].size
    rng = np.random.default_rng(joints)
    J = rng.normal(size=(6, joints))
    r, L = rng.normal(size=joints), np.tril(rng.uniform(0.1, 2, (joints, joints)))
    found = called(program, {"J": J, "r": r, "covariance": L @ L.T})
    A = np.linalg.solve(L, J[: load.rows].T)
    F = np.linalg.lstsq(A, np.linalg.solve(L, r), rcond=None)[0]
    close(found["F"], F, 1e-8)
    close(found["P"], np.linalg.inv(A.T @ A), 1e-8)
    spread = [np.sqrt(np.mean(np.sum(A[:, part : part + 3] ** 2, axis=0))) for part in range(0, load.rows, 3)]
    singular = np.linalg.svd(A / np.repeat(spread, 3), compute_uv=False)
    assert float(found["condition"]) == pytest.approx(np.sqrt(np.mean(singular**2) * np.mean(1 / singular**2)))
    assert found["condition"] <= singular[0] / singular[-1] <= load.rows * found["condition"]
    for lacking in ({"J": 0 * J, "covariance": L @ L.T}, {"J": J, "covariance": np.ones((joints, joints))}):
        lost = called(program, lacking | {"r": r})
        assert lost["status"] == 1
        assert not np.any(lost["F"])


THROUGH_ONE_POINT = """\
schema: rrrgen/1
name: wrist
convention: standard
units: {angle: deg, length: m}
gravity: [0, 0, -9.81]
base: {translation: [0.1, 0.2, 0.7], rpy: [20, 30, 40]}
joints:
  - {name: roll, type: revolute, alpha: 90, a: 0, d: 0, theta: 20}
  - {name: pitch, type: revolute, alpha: -70, a: 0, d: 0, theta: 10}
  - {name: yaw, type: revolute, alpha: 0, a: 0, d: 0}
"""

BESIDE_THE_TIP = """\
schema: rrrgen/1
name: torso
convention: modified
units: {angle: deg, length: m}
gravity: [0, 0, -9.81]
joints:
  - {name: yaw, type: revolute, alpha: 0, a: 0, d: 0.5}
  - {name: j1, type: revolute, alpha: 90, a: 0.1, d: 0}
  - {name: j2, type: revolute, alpha: 0, a: 0.3, d: 0}
  - {name: j3, type: revolute, alpha: 90, a: 0, d: 0.2}
  - {name: k1, type: revolute, alpha: -90, a: 0.1, d: 0, parent: yaw}
  - {name: k2, type: revolute, alpha: 0, a: 0.3, d: 0}
tip: yaw
tool: {translation: [0, 0, 0.4]}
"""


@pytest.mark.parametrize("text", [THROUGH_ONE_POINT, BESIDE_THE_TIP])
def test_a_tip_whose_position_no_joint_moves_has_no_control_of_it(text):
    spec = loads_spec(text)
    assert operational_space.tip_moves(spec) == (False, True)
    names = {function.name for function in functions_for(spec, ("control",))}
    assert "computed_torque" in names
    assert not names & {"operational_space", "position_operational_space"}
    derive_model(spec, ("control", "points", "observer"))
    moved = loads_spec(text.partition("tool:")[0] + "tool: {translation: [0, 0.1, 0.4]}\n")
    assert operational_space.tip_moves(moved) == (True, True)
    assert "position_operational_space" in {function.name for function in functions_for(moved, ("control",))}
    derive_model(moved, ("control",))


def test_gantries_do_not_turn_the_tip():
    rows = "".join(f"  - {{type: prismatic, alpha: {alpha}, a: 0, theta: 0}}\n" for alpha in (90, 90, 0, 90, 90, 0))
    spec = loads_spec(THROUGH_ONE_POINT.partition("  - {name")[0] + rows)
    assert operational_space.tip_moves(spec) == (True, False)
    assert {f.name for f in functions_for(spec, ("control",))} & {"operational_space"} == set()
    derive_model(spec, ("control",))
