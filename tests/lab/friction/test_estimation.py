"""Friction of one joint against the known truth of an independent simulation with stick and slip."""

from __future__ import annotations

import json
from types import SimpleNamespace

import numpy as np
import pytest

from lab.friction.independent import LIMITS
from lab.friction.logs import write_log
from rrrgen.cli.main import run
from rrrgen.lab.friction.candidate_laws import candidates
from rrrgen.lab.friction.estimation import LawEstimate, LawScore, choose, notes, reported_values
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


# ------------------------------------------------------------------------------------------------------------------
# The choice among laws by their losses on held-out windows, and what is said about the one chosen.
# ------------------------------------------------------------------------------------------------------------------

BLOCKS = np.repeat(np.arange(10), 5)


def score(law, parameters, losses, bic=0.0):
    return LawScore(law, parameters, float(np.sqrt(np.mean(losses))), bic, losses)


def test_a_clear_gain_in_a_few_blocks_counts():
    even = np.ones(50)
    rough = even + 40.0 * (BLOCKS == 3) + 30.0 * (BLOCKS == 8)
    assert choose([score("simple", 6, rough), score("rich", 8, even)], BLOCKS) == 1


def test_a_small_uncertain_gain_does_not_pay_for_parameters():
    rng = np.random.default_rng(0)
    simple = 10.0 + rng.normal(size=50)
    rich = simple - 0.02 + rng.normal(size=50)
    assert choose([score("simple", 6, simple), score("rich", 8, rich, bic=-100.0)], BLOCKS) == 0


def test_of_equally_many_parameters_the_criterion_decides():
    even = np.ones(50)
    assert choose([score("a", 8, even, bic=5.0), score("b", 8, even, bic=-5.0)], BLOCKS) == 1


@pytest.mark.parametrize(
    ("gravity", "law", "theta", "held_out", "told"),
    [
        (
            2,
            1,
            [0.1, 1.0, 0.0, 0.2, 0.2, 0.7, 0.5, 0.0],
            1.0,
            ["of the measured torque of 0.1 with equal Coulomb"],
        ),
        (2, 1, [0.1, 1.0, 0.0, 0.2, 0.3, 0.7, 0.5, 0.0], 2.4, ["2.4 times the noise: asymmetric is the best"]),
        (1, 1, [0.1, 1.0, 0.2, 0.3, 0.7, 0.5, 0.0], 1.0, ["gravity is the force for which the two are equal"]),
        (0, 0, [0.1, 0.1, 0.2, 0.6, 0.0], 1.0, ["Coulomb friction of 0.7 forward and 0.5 backward (law asymmetric)"]),
        (0, 0, [0.1, 0.001, 0.2, 0.6, 0.0], 1.35, []),
        (0, 0, [0.1, 0.001, 0.2, 0.6, 0.0], 1.5, ["1.5 times the noise: something is left that coulomb_viscous does"]),
    ],
)
def test_models_that_are_the_same_and_a_poor_fit_are_named(gravity, law, theta, held_out, told):
    law, theta = candidates(gravity)[law], np.array(theta)
    values, rating = reported_values(law, theta, 1e-3), LawScore(law.name, len(theta), held_out, 0.0, np.ones(1))
    chosen = LawEstimate(law, law.balance_coulomb(theta), values, dict.fromkeys(values, 1e-3), rating, values, 0.01)
    found = notes(chosen, SimpleNamespace(speed=1.0))
    assert [part in note for part, note in zip(told, found, strict=True)] == [True] * len(told), found
