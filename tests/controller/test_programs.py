"""The controller as a unit: against the stateless laws, under faults, and its structs against the C compiler."""

from __future__ import annotations

import re
import shutil
import subprocess

import numpy as np
import pytest

from controller.fault_table import ARMS, built, outcome
from controller.units import Ts


def motion(t):
    w = np.array([1.0, 1.5, 2.0])
    return 0.3 * (1 - np.cos(w * t)), 0.3 * w * np.sin(w * t), 0.3 * w * w * np.cos(w * t)


@pytest.mark.parametrize("mode", ["pd_gravity", "feedforward", "computed_torque"])
def test_torques_are_those_of_the_law(rrr, controller, mode):
    c = controller(mode)
    q, dq = np.array([0.2, -0.4, 0.3]), np.array([0.3, -0.1, 0.2])
    c.start(q=q, dq=dq)
    z, p = np.zeros(3), c.params
    names = ("kp", "kd", "ki") if mode == "computed_torque" else ("pd_kp", "pd_kd", "pd_ki")
    c.set(**{names[2]: np.ones(3)})
    gains = [getattr(p, name) for name in names]
    limits = {"friction": p.friction, "tau_max": p.tau_max}
    for k in range(5):
        q_d, dq_d, ddq_d = motion(0.1 + k * Ts)
        out = c.step(q=q, dq=dq, q_d=q_d, dq_d=dq_d, ddq_d=ddq_d)
        step = getattr(rrr, mode)(q, dq, q_d, dq_d, ddq_d, *gains, z, width=p.friction_width, Ts=Ts, **limits)
        z = step.z_next
        np.testing.assert_allclose(out.tau, step.tau, rtol=1e-13)


def test_a_change_of_mode_is_without_a_step(controller):
    c = controller("gravity")
    q = np.array([0.2, -0.4, 0.3])
    c.start(q=q, dq=np.zeros(3))
    before = c.step(q=q, dq=np.zeros(3)).tau.copy()
    after = c.step(mode="computed_torque", q_d=q + 0.1).tau.copy()
    np.testing.assert_allclose(after, before, rtol=1e-12)
    for _ in range(1000):
        last = c.step().tau.copy()
    assert np.abs(last - before).max() > 1.0


@pytest.mark.parametrize("mode", ["pd_gravity", "computed_torque", "impedance", "operational_space", "velocity"])
def test_a_change_of_mode_in_motion_is_without_a_step(rrr, controller, mode):
    """The velocity of the tip is not the wanted one, and the drives have no limit of acceleration."""
    c = controller("gravity", ddq_max=np.inf)
    q, dq = np.array([0.2, -0.4, 0.8]), np.array([1.5, -1.0, 2.0])
    c.start(q=q, dq=dq)
    torques = [c.step(q=q, dq=dq).tau.copy()]
    given = {"q_d": q, "dq_d": 0 * q, "ddq_d": 0 * q, "T_d": rrr.forward_kinematics(q).ravel(), "V_d": np.zeros(6)}
    torques += [c.step(q=q, dq=dq, mode=mode, **given).tau.copy() for _ in range(20)]
    bump = np.abs(torques[0] - c.step(q=q, dq=dq).tau).max()
    assert np.abs(np.diff(torques, axis=0)).max() < max(0.2 * bump, 2.0)


@pytest.mark.sweep(but=["rrr"])
@pytest.mark.parametrize(
    ("robot", "real", "parts", "compiler", "flags"),
    [
        (ARMS[0], "double", ["kalman", "estimator", "observer"], ["gcc", "-std=c99"], ["-O0"]),
        (ARMS[1], "float", None, ["clang", "-std=c99"], ["-O2", "-ffast-math", "-fno-sanitize=all"]),
        pytest.param(ARMS[2], "double", None, ["g++", "-std=c++17", "-x", "c++"], ["-O0"], marks=pytest.mark.sweep),
    ],
    ids=["rrr", "Own6", "panda"],
)
def test_every_fault_in_every_mode_is_as_the_table_says(robot, real, parts, compiler, flags, tmp_path):
    if shutil.which(compiler[0]) is None:
        pytest.skip(f"needs {compiler[0]}")
    passed, text = outcome(built(robot, tmp_path, real, parts, compiler, flags), 20000)
    assert passed, text
    counts = {
        word.strip(" ,;"): int(count)
        for word, count in re.findall(r"([a-z ]+) (\d+)(?:,|$)", text.split("episodes:")[1])
    }
    assert sum(counts.values()) > 80
    assert counts["reference not finite"] >= 10


def test_a_push_is_felt_after_a_damaged_sample(rrr, controller):
    c = controller("computed_torque", threshold=10.0, contact_action=1)
    q, dq = np.array([0.2, -0.4, 0.3]), np.zeros(3)
    target = q.copy()
    c.start(q=q, dq=dq)
    touched = []
    for k in range(400):
        seen = np.full(3, np.nan) if k == 100 else q
        out = c.step(q=seen, dq=dq, q_d=target, dq_d=np.zeros(3), ddq_d=np.zeros(3))
        push = np.array([0.0, 30.0, 0.0]) if k > 200 else np.zeros(3)
        dq = dq + Ts * rrr.forward_dynamics(q, dq, out.tau + push)
        q = q + Ts * dq
        touched.append("CONTACT" in c.faults(out.status))
    assert not any(touched[:200])
    assert any(touched[200:230])
    assert c.modes[out.mode] == "gravity"


def test_generated_with_the_filter_and_its_self_test(tmp_path):
    from click.testing import CliRunner

    from rrrgen.cli.generate import generate

    words = ["--with", "controller", "--modes", "computed_torque,impedance", "--parts", "kalman,observer,estimator"]
    arguments = ["pendulum", "-o", str(tmp_path), "--real", "float", "--no-casadi-files", "-j", "1", *words]
    done = CliRunner().invoke(generate, arguments)
    assert done.exit_code == 0, done.output
    strict = ["-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Wdouble-promotion", "-Wshadow", "-Werror"]
    sources = sorted(path.name for path in tmp_path.glob("*.c"))
    build = ["cc", *strict, "-fsanitize=undefined", "-fno-sanitize-recover=all", *sources, "-o", "selftest", "-lm"]
    built = subprocess.run(build, cwd=tmp_path, capture_output=True, text=True)
    assert built.returncode == 0, built.stderr[:2000]
    ran = subprocess.run(["./selftest"], cwd=tmp_path, capture_output=True, text=True)
    assert ran.returncode == 0, ran.stdout
    assert "ok      controller: status and phase of every fault in every mode" in ran.stdout


def test_without_friction_the_law_is_that_of_zero_friction_and_shorter(rrr):
    from rrrgen.controller.programs import own_programs
    from rrrgen.controller.table import GROUPS, unit_of
    from rrrgen.emit.targets.c_package import derived_model

    model = derived_model(rrr.spec, GROUPS)[0]
    assert not own_programs(unit_of(model, parts=["friction"]))
    short = own_programs(unit_of(model, parts=[]))["computed_torque"]
    assert not {"friction", "width"} & {port.name for port in short.inputs}
    assert not any(op.value == "exp" for op, _, _ in short.nodes)
    free = rrr.controller(modes=["computed_torque"], parts=["observer"])
    zero = rrr.controller(modes=["computed_torque"], parts=["observer", "friction"], friction=0.0)
    q, dq = np.array([0.2, -0.4, 0.3]), np.array([0.3, -0.1, 0.2])
    for c in (free, zero):
        c.start(q=q, dq=dq)
    for k in range(20):
        q_d, dq_d, ddq_d = motion(0.1 + k * Ts)
        given = {"q": q + 1e-4 * k, "dq": dq, "q_d": q_d, "dq_d": dq_d, "ddq_d": ddq_d}
        one, other = free.step(**given), zero.step(**given)
        np.testing.assert_allclose(one.tau, other.tau, rtol=1e-13)
        np.testing.assert_allclose(one.r, other.r, rtol=1e-12, atol=1e-12)


def test_the_estimator_learns_a_payload_but_not_a_push(rrr):
    c = rrr.controller(modes=["computed_torque"], parts=["observer", "estimator", "kalman", "friction"], friction=0.0)
    true = c.params.beta * np.where(np.arange(15) % 3 == 0, 1.3, 0.8)
    q, dq = np.array([0.2, -0.4, 0.3]), np.zeros(3)
    target = q.copy()
    c.start(q=q)
    c.set(estimator_gain=5.0 * c.params.estimator_gain)
    gain, errors = c.params.estimator_gain.copy(), []
    for k in range(8000):
        a, b, d = motion(k * Ts)
        out = c.step(q=q, q_d=target + a, dq_d=b, ddq_d=d)
        errors.append(np.linalg.norm(target + a - q))
        np.testing.assert_array_less(c.params.beta_min - 1e-15, out.beta)
        dq = dq + Ts * rrr.forward_dynamics(q, dq, out.tau, beta=true)
        q = q + Ts * dq
    free = gain > 0
    before, after = (np.sum((beta - true)[free] ** 2 / gain[free]) for beta in (c.params.beta, out.beta))
    assert after < before  # directions that the motion does not excite stay
    assert np.mean(errors[-1000:]) < 0.1 * np.mean(errors[:1000])
    assert np.abs(rrr.gravity(q, beta=out.beta) - rrr.gravity(q, beta=true)).max() < 0.2
    c.set(threshold=1.0)
    learned = c.step(q=q).beta.copy()
    for _ in range(100):  # held by a hand
        out = c.step(q=q, q_d=target + a)
    assert c.faults(out.status).keys() >= {"CONTACT"}
    settled = out.beta.copy()
    assert np.array_equal(c.step(q=q).beta, settled)
    assert np.all(np.isfinite(learned))


def test_near_a_singular_configuration_the_law_is_damped_or_the_arm_stops(rrr):
    q, rest = np.array([0.2, -0.4, 0.0]), np.zeros(3)  # stretched out
    for action, phase, faults in ((0, 0, {"MODEL"}), (1, 2, {"MODEL"})):
        c = rrr.controller(modes=["operational_space"], model_action=action)
        c.start(q=q, dq=rest)
        out = c.step(q=q, dq=rest, T_d=rrr.forward_kinematics(q).ravel(), V_d=np.zeros(6))
        assert c.faults(out.status).keys() - {"CONTACT_UNKNOWN"} == faults
        assert out.phase == phase
        np.testing.assert_allclose(out.tau, rrr.gravity(q), atol=1e-6)


def test_a_law_whose_terms_cancel_beyond_the_range_of_numbers_stops_the_arm(controller):
    """Infinity minus infinity passed the limits as the largest torque, with status 0."""
    c, q, zero = controller("joint_impedance"), np.array([0.3, 0.4, 0.5]), np.zeros(3)
    c.start(q=q, dq=zero)
    held = c.step(q=q, dq=zero, q_d=q, dq_d=zero).tau.copy()
    out = c.step(q=q, dq=zero, q_d=np.full(3, 1.7e308), dq_d=np.full(3, -1.7e308))
    assert "OUTPUT" in c.faults(out.status)
    assert out.brake == 0  # a damped stop
    assert np.all(np.abs(out.tau - held) < 5.0)
