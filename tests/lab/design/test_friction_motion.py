"""The motion of a friction experiment: within limits, smooth, at rest at both ends, read back."""

import json
from dataclasses import replace

import numpy as np
import pytest

from rrrgen.cli.main import run
from rrrgen.lab.design.friction_motion import design_friction_motion, read_friction_motion
from rrrgen.robot.file import load_spec


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    place = tmp_path_factory.mktemp("friction")
    assert (
        run(["experiment", "excite", "rrr", "--friction", "q3", "--duration", "30", "--rate", "500", "-o", str(place)])
        == 0
    )
    return place


def test_motion_of_one_joint_within_its_limits(folder):
    table = np.genfromtxt(folder / "results" / "friction_motion.csv", delimiter=",", names=True)
    limits = load_spec("rrr").joints[2].limits
    assert len(table) == 15000
    assert np.abs(table["dq3"]).max() <= float(limits.velocity)
    assert np.abs(table["ddq3"]).max() <= float(limits.acceleration)
    assert np.ptp(table["q1"]) == np.ptp(table["q2"]) == 0.0
    assert abs(table["dq3"][0]) < 1e-12
    assert (folder / "figures" / "friction_motion.png").exists()


def test_fast_first_then_slow_with_reversals(folder):
    table = np.genfromtxt(folder / "results" / "friction_motion.csv", delimiter=",", names=True)
    fast, slow = table["dq3"][:7500], table["dq3"][7500:]
    assert np.std(fast) > 3.0 * np.std(slow)
    assert np.count_nonzero(slow[1:] * slow[:-1] < 0.0) >= 3


def test_speed_and_acceleration_are_derivatives(folder):
    motion = read_friction_motion(folder / "results" / "friction_motion.json")
    t = np.arange(0.0, motion.period, 1e-4)
    q, dq, ddq = (part[:, 2] for part in motion.evaluate(t))
    assert np.abs(np.gradient(q, t) - dq)[1:-1].max() < 1e-4 * np.abs(dq).max()
    assert np.abs(np.gradient(dq, t) - ddq)[1:-1].max() < 1e-4 * np.abs(ddq).max()


def test_tight_position_limits_shrink_the_motion():
    spec = load_spec("pendulum")
    joint = replace(spec.joints[0], limits=replace(spec.joints[0].limits, lower=0.9, upper=1.1))
    motion = design_friction_motion(replace(spec, joints=(joint,)), joint.name, 30.0, 0)
    q = motion.evaluate(np.arange(0.0, 30.0, 1e-3))[0][:, 0]
    assert q.min() >= 0.9
    assert q.max() <= 1.1
    assert np.ptp(q) > 0.1


@pytest.mark.parametrize(("side", "limit"), [("lower", 0.0), ("lower", 0.4), ("upper", -0.2), ("upper", 0.05)])
@pytest.mark.sweep(but=["lower-0.0", "upper--0.2"])
def test_one_position_limit_near_zero_moves_the_motion_away_from_it(side: str, limit: float):
    """A joint with one limit at or beyond zero was centred on it, and refused for lack of room."""
    spec = load_spec("pendulum")
    ranges = []
    for sides in ({side: limit}, {}):
        stated = replace(spec.joints[0].limits, **{"lower": None, "upper": None} | sides)
        joint = replace(spec.joints[0], limits=stated)
        motion = design_friction_motion(replace(spec, joints=(joint,)), joint.name, 30.0, 0)
        q = motion.evaluate(np.arange(0.0, 30.0, 1e-3))[0][:, 0]
        ranges.append(np.ptp(q))
        if side in sides:
            assert q.min() > limit if side == "lower" else q.max() < limit
    assert ranges[0] == pytest.approx(ranges[1], rel=1e-6)  # as large as without a limit


@pytest.mark.parametrize("control", ["pd", "computed-torque"])
def test_the_virtual_robot_holds_the_joints_that_stand(folder, tmp_path, control):
    """The observer of a joint without reference motion used to be so slow that its loop was unstable."""
    motion = str(folder / "results" / "friction_motion.json")
    words = ["--duration", "2.5", "--rate", "500", "--control", control]
    assert run(["experiment", "simulate", "rrr", "--trajectory", motion, *words, "-o", str(tmp_path)]) == 0
    table = np.genfromtxt(tmp_path / "results" / "log.csv", delimiter=",", names=True)
    assert np.abs(table["tau_q1"]).max() < 30.0
    assert np.abs(table["q_q1"]).max() < 0.1  # under PD control without gravity the others give way a little
    assert np.abs(table["q_q1"][-500:]).max() < 0.02


def test_an_unknown_joint_and_a_short_experiment_are_refused(tmp_path, capsys):
    assert run(["experiment", "excite", "rrr", "--friction", "elbow", "-o", str(tmp_path / "a")]) == 3
    assert "q1, q2, q3" in capsys.readouterr().err
    assert run(["experiment", "excite", "rrr", "--friction", "q3", "--duration", "5", "-o", str(tmp_path / "b")]) == 3
    assert "too short" in capsys.readouterr().err
    assert not (tmp_path / "a" / "results").exists()


def test_the_file_says_what_it_is(folder, tmp_path):
    data = json.loads((folder / "results" / "friction_motion.json").read_text())
    assert data["schema"] == "rrrgen-friction-motion/1"
    (tmp_path / "other.json").write_text("{}")
    assert read_friction_motion(tmp_path / "other.json") is None
