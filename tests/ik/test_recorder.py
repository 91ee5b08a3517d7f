"""The recorder: the variables of the target are known before any choice, and have the names of their entries."""

from __future__ import annotations

import pytest

from rrrgen.base.errors import InternalError
from rrrgen.ik.recording import steps
from rrrgen.ik.recording.recorder import Recorder

POSE = ["r11", "r12", "r13", "r21", "r22", "r23", "r31", "r32", "r33", "px", "py", "pz"]


def names(values):
    return [value.text for value in values]


def test_the_target_position_and_the_tool_are_known_before_any_choice():
    recorder = Recorder()
    point, tool = recorder.point(), recorder.tool()
    assert names(point) == ["px", "py", "pz"]
    assert names(tool) == ["tx", "ty", "tz"]
    assert [value.level for value in (*point, *tool)] == [0] * 6
    assert [type(step) for step in recorder._steps] == [steps.TargetStep, steps.ToolStep]
    assert [step.results for step in recorder._steps] == [point, tool]


def test_the_target_pose_is_one_target_however_often_it_is_read():
    recorder = Recorder()
    pose = recorder.pose()
    flat = [*(entry for row in pose.R for entry in row), *pose.t]
    assert names(flat) == POSE
    assert [value.level for value in flat] == [0] * 12
    again = recorder.pose()
    assert (again.R, again.t) == (pose.R, pose.t)
    assert len(recorder._steps) == 1


def test_a_name_is_at_the_level_of_its_value_and_no_name_is_given_twice():
    recorder = Recorder()
    x, y, _ = recorder.point()
    first, second = recorder.name("a", x + y), recorder.name("a", x - y)
    assert names([first, second]) == ["a", "a_2"]
    assert (first.level, second.level) == (0, 0)
    assert recorder.name("a", x) is x


def test_an_arm_with_an_unsolved_joint_has_no_solver():
    with pytest.raises(InternalError, match=r"\[1, 2\]"):
        Recorder().solver(2)
