"""Friction of one joint refined in the simulated closed loop, on a recording with known truth."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from click.testing import CliRunner

from rrrgen.cli.main import cli
from rrrgen.lab.closed_loop.controller import loads_controller
from rrrgen.lab.closed_loop.joint_friction import refine
from rrrgen.lab.data.recordings import Log
from rrrgen.lab.friction.candidate_laws import Candidate
from rrrgen.lab.friction.estimation import FrictionEstimate, LawEstimate, LawScore, reported_values
from rrrgen.lab.friction.joint_recording import joint_data
from rrrgen.robot.file import load_spec
from rrrgen.robot.friction.laws import LAWS
from samples.stick_slip_joint import Joint, record

TRUTH = Joint("stribeck")
LIMITS = {"inertia": 0.01, "coulomb": 0.02, "viscous": 0.05, "stiction_excess": 0.1, "stribeck_speed": 0.1}
OMEGA = 2.0 * math.pi * 6.0
KP, KD = TRUTH.inertia * OMEGA**2, 1.6 * TRUTH.inertia * OMEGA
ROBOT = """
schema: rrrgen/1
name: pendulum
convention: modified
units: {angle: rad, length: m}
gravity: [0, -9.81, 0]
joints:
  - {name: q, type: revolute, alpha: 0, a: 0, d: 0, theta: 0, friction: {viscous: 0, coulomb: 0}}
"""
LOG = """
schema: rrrgen-log/1
files: log.csv
time: {column: t, unit: s}
joints:
  - name: q
    position: {column: q, unit: rad}
    torque: {column: tau, unit: N*m}
    reference: {column: qr, unit: rad}
    reference_velocity: {column: dqr, unit: rad/s}
"""
CONTROLLER = f"""
schema: rrrgen-controller/1
rate: 1 kHz
delay: 1
records: command
signals:
  speed: {{difference: position}}
  u: {{sum: {{reference: {KP}, position: {-KP}, reference_velocity: {KD}, speed: {-KD}}}}}
torque: u
joints: [q]
"""


@pytest.fixture(scope="module")
def refined(tmp_path_factory):
    folder = tmp_path_factory.mktemp("joint")
    found = record(TRUTH, duration=15.0, delay=1, substeps=5)
    names = ("t", "q", "tau", "qr", "dqr")
    rows = np.column_stack([found[name] for name in names])
    np.savetxt(folder / "log.csv", rows, delimiter=",", header=",".join(names), comments="", fmt="%.12g")
    for name, text in (("robot", ROBOT), ("log", LOG), ("controller", CONTROLLER)):
        (folder / f"{name}.yaml").write_text(text)
    words = ("robot.yaml", "--log", "log.yaml", "--controller", "controller.yaml", "-o", "out")
    words = tuple(str(folder / word) if "." in word or word == "out" else word for word in words)
    done = CliRunner().invoke(cli, ["experiment", "friction", *words, "--joint", "q", "--law", "stribeck"])
    assert done.exit_code == 0, done.output
    return folder / "out/results", done.output


def test_the_refined_parameters_are_true_and_written(refined):
    folder, output = refined
    record = json.loads((folder / "friction.json").read_text())
    assert "refined: relative torque error" in output
    values, std = record["models"]["stribeck"]["parameters"], record["models"]["stribeck"]["std"]
    truth = {"stiction_excess": TRUTH.excess, "stribeck_speed": TRUTH.speed}
    for name, limit in LIMITS.items():
        actual = truth.get(name) or getattr(TRUTH, name)
        assert values[name] == pytest.approx(actual, rel=limit)
        assert abs(values[name] - actual) < 6.0 * std[name] + 1e-3 * actual, name
    law = load_spec(folder / "robot.yaml").joints[0].friction.law
    assert law.values[:3] == pytest.approx([values[n] for n in ("stiction_excess", "coulomb", "viscous")], rel=1e-9)


def test_the_loop_explains_the_torque_better_than_before(refined):
    record = json.loads((refined[0] / "friction.json").read_text())["closed_loop"]
    assert record["controller_error"] < 1e-6
    assert record["after"]["relative_error"] <= record["before"]["relative_error"]
    assert record["after"]["relative_error"] < 0.02
    assert set(record["multiple_shooting"]) >= set(LIMITS)


@pytest.mark.sweep
def test_bristles_are_simulated_and_found():
    """LuGre's law, from parameters that are off: the joint vibrates at 280 Hz on its bristles."""
    sigma0, sigma1 = 2e5, 90.0
    truth = Joint("lugre", sigma0=sigma0, sigma1=sigma1)
    found = record(truth, duration=15.0, delay=1, finer=5)
    t, q, tau, reference, speed = (found[name] for name in ("t", "q", "tau", "qr", "dqr"))
    log = Log(("q",), t, q[:, None], tau[:, None], reference=reference[:, None], reference_velocity=speed[:, None])
    candidate = Candidate(LAWS["lugre"], 2)
    actual = np.array([truth.inertia, truth.gravity, 0.0, sigma0, sigma1, *(TRUTH.excess, TRUTH.coulomb)])
    actual = np.append(actual, [TRUTH.viscous, TRUTH.speed, 1.0])
    start = actual * np.array([1.02, 0.99, 1.0, 0.7, 1.4, 0.9, 1.03, 0.95, 1.1, 1.0])
    values = reported_values(candidate, start, 1e-3)
    score = LawScore("lugre", len(start), 1.0, 0.0, np.ones(1))
    law = LawEstimate(candidate, start, values, dict.fromkeys(values, 0.0), score, values, 0.0)
    fit = refine(FrictionEstimate(joint_data(log, "q"), (law,), law, 1.0, 1), log, loads_controller(CONTROLLER))
    again = fit.estimate.chosen.values
    for name, value in zip(candidate.names, actual, strict=True):
        if name in again and name != "delay":
            assert again[name] == pytest.approx(value, rel=0.03 if name.startswith("sigma") else 0.005), name
    assert fit.after.relative_error < 0.01 < fit.before.relative_error
