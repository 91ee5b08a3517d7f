"""The recording of one joint: what tells no friction is refused, and named."""

import numpy as np
import pytest

from lab.friction.logs import write_log
from rrrgen.base.errors import DerivationError
from rrrgen.cli.main import run
from rrrgen.lab.data.recordings import Log
from rrrgen.lab.friction.joint_recording import joint_data
from samples.stick_slip_joint import Joint, record


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


@pytest.mark.parametrize(("scale", "unit"), [(1e3, "ms"), (1e6, "us"), (1e9, "ns")])
def test_a_clock_in_another_unit_is_named(moving, scale, unit):
    """It was said to slide for 0 s only."""
    log = Log(("q",), scale * moving["t"], moving["q"][:, None], moving["tau"][:, None])
    with pytest.raises(DerivationError, match=f"clock in {unit} that is read in s"):
        joint_data(log, "q")


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
