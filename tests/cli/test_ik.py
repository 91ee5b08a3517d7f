"""The command ik: every branch, and why there is none."""

import json
from pathlib import Path

import numpy as np
import pytest

from cli.test_workflow import run
from rrrgen.robot.file import load_spec
from rrrgen.verify.references.newton_euler import NewtonEuler
from rrrgen.verify.references.numeric_robot import chain_of


def test_ik_prints_every_branch_and_says_why_there_is_none():
    found = run("ik", "rrr", "--pose", "0.2 -0.4 0.6", "--json")
    assert found.return_value == 0
    rows = json.loads(found.output)["solutions"]
    assert len(rows) == 4
    nearest = run("ik", "rrr", "--pose", "0.2 -0.4 0.6", "--near", "1.4 1.5 2.0", "--json")
    assert np.allclose(json.loads(nearest.output)["solutions"][0]["q"], [1.41677, 1.47716, 2.05795], atol=1e-4)
    none = run("ik", "rrr", "--pose", "2 0 0")
    assert none.return_value == 1
    assert "from reach" in none.output
    closest = run("ik", "rrr", "--pose", "2 0 0", "--closest")
    assert closest.return_value == 0


def test_ik_refuses_poses_of_the_wrong_size():
    with pytest.raises(Exception, match="numbers; wanted 3 or 6 or 16"):
        run("ik", "rrr", "--pose", "1 2")


def test_a_named_tip_is_solved_by_its_own_joints():
    """Roll and pitch of the hand, which finger and thumb share, are as --near says."""
    hand = Path(__file__).resolve().parents[2] / "examples" / "trees" / "hand.yaml"
    q = [0.3, -0.4, 0.2, 0.5, -0.3, 0.6, -0.7, 0.4]
    thumb = NewtonEuler(chain_of(load_spec(hand).at_tip("thumb")), np.zeros((8, 10)))
    pose = " ".join(map(repr, thumb.forward_kinematics(np.array([q]))[0].ravel().tolist()))
    call = ["ik", str(hand), "--backend", "numpy", "--pose", pose, "--no-limits", "--json"]
    found = json.loads(run(*call, "--tip", "thumb", "--near", " ".join(map(str, q))).output)
    assert [joint["name"] for joint in found["joints"]] == ["t1", "t2", "t3"]
    assert np.abs(np.array(found["solutions"][0]["q"]) - q[5:]).max() < 1e-9
    with pytest.raises(Exception, match="--tip thumb needs --near, which holds"):
        run(*call, "--tip", "thumb")
    with pytest.raises(Exception, match="its tips are finger, thumb"):
        run(*call, "--tip", "thum")
