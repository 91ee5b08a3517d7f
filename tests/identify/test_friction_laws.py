"""Friction laws in the joint estimation: shapes recovered, the law chosen, the model written and scored again."""

from __future__ import annotations

import json
from functools import partial

import numpy as np
import pytest
from click.testing import CliRunner

import rrrgen
from rrrgen import pipeline
from rrrgen.cli.main import cli
from rrrgen.errors import InputError
from rrrgen.friction.laws import LAWS
from rrrgen.friction.models import FrictionModel
from rrrgen.identify.friction_laws import choice
from rrrgen.identify.friction_laws.choice import CANDIDATES, LawChoice
from rrrgen.identify.friction_laws.surfaces import FrictionSurface, stated_surfaces
from rrrgen.identify.identification import identify
from rrrgen.identify.options import Options
from rrrgen.identify.results import identified_spec
from rrrgen.identify.scoring.split import Split
from rrrgen.identify.validation import robot_model, validate_recordings
from rrrgen.recordings.logs import Log
from rrrgen.robotfile import dumps, loads_spec
from rrrgen.robotfile.writer import dumps as written
from rrrgen.signals.processing import Processing
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
PERIOD = 2e-3
PROCESSING = Processing("logged", decimate=10)


@pytest.fixture(scope="module")
def arm():
    return rrrgen.compile(loads_spec(ARM), backend="numpy")


def recording(arm, seed=3, seconds=10.0, noise=0.02):
    """A motion with many reversals, its friction stepped sample by sample, and encoders and torques with noise."""
    t = PERIOD * np.arange(round(seconds / PERIOD))
    q, dq, ddq = fourier_motion(t, 2, seed, base=1 / 5, size=0.35)
    torque = arm.inverse_dynamics(q, dq, ddq)
    for i, (name, values) in enumerate(TRUTH):
        law, z = FrictionModel(LAWS[name], np.array([values])), np.zeros(1)
        for k in range(len(t)):
            z, tau = law.step(z, dq[k, [i]], PERIOD)
            torque[k, i] += tau[0]
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
    assert first == pytest.approx((0.12, 8e-4), rel=0.15)
    assert second == pytest.approx((0.08,), rel=0.1)
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
        assert values[name] == pytest.approx(value, rel=0.08), name
    assert values["off1"] == pytest.approx(0.3, abs=0.02)
    assert chosen.consistent_held_out["relative_error"] < 0.01


def test_the_true_law_beats_the_linear_one_held_out(arm, log, chosen):
    linear = fitted(arm, log, split=Split.parse("first:0.7"), consistent=False)
    assert linear.friction is None
    assert linear.held_out["relative_error"] > 3 * chosen.held_out["relative_error"]


def test_held_out_data_do_not_reach_the_shapes_or_the_choice(arm, log, monkeypatch):
    """Other torques in the held-out part change no bit of what was fitted."""
    monkeypatch.setattr(choice, "CANDIDATES", ("coulomb_viscous", "stribeck"))
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
        ("dhal", "no friction law 'dhal' can be fitted; there are"),
        ("lugre", "'lugre' can be fitted .dahl_exponential has its presliding"),
        ("c=dahl", "no joint or motor 'c' states friction; there are a, b"),
    ],
)
def test_wrong_laws_are_refused(arm, law, message):
    with pytest.raises(InputError, match=message):
        LawChoice.parse([law], arm.spec)


def test_a_stated_law_that_cannot_be_fitted_names_another():
    stated = "{law: lugre, sigma0: 400, sigma1: 1, coulomb: 0.6, stribeck_speed: 0.3}"
    spec = loads_spec(ARM.replace("{viscous: 0, coulomb: 0}", stated))
    with pytest.raises(InputError, match="dahl_exponential has its presliding"):
        stated_surfaces(spec)


def test_the_command_prints_the_table_and_writes_the_law(tmp_path, arm, log, monkeypatch):
    monkeypatch.setattr(pipeline, "compile", partial(pipeline.compile, backend="numpy"))
    robot, data = tmp_path / "robot.yaml", tmp_path / "log.csv"
    robot.write_text(written(arm.spec))
    write_log(data, log)
    command = ["identify", str(robot), "--log", str(data), "-o", str(tmp_path / "run"), "--cutoff", "60"]
    told = CliRunner().invoke(cli, [*command, "--decimate", "10", "--friction", "a=auto", "--no-consistent"])
    assert told.exit_code == 0, told.output
    lines = told.output.splitlines()
    assert any(line.startswith("dahl_exponential ") for line in lines)
    assert any(line.startswith("friction of a: dahl_exponential: decay_speed 0.1") for line in lines)
    assert "relative torque error" in told.output
    record = json.loads((tmp_path / "run" / "results" / "identification.json").read_text())
    assert [each["law"] for each in record["friction"]["candidates"]] == list(CANDIDATES)
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
        blocks = np.full((choice.BLOCKS, 3), size)
        if law == "stribeck":
            blocks[:, 2] *= (
                1.0 + spread * np.sqrt(choice.BLOCKS) * (noise := rng.normal(size=choice.BLOCKS)) / noise.std()
            )
            blocks[:, 2] += size[2] - blocks[:, 2].mean()
        table.append(choice.Candidate(law, 0.0, 0.0, (), tuple(map(tuple, blocks.tolist()))))
    found = choice._chosen(table, surfaces, dict.fromkeys(names, choice.AUTO))
    assert [found[name] for name in names] == expected
