"""The command ik: every branch, and why there is none."""

import json

import numpy as np
import pytest

from cli.test_workflow import run


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
