"""Friction laws in the joint estimation: shapes recovered, the law chosen, the model written and scored again."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from click.testing import CliRunner

import rrrgen
from rrrgen.base.errors import InputError
from rrrgen.cli.main import cli
from rrrgen.lab.data.preprocessing import Processing
from rrrgen.lab.data.recordings import Log
from rrrgen.lab.identify import friction_choice
from rrrgen.lab.identify.diagnosis.report import diagnose_fit
from rrrgen.lab.identify.friction_choice import CANDIDATES, LawChoice
from rrrgen.lab.identify.friction_columns import FrictionSurface
from rrrgen.lab.identify.held_out_data import Split
from rrrgen.lab.identify.identification import Options, identify
from rrrgen.lab.identify.results import identified_spec
from rrrgen.lab.identify.validation import robot_model, validate_recordings
from rrrgen.robot.file import dumps, loads_spec
from rrrgen.robot.file.writer import dumps as written
from rrrgen.runtime import load
from samples.recordings import fourier_motion, write_log

ARM = """schema: rrrgen/1
name: sticky
convention: standard
units: {angle: rad, length: m}
gravity: [0, -9.81, 0]
joints:
  - {name: a, type: revolute, alpha: 0, a: 0.4, d: 0, friction: {viscous: 0, coulomb: 0, offset: 0}}
  - {name: b, type: revolute, alpha: 0, a: 0.3, d: 0, friction: {viscous: 0, coulomb: 0}}
links:
  - {mass: 3, com: [-0.2, 0, 0], inertia: {about: com, xx: 0.01, yy: 0.04, zz: 0.05}}
  - {mass: 2, com: [-0.15, 0.01, 0], inertia: {about: com, xx: 0.01, yy: 0.02, zz: 0.02}}
"""
TRUTH = ("dahl_exponential", (-0.8, 2.0, 1.2, -0.15, 0.12, 8e-4)), ("stribeck", (0.9, 1.5, 0.6, 0.08))
BRISTLES = ("lugre", (2.5e3, 5.0, 0.9, 2.0, 1.2, 0.12)), ("lugre", (2e3, 4.0, -0.5, 1.5, 0.6, 0.08))
FINE = 10  # steps of the integration of friction in a sampling period
PERIOD = 2e-3
PROCESSING = Processing("logged", decimate=10)


@pytest.fixture(scope="module")
def arm():
    return rrrgen.compile(loads_spec(ARM), backend="numpy")


def friction(name, p, v):
    """Friction torque (N,) at the speeds ``v`` (N FINE,): an own integration by the implicit midpoint rule."""
    slow = v[::FINE]
    if name == "stribeck":
        return (p[0] * np.exp(-((slow / p[3]) ** 2)) + p[1]) * np.sign(slow) + p[2] * slow

    def level(v):
        return p[3] + p[2] * np.exp(-((v / p[5]) ** 2))

    reach = level(v) / p[0] if name == "lugre" else np.full(len(v), p[5])
    z, deflection = 0.0, []
    travels = (v + np.concatenate([v[:1], v[:-1]])) / 2 * PERIOD / FINE
    for x, far in zip(travels.tolist(), reach.tolist(), strict=True):
        bent = abs(x) / far / 2
        z = ((1 - bent) * z + x) / (1 + bent)
        deflection.append(z)
    z = np.array(deflection)[::FINE]
    if name == "lugre":
        return p[0] * z + p[1] * (slow - abs(slow) * z / reach[::FINE]) + p[4] * slow
    return (p[0] * np.exp(-abs(slow) / p[4]) + p[1]) * z / p[5] + p[2] * slow + p[3] * slow * abs(slow)


def recording(arm, truth=TRUTH, seed=3, seconds=8.0, noise=0.02):
    """A motion with many reversals, with friction after ``truth``, and with noise of the torques."""
    t = PERIOD * np.arange(round(seconds / PERIOD))
    q, dq, ddq = fourier_motion(t, 2, seed, base=1 / 5, size=0.35)
    torque = arm.inverse_dynamics(q, dq, ddq)
    speeds = fourier_motion(PERIOD / FINE * np.arange(FINE * len(t)), 2, seed, base=1 / 5, size=0.35)[1]
    for i, (name, values) in enumerate(truth):
        torque[:, i] += friction(name, values, speeds[:, i])
    torque[:, 0] += 0.3
    torque += noise * np.random.default_rng(seed).normal(size=torque.shape)
    return Log(("a", "b"), t, q, torque, dq=dq, ddq=ddq, period=PERIOD)


@pytest.fixture(scope="module")
def log(arm):
    return recording(arm)


def fitted(arm, log, *laws, **given):
    options = Options(friction=LawChoice.parse(laws, arm.spec), correlated=False, poses=2, **given)
    return identify(arm, [log], PROCESSING, options)


@pytest.fixture(scope="module")
def chosen(arm, log):
    return fitted(arm, log, "auto", split=Split.parse("first:0.7"))


def test_the_law_of_every_joint_is_found_with_its_shapes(chosen):
    assert [surface.law for surface in chosen.friction.surfaces] == ["dahl_exponential", "stribeck"]
    assert [each.law for each in chosen.friction.table] == list(CANDIDATES)
    first, second = (surface.shapes for surface in chosen.friction.surfaces)
    assert first == pytest.approx((0.12, 8e-4), rel=0.01)
    assert second == pytest.approx((0.08,), rel=0.02)
    values = dict(zip(chosen.consistent.names, chosen.consistent.theta, strict=True))
    truth = {
        "coulomb1": 2.0,
        "viscous1": 1.2,
        "excess1": -0.8,
        "coulomb2": 1.5,
        "viscous2": 0.6,
        "stiction_excess2": 0.9,
    }
    for name, value in truth.items():
        assert values[name] == pytest.approx(value, rel=0.02), name
    assert values["off1"] == pytest.approx(0.3, abs=0.01)
    assert chosen.consistent_held_out["relative_error"] < 0.002


@pytest.mark.parametrize("late", [0.0, 0.02])
def test_a_reversal_over_a_distance_is_not_taken_for_late_torques(arm, log, late):
    """Linear friction stands for the laws in the diagnosis, where such a reversal looks like a delay."""
    tau = np.column_stack([np.interp(log.t - late, log.t, column) for column in log.tau.T])
    recorded = replace(log, tau=tau)
    causes = diagnose_fit(arm, [recorded], fitted(arm, recorded, "a=dahl_exponential", "b=stribeck"))
    assert bool(causes) == bool(late)
    assert all("recorded too late" in cause.cause for cause in causes)


def test_bristles_are_found_and_chosen(arm, monkeypatch):
    """LuGre friction, once with more and once with less friction at rest than in sliding; (14.13)."""
    monkeypatch.setattr(friction_choice, "CANDIDATES", ("coulomb_viscous", "stribeck", "dahl_exponential", "lugre"))
    log = recording(arm, BRISTLES, seconds=6.0, noise=0.005)
    found = fitted(arm, log, "auto", split=Split.parse("first:0.7"))
    assert [surface.law for surface in found.friction.surfaces] == ["lugre", "lugre"]
    spec = loads_spec(dumps(identified_spec(arm.spec, found.consistent, surfaces=found.friction.surfaces)))
    for joint, (_, truth) in zip(spec.joints, BRISTLES, strict=True):
        assert joint.friction.law.name == "lugre"
        errors = np.array(joint.friction.law.values) / truth - 1.0
        assert np.all(np.abs(errors) < [0.03, 0.15, 0.05, 0.01, 0.01, 0.05])  # damping is hardly excited
    scored = validate_recordings(robot_model(rrrgen.compile(spec, backend="numpy")), [log], PROCESSING)
    assert scored.relative_error == pytest.approx(found.consistent_fit["relative_error"], rel=0.2)


def test_a_stated_logistic_law_is_estimated(arm):
    truth = (1.6, 15.0, 0.04)
    text = ARM.replace("{viscous: 0, coulomb: 0}", "{law: logistic, span: 1, steepness: 40, shift: -0.01}")
    t = PERIOD * np.arange(2000)
    q, dq, ddq = fourier_motion(t, 2, 3, base=1 / 5, size=0.35)
    tau = arm.inverse_dynamics(q, dq, ddq)
    span, steepness, shift = truth
    tau[:, 1] += span / (1 + np.exp(-steepness * (dq[:, 1] + shift))) - span / (1 + np.exp(-steepness * shift))
    tau += 0.002 * np.random.default_rng(5).normal(size=tau.shape)
    log = Log(("a", "b"), t, q, tau, dq=dq, ddq=ddq, period=PERIOD)
    stated = rrrgen.compile(loads_spec(text), backend="numpy")
    found = fitted(stated, log)
    spec = identified_spec(stated.spec, found.consistent, surfaces=found.friction.surfaces)
    assert spec.joints[1].friction.law.values == pytest.approx(truth, rel=0.01)


def test_the_true_law_beats_the_linear_one_held_out(arm, log, chosen):
    linear = fitted(arm, log, split=Split.parse("first:0.7"), consistent=False)
    assert linear.friction is None
    assert linear.held_out["relative_error"] > 3 * chosen.held_out["relative_error"]


def test_held_out_data_do_not_reach_the_shapes_or_the_choice(arm, log, monkeypatch):
    """Other torques in the held-out part change no bit of what was fitted."""
    monkeypatch.setattr(friction_choice, "CANDIDATES", ("coulomb_viscous", "stribeck"))
    spoiled = Log(log.joints, log.t, log.q, log.tau.copy(), dq=log.dq, ddq=log.ddq, period=PERIOD)
    spoiled.tau[int(0.75 * len(log.t)) :] *= 3.0
    options = {"split": Split.parse("first:0.7"), "guard": 0.2, "consistent": False}
    one, other = (fitted(arm, each, "a=dahl", "b=auto", **options) for each in (log, spoiled))
    assert one.friction.surfaces == other.friction.surfaces
    assert one.friction.table == other.friction.table
    assert np.array_equal(one.theta, other.theta)
    assert one.held_out["relative_error"] < other.held_out["relative_error"]


def test_the_written_robot_file_is_the_model_that_was_scored(arm, log, chosen):
    spec = loads_spec(dumps(identified_spec(arm.spec, chosen.consistent, surfaces=chosen.friction.surfaces)))
    assert [joint.friction.law.name for joint in spec.joints] == ["dahl_exponential", "stribeck"]
    result = validate_recordings(robot_model(rrrgen.compile(spec, backend="numpy")), [log], PROCESSING)
    whole = [s.relative_error for s in chosen.scores if s.estimate == "consistent" and s.torque != "unfiltered"]
    assert min(whole) <= result.relative_error <= max(whole)
    again = identify(rrrgen.compile(spec, backend="numpy"), [log], PROCESSING, Options(correlated=False, poses=2))
    assert [surface.law for surface in again.friction.surfaces] == ["dahl_exponential", "stribeck"]
    linear = LawChoice.parse(["coulomb_viscous"], spec)
    plain = identify(rrrgen.compile(spec, backend="numpy"), [log], PROCESSING, Options(friction=linear, poses=2))
    assert {"fv1", "fc1", "off1", "fv2", "fc2"} <= set(plain.names)
    assert identified_spec(spec, plain.consistent).joints[0].friction.law is None


@pytest.mark.parametrize(
    ("law", "message"),
    [
        ("lugr", r"no friction law 'lugr'; did you mean 'lugre'\? there are coulomb_viscous, asymmetric"),
        ("c=dahl", "no joint or motor 'c' states friction; there are a, b"),
    ],
)
def test_wrong_laws_are_refused(arm, law, message):
    with pytest.raises(InputError, match=message):
        LawChoice.parse([law], arm.spec)


def test_the_command_prints_the_table_and_writes_the_law(tmp_path, arm, log, monkeypatch):
    monkeypatch.setattr(load, "compile", partial(load.compile, backend="numpy"))
    robot, data = tmp_path / "robot.yaml", tmp_path / "log.csv"
    robot.write_text(written(arm.spec))
    write_log(data, log)
    command = ["identify", str(robot), "--log", str(data), "-o", str(tmp_path / "run"), "--cutoff", "60"]
    monkeypatch.setattr(friction_choice, "CANDIDATES", ("coulomb_viscous", "dahl", "dahl_exponential"))
    told = CliRunner().invoke(cli, [*command, "--decimate", "10", "--friction", "a=auto", "--no-consistent"])
    assert told.exit_code == 0, told.output
    lines = told.output.splitlines()
    assert any(line.startswith("dahl_exponential ") for line in lines)
    assert any(line.startswith("friction of a: dahl_exponential: decay_speed 0.1") for line in lines)
    assert "relative torque error" in told.output
    record = json.loads((tmp_path / "run" / "results" / "identification.json").read_text())
    assert [each["law"] for each in record["friction"]["candidates"]] == list(friction_choice.CANDIDATES)
    assert record["friction"]["surfaces"][0]["shapes"]["presliding"] == pytest.approx(8e-4, rel=0.2)


@pytest.mark.parametrize(
    ("factor", "spread", "expected"),
    [
        (0.9, 0.5, ["dahl", "dahl", "dahl"]),  # better at one joint by chance
        (0.5, 0.2, ["dahl", "dahl", "stribeck"]),  # significantly better there
        (1.02, 0.0, ["dahl", "dahl", "dahl"]),
    ],
)
def test_joints_share_a_law_unless_another_one_is_significantly_better(factor, spread, expected):
    rng = np.random.default_rng(0)
    names = ("a", "b", "c")
    surfaces = [FrictionSurface(name, tuple(float(i == k) for i in range(3)), "") for k, name in enumerate(names)]
    table = []
    for law, size in ((CANDIDATES[0], [4.0, 4.0, 4.0]), ("stribeck", [1.5, 1.5, factor]), ("dahl", [1.0, 1.0, 1.0])):
        blocks = np.full((friction_choice.BLOCKS, 3), size)
        if law == "stribeck":
            blocks[:, 2] *= (
                1.0
                + spread
                * np.sqrt(friction_choice.BLOCKS)
                * (noise := rng.normal(size=friction_choice.BLOCKS))
                / noise.std()
            )
            blocks[:, 2] += size[2] - blocks[:, 2].mean()
        table.append(friction_choice.LawErrors(law, 0.0, 0.0, (), tuple(map(tuple, blocks.tolist()))))
    found = friction_choice._choose_laws(table, surfaces, dict.fromkeys(names, friction_choice.AUTO))
    assert [found[name] for name in names] == expected
