"""Several tools of one robot: each is a robot of its own name, with the same arm."""

from __future__ import annotations

import numpy as np
import pytest

from robot.file.sample import SAMPLE
from rrrgen.base.errors import InputError
from rrrgen.robot.file import dumps, load_spec, loads_spec
from rrrgen.verify.references.newton_euler import NewtonEuler
from rrrgen.verify.references.numeric_robot import chain_of

TOOLS = "tools:\n  camera: {translation: [0, 0.1, 0.2], rpy: [0, pi/2, 0]}\n  pin: {}\n"


def write(folder, text):
    (folder / "arm.yaml").write_text(text, encoding="utf-8")
    return folder / "arm.yaml"


def test_a_tool_takes_the_place_of_the_tool(tmp_path):
    file = write(tmp_path, SAMPLE + TOOLS)
    plain, camera, pin = (load_spec(f"{file}{tool}") for tool in ("", "@camera", "@pin"))
    assert (camera.name, pin.name) == ("elbow3_camera", "elbow3_pin")
    assert pin.tool == plain.tool
    q = np.array([[0.3, 0.1]])
    ours, bare = (NewtonEuler(chain_of(s), np.zeros((2, 10))).forward_kinematics(q)[0] for s in (camera, plain))
    np.testing.assert_allclose(ours[:3, 3], bare[:3, 3] + bare[:3, :3] @ [0, 0.1, 0.2], atol=1e-15)
    np.testing.assert_allclose(ours[:3, 0], -bare[:3, 2], atol=1e-15)
    assert loads_spec(dumps(plain)) == plain


def test_an_unknown_tool_and_a_bad_one(tmp_path):
    file = write(tmp_path, SAMPLE + TOOLS)
    with pytest.raises(InputError, match=r"the robot has no tool 'camra'(.|\n)*did you mean 'camera'"):
        load_spec(f"{file}@camra")
    with pytest.raises(InputError, match="tools are none"):
        load_spec("rrr@gripper")
    with pytest.raises(InputError, match=r"15:\d+: error: (.|\n)*translation of tool pin"):
        loads_spec(SAMPLE + "tools:\n  pin: {translation: [0, 1]}\n")
    with pytest.raises(InputError, match="tool"):
        loads_spec(SAMPLE + "tools: {2x: {}}\n")


def test_an_at_sign_in_a_path_is_a_path(tmp_path):
    folder = tmp_path / "me@home"
    folder.mkdir()
    assert load_spec(write(folder, SAMPLE)).name == "elbow3"
