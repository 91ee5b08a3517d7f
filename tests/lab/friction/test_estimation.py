"""Friction of one joint against the known truth of an independent simulation with stick and slip."""

import json

import numpy as np
import pytest

from lab.friction.independent import LIMITS
from lab.friction.logs import write_log
from rrrgen.cli.main import run
from rrrgen.robot.file import load_spec
from rrrgen.robot.friction.laws import LAWS
from samples.stick_slip_joint import Joint, bristles, multisine, record

BRISTLES = Joint("lugre", sigma0=1e4, sigma1=10.0, gravity=0.0)


def test_a_hidden_joint_is_found(tmp_path, capsys):
    truth = Joint("stribeck", angle=0.4)
    found = record(truth, duration=16.0, seed=3, substeps=5, torque_noise=0.01, centred=True)
    laws = ["--law", truth.law, "--law", "coulomb_viscous"]
    for level in (0.15, 0.3):
        laws += ["--presliding", str(write_log(tmp_path / f"rest{level}.csv", below_break_away(level)))]
    log = write_log(tmp_path / "log.csv", found)
    assert (
        run(["experiment", "friction", "rrr", "--log", str(log), "--joint", "q3", "-o", str(tmp_path / "run"), *laws])
        == 0
    )
    found = json.loads((tmp_path / "run" / "results" / "friction.json").read_text())
    assert found["chosen"] == truth.law
    model = found["models"][truth.law]
    attributes = {"stiction_excess": "excess", "stribeck_speed": "speed"}
    for name in set(LIMITS) & set(model["parameters"]):
        actual = getattr(truth, attributes.get(name, name))
        assert model["parameters"][name] == pytest.approx(actual, rel=LIMITS[name]), name
        assert 0.0 < model["std"][name] < LIMITS[name] * actual, name
    assert found["delay"] == pytest.approx(-5e-4, abs=1e-4)
    assert model["held_out"] < found["models"]["coulomb_viscous"]["held_out"] * 1.05
    table = capsys.readouterr().out
    assert f"* {truth.law}" in table
    assert "BIC" in table
    assert (tmp_path / "run" / "figures" / "friction.png").exists()
    rest = found["presliding"]["parameters"]
    assert rest["sigma0"] == pytest.approx(BRISTLES.sigma0, rel=0.02)
    assert rest["sigma1"] == pytest.approx(BRISTLES.sigma1, rel=0.05)
    written = load_spec(str(tmp_path / "run" / "results" / "robot.yaml")).joints[2].friction.law
    assert written.name == truth.law
    assert sorted(written.values) == sorted(model["parameters"][p.name] for p in LAWS[truth.law].parameters)


def below_break_away(level):
    """Torque and motion of a resting joint under a multisine of 2 s, at q = 0, where gravity adds no stiffness."""
    torque = multisine(1, level)
    q = np.round(bristles(BRISTLES, torque, 1e-3) / 1e-9) * 1e-9
    centred = 0.5 * (torque + np.concatenate([torque[:1], torque[:-1]]))  # as in the recording of sliding
    return {"t": np.arange(len(torque)) * 1e-3, "q": q, "tau": centred}
