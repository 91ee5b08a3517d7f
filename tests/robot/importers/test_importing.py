"""Choices of an import: wrong ones are refused, several tips are listed, and kept where they are chosen."""

from __future__ import annotations

from dataclasses import replace

import pytest

from robot.importers.urdf_files import AGREE, ARM, write
from rrrgen.base.errors import InputError
from rrrgen.robot.importers.importing import import_robot
from rrrgen.robot.importers.interface import ChainChoice
from rrrgen.verify.references.imported_source import compare_with_source

CHOICES = {
    "tip": (ChainChoice(tip="tol"), "the tip: there is no link 'tol'"),
    "base": (ChainChoice(base="bas"), "the base: there is no link 'bas'"),
    "hold": (ChainChoice(held={"lit": 0}), "there is no joint 'lit' to hold"),
    "nothing moves": (
        ChainChoice(tip="tool", base="lower"),
        r":\d+:\d+: error: no joint moves between 'lower' and 'tool'",
    ),
}


@pytest.mark.parametrize("case", CHOICES)
def test_a_wrong_choice_is_refused(case, tmp_path):
    choice, message = CHOICES[case]
    with pytest.raises(InputError, match=message):
        import_robot(write(tmp_path, ARM), chain=choice)


@pytest.mark.parametrize("name", ["0 link", "true"])
def test_a_name_that_no_robot_can_have_is_a_fault_in_place_unless_another_is_given(name, tmp_path):
    file = write(tmp_path, ARM.replace("two link", name))
    with pytest.raises(InputError, match=r":1:1: error: the robot name (.|\n)*give another with --name"):
        import_robot(file)
    assert import_robot(file, name="arm").spec.name == "arm"


def test_a_length_of_a_calibration_is_a_decimal_number(tmp_path):
    rows = "dh_theta: [0,0,0,0,0,0]\ndh_a: [0,0,0,0,0,0]\ndh_d: [.1,0,pi -3.1,0,0,0]\ndh_alpha: [0,0,0,0,0,0]\n"
    with pytest.raises(InputError, match=r":3:13: error: an entry of dh_d is pi -3.1, not a decimal number"):
        import_robot(write(tmp_path, rows, "arm.yaml"), "ur-calibration")


def test_several_tips_are_listed(tmp_path):
    more = '<link name="cup"/><joint name="c" type="fixed"><parent link="lower"/><child link="cup"/></joint></robot>'
    with pytest.raises(
        InputError,
        match=r":\d+:\d+: error: the file has 2 chains from 'base'(.|\n)*cup \(2 joints\), tool \(2 joints\)",
    ):
        import_robot(write(tmp_path, ARM.replace("</robot>", more)))


BODY = """<inertial><origin xyz="0.05 -0.02 0.1" rpy="0.3 0 0.2"/><mass value="{0}"/>
    <inertia ixx="0.{0}1" iyy="0.{0}2" izz="0.{0}2" ixy="0.001" ixz="0" iyz="0.002"/></inertial>"""
JOINTS = {
    "yaw": ("pedestal torso revolute", "0 0 0.4", "0 0 0.2", "0 0 1"),
    "ls": ("torso left_upper revolute", "0.05 0.2 0.3", "0.4 -1.2 0", "0 0 1"),
    "le": ("left_upper left_lower revolute", "0.3 0 0.02", "0 0 0.5", "0 1 0"),
    "lh": ("left_lower left_hand fixed", "0.2 0 0.1", "0 1 0", "1 0 0"),
    "rs": ("torso right_upper revolute", "0.05 -0.2 0.3", "-0.4 1.1 0", "0 1 0"),
    "re": ("right_upper right_lower prismatic", "0.3 0 0.02", "0 0 0.5", "0 0 1"),
    "nod": ("torso head revolute", "0 0 0.5", "0 0 0", "0 1 0"),
}
"""Two arms and a head on a yawing torso: parent, child and type; origin and angles; axis."""


def urdf_of_two_arms() -> str:
    lines = ['<robot name="two arms">', '<link name="pedestal"/>']
    for k, (name, (ends, xyz, rpy, axis)) in enumerate(JOINTS.items(), 1):
        parent, child, kind = ends.split()
        body = "" if kind == "fixed" else BODY.format(k)
        lines += [f'<link name="{child}">{body}</link>']
        lines += [f'<joint name="{name}" type="{kind}"><origin xyz="{xyz}" rpy="{rpy}"/><parent link="{parent}"/>']
        lines += [f'<child link="{child}"/><axis xyz="{axis}"/>']
        lines += ['<limit lower="-2" upper="2" effort="9" velocity="3"/></joint>']
    return "\n".join([*lines, "</robot>"])


def mjcf_of_two_arms() -> str:
    def body(name: str) -> str:
        inside = ""
        for k, (joint, (ends, xyz, rpy, axis)) in enumerate(JOINTS.items(), 1):
            parent, child, kind = ends.split()
            if parent != name:
                continue
            kinds = {"revolute": "hinge", "prismatic": "slide"}
            moved = "" if kind == "fixed" else f'<joint name="{joint}" type="{kinds[kind]}" axis="{axis}"/>'
            mass = f'<inertial pos="0.05 -0.02 0.1" mass="{k}" diaginertia="0.{k}1 0.{k}2 0.{k}2"/>'
            held = "" if kind == "fixed" else mass
            inside += f'<body name="{child}" pos="{xyz}" euler="{rpy}">{held}{moved}{body(child)}</body>'
        return inside

    world = f'<worldbody><body name="pedestal">{body("pedestal")}</body></worldbody>'
    return f'<mujoco model="two arms"><compiler angle="radian" eulerseq="XYZ"/>{world}</mujoco>'


TIPS = ChainChoice(tip="left_hand", further_tips=("right_lower", "torso"), convention="modified")


@pytest.mark.parametrize(("form", "package"), [("urdf", "pinocchio"), ("mjcf", "mujoco")])
def test_chosen_tips_of_a_tree_are_kept_with_their_branches(form, package, tmp_path):
    pytest.importorskip(package)
    text = urdf_of_two_arms() if form == "urdf" else mjcf_of_two_arms()
    found = import_robot(write(tmp_path, text, f"arms.{form if form == 'urdf' else 'xml'}"), chain=TIPS)
    assert [joint.name for joint in found.spec.joints] == ["yaw", "ls", "le", "rs", "re"]
    assert found.spec.parents == (-1, 0, 1, 0, 3)
    assert {name: tip.row for name, tip in found.spec.tips.items()} == {
        "left_hand": "le", "right_lower": "re", "torso": "yaw"
    }  # fmt: skip
    compared = compare_with_source(found)  # the head is held, its mass belongs to the torso
    assert compared.pose < AGREE
    assert compared.torque < AGREE


def test_a_branch_may_start_at_the_base_and_a_tip_below_another(tmp_path):
    pytest.importorskip("pinocchio")
    text = urdf_of_two_arms().replace(
        '<joint name="rs" type="revolute"><origin xyz="0.05 -0.2 0.3" rpy="-0.4 1.1 0"/><parent link="torso"/>',
        '<joint name="rs" type="revolute"><origin xyz="0.05 -0.2 0.3" rpy="-0.4 1.1 0"/><parent link="pedestal"/>',
    )
    choice = ChainChoice(tip="left_upper", further_tips=("right_lower", "left_hand"), convention="modified")
    found = import_robot(write(tmp_path, text), chain=choice)
    assert found.spec.parents == (-1, 0, -1, 2, 1)
    compared = compare_with_source(found)
    assert max(compared.pose, compared.torque) < AGREE
    text = text.replace('parent link="left_upper"', 'parent link="left_uppr"')
    with pytest.raises(InputError, match="left_uppr"):
        import_robot(write(tmp_path, text), chain=choice)


def test_branches_need_modified_rows_and_joints(tmp_path):
    file = write(tmp_path, urdf_of_two_arms())
    with pytest.raises(InputError, match="standard rows cannot branch"):
        import_robot(file, chain=replace(TIPS, convention="standard"))
    with pytest.raises(InputError, match="the tip: there is no link 'right_hnd'"):
        import_robot(file, chain=replace(TIPS, further_tips=("right_hnd",)))
    with pytest.raises(InputError, match="no joint moves between 'pedestal' and 'pedestal'"):
        import_robot(file, chain=replace(TIPS, further_tips=("pedestal",)))


def test_a_choice_of_a_chain_needs_a_tree(tmp_path):
    file = write(tmp_path, "dh_theta: [0]\n", "arm.yaml")
    with pytest.raises(InputError, match="ur-calibration is one chain already"):
        import_robot(file, chain=ChainChoice(tip="tool"))
