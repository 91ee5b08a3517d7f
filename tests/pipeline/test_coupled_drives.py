"""Coupled drives through the whole compiler, against an equation of motion written down by hand.

``tau = tau_rigid + Ia ddq + tau_f(dq) + S^-T (Ia_m ddq_m + tau_fm(dq_m))``, ``dq = S dq_m``: tau_rigid is the oracle's.
"""

from __future__ import annotations

import numpy as np
import pytest

import rrrgen
from emit.c_tools import C99, CXX, compile_all, compiler, emitted, run
from oracles import newton_euler as oracle
from oracles.random_robots import random_robot, to_yaml
from rrrgen.cli.show import as_data, as_text
from rrrgen.derive import derive_model
from rrrgen.emit.html import html_report
from rrrgen.emit.latex.equations import plain
from rrrgen.emit.package import emit
from rrrgen.lab.design.problem import ExcitationLimits
from rrrgen.lab.design.robot import robot_problem
from rrrgen.robot.file import dumps, loads_spec
from rrrgen.verify import verify

ROUND_OFF = 1e-11  # relative to the largest torque
GEARS = (45.0, -32.0, 20.0)
COUPLING = np.array([[1.0, 0.0, 0.25], [-0.5, 1.0, 0.0], [0.0, -1 / 3, 2.0]])  # joint speeds from the drives'
ROTORS = (2e-4, None, 5e-4)
MOTOR_FRICTION = ({"viscous": 1e-3, "coulomb": 0.02, "offset": -0.01}, {"coulomb": 0.03}, None)
JOINT_INERTIA = (None, 0.3, None)
JOINT_FRICTION = (None, {"viscous": 0.4, "coulomb": 1.5}, {"offset": 0.2})


def text_with_coupled_drives(robot) -> str:
    """The robot's file with drive inertia and friction at joints and at motors, with fields left out."""
    lines, k = [], 0
    for line in to_yaml(robot).splitlines():
        if line.startswith("  - {type: "):
            added = [] if JOINT_INERTIA[k] is None else [f"drive: {{inertia: {JOINT_INERTIA[k]}}}"]
            added += [] if JOINT_FRICTION[k] is None else [f"friction: {flow(JOINT_FRICTION[k])}"]
            line, k = ", ".join([line[:-1], *added]) + "}", k + 1
        lines.append(line)
    n = robot.n
    lines += ["drives:", "  joint_from_drive:"]
    lines += [f"    - [{', '.join('-1/3' if v == -1 / 3 else f'{v:g}' for v in row[:n])}]" for row in COUPLING[:n]]
    lines.append("  motors:")
    for i in range(n):
        entries = {"name": f"drive_{i + 1}", "gear_ratio": f"{GEARS[i]:g}"}
        entries |= {} if ROTORS[i] is None else {"inertia": ROTORS[i]}
        entries |= {} if MOTOR_FRICTION[i] is None else {"friction": flow(MOTOR_FRICTION[i])}
        lines.append(f"    - {flow(entries)}")
    return "\n".join(lines) + "\n"


def flow(entries) -> str:
    return "{" + ", ".join(f"{key}: {value}" for key, value in entries.items()) + "}"


class Truth:
    """What the functions of the model must answer."""

    def __init__(self, robot) -> None:
        self.robot, self.n = robot, robot.n
        self.S = COUPLING[: self.n, : self.n] / np.array(GEARS[: self.n])
        rotors = np.diag([value or 0.0 for value in ROTORS[: self.n]])
        inverse = np.linalg.inv(self.S)
        self.driven = np.diag([v or 0.0 for v in JOINT_INERTIA[: self.n]]) + inverse.T @ rotors @ inverse

    def mass(self, q):
        return np.array([oracle.mass_matrix(self.robot, x) for x in q]) + self.driven

    def bias(self, q, dq):
        return np.array([oracle.bias(self.robot, *x) for x in zip(q, dq, strict=True)])

    def friction(self, dq):
        motors = np.linalg.solve(self.S, dq.T).T
        at_motors = self.law(MOTOR_FRICTION, motors)
        return self.law(JOINT_FRICTION, dq) + np.linalg.solve(self.S.T, at_motors.T).T

    def law(self, given, rates):
        fv, fc, off = (
            np.array([(given[i] or {}).get(name, 0.0) for i in range(self.n)])
            for name in ("viscous", "coulomb", "offset")
        )
        return fv * rates + fc * np.sign(rates) + off


@pytest.fixture(scope="module", params=[(2, 21), (3, 48)], ids=lambda p: f"{p[0]}-joints")
def case(request):
    """Two revolute joints; two revolute joints and a sliding one."""
    joints, seed = request.param
    robot = random_robot(seed, n=joints)
    spec = loads_spec(text_with_coupled_drives(robot))
    model = rrrgen.compile(spec, backend="c" if joints == 3 else "numpy")
    states = [np.random.default_rng(seed + k).uniform(-2, 2, (9, joints)) for k in range(3)]
    return Truth(robot), model, states


def test_the_equation_of_motion(case):
    truth, model, (q, dq, ddq) = case
    M, bias = truth.mass(q), truth.bias(q, dq)
    tau = np.einsum("bij,bj->bi", M, ddq) + bias
    scale = np.abs(tau).max()
    assert np.abs(model.mass_matrix(q) - M).max() <= ROUND_OFF * np.abs(M).max()
    assert np.abs(model.dynamics_terms(q, dq).M - M).max() <= ROUND_OFF * np.abs(M).max()
    assert np.abs(model.bias(q, dq) - bias).max() <= ROUND_OFF * scale
    assert np.abs(model.inverse_dynamics(q, dq, ddq) - tau).max() <= ROUND_OFF * scale
    again = np.einsum("bij,bj->bi", M, model.forward_dynamics(q, dq, tau)) + bias
    assert np.abs(again - tau).max() <= ROUND_OFF * scale
    kinetic, _ = model.energy(q, dq)
    assert np.abs(kinetic - 0.5 * np.einsum("bi,bij,bj->b", dq, M, dq)).max() <= ROUND_OFF * np.abs(kinetic).max()
    friction = truth.friction(dq)
    assert np.abs(model.friction(dq) - friction).max() <= ROUND_OFF * np.abs(friction).max()
    whole = model.identification_regressor(q, dq, ddq) @ model.identification_parameters
    assert np.abs(whole - tau - friction).max() <= ROUND_OFF * np.abs(whole).max()


def test_drives_that_move_one_joint_each_are_those_of_the_joints():
    """With the unit matrix the same programs are recorded as from `drive` and `friction` of the joints."""
    stated = ", drive: {inertia: 0.3}, friction: {viscous: 2}}"
    lines = to_yaml(random_robot(21, n=2)).splitlines()
    joints = "\n".join(line[:-1] + stated if line.startswith("  - {type: ") else line for line in lines) + "\n"
    rows = "".join(f"    - {{name: m{i}, inertia: 0.3, friction: {{viscous: 2}}}}\n" for i in (1, 2))
    motors = to_yaml(random_robot(21, n=2)) + f"drives:\n  joint_from_drive: [[1, 0], [0, 1]]\n  motors:\n{rows}"
    one, other = (derive_model(loads_spec(text)).alternatives for text in (joints, motors))
    assert one.keys() == other.keys()
    assert "friction" in one
    for name in one:
        for left, right in zip(one[name], other[name], strict=True):
            assert (left.nodes, left.results) == (right.nodes, right.results), name


def test_inertia_can_be_given_at_run_time(case):
    truth, model, (q, _, _) = case
    rigid = truth.mass(q) - truth.driven
    doubled = model.mass_matrix(q, model.beta, Ia=2 * model.drive_inertia)
    assert np.abs(doubled - rigid - 2 * truth.driven).max() <= ROUND_OFF * np.abs(doubled).max()
    assert model.drive_inertia.shape == (truth.n,)
    with pytest.raises(ValueError, match="Ia"):
        model.mass_matrix(q, model.beta, Ia=np.ones(truth.n + 1))


def test_the_parameters_are_named_after_joints_and_motors(case):
    truth, model, _ = case
    names = ["Ia2", "fv2", "fc2", "Ia_drive_1", "fv_drive_1", "fc_drive_1", "off_drive_1", "fc_drive_2"]
    if truth.n == 3:
        names = [*names[:3], "off3", *names[3:], "Ia_drive_3"]
    assert model.identification_parameter_names[len(model.base_parameters) :] == tuple(names)


@pytest.mark.sweep(but=["2-joints"])
def test_the_model_is_verified_with_them(case):
    report = verify(case[1], samples=20)
    assert report.ok, report.to_text()
    checked = " ".join(row.function for row in report.rows)
    assert "inverse_dynamics_derivatives: M" in checked
    assert "friction" in checked


def test_verification_finds_a_coupling_that_is_left_out(case):
    """The reference is built from the file; here the model is that of another one."""
    spec = case[1].spec
    for other in (
        spec.drives.__class__(spec.drives.joint_from_drive[::-1], spec.drives.motors),
        spec.drives.__class__(spec.drives.joint_from_drive, spec.drives.motors[::-1]),
    ):
        wrong = rrrgen.compile(loads_spec(dumps(spec)), backend="numpy")
        wrong.spec = spec.__class__(**{**vars(spec), "drives": other})
        report = verify(wrong, samples=5, libraries=False)
        failed = {row.function for row in report.rows if not row.ok}
        assert {"inverse_dynamics", "mass_matrix", "friction", "energy, kinetic"} <= failed


@pytest.mark.parametrize("real", ["double", "float"])
@pytest.mark.sweep(but=["2-joints-float"])
def test_the_emitted_self_test_passes(case, real, tmp_path):
    program = compile_all(emitted(case[1].derived, tmp_path, real), [compiler("gcc"), *C99, "-O1"])
    done = run(program)
    assert done.returncode == 0, done.stdout
    if real == "double":
        compile_all(tmp_path, [compiler("g++"), *CXX, "-O0"])


def test_casadi_computes_the_same(case):
    casadi = pytest.importorskip("casadi")
    truth, model, (q, dq, ddq) = case
    tau = np.einsum("bij,bj->bi", truth.mass(q), ddq) + truth.bias(q, dq)
    inverse, friction = model.casadi_function("inverse_dynamics_nominal"), model.casadi_function("friction")
    for k in range(3):
        found = np.array(casadi.DM(inverse(q[k], dq[k], ddq[k]))).ravel()
        assert np.abs(found - tau[k]).max() <= ROUND_OFF * np.abs(tau).max()
        lost = np.array(casadi.DM(friction(dq[k]))).ravel()
        assert np.abs(lost - truth.friction(dq)[k]).max() <= ROUND_OFF * np.abs(truth.friction(dq)).max()


def test_torques_that_an_excitation_bounds_hold_the_drives(case):
    casadi = pytest.importorskip("casadi")
    truth, model, (q, dq, ddq) = case
    limits = ExcitationLimits(speed=(1.0,) * truth.n, torque=(1.0,) * truth.n)
    torque = casadi.Function.deserialize(robot_problem(model, limits).torque)
    tau = np.einsum("bij,bj->bi", truth.mass(q), ddq) + truth.bias(q, dq) + truth.friction(dq)
    found = np.array([np.array(casadi.DM(torque(*state))).ravel() for state in zip(q, dq, ddq, strict=True)])
    assert np.abs(found - tau).max() <= ROUND_OFF * np.abs(tau).max()


def test_what_is_printed_names_the_coupling(case):
    truth, model, _ = case
    derived = model.derived
    files = emit(derived)
    header, manifest = files[f"{model.spec.name}.h"], files["manifest.json"]
    for text in (header, as_text(derived), html_report(derived, {}).replace("²", "^2")):
        assert "-1/2*drive_1 + drive_2" in text.replace("−", "-")
        assert "gear ratio 45, inertia 0.0002 kg m^2, viscous 0.001 N m s/rad, coulomb 0.02 N m" in " ".join(
            text.replace("*\n", "\n").replace("\n *", "\n").split()
        )
    data = as_data(derived, {}, None)["drives"]
    assert data["joint_from_drive"][1][:2] == ["-1/2", "1"]
    assert data["motors"][0] == {
        "name": "drive_1", "type": "revolute", "gear_ratio": "45", "inertia": 2e-4, "viscous": 1e-3, "coulomb": 0.02,
        "offset": -0.01, "torque_limit": None,
    }  # fmt: skip
    assert '"joint_from_drive"' in manifest
    assert "Ia_drive_1" in header
    forms = plain({"mass_matrix": model.closed_form("mass_matrix").matrix()}) if truth.n == 2 else "Ia_drive_1"
    assert "Ia_drive_1" in forms
