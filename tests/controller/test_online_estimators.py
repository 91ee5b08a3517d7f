"""Online estimators: the emitted C and NumPy against independent algebra, convergence, rest, and bounded work."""

from __future__ import annotations

import subprocess
from functools import cache
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

import rrrgen
from oracles.recursive_least_squares import InformationFilter, batch_estimate, gradient_step
from rrrgen.base.errors import DerivationError, InputError
from rrrgen.emit.controller.online_estimators import (
    EstimatorSettings,
    chosen_gain,
    estimator_files,
    gain_bound,
    regression,
)
from rrrgen.lab.data.kalman import kalman_matrices, kalman_step
from rrrgen.program import count_operations, evaluate
from rrrgen.runtime.online_estimators import online_estimator

FIXED = {"p4": 0.0, "p15": 0.0}  # as in the chapter: links 2 and 3 are symmetric
SIGMA = np.array([0.2, 0.1, 0.05])
CORRELATED = np.diag(SIGMA) @ np.array([[1.0, 0.4, -0.2], [0.4, 1.0, 0.3], [-0.2, 0.3, 1.0]]) @ np.diag(SIGMA)
PERIOD = 1e-3

DAMPED = """
schema: rrrgen/1
name: damped
convention: standard
gravity: [0, -9.81, 0]
units: {angle: rad, length: m}
joints:
  - {name: q1, type: revolute, alpha: 0, a: 0.4, d: 0, theta: 0,
     friction: {viscous: 0.8, coulomb: 1.2, offset: 0.1}, drive: {inertia: 0.05}}
links:
  - {mass: 3, com: [-0.2, 0.02, 0], inertia: {about: com, xx: 0.01, yy: 0.05, zz: 0.05}}
"""


def rows(matrix):
    return tuple(tuple(float(v) for v in row) for row in matrix)


@cache
def compiled(name: str, backend: str = "c", real: str = "double"):
    robot = rrrgen.loads_spec(DAMPED) if name == "damped" else name
    return rrrgen.compile(robot, backend=backend, real=real)


def motion(n: int, t):
    """Sums of sines, exact in position, velocity and acceleration, within 6 rad/s and 60 rad/s^2."""
    rng = np.random.default_rng(5)
    w = 2.0 * np.pi * np.array([0.1, 0.3, 0.5, 0.8, 1.1, 1.6, 2.1])
    phase, size = rng.uniform(0.0, 2.0 * np.pi, (n, w.size)), rng.uniform(0.6, 1.0, (n, w.size))
    angle = w * t[:, None, None] + phase
    return tuple(np.sum(size * part, axis=2) for part in (np.sin(angle) / w, np.cos(angle), -w * np.sin(angle)))


def measured(model, t, seed=2):
    q, dq, ddq = motion(model.n, t)
    noise = np.random.default_rng(seed).normal(size=q.shape) * SIGMA[: model.n]
    return q, dq, ddq, model.inverse_dynamics(q, dq, ddq) + model.friction(dq) + noise


def relative_torque_error(model, estimator):
    """Of the torques along the motion, for the estimated parameters."""
    q, dq, ddq = motion(model.n, np.linspace(0.0, 10.0, 300))
    known = dict(zip(estimator.names, estimator.parameters, strict=True)) | FIXED
    Y = model.identification_regressor(q, dq, ddq)
    truth, found = model.identification_parameters, [known[name] for name in model.identification_parameter_names]
    return np.linalg.norm(Y @ (np.array(found) - truth)) / np.linalg.norm(Y @ truth)


@pytest.mark.sweep(but=["rrr-c-float-0.002-0.99", "rrr-numpy-double-1e-09-0.99", "damped-numpy-double-1e-09-1.0"])
@pytest.mark.parametrize(
    ("name", "backend", "real", "tolerance", "forgetting"),
    [
        ("rrr", "c", "double", 1e-9, 1.0),
        ("rrr", "c", "double", 1e-9, 0.99),
        ("rrr", "c", "float", 2e-3, 0.99),
        ("rrr", "numpy", "double", 1e-9, 0.99),
        ("damped", "c", "double", 1e-9, 0.99),
        ("damped", "numpy", "double", 1e-9, 1.0),
    ],
)
def test_least_squares_equal_the_information_form(name, backend, real, tolerance, forgetting):
    """Parameters and covariance, with correlated noise and joints that rest in between."""
    model, fixed = compiled(name, backend, real), FIXED if name == "rrr" else {"Ia1": 0.05}
    reference = compiled(name)
    q, dq, ddq, tau = measured(reference, 0.01 * np.arange(400))
    dq[100:140, 0] = 0.0
    p = len(regression(model.derived, fixed).names)
    noise = CORRELATED[: model.n, : model.n]
    settings = EstimatorSettings((0.1,) * p, (3.0,) * p, rows(noise), forgetting)
    estimator = online_estimator(model, "rls", settings, fixed)
    errors = estimator.update(q, dq, ddq, tau)

    names = reference.identification_parameter_names
    keep = [k for k, each in enumerate(names) if each in estimator.names]
    Y = reference.identification_regressor(q, dq, ddq)
    y = tau - Y @ np.array([fixed.get(each, 0.0) for each in names])
    oracle = InformationFilter((0.1,) * p, (3.0,) * p, noise, forgetting)
    for k in range(len(q)):
        expected = y[k] - Y[k][:, keep] @ oracle.p
        assert np.allclose(errors[k], expected, atol=tolerance * np.abs(tau).max())
        oracle.update(Y[k][:, keep], y[k], np.abs(dq[k]) >= 0.01)
    assert np.abs(estimator.parameters - oracle.p).max() <= tolerance * np.abs(oracle.p).max()
    P = np.linalg.inv(oracle.J)
    assert np.abs(estimator.covariance - P).max() <= 10.0 * tolerance * np.abs(P).max()


COUPLED = """
schema: rrrgen/1
name: coupled
convention: standard
gravity: [0, -9.81, 0]
units: {angle: rad, length: m}
joints:
  - {name: q1, type: revolute, alpha: 0, a: 0.4, d: 0, theta: 0, friction: {offset: 0.1}}
  - {name: q2, type: revolute, alpha: 0, a: 0.3, d: 0, theta: 0}
links:
  - {mass: 3, com: [-0.2, 0, 0], inertia: {about: com, xx: 0.01, yy: 0.05, zz: 0.05}}
  - {mass: 2, com: [-0.15, 0.02, 0], inertia: {about: com, xx: 0.01, yy: 0.03, zz: 0.03}}
drives:
  joint_from_drive: [[1, 0], [-1, 1]]
  motors:
    - {name: left, gear_ratio: 50, inertia: 2e-5, friction: {viscous: 1e-4, coulomb: 0.008}}
    - {name: right, gear_ratio: 40, inertia: 3e-5, friction: {coulomb: 0.01, offset: 0.001}}
"""


def test_rows_of_coupled_drives_are_those_of_the_identification():
    """A joint rests where a motor that acts on it rests, at a speed that is compared at the joints."""
    model = rrrgen.compile(rrrgen.loads_spec(COUPLED), backend="numpy")
    fixed = {"fc_left": 0.3, "off1": 0.2}
    setting = regression(model.derived, fixed)
    q, dq, ddq = motion(2, 0.1 * np.arange(50))
    tau = np.random.default_rng(0).normal(size=q.shape)
    Y, y, moves = evaluate(setting.rows, q, dq, ddq, tau, 0.3)
    every, names = model.identification_regressor(q, dq, ddq), model.identification_parameter_names
    keep = [k for k, name in enumerate(names) if name not in fixed]
    assert tuple(names[k] for k in keep) == setting.names
    assert np.allclose(Y, every[..., keep], atol=1e-12)
    assert np.allclose(y, tau - every @ [fixed.get(name, 0.0) for name in names], atol=1e-12)
    W = np.array(model.spec.drives.motor_from_joint, dtype=float)
    slow = np.abs(dq @ W.T) < 0.3 * np.linalg.norm(W, axis=1)
    expected = ~((slow[:, :, None] & (W != 0.0)).any(axis=1) | (np.abs(dq) < 0.3) * [True, False])
    assert np.array_equal(moves > 0.0, expected)
    p = np.zeros(len(setting.names))
    following, errors, _ = evaluate(setting.gradient, q, dq, ddq, tau, p, 1e-12, 0.3)
    assert np.allclose(errors, -y, atol=1e-12)
    r = np.einsum("kij,ki->kj", Y, errors * expected)
    assert np.allclose(following, -1e-12 * r, rtol=1e-9, atol=1e-15)


def test_without_forgetting_the_recursion_is_the_batch_estimate():
    model = compiled("rrr")
    q, dq, ddq, tau = measured(model, 0.01 * np.arange(500))
    settings = EstimatorSettings((0.0,) * 13, (10.0,) * 13, rows(CORRELATED), 1.0, rest=0.0)
    estimator = online_estimator(model, "rls", settings, FIXED)
    estimator.update(q, dq, ddq, tau)
    keep = [k for k, name in enumerate(model.base_parameter_names) if name not in FIXED]
    Y = model.regressor(q, dq, ddq)[:, :, keep]
    expected = batch_estimate(Y, tau, (0.0,) * 13, (10.0,) * 13, CORRELATED)
    assert np.abs(estimator.parameters - expected).max() <= 1e-9 * np.abs(expected).max()


@pytest.mark.parametrize(("name", "backend"), [("rrr", "c"), ("rrr", "numpy"), ("damped", "c")])
def test_the_gradient_step_equals_its_definition(name, backend):
    model, fixed = compiled(name, backend), FIXED if name == "rrr" else {}
    q, dq, ddq, tau = measured(compiled(name), 0.05 * np.arange(100))
    dq[20:30, -1] = 0.0
    setting = regression(model.derived, fixed)
    gain = 0.3 * gain_bound(setting, q, dq, ddq)  # some samples break the bound of the parameter error all the same
    estimator = online_estimator(model, "gradient", EstimatorSettings(gain=4.0 * gain), fixed)
    p = np.array(setting.nominal)
    for k in range(len(q)):
        Y, y, _ = evaluate(setting.rows, q[k], dq[k], ddq[k], tau[k], 0.0)
        errors = estimator.update(q[k], dq[k], ddq[k], tau[k])
        assert np.allclose(errors, Y @ p - y, atol=1e-11 * np.abs(tau).max())
        p = gradient_step(Y, y, p, 4.0 * gain, np.abs(dq[k]) >= 0.01)
        assert np.abs(estimator.parameters - p).max() <= 1e-11 * np.abs(p).max()


def test_the_gain_bound_is_that_of_the_largest_regressor():
    model = compiled("rrr")
    setting = regression(model.derived, FIXED)
    q, dq, ddq = motion(3, np.linspace(0.0, 10.0, 500))
    keep = [k for k, name in enumerate(model.base_parameter_names) if name not in FIXED]
    largest = max(np.linalg.svd(Y[:, keep], compute_uv=False)[0] for Y in model.regressor(q, dq, ddq))
    bound = gain_bound(setting, q, dq, ddq)
    assert bound == pytest.approx(2.0 / largest**2, rel=1e-12)
    assert chosen_gain(None, bound) == pytest.approx(0.1 * bound)
    with pytest.raises(InputError, match="unstable along this motion"):
        chosen_gain(1.01 * bound, bound)


def kalman_motion(reading, reference, jerk):
    """The motion that the Kalman filter of the controller tells from encoder readings."""
    filters = [kalman_matrices(PERIOD, 1e-10 / 12.0, top**2) for top in jerk]
    E, gains = np.array([m.E for m in filters]), np.array([m.k for m in filters])
    x, found = np.zeros((3, 3)), np.empty((len(reading), 3, 3))
    for k in range(len(reading)):
        x, found[k] = kalman_step(E, gains, x, reading[k], np.stack([part[k] for part in reference], axis=-1))
    return found.transpose(2, 0, 1)


@pytest.fixture(scope="module")
def interrupted():
    """6 s of motion, 10 s of rest with friction that the model does not know, the motion again."""
    model = compiled("rrr")
    t = PERIOD * np.arange(22000)
    moving = (t < 6.0) | (t >= 16.0)
    reference = motion(3, np.where(t < 6.0, t, np.where(moving, t - 10.0, 6.0)))
    reference = (reference[0], *(part * moving[:, None] for part in reference[1:]))
    tau = model.inverse_dynamics(*reference) + np.random.default_rng(3).normal(size=(len(t), 3)) * SIGMA
    tau[~moving] += [1.5, 0.8, 0.4]
    jerk = np.abs(np.diff(motion(3, t[:6000])[2], axis=0)).max(axis=0) / PERIOD
    readings = np.round(reference[0] / 1e-5) * 1e-5
    return model, (*kalman_motion(readings, reference, jerk), tau)


@pytest.mark.parametrize("forgetting", [1.0, 0.999])
def test_least_squares_converge_and_do_not_burst_after_a_rest(interrupted, forgetting):
    """Below 1 % of torque within 5 s, below .2 % at the end, never above 1 % in between: P cannot grow."""
    model, samples = interrupted
    settings = EstimatorSettings((0.0,) * 13, noise=rows(np.diag(SIGMA**2)), forgetting=forgetting)
    estimator = online_estimator(model, "rls", settings, FIXED)
    history, sizes = [], []
    for k in range(0, len(samples[0]), 100):
        estimator.update(*(part[k : k + 100] for part in samples))
        history.append(relative_torque_error(model, estimator))
        sizes.append(estimator.covariance)
    assert max(history[50:]) <= 0.01
    assert history[-1] <= 0.002
    assert all(np.linalg.eigvalsh(before - after).min() >= -1e-9 for before, after in pairwise(sizes))


def test_forgetting_follows_a_payload_in_any_precision(interrupted):
    """With a load at the tip from the rest on; without forgetting the old data win."""
    model, (q, dq, ddq, tau) = interrupted
    load = {"p3": 0.4, "p5": 0.16, "p12": 0.2, "p13": 0.16, "p14": 0.16}
    change = np.array([load.get(name, 0.0) for name in model.base_parameter_names])
    tau = tau + (model.regressor(q, dq, ddq) @ change) * (np.arange(len(q)) >= 8000)[:, None]
    errors = {}
    for real, forgetting in (("double", 1.0), ("double", 0.995), ("float", 0.995)):
        settings = EstimatorSettings((0.0,) * 13, noise=rows(np.diag(SIGMA**2)), forgetting=forgetting)
        estimator = online_estimator(compiled("rrr", real=real), "rls", settings, FIXED)
        for part in (slice(0, None), slice(16000, None)):
            estimator.update(q[part], dq[part], ddq[part], tau[part])
        known = dict(zip(estimator.names, estimator.parameters, strict=True))
        found = np.array([known.get(name, 0.0) for name in model.base_parameter_names])
        state = motion(3, np.linspace(0.0, 10.0, 300))
        torque = model.inverse_dynamics(*state, model.beta + change)
        errors[real, forgetting] = np.linalg.norm(model.inverse_dynamics(*state, found) - torque) / np.linalg.norm(
            torque
        )
    assert errors["double", 0.995] < 0.04 < 0.08 < errors["double", 1.0]
    assert errors["float", 0.995] == pytest.approx(errors["double", 0.995], abs=1e-4)


def test_the_gradient_converges_at_a_tenth_of_its_bound_and_survives_a_gain_far_above_it(interrupted):
    model, samples = interrupted
    moving = np.r_[0:6000, 16000:22000]
    setting = regression(model.derived, FIXED)
    bound = gain_bound(setting, *motion(3, np.linspace(0.0, 10.0, 1000)))
    errors = []
    for share in (0.1, 20.0):
        settings = EstimatorSettings((0.0,) * 13, gain=share * bound)
        estimator = online_estimator(model, "gradient", settings, FIXED)
        for _ in range(2):
            estimator.update(*(part[moving] for part in samples))
        errors.append(relative_torque_error(model, estimator))
    assert errors[0] <= 0.01
    assert errors[1] <= 1.0


@pytest.mark.parametrize("kind", ["rls", "gradient"])
@pytest.mark.parametrize("backend", ["c", "numpy"])
def test_a_sample_that_is_no_number_teaches_nothing(kind, backend):
    model = compiled("rrr", backend)
    estimator = online_estimator(model, kind, EstimatorSettings(gain=1e-4))
    before = estimator.parameters
    bad = np.array([1.0, np.nan, 0.3])
    good = np.array([1.0, 2.0, 0.3])
    for sample in ((bad, good, good, good), (good, good, good, bad), (good, good, np.inf * good, good)):
        with np.errstate(invalid="ignore"):
            estimator.update(*sample)
        assert np.array_equal(estimator.parameters, before)
    estimator.update(good, good, good, good)
    assert not np.array_equal(estimator.parameters, before)


COUNTING = """
#include <cmath>
extern "C++" {
static long counted_operations = 0, counted_divisions = 0;
struct counted {
    double v;
    counted() : v(0) {}
    counted(double x) : v(x) {}
    explicit operator double() const { return v; }
    counted &operator+=(counted o) { ++counted_operations; v += o.v; return *this; }
    counted &operator-=(counted o) { ++counted_operations; v -= o.v; return *this; }
    counted &operator*=(counted o) { ++counted_operations; v *= o.v; return *this; }
};
static inline counted operator+(counted a, counted b) { ++counted_operations; return counted(a.v + b.v); }
static inline counted operator-(counted a, counted b) { ++counted_operations; return counted(a.v - b.v); }
static inline counted operator*(counted a, counted b) { ++counted_operations; return counted(a.v * b.v); }
static inline counted operator/(counted a, counted b) { ++counted_divisions; return counted(a.v / b.v); }
static inline counted operator-(counted a) { return counted(-a.v); }
static inline bool operator>(counted a, counted b) { return a.v > b.v; }
static inline bool operator<(counted a, counted b) { return a.v < b.v; }
static inline bool operator>=(counted a, counted b) { return a.v >= b.v; }
static inline bool operator<=(counted a, counted b) { return a.v <= b.v; }
static inline counted sin(counted a) { return counted(std::sin(a.v)); }
static inline counted cos(counted a) { return counted(std::cos(a.v)); }
static inline counted fabs(counted a) { return counted(std::fabs(a.v)); }
}
#define RRR_RLS_REAL_DEFINED
typedef counted rrr_rls_real;
"""


def test_an_update_takes_bounded_work(tmp_path):
    """Counted in the C itself with a type that counts: 3 rows of 13 parameters, alike for all data."""
    setting = regression(compiled("rrr").derived, FIXED)
    for name, text in estimator_files(setting, "rls", EstimatorSettings(), "double").items():
        (tmp_path / name).write_text(text)
    main = (
        COUNTING
        + """
#include "rrr_rls.c"
#include <stdio.h>
int main() {
    rrr_rls_state s;
    rrr_rls_start(&s);
    for (int k = 0; k < 50; ++k) {
        rrr_rls_real q[3] = {0.1 * k, 0.2 * k, -0.1 * k}, dq[3] = {1.0, -2.0 + 0.01 * k, 3.0};
        rrr_rls_real ddq[3] = {5.0, k - 3.0, 2.0}, tau[3] = {1.0 * k, 2.0, 3.0}, e[3];
        counted_operations = counted_divisions = 0;
        rrr_rls_update(&s, q, dq, ddq, tau, e);
        printf("%ld %ld\\n", counted_operations, counted_divisions);
    }
    return 0;
}
"""
    )
    (tmp_path / "main.cpp").write_text(main)
    subprocess.run(["g++", "-O1", "main.cpp", "-o", "count"], cwd=tmp_path, check=True)
    output = subprocess.run([tmp_path / "count"], capture_output=True, text=True, check=True).stdout
    counts = {tuple(map(int, line.split())) for line in output.splitlines()}
    assert len(counts) == 1
    operations, divisions = counts.pop()
    assert operations <= 3 * (3.5 * 13**2 + 10 * 13) + count_operations(setting.rows).total + 150
    assert divisions <= 3 * (13 + 5)


@pytest.mark.parametrize(
    ("settings", "reason"),
    [
        ({"forgetting": 0.0}, "forgetting factor"),
        ({"start": (1.0,)}, "13 finite values"),
        ({"spread": (-1.0,) * 13}, "standard deviations"),
        ({"noise": rows(np.ones((3, 3)))}, "positive definite"),
        ({"rest": np.inf}, "at rest"),
        ({"gain": -1.0}, "gain"),
    ],
)
def test_impossible_settings_are_refused(settings, reason):
    with pytest.raises(InputError, match=reason):
        online_estimator(compiled("rrr"), "rls", EstimatorSettings(**settings), FIXED)


def test_loops_of_newtons_method_have_no_estimator():
    six_bar = Path(__file__).parents[2] / "examples" / "linkages" / "six_bar.yaml"
    with pytest.raises(DerivationError, match="an online estimator does not exist with loops solved by Newton's"):
        rrrgen.online_estimator(rrrgen.compile(six_bar, backend="numpy"))


def test_parameters_that_do_not_exist_cannot_be_fixed():
    with pytest.raises(InputError, match="'p99' is no parameter of rrr: there are p1, p2"):
        online_estimator(compiled("rrr"), "rls", fixed={"p99": 0.0})
    with pytest.raises(InputError, match="needs a gain"):
        online_estimator(compiled("rrr"), "gradient")
    with pytest.raises(InputError, match="there is no online estimator 'kalman'; there are rls and gradient"):
        online_estimator(compiled("rrr"), "kalman")
    with pytest.raises(InputError, match="gain"):
        online_estimator(compiled("rrr"), "gradient", EstimatorSettings(gain=-1.0))
    with pytest.raises(ValueError, match=r"all \(n,\) or all \(N, n\)"):
        online_estimator(compiled("rrr")).update(np.zeros(3), np.zeros(3), np.zeros(3), np.zeros((2, 3)))
