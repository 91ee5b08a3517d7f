"""Friction of one joint against the known truth of an independent simulation with stick and slip."""

import json

import numpy as np
import pytest

from friction_estimation.independent import LIMITS
from rrrgen.cli.main import run
from rrrgen.lab.data.recordings import Log
from rrrgen.lab.friction.estimation import estimate_friction
from rrrgen.lab.friction.joint_recording import joint_data
from rrrgen.robot.file import load_spec
from rrrgen.robot.friction.laws import LAWS
from samples.stick_slip_joint import Joint, bristles, multisine, record

BRISTLES = Joint("lugre", sigma0=1e4, sigma1=10.0, gravity=0.0)


def write_log(path, found, joints=("q1", "q2", "q3"), moving="q3"):
    """The recording of one joint as a log of rrrgen's own columns; the other joints stand still."""
    still = np.zeros_like(found["t"])
    columns = {"t": found["t"]}
    columns |= {f"q_{name}": found["q"] if name == moving else still for name in joints}
    columns |= {f"tau_{name}": found["tau"] if name == moving else still for name in joints}
    table = np.column_stack(list(columns.values()))
    np.savetxt(path, table, delimiter=",", header=",".join(columns), comments="", fmt="%.15g")
    return path


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


@pytest.fixture(scope="module")
def moving():
    """A joint that moves as it should."""
    return record(Joint(), duration=16.0, substeps=2)


def refused(tmp_path, capsys, found, joint="q3"):
    log = write_log(tmp_path / "log.csv", found)
    code = run(["experiment", "friction", "rrr", "--log", str(log), "--joint", joint, "-o", str(tmp_path / "run")])
    assert not (tmp_path / "run" / "results").exists()
    return code, capsys.readouterr().err


def test_too_little_data_is_refused(tmp_path, capsys):
    code, message = refused(tmp_path, capsys, record(Joint(), duration=6.0, substeps=2))
    assert code == 4
    assert "too little" in message
    assert "15 s" in message


def test_a_joint_that_stands_is_refused(tmp_path, capsys):
    rng, t = np.random.default_rng(0), np.arange(20_000) * 1e-3
    q = 0.3 + 1e-5 * rng.integers(-1, 2, len(t))
    code, message = refused(tmp_path, capsys, {"t": t, "q": q, "tau": rng.normal(size=len(t))})
    assert code == 4
    assert "no excitation" in message


def test_a_torque_that_does_not_belong_to_the_motion_is_refused(moving, tmp_path, capsys):
    noise = np.random.default_rng(0).normal(size=len(moving["t"]))
    code, message = refused(tmp_path, capsys, moving | {"tau": noise})
    assert code == 4
    assert "does not belong" in message


def test_a_torque_of_the_wrong_sign_is_named(moving, tmp_path, capsys):
    code, message = refused(tmp_path, capsys, moving | {"tau": -moving["tau"]})
    assert code == 4
    assert "negative inertia" in message


@pytest.mark.parametrize("value", [0.0, 0.3])
def test_a_constant_torque_is_refused(value, moving, tmp_path, capsys):
    code, message = refused(tmp_path, capsys, moving | {"tau": np.full(len(moving["t"]), value)})
    assert code == 4
    assert "torque of joint 'q3' is constant" in message


def test_motion_in_one_direction_is_refused(tmp_path, capsys):
    t = np.arange(20_000) * 1e-3
    q = np.round((0.5 * t + 0.1 * np.sin(t)) / 1e-5) * 1e-5
    code, message = refused(tmp_path, capsys, {"t": t, "q": q, "tau": np.sin(t)})
    assert code == 4
    assert "both directions" in message


def test_another_joint_that_moves_is_refused(moving, tmp_path, capsys):
    log = write_log(tmp_path / "log.csv", moving)
    table = np.genfromtxt(log, delimiter=",", names=True)
    table["q_q1"] = np.sin(table["t"])
    np.savetxt(log, table, delimiter=",", header=",".join(table.dtype.names), comments="")
    code = run(["experiment", "friction", "rrr", "--log", str(log), "--joint", "q3", "-o", str(tmp_path / "run")])
    assert code == 4
    assert "joint 'q1' moves" in capsys.readouterr().err


def test_an_unknown_joint_is_named(tmp_path, capsys):
    code, message = refused(tmp_path, capsys, record(Joint(), duration=1.0, substeps=2), joint="elbow")
    assert code == 3
    assert "q1, q2, q3" in message


@pytest.mark.parametrize(
    ("sigma0", "sigma1", "period"), [(5e3, 10.0, 2e-3), (1.5e4, 15.0, 4e-3)], ids=["soft", "stiff"]
)
def test_bristles_are_told_with_honest_deviations(sigma0, sigma1, period):
    """How far they are bent and how fast they ring when a window begins is unknown: a guess spoils all deviations."""
    truth = Joint("lugre", sigma0=sigma0, sigma1=sigma1, gravity=0.0)
    found = record(truth, duration=16.0, period=period, substeps=round(4000 * period), finer=5)
    data = joint_data(Log(("q",), found["t"], found["q"][:, None], found["tau"][:, None]), "q")
    chosen = estimate_friction(data, 0, ("lugre",)).chosen
    assert chosen.name == "lugre"
    assert chosen.score.held_out < 1.0
    actual = {"inertia": truth.inertia, "sigma0": truth.sigma0, "sigma1": truth.sigma1, "stiction_excess": truth.excess}
    limits = {"sigma1": 0.01 if sigma0 < 1e4 else 0.05}  # stiff bristles ring for a few samples only
    for name, value in actual.items():
        assert chosen.values[name] == pytest.approx(value, rel=limits.get(name, 0.01)), name
        assert abs(chosen.values[name] - value) < 3.0 * chosen.std[name], name


def test_rigid_bristles_do_not_speak_for_the_stribeck_law():
    """LuGre with bristles too stiff for the sampling rate describes sticking best here, sliding is Coulomb-viscous."""
    found = record(Joint("coulomb_viscous", angle=0.7), duration=16.0, period=4e-3, substeps=5, torque_noise=0.01)
    data = joint_data(Log(("q",), found["t"], found["q"][:, None], found["tau"][:, None]), "q")
    estimate = estimate_friction(data, 2, ("coulomb_viscous", "lugre"))
    assert estimate.chosen.name == "coulomb_viscous"
